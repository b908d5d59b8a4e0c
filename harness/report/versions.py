"""Versions of the software that computed a result."""

import platform as machine
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python and of relevant packages, and the type of machine."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    """Read the versions from package metadata, once: it takes longer than a short run."""
    installed = {"python": machine.python_version()}
    for package in PACKAGES:
        with suppress(PackageNotFoundError):  # such as those of the extra `fmu`
            installed[package] = version(package)
    return {**installed, "machine": f"{machine.system()} {machine.machine()}"}

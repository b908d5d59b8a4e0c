"""Versions of the software that computed a result."""

import platform as machine
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python and of relevant packages, and the type of machine."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    """Read the versions from package metadata, once: it takes longer than a short run."""
    return {
        "python": machine.python_version(),
        **{package: found for package in PACKAGES if (found := _version(package)) is not None},
        "machine": f"{machine.system()} {machine.machine()}",
    }


def _version(package: str) -> str | None:
    """The version of a package; None if it is not installed, such as those of the extra `fmu`."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None

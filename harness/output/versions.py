"""What a result was made with."""

import platform as machine
from functools import cache
from importlib.metadata import version

PACKAGES = ("gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that matter, and the kind of machine."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    """Read from the packages' metadata once, which takes longer than a short run."""
    return {
        "python": machine.python_version(),
        **{package: version(package) for package in PACKAGES},
        "machine": f"{machine.system()} {machine.machine()}",
    }

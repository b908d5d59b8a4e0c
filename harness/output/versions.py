"""What a result was made with."""

import platform as machine
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that matter, and the kind of machine."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    """Read from the packages' metadata once, which takes longer than a short run."""
    return {
        "python": machine.python_version(),
        **{package: found for package in PACKAGES if (found := _version(package)) is not None},
        "machine": f"{machine.system()} {machine.machine()}",
    }


def _version(package: str) -> str | None:
    """None of one that is not installed, as those of the extra `fmu` may be."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None

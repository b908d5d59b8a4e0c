"""Errors of the build, among them a missing package of the extra `fmu`, which only building or running FMUs needs."""

from importlib.util import find_spec

from gough_stewart.model.errors import GoughStewartError

RUNNER, COMPILER = "fmpy", "ziglang"


class BuildError(GoughStewartError):
    """An FMU cannot be built: a wrong option, a package that is not installed, or a compiler error."""


def check_installed(*packages: str) -> None:
    """Check that these packages, `RUNNER` or `COMPILER`, are installed, without importing them.

    Raises
    ------
    BuildError
        A package is missing; the message tells how to install it.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        uses = {RUNNER: "to run FMUs", COMPILER: "to compile FMUs"}
        packages_and_uses = " and ".join(f"{package} ({uses[package]})" for package in missing)
        raise BuildError(f"not installed: {packages_and_uses}; install the extra: pip install 'gough-stewart[fmu]'")

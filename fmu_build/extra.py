"""The extra `fmu`: packages that are needed only to build or run FMUs."""

from importlib.util import find_spec

from gough_stewart.fmu_build.errors import BuildError

RUNNER, COMPILER = "fmpy", "ziglang"


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

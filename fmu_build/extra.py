"""What only those need who build or run FMUs: the extra `fmu` of this package, a quarter of its weight."""

from importlib.util import find_spec

from gough_stewart.fmu_build.errors import BuildError

RUNNER, COMPILER = "fmpy", "ziglang"


def check_installed(*packages: str) -> None:
    """Raise unless these packages, of `RUNNER` and `COMPILER`, are there; nothing is imported.

    Raises
    ------
    BuildError
        Names what is missing, and how to install it.
    """
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        uses = {RUNNER: "runs FMUs", COMPILER: "compiles them"}
        what = " and ".join(f"{package}, which {uses[package]}" for package in missing)
        raise BuildError(f"not installed: {what}; expected the extra: pip install 'gough-stewart[fmu]'")

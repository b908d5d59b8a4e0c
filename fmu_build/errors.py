"""Errors of the build, among them a missing package of the extra `compile`."""

from gough_stewart.model.errors import GoughStewartError, NotInstalledError
from gough_stewart.model.process import installed
from gough_stewart.model.process.installed import TRACER

RUNNER, COMPILER = "fmpy", "ziglang"
_USES = {TRACER: "to trace equations", COMPILER: "to compile"}


class BuildError(GoughStewartError):
    """An FMU cannot be built: a wrong option, a package that is not installed, or a compiler error."""


def check_installed(*packages: str) -> None:
    """Check that these packages, `TRACER` or `COMPILER`, are installed, without importing them.

    Raises
    ------
    BuildError
        A package is missing; the message tells how to install it.
    """
    try:
        installed.check_installed({package: _USES[package] for package in packages})
    except NotInstalledError as error:
        raise BuildError(str(error)) from None

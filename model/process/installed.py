"""Packages of the extra `compile`, which are needed only where something new is traced or compiled."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec

from gough_stewart.model.errors import NotInstalledError

TRACER = "casadi"


def check_installed(uses: Mapping[str, str]) -> None:
    """Check that packages are installed, without importing them.

    Parameters
    ----------
    uses
        What each is needed for, by its name.

    Raises
    ------
    NotInstalledError
        One is missing; the message tells what for, and how to install it.
    """
    missing = [package for package in uses if find_spec(package) is None]
    if missing:
        raise _not_installed(" and ".join(f"{package} ({uses[package]})" for package in missing))


@contextmanager
def tracer_is_named() -> Iterator[None]:
    """Context for importing and running what traces equations from its first line on.

    Raises
    ------
    NotInstalledError
        CasADi is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != TRACER:
            raise
        raise _not_installed(f"{TRACER} (to trace equations)") from None


def _not_installed(packages: str) -> NotInstalledError:
    return NotInstalledError(f"not installed: {packages}; install the extra: pip install 'gough-stewart[compile]'")

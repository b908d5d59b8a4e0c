"""What must be installed and set where this runs: packages of the extra `compile`, and environment variables.

The packages are needed only where something new is traced or compiled. With these variables, libraries would fail
later, in words of their own.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec

from gough_stewart.model.errors import EnvironmentVariableError, NotInstalledError

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


@cache
def check_environment() -> None:
    """Refuse values that Polars and NumPy cannot read; replace a backend of matplotlib that is not there.

    Raises
    ------
    EnvironmentVariableError
        POLARS_MAX_THREADS or SOURCE_DATE_EPOCH is not a number of their kind.
    """
    for name, least, expected in (
        ("POLARS_MAX_THREADS", 1, "a number of threads of at least 1"),
        ("SOURCE_DATE_EPOCH", 0, "a whole number of seconds since 1970"),
    ):
        value = os.environ.get(name)
        if value is not None and not (value.isascii() and value.isdigit() and int(value) >= least):
            raise EnvironmentVariableError(
                f"the environment variable {name} is '{value}'; expected {expected}; unset it"
            )
    # a notebook names its own backend to all commands, which may run in another environment; no window is opened here
    backend = os.environ.get("MPLBACKEND", "")
    if backend.startswith("module://"):
        try:
            is_there = find_spec(backend.removeprefix("module://")) is not None
        except (ImportError, ValueError):
            is_there = False
        if not is_there:
            os.environ["MPLBACKEND"] = "agg"


def _not_installed(packages: str) -> NotInstalledError:
    return NotInstalledError(f"not installed: {packages}; install the extra: pip install 'gough-stewart[compile]'")

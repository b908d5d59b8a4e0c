"""Environment variables at which libraries would fail later, in words of their own."""

import importlib.util
import os
from functools import cache

from gough_stewart.model.errors import EnvironmentVariableError

_MODULE = "module://"


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
    if backend.startswith(_MODULE) and not _exists(backend.removeprefix(_MODULE)):
        os.environ["MPLBACKEND"] = "agg"


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False

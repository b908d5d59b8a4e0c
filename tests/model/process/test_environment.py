"""Environment variables that a library could not read: told by name and value, with what is expected."""

import os
import re

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.model.process.installed import environment

# Name, value, and what is expected; ² and the Arabic three are digits for Python, and not for the libraries.
WRONG = [
    *(("POLARS_MAX_THREADS", value, "a number of threads of at least 1") for value in ("0", "", "-1", "2.5", "²")),
    *(("SOURCE_DATE_EPOCH", value, "a whole number of seconds since 1970") for value in ("abc", "", "-1", "٣")),
]
# Backends, and what is left of them: other kinds of names are matplotlib's to judge.
BACKENDS = {
    "module://no_such_module_here.backend": "agg",
    "module://relative..name": "agg",
    "module://json.decoder": "module://json.decoder",
    "svg": "svg",
    "no_such_module_here": "no_such_module_here",
}


def test_values_that_a_library_cannot_read_are_refused_and_a_missing_backend_is_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("POLARS_MAX_THREADS", "SOURCE_DATE_EPOCH", "MPLBACKEND"):
        monkeypatch.delenv(name, raising=False)
    for name, value, expected in WRONG:
        monkeypatch.setenv(name, value)
        text = f"the environment variable {name} is '{value}'; expected {expected}; unset it"
        with pytest.raises(GoughStewartError, match=f"^{re.escape(text)}$"), environment():
            pass
        monkeypatch.setenv(name, "1")
        with environment():
            pass
    for backend, left in BACKENDS.items():
        monkeypatch.setenv("MPLBACKEND", backend)
        with environment():
            pass
        assert os.environ["MPLBACKEND"] == left

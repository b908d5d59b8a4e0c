"""Environment variables that a library could not read: told by name and value, with what is expected."""

import os
import re
from collections.abc import Iterator

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.model.process.installed import check_environment

_NAMES = ("POLARS_MAX_THREADS", "SOURCE_DATE_EPOCH", "MPLBACKEND")


@pytest.fixture(autouse=True)
def _fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """None of them set, and nothing remembered of an earlier check."""
    for name in _NAMES:
        monkeypatch.delenv(name, raising=False)
    check_environment.cache_clear()
    yield
    check_environment.cache_clear()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        *(("POLARS_MAX_THREADS", value, "a number of threads of at least 1") for value in ("0", "", "-1", "2.5", "²")),
        *(("SOURCE_DATE_EPOCH", value, "a whole number of seconds since 1970") for value in ("abc", "", "-1", "٣")),
    ],
)
def test_a_value_that_a_library_cannot_read_is_refused(
    name: str, value: str, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the whole sentence; ² and the Arabic three are digits for Python, and not for the libraries."""
    monkeypatch.setenv(name, value)
    text = f"the environment variable {name} is '{value}'; expected {expected}; unset it"
    with pytest.raises(GoughStewartError, match=f"^{re.escape(text)}$"):
        check_environment()
    monkeypatch.setenv(name, "1")
    check_environment()
    assert "MPLBACKEND" not in os.environ


@pytest.mark.parametrize(
    ("backend", "left"),
    [
        ("module://no_such_module_here.backend", "agg"),
        ("module://relative..name", "agg"),
        ("module://json.decoder", "module://json.decoder"),
        ("svg", "svg"),
        ("no_such_module_here", "no_such_module_here"),
    ],
)
def test_only_a_backend_that_is_not_there_is_replaced(backend: str, left: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: by the one without a window; other kinds of names are matplotlib's to judge."""
    monkeypatch.setenv("MPLBACKEND", backend)
    check_environment()
    assert os.environ["MPLBACKEND"] == left

"""Tables of experiments: how their validators come to be."""

import os
import signal
from typing import Any

import pytest

from gough_stewart.harness.section import TableSection


class Loud(TableSection):
    """A table during whose building a signal arrives."""

    size: int

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return handler(source)


def test_an_interrupt_while_a_validator_is_built_comes_after_it() -> None:
    """Expected: Python's own exception, and a validator; pydantic's builder makes a SchemaError of an interrupt."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Loud(size=3)
    finally:
        signal.signal(signal.SIGINT, handler)
    assert Loud.__pydantic_complete__
    assert Loud(size=3).size == 3

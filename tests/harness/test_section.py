"""Tables of experiments: how their validators come to be."""

import os
import signal
from typing import Any

import pytest
from pydantic import Field

from gough_stewart.harness.section import FileName, TableSection, file_names


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


def test_files_are_found_in_every_table_by_their_keys() -> None:
    """Expected: keys that name files, also in elements of lists, which count from 1."""

    class Named(TableSection):
        file: FileName | None = None
        other: str = "no.csv"

    class Whole(TableSection):
        first: Named = Named()
        several: list[Named] = Field(default_factory=list)
        fmu: FileName = "a.fmu"

    several = [Named(), Named(file="two.csv"), Named(file="three.csv")]
    found = file_names(Whole(first=Named(file="one.csv"), several=several))
    assert found == {
        ("first", "file"): "one.csv",
        ("several", "2", "file"): "two.csv",
        ("several", "3", "file"): "three.csv",
        ("fmu",): "a.fmu",
    }

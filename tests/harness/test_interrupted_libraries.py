"""Ctrl-C while a library works that calls Python functions, and makes an error of its own of what they raise."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import polars
import pytest

from gough_stewart.harness.section import TableSection
from gough_stewart.harness.table_file import read_parquet, scan_parquet, write_to

TABLE = polars.DataFrame({"time": [7.3, 7.4], "F*[1]": [1.0, -2.0]})


@contextmanager
def interrupted() -> Iterator[None]:
    """Expects Python's own exception of a signal."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            yield
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_while_polars_writes_leaves_a_whole_file(tmp_path: Path) -> None:
    """Expected: the interrupt, not a panic of Rust, and the table, of a name with a pattern's characters."""
    path = tmp_path / "run[1]*.parquet"

    def write(target: Path | BytesIO) -> None:
        signal.raise_signal(signal.SIGINT)
        TABLE.write_parquet(target)

    with interrupted():
        write_to(path, write)
    assert read_parquet(path).equals(TABLE)
    assert scan_parquet(path).collect().equals(TABLE)


class Loud(TableSection):
    """A table during whose building a signal arrives."""

    size: int

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return handler(source)


def test_ctrl_c_while_pydantic_builds_a_validator_comes_after_it() -> None:
    """Expected: the interrupt, not a SchemaError, and a validator."""
    with interrupted():
        Loud(size=3)
    assert Loud.__pydantic_complete__
    assert Loud(size=3).size == 3

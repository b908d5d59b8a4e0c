"""Ctrl-C while Polars works, whose Rust calls Python functions in which an exception becomes a panic."""

import signal
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import polars
import pytest

from gough_stewart.harness.polars_paths import read_parquet, scan_parquet, write_to

TABLE = polars.DataFrame({"time": [7.3, 7.4], "F*[1]": [1.0, -2.0]})


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("read", [read_parquet, scan_parquet])
def test_ctrl_c_while_polars_reads_comes_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Any) -> None:
    """Expected: the interrupt, and Polars was not broken off."""
    TABLE.write_parquet(tmp_path / "a.parquet")
    ended, of_polars = list[str](), getattr(polars, read.__name__)

    def interrupted(*arguments: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        ended.append("read")
        return of_polars(*arguments, **options)

    monkeypatch.setattr(polars, read.__name__, interrupted)
    with pytest.raises(KeyboardInterrupt):
        read(tmp_path / "a.parquet")
    assert ended == ["read"]


def test_ctrl_c_while_polars_writes_leaves_a_whole_file(tmp_path: Path) -> None:
    """Expected: the table that was written, of a name with a pattern's characters."""
    path = tmp_path / "run[1]*.parquet"

    def write(target: Path | BytesIO) -> None:
        signal.raise_signal(signal.SIGINT)
        TABLE.write_parquet(target)

    with pytest.raises(KeyboardInterrupt):
        write_to(path, write)
    assert read_parquet(path).equals(TABLE)
    assert scan_parquet(path).collect().equals(TABLE)

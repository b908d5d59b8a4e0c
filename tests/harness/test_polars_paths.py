"""Ctrl-C while Polars works, whose Rust calls Python functions in which an exception becomes a panic."""

import signal
from io import BytesIO
from pathlib import Path

import polars
import pytest

from gough_stewart.harness.polars_paths import read_parquet, scan_parquet, write_to

TABLE = polars.DataFrame({"time": [7.3, 7.4], "F*[1]": [1.0, -2.0]})


def test_ctrl_c_while_polars_writes_leaves_a_whole_file(tmp_path: Path) -> None:
    """Expected: the interrupt, and the table that was written, of a name with a pattern's characters."""
    path = tmp_path / "run[1]*.parquet"

    def write(target: Path | BytesIO) -> None:
        signal.raise_signal(signal.SIGINT)
        TABLE.write_parquet(target)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            write_to(path, write)
    finally:
        signal.signal(signal.SIGINT, before)
    assert read_parquet(path).equals(TABLE)
    assert scan_parquet(path).collect().equals(TABLE)

"""Columns of tables as numbers: their types, what is refused in them, and times with more digits than a number has."""

import os
from pathlib import Path

import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import TableError
from gough_stewart.harness.table_file import numbers_of, read_table, times_of

NS = 1_700_000_000_123_456_789


def test_columns_are_numbers_by_their_names(tmp_path: Path) -> None:
    """Expected: what was written, of integers, floats, singles and texts, in CSV and Parquet."""
    columns = {
        "whole": [3, -4, 5],
        "real": [0.1, 2.5e-7, -3e9],
        "single": polars.Series([0.5, 0.25, -8], dtype=polars.Float32),
        "text": ["1.5", "-2e3", "7"],
    }
    table = polars.DataFrame(columns)
    table.write_parquet(tmp_path / "t.parquet")
    table.write_csv(tmp_path / "t.csv")
    for name in ("t.parquet", "t.csv"):
        read = read_table(tmp_path / name, "log")
        for column, values in (("whole", [3, -4, 5]), ("real", [0.1, 2.5e-7, -3e9]), ("single", [0.5, 0.25, -8])):
            assert numbers_of(read, column).tolist() == values
        assert numbers_of(read, "text").tolist() == [1.5, -2000, 7]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (
            ["1", "x", "3", "y", ""],
            "a in row 2 is 'x', and 2 more in this column; expected a finite number, see the log",
        ),
        (["1", "2", "z"], "a in row 3 is 'z'; expected a finite number, see the log"),
        (["1,5", "2"], "a in row 1 is '1,5'; expected a finite number, with a point, not a comma"),
        ([1.0, float("nan")], "a in row 2 is nan; expected a finite number, see the log"),
        ([float("inf"), 1.0], "a in row 1 is inf; expected a finite number, see the log"),
        ([1, None], "a in row 2 is None; expected a finite number, see the log"),
        ([True, False], "a has values of the type Boolean; expected numbers"),
    ],
)
def test_what_is_no_number_is_named_with_its_row(values: list[object], says: str) -> None:
    """Expected: the whole message; rows count from 1."""
    table = polars.DataFrame({"b": range(len(values)), "a": values}, strict=False)
    with pytest.raises(TableError) as caught:
        numbers_of(table, "a", ", see the log")
    assert str(caught.value) == says
    assert numbers_of(table, "b").tolist() == list(range(len(values)))


def test_a_column_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("b,a,a\n1,2,3\n")
    read = read_table(tmp_path / "t.csv", "log")
    assert numbers_of(read, "b").tolist() == [1]
    with pytest.raises(TableError, match=r"^has the column a twice; expected every column once$"):
        numbers_of(read, "a")


def test_times_since_the_first_keep_their_digits() -> None:
    """Expected: nanoseconds since 1970, subtracted as whole numbers; others as numbers, from 7.3 s."""
    steps = [0, 1, 3, 1_000_000_007]
    for values in ([NS + step for step in steps], [str(NS + step) for step in steps]):
        first, since = times_of(polars.DataFrame({"b": [5] * 4, "t": values}), "t")
        assert since.tolist() == steps
        assert first == pytest.approx(NS, rel=1e-15)
    for kind in ([7.3, 7.8, 9.05], ["7.3", "7.8", "9.05"]):
        first, since = times_of(polars.DataFrame({"t": kind}), "t")
        assert first == 7.3
        assert since.tolist() == pytest.approx([0, 0.5, 1.75])
    # floats that happen to be whole
    first, since = times_of(polars.DataFrame({"t": [7.0, 8.0]}), "t")
    assert (first, since.tolist()) == (7.0, [0, 1])
    first, since = times_of(polars.DataFrame({"t": polars.Series([], dtype=polars.Int64)}), "t")
    assert (first, since.tolist()) == (0.0, [])


def test_files_that_are_no_tables_say_so(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"^cannot read this reference: No such file or directory$"):
        read_table(tmp_path / "none.csv", "reference")
    with pytest.raises(TableError, match=r"^cannot read this log: Is a directory$"):
        read_table(tmp_path, "log")
    (tmp_path / "t.parquet").write_bytes(b"PAR1 and nothing else")
    with pytest.raises(TableError, match=r"^is not Parquet: "):
        read_table(tmp_path / "t.parquet", "log")


def test_records_go_through_folders_whose_names_are_not_utf8(tmp_path: Path) -> None:
    """Expected: the same table; file systems allow any bytes."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/m\xfcll"))
    record = gs.run("heave_step", {"loop.duration": 0.01, "reference.at": 0.005})
    gs.save_record(record, folder)
    assert gs.read_record(folder).table.equals(record.table)
    assert gs.read_record(folder / "record.parquet").table.equals(record.table)
    lines = (folder / "record.csv").read_text().splitlines()
    assert len(lines) == record.table.height + 1

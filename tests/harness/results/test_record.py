"""Records survive their files exactly, and say what is not in them."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.experiment.file import shipped_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.results.record import Record, read_record

# 0.0 and -0.0 are the same time
_NUMBERS = st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: x != 0)


def written(record: Record, folder: Path) -> list[Path]:
    (folder / "record.csv").write_bytes(record.to_csv())
    (folder / "record.parquet").write_bytes(record.to_parquet())
    (folder / "metadata.json").write_bytes(record.to_metadata())
    return [folder / "record.csv", folder / "record.parquet"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(_NUMBERS, min_size=1, max_size=20, unique=True), flag=st.booleans())
def test_files_read_back_every_bit(values: list[float], flag: bool, tmp_path: Path) -> None:
    """Expected: the same floats, also the least and the largest; truth values; metadata in any script."""
    table = polars.DataFrame({"time": sorted(values), "x[1]": values[::-1], "flag.a[1]": [flag] * len(values)})
    record = Record(table, {"title": "Übung – 试验", "rows": len(values), "numbers": [0.1, 1e-300]})
    for path in written(record, tmp_path):
        again = read_record(path)
        assert again.table.columns == table.columns
        assert again["x[1]"].tobytes() == np.array(values[::-1]).tobytes()
        assert again["flag.a[1]"].tolist() == [flag] * len(values)
        assert again.metadata == record.metadata


def test_the_record_of_a_run_reads_back_the_same(tmp_path: Path) -> None:
    record = run(shipped_experiment("impulse", ["loop.duration=0.02", "disturbance=[]"]))
    for path in written(record, tmp_path):
        again = read_record(path)
        assert again.table.equals(record.table)
        assert again.table.schema == record.table.schema
        assert again.metadata == record.metadata


def test_variables_and_columns_go_by_name() -> None:
    """Expected: whole variables as arrays, single columns, the nearest name for what is not there."""
    record = Record(
        polars.DataFrame({"time": [0.0, 1.0], "error.position[1]": [1.0, 2.0], "error.position[2]": [3.0, 4.0]}), {}
    )
    assert record["error.position"].tolist() == [[1, 3], [2, 4]]
    assert record["error.position[2]"].tolist() == [3, 4]
    assert "error.position" in record
    assert "error" not in record
    with pytest.raises(RecordError, match=r"no 'error.positon'; did you mean 'error.position'"):
        record["error.positon"]


def test_files_that_are_no_records_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"nothing.parquet: .*expected record.parquet"):
        read_record(tmp_path / "nothing.parquet")
    (tmp_path / "record.csv").write_text("time\n0\n")
    with pytest.raises(RecordError, match=r"metadata.json: No such file"):
        read_record(tmp_path / "record.csv")
    polars.DataFrame({"a": [1]}).write_parquet(tmp_path / "other.parquet")
    with pytest.raises(RecordError, match="has no metadata of a run"):
        read_record(tmp_path / "other.parquet")
    (tmp_path / "text.parquet").write_text("hello")
    with pytest.raises(RecordError, match=r"text.parquet: cannot be read as a record"):
        read_record(tmp_path / "text.parquet")


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The CSV of a short run with its metadata."""
    folder = tmp_path_factory.mktemp("saved")
    written(run(shipped_experiment("impulse", ["loop.duration=0.02", "disturbance=[]"])), folder)
    (folder / "record.parquet").unlink()
    return folder


def edited(text: str, row: int, column: str, value: str) -> str:
    """A CSV with another cell; row 1 is the first below the header."""
    lines = [line.split(",") for line in text.splitlines()]
    lines[row][lines[0].index(column)] = value
    return "\n".join(",".join(line) for line in lines) + "\n"


DAMAGE: dict[str, tuple[Callable[[str], str], str]] = {
    "half of it": (lambda t: t[: len(t) // 2], "is empty; expected a number|has 1[01] rows, but the run had 21"),
    "rows at its end": (lambda t: "".join(t.splitlines(True)[:-3]), "has 18 rows, but the run had 21"),
    "all but its header": (lambda t: t.splitlines(True)[0], "has no rows"),
    "everything": (lambda _: "", "cannot be read as a record"),
    "a number": (lambda t: edited(t, 3, "position[2]", "abc"), r"position\[2\] in row 3 is 'abc'; expected a number"),
    "a cell": (lambda t: edited(t, 4, "position[3]", ""), r"position\[3\] in row 4 is empty"),
    "a time": (lambda t: edited(t, 2, "time", "NaN"), "time in row 2 is nan"),
    "an order": (lambda t: edited(t, 5, "time", "0.001"), r"time in row 5 is 0.001; expected finite, increasing times"),
    "the times": (lambda t: t.replace("time", "clock", 1), "has no column 'time'"),
    "a column": (lambda t: t.replace("position[2]", "elsewhere", 1), "has 2 columns of position; expected 3"),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_table_that_has_lost_something_is_refused(what: str, saved: Path, tmp_path: Path) -> None:
    """Expected: file, place and expectation, in one line."""
    damage, message = DAMAGE[what]
    (tmp_path / "metadata.json").write_bytes((saved / "metadata.json").read_bytes())
    (tmp_path / "record.csv").write_text(damage((saved / "record.csv").read_text()))
    with pytest.raises(RecordError, match=rf"record.csv: .*({message}).*expected record.parquet") as caught:
        read_record(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("", None, "has no metadata of a run"),
        ("", [1], "has no metadata of a run"),
        ("outcome", "completed", "metadata: outcome is 'completed'; input should be"),
        ("outcome", {"status": 3, "time": 0.0}, "metadata: outcome.status is 3; input should be a valid string"),
        ("platform", [], r"metadata: platform is \[\]; input should be a valid dictionary"),
        ("experiment", {"loop": 3}, "metadata: experiment.loop is 3; input should be a valid dictionary"),
        ("force_limit", "large", "metadata: force_limit is 'large'; input should be a valid number"),
        ("rows", 22, "has 21 rows, but the run had 22"),
    ],
)
def test_metadata_of_another_kind_are_refused(
    key: str, value: object, message: str, saved: Path, tmp_path: Path
) -> None:
    metadata = json.loads((saved / "metadata.json").read_text())
    (tmp_path / "metadata.json").write_text(json.dumps({**metadata, key: value} if key else value))
    (tmp_path / "record.csv").write_bytes((saved / "record.csv").read_bytes())
    with pytest.raises(RecordError, match=rf"record.csv: {message}"):
        read_record(tmp_path)


def test_names_with_brackets_and_stars_are_only_names(saved: Path, tmp_path: Path) -> None:
    """Expected: the record of that name, not those that a pattern matches, and not all of them."""
    for name, title in (("run[12]", "mine"), ("run1", "another"), ("run*", "third"), ("run2", "fourth")):
        (tmp_path / name).mkdir()
        read = read_record(saved)
        written(Record(read.table.head(5), {**read.metadata, "title": title, "rows": 5}), tmp_path / name)
    for file in ("record.csv", "record.parquet", ""):
        assert read_record(tmp_path / "run[12]" / file).metadata["title"] == "mine"
        assert read_record(tmp_path / "run*" / file).table.height == 5

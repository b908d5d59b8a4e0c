"""Records survive their files exactly, and say what is not in them."""

import json
from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np
import polars
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.experiment.file import shipped_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.results.record import Record, machine_of, platform_of, read_record
from gough_stewart.harness.results.record_checks import check_metadata, check_table

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


SIZES = {
    **{"position": 3, "orientation": 3, "velocity": 3, "angular_velocity": 3, "leg_length": 6, "leg_velocity": 6},
    **{"acceleration": 3, "angular_acceleration": 3, "joint_force": 18, "actuator_force": 6},
    **{"external_force": 3, "external_torque": 3},
    **{f"flag.{name}": 6 for name in ("force_limited", "rate_limited", "stroke_exceeded")},
    **{f"error.{name}": size for name, size in (("position", 3), ("orientation", 3), ("leg_length", 6))},
    **{f"reference.{name}": size for name, size in (("position", 3), ("velocity", 3), ("leg_velocity", 6))},
}


@pytest.mark.parametrize("name", SIZES)
def test_each_variable_has_all_of_its_elements_or_none(name: str) -> None:
    """Expected: the sizes of the interface: whole, left out, and without the last element."""
    record = run(shipped_experiment("impulse", ["loop.duration=0.002", "disturbance=[]"]))
    table = record.table
    if not record.columns_of(name):
        table = table.with_columns(*(polars.lit(0.5).alias(f"{name}[{k + 1}]") for k in range(SIZES[name])))
    columns = Record(table, {}).columns_of(name)
    check_table(table, 3)
    check_table(table.drop(columns), 3)
    assert len(columns) == SIZES[name]
    with pytest.raises(RecordError) as caught:
        check_table(table.drop(columns[-1]), 3)
    assert str(caught.value) == f"has {len(columns) - 1} columns of {name}; expected {len(columns)}"


TABLES: dict[str, tuple[dict[str, object], int | None, str]] = {
    "nothing wrong": ({"time": [7.3, 7.4], "x": [True, False]}, 2, ""),
    "rows unknown": ({"time": [7.3, 7.4]}, None, ""),
    "a single row": ({"time": [-7.3]}, 1, ""),
    "no rows": ({"time": []}, None, "has no rows; expected at least one"),
    "no times": ({"x": [1.0]}, None, "has no column 'time'; expected one with the times of the rows"),
    "a text": ({"time": [1.0, 2.0], "x": ["1", "b"]}, None, "x in row 2 is 'b'; expected a number"),
    "a date": ({"time": [1.0], "x": [date(2026, 1, 2)]}, None, "x has type Date; expected numbers"),
    "a gap": ({"time": [1.0, 2.0, 3.0], "x": [1, 2, None]}, None, "x in row 3 is empty; expected a number"),
    "the same time": ({"time": [1.0, 2.0, 2.0]}, None, "time in row 3 is 2.0; expected finite, increasing times"),
    "an infinite time": (
        {"time": [1.0, float("inf")]},
        None,
        "time in row 2 is inf; expected finite, increasing times",
    ),
    "a row too many": (
        {"time": [1.0, 2.0]},
        1,
        "has 2 rows, but the run had 1; the file is incomplete or from another run",
    ),
}


@pytest.mark.parametrize("what", TABLES)
def test_a_table_is_checked_row_by_row(what: str) -> None:
    """Expected: the whole message, or none."""
    columns, rows, says = TABLES[what]
    if not says:
        check_table(polars.DataFrame(columns), rows)
        return
    with pytest.raises(RecordError) as caught:
        check_table(polars.DataFrame(columns), rows)
    assert str(caught.value) == says


# Keys of metadata, and values of other types.
KEYS: dict[str, object] = {
    **{"title": 3, "plant": 3, "rows": 2.5, "outcome": 3, "duration": "x", "sample_time": "x", "plant_step": []},
    **{"force_limit": "x", "platform": 3, "experiment": [], "versions": 3, "files": {"a": 3}, "replaced": "x"},
    **{f"experiment.{name}": 3 for name in ("reference", "controller", "loop", "sensors", "actuators", "limits")},
    **{"experiment.start": 3, "experiment.change": {}, "experiment.disturbance": {}, "experiment.description": 3},
    **{"outcome.time": "x", "outcome.cause": 3, "outcome.status": None},
}


@pytest.mark.parametrize("key", KEYS)
def test_metadata_are_checked_key_by_key(key: str) -> None:
    """Expected: the key and its value; None where a run has none, and other keys, are fine."""
    outer, _, inner = key.partition(".")
    value = (
        {"status": "completed", "time": 1.0, inner: KEYS[key]} if outer == "outcome" and inner else {inner: KEYS[key]}
    )
    with pytest.raises(RecordError, match=f"^metadata: {key}[.a]* is "):
        check_metadata({outer: value if inner else KEYS[key]})
    check_metadata({"more": KEYS[key], "outcome": {"status": "completed", "time": 1.0, "more": 3}})
    empty = (
        "plant",
        "rows",
        "outcome",
        "duration",
        "sample_time",
        "plant_step",
        "force_limit",
        "platform",
        "experiment",
    )
    check_metadata(dict.fromkeys(empty))
    check_metadata({})


def test_a_record_knows_the_nominal_platform_and_the_machine(tmp_path: Path) -> None:
    """Expected: both, if they differ; the nominal one twice, if there is only that; Parquet before CSV."""
    record = run(
        shipped_experiment("impulse", ["loop.duration=0.002", "disturbance=[]", "plant.parameters.platform_mass=77"])
    )
    nominal, machine = platform_of(record), machine_of(record)
    assert (nominal.platform_mass == 77, machine.platform_mass) == (False, 77)
    alone = Record(record.table, {"platform": record.metadata["platform"]})
    assert machine_of(alone) == platform_of(alone) == nominal
    for metadata in ({}, {"platform": {"mass": 3}}):
        with pytest.raises(
            RecordError, match=r"^the metadata have no platform \(.*\); expected what `gough-stewart run`"
        ):
            machine_of(Record(record.table, metadata))
    written(Record(record.table, {**record.metadata, "title": "first"}), tmp_path)
    (tmp_path / "metadata.json").write_bytes(Record(record.table, {**record.metadata, "title": "second"}).to_metadata())
    assert read_record(tmp_path).metadata["title"] == "first"
    assert read_record(tmp_path / "record.csv").metadata["title"] == "second"

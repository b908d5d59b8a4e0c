"""Records survive their files exactly, say what is not in them, and refuse files of something else."""

import json
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import gough_stewart as gs
from tests.support.records import columns

Refusal = gs.GoughStewartError
# 0.0 and -0.0 are the same time
_NUMBERS = st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: x != 0)


def written(record: gs.Record, folder: Path) -> list[Path]:
    (folder / "record.csv").write_bytes(record.to_csv())
    (folder / "record.parquet").write_bytes(record.to_parquet())
    (folder / "metadata.json").write_bytes(record.to_metadata())
    return [folder / "record.csv", folder / "record.parquet"]


def refused(table: dict[str, Any] | polars.DataFrame, metadata: dict[str, Any], folder: Path) -> str:
    """What reading says of a table and metadata, after the file's name; nothing if they are a record."""
    (path := folder / "record.parquet").write_bytes(gs.Record(polars.DataFrame(table), metadata).to_parquet())
    try:
        gs.read_record(path)
    except Refusal as error:
        return str(error).removeprefix(f"{path}: ").partition("; expected record.parquet")[0]
    return ""


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(values=st.lists(_NUMBERS, min_size=1, max_size=20, unique=True), flag=st.booleans())
def test_files_read_back_every_bit(values: list[float], flag: bool, tmp_path: Path) -> None:
    """Expected: the same floats, also the least and the largest; truth values; metadata in any script."""
    table = polars.DataFrame({"time": sorted(values), "x[1]": values[::-1], "flag.a[1]": [flag] * len(values)})
    record = gs.Record(table, {"title": "Übung – 试验", "rows": len(values), "numbers": [0.1, 1e-300]})
    for path in written(record, tmp_path):
        again = gs.read_record(path)
        assert again.table.columns == table.columns
        assert again["x[1]"].tobytes() == np.array(values[::-1]).tobytes()
        assert again["flag.a[1]"].tolist() == [flag] * len(values)
        assert again.metadata == record.metadata


@pytest.fixture(scope="module")
def record() -> gs.Record:
    """A short run of a machine that is not the nominal one."""
    return gs.run("impulse", {"loop.duration": 0.02, "disturbance": [], "plant.parameters.platform_mass": 77})


@pytest.fixture(scope="module")
def saved(record: gs.Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved")
    written(record, folder)
    (folder / "record.parquet").unlink()
    return folder


def test_the_record_of_a_run_reads_back_the_same(record: gs.Record, tmp_path: Path) -> None:
    """Expected: table, types and metadata; of a folder with both, Parquet; the machine and the belief beside it."""
    for path in written(record, tmp_path):
        again = gs.read_record(path)
        assert again.table.equals(record.table)
        assert again.table.schema == record.table.schema
        assert again.metadata == record.metadata
    (tmp_path / "metadata.json").write_bytes(gs.Record(record.table, {**record.metadata, "title": "2nd"}).to_metadata())
    assert gs.read_record(tmp_path).metadata["title"] == record.metadata["title"]
    assert gs.read_record(tmp_path / "record.csv").metadata["title"] == "2nd"
    # of another program, in which only the last number is no integer
    (tmp_path / "record.csv").write_text("time,x\n" + "".join(f"{k},{k}\n" for k in range(20_000)) + "20000,0.5\n")
    (tmp_path / "metadata.json").write_text("{}")
    assert gs.read_record(tmp_path / "record.csv")["x"][-1] == 0.5
    assert record.metadata["machine"]["platform_mass"] == 77 != record.metadata["platform"]["platform_mass"]


def test_variables_and_columns_go_by_name() -> None:
    """Expected: whole variables as arrays, single columns, the nearest name for what is not there."""
    table = {"time": [0.0, 1.0], **columns("error.position", [[1.0, 3.0], [2.0, 4.0]])}
    record = gs.Record(polars.DataFrame(table), {})
    assert record["error.position"].tolist() == [[1, 3], [2, 4]]
    assert record["error.position[2]"].tolist() == [3, 4]
    assert record.columns_of("error.position") == ["error.position[1]", "error.position[2]"]
    assert "error.position" in record
    assert "error" not in record
    with pytest.raises(Refusal, match=r"no 'error.positon'; did you mean 'error.position'"):
        record["error.positon"]
    for metadata in ({}, {"platform": {"mass": 3}}):
        with pytest.raises(Refusal, match=r"^the metadata have no platform \(.*\); expected what `gough-stewart run`"):
            gs.Record(record.table, metadata).report()


@pytest.mark.parametrize(
    ("damaged", "message"),
    [
        (lambda text: text[: text.rindex(",", 0, len(text) // 2)], "is empty; expected a number"),
        (lambda text: "".join(text.splitlines(True)[:-3]), "has 18 rows, but the run had 21"),
        (lambda _: "", "cannot be read as a record"),
    ],
    ids=["half of it", "rows at its end", "everything"],
)
def test_a_table_that_has_lost_something_is_refused_in_one_line(
    damaged: Callable[[str], str], message: str, saved: Path, tmp_path: Path
) -> None:
    (tmp_path / "metadata.json").write_bytes((saved / "metadata.json").read_bytes())
    (tmp_path / "record.csv").write_text(damaged((saved / "record.csv").read_text()))
    with pytest.raises(Refusal, match=rf"^[^\n]*record.csv: .*({message}).*expected record.parquet[^\n]*$"):
        gs.read_record(tmp_path)


TIMES = "expected finite, increasing times"
TABLES: dict[str, tuple[dict[str, Any], int | None, str]] = {
    "nothing wrong": ({"time": [7.3, 7.4], "x": [True, False]}, 2, ""),
    "rows unknown": ({"time": [7.3, 7.4]}, None, ""),
    "a single row": ({"time": [-7.3]}, 1, ""),
    "no times": ({"x": [1.0]}, None, "has no column 'time'; expected one with the times of the rows"),
    "no rows": ({"time": []}, None, "has no rows; expected at least one"),
    "a text": ({"time": [1.0, 2.0], "x": ["1", "b"]}, None, "x in row 2 is 'b'; expected a number"),
    "a date": ({"time": [1.0], "x": [date(2026, 1, 2)]}, None, "x has type Date; expected numbers"),
    "a gap": ({"time": [1.0, 2.0, 3.0], "x": [1, 2, None]}, None, "x in row 3 is empty; expected a number"),
    "the same time": ({"time": [1.0, 2.0, 2.0]}, None, f"time in row 3 is 2.0; {TIMES}"),
    "an infinite time": ({"time": [1.0, float("inf")]}, None, f"time in row 2 is inf; {TIMES}"),
    "no time": ({"time": [float("nan"), 1.0]}, None, f"time in row 1 is nan; {TIMES}"),
    "a row too many": ({"time": [1.0, 2.0]}, 1, "has 2 rows, but the run had 1; the file is incomplete or from another "
                       "run"),
}  # fmt: skip


@pytest.mark.parametrize("what", TABLES)
def test_a_table_is_checked_row_by_row(what: str, tmp_path: Path) -> None:
    """Expected: the whole message, or none."""
    table, rows, says = TABLES[what]
    assert refused(table, {"rows": rows}, tmp_path) == says


SIZES = {
    **dict.fromkeys(("position", "velocity", "external_force", "error.position", "reference.velocity"), 3),
    **dict.fromkeys(("leg_length", "actuator_force", "flag.rate_limited", "error.leg_length"), 6),
    "joint_force": 18,
}


def test_each_variable_has_all_of_its_elements_or_none(tmp_path: Path) -> None:
    """Expected: the sizes of the interface: whole, and without the last element."""
    for name, size in SIZES.items():
        table = {"time": [0.0, 1.0], **columns(name, np.zeros((2, size)))}
        assert refused(table, {}, tmp_path) == ""
        del table[f"{name}[{size}]"]
        assert refused(table, {}, tmp_path) == f"has {size - 1} columns of {name}; expected {size}"


# Keys of metadata, and values of other types.
KEYS: dict[str, Any] = {
    **{"title": 3, "plant": 3, "rows": 2.5, "outcome": 3, "duration": "x", "sample_time": "x", "plant_step": []},
    **{"force_limit": "x", "platform": 3, "experiment": [], "versions": 3, "files": {"a": 3}, "replaced": "x"},
    **{f"experiment.{name}": 3 for name in ("reference", "controller", "loop", "sensors", "actuators", "limits")},
    **{"experiment.start": 3, "experiment.change": {}, "experiment.disturbance": {}, "experiment.description": 3},
    **{"outcome.time": "x", "outcome.cause": 3, "outcome.status": None, "settings": {"a": 3}},
}


def test_metadata_are_checked_key_by_key(saved: Path, tmp_path: Path) -> None:
    """Expected: the key and its value; None where a run has none, and other keys, are fine."""
    table, outcome = {"time": [0.0]}, {"status": "completed", "time": 1.0}
    for key, wrong in KEYS.items():
        outer, _, inner = key.partition(".")
        value = {**(outcome if outer == "outcome" else {}), inner: wrong} if inner else wrong
        shown = wrong["a"] if key in ("files", "settings") else wrong
        says = refused(table, {outer: value}, tmp_path)
        place = f"{key}.a" if key in ("files", "settings") else key
        assert says.startswith(f"metadata: {place} is {shown!r}; input "), says
        assert refused(table, {"more": wrong, "outcome": {**outcome, "more": 3}}, tmp_path) == ""
    empty = ("plant", "rows", "outcome", "duration", "sample_time", "plant_step", "force_limit", "platform")
    assert refused(table, dict.fromkeys((*empty, "experiment")), tmp_path) == ""
    (tmp_path / "record.csv").write_bytes((saved / "record.csv").read_bytes())
    for text in ("null", "[1]"):
        (tmp_path / "metadata.json").write_text(json.dumps(json.loads(text)))
        with pytest.raises(Refusal, match=r"record.csv: has no metadata of a run"):
            gs.read_record(tmp_path / "record.csv")


def test_names_with_brackets_and_stars_are_only_names(record: gs.Record, tmp_path: Path) -> None:
    """Expected: the record of that name, not those that a pattern matches, and not all of them."""
    for name in ("run[12]", "run1", "run*", "run2"):
        (tmp_path / name).mkdir()
        written(gs.Record(record.table.head(5), {**record.metadata, "title": name, "rows": 5}), tmp_path / name)
    for file in ("record.csv", "record.parquet", ""):
        for name in ("run[12]", "run*"):
            assert gs.read_record(tmp_path / name / file).metadata["title"] == name


FOLDERS = {
    "differences.parquet": "it has two ensembles compared by `ensemble --compare`; `gough-stewart view` it",
    "plan.json": "it has an unfinished ensemble; continue it with `gough-stewart ensemble … --resume`",
    "ensemble.json": "it has an ensemble; `gough-stewart view` it, or worst/member-…",
    "frf.csv": "it has a frequency response; `gough-stewart view` it, or its record",
    "two.fmu law.fmu one.c": "it has FMUs: law.fmu, two.fmu",
    "report.html margins.json": "it has margins; `gough-stewart view` it",
    "run_1/record.parquet": "it has folders of records: run_1; view one of them",
    "notes.txt": "it has notes.txt",
    "f b e a g c d .hidden": "it has a, b, c, d, e and 2 more",
    "": "it is empty",
}


@pytest.mark.parametrize("names", FOLDERS)
def test_a_folder_without_a_record_is_told_by_what_it_has(names: str, tmp_path: Path) -> None:
    """Expected: the file that the command of the same name writes, and what to do with it; five names at most."""
    for name in names.split():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    with pytest.raises(Refusal) as caught:
        gs.read_record(tmp_path)
    expected = "expected record.parquet, or record.csv with metadata.json beside it"
    assert str(caught.value).startswith(f"{tmp_path}: the folder has no record; {FOLDERS[names]}; {expected}")

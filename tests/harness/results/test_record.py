"""Records survive their files exactly, and say what is not in them."""

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


def written(record: Record, folder: Path) -> list[Path]:
    (folder / "record.csv").write_bytes(record.to_csv())
    (folder / "record.parquet").write_bytes(record.to_parquet())
    (folder / "metadata.json").write_bytes(record.to_metadata())
    return [folder / "record.csv", folder / "record.parquet"]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20), flag=st.booleans())
def test_files_read_back_every_bit(values: list[float], flag: bool, tmp_path: Path) -> None:
    """Expected: the same floats, also the least and the largest; truth values; metadata in any script."""
    table = polars.DataFrame({"time": values, "x[1]": values[::-1], "flag.a[1]": [flag] * len(values)})
    record = Record(table, {"title": "Übung – 试验", "outcome": {"cause": None}, "numbers": [0.1, 1e-300]})
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
    with pytest.raises(RecordError, match="holds no metadata of a run"):
        read_record(tmp_path / "other.parquet")
    (tmp_path / "text.parquet").write_text("hello")
    with pytest.raises(RecordError, match=r"text.parquet: cannot be read as a record"):
        read_record(tmp_path / "text.parquet")

"""Logs from files: what columns may be called, what units they may have, and what is refused."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

from gough_stewart import GoughStewartError, Log, read_log, run, save_record

LENGTHS = 0.31 + 0.017 * np.sin(np.outer(np.arange(8), [1.0, 1.3, 1.7, 2.1, 2.3, 2.9]))
FORCES = 40.0 + 13.0 * np.cos(np.outer(np.arange(8), [0.7, 1.1, 1.9, 2.2, 2.6, 3.1]))
SIZES: dict[str, tuple[int, ...]] = {"time": (), "position": (3,), "orientation": (3,)}


def written(path: Path, columns: dict[str, object]) -> Path:
    polars.DataFrame(columns).write_csv(path)
    return path


def six(name: str, values: np.ndarray, unit: str = "") -> dict[str, object]:
    return {f"{name}[{k + 1}]{unit}": values[:, k] for k in range(values.shape[1])}


def table(**changes: object) -> dict[str, object]:
    return {"time": 0.002 * np.arange(8)} | six("leg_length", LENGTHS) | six("actuator_force", FORCES) | changes


def test_some_rows_of_a_log_are_those_of_all_its_readings() -> None:
    """Expected: the rows of every array; what is not an array stays."""
    arrays: dict[str, Any] = {
        row.name: np.random.default_rng(k).normal(size=(9, *SIZES.get(row.name, (6,))))
        for k, row in enumerate(fields(Log))
        if "float64" in str(row.type)
    }
    assert len(arrays) == 6
    some = Log(**arrays, holds_force=True, where="here", side="motor").rows(slice(2, 8, 3))
    for name, values in arrays.items():
        np.testing.assert_array_equal(getattr(some, name), values[[2, 5]])
    assert (some.holds_force, some.where, some.side) == (True, "here", "motor")
    plain = Log(**{name: values.tolist() for name, values in arrays.items()})
    np.testing.assert_array_equal(plain.position, arrays["position"])
    for name, values in arrays.items():
        for wrong in (values[:-1], values[..., None], [*values[:-1].tolist(), "x"]):
            with pytest.raises(GoughStewartError, match=r"expected (an array of numbers|.[0-9n]+,)"):
                Log(**arrays | {name: wrong})


def test_a_record_gives_what_encoders_measured_and_forces_held_from_sample_to_sample(tmp_path: Path) -> None:
    """Expected: measured lengths at the samples, multiples of the encoder's step; the mean force of their rows."""
    settings = {"loop.duration": 0.05, "loop.plant_step": 1e-3 / 4, "loop.sample_time": 1e-3, "actuators.lag": 2e-3}
    # forces change within a sample once the platform is to move
    settings["reference.at"] = 0.01
    record = run("heave_step", settings | {"sensors.quantisation": {"leg_length": 1e-5}})
    save_record(record, tmp_path)
    log = read_log(tmp_path)
    (tmp_path / "record.parquet").unlink()
    assert np.asarray(read_log(tmp_path).actuator_force) == pytest.approx(log.actuator_force, rel=1e-12)
    assert log.holds_force
    assert log.time is not None
    assert log.actuator_force is not None
    np.testing.assert_allclose(np.diff(log.time), 1e-3, rtol=1e-9)
    steps = log.leg_length / 1e-5
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    of_sample = record["actuator_force"][120:124]
    assert (np.ptp(of_sample, axis=0) > 1e-6).all()
    np.testing.assert_allclose(log.actuator_force[30], of_sample.mean(axis=0), rtol=1e-14)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": [0.0, 1.0], "force": [1.0, 2.0]}, "no leg lengths; expected columns time"),
        (table(time=[0, 1, 2, 3, None, 5, 6, 7]), "time in row 5 is None; expected a finite number: cut the log"),
        (
            table(**{"leg_length[3]": [0.3, 0.3, "x", "nan", 0.3, 0.3, 0.3, 0.3]}),
            r"leg_length\[3\] in row 3 is 'x', and 1 more in this column",
        ),
        (table(leg_length_2=LENGTHS[:, 0]), r"has leg_length\[2\] and leg_length_2, which mean the same; remove one"),
        ({k: v for k, v in table().items() if k != "actuator_force[4]"}, r"no column actuator_force\[4\]"),
        (
            {"time [h]": np.arange(8.0)} | six("leg_length", LENGTHS),
            r"time \[h\] has the unit 'h'; expected one of s, ms",
        ),
        ({k: v[:1] for k, v in table().items()}, "1 rows; expected a log of some seconds"),  # type: ignore[index]
        ({k: v[:0] for k, v in table().items()}, "has a header, and no rows below it"),  # type: ignore[index]
    ],
)
def test_what_is_no_log_is_refused_with_its_place(columns: dict[str, object], message: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    polars.DataFrame(columns, strict=False).write_csv(path)
    with pytest.raises(GoughStewartError, match=message):
        read_log(path)
    with pytest.raises(GoughStewartError, match="no such file; expected a log as CSV or Parquet"):
        read_log(tmp_path / "none.csv")


def test_units_in_the_header_become_si(tmp_path: Path) -> None:
    """Expected: the numbers that were written with other units, to rounding."""
    columns = {"time [ms]": 2.0 * np.arange(8)} | six("leg_length", 1e3 * LENGTHS, " [mm]")
    log = read_log(written(tmp_path / "log.csv", columns | six("actuator_force", FORCES / 1e3, " (kN)")))
    assert log.time is not None
    assert log.actuator_force is not None
    np.testing.assert_allclose(log.time, 0.002 * np.arange(8), rtol=1e-14)
    np.testing.assert_allclose(log.leg_length, LENGTHS, rtol=1e-14)
    np.testing.assert_allclose(log.actuator_force, FORCES, rtol=1e-14)


def test_columns_with_underscores_in_any_order_are_the_same(tmp_path: Path) -> None:
    columns = {f"leg_length_{k}": LENGTHS[:, k - 1] for k in (4, 2, 6, 1, 3, 5)} | {"time": np.arange(8.0)}
    read = read_log(written(tmp_path / "log.csv", columns))
    polars.DataFrame(columns).write_parquet(tmp_path / "log.parquet")
    for log in (read, read_log(tmp_path / "log.parquet")):
        np.testing.assert_array_equal(log.leg_length, LENGTHS)
        assert log.actuator_force is None


def test_currents_become_forces_by_their_factor(tmp_path: Path) -> None:
    columns = {"time": np.arange(8.0)} | six("leg_length", LENGTHS) | six("motor_current", FORCES, " [mA]")
    path = written(tmp_path / "log.csv", columns)
    force = read_log(path, force_per_current=250.0).actuator_force
    assert force is not None
    np.testing.assert_allclose(force, 0.25 * FORCES, rtol=1e-14)
    for factor in (None, 0.0, np.inf):
        with pytest.raises(GoughStewartError, match=rf"currents, but force_per_current is {factor}; .* factor \[N/A\]"):
            read_log(path, factor)

"""Experiments run whole: plants agree, feedforward pays, records say what happened."""

import json
from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.plain_motion import trajectory

pytestmark = pytest.mark.usefixtures("units_in_process")


def test_the_papers_open_loop_is_that_of_a_lagrangian() -> None:
    """Expected: the tests' Lagrangian under DOP853 at 1e-11; and no error without a reference."""
    record = gs.run("paper_open_loop")
    start = np.concatenate([record[name][0] for name in ("position", "orientation", "velocity", "angular_velocity")])
    inputs = np.concatenate([record["actuator_force"][0], np.zeros(6)])
    expected = trajectory(gs.load_preset("liu2000"), start, lambda _time: inputs, record["time"][::100])
    assert start == pytest.approx([0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0])
    assert inputs[:6] == pytest.approx([55, 49.5] * 3)
    pose = np.hstack([record["position"], record["orientation"]])
    assert np.abs(pose[::100] - expected[:, :6]).max() < 1e-8
    assert "error.position" not in record


def test_the_same_run_gives_the_same_bytes() -> None:
    """Expected: no clock, no random number without a seed, no path in any file."""
    settings = ["loop.duration=0.3", "sensors.noise.leg_length='5 um'", "sensors.seed=3"]
    experiment = gs.load_experiment("heave_step", settings)
    one, two = (gs.run(experiment, plant="fmu3") for _ in range(2))
    assert one.to_csv() == two.to_csv()
    assert one.to_parquet() == two.to_parquet()
    assert one.to_metadata() == two.to_metadata()
    other = gs.run(gs.load_experiment("heave_step", [*settings, "sensors.seed=4"]), plant="fmu3")
    assert other.to_csv() != one.to_csv()


def test_metrics_are_written_although_a_requirement_cannot_be_judged(tmp_path: Path) -> None:
    """Expected: the metrics of the record; a settling time that a run without a step along x does not have."""
    options = ("--set", "loop.duration=0.05", "--require", "step_response.x.settling_time <= 1 s")
    done = invoke("run", "heave_step", *options, "--out", str(tmp_path), catch_exceptions=True)
    assert done.exit_code == 4
    record = gs.read_record(tmp_path)
    assert json.loads((tmp_path / "metrics.json").read_text()) == gs.metrics(record)
    assert record["time"][-1] == pytest.approx(0.05)

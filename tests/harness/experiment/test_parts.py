"""Single tables of an experiment at work, and whole runs: start, limits, changes, disturbances, in their records."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.plain_motion import trajectory
from tests.support.uneven import PARAMETERS, UNEVEN

HOLD: dict[str, Any] = {
    "platform": {"preset": "liu2000", "parameters": PARAMETERS},
    "reference": {"type": "hold"},
    "controller": {"type": "pd", "bandwidth": 2, "feedforward": "gravity"},
    "loop": {"duration": 0.02, "sample_time": 2e-3, "plant_step": 1e-3, "delay": 1},
    "sensors": {},
}


def run(**tables: Any) -> gs.Record:
    return gs.run("heave_step", {**HOLD, **tables})


def static(machine: gs.Platform, pose: np.ndarray[Any, Any]) -> Any:
    return gs.static_leg_forces(machine, pose[:3], pose[3:])


STARTS: dict[str, tuple[list[Any], list[float]]] = {
    "position": (["90 mm", -0.06, "2.91 m"], [0.09, -0.06, 2.91]),
    "orientation": (["2 deg", 0.03, -0.02], [np.pi / 90, 0.03, -0.02]),
    "velocity": (["0.1 m/s", "-20 mm/s", 0.03], [0.1, -0.02, 0.03]),
    "angular_velocity": (["1 deg/s", 0.2, -0.3], [np.pi / 180, 0.2, -0.3]),
}


def test_every_key_of_the_start_is_in_the_first_row() -> None:
    """Expected: what is written, with units; what is not, from the reference, which moves at its beginning."""
    sine = {"type": "sine", "position_amplitude": [0.01, 0.02, 0.03], "orientation_amplitude": [0.04, 0.05, 0.06]}
    reference = {**sine, "frequency": 1.5, "phase": 0.4}
    free = run(reference=reference)
    turned = run(reference=reference, start={"orientation": [2 * np.pi + 0.02, 0.03, -0.02]})
    assert turned["orientation"][0] == pytest.approx([0.02, 0.03, -0.02])
    for name, (written, _) in STARTS.items():
        assert free[name][0] == pytest.approx(free[f"reference.{name}"][0])
        one = run(reference=reference, start={name: written})
        for other, (_, meant) in STARTS.items():
            assert one[other][0] == pytest.approx(meant if other == name else free[other][0]), (name, other)


def test_a_closed_loop_starts_at_rest_and_an_open_one_with_its_own_forces() -> None:
    """Expected: until the first command acts, the static forces of the start's pose and the machine; clipped."""
    pose = np.array([0.12, -0.06, 2.93, 0.02, 0.05, -0.04])
    start = {"position": pose[:3].tolist(), "orientation": pose[3:].tolist()}
    machine = gs.load_experiment("heave_step", {**HOLD, "plant": {"parameters": {"platform_mass": 14.0}}})
    record = gs.run(machine, {"start": start})
    heavier = type(UNEVEN)(**{**UNEVEN.as_dict(), "platform_mass": 14.0})
    assert record["actuator_force"][0] == pytest.approx(static(heavier, pose), rel=1e-9)
    limited = gs.run(machine, {"start": start, "actuators.force_limit": 50.0, "limits.reference": "warn"})
    assert limited["actuator_force"][0] == pytest.approx(np.clip(static(heavier, pose), -50, 50), rel=1e-9)
    force = [55.0, 45.0, 50.0, 40.0, 60.0, 35.0]
    own = run(controller={"type": "open_loop", "force": force}, start=start)
    assert own["actuator_force"][0].tolist() == pytest.approx(force)
    assert own["controller.feedforward"][3].tolist() == pytest.approx(force)


def test_force_limits_come_from_the_platform_the_file_or_nowhere() -> None:
    """Expected: of the nominal platform, not the machine's."""
    plant = {"parameters": {"actuator_force_max": 900.0}}
    for value, meant in (("platform", 640.0), ("none", None), ("0.3 kN", 300.0)):
        assert run(actuators={"force_limit": value}, plant=plant).metadata["force_limit"] == meant
    assert run(plant=plant).metadata["force_limit"] == 640


def test_disturbances_add_up_where_they_overlap() -> None:
    """Expected: 2 kN from 5 ms, 2 + 1 from 7 ms, 1 from 10 ms, none from 17 ms."""
    both = [{"at": 0.005, "duration": 0.005, "force": [20, 0, 0]}, {"at": 0.007, "duration": 0.01, "force": [10, 0, 5]}]
    record = run(disturbance=both)
    time = record["time"] + 1e-9
    active = np.array([(time > at) & (time < end) for at, end in ((0.005, 0.01), (0.007, 0.017))])
    # a fault without an end may begin at the end, where it changes nothing
    assert np.array_equal(run(fault=[{"at": 0.02, "cut": [2]}])["position"], run()["position"])
    assert record["external_force"] == pytest.approx(active.T.astype(float) @ np.array([[20.0, 0, 0], [10, 0, 5]]))


def test_changes_are_of_the_machine_as_it_is_just_before() -> None:
    """Expected: 10 kg · 1.5 · 2 = 30 kg in order of time; of six values of friction the mean, and each over it."""
    factors = [{"at": 0.01, "factors": {"platform_mass": 2}}, {"at": 0.005, "factors": {"platform_mass": 1.5}}]
    record = run(plant={"parameters": {"platform_mass": 10.0}}, change=factors)
    assert record["platform_mass"][[0, 5, 10, 20]].tolist() == [10, 15, 30, 30]
    assert record.metadata["machine"]["platform_mass"] == 10
    friction = [{"at": 0.01, "parameters": {"leg_viscous_friction": [1, 2, 3, 4, 5, 6]}}]
    six = run(change=friction, plant={"parameters": {"leg_coulomb_friction": [6, 5, 4, 3, 2, 1]}})
    assert six["leg_viscous_friction"][[0, -1]].tolist() == [UNEVEN.leg_viscous_friction, 3.5]
    assert six["leg_viscous_friction_factor"][-1] == pytest.approx(np.arange(1, 7) / 3.5, rel=1e-15)
    assert np.ravel(six.metadata["machine"]["leg_coulomb_friction_factor"]) == pytest.approx(np.arange(6, 0, -1) / 3.5)


def test_a_controller_in_the_place_of_an_open_loop_takes_its_forces_away() -> None:
    """Expected: of the plan only the feedforward stays; here the open loop's 1 N … 6 N beside none."""
    tables: dict[str, Any] = {**HOLD, "controller": {"type": "open_loop", "force": [1, 2, 3, 4, 5, 6]}}
    assert gs.run("heave_step", tables)["controller.feedforward"][7].tolist() == [1, 2, 3, 4, 5, 6]
    replaced = gs.run("heave_step", tables, controller=lambda _sample: np.zeros(6))
    assert not replaced["controller.feedforward"].any()
    assert replaced.metadata["replaced"] == ["controller"]


def test_an_injection_of_another_shape_is_refused() -> None:
    with pytest.raises(gs.GoughStewartError, match=r"the injection at time 0 s has shape \(3,\)"):
        gs.run("heave_step", HOLD, injection=lambda _time: [1.0, 2.0, 3.0])


def test_the_machine_may_come_from_a_file(tmp_path: Path) -> None:
    """Expected: the file's platform, with single parameters changed on it; the belief stays."""
    desktop = gs.load_preset("desktop_hexapod")
    gs.save_platform(desktop, tmp_path / "machine.toml")
    plant: dict[str, Any] = {"file": str(tmp_path / "machine.toml"), "parameters": {"leg_viscous_friction": 3.0}}
    tables = {"platform.preset": "motion_base", "plant": plant, "controller": {"type": "open_loop"}}
    metadata = gs.run("paper_open_loop", {**tables, "start": {}, "loop.duration": 0.01}).metadata
    machine = metadata["machine"]
    assert (machine["name"], machine["leg_viscous_friction"]) == (desktop.name, 3)
    assert gs.Platform(**metadata["platform"]) == gs.load_preset("motion_base")
    with pytest.raises(gs.GoughStewartError, match="plant: platform_mas: no such parameter"):
        gs.ensemble("heave_tolerances", {"plant.parameters.platform_mas": 3.0})


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


@pytest.mark.usefixtures("units_in_process")
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

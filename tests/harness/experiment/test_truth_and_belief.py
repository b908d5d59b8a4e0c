"""The machine differs from what the designer believes: what comes from which, and what it costs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gough_stewart.harness.control.python.sample import Sample
from gough_stewart.harness.errors import ControllerError, ExperimentError, PlantError
from gough_stewart.harness.experiment.analysis import margins
from gough_stewart.harness.experiment.file import experiment_from, shipped_experiment
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.plants.model import ModelPlant
from gough_stewart.harness.results.record import machine_of, platform_of
from gough_stewart.harness.results.run_report import parameters_table
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

RNG = np.random.default_rng(12)
# 1 mm at every joint, in directions of its own
BASE_ERRORS, PLATFORM_ERRORS = (
    each / np.linalg.norm(each, axis=1, keepdims=True) * 1e-3 for each in RNG.normal(size=(2, 6, 3))
)
POSE = {"position": [0.05, -0.1, 2.1], "orientation": [0.05, -0.03, 0.1]}


def experiment_with(machine: dict[str, Any], **more: Any) -> Experiment:
    """The motion base at an uneven pose under PID, on a machine that differs."""
    return experiment_from(
        {
            "title": "truth and belief",
            "platform": {"preset": "motion_base"},
            "plant": {"parameters": machine},
            "reference": {"type": "hold", **POSE},
            "controller": {
                "type": "pid",
                "bandwidth": "4 Hz",
                "damping_ratio": 0.8,
                "integral_time": "0.2 s",
                "feedforward": "gravity",
            },
            "loop": {"duration": "2 s", "sample_time": "2 ms"},
            **more,
        }
    )


def moved_joints() -> dict[str, Any]:
    believed = load_preset("motion_base")
    return {
        "base_points": (believed.base_points + BASE_ERRORS).tolist(),
        "platform_points": (believed.platform_points + PLATFORM_ERRORS).tolist(),
        "leg_coulomb_friction": 0.0,
    }


def test_joint_errors_of_a_millimetre_are_seen_at_the_platform_as_geometry_predicts() -> None:
    """Expected: integral action makes the legs as long as believed, so that L_true(x + δx) = L_believed(x).

    To first order J δx = −u·(R δp − δb); the record's error is −δx. Second order: (1 mm)²/2 m, below 1e-6.
    """
    believed = load_preset("motion_base")
    record = run(experiment_with(moved_joints()))
    position, orientation = (np.array(POSE[name]) for name in ("position", "orientation"))
    u = leg_geometry(believed, position, orientation).direction
    off = (u * (PLATFORM_ERRORS @ matrix_from_orientation(orientation).T - BASE_ERRORS)).sum(axis=1)
    expected = np.linalg.solve(leg_jacobian(believed, position, orientation), off)
    assert np.abs(record["error.leg_length"][-1]).max() < 2e-6
    assert np.linalg.norm(expected[:3]) > 0.5e-3
    assert record["error.position"][-1] == pytest.approx(expected[:3], abs=5e-6)
    # small angles, about the world's axes; roll, pitch, yaw differ from them in second order of the pose's own angles
    assert np.abs(record["error.orientation"][-1] - expected[3:]).max() < 0.2 * np.abs(expected[3:]).max()


def test_references_of_the_legs_and_gravity_are_those_believed() -> None:
    """Expected: inverse kinematics and statics of the believed platform, on a machine with other joints and payload."""
    believed, seen = load_preset("motion_base"), list[FloatArray]()

    def law(sample: Sample) -> FloatArray:
        seen.append(sample.reference["leg_length"])
        return np.zeros(6)

    experiment = experiment_with(moved_joints() | {"platform_mass": 700.0}, loop={"duration": 0.01})
    record = run(experiment, controller=law)
    pose = (np.array(POSE["position"]), np.array(POSE["orientation"]))
    assert seen[0] == pytest.approx(leg_geometry(believed, *pose).length, abs=1e-12)
    assert record["controller.feedforward"][0] == pytest.approx(static_leg_forces(believed, *pose), rel=1e-9)
    # the machine is held still until the first command
    machine = prepare(experiment).machine
    assert prepare(experiment).loop.start_force == pytest.approx(static_leg_forces(machine, *pose), rel=1e-9)
    assert machine.platform_mass == 700
    assert machine_of(record) == machine
    assert platform_of(record) == believed


def test_gains_come_from_the_belief_and_margins_from_the_machine() -> None:
    """Expected: the same gains, whatever the machine is; a heavier machine has modes that are slower by its inertia."""
    one, other = (margins(experiment_with(machine)) for machine in ({}, {"platform_mass": 900.0}))
    (gains, heavier), (believed, own) = ([found.as_dict()[k] for found in (one, other)] for k in ("gains", "margins"))
    assert gains == heavier
    assert other.as_dict()["believed"] == believed != own
    designed = {"preset": "motion_base", "parameters": {"platform_mass": 900.0}}
    assert margins(experiment_with({}, platform=designed)).as_dict()["gains"] != gains


def test_changes_during_a_run_are_changes_of_the_machine() -> None:
    """Expected: factors of the machine's own mass, 600 kg, not of the believed one."""
    change = [{"at": 0.01, "factors": {"platform_mass": 1.5}}]
    record = run(experiment_with({"platform_mass": 600.0}, change=change, loop={"duration": 0.02}))
    assert record["platform_mass"][[0, -1]].tolist() == [600.0, 900.0]


def test_the_machine_may_come_from_a_file(tmp_path: Path) -> None:
    """Expected: the file's platform, with single parameters changed on it."""
    from gough_stewart.model.platform_toml import preset_text

    (tmp_path / "machine.toml").write_text(preset_text("desktop_hexapod"))
    plant = {"file": "machine.toml", "parameters": {"leg_viscous_friction": 3.0}}
    experiment = experiment_with({}, plant=plant).from_file("here", tmp_path)
    machine = prepare(experiment).machine
    assert machine.name == load_preset("desktop_hexapod").name
    assert machine.leg_viscous_friction == 3
    assert prepare(experiment).platform == load_preset("motion_base")


def test_a_machine_that_cannot_be_is_refused_with_its_place() -> None:
    with pytest.raises(ExperimentError, match="plant: platform_mas: no such parameter; did you mean 'platform_mass'"):
        prepare(experiment_with({"platform_mas": 3.0}))


def test_the_key_model_says_where_to_go() -> None:
    with pytest.raises(ExperimentError, match=r"controllers use the nominal model \[platform\].*\[plant.parameters\]"):
        shipped_experiment("circle_computed_torque", ["controller.model.platform_mass=12"])


class Foreign:
    """A plant that keeps the rules and inherits nothing; the model inside."""

    def __init__(self, inside: ModelPlant) -> None:
        self.inside, self.steps = inside, 0

    def set_inputs(self, inputs: FloatArray) -> None:
        self.inside.set_inputs(inputs)

    def set_parameters(self, values: Any) -> None:
        self.inside.set_parameters(values)

    def results(self) -> FloatArray:
        return self.inside.results()

    def do_step(self, time: float, step: float) -> None:
        self.steps += 1
        self.inside.do_step(time, step)


def test_any_object_that_keeps_the_rules_is_a_plant() -> None:
    """Expected: the same bits as the model alone, both run by NumPy's loop; it is named by its class."""
    experiment = shipped_experiment("circle", ["loop.duration=0.02", "loop.sample_time=2 ms", "loop.plant_step=1 ms"])
    prepared = prepare(experiment)
    foreign = Foreign(ModelPlant(prepared.machine, State(*prepared.start)))
    record = run(experiment, plant=foreign)  # type: ignore[arg-type]
    alone = ModelPlant(prepared.machine, State(*prepared.start))
    assert record.table.equals(run(experiment, plant=alone).table)
    assert record.metadata["host"] == "Python"
    assert record.metadata["plant"] == "Foreign"
    assert foreign.steps == 20
    with pytest.raises(PlantError, match="without set_inputs, set_parameters, results, do_step; expected 'model'"):
        run(experiment, plant=object())  # type: ignore[arg-type]


def test_an_injection_is_in_the_record_and_in_the_command() -> None:
    """Expected: a function of the nominal time, in six legs apart; without it no such column."""

    def wave(time: float) -> FloatArray:
        return np.asarray(10 * np.sin(30 * time + np.arange(6)))

    experiment = experiment_with({}, loop={"duration": 0.02, "sample_time": 0.002, "plant_step": 0.001})
    with_it, without = run(experiment, injection=wave), run(experiment)
    expected = np.array([wave(0.002 * (min(k, 19) // 2)) for k in range(21)])
    assert with_it["controller.injection"] == pytest.approx(expected)
    assert "controller.injection" not in without
    assert with_it["controller.force"][0] - without["controller.force"][0] == pytest.approx(expected[0])
    with pytest.raises(ControllerError, match=r"the injection at time 0 s has shape \(3,\)"):
        run(experiment, injection=lambda _time: [1.0, 2.0, 3.0])


def test_jitter_and_the_encoders_clock_come_from_the_file() -> None:
    """Expected: late samples by the seed of [sensors]; readings every 6 ms in a loop of 4 ms."""
    loop = {"duration": 0.2, "sample_time": "4 ms", "plant_step": "1 ms", "jitter": "3 ms"}
    sensors = {"sample_time": "6 ms", "seed": 5, "quantisation": {"leg_length": "1 um"}}
    prepared = prepare(experiment_with({}, loop=loop, sensors=sensors))
    assert prepared.loop.timing.jitter == 0.003
    assert prepared.loop.timing.seed == 5
    assert prepared.loop.sensors.sample_time == 0.006


def test_the_page_shows_the_machine_and_what_was_believed_of_it_otherwise() -> None:
    """Expected: both masses in one row; nothing beside what agrees."""
    record = run(experiment_with({"platform_mass": 777.0}, loop={"duration": 0.01}))
    sheet = parameters_table(machine_of(record), platform_of(record))
    rows = {str(row[0]): [str(cell) for cell in row[1:]] for row in sheet.rows}
    mass = next(row for name, row in rows.items() if "platform_mass" in name)
    assert mass == ["777", f"{load_preset('motion_base').platform_mass:g}"]
    assert next(row for name, row in rows.items() if "base_points" in name)[1] == ""
    same = run(experiment_with({}, loop={"duration": 0.01}))
    assert all(len(row) == 2 for row in parameters_table(machine_of(same), platform_of(same)).rows)

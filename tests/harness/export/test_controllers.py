"""Exported controllers in C against the controllers of the harness, at every sample of a run.

Expected: what the Python loop commanded (`simulate`: laws in NumPy, LAPACK's solves, actuators), from the same
measurements. The platform is uneven, as are gains and motions; runs start off the reference, with noise.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import casadi
import control
import numpy as np
import pytest

from gough_stewart import Gains, LinearController, Sample, experiment_names, leg_geometry, load_experiment, pid, sampled
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.tables import path_of
from tests.support.arrays import FloatArray
from tests.support.experiments import experiment_from
from tests.support.exported import (
    KD,
    KI,
    KP,
    REALS,
    TOLERANCE,
    Exported,
    commanded,
    largest_difference,
    measured_by,
    run_in_python,
    uneven_experiment,
)
from tests.support.uneven import UNEVEN

SINE = {
    "type": "sine",
    "position_amplitude": [0.03, -0.02, 0.04],
    "orientation_amplitude": [0.02, 0.05, -0.03],
    "frequency": 4.0,
    "phase": 0.4,
    "fade_in": 0.05,
}
CHIRP = {**SINE, "type": "chirp", "from_frequency": 2.0, "to_frequency": 7.0, "duration": 0.1}
del CHIRP["frequency"], CHIRP["phase"]
CIRCLE = {"type": "circle", "radius": 0.04, "frequency": 3.0, "plane": "xz", "fade_in": 0.06}
HOLD: dict[str, Any] = {"type": "hold", "position": [0.1, -0.07, 2.93], "orientation": [0.06, -0.09, 0.13]}
PD = {"type": "pd", "proportional_gain": KP, "derivative_gain": KD}
PID = {"type": "pid", "proportional_gain": KP, "derivative_gain": KD, "integral_gain": KI}
CASES: dict[str, dict[str, Any]] = {
    "PD, no feedforward": {"reference": CHIRP, "controller": PD},
    "PD along a scaled motion": {
        "reference": {**CHIRP, "time_scale": 1.3, "amplitude_scale": -0.7},
        "controller": {**PD, "feedforward": "computed_torque"},
    },
    "PD with computed torque, no derivative in two legs": {
        "reference": CIRCLE,
        "controller": {**PD, "derivative_gain": [0, *KD[1:5], 0], "feedforward": "computed_torque"},
    },
    "PID held, with every limit": {
        "reference": SINE,
        "controller": {**PID, "feedforward": "gravity", "discretisation": "zoh", "anti_windup_time": 0.02},
        "actuators": {"force_limit": 47.0, "rate_limit": 900.0, "lag": 0.004},
    },
    "PID in task space at its rate limit": {
        "reference": SINE,
        "controller": {**PID, "space": "task", "feedforward": "computed_torque"},
        "actuators": {"force_limit": 80.0, "rate_limit": 700.0},
    },
    "PD at a place": {"reference": HOLD, "controller": {**PD, "feedforward": "gravity"}},
}


# Motions that tests/harness/export/test_options_together.py has not; the others take their time.
OF_CASES = ("PD along a scaled motion", "PID held, with every limit", "PD at a place", "PD, no feedforward")


def often(names: Iterable[str], chosen: Iterable[str]) -> list[Any]:
    """Names of cases; those that are not chosen run with the evidence."""
    return [pytest.param(each, marks=() if each in chosen else pytest.mark.evidence) for each in names]


@pytest.mark.parametrize("case", often(CASES, OF_CASES))
def test_an_exported_controller_gives_the_forces_of_the_harness(case: str) -> None:
    experiment = uneven_experiment(**CASES[case])
    made, run = designed(experiment), run_in_python(experiment)
    assert run.outcome.status == "completed"
    expected = commanded(run, made)
    if "limit" in case:
        assert run.force_limited.any()
        assert not run.force_limited.all()
    for real in REALS:
        exported = Exported(made, real).start()
        steps = [exported.step(row) for row in measured_by(run, made)]
        assert largest_difference(np.array([force for force, _ in steps]), expected) < TOLERANCE[real], real
        assert np.array_equal([limited for _, limited in steps], run.force_limited)


def systems() -> dict[str, LinearController]:
    """Discrete systems with states, of every form."""
    rng = np.random.default_rng(5)

    def system(n_states: int, n_inputs: int, size: float) -> Any:
        A = rng.normal(size=(n_states, n_states))
        A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
        A[:2] = 0.0
        A[0, :2], A[1, 1] = [1, 0.3], 1.0  # two integrators in a row
        B, C = rng.normal(size=(n_states, n_inputs)) * 0.1, rng.normal(size=(6, n_states)) * size
        return control.ss(A, B, C, rng.normal(size=(6, n_inputs)) * size, 0.0015)

    two, pose = ("leg_velocity", "leg_length"), ("position", "orientation")
    return {
        "errors of two signals, in an order of one's own": LinearController(system(5, 12, 20.0), two),
        "references and measurements of the pose": LinearController(system(4, 12, 5.0), pose),
        "with the excess": LinearController(system(7, 18, 1.5)),
        "errors in task space": LinearController(system(4, 6, 40.0), space="task"),
        "PID of python-control": LinearController(sampled(pid(Gains(KP, KD, KI)), 0.0015)),
        "static gains": LinearController(control.ss([], [], [], np.diag(KP))),
    }


OF_SYSTEMS = ("errors of two signals, in an order of one's own", "references and measurements of the pose")


@pytest.mark.parametrize("name", often(systems(), OF_SYSTEMS))
def test_a_discrete_system_gives_the_forces_of_the_harness(name: str) -> None:
    experiment = uneven_experiment(
        reference=SINE,
        controller={**PD, "feedforward": "gravity"},
        actuators={"force_limit": 90.0},
        limits={"position_error": 1e3},
        loop={"duration": 0.06, "sample_time": 0.0015, "plant_step": 0.0005},
    )
    controller = systems()[name]
    made, run = designed(experiment, controller), run_in_python(experiment, controller)
    expected = commanded(run, made)
    assert len(expected) == 40
    for real in REALS:
        exported = Exported(made, real)
        assert largest_difference(exported.forces(measured_by(run, made)), expected) < TOLERANCE[real], real


DURATIONS = {"impulse": 0.6, "too_slow": 1.6}
# What no case above has: references of a file, of many sines; a slow loop, a late disturbance. Paths: test_paths.py.
SHIPPED = ("excitation", "impulse", "recorded_ride", "too_slow")


@pytest.mark.parametrize("name", often([each for each in experiment_names() if each != "paper_open_loop"], SHIPPED))
def test_controllers_of_shipped_experiments_give_the_forces_of_the_harness(name: str) -> None:
    # the plant's changes come later, and what is injected is not the controller's
    whole = load_experiment(name).model_copy(update={"change": [], "injection": None})
    experiment = experiment_from(
        {**whole.model_dump(), "loop": {**whole.loop.model_dump(), "duration": DURATIONS.get(name, 0.3)}}
    )
    made, run = designed(experiment), run_in_python(experiment)
    # where nothing is to be done forces are zero
    expected = commanded(run, made)
    seen = np.abs(expected).max(axis=1) > 1e-9
    assert seen[1:].all()
    for real in REALS:
        forces = Exported(made, real).forces(measured_by(run, made))
        if path_of(made.reference) is None:
            assert largest_difference(forces[seen], expected[seen]) < TOLERANCE[real], real
        else:  # whose time law is rounded
            assert np.abs(forces - expected).max() < max(1e-6, TOLERANCE[real]) * np.abs(expected).max(), real
        assert not forces[~seen].any()


def _traced() -> casadi.Function:
    """PD with a memory of the last error, tilted by measured yaw and faded in by time."""
    shapes = {"time": 1, "leg_length": 6, "reference_leg_length": 6, "orientation": 3, "reference_acceleration": 3}
    inputs = {name: casadi.MX.sym(name, size) for name, size in {**shapes, "memory": 7}.items()}
    error = inputs["reference_leg_length"] - inputs["leg_length"]
    count = inputs["memory"][6]
    change = casadi.if_else(count > 0, error - inputs["memory"][:6], 0)
    force = casadi.DM(KP) * error + 9e3 * change + 40 * inputs["orientation"][2] + inputs["reference_acceleration"][1]
    force = force * casadi.fmin(inputs["time"] / 0.05, 1) + 30
    outputs = [force, casadi.vertcat(error, count + 1)]
    return casadi.Function("law", list(inputs.values()), outputs, list(inputs), ["actuator_force", "memory_next"])


def test_a_casadi_function_gives_the_forces_of_the_same_law_in_python() -> None:
    """Expected: the law written a second time, in NumPy, as a function of a Sample in the harness."""
    experiment = uneven_experiment(reference=SINE, controller={**PD, "feedforward": "gravity"})
    last: list[FloatArray] = []

    def law(sample: Sample) -> FloatArray:
        error = sample.reference["leg_length"] - sample.measured["leg_length"]
        change = error - last[-1] if last else np.zeros(6)
        last.append(error)
        force = np.array(KP) * error + 9e3 * change + 40 * sample.measured["orientation"][2]
        force = force + sample.reference["acceleration"][1]
        return np.asarray(force * min(sample.time / 0.05, 1) + 30)

    made, run = designed(experiment, _traced()), run_in_python(experiment, law)
    assert [v.name for v in made.measured] == ["orientation", "leg_length"]
    for real in REALS:
        forces = Exported(made, real).forces(measured_by(run, made))
        assert largest_difference(forces, commanded(run, made)) < TOLERANCE[real], real


OTHER_GAINS = {
    "proportional_gain": [900.0, 700.0, 1000.0, 800.0, 1100.0, 950.0],
    "derivative_gain": [70.0, 0.0, 81.0, 62.0, 93.0, 76.0],
    "integral_gain": [1000.0, 0.0, 0.0, 800.0, 1400.0, 0.0],
    "derivative_filter": 0.005,
    "anti_windup_time": 0.03,
}
OTHER_BELIEF = {"platform_mass": 13.0, "platform_com": [0.1, 0.02, 0.2], "leg_viscous_friction": 11.0}


@pytest.mark.parametrize("space", ["leg", "task", "another platform"])
def test_what_is_tuned_in_c_is_that_of_another_design(space: str) -> None:
    """Expected: the forces of the harness under the other gains, or the other belief."""
    is_belief = space == "another platform"
    controller = {**PID, "space": "leg" if is_belief else space, "derivative_filter": 0.004, "feedforward": "gravity"}
    tables: dict[str, Any] = {"reference": SINE, "controller": controller, "actuators": {"force_limit": 52.0}}
    experiment = uneven_experiment(**tables)
    believed = {"preset": "liu2000", "parameters": {**experiment.platform.parameters, **OTHER_BELIEF}}
    changed = {"platform": believed} if is_belief else {"controller": {**controller, **OTHER_GAINS}}
    run, exported = run_in_python(uneven_experiment(**{**tables, **changed})), Exported(designed(experiment))
    for name, value in (OTHER_BELIEF if is_belief else OTHER_GAINS).items():
        exported.parameters[name] = value
    forces, expected = exported.forces(measured_by(run, exported.designed)), commanded(run, exported.designed)
    assert run.force_limited.any()
    if space == "leg":  # without an integral gain a leg's integral gives way to limits all the same
        forces, expected = (np.delete(values, 2, axis=1) for values in (forces, expected))
    elif space == "task":
        quiet = slice(0, int(run.force_limited.any(axis=1).argmax()) + 1)
        forces, expected = forces[quiet], expected[quiet]
    assert largest_difference(forces, expected) < TOLERANCE["double"]


def test_the_references_of_a_file_are_those_of_its_splines(tmp_path: Path) -> None:
    """Expected: the harness, which evaluates B-splines; beyond the end the pose of the last row at rest."""
    rng, times = np.random.default_rng(3), np.sort(np.append(np.linspace(-0.02, 0.15, 19), [0.0333, 0.0334]))
    pose = np.array([0.08, -0.05, 2.9, 0.04, -0.07, 0.11]) + 0.03 * np.sin(20 * times[:, None] + rng.uniform(0, 6, 6))
    columns = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
    rows = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in np.column_stack([times, pose]))]
    (tmp_path / "motion.csv").write_text("\n".join(rows))
    experiment = uneven_experiment(
        reference={"type": "file", "file": str(tmp_path / "motion.csv"), "start_time": 0.0},
        controller={**PD, "feedforward": "computed_torque"},
        limits={"condition_number": 1e3},
    )
    made, run = designed(experiment), run_in_python(experiment)
    measured = measured_by(run, made)
    for real in REALS:
        exported = Exported(made, real)
        assert largest_difference(exported.forces(measured), commanded(run, made)) < TOLERANCE[real], real
    hold = {"type": "hold", "position": pose[-1, :3].tolist(), "orientation": pose[-1, 3:].tolist()}
    at_rest = designed(uneven_experiment(reference=hold, controller={**PD, "feedforward": "gravity"}))
    lengths = leg_geometry(UNEVEN, pose[-1, :3], pose[-1, 3:]).length
    after, expected = (Exported(code).forces(np.tile(lengths + 0.01, (400, 1)))[-1:] for code in (made, at_rest))
    assert largest_difference(after, expected) < 1e-9

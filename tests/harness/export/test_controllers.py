"""Exported controllers in C against what those of `gs.run` commanded from the same noisy measurements."""

import re
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from tests.support import exported
from tests.support.exported import PD, PID, REALS, SINE, TOLERANCE, Exported, source_of, uneven_experiment
from tests.support.uneven import UNEVEN

CHIRP = {**SINE, "type": "chirp", "from_frequency": 2.0, "to_frequency": 7.0, "duration": 0.1}
del CHIRP["frequency"], CHIRP["phase"]
PATH: dict[str, Any] = {"reference.poses": [[0.0] * 6, [0.06, 0.02, 0.05, 0.0, 0.04, 0.0]], "loop.duration": 1.2}
# Tables of the uneven experiment, or settings of a shipped one; and a law that replaces its own.
CASES: dict[str, Any] = {
    "PD along a scaled motion": {
        "reference": {**CHIRP, "time_scale": 1.3, "amplitude_scale": -0.7},
        "controller": {**PD, "feedforward": "computed_torque", "derivative_gain": [0, *exported.KD[1:5], 0]},
    },
    "PID held, with every limit": {
        "reference": SINE,
        "controller": {**PID, "feedforward": "gravity", "discretisation": "zoh", "space": "task"},
        "actuators": {"force_limit": 47.0, "rate_limit": 900.0, "lag": 0.004},
    },
    "sines of an excitation": ("excitation", {"loop.duration": 0.3}),
}
# Motions along a path: settings of a shipped experiment.
SMALLER = {"reference.interpolation": "cubic", "reference.time_scale": 1.3, "reference.amplitude_scale": -0.6}
CHOSEN = {"reference.timing": 2.0, "reference.margin": 0.0, "reference.ramp": 0.0, "reference.at": 0.0}
PATHS: dict[str, dict[str, Any]] = {"fastest, smaller and slower": SMALLER, "in a chosen time": CHOSEN}


def experiment_of(case: str) -> gs.Experiment:
    """An experiment of the table."""
    tables = CASES[case]
    return uneven_experiment(**tables) if isinstance(tables, dict) else gs.load_experiment(*tables)


@pytest.mark.parametrize("case", CASES)
def test_an_exported_controller_gives_the_forces_of_the_harness(case: str) -> None:
    experiment = experiment_of(case)
    record, source = gs.run(experiment), source_of(experiment)
    expected, limited = exported.commanded(record), exported.samples_of(record, "flag.force_limited")
    assert record.metadata["outcome"]["status"] == "completed"
    assert limited.any() == ("limit" in case)
    for real in REALS:
        force, flags = Exported(source, real).steps(exported.measured_by(record))
        assert np.array_equal(flags, limited)
        assert exported.largest_difference(force, expected) < TOLERANCE[real], real


@pytest.mark.parametrize("motion", PATHS)
def test_forces_along_a_path_are_those_of_a_run(motion: str) -> None:
    """Expected: the run's feedforward, to 1e-6 of the largest force, since the time law of a path is rounded."""
    settings = {**PATH, **PATHS[motion]}
    alone = {**settings, "controller": {"type": "open_loop", "feedforward": "computed_torque"}}
    expected = exported.samples_of(gs.run("fastest_path", settings), "controller.feedforward")
    source = source_of("fastest_path", settings=alone)
    for real in REALS:
        force, _ = Exported(source, real).steps(np.zeros((len(expected), 0)))
        assert np.abs(force - expected).max() < max(1e-6, TOLERANCE[real]) * np.abs(expected).max(), real
    said = exported.words_of(source.with_suffix(".h"))
    rounding = re.search(r"in double precision, forces differ from those of a run by (\S+) of these", said)
    flash = re.search(r"Constants in flash: (\d+) bytes", said)
    assert rounding is not None
    assert flash is not None
    assert 0 < float(rounding[1]) < 1e-6
    assert 500 < int(flash[1]) < 64 * 1024


def system(n_states: int, n_inputs: int, size: float) -> Any:
    """A discrete system of the loop's sample time, with two integrators in a row."""
    rng = np.random.default_rng(5)
    A = rng.normal(size=(n_states, n_states))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    A[:2] = 0.0
    A[0, :2], A[1, 1] = [1, 0.3], 1.0
    B, C = rng.normal(size=(n_states, n_inputs)) * 0.1, rng.normal(size=(6, n_states)) * size
    return control.ss(A, B, C, rng.normal(size=(6, n_inputs)) * size, 0.0015)


def test_a_discrete_system_gives_the_forces_of_the_harness() -> None:
    """Of references and measurements of lengths, velocities and the pose, in an order of one's own."""
    limits: dict[str, Any] = {"actuators": {"force_limit": 90.0}, "limits": {"position_error": 1e3}}
    clocks = {"duration": 0.06, "sample_time": 0.0015, "plant_step": 0.0005}
    controller = {**PD, "feedforward": "gravity"}
    experiment = uneven_experiment(reference=SINE, controller=controller, loop=clocks, **limits)
    law = gs.LinearController(system(5, 36, 5.0), ("leg_velocity", "leg_length", "position", "orientation"))
    record, source = gs.run(experiment, controller=law), source_of(experiment, law)
    measured = exported.measured_by(record, "position", "orientation", "leg_length", "leg_velocity")
    measured[15:, 5] -= 2 * np.pi  # the yaw is counted otherwise
    for real in REALS:
        force, _ = Exported(source, real).steps(measured)
        assert exported.largest_difference(force, exported.commanded(record)) < TOLERANCE[real], real


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
    record, code = gs.run(uneven_experiment(**{**tables, **changed})), Exported(source_of(experiment))
    for name, value in (OTHER_BELIEF if is_belief else OTHER_GAINS).items():
        code.parameters[name] = value
    (forces, _), expected = code.steps(exported.measured_by(record)), exported.commanded(record)
    limited = exported.samples_of(record, "flag.force_limited").any(axis=1)
    assert limited.any()
    if space == "leg":  # without an integral gain a leg's integral gives way to limits all the same
        forces, expected = (np.delete(values, 2, axis=1) for values in (forces, expected))
    elif space == "task":
        forces, expected = (values[: int(limited.argmax()) + 1] for values in (forces, expected))
    assert exported.largest_difference(forces, expected) < TOLERANCE["double"]


def test_the_references_of_a_file_are_those_of_its_splines(tmp_path: Path) -> None:
    """Expected: the harness, which evaluates B-splines; beyond the end the pose of the last row at rest."""
    rng, times = np.random.default_rng(3), np.sort(np.append(np.linspace(-0.02, 0.15, 21), [0.0333, 0.0334]))
    pose = np.array([0.08, -0.05, 2.9, 0.04, -0.07, 0.11]) + 0.03 * np.sin(20 * times[:, None] + rng.uniform(0, 6, 6))
    columns = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
    rows = [",".join(columns), *(",".join(map(repr, map(float, row))) for row in np.column_stack([times, pose]))]
    (tmp_path / "motion.csv").write_text("\n".join(rows))
    experiment = uneven_experiment(
        reference={"type": "file", "file": str(tmp_path / "motion.csv"), "start_time": 0.0},
        controller={**PD, "feedforward": "computed_torque"},
        limits={"condition_number": 1e3},
    )
    record, source = gs.run(experiment), source_of(experiment)
    for real in REALS:
        forces, _ = Exported(source, real).steps(exported.measured_by(record))
        assert exported.largest_difference(forces, exported.commanded(record)) < TOLERANCE[real], real
    hold = {"type": "hold", "position": pose[-1, :3].tolist(), "orientation": pose[-1, 3:].tolist()}
    at_rest = source_of(uneven_experiment(reference=hold, controller={**PD, "feedforward": "gravity"}))
    lengths = gs.leg_geometry(UNEVEN, pose[-1, :3], pose[-1, 3:]).length
    after, expected = (Exported(code).steps(np.tile(lengths + 0.01, (400, 1)))[0][-1:] for code in (source, at_rest))
    assert exported.largest_difference(after, expected) < 1e-9


@pytest.mark.parametrize("reference", [SINE, exported.CIRCLE, CHIRP], ids=lambda reference: reference["type"])
def test_phases_stay_right_for_months(reference: dict[str, Any]) -> None:
    """Expected: double precision at that sample; a float alone has no digit of the phase after a million samples."""
    source, T = source_of(uneven_experiment(reference=reference, controller={**PD, "feedforward": "gravity"})), 0.0015
    for start in (10**6, 2**23 - 2, 10**9, 10**11):
        both = [Exported(source, real).start() for real in REALS]
        for code in both:
            code.step(np.full(6, 3.0))
            code.set_samples(start)
        rounding = 1e-15 * start * T * 2 * np.pi * 5  # [rad], of the double
        for _ in range(5):
            double, single = (code.step(np.full(6, 3.0))[0] for code in both)
            assert np.abs(single - double).max() < 1e-4 * np.abs(double).max() + 0.1 * rounding * 2e4
        assert [both[1].remembered(name)[0] for name in ("turns", "samples")] == list(divmod(start + 5, 2**23))


@pytest.mark.parametrize("change", [-1e-5, 1e-5])
def test_another_sample_time_than_the_designed_one_has_no_part_of_it(change: float) -> None:
    """Expected: double precision after a hundred million samples; what a float leaves out would be 5 ms by then."""
    source = source_of(uneven_experiment(reference=exported.CIRCLE, controller={**PD, "feedforward": "gravity"}))
    forces = []
    for real in REALS:
        code = Exported(source, real)
        code.parameters["sample_time"] = np.float32(0.0015 + change)
        code.start().step(np.full(6, 3.0))
        code.set_samples(10**8)
        forces.append(code.step(np.full(6, 3.0))[0])
    np.testing.assert_allclose(forces[1], forces[0], atol=1e-4 * np.abs(forces[0]).max())


def test_small_steps_of_an_integral_add_up() -> None:
    """Expected: double precision; steps are less than half of what a float of the sum resolves."""
    source = source_of(uneven_experiment(reference=exported.HOLD, controller=PID))
    place = np.array(exported.HOLD["position"]), np.array(exported.HOLD["orientation"])
    lengths = gs.leg_geometry(UNEVEN, *place).length
    both = [Exported(source, real).start() for real in REALS]
    for error, samples in ((0.1, 2000), (1e-6, 4000)):
        for _ in range(samples):
            expected, force = (code.step(lengths - error)[0] for code in both)
    step = np.array(exported.KI) * 1e-6 * 0.0015
    legs = step > 0
    assert (step < np.spacing(expected.astype(np.float32)) / 2)[legs].all()
    assert (np.abs(force - expected) < 0.2 * 4000 * step)[legs].all()


def test_the_header_states_what_single_precision_costs() -> None:
    """Expected: the forces in a float less those in double precision, measured again with another compiler."""
    experiment = experiment_of("PID held, with every limit")
    source, record = source_of(experiment), gs.run(experiment)
    said = exported.words_of(source.with_suffix(".h"))
    stated = re.search(
        r"With EXPERIMENT_CONTROLLER_REAL=float, forces deviate from those in double precision, in (\S+) s of the "
        r"designed loop, by at most (\S+) N, (\S+) of the largest force; in root mean square by (\S+) N",
        said,
    )
    assert stated is not None
    double, single = (Exported(source, real).steps(exported.measured_by(record))[0] for real in REALS)
    deviation = single - double
    most, mean_square = np.abs(deviation).max(), (deviation**2).mean()
    duration, said_most, share, said_mean = map(float, stated.groups())
    assert duration == pytest.approx(0.15, abs=0.01)
    assert [said_most, share] == pytest.approx([most, most / np.abs(double).max()], rel=0.4)
    assert said_mean / said_most == pytest.approx(mean_square**0.5 / most, rel=0.1)

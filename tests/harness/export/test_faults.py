"""Inputs as they come on a machine: dead buses, spikes, NaN, frozen sensors; coefficients that were never prepared."""

from functools import cache
from typing import Any

import casadi
import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.control.laws import LinearController
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.choices import faults_of
from gough_stewart.harness.export.design import Designed, designed, ranges_of
from gough_stewart.harness.motion.limits.reach import LegMotion, legs_of
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import load_preset
from gough_stewart.model.vectors import FloatArray
from tests.harness.export.test_controllers import CIRCLE, HOLD, PD, PID, SINE
from tests.support.exported import KP, Exported, commanded, measured_by, run_in_python, uneven_experiment
from tests.support.uneven import UNEVEN

GOOD, OUT_OF_RANGE, FROZEN, NOT_FINITE, NOT_PREPARED = range(5)
LIMIT = 400.0
TABLES: dict[str, dict[str, Any]] = {
    "PD": {"reference": CIRCLE, "controller": {**PD, "feedforward": "gravity"}},
    "PID": {"reference": SINE, "controller": {**PID, "feedforward": "computed_torque"}},
    "PID in task space": {"reference": SINE, "controller": {**PID, "space": "task", "feedforward": "gravity"}},
}
BAD: dict[str, Any] = {
    "NaN in one leg": [np.nan, None, None, None, None, None],
    "infinite in one leg": [None, None, -np.inf, None, None, None],
    "a dead bus": [0.0] * 6,
    "a spike of 1e10": [None, None, None, 1e10, None, None],
    "a spike of 1e300": [None, None, None, None, 1e300, None],
    "a spike of -1e300": [None, None, None, None, None, -1e300],
    "just beyond the stroke": [None, 3.9 + 0.17, None, None, None, None],
}


@cache
def calm(case: str) -> tuple[Designed, FloatArray, FloatArray]:
    """A controller, what it measures in a run, and the forces of its feedforward in an open loop."""
    tables = {**TABLES[case], "actuators": {"force_limit": 3000.0}}
    made = designed(uneven_experiment(**tables))
    feedforward = {"reference": tables["reference"], "controller": {"type": "open_loop"}}
    feedforward["controller"]["feedforward"] = tables["controller"]["feedforward"]
    known = commanded(run_in_python(uneven_experiment(**feedforward)), made)
    return made, measured_by(run_in_python(uneven_experiment(**tables)), made), known


def spoiled(good: Any, bad: Any) -> np.ndarray:
    """The measurement with some elements replaced."""
    return np.array([value if other is None else other for value, other in zip(good, bad, strict=True)])


def lengths_at(made: Designed, sample: int) -> np.ndarray:
    assert made.reference is not None
    at = made.reference(np.array([sample * made.sample_time]))
    return np.asarray(legs_of(UNEVEN, at).leg_length[0])


def known_at(made: Designed, sample: int) -> np.ndarray:
    """Static forces of the reference when the force of a sample acts, by the physics in NumPy (6,) [N]."""
    assert made.reference is not None
    at = made.reference(np.array([(sample + made.delay + 0.5) * made.sample_time]))
    return np.asarray(static_leg_forces(UNEVEN, at.position[0], at.orientation[0]))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("case", TABLES)
def test_a_bad_sample_gives_the_feedforward_and_the_next_good_one_recovers(case: str, bad: str) -> None:
    """Expected: all six forces of the feedforward (of an open loop), no state changed; the run goes on as if unhurt.

    Compared with a controller that saw the good measurement at that sample: one sample of a law with time constants
    of many samples changes the next forces by a part of their own change only.
    """
    made, measured, known = calm(case)
    exported, unhurt = Exported(made).start(), Exported(made).start()
    for row in measured[:40]:
        exported.step(row)
        unhurt.step(row)
    states = exported.remembered("states")
    force, limited = exported.step(spoiled(measured[40], BAD[bad]))
    np.testing.assert_allclose(force, known[40], rtol=1e-9, atol=1e-9)
    assert not limited.any()
    assert np.array_equal(exported.remembered("states"), states)
    assert (exported.status, exported.bad_time) == (OUT_OF_RANGE, made.sample_time)
    usual = [unhurt.step(row)[0] for row in measured[40:60]]
    after = [exported.step(row)[0] for row in measured[41:60]]
    assert (exported.status, exported.bad_time) == (GOOD, 0.0)
    change = np.abs(np.diff(usual, axis=0)).max()
    assert np.abs(np.array(after) - usual[1:]).max() < 4 * change
    assert np.isfinite(exported.memory).all()


@pytest.mark.parametrize("space", ["leg", "task"])
def test_after_a_gap_the_law_begins_at_rest_with_its_integrals(space: str) -> None:
    """Expected, by hand: F = kp e + x + ki T e/2 + known in leg space; no derivative of the jump of e over the gap.

    In task space: no more than without the gap's memory, that is the force of a law that starts anew plus the integral.
    """
    controller = {**PID, "space": space, "derivative_filter": 0.004, "feedforward": "gravity"}
    experiment = uneven_experiment(reference=HOLD, controller=controller, actuators={"force_limit": 3e4})
    made = designed(experiment)
    exported, fresh = Exported(made).start(), Exported(made).start()
    before = made.first_measured + np.array([3, -2, 4, 1, -5, 2]) * 1e-3
    after = made.first_measured - np.array([2, 7, -1, 8, 2, -8]) * 1e-3
    for _ in range(50):
        exported.step(before)
    for k in range(20):
        exported.step(np.full(6, np.nan))
        assert exported.bad_time == pytest.approx((k + 1) * made.sample_time)
    force, _ = exported.step(after)
    known = static_leg_forces(UNEVEN, np.array(HOLD["position"]), np.array(HOLD["orientation"]))
    anew, _ = fresh.step(after)
    if space == "leg":
        kp, ki, T = np.array(KP), np.array(PID["integral_gain"]), made.sample_time
        before_e, e = made.first_measured - before, made.first_measured - after
        integral = ki * T * (50 * before_e + e / 2)  # Tustin: half a step at either end
        np.testing.assert_allclose(force, kp * e + integral + known, rtol=1e-9)
    # the integral of the first law alone is between them; without it both are the same
    gap = exported.remembered("states") - fresh.remembered("states")
    assert np.abs(gap).max() > 0
    assert np.abs(force - anew).max() < 3 * np.abs(50 * made.sample_time * np.array(PID["integral_gain"]) * 5e-3).max()


def test_recovery_of_a_discrete_system_keeps_its_integrators_only() -> None:
    """Expected, by hand: states (integrator, filter) are (x1, rest) after a gap; rest of x⁺ = 0.6 x + e is e/0.4."""
    A, B = np.diag([1.0] * 6 + [0.6] * 6), np.vstack([0.01 * np.eye(6), np.eye(6)])
    law = LinearController(control.ss(A, B, np.hstack([40 * np.eye(6), 25 * np.eye(6)]), np.diag(KP), 0.0015))
    made = designed(uneven_experiment(reference=HOLD, controller={**PD, "feedforward": "none"}), law)
    exported = Exported(made).start()
    e0, e1 = np.array([3, -2, 4, 1, -5, 2]) * 1e-3, np.array([2, 7, -1, 8, 2, -8]) * 1e-3
    for _ in range(30):
        exported.step(made.first_measured - e0)
    for _ in range(7):
        exported.step(np.zeros(6))
    force, _ = exported.step(made.first_measured - e1)
    np.testing.assert_allclose(force, 40 * 30 * 0.01 * e0 + 25 * e1 / 0.4 + np.array(KP) * e1, rtol=1e-9)


def test_a_far_measurement_within_its_range_is_one() -> None:
    """Expected: limited forces while it lasts, none of them beyond the limit, finite states, and good inputs."""
    experiment = uneven_experiment(**TABLES["PID"], actuators={"force_limit": LIMIT})
    made, run = designed(experiment), run_in_python(experiment)
    exported, measured = Exported(made).start(), measured_by(run, made)
    far = measured.copy()
    far[30, 2] = 3.85
    forces = exported.forces(far)
    assert exported.status == GOOD
    assert np.abs(forces).max() <= LIMIT
    assert np.abs(forces[30, 2]) == LIMIT
    # the filter forgets the spike, and the integral took what was cut off
    assert np.abs(forces[95:] - commanded(run, made)[95:]).max() < 0.1 * LIMIT


@pytest.mark.parametrize(
    ("feedforward", "safe_force", "expected"),
    [
        ("gravity", "feedforward", "known"),
        ("gravity", "zero", "zero"),
        ("none", "feedforward", "start"),
        ("none", "zero", "zero"),
    ],
)
def test_the_safe_force_is_chosen_at_export(feedforward: str, safe_force: str, expected: str) -> None:
    """Expected: static forces by the physics; the start forces where nothing is known; or zero; within the limit."""
    experiment = uneven_experiment(reference=CIRCLE, controller={**PD, "feedforward": feedforward})
    made = designed(experiment, faults=faults_of(safe_force))
    exported = Exported(made).start()
    for k in range(3):
        exported.step(lengths_at(made, k))
    wanted = {"known": known_at(made, 3), "start": made.start_force, "zero": np.zeros(6)}[expected]
    force, limited = exported.step(np.zeros(6))
    np.testing.assert_allclose(force, wanted, rtol=1e-9, atol=1e-12)
    assert not limited.any()
    exported.parameters["force_limit"] = 20.0
    assert exported.prepare() == 0
    force, limited = exported.step(np.zeros(6))
    if expected == "known":
        wanted = known_at(made, 4)
    np.testing.assert_allclose(force, np.clip(wanted, -20, 20), rtol=1e-9, atol=1e-12)
    assert np.array_equal(limited, np.abs(wanted) > 20)


def test_a_bad_reference_gives_the_feedforward_of_the_last_good_one() -> None:
    """Expected: the same forces again; for zeros, NaN and a position out of reach; before any, the start forces."""
    experiment = uneven_experiment(reference=CIRCLE, controller={**PD, "feedforward": "gravity"})
    made = designed(experiment, reference="inputs")
    inside = designed(experiment).reference
    assert inside is not None
    first = np.concatenate(inside(np.array([0.05])), axis=1)[0]
    lengths = leg_geometry(UNEVEN, first[:3], first[3:6]).length
    exported = Exported(made).start()
    bad = first.copy()
    bad[7] = np.nan
    assert np.array_equal(exported.step(lengths, bad)[0], made.start_force)
    known, _ = exported.step(lengths, first)  # exactly on the reference
    far = first.copy()
    far[2] = 9.0
    for reference in (bad, np.zeros(18), far):
        np.testing.assert_allclose(exported.step(lengths, reference)[0], known, rtol=1e-12)
        assert exported.status == OUT_OF_RANGE
    np.testing.assert_allclose(exported.step(np.zeros(6), first)[0], known, rtol=1e-9)
    exported.step(lengths, first)
    assert exported.status == GOOD


def test_a_force_that_is_no_number_is_told_from_a_bad_input() -> None:
    """Expected: √(z) of a law at z = −0.1 m, within the range; the feedforward, and a status of its own."""
    p = casadi.SX.sym("p", 3)
    law = casadi.Function("law", [p], [casadi.repmat(casadi.sqrt(p[2]), 6)], ["position"], ["actuator_force"])
    made = designed(uneven_experiment(reference=HOLD, controller={**PD, "feedforward": "gravity"}), law)
    exported = Exported(made).start()
    place = np.array(HOLD["position"])
    normal, _ = exported.step(place)
    force, _ = exported.step([place[0], place[1], -0.1])
    assert exported.status == NOT_FINITE
    np.testing.assert_allclose(force, normal - np.sqrt(place[2]), rtol=1e-12)
    assert np.array_equal(exported.step(place)[0], normal)


def test_a_memory_that_is_no_number_is_not_kept() -> None:
    """Expected: a law whose memory becomes infinite keeps the one before."""
    length, memory = casadi.SX.sym("length", 6), casadi.SX.sym("memory")
    grown = memory + 1 / (length[0] - 3)
    names = ["leg_length", "memory"], ["actuator_force", "memory_next"]
    law = casadi.Function("law", [length, memory], [length, grown], *names)
    made = designed(uneven_experiment(reference=HOLD, controller={**PD, "feedforward": "none"}), law)
    exported = Exported(made).start()
    exported.step([3.5, 3, 3, 3, 3, 3])
    exported.step([3.0, 3, 3, 3, 3, 3])
    assert exported.status == NOT_FINITE
    assert exported.remembered("states") == 2


@pytest.mark.parametrize("signal", ["leg_length", "position"])
def test_a_measurement_that_stands_still_while_its_reference_moves_is_frozen(signal: str) -> None:
    """Expected: bad from the sample at which both bounds are passed, until it moves; by the reference."""
    size = 6 if signal == "leg_length" else 3
    law = LinearController(control.ss([], [], [], 100 * np.ones((6, size)), 0.0015), (signal,))
    samples, movement = 20, 0.004
    faults = faults_of(frozen=(samples, movement))
    made = designed(uneven_experiment(reference=SINE, controller={**PD, "feedforward": "gravity"}), law, faults=faults)
    assert made.reference is not None
    times = made.sample_time * np.arange(300)
    at = made.reference(times)
    wanted = legs_of(UNEVEN, at).leg_length if signal == "leg_length" else at.position
    exported = Exported(made).start()
    for k in range(60):
        exported.step(wanted[k])
        assert exported.status == GOOD
    stuck = wanted[59, 1]
    moved = np.abs(np.maximum.accumulate(np.abs(wanted[59:, 1] - stuck)))
    since = np.arange(len(moved))
    expected = (since >= samples) & (moved > movement)
    first = 59 + int(expected.argmax())
    assert first > 59
    for k in range(60, first + 110):
        row = wanted[k].copy()
        row[1] = stuck
        exported.step(row)
        assert exported.status == (FROZEN if k >= first else GOOD), k
    # the reference has come back, which thaws nothing
    assert np.abs(wanted[first : first + 110, 1] - stuck).min() < movement / 2
    assert exported.bad_time == pytest.approx(110 * made.sample_time)
    exported.step(wanted[first + 110])
    assert exported.status == GOOD


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"safe_force": "brake"}, "safe_force is 'brake'; expected 'feedforward' or 'zero'"),
        ({"frozen": 5}, "frozen is 5; expected a number of samples and a movement"),
        ({"frozen": (0, 1.0)}, "expected a number of samples"),
        ({"frozen": (2.5, 1.0)}, "expected a number of samples"),
        ({"frozen": (5, 0.0)}, "such as"),
        ({"frozen": (5, np.inf)}, "such as"),
    ],
)
def test_choices_that_cannot_be_are_refused(arguments: Any, message: str) -> None:
    with pytest.raises(ExportError, match=message):
        faults_of(**arguments)


def test_a_controller_of_rates_cannot_be_watched() -> None:
    damper = LinearController(control.ss([], [], [], np.eye(6), 0.0015), signals=("leg_velocity",))
    with pytest.raises(ExportError, match=r"leg_length or position.*the controller measures leg_velocity"):
        designed(uneven_experiment(reference=SINE, controller=PD), damper, faults=faults_of(frozen=(5, 0.1)))


@cache
def pid_with_gravity(with_drives: bool) -> Designed:
    """A PID alone, or with the drives of its machine."""
    actuators = {"force_limit": 900.0, "lag": 2e-3} if with_drives else {}
    tables = {"reference": HOLD, "controller": {**PID, "feedforward": "gravity"}, "actuators": actuators}
    return designed(uneven_experiment(**tables), parts=("drives",) if with_drives else ())


DRIVES = pytest.mark.parametrize("with_drives", [False, True], ids=["at samples", "at steps of drives"])


@DRIVES
def test_coefficients_that_were_never_prepared_give_zero_and_say_so(with_drives: bool) -> None:
    """Expected: no force, a status of its own, and nothing else in the memory; all is well once they are prepared."""
    exported = Exported(pid_with_gravity(with_drives))
    exported.start()
    prepared = exported.coefficients.copy()
    exported.coefficients[:] = 0
    before = exported.memory.copy()
    force, limited = exported.step(exported.designed.first_measured + 0.01)
    assert not force.any()
    assert not limited.any()
    assert exported.status == NOT_PREPARED
    exported.coefficients[:] = prepared
    again, _ = exported.step(exported.designed.first_measured)
    assert np.abs(again).min() > 0.1
    assert exported.status == GOOD
    assert exported.bad_time == 0
    # the status alone was written
    fresh = Exported(exported.designed).start()
    assert np.array_equal(fresh.memory, before)
    assert np.array_equal(fresh.step(exported.designed.first_measured)[0], again)


@DRIVES
@pytest.mark.parametrize(("name", "value"), [("platform_mass", np.nan), ("proportional_gain", -1.0), ("delay", 0.5)])
def test_a_refused_parameter_leaves_the_coefficients_in_use(name: str, value: float, with_drives: bool) -> None:
    """Expected: each byte of them, so the forces of a controller whose parameter was never touched."""
    made = pid_with_gravity(with_drives)
    touched, other = Exported(made).start(), Exported(made).start()
    for k in range(6):
        measured = made.first_measured + 1e-3 * k
        good, before = touched.parameters[name].copy(), touched.coefficients.copy()
        touched.parameters[name] = value
        assert touched.prepare() == 1 + [each.variable.name for each in made.settings].index(name)
        assert touched.coefficients.tobytes() == before.tobytes()
        touched.parameters[name] = good
        force, _ = touched.step(measured)
        assert np.abs(force).min() > 0.1
        assert np.array_equal(force, other.step(measured)[0])
        assert touched.status == GOOD


@pytest.mark.parametrize("name", ["force_limit", "force_rate_limit"])
@pytest.mark.parametrize("value", [0.0, np.inf])
def test_a_limit_of_zero_is_none(name: str, value: float) -> None:
    """Expected: the forces of the harness without that limit."""
    tables = {"reference": SINE, "controller": PID}
    limits = {"force_limit": 47.0, "rate_limit": 900.0}
    exported = Exported(designed(uneven_experiment(**tables, actuators=limits)))
    exported.parameters[name] = value
    key = name.replace("force_rate", "rate")
    without = {k: v for k, v in limits.items() if k != key} | ({"force_limit": "none"} if key == "force_limit" else {})
    other = uneven_experiment(**tables, actuators=without)
    run = run_in_python(other)
    exported.parameters["start_force"] = designed(other).start_force  # a limit cuts these, too
    assert run.force_limited.any() == (name != "force_limit")
    forces = exported.forces(measured_by(run, exported.designed))
    expected = run.command if key == "force_limit" else np.clip(run.command, -47, 47)
    np.testing.assert_allclose(forces, expected[: len(forces)], rtol=1e-8, atol=1e-8)


def test_ranges_are_those_of_the_stroke_and_of_the_motion() -> None:
    """Expected: 2.3 to 3.9 m and a tenth of 1.6 m more; a motion beyond the stroke is within."""
    ranges = ranges_of(UNEVEN, 0.01, None)
    np.testing.assert_allclose(ranges.leg_length, (2.14, 4.06))
    lengths = np.array([[2.5, 2.6, 2.4, 2.1, 2.9, 2.8], [2.5, 2.6, 2.4, 2.2, 4.2, 2.8]])
    np.testing.assert_allclose(ranges_of(UNEVEN, 0.01, LegMotion(lengths, 0 * lengths)).leg_length, (1.89, 4.41))


@pytest.mark.parametrize("preset", ["liu2000", "motion_base", "desktop_hexapod"])
@given(
    direction=st.tuples(*[st.floats(-1, 1)] * 3),
    angles=st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)),
)
@settings(max_examples=20)
def test_poses_whose_legs_are_in_range_are_in_range(preset: str, direction: Any, angles: Any) -> None:
    """Expected: every pose with such legs; without a stroke every pose within a mean leg of home has such legs."""
    platform = load_preset(preset)
    ranges = ranges_of(platform, 0.001, None)
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    along = np.array(direction)
    position = platform.home_position + along / max(1.0, float(np.linalg.norm(along))) * home.mean()
    lengths = leg_geometry(platform, position, np.array(angles)).length
    low, high = ranges.leg_length
    if platform.leg_length_min is None:
        assert (lengths <= high).all()
    if ((lengths >= low) & (lengths <= high)).all():
        assert (position >= ranges.position.low).all()
        assert (position <= ranges.position.high).all()
    assert 0 < low < home.min()
    assert home.max() < high

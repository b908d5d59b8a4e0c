"""Inputs as they come on a machine: dead buses, spikes, NaN, frozen sensors; coefficients that were never prepared."""

from functools import cache
from typing import Any

import casadi
import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart import GoughStewartError, LinearController, leg_geometry, load_preset, static_leg_forces
from gough_stewart.harness.export.choices import faults_of
from gough_stewart.harness.export.design import Designed, designed, ranges_of
from gough_stewart.harness.motion.limits.reach import LegMotion, legs_of
from tests.harness.export.test_controllers import CIRCLE, HOLD, PD, PID, SINE
from tests.support.arrays import FloatArray
from tests.support.exported import KP, Exported, commanded, measured_by, run_in_python, uneven_experiment
from tests.support.uneven import UNEVEN

GOOD, OUT_OF_RANGE, FROZEN, NOT_FINITE, NOT_PREPARED = range(5)
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
    "just beyond the stroke": [None, 3.9 + 0.17, None, None, None, None],
}
BEFORE, AFTER = np.array([[3, -2, 4, 1, -5, 2], [2, 7, -1, 8, 2, -8]]) * 1e-3


def started(controller: Any = None, feedforward: str = "none", motion: Any = HOLD, **options: Any) -> Exported:
    """The code of an experiment's PD, or of what replaces it."""
    experiment = uneven_experiment(reference=motion, controller={**PD, "feedforward": feedforward})
    return Exported(designed(experiment, controller, **options)).start()


def function_of(name: str, size: int, force: Any, **memory: Any) -> casadi.Function:
    """A law of one signal, and perhaps of a memory."""
    signal, state = casadi.SX.sym(name, size), casadi.SX.sym("memory")
    outputs = [force(signal), *(following(signal, state) for following in memory.values())]
    names = [name, "memory"] if memory else [name], ["actuator_force", "memory_next"][: len(outputs)]
    return casadi.Function("law", [signal, state][: len(names[0])], outputs, *names)


@cache
def calm(case: str) -> tuple[Designed, FloatArray, FloatArray]:
    """A controller, what it measures in a run, and the forces of its feedforward in an open loop."""
    tables = {**TABLES[case], "actuators": {"force_limit": 3000.0}}
    made = designed(uneven_experiment(**tables))
    alone = {"type": "open_loop", "feedforward": tables["controller"]["feedforward"]}
    known = commanded(run_in_python(uneven_experiment(reference=tables["reference"], controller=alone)), made)
    return made, measured_by(run_in_python(uneven_experiment(**tables)), made), known


@pytest.mark.parametrize(("case", "bad"), [*(("PD", bad) for bad in BAD), *((case, "a dead bus") for case in TABLES)])
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
    spoiled = [good if other is None else other for good, other in zip(measured[40], BAD[bad], strict=True)]
    force, limited = exported.step(spoiled)
    np.testing.assert_allclose(force, known[40], rtol=1e-9, atol=1e-9)
    assert not limited.any()
    assert np.array_equal(exported.remembered("states"), states)
    assert (exported.status, exported.bad_time) == (OUT_OF_RANGE, made.sample_time)
    usual = [unhurt.step(row)[0] for row in measured[40:60]]
    after = [exported.step(row)[0] for row in measured[41:60]]
    assert (exported.status, exported.bad_time) == (GOOD, 0.0)
    assert np.abs(np.array(after) - usual[1:]).max() < 4 * np.abs(np.diff(usual, axis=0)).max()
    assert np.isfinite(exported.memory).all()


@pytest.mark.parametrize("space", ["leg", "task"])
def test_after_a_gap_the_law_begins_at_rest_with_its_integrals(space: str) -> None:
    """Expected, by hand: F = kp e + x + ki T e/2 + known in leg space; no derivative of the jump of e over the gap.

    In task space: no more than without the gap's memory, that is the force of a law that starts anew plus the integral.
    """
    controller = {**PID, "space": space, "derivative_filter": 0.004, "feedforward": "gravity"}
    made = designed(uneven_experiment(reference=HOLD, controller=controller, actuators={"force_limit": 3e4}))
    exported, fresh = Exported(made).start(), Exported(made).start()
    for _ in range(50):
        exported.step(made.first_measured + BEFORE)
    for k in range(20):
        exported.step(np.full(6, np.nan))
        assert exported.bad_time == pytest.approx((k + 1) * made.sample_time)
    force, anew = (code.step(made.first_measured - AFTER)[0] for code in (exported, fresh))
    ki, T = np.array(PID["integral_gain"]), made.sample_time
    if space == "leg":
        known = static_leg_forces(UNEVEN, np.array(HOLD["position"]), np.array(HOLD["orientation"]))
        integral = ki * T * (AFTER / 2 - 50 * BEFORE)  # Tustin: half a step at either end
        np.testing.assert_allclose(force, np.array(KP) * AFTER + integral + known, rtol=1e-9)
    # the integral of the first law alone is between them; without it both are the same
    assert np.abs(exported.remembered("states") - fresh.remembered("states")).max() > 0
    assert np.abs(force - anew).max() < 3 * np.abs(50 * T * ki * 5e-3).max()


def test_recovery_of_a_discrete_system_keeps_its_integrators_only() -> None:
    """Expected, by hand: states (integrator, filter) are (x1, rest) after a gap; rest of x⁺ = 0.6 x + e is e/0.4."""
    A, B = np.diag([1.0] * 6 + [0.6] * 6), np.vstack([0.01 * np.eye(6), np.eye(6)])
    law = LinearController(control.ss(A, B, np.hstack([40 * np.eye(6), 25 * np.eye(6)]), np.diag(KP), 0.0015))
    exported = started(law)
    for row in [exported.designed.first_measured - BEFORE] * 30 + [np.zeros(6)] * 7:
        exported.step(row)
    force, _ = exported.step(exported.designed.first_measured - AFTER)
    np.testing.assert_allclose(force, 40 * 30 * 0.01 * BEFORE + 25 * AFTER / 0.4 + np.array(KP) * AFTER, rtol=1e-9)


@pytest.mark.parametrize(
    ("feedforward", "safe_force", "expected"),
    [("gravity", "feedforward", "known"), ("gravity", "zero", "zero"), ("none", "feedforward", "start")],
)
def test_the_safe_force_is_chosen_at_export(feedforward: str, safe_force: str, expected: str) -> None:
    """Expected: static forces by the physics, when the force acts; start forces; or zero; within the limit."""
    exported = started(None, feedforward, CIRCLE, faults=faults_of(safe_force))
    made = exported.designed
    assert made.reference is not None
    times = made.sample_time * (np.arange(5) + np.array([[0.0], [made.delay + 0.5]]))
    now, later = map(made.reference, times)
    for lengths in legs_of(UNEVEN, now).leg_length[:3]:
        exported.step(lengths)
    known = [static_leg_forces(UNEVEN, later.position[k], later.orientation[k]) for k in (3, 4)]
    for limit, at in ((np.inf, 0), (20.0, 1)):
        exported.parameters["force_limit"] = limit
        assert exported.prepare() == 0
        wanted = np.asarray({"known": known[at], "start": made.start_force, "zero": np.zeros(6)}[expected])
        force, limited = exported.step(np.zeros(6))
        np.testing.assert_allclose(force, np.clip(wanted, -limit, limit), rtol=1e-9, atol=1e-12)
        assert np.array_equal(limited, np.abs(wanted) > limit)


def test_a_bad_reference_gives_the_feedforward_of_the_last_good_one() -> None:
    """Expected: the same forces again; for zeros, NaN and a position out of reach; before any, the start forces."""
    exported, inside = started(None, "gravity", CIRCLE, reference="inputs"), calm("PD")[0].reference
    assert inside is not None
    first = np.concatenate(inside(np.array([0.05])), axis=1)[0]
    lengths = leg_geometry(UNEVEN, first[:3], first[3:6]).length
    bad, far = first.copy(), first.copy()
    bad[7], far[2] = np.nan, 9.0
    assert np.array_equal(exported.step(lengths, bad)[0], exported.designed.start_force)
    known, _ = exported.step(lengths, first)  # exactly on the reference
    for reference in (bad, np.zeros(18), far):
        np.testing.assert_allclose(exported.step(lengths, reference)[0], known, rtol=1e-12)
        assert exported.status == OUT_OF_RANGE
    np.testing.assert_allclose(exported.step(np.zeros(6), first)[0], known, rtol=1e-9)
    exported.step(lengths, first)
    assert exported.status == GOOD


def test_a_force_or_a_memory_that_is_no_number_is_told_from_a_bad_input() -> None:
    """Expected: √(z) of a law at z = −0.1 m, within the range: the feedforward; an infinite memory is not kept."""
    exported = started(function_of("position", 3, lambda p: casadi.repmat(casadi.sqrt(p[2]), 6)), "gravity")
    x, y, z = HOLD["position"]
    normal, _ = exported.step([x, y, z])
    force, _ = exported.step([x, y, -0.1])
    assert exported.status == NOT_FINITE
    np.testing.assert_allclose(force, normal - np.sqrt(z), rtol=1e-12)
    assert np.array_equal(exported.step([x, y, z])[0], normal)
    exported = started(function_of("leg_length", 6, lambda v: v, memory=lambda v, state: state + 1 / (v[0] - 3)))
    for first, status in ((3.5, GOOD), (3.0, NOT_FINITE)):
        exported.step([first, 3, 3, 3, 3, 3])
        assert (exported.status, *exported.remembered("states")) == (status, 2)


@pytest.mark.parametrize("signal", ["leg_length", "position"])
def test_a_measurement_that_stands_still_while_its_reference_moves_is_frozen(signal: str) -> None:
    """Expected: bad from the sample at which both bounds are passed, until it moves; by the reference."""
    size, samples, movement = 6 if signal == "leg_length" else 3, 20, 0.004
    law = LinearController(control.ss([], [], [], 100 * np.ones((6, size)), 0.0015), (signal,))
    exported = started(law, "gravity", SINE, faults=faults_of(frozen=(samples, movement)))
    made = exported.designed
    assert made.reference is not None
    at = made.reference(made.sample_time * np.arange(300))
    wanted = legs_of(UNEVEN, at).leg_length if signal == "leg_length" else at.position
    for k in range(60):
        exported.step(wanted[k])
        assert exported.status == GOOD
    stuck = wanted[59, 1]
    moved = np.maximum.accumulate(np.abs(wanted[59:, 1] - stuck))
    first = 59 + int(((np.arange(len(moved)) >= samples) & (moved > movement)).argmax())
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
        *(({"frozen": (n, 1.0)}, "expected a number of samples") for n in (0, 2.5)),
        *(({"frozen": (5, movement)}, "such as") for movement in (0.0, np.inf)),
    ],
)
def test_choices_that_cannot_be_are_refused(arguments: Any, message: str) -> None:
    with pytest.raises(GoughStewartError, match=message):
        faults_of(**arguments)


def test_a_controller_of_rates_cannot_be_watched() -> None:
    damper = LinearController(control.ss([], [], [], np.eye(6), 0.0015), signals=("leg_velocity",))
    with pytest.raises(GoughStewartError, match=r"leg_length or position.*the controller measures leg_velocity"):
        started(damper, faults=faults_of(frozen=(5, 0.1)))


@cache
def pid_with_gravity(with_drives: bool) -> Designed:
    """A PID alone, or with the drives of its machine."""
    actuators = {"force_limit": 900.0, "lag": 2e-3} if with_drives else {}
    tables = {"reference": HOLD, "controller": {**PID, "feedforward": "gravity"}, "actuators": actuators}
    return designed(uneven_experiment(**tables), parts=("drives",) if with_drives else ())


@pytest.mark.parametrize("with_drives", [False, True], ids=["at samples", "at steps of drives"])
def test_coefficients_count_once_they_are_prepared_and_a_refused_parameter_leaves_them(with_drives: bool) -> None:
    """Expected: before, no force, a status of its own, and nothing else in the memory; each byte after a refusal."""
    made = pid_with_gravity(with_drives)
    exported, fresh = Exported(made).start(), Exported(made).start()
    prepared, before = exported.coefficients.copy(), exported.memory.copy()
    exported.coefficients[:] = 0
    force, limited = exported.step(made.first_measured + 0.01)
    assert not force.any()
    assert not limited.any()
    assert exported.status == NOT_PREPARED
    assert np.array_equal(fresh.memory, before)
    exported.coefficients[:] = prepared
    for k, (name, value) in enumerate((("platform_mass", np.nan), ("proportional_gain", -1.0), ("delay", 0.5))):
        good, of_now = exported.parameters[name].copy(), exported.coefficients.tobytes()
        exported.parameters[name] = value
        assert exported.prepare() == 1 + [s.variable.name for s in made.settings].index(name)
        assert exported.coefficients.tobytes() == of_now
        exported.parameters[name] = good
        measured = made.first_measured + 1e-3 * k
        force, _ = exported.step(measured)
        assert np.abs(force).min() > 0.1
        assert np.array_equal(force, fresh.step(measured)[0])
        assert (exported.status, exported.bad_time) == (GOOD, 0)


def test_ranges_are_those_of_the_stroke_and_of_the_motion() -> None:
    """Expected: 2.3 to 3.9 m and a tenth of 1.6 m more; a motion beyond the stroke is within."""
    np.testing.assert_allclose(ranges_of(UNEVEN, 0.01, None).leg_length, (2.14, 4.06))
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
    lengths, (low, high) = leg_geometry(platform, position, np.array(angles)).length, ranges.leg_length
    if platform.leg_length_min is None:
        assert (lengths <= high).all()
    if ((lengths >= low) & (lengths <= high)).all():
        assert (position >= ranges.position.low).all()
        assert (position <= ranges.position.high).all()
    assert 0 < low < home.min()
    assert home.max() < high

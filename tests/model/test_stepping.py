"""The stepping model's contract, rule by rule, of both integrators and four variants; one against a Lagrangian."""

import re
from copy import deepcopy
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart import GoughStewartError, State, StepError, SteppingModel, leg_geometry, leg_jacobian, mass_matrix
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.plain_motion import trajectory
from tests.support.real_platforms import real_platform
from tests.support.steppers import BOTH, CLOCKS, INTEGRATORS, MOTION, PLATFORMS, Integrator, moving, stepped
from tests.support.uneven import INPUT_VALUES, MOVING, STATE, UNEVEN

FORCES = INPUT_VALUES["actuator_force"].tolist()
INPUTS = np.concatenate([*INPUT_VALUES.values()])
PAPER = gs.load_preset("liu2000")
of_both = pytest.mark.parametrize(("name", "integrator"), BOTH)
by_both = pytest.mark.parametrize("integrator", INTEGRATORS)


def started(tolerance: float = 1e-8, integrator: Integrator = "compiled") -> SteppingModel:
    """The uneven platform in motion under all inputs, ready for its first step; regular for 0.9 s."""
    model = SteppingModel(UNEVEN, tolerance, integrator=integrator)
    model.set_many(MOVING)
    return model


def refused(model: SteppingModel, call: Any, message: str) -> Any:
    """The call fails with this message and leaves the model as it was (rule 8)."""
    before = model.save_state()
    with pytest.raises(GoughStewartError, match=message) as caught:
        call()
    assert model.save_state() == before
    return caught.value


# --- rules 1 to 4: variables ---------------------------------------------------------------------------------------


@of_both
def test_it_starts_at_home_at_rest_at_time_zero_and_stands_still(name: str, integrator: Integrator) -> None:
    """Expected: nothing moves; six different forces hold an uneven platform in gravity aslant."""
    model = SteppingModel(PLATFORMS[name], integrator=integrator)
    assert model.time == 0
    assert np.array_equal(model.get("position"), UNEVEN.home_position)
    assert np.array_equal(model.get("orientation"), UNEVEN.home_orientation)
    assert len(set(np.ravel(model.get("actuator_force")))) == 6
    home = model.state
    assert not home[6:12].any()
    model.do_step(0.0, 0.02)
    assert np.abs(model.state - home)[:6].max() < 1e-10
    # springs keep the rounding of their stretch
    assert np.abs(model.state - home).max() < (1e-7 if model.variant.springs else 1e-10)


REFUSED: list[tuple[Any, Any, str]] = [
    ("actuator_forces", FORCES, "did you mean 'actuator_force'"),
    (3, FORCES, "expected the name of a variable"),
    ("actuator_force", FORCES[:5], r"has shape \(5,\); expected numbers of shape \(6,\)"),
    ("actuator_force", [FORCES, [1]], "expected numbers"),
    ("actuator_force", [1, 2, np.nan, 4, 5, 6], r"actuator_force: is \[1.0, 2.0, nan"),
    ("actuator_force", np.array([1, 2, np.inf, 4, 5, 6]), r"actuator_force: is \[1.0, 2.0, inf"),
    ("actuator_force[2]", np.inf, r"actuator_force\[2\]: is inf"),
    ("actuator_force", [True] * 6, "expected numbers"),
    ("actuator_force", ["1"] * 6, "expected numbers"),
    ("actuator_force", np.ones(6) * 1j, "expected numbers"),
    ("actuator_force", [10**400] * 6, "expected numbers"),
    ("platform_mass", None, "is None; expected one number"),
    ("external_force", "up", "expected numbers"),
    ("external_force", 1.0, r"^external_force: has shape \(\); expected numbers of shape \(3,\) \[N\], ext"),
    ("leg_length", [3.0] * 6, r"is computed \(output\); set inputs, parameters or states instead"),
    ("joint_force[2,3]", 1.0, r"is computed \(local\)"),
    ("fixed_step_size", 1e-3, "parameter of the FMU"),
    ("orientation", [0, 1.6, 0], r"orientation\[2\]: is 1.6 rad; expected a pitch within ±1.5698 rad"),
    ("orientation[2]", -np.pi / 2 + 0.999e-3, "expected a pitch within"),
    ("platform_mass", -1.0, "is -1 kg; expected > 0"),
    ("leg_coulomb_friction", -1.0, "is -1 N; expected >= 0"),
    ("leg_bristle", np.zeros(6), "is nothing that this platform has: leg_friction_model is 's"),
    ("leg_damping", 3.0, "is nothing that this platform has: leg_stiffness is 0"),
    ("leg_stiffness", 1e7, "would give the model other states; make a SteppingModel of that platform"),
]


@pytest.mark.parametrize(("name", "value", "message"), REFUSED)
def test_what_cannot_be_set_is_refused(name: Any, value: Any, message: str) -> None:
    model = started()
    refused(model, lambda: model.set(name, value), message)


def test_what_is_set_is_what_is_had_and_nothing_else_changes() -> None:
    """Expected: every input, state and parameter one after the other, whole and its last element; also large forces."""
    settable = [v for v in gs.VARIABLES if v.causality in ("input", "parameter") or v.is_state]
    settable = [v for v in settable if v.name != "fixed_step_size"]
    for variable in (v for v in settable if v.name != "platform_inertia"):
        model = started()
        before = {v.name: np.array(model.get(v.name)) for v in settable}
        value = np.array(before[variable.name] * 1.01 + (0.01 if variable.lower_bound is None else 0.0))
        model.set(variable.name, value)
        last = variable.scalar_names[-1]
        value[(-1,) * value.ndim] *= 1.01
        model.set(last, float(np.ravel(value)[-1]))
        for other in settable:
            expected = value if other is variable else before[other.name]
            assert np.array_equal(model.get(other.name), expected), (variable.name, other.name)
        model.reset()
        assert model.save_state() == SteppingModel(UNEVEN).save_state()
    model.set("external_force", [1e200, 0.0, 0.0])  # whose square is not finite
    assert model.get("external_force[1]") == 1e200
    refused(model, lambda: model.set_inputs(np.append(INPUTS[:11], np.inf)), r"external_torque.*inf")
    refused(model, lambda: model.set_inputs(INPUTS[:11]), r"^inputs: have the shape \(11,\); expected \(12,\)$")
    texts: Any = ["1"] * 12
    refused(model, lambda: model.set_inputs(texts), "actuator_force: is .*expected numbers")


def test_states_and_fixed_parameters_are_set_before_the_first_step_only() -> None:
    model = started()
    model.set("leg_lower_mass", 2.5)
    model.do_step(0.0, 0.01)
    late = "which can only be set before the first step; call reset() first"
    for name, value, text in (
        ("position", [0, 0, 3], f"position: is a state, {late}"),
        ("velocity[3]", 1.0, f"velocity: is a state, {late}"),
        ("leg_lower_mass", 2.0, f"leg_lower_mass: is a fixed parameter, {late}"),
    ):
        refused(model, lambda n=name, v=value: model.set(n, v), f"^{re.escape(text)}$")
    size = model.save_state().internal_step  # carries over
    model.set("platform_mass", 12.0)
    assert (model.platform.platform_mass, model.save_state().internal_step) == (12.0, size)


def test_several_variables_are_set_together_or_none() -> None:
    """Expected: one by one each element of an inertia would be asymmetric, which no inertia is."""
    model = started()
    refused(model, lambda: model.set_many({"external_force": [1, 2, 3], "gravity": [0, 0]}), "gravity")
    refused(model, lambda: model.set("platform_inertia[1,2]", 0.5), "not symmetric")
    model.set_many({"platform_inertia[1,2]": 0.5, "platform_inertia[2,1]": 0.5})
    assert model.platform.platform_inertia[0, 1] == model.platform.platform_inertia[1, 0] == 0.5


@by_both
def test_results_are_those_of_independent_equations_under_the_present_inputs(integrator: Integrator) -> None:
    """Expected: a Lagrangian's linear acceleration; Newton and Euler of the platform alone, pushed by its joints."""
    model = started(integrator=integrator)
    found, vector = model.results(), model.result_vector()
    turn = Rotation.from_euler("xyz", STATE.orientation)
    R, omega, (force, torque) = turn.as_matrix(), STATE.angular_velocity, (INPUTS[6:9], INPUTS[9:])
    rates = np.asarray(np.linalg.solve(twist_of_rates(model.state[:6]), model.state[6:]), dtype=np.float64)
    expected = accelerations(UNEVEN, model.state[:6], rates, INPUTS[:6], INPUTS[6:])
    assert found["acceleration"] == pytest.approx(expected[:3], rel=1e-9)
    arm, com, J = UNEVEN.platform_points @ R.T, R @ UNEVEN.platform_com, R @ UNEVEN.platform_inertia @ R.T
    alpha = found["angular_acceleration"]
    of_com = found["acceleration"] + np.cross(alpha, com) + np.cross(omega, np.cross(omega, com))
    weight = 11.5 * (of_com - UNEVEN.gravity)
    assert found["joint_force"].sum(axis=0) + force == pytest.approx(weight, rel=1e-9)
    moment = np.cross(arm, found["joint_force"]).sum(axis=0) + torque
    assert moment == pytest.approx(np.cross(com, weight) + J @ alpha + np.cross(omega, J @ omega), rel=1e-8)
    lengths = np.linalg.norm(STATE.position + arm - UNEVEN.base_points, axis=1)
    assert found["leg_length"] == pytest.approx(lengths, rel=1e-12)
    assert np.concatenate([np.ravel(value) for value in found.values()]).tolist() == vector.tolist()
    assert [model.get(name) for name in model.variant.columns] == vector.tolist()
    change = np.array([20.0, -30.0, 100.0])
    model.set("external_force", force + change)
    names = ("acceleration", "angular_acceleration")
    moved = np.concatenate([np.asarray(model.get(name)) - found[name] for name in names])
    M = mass_matrix(UNEVEN, STATE.position, STATE.orientation)
    assert M @ moved == pytest.approx(np.concatenate([change, np.zeros(3)]), abs=1e-10)


# --- rules 5 and 6: time and integration ---------------------------------------------------------------------------


@of_both
def test_the_error_is_of_the_order_of_the_tolerance(name: str, integrator: Integrator) -> None:
    """Expected: SciPy at 1e-12, or at 1e-13 for itself; legs break loose and reverse, and springs swing."""
    judge = moving(name, 1e-12 if integrator == "compiled" else 1e-13, integrator="scipy")
    exact = stepped(judge, 12)
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10) if integrator == "compiled" else (1e-6, 1e-8):
        gap = np.abs(stepped(moving(name, tolerance, integrator=integrator), 12) - exact)
        assert gap[:6].max() < 0.5 * tolerance
        assert gap[6:12].max() < 60 * tolerance
        # a bristle's own scale is a hundredth of that of other states
        of_bristles = 0.04 if integrator == "compiled" else 1
        assert gap[12:18].max(initial=0.0) < (of_bristles if judge.variant.bristles else 60) * tolerance


@by_both
def test_the_motion_is_that_of_a_lagrangian_however_time_is_cut(integrator: Integrator) -> None:
    """Expected: the tests' Lagrangian under DOP853 at 1e-12, within the tolerance; inputs are held."""
    exact = trajectory(UNEVEN, np.concatenate(STATE), lambda _t: INPUTS, np.array([0.0, 0.6]), 1e-12)[-1]
    for steps in ((0.6,), (0.14, 0.001, 0.259, 0.2), (0.1,) * 6):
        for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
            model = started(tolerance, integrator)
            for step in steps:
                model.do_step(model.time, step)
            assert np.abs(model.state - exact).max() < 10 * tolerance


@pytest.mark.parametrize("name", ["ideal", "elastic"])
def test_fixed_steps_have_order_4(name: str) -> None:
    """Expected: errors against SciPy at 1e-12 fall by 2⁴ from step to half of it."""
    exact = stepped(moving(name, 1e-12, integrator="scipy"), 20)
    steps = (2.5e-4, 1.25e-4, 6.25e-5) if name == "elastic" else (1e-3, 5e-4, 2.5e-4)
    errors = [np.abs(stepped(moving(name, fixed_step_size=h), 20) - exact)[:12].max() for h in steps]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.8


TIMES: list[tuple[Any, Any, str]] = [
    (0.5, 0.0, "step = 0 .*expected a communication step > 0"),
    (0.5, -0.1, "expected a communication step > 0"),
    (0.6, 0.1, "expected the model's current time"),
    (0.5, 1e-18, "too small to advance the time"),
    *((0.5, value, "step: is|step: has") for value in (np.nan, np.inf, "1", None, True, 1j, [1])),
    *((value, 0.1, "time: is|time: has") for value in (np.nan, np.inf, "1", None, True, 10**400)),
]


@pytest.mark.parametrize(("time", "step", "message"), TIMES, ids=lambda value: str(value)[:12])
def test_wrong_times_are_refused(time: Any, step: Any, message: str) -> None:
    model = started()
    model.do_step(0, np.float32(0.5))  # type: ignore[arg-type]
    assert type(model.time) is float
    refused(model, lambda: model.do_step(time, step), message)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("now", "step", "inside", "outside"), CLOCKS)
def test_a_clock_may_round_a_little(now: float, step: float, inside: float, outside: float, side: int) -> None:
    # the judge, since the compiled integrator also looks at the clock itself
    model = SteppingModel(replace(UNEVEN, gravity=np.zeros(3)), integrator="scipy")
    model.do_step(0.0, now)
    refused(model, lambda: model.do_step(now + side * outside, step), "current time")
    model.do_step(now + side * inside, step)


ARGUMENTS: list[tuple[dict[str, Any], str]] = [
    *(({"tolerance": value}, "^tolerance: is") for value in (0.0, 0.9e-13, 1.1e-2, np.nan, None, "1e-8", True)),
    ({"tolerance": 1e-14}, "^tolerance: is 1e-14; expected 1e-13 to 0.01, for example 1e-08$"),
    ({"fixed_step_size": -1}, "fixed_step_size: is -1 s; expected 0 for error control, or > 0"),
    ({"fixed_step_size": 1e-3, "integrator": "scipy"}, "fixed_step_size: is 0.001 s, but the integrator 'scipy' contr"),
    ({"integrator": "rk4"}, "^integrator: is 'rk4'; expected 'compiled' or 'scipy'$"),
    ({"platform": "liu2000"}, "expected a Platform, such as load_preset"),
]


@pytest.mark.parametrize(("arguments", "message"), ARGUMENTS)
def test_arguments_that_make_no_sense_are_refused(arguments: dict[str, Any], message: str) -> None:
    for tolerance in (1e-13, 1e-2):
        SteppingModel(UNEVEN, tolerance)
    with pytest.raises(GoughStewartError, match=message):
        SteppingModel(**{"platform": UNEVEN, **arguments})


# --- rules 7 and 8: failures ---------------------------------------------------------------------------------------

CONDITION, STEP_SIZE = "condition number of the leg Jacobian", "internal step size"
# Start, forces, step, and what fails: quantity, words.
FAILURES: dict[str, tuple[dict[str, Any], list[float], float, str, str]] = {
    "legs pulled into the base plane": ({}, [-100.0] * 6, 10.0, CONDITION, "singular pose"),
    "yaw through a singular pose": ({"angular_velocity": [0, 0, 3.0]}, [0.0] * 6, 1.0, CONDITION, "singular pose"),
    "pitch of 90°": (
        {"orientation": [0, 1.56, 0], "angular_velocity": [0, 1.0, 0]}, [0.0] * 6, 0.1, "orientation[2]", "the pitch"
    ),
    "P_1 on B_1": (
        {"position": PAPER.base_points[0] - PAPER.platform_points[0]}, [0.0] * 6, 0.1, "leg_length[1]", "the leg has"
    ),
    "forces beyond double precision": ({}, [1e300] * 6, 1e-3, STEP_SIZE, "the tolerance 1e-08 cannot be met"),
    "accelerations that almost overflow": ({}, [-1e307] * 6, 1e-3, STEP_SIZE, "cannot be met"),
}  # fmt: skip


@by_both
@pytest.mark.parametrize("case", FAILURES)
def test_a_step_that_fails_says_what_and_leaves_the_model(case: str, integrator: Integrator) -> None:
    """Expected: quantity, value and time, in words and as data; the model is still good for something."""
    start, pull, span, quantity, words = FAILURES[case]
    model = SteppingModel(PAPER, integrator=integrator)
    model.set_many({**start, "actuator_force": pull})
    error = refused(model, lambda: model.do_step(0.0, span), words)
    assert error.quantity == quantity
    assert 0 <= error.time <= span
    assert str(error).startswith(f"{quantity} = {error.value:.6g} at time {error.time:.9g} s: ")
    if quantity == "orientation[2]":
        assert error.value == pytest.approx(np.pi / 2, abs=0.01)
    model.reset()
    if quantity in (CONDITION, "orientation[2]"):  # the motion is fine until then
        model.set_many({**start, "actuator_force": pull})
        assert error.time > 5e-3
        model.do_step(0.0, 0.5 * error.time)
    else:
        model.do_step(0.0, 1e-4)


@by_both
def test_poses_are_refused_from_their_limits_on(integrator: Integrator) -> None:
    """Expected: 1e-3 rad below 90° of pitch of either sign, a thousandth of ρ, NumPy's condition number of 1e8."""
    model = SteppingModel(UNEVEN, integrator=integrator)
    rho, home = np.sqrt((UNEVEN.platform_points**2).sum() / 6), UNEVEN.home_position

    def error_at(position: Any, orientation: Any) -> StepError | None:
        """Of a step of 1 ns from rest in this pose."""
        pose = (*position, *orientation, *[0.0] * 6)
        model.restore_state(replace(model.save_state(), time=7.3, x=pose, started=True))
        try:
            model.do_step(7.3, 1e-9)
        except StepError as error:
            return error
        return None

    far = np.pi / 2 - 1e-3
    for sign in (1, -1):
        assert error_at(home, [1.2, sign * (far - 1e-9), -1.9]) is None
        error = error_at(home, [0.1, sign * (far + 1e-9), 0.2])
        assert error is not None
        assert (error.quantity, error.value, error.time) == ("orientation[2]", sign * (far + 1e-9), 7.3)
    for leg, joint in enumerate(UNEVEN.base_points - UNEVEN.platform_points):
        assert error_at(joint + 1.1e-3 * rho * np.array([0.6, 0.0, 0.8]), np.zeros(3)) is None
        error = error_at(joint + 0.9e-3 * rho * np.array([0.6, 0.0, 0.8]), np.zeros(3))
        assert error is not None
        assert error.quantity == f"leg_length[{leg + 1}]"
        assert error.value == pytest.approx(0.9e-3 * rho, rel=1e-6)

    def scaled(yaw: float) -> Any:
        return leg_jacobian(UNEVEN, home, np.array([0.0, 0.0, yaw])) / np.repeat([1.0, rho], 3)

    singular, seen = brentq(lambda yaw: np.linalg.det(scaled(yaw)), 1.0, 2.5, xtol=1e-15), set()
    for away in np.geomspace(1e-9, 1e-6, 12):
        for yaw in (singular - away, singular + away):
            number, frobenius = (float(np.linalg.cond(scaled(yaw), norm)) for norm in (2, "fro"))
            if number > 1.05e8 or frobenius < 0.95e8:
                assert (error_at(home, [0.0, 0.0, yaw]) is not None) == (number > 1e8)
                seen.add(number > 1e8)
    assert seen == {True, False}


@pytest.mark.parametrize(
    ("name", "options", "span", "quantity", "words"),
    [
        ("ideal", {"fixed_step_size": 1e-9}, 0.1, "fixed_step_size", "too small for one step to time 0.1 s; expected"),
        ("elastic", {"tolerance": 1e-13}, 20.0, "internal steps", "too many internal steps for one step to time 20 s"),
        ("elastic", {"fixed_step_size": 0.01}, 0.02, "fixed_step_size", "steps of 0.01 s are too large for legs with"),
    ],
)
def test_steps_without_end_or_too_large_fail(
    name: str, options: dict[str, Any], span: float, quantity: str, words: str
) -> None:
    """Expected: the limits of the docstring; the same motion passes in shorter steps."""
    model = moving(name, **options)
    error = refused(model, lambda: model.do_step(0.0, span), words)
    assert error.quantity == quantity
    model.do_step(0.0, 1e-4 if "fixed_step_size" not in options else 1e-5)


def test_fixed_steps_go_up_to_the_largest_that_resolves_the_modes_of_legs() -> None:
    """Expected: h |λ| = 2.6 for the motors on their springs, √(k/m_a + …) above √(k/m_a); what is larger is refused."""
    platform = real_platform("elasto_plastic", True, leg_armature=0.5)
    model = SteppingModel(platform, fixed_step_size=1e-3)
    error = refused(model, lambda: model.do_step(0.0, 2e-3), "^fixed_step_size = 0.001 at time 0 s: steps of")
    largest = float(str(error).split("at most ")[1].split()[0])
    fast = np.sqrt((platform.leg_stiffness + platform.leg_bristle_stiffness) / platform.leg_armature)
    assert 0.7 * 2.6 / fast < largest < 2.6 / fast
    # that of legs that stand, also for legs that slide, whose bristles forget within 10 µs
    sliding = SteppingModel(platform, fixed_step_size=1e-3)
    sliding.set_many({**MOTION, "leg_bristle": np.full(6, 5e-6)})
    also = refused(sliding, lambda: sliding.do_step(0.0, 2e-3), "are too large")
    assert float(str(also).split("at most ")[1].split()[0]) == pytest.approx(largest, rel=1e-3)
    model = SteppingModel(platform, fixed_step_size=0.99 * largest)
    model.do_step(0.0, 2e-3)
    assert model.time == 2e-3


@by_both
def test_a_start_with_a_leg_too_short_for_its_parts_fails_the_first_step_only(integrator: Integrator) -> None:
    """Expected: the shortest leg of the start, by NumPy; in the same pose of a running model, no such check."""
    low = UNEVEN.home_position - [0.0, 0.0, 0.9]
    shortest = np.linalg.norm(low + UNEVEN.platform_points - UNEVEN.base_points, axis=1).min()
    model = SteppingModel(replace(UNEVEN, leg_upper_com=2.6), integrator=integrator)
    model.set_many({"position": low, "orientation": np.zeros(3)})
    text = (
        f"is 2.6 m from the platform joint; expected between 0 and the shortest leg of the start pose, {shortest:g} m"
    )
    refused(model, lambda: model.do_step(0.0, 1e-3), re.escape(text))
    model.reset()
    model.do_step(0.0, 1e-3)
    model.restore_state(replace(model.save_state(), x=(*low.tolist(), *[0.0] * 9)))
    model.do_step(1e-3, 1e-3)


@by_both
def test_the_side_of_singular_poses_is_forgotten_with_what_is_set_or_restored(integrator: Integrator) -> None:
    """Expected: a state on the other side, by NumPy's determinant, is a new start; one beyond a limit fails there."""
    other = np.array([0.0, 0.0, 2.8])
    sides = (np.linalg.det(leg_jacobian(UNEVEN, UNEVEN.home_position, o)) for o in (UNEVEN.home_orientation, other))
    assert np.prod([*sides]) < 0
    model = SteppingModel(replace(UNEVEN, gravity=np.zeros(3)), integrator=integrator)
    model.set("actuator_force", np.zeros(6))
    before = model.save_state()
    model.do_step(0.0, 1e-3)
    model.restore_state(replace(before, x=(*UNEVEN.home_position.tolist(), *other.tolist(), *[0.0] * 6)))
    model.do_step(0.0, 1e-3)
    model.set("platform_mass", 12.0)
    model.do_step(1e-3, 1e-3)
    joint = UNEVEN.base_points[3] - UNEVEN.platform_points[3] + np.array([0.0, 0.0, 2e-4])
    model.restore_state(replace(before, time=7.3, x=(*joint.tolist(), *[0.0] * 9), started=True))
    error = refused(model, lambda: model.do_step(7.3, 1e-3), r"^leg_length\[4\] = 0.0002 at time 7.3 s")
    assert error.time == 7.3
    model.restore_state(replace(before, time=7.3))
    model.do_step(7.3, 1e-3)
    assert model.time == 7.3 + 1e-3


# --- rule 9: saved states, copies ----------------------------------------------------------------------------------


def test_a_copy_takes_the_fixed_steps_that_its_model_takes() -> None:
    """Expected: what was stable in the first step stays so, also in poses whose own limit is below it."""
    step = 0.000673707  # 0.1 % below the largest at home, above that of poses further down
    platform = replace(gs.load_preset("motion_base"), leg_stiffness=1e8, leg_armature=20.0)
    model = SteppingModel(platform, 1e-8, step)
    model.set("velocity[3]", -1.0)
    for _ in range(200):
        model.do_step(model.time, step)
    other = SteppingModel(model.platform, 1e-8, step)
    other.set_many({"position": model.get("position"), "velocity": [0, 0, -1.0]})
    refused(other, lambda: other.do_step(0.0, step), "steps of 0.000673707 s are too large")
    for twin in (deepcopy(model), model):
        twin.do_step(twin.time, step)


def test_a_snapshot_of_another_kind_of_platform_is_refused() -> None:
    model, other = SteppingModel(PLATFORMS["both"]), SteppingModel(UNEVEN)
    with pytest.raises(GoughStewartError, match="is of a platform with smooth friction and rigid legs; expected one"):
        model.restore_state(other.save_state())
    assert model.save_state() == SteppingModel(PLATFORMS["both"]).save_state()


# --- rules 10 and 11, and what is beneath --------------------------------------------------------------------------


def test_motors_start_where_they_hold_the_pose_and_follow_what_is_set() -> None:
    """Expected: leg length plus force over stiffness, and the rates of the legs."""
    platform = PLATFORMS["both"]
    model = SteppingModel(platform)
    stretch = platform.home_actuator_force / platform.leg_stiffness
    assert model.get("motor_position") == pytest.approx(np.asarray(model.get("leg_length")) + stretch, rel=1e-14)
    assert model.get("leg_force") == pytest.approx(platform.home_actuator_force, rel=1e-7)
    heavy = SteppingModel(platform)
    heavy.set("platform_mass", 1.5 * platform.platform_mass)  # moves them, too: they bear more
    stretch = replace(platform, platform_mass=1.5 * platform.platform_mass).home_actuator_force / platform.leg_stiffness
    assert heavy.get("motor_position") == pytest.approx(np.asarray(heavy.get("leg_length")) + stretch, rel=1e-14)
    aside = platform.home_position + np.array([0.02, 0.01, -0.03])
    state = State(aside, platform.home_orientation, np.array([0.1, 0, 0.2]), np.zeros(3))
    model.set_many(state._asdict())
    for factor in (1.02, 0.98):
        away = SteppingModel(platform)
        length = float(np.asarray(away.get("leg_length"))[3])
        away.set("motor_position[4]", factor * length)
        found = rf"motor_position\[4\]: is {factor * length:g} m, but leg_length\[4\] {length:g} m at the start"
        refused(away, partial(away.do_step, 0.0, 1e-3), f"^{found}; expected a stretch of at most 1 %")
    legs, J = leg_geometry(platform, *state[:2]).length, leg_jacobian(platform, *state[:2])
    assert np.abs(np.asarray(model.get("motor_position")) - legs).max() < 1e-3
    assert model.get("motor_velocity") == pytest.approx(J @ np.concatenate(state[2:]), rel=1e-12)
    # set in the same call, they stay
    model.set_many({"position": platform.home_position, "motor_position": legs})
    assert model.get("motor_position") == pytest.approx(legs, rel=1e-15)


@pytest.mark.parametrize(("friction", "fixed"), [*product(("elasto_plastic", "lugre"), (0.0, 1e-3))])
def test_lugre_creeps_below_breakaway_and_elasto_plastic_does_not(friction: str, fixed: float) -> None:
    """40 N ± 20 N on each leg more than its weight, 100 N of friction. Expected: stands within 1 nm; creeps further."""
    platform = gs.load_preset("motion_base").with_parameters(
        {"leg_friction_model": friction, "leg_coulomb_friction": 100.0}
    )
    model = SteppingModel(platform, fixed_step_size=fixed)
    # bristles that are not exactly alike: standing must not be a balance on a needle's point
    model.set("leg_bristle", 1e-17 * np.arange(6))
    heights = []
    for k in range(600):
        model.set("actuator_force", platform.home_actuator_force + 40.0 + 20.0 * np.sin(np.pi * k / 50))
        model.do_step(model.time, 1e-3)
        if k % 100 == 99:
            heights.append(model.state[2] - platform.home_position[2])
    # 40 N over 1e7 N/m and the legs' slope
    assert 3e-6 < heights[0] < 2e-5
    drift = heights[-1] - heights[-2]
    assert drift > 1e-8 if friction == "lugre" else abs(drift) < 1e-9

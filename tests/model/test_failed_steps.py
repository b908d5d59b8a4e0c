"""Rule 7 of the stepping model: which steps fail, and what their errors say."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from gough_stewart.model.errors import StepError
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.pose_limits import check_pose
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.vectors import FloatArray
from tests.model.test_stepping import refused, started
from tests.support.uneven import STATE, UNEVEN

PAPER = load_preset("liu2000")


def fails(start: dict[str, Any], forces: Any, quantity: str, message: str, span: float = 5.0) -> None:
    """A step of this length fails by this quantity, at a time within it, and nothing changes (rules 7, 8)."""
    model = SteppingModel(PAPER)
    model.set_many({**start, "actuator_force": forces})
    model.set("gravity", [0, 0, 0])
    error = refused(model, lambda: model.do_step(0.0, span), StepError, message)
    assert isinstance(error, StepError)
    assert error.quantity == quantity
    assert 0 <= error.time <= span
    assert quantity in str(error)
    # and the model is still good for something
    model.set("actuator_force", np.zeros(6))
    model.do_step(0.0, 1e-4)


def test_rule_7_a_singular_pose_fails_the_step() -> None:
    """Legs pulled together lower the platform into the base plane, where they cannot hold it."""
    fails({}, [-100.0] * 6, "condition number of the leg Jacobian", "singular pose")


def test_rule_7_a_yaw_through_the_singular_pose_fails_the_step() -> None:
    fails({"angular_velocity": [0, 0, 3.0]}, [0.0] * 6, "condition number of the leg Jacobian", "singular pose", 1.0)


def test_rule_7_pitch_of_90_degrees_fails_the_step() -> None:
    start = {"orientation": [0, 1.56, 0], "angular_velocity": [0, 1.0, 0]}
    fails(start, [0.0] * 6, "orientation[2]", "the pitch has reached ±90°", 0.1)


def test_rule_7_a_collapsed_leg_fails_the_step() -> None:
    """The pose with P_1 on B_1 is the end of leg 1."""
    model = SteppingModel(PAPER)
    model.set("position", PAPER.base_points[0] - PAPER.platform_points[0])
    refused(model, lambda: model.do_step(0.0, 0.1), StepError, r"leg_length\[1\] = .* at time 0 s: the leg has")


def test_rule_7_a_tolerance_that_cannot_be_held_fails_the_step() -> None:
    """Forces beyond what double precision can integrate."""
    fails({}, [1e300] * 6, "internal step size", "cannot be met", 1e-3)


@pytest.mark.parametrize("force", [1e306, -1e307, 1e308, 1.7e308])
def test_rule_7_forces_whose_accelerations_overflow_fail_the_step(force: float) -> None:
    """Expected: an error at once, where SciPy's choice of a first step is not a number."""
    fails({}, [force] * 6, "internal step size", "cannot be met", 1e-3)


def test_rule_7_a_step_without_end_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the limit, made small here; the same motion passes in shorter steps."""
    monkeypatch.setattr("gough_stewart.model.integrator.MOST_INTERNAL_STEPS", 3)
    model = started()
    refused(model, lambda: model.do_step(0.0, 0.8), StepError, "internal steps = 4 .*too many for one step")
    model.do_step(0.0, 0.01)


def test_check_pose_tells_the_sides_of_a_singular_pose_apart(paper: Platform) -> None:
    upright = np.concatenate([paper.home_position, np.zeros(9)])
    turned = np.concatenate([paper.home_position, [0, 0, 2.0], np.zeros(6)])
    assert check_pose(paper, upright, 0.0) == -check_pose(paper, turned, 0.0)
    with pytest.raises(StepError, match="passed since the last internal step"):
        check_pose(paper, turned, 1.0, handedness=check_pose(paper, upright, 0.0))


def state_at(position: Any, orientation: Any) -> FloatArray:
    """A state whose velocities would be impossible poses."""
    return np.concatenate([position, orientation, [9.0, 9.0, 9.0], [9.0, 9.0, 9.0]])


def stopped(
    x: FloatArray, handedness: float | None = None, platform: Platform = UNEVEN
) -> tuple[str, float, float, str]:
    """Quantity, value, time and words of the error of a pose at 7.3 s."""
    with pytest.raises(StepError) as caught:
        check_pose(platform, x, 7.3, handedness)
    error = caught.value
    return error.quantity, error.value, error.time, str(error).partition(": ")[2]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_pitch_is_refused_from_a_milliradian_below_90_degrees_on(sign: int) -> None:
    """Expected: both signs, both sides of the limit; only the pitch counts."""
    far = np.pi / 2 - 1e-3
    check_pose(UNEVEN, state_at(UNEVEN.home_position, [1.2, sign * (far - 1e-9), -1.9]), 7.3)
    pitch = sign * (far + 1e-9)
    found = stopped(state_at(UNEVEN.home_position, [0.1, pitch, 0.2]))
    assert found == ("orientation[2]", pitch, 7.3, "the pitch has reached ±90°")
    assert stopped(state_at(UNEVEN.home_position, [0.1, np.nan, 0.2]))[0] == "orientation[2]"


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("k", "name"), [(0, "position[1]"), (7, "velocity[2]"), (11, "angular_velocity[3]"), (14, "state[15]")]
)
def test_a_state_that_is_not_finite_is_refused_by_its_name(k: int, name: str, value: float) -> None:
    """Expected: also a velocity or a bristle alone, whose pose is fine."""
    x = np.concatenate([state_at(UNEVEN.home_position, np.zeros(3)), np.zeros(6)])
    x[k] = value
    quantity, found, time, text = stopped(x)
    assert (quantity, time, text) == (name, 7.3, "the motion is not finite")
    assert str(found) == str(value)


@pytest.mark.parametrize("leg", range(6))
def test_a_leg_has_collapsed_below_a_thousandth_of_the_platform(leg: int) -> None:
    """Expected: that leg by its number, its length; the limit from both sides, ρ by the joints' squares."""
    rho = float(np.sqrt((UNEVEN.platform_points**2).sum() / 6))
    joint = UNEVEN.base_points[leg] - UNEVEN.platform_points[leg]
    for share, is_refused in ((0.9e-3, True), (1.1e-3, False)):
        x = state_at(joint + share * rho * np.array([0.6, 0.0, 0.8]), np.zeros(3))
        if is_refused:
            quantity, value, time, text = stopped(x)
            assert (quantity, time, text) == (f"leg_length[{leg + 1}]", 7.3, "the leg has collapsed")
            assert value == pytest.approx(share * rho, rel=1e-6)
        else:
            check_pose(UNEVEN, x, 7.3)


def test_a_pose_is_singular_from_a_condition_number_of_1e8_on_or_on_the_other_side() -> None:
    """Expected: NumPy's condition number with angles scaled; the sign of NumPy's determinant."""
    rho = float(np.sqrt((UNEVEN.platform_points**2).sum() / 6))

    def scaled(yaw: float) -> FloatArray:
        J = leg_jacobian(UNEVEN, UNEVEN.home_position, np.array([0.0, 0.0, yaw]))
        return np.asarray(J / np.array([1, 1, 1, rho, rho, rho]))

    singular = brentq(lambda yaw: np.linalg.det(scaled(yaw)), 1.0, 2.5, xtol=1e-15)
    seen = {True: 0, False: 0}
    for yaw in singular + np.concatenate([-np.geomspace(1e-9, 1e-6, 12), np.geomspace(1e-9, 1e-6, 12)]):
        number, side = float(np.linalg.cond(scaled(yaw))), float(np.sign(np.linalg.det(scaled(yaw))))
        if abs(np.log(number / 1e8)) < 0.05:
            continue
        x = state_at(UNEVEN.home_position, [0.0, 0.0, yaw])
        seen[number > 1e8] += 1
        reached = "the platform has reached a singular pose{}; the legs cannot hold it there"
        quantity = "condition number of the leg Jacobian"
        if number > 1e8:
            found = stopped(x)
            assert (found[0], found[2:]) == (quantity, (7.3, reached.format("")))
            assert found[1] == pytest.approx(number, rel=1e-3)
        else:
            assert check_pose(UNEVEN, x, 7.3) == check_pose(UNEVEN, x, 7.3, side) == side
        found = stopped(x, -side)
        assert found[2:] == (7.3, reached.format(" (passed since the last internal step)"))
        assert found[1] == pytest.approx(number, rel=1e-3)
    assert min(seen.values()) > 3


def test_a_start_with_a_leg_too_short_for_its_parts_fails_the_first_step_only() -> None:
    """Expected: the shortest leg of the start, by NumPy; in the same pose of a running model, no such check."""
    long = replace(UNEVEN, leg_upper_com=2.6)
    low = UNEVEN.home_position - [0.0, 0.0, 0.9]
    shortest = np.linalg.norm(low + UNEVEN.platform_points - UNEVEN.base_points, axis=1).min()
    model = SteppingModel(long)
    model.set_many({"position": low, "orientation": np.zeros(3)})
    text = (
        "leg_upper_com: is 2.6 m from the platform joint; expected between 0 and the shortest leg of the start pose, "
        f"{shortest:g} m"
    )
    refused(model, lambda: model.do_step(0.0, 1e-3), ValueError, re.escape(text))
    running = SteppingModel(long)
    running.do_step(0.0, 1e-3)
    snapshot = running.save_state()
    running.restore_state(replace(snapshot, x=(*low.tolist(), *[0.0] * 9)))
    running.do_step(1e-3, 1e-3)


def test_the_side_of_singular_poses_is_remembered_and_forgotten_with_what_is_set() -> None:
    """Expected: a state on the other side is a new start; a platform with mirrored joints has the other side."""
    other = np.array([0.0, 0.0, 2.8])
    model = SteppingModel(replace(UNEVEN, gravity=np.zeros(3)))
    sides = [
        np.sign(np.linalg.det(leg_jacobian(UNEVEN, UNEVEN.home_position, o))) for o in (UNEVEN.home_orientation, other)
    ]
    assert sides[0] == -sides[1]
    model.set("actuator_force", np.zeros(6))
    before = model.save_state()
    model.do_step(0.0, 1e-3)
    model.restore_state(replace(before, x=(*UNEVEN.home_position.tolist(), *other.tolist(), *[0.0] * 6)))
    model.do_step(0.0, 1e-3)
    model.set("platform_mass", 12.0)
    model.do_step(1e-3, 1e-3)
    model.reset()
    model.set_many({"actuator_force": np.zeros(6), "position": STATE.position})
    model.do_step(0.0, 1e-3)
    assert model.time == 1e-3


def test_a_pose_that_is_restored_beyond_a_limit_fails_at_its_own_time() -> None:
    """Expected: 7.3 s and the leg's length there; the same model goes on from a pose within the limits."""
    model = SteppingModel(UNEVEN)
    model.do_step(0.0, 1e-3)
    snapshot = replace(model.save_state(), time=7.3)
    joint = UNEVEN.base_points[3] - UNEVEN.platform_points[3] + np.array([0.0, 0.0, 2e-4])
    model.restore_state(replace(snapshot, x=(*joint.tolist(), *[0.0] * 9)))
    error = refused(model, lambda: model.do_step(7.3, 1e-3), StepError, r"^leg_length\[4\] = 0.0002 at time 7.3 s")
    assert isinstance(error, StepError)
    assert error.time == 7.3
    model.restore_state(snapshot)
    model.do_step(7.3, 1e-3)
    assert model.time == 7.3 + 1e-3

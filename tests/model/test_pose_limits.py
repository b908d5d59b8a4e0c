"""Limits of the pose, as Python checks them: quantity, value, time and words; the unit's have tests of their own."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from gough_stewart import StepError, leg_jacobian
from gough_stewart.model.pose_limits import check_pose
from tests.support.lagrangian import FloatArray
from tests.support.uneven import UNEVEN

HOME, RHO = UNEVEN.home_position, float(np.sqrt((UNEVEN.platform_points**2).sum() / 6))
CONDITION = "condition number of the leg Jacobian"


def state_at(position: Any, orientation: Any) -> FloatArray:
    """A state whose velocities would be impossible poses."""
    return np.concatenate([position, orientation, np.full(6, 9.0)])


def stopped(x: FloatArray, handedness: float | None = None) -> tuple[str, float, str]:
    """Quantity, value and words of the error of a pose at 7.3 s."""
    with pytest.raises(StepError) as caught:
        check_pose(UNEVEN, x, 7.3, handedness)
    assert caught.value.time == 7.3
    return caught.value.quantity, caught.value.value, str(caught.value).partition(": ")[2]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_pitch_is_refused_from_a_milliradian_below_90_degrees_on(sign: int) -> None:
    """Expected: both signs, both sides of the limit; only the pitch counts."""
    far = np.pi / 2 - 1e-3
    check_pose(UNEVEN, state_at(HOME, [1.2, sign * (far - 1e-9), -1.9]), 7.3)
    pitch = sign * (far + 1e-9)
    assert stopped(state_at(HOME, [0.1, pitch, 0.2])) == ("orientation[2]", pitch, "the pitch has reached ±90°")


@pytest.mark.parametrize("value", [np.nan, -np.inf])
@pytest.mark.parametrize(
    ("k", "name"), [(0, "position[1]"), (4, "orientation[2]"), (11, "angular_velocity[3]"), (14, "state[15]")]
)
def test_a_state_that_is_not_finite_is_refused_by_its_name(k: int, name: str, value: float) -> None:
    """Expected: also a velocity or a bristle alone, whose pose is fine."""
    x = np.concatenate([state_at(HOME, np.zeros(3)), np.zeros(6)])
    x[k] = value
    quantity, found, text = stopped(x)
    assert (quantity, str(found), text) == (name, str(value), "the motion is not finite")


@pytest.mark.parametrize("leg", range(6))
def test_a_leg_has_collapsed_below_a_thousandth_of_the_platform(leg: int) -> None:
    """Expected: that leg by its number, its length; the limit from both sides, ρ by the joints' squares."""
    joint, away = UNEVEN.base_points[leg] - UNEVEN.platform_points[leg], RHO * np.array([0.6, 0.0, 0.8])
    check_pose(UNEVEN, state_at(joint + 1.1e-3 * away, np.zeros(3)), 7.3)
    quantity, value, text = stopped(state_at(joint + 0.9e-3 * away, np.zeros(3)))
    assert (quantity, text) == (f"leg_length[{leg + 1}]", "the leg has collapsed")
    assert value == pytest.approx(0.9e-3 * RHO, rel=1e-6)


def test_a_pose_is_singular_from_a_condition_number_of_1e8_on_or_on_the_other_side() -> None:
    """Expected: NumPy's condition number with angles scaled; the sign of NumPy's determinant."""

    def scaled(yaw: float) -> FloatArray:
        J = leg_jacobian(UNEVEN, HOME, np.array([0.0, 0.0, yaw]))
        return np.asarray(J / np.array([1, 1, 1, RHO, RHO, RHO]))

    singular, seen = brentq(lambda yaw: np.linalg.det(scaled(yaw)), 1.0, 2.5, xtol=1e-15), {True: 0, False: 0}
    away = np.geomspace(1e-9, 1e-6, 12)
    for yaw in singular + np.concatenate([-away, away]):
        number, side = float(np.linalg.cond(scaled(yaw))), float(np.sign(np.linalg.det(scaled(yaw))))
        if abs(np.log(number / 1e8)) < 0.05:
            continue
        x, reached = (
            state_at(HOME, [0.0, 0.0, yaw]),
            "the platform has reached a singular pose{}; the legs cannot hold it there",
        )
        seen[number > 1e8] += 1
        cases: list[tuple[float | None, str]] = [(-side, " (passed since the last internal step)")]
        if number > 1e8:
            cases.append((None, ""))
        else:
            assert check_pose(UNEVEN, x, 7.3) == check_pose(UNEVEN, x, 7.3, side) == side
        for before, since in cases:
            quantity, value, text = stopped(x, before)
            assert (quantity, text) == (CONDITION, reached.format(since))
            assert value == pytest.approx(number, rel=1e-3)
    assert min(seen.values()) > 3

"""The quick check of the pose limits, which must never pass a pose that the full one refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.pose_limits import LARGEST_PITCH, SHORTEST_LEG, check_pose, clear_of_limits
from gough_stewart.model.stepping import SteppingModel
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven import UNEVEN

_KERNEL, _P = Kernel(), parameter_vector(UNEVEN)
_RHO = math.sqrt(float((UNEVEN.platform_points**2).sum()) / 6)


def _quick(position: FloatArray, orientation: FloatArray) -> float | None:
    x = np.concatenate([position, orientation, np.full(6, 9.0)])
    return clear_of_limits(float(orientation[1]), *_KERNEL.margins(x, _P))


def _jacobian(position: FloatArray, orientation: FloatArray) -> FloatArray:
    J = leg_jacobian(UNEVEN, position, orientation)
    return np.asarray(J / np.array([1, 1, 1, _RHO, _RHO, _RHO]))


_share = st.floats(-1, 1)


@given(st.tuples(_share, _share, _share), st.tuples(_share, _share, _share), st.floats(0.01, 3))
def test_a_pose_that_is_clear_is_within_all_limits(
    place: tuple[float, ...], turn: tuple[float, ...], size: float
) -> None:
    """Expected: NumPy's condition number and determinant; the length of every leg."""
    position = UNEVEN.home_position + size * np.array(place)
    orientation = np.array([3.0, 1.6, 3.0]) * turn
    side = _quick(position, orientation)
    if side is not None:
        x = np.concatenate([position, orientation, np.zeros(6)])
        assert check_pose(UNEVEN, x, 7.3) == side == np.sign(np.linalg.det(_jacobian(position, orientation)))
        assert np.linalg.cond(_jacobian(position, orientation)) < 1e8


def test_almost_every_pose_of_a_platform_in_use_is_clear() -> None:
    """Expected: all of these have condition numbers below 1,000, by NumPy."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        position = UNEVEN.home_position + rng.uniform(-0.1, 0.1, 3)
        orientation = rng.uniform(-0.2, 0.2, 3)
        assert np.linalg.cond(_jacobian(position, orientation)) < 1e3
        assert _quick(position, orientation) is not None


def test_poses_at_a_limit_are_left_to_the_full_check() -> None:
    home = UNEVEN.home_position

    def determinant(yaw: float) -> float:
        return float(np.linalg.det(_jacobian(home, np.array([0.0, 0.0, yaw]))))

    singular = brentq(determinant, 1.0, 2.5, xtol=1e-15)
    for away in (-1e-7, -1e-12, 0.0, 1e-12, 1e-7):
        assert _quick(home, np.array([0.0, 0.0, singular + away])) is None
    sides = [_quick(home, np.array([0.0, 0.0, singular + away])) for away in (-0.1, 0.1)]
    assert None not in sides
    assert sides[0] == -sides[1]  # type: ignore[operator]
    for pitch in (LARGEST_PITCH, -LARGEST_PITCH, math.nan):
        assert _quick(home, np.array([0.0, pitch, 0.0])) is None
    # one leg, the fourth, at the shortest length
    at_joint = UNEVEN.base_points[3] - UNEVEN.platform_points[3] + np.array([0, 0, 1.5 * SHORTEST_LEG * _RHO])
    assert _quick(at_joint, np.zeros(3)) is None
    assert _quick(np.array([math.nan, 0.0, 1.0]), np.zeros(3)) is None


def test_the_margins_of_the_kernel_follow_its_parameters() -> None:
    """Expected: lengths and joints by NumPy, with joints twice as far apart after others."""
    kernel, x = Kernel(), np.concatenate([UNEVEN.home_position, np.zeros(9)])
    for scale in (1.0, 2.0):
        larger = replace(
            UNEVEN, platform_points=scale * UNEVEN.platform_points, leg_length_min=None, leg_length_max=None
        )
        square, _, size = kernel.margins(x, parameter_vector(larger))
        legs = x[:3] + larger.platform_points - larger.base_points
        assert square == pytest.approx((legs**2).sum(axis=1), rel=1e-12)
        assert size == pytest.approx((scale * _RHO) ** 2, rel=1e-12)


def test_all_inputs_are_set_as_one_vector() -> None:
    """Expected: what `get` gives of each; a value that is not finite is refused by name, and nothing changes."""
    model, inputs = SteppingModel(UNEVEN), np.arange(12.0) + 0.5
    model.set_inputs(inputs)
    assert np.array_equal(model.get("actuator_force"), inputs[:6])
    assert np.array_equal(model.get("external_force"), inputs[6:9])
    assert np.array_equal(model.get("external_torque"), inputs[9:])
    inputs[3] = math.inf
    assert model.get("actuator_force[4]") == 3.5
    with pytest.raises(InterfaceError, match=r"actuator_force.*inf"):
        model.set_inputs(inputs)
    assert model.get("actuator_force[4]") == 3.5


def test_a_step_into_a_singular_pose_still_fails() -> None:
    """The quick check passes the decision on: a fall through the base plane ends in an error of `check_pose`."""
    model = SteppingModel(UNEVEN)
    model.set_inputs(np.concatenate([np.full(6, -500.0), np.zeros(6)]))
    with pytest.raises(StepError, match=r"singular pose|collapsed|pitch"):
        model.do_step(0.0, 5.0)

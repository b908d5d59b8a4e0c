"""Paths through poses against their poses, differences of rotation matrices and straight lines."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gough_stewart import GoughStewartError, ViaPath
from gough_stewart.harness.motion.paths.path import GeometricPath, turning_of
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.arrays import FloatArray

POSITION = np.array([[0.1, -0.2, 2.9], [0.3, 0.1, 3.1], [-0.2, 0.15, 3.0], [0.05, -0.1, 2.7]])
ORIENTATION = np.array([[0.1, -0.2, 0.3], [-0.3, 0.25, -0.4], [0.2, 0.3, 0.9], [0.0, -0.1, 0.2]])


def path(degree: int = 5) -> GeometricPath:
    return GeometricPath(POSITION, ORIENTATION, 0.8, degree)


@pytest.mark.parametrize("degree", [3, 5])
def test_a_path_goes_through_its_poses(degree: int) -> None:
    through = path(degree)
    at = through(through.at)
    assert_allclose(at.position, POSITION, atol=1e-12)
    assert_allclose(at.orientation, ORIENTATION, atol=1e-12)


@pytest.mark.parametrize("degree", [3, 5])
def test_derivatives_are_those_of_positions_and_rotation_matrices(degree: int) -> None:
    through, s, h = path(degree), np.linspace(0.03, 0.97, 23), 1e-5
    before, now, after = through(s - h), through(s), through(s + h)
    assert_allclose((after.position - before.position) / (2 * h), now.tangent, atol=1e-7)
    assert_allclose((after.tangent - before.tangent) / (2 * h), now.curvature, atol=1e-5)
    # R' Rᵀ is the cross product with τ
    rates = matrix_from_orientation(after.orientation) - matrix_from_orientation(before.orientation)
    spin = rates / (2 * h) @ np.swapaxes(matrix_from_orientation(now.orientation), 1, 2)
    assert_allclose(np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1), now.turning, atol=1e-7)
    assert_allclose((after.turning - before.turning) / (2 * h), now.turning_rate, atol=1e-5)


@given(angle=st.floats(1e-9, 0.02))
def test_small_turns_have_the_derivatives_of_large_ones(angle: float) -> None:
    # about a fixed axis the turning is the rate of the angle, whatever the angle: series and closed form alike
    axis = np.array([[2.0, -3.0, 6.0]]) / 7
    turning, turning_rate = turning_of(angle * axis, 0.7 * axis, -0.4 * axis)
    assert_allclose(turning, 0.7 * axis, atol=1e-15)
    assert_allclose(turning_rate, -0.4 * axis, atol=1e-15)
    # across it, by the derivative of exp: sin θ/θ along, (1 − cos θ)/θ about the axis
    across, about = np.array([[3.0, 2.0, 0.0]]) / np.sqrt(13), np.cross(axis, [[3.0, 2.0, 0.0]]) / np.sqrt(13)
    turning, _ = turning_of(angle * axis, across, 0 * axis)
    half = np.sin(angle / 2)
    assert_allclose(turning, np.sin(angle) / angle * across + 2 * half**2 / angle * about, atol=1e-12)


@pytest.mark.parametrize(("degree", "zero"), [(3, (2,)), (5, (2, 4))])
def test_derivatives_are_zero_at_the_ends_as_documented(degree: int, zero: tuple[int, ...]) -> None:
    """Expected: a polynomial of the same degree through points near the end; the quintic is not the natural one."""
    through = path(degree)
    for end, sign in ((0.0, 1), (1.0, -1)):
        # within the first and the last piece
        near = 0.04 * np.arange(degree + 1)
        fitted = np.polynomial.polynomial.polyfit(near, through(end + sign * near).position, degree)
        sizes = np.abs(fitted).max(axis=1)
        assert [k for k in range(2, degree) if sizes[k] < 1e-6 * sizes.max()] == list(zero)
    # a natural quintic spline has zero third and fourth derivatives, so this one must not be called so
    assert "natural" not in (ViaPath.__doc__ or "")


def test_two_poses_are_joined_by_a_straight_line_and_one_axis() -> None:
    at = GeometricPath(POSITION[:2], ORIENTATION[:2], 0.8)(np.array([0.0, 0.25, 1.0]))
    assert_allclose(at.position[1], 0.75 * POSITION[0] + 0.25 * POSITION[1], atol=1e-12)
    assert_allclose(at.turning, at.turning[:1].repeat(3, axis=0), atol=1e-12)


@pytest.mark.parametrize(
    ("position", "orientation", "complaint"),
    [
        (POSITION[:1], ORIENTATION[:1], "a path of 1 poses; expected at least 2"),
        (POSITION[[0, 1, 1]], ORIENTATION[[0, 1, 1]], "poses 2 and 3 of the path are the same"),
        (
            POSITION[[0, 1, 1]] + [[0, 0, 0], [0, 0, 0], [0, 1e-12, 0]],
            ORIENTATION[[0, 1, 1]],
            "poses 2 and 3 of the path are the same, or 1e-12 m apart; remove one",
        ),
        (
            POSITION[[0, 1, 1, 2]],
            ORIENTATION[[0, 1, 1, 2]] + [[0, 0, 0], [0, 0, 0], [0, 0, 1e-9], [0, 0, 0]],
            "poses 2 and 3 of the path are the same, or 1e-09 m apart; remove one",
        ),
        (POSITION * np.nan, ORIENTATION, "position of the poses"),
        (
            POSITION,
            np.array([[0, 0, 0.0], [0, 0, 1], [0, 0, 3.2], [0, 0, 0]]),
            "pose 3 of the path is rotated by half a turn",
        ),
    ],
)
def test_what_is_no_path_is_refused(position: FloatArray, orientation: FloatArray, complaint: str) -> None:
    with pytest.raises(GoughStewartError, match=complaint):
        GeometricPath(position, orientation, 1.0)


@pytest.mark.parametrize("degree", [3, 5])
def test_poses_close_together_do_not_turn_a_path_out_of_their_plane(degree: int) -> None:
    """Expected: all points in the plane of the poses, as every spline of points of a plane is, to 1e-7 m.

    Two poses are as near as is allowed, 1e-8 m; of 1e-12 m their rounding would choose a direction.
    """
    normal = np.array([2.0, -3.0, 6.0]) / 7
    across, along = np.array([3.0, 2.0, 0.0]) / np.sqrt(13), np.cross(normal, np.array([3.0, 2.0, 0.0]) / np.sqrt(13))
    plane = np.array([[0.0, 0.0], [0.2, 0.1], [0.2, 0.1 + 1e-8], [0.5, -0.1]])
    position = np.array([0.1, -0.2, 2.9]) + plane @ np.stack([across, along])
    at = GeometricPath(position, np.zeros((4, 3)), 0.8, degree)(np.linspace(0, 1, 501))
    assert np.abs((at.position - position[0]) @ normal).max() < 1e-7


def test_arrays_of_users_stay_theirs() -> None:
    own: Any = POSITION.copy()
    through = GeometricPath(own, ORIENTATION, 0.8)
    own[:] = 7
    assert_allclose(through(through.at).position, POSITION, atol=1e-12)

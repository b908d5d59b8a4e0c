"""Orientation helpers against SciPy's Rotation and finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart.model import rotations
from gough_stewart.model.errors import OrientationError

angle = st.floats(-np.pi + 1e-6, np.pi - 1e-6)
pitch = st.floats(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3)
orientations = st.tuples(angle, pitch, angle).map(np.array)
vectors = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)


@given(orientations)
def test_matrix_turns_about_fixed_x_then_y_then_z(orientation: np.ndarray) -> None:
    """Expected: SciPy, lower-case axes are extrinsic."""
    expected = Rotation.from_euler("xyz", orientation).as_matrix()
    assert np.allclose(rotations.matrix_from_orientation(orientation), expected, atol=1e-14)


@given(orientations)
def test_orientation_survives_the_round_trip_through_its_matrix(orientation: np.ndarray) -> None:
    back = rotations.orientation_from_matrix(rotations.matrix_from_orientation(orientation))
    assert np.allclose(back, orientation, atol=1e-11)


@given(orientations, vectors)
def test_rates_and_angular_velocity_are_inverse_to_each_other(orientation: np.ndarray, rate: np.ndarray) -> None:
    omega = rotations.angular_velocity_from_orientation_rate(orientation, rate)
    back = rotations.orientation_rate_from_angular_velocity(orientation, omega)
    assert np.allclose(back, rate, atol=1e-10 * (1 + np.abs(rate).max()))


@given(orientations, vectors)
def test_angular_velocity_is_that_of_the_turning_matrix(orientation: np.ndarray, rate: np.ndarray) -> None:
    """Expected: dR/dt Rᵀ = ω~, by central differences."""
    h = 1e-6
    ahead, behind = (rotations.matrix_from_orientation(orientation + s * h * rate) for s in (1, -1))
    turning = (ahead - behind) / (2 * h) @ rotations.matrix_from_orientation(orientation).T
    omega = rotations.angular_velocity_from_orientation_rate(orientation, rate)
    assert np.allclose(omega, [turning[2, 1], turning[0, 2], turning[1, 0]], atol=1e-6)


@pytest.mark.parametrize("sign", [1, -1])
def test_pitch_of_90_degrees_is_refused(sign: int) -> None:
    with pytest.raises(OrientationError, match=r"pitch within .* of ±90°"):
        rotations.orientation_from_matrix(rotations.matrix_from_orientation(np.array([0.3, sign * np.pi / 2, 0.1])))


@pytest.mark.parametrize(
    "bad", [np.diag([1.0, 1.0, -1.0]), 2 * np.eye(3), np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])]
)
def test_one_bad_matrix_in_a_batch_is_enough_to_be_refused(bad: np.ndarray) -> None:
    """A reflection, a stretched one, and a pitch of 90°."""
    with pytest.raises(OrientationError):
        rotations.orientation_from_matrix(np.stack([np.eye(3), bad, np.eye(3)]))


@pytest.mark.parametrize("sign", [1, -1])
def test_pitch_just_short_of_90_degrees_still_converts(sign: int) -> None:
    orientation = np.array([0.3, sign * (np.pi / 2 - 1e-4), 0.1])
    back = rotations.orientation_from_matrix(rotations.matrix_from_orientation(orientation))
    assert np.allclose(back, orientation, atol=1e-9)


def test_small_angles_are_the_rotation_vector_to_first_order() -> None:
    small = np.array([1e-8, -2e-8, 3e-8])
    assert np.allclose(Rotation.from_matrix(rotations.matrix_from_orientation(small)).as_rotvec(), small, atol=1e-15)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), "not a rotation matrix"),
        (2 * np.eye(3), "not a rotation matrix"),
        (np.full((3, 3), np.nan), "not a rotation matrix"),
        (np.eye(2), r"shape \(2, 2\)"),
    ],
)
def test_what_is_no_rotation_is_refused(matrix: np.ndarray, message: str) -> None:
    with pytest.raises(OrientationError, match=message):
        rotations.orientation_from_matrix(matrix)


@given(st.tuples(*[st.floats(-1, 1)] * 4).map(np.array).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternion_matrix_ignores_length(quaternion: np.ndarray) -> None:
    """Expected: SciPy, which normalises."""
    expected = Rotation.from_quat(quaternion).as_matrix()
    assert np.allclose(rotations.matrix_from_quaternion(quaternion), expected, atol=1e-14)


@given(orientations, vectors)
def test_quaternion_rate_turns_with_the_angular_velocity(orientation: np.ndarray, omega: np.ndarray) -> None:
    """Expected: the exact turn exp(ω~ h) by SciPy."""
    start, h = Rotation.from_euler("xyz", orientation), 1e-6
    ahead, behind = ((Rotation.from_rotvec(s * h * omega) * start).as_matrix() for s in (1, -1))
    q = start.as_quat()
    dq = rotations.quaternion_rate(q, omega)
    by_rate = [rotations.matrix_from_quaternion(q + s * h * dq) for s in (1, -1)]
    assert np.allclose((by_rate[0] - by_rate[1]) / (2 * h), (ahead - behind) / (2 * h), atol=1e-7)


@given(angles=st.lists(st.floats(-1.4, 1.4), min_size=9, max_size=9))
def test_angular_acceleration_is_the_derivative_of_angular_velocity(angles: list[float]) -> None:
    """Expected: central differences of ω along θ + θ̇ t + θ̈ t²/2."""
    theta, rate, acceleration = np.array(angles).reshape(3, 3)
    h = 1e-5

    def omega(t: float) -> np.ndarray:
        return rotations.angular_velocity_from_orientation_rate(
            theta + rate * t + acceleration * t**2 / 2, rate + acceleration * t
        )

    expected = (omega(h) - omega(-h)) / (2 * h)
    found = rotations.angular_acceleration_from_orientation_rates(theta, rate, acceleration)
    assert found == pytest.approx(expected, abs=1e-8)


def test_angular_acceleration_broadcasts() -> None:
    """Expected: row by row."""
    rng = np.random.default_rng(1)
    orientation, rate, acceleration = rng.normal(size=(4, 1, 3)), rng.normal(size=3), rng.normal(size=(5, 3))
    found = rotations.angular_acceleration_from_orientation_rates(orientation, rate, acceleration)
    assert found.shape == (4, 5, 3)
    for i, j in np.ndindex(4, 5):
        one = rotations.angular_acceleration_from_orientation_rates(orientation[i, 0], rate, acceleration[j])
        assert np.allclose(found[i, j], one, rtol=1e-14, atol=1e-14)


def test_steady_turns_about_two_axes_accelerate_about_the_third() -> None:
    """Expected: γ̇ e_z × α̇ e_x = γ̇ α̇ e_y, from a platform at level."""
    found = rotations.angular_acceleration_from_orientation_rates(np.zeros(3), np.array([2.0, 0, 3.0]), np.zeros(3))
    assert np.allclose(found, [0, 6, 0], atol=1e-15)

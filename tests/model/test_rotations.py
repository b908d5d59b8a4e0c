"""Orientation helpers against SciPy's Rotation and finite differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError
from gough_stewart.model import rotations
from tests.support.orientations import rotation_vectors

angle = st.floats(-np.pi + 1e-6, np.pi - 1e-6)
pitch = st.floats(-np.pi / 2 + 1e-3, np.pi / 2 - 1e-3)
orientations = st.tuples(angle, pitch, angle).map(np.array)
vectors = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)


@given(orientations, vectors, vectors)
def test_rates_are_derivatives_of_the_turning_matrix(o: np.ndarray, rate: np.ndarray, second: np.ndarray) -> None:
    """Expected: dR/dt Rᵀ = ω~ and dω/dt, by central differences along θ + θ̇ t + θ̈ t²/2; of quaternions too."""
    h = 1e-6

    def at(t: float) -> tuple[np.ndarray, np.ndarray]:
        now = o + rate * t + second * t**2 / 2
        omega = rotations.angular_velocity_from_orientation_rate(now, rate + second * t)
        return rotations.matrix_from_orientation(now), omega

    (ahead, faster), (R, omega), (behind, slower) = at(h), at(0.0), at(-h)
    turning = (ahead - behind) / (2 * h) @ R.T
    assert np.allclose(omega, [turning[2, 1], turning[0, 2], turning[1, 0]], atol=1e-6)
    change = rotations.angular_acceleration_from_orientation_rates(o, rate, second)
    assert np.allclose(change, (faster - slower) / (2 * h), atol=1e-6)
    q = Rotation.from_euler("xyz", o).as_quat()
    dq = rotations.quaternion_rate(q, omega)
    by_rate = [rotations.matrix_from_quaternion(q + s * h * dq) for s in (1, -1)]
    assert np.allclose((by_rate[0] - by_rate[1]) / (2 * h), (ahead - behind) / (2 * h), atol=1e-6)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.diag([1.0, 1.0, -1.0]), "not a rotation matrix"),
        (2 * np.eye(3), "not a rotation matrix"),
        (np.diag([1.0, 1 + 0.51e-8, 1.0]), r"\|R Rᵀ − 1\| = 1.02e-08; expected orthonormal columns"),
        (np.full((3, 3), np.nan), "not a rotation matrix"),
        (np.eye(2), r"shape \(2, 2\)"),
    ],
)
def test_what_is_no_rotation_is_refused(matrix: np.ndarray, message: str) -> None:
    with pytest.raises(GoughStewartError, match=message):
        rotations.orientation_from_matrix(matrix)
    rotations.orientation_from_matrix(np.diag([1.0, 1 + 0.49e-8, 1.0]))


def test_a_pitch_is_read_up_to_a_microradian_from_90_degrees() -> None:
    """Expected: the limit of `orientation_from_matrix` from both sides, of both signs, also for one of many."""
    for sign in (1, -1):
        near, nearer = (np.array([0.3, sign * (np.pi / 2 - off), 0.1]) for off in (1.1e-6, 0.9e-6))
        back = rotations.orientation_from_matrix(rotations.matrix_from_orientation(near))
        assert back[1] == pytest.approx(near[1], abs=1e-9)
        several = rotations.matrix_from_orientation(np.stack([np.zeros(3), nearer, near]))
        with pytest.raises(GoughStewartError, match=r"^pitch within 1e-06 rad of ±90°: roll and yaw are not defined"):
            rotations.orientation_from_matrix(several)


def test_orientations_of_many_are_converted_each_by_itself() -> None:
    """Expected: SciPy, one rotation after the other, over two leading axes; no rotations give no orientations."""
    rng = np.random.default_rng(3)
    several = rng.uniform(-1.4, 1.4, (4, 5, 3))
    matrices = rotations.matrix_from_orientation(several)
    quaternions = 1.7 * Rotation.from_euler("xyz", several.reshape(-1, 3)).as_quat().reshape(4, 5, 4)
    expected = Rotation.from_euler("xyz", several.reshape(-1, 3)).as_matrix().reshape(4, 5, 3, 3)
    assert matrices == pytest.approx(expected, abs=1e-14)
    assert rotations.matrix_from_quaternion(quaternions) == pytest.approx(expected, abs=1e-14)
    assert rotations.orientation_from_matrix(matrices) == pytest.approx(several, abs=1e-12)
    assert rotations.angles_of(matrices) == pytest.approx(several, abs=1e-12)
    assert rotations.orientation_from_matrix(np.zeros((0, 3, 3))).shape == (0, 3)
    rate = rng.normal(size=(4, 5, 3))
    omega = rotations.angular_velocity_from_orientation_rate(several, rate)
    back = rotations.orientation_rate_from_angular_velocity(several, omega)
    assert back == pytest.approx(rate, abs=1e-11)
    turning = rotations.quaternion_rate(quaternions, omega)
    for at in np.ndindex(4, 5):
        one = rotations.angular_velocity_from_orientation_rate(several[at], rate[at])
        assert omega[at] == pytest.approx(one, abs=1e-14)
        assert turning[at] == pytest.approx(rotations.quaternion_rate(quaternions[at], omega[at]), abs=1e-14)


def test_a_rotation_between_orientations_is_that_of_scipy() -> None:
    """Expected: SciPy's rotation vectors, of any angles, also beyond a turn, half a turn apart, nearly equal."""
    rng = np.random.default_rng(2)
    first, second = rng.uniform(-7, 7, (2, 500, 3)) * [1, 0.1, 1]
    changes = (second, rng.normal(size=(500, 3)) * 1e-3, np.array([0, 0, 3.14]), np.array([2 * np.pi, 0, 0]))
    for change in changes:
        to = first + change
        found = rotations.rotation_between(first, to)
        np.testing.assert_allclose(found, rotation_vectors(first, to), atol=2e-12)


def test_an_angle_is_counted_in_the_turns_of_another() -> None:
    """Expected: by hand; an angle within half a turn of the other keeps its bits."""
    angles = np.array([0.3, -np.pi, 3.2, -9.0, 0.3])
    near = np.array([0.0, np.pi + 0.1, -3.0, 0.2, 7.0])
    expected = [0.3, np.pi, 3.2 - 2 * np.pi, -9 + 2 * np.pi, 0.3 + 2 * np.pi]
    found = rotations.nearest_angle(angles, near)
    assert found == pytest.approx(expected, abs=1e-14)
    assert found[0] == angles[0]

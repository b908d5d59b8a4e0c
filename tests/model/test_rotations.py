"""Orientation helpers against SciPy's Rotation and finite differences."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

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


def test_a_rotation_between_orientations_is_that_of_scipy() -> None:
    """Expected: SciPy's rotation vectors, of any angles, also beyond a turn, half a turn apart, nearly equal."""
    rng = np.random.default_rng(2)
    first, second = rng.uniform(-7, 7, (2, 500, 3)) * [1, 0.1, 1]
    changes = (second, rng.normal(size=(500, 3)) * 1e-3, np.array([0, 0, 3.14]), np.array([2 * np.pi, 0, 0]))
    for change in changes:
        to = first + change
        found = rotations.rotation_between(first, to)
        np.testing.assert_allclose(found, rotation_vectors(first, to), atol=2e-12)

"""Motion of the platform from its legs, uneven and far from home, against lengths written out and differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.regressor import motion_of_lengths
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven import UNEVEN

HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])


def lengths(poses: FloatArray) -> FloatArray:
    """|p + R b − a|, R from yaw, pitch and roll about z, y and x."""
    R = Rotation.from_euler("xyz", poses[:, 3:]).as_matrix()
    arms = np.einsum("nij,lj->nli", R, UNEVEN.platform_points)
    return np.asarray(np.linalg.norm(poses[:, None, :3] + arms - UNEVEN.base_points, axis=-1))


def far(n: int) -> FloatArray:
    """Poses some decimetres and up to half a radian from home, all coordinates unlike."""
    rng = np.random.default_rng(8)
    return np.asarray(HOME + rng.uniform(-1, 1, (n, 6)) * [0.4, 0.35, 0.3, 0.4, 0.45, 0.5])


def test_poses_far_from_home_are_found() -> None:
    """Expected: the poses of the lengths, each row from the one before."""
    poses = far(300)
    state, _ = motion_of_lengths(UNEVEN, lengths(poses), np.zeros((300, 6)), np.zeros((300, 6)))
    np.testing.assert_allclose(np.hstack([state.position, state.orientation]), poses, atol=1e-9)


def test_impossible_lengths_are_named_with_their_row() -> None:
    """Expected: the third row, whose fourth leg is as long as the whole machine."""
    wrong = lengths(far(4))
    wrong[2, 3] = 9.0
    with pytest.raises(LogError, match=r"leg lengths \[.*9\.0.*\] m of row 3 \(.*the order of the legs, and the unit"):
        motion_of_lengths(UNEVEN, wrong, wrong, wrong)


def test_rates_are_those_of_the_motion() -> None:
    """Expected: twist and accelerations by differences of positions and rotations, of a motion in all coordinates."""
    h, rng = 1e-3, np.random.default_rng(5)
    size, phase = rng.uniform(0.1, 0.3, 6), rng.uniform(0, 6, 6)
    t = 7.3 + h * np.arange(400)
    poses = HOME + size * np.sin(np.outer(t, [3.1, 2.3, 4.2, 2.9, 3.7, 5.1]) + phase)
    L = lengths(poses)

    def middle(values: FloatArray) -> FloatArray:
        """First derivatives, of the fourth order."""
        return np.asarray((values[:-4] - 8 * values[1:-3] + 8 * values[3:-1] - values[4:]) / (12 * h))

    velocity, acceleration = middle(L)[2:-2], middle(middle(L))
    state, found = motion_of_lengths(UNEVEN, L[4:-4], velocity, acceleration)
    np.testing.assert_allclose(state.position, poses[4:-4, :3], atol=1e-9)
    np.testing.assert_allclose(state.orientation, poses[4:-4, 3:], atol=1e-9)
    np.testing.assert_allclose(state.velocity, middle(poses[:, :3])[2:-2], atol=1e-7)
    R = Rotation.from_euler("xyz", poses[:, 3:]).as_matrix()
    spin = middle(R.reshape(len(R), 9)).reshape(-1, 3, 3) @ np.swapaxes(R[2:-2], 1, 2)
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    np.testing.assert_allclose(state.angular_velocity, omega[2:-2], atol=1e-7)
    np.testing.assert_allclose(found.linear, middle(middle(poses[:, :3])), atol=1e-5)
    np.testing.assert_allclose(found.angular, middle(omega), atol=1e-5)

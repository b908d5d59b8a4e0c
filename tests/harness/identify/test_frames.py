"""First guesses of a tracker's frame and its target, of exact readings: they are the frames that made them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.harness.identify.geometry import Frames, Geometry, Measured, Poses, guessed_frames
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven import UNEVEN

GEOMETRY = Geometry(UNEVEN.base_points, UNEVEN.platform_points, np.zeros(6))
N = 12


def turned(*angles: float) -> FloatArray:
    return np.asarray(Rotation.from_rotvec(angles).as_matrix())


def made(seed: int, target: FloatArray) -> tuple[Frames, Poses, Measured]:
    """Readings X_t + X (t + R y) and X R Y of poses in which everything turns."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (N, 3)))
    poses = Poses(UNEVEN.home_position + rng.uniform(-0.3, 0.3, (N, 3)), rotations.as_matrix())
    frames = Frames(np.array([5.0, -3.0, 2.0]), turned(0.7, -1.9, 1.1), target, turned(-0.4, 0.9, 2.1))
    position = frames.X_t + (poses.position + poses.rotation @ target) @ frames.X.T
    shown = Rotation.from_matrix(frames.X @ poses.rotation @ frames.Y).as_euler("xyz")
    return frames, poses, Measured(np.full((N, 6), np.nan), position, shown, np.ones(12))


def check(found: Frames, frames: Frames) -> None:
    for name in Frames._fields:
        np.testing.assert_allclose(getattr(found, name), getattr(frames, name), atol=1e-9, err_msg=name)


@pytest.mark.parametrize("missing", [0, 4])
def test_frames_of_exact_poses_are_found(missing: int) -> None:
    """Expected: all four, of a target far from Op; some rows have a position or an orientation only."""
    frames, poses, measured = made(3, np.array([0.4, -0.7, 1.2]))
    measured.position[:missing] = np.nan
    measured.orientation[N - missing :] = np.nan
    check(guessed_frames(GEOMETRY, poses, measured), frames)


def test_positions_alone_tell_the_frame_and_rotations_alone_both_turns() -> None:
    """Expected: of a target at Op, X and X_t; without positions X and Y, and the rest as it was."""
    frames, poses, measured = made(4, np.zeros(3))
    only = measured._replace(orientation=np.full((N, 3), np.nan))
    check(guessed_frames(GEOMETRY, poses, only), frames._replace(Y=np.eye(3)))
    only = measured._replace(position=np.full((N, 3), np.nan))
    check(guessed_frames(GEOMETRY, poses, only), frames._replace(X_t=np.zeros(3)))

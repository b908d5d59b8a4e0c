"""Moves recorded motions to the home pose of a platform."""

from typing import Literal

import numpy as np

from gough_stewart.harness.motion.table import FromTable
from gough_stewart.harness.motion.turning import orientation_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

# The pose of a recording that becomes the platform's home pose.
AtHome = Literal["start", "mean"]


def moved_home(table: FromTable, platform: Platform, pose: AtHome, start: float) -> FromTable:
    """Move a motion rigidly, so that its pose at a time, or its mean pose, becomes the home pose.

    p = p_home + R_home R₀ᵀ (p − p₀) and R = R_home R₀ᵀ R: displacements stay the same in the axes of the platform in
    the pose p₀, R₀, so surge of a vehicle stays surge, whatever its heading. Means are over time; the mean rotation is
    the rotation nearest to the mean of the matrices.

    Parameters
    ----------
    start
        The time of the pose "start" [s].

    Raises
    ------
    MotionError
        The time is outside the table, or a pitch reaches ±90°.
    """
    if pose == "start":
        at = table(np.array([start]))
        position, rotation = at.position[0], matrix_from_orientation(at.orientation[0])
    else:
        position, rotation = _mean_pose(table)
    turn = matrix_from_orientation(platform.home_orientation) @ rotation.T
    return FromTable(
        table.time,
        platform.home_position + (table.position - position) @ turn.T,
        orientation_of(turn @ matrix_from_orientation(table.orientation)),
    )


def _mean_pose(table: FromTable) -> tuple[FloatArray, FloatArray]:
    """Mean position (3,) [m] and rotation (3, 3) over time, by the trapezoidal rule."""
    from scipy.spatial.transform import Rotation  # rarely needed

    steps = np.diff(table.time)
    weights = (np.append(steps, 0.0) + np.append(0.0, steps)) / 2
    rotations = Rotation.from_matrix(matrix_from_orientation(table.orientation))
    position: FloatArray = np.average(table.position, axis=0, weights=weights)
    return position, rotations.mean(weights=weights).as_matrix()

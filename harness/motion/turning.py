"""Recorded orientations as continuous roll, pitch and yaw."""

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.rotations import matrix_from_quaternion, orientation_from_matrix
from gough_stewart.model.vectors import FloatArray

# Logs round to at least four digits; a larger deviation from norm 1 is an error.
_LENGTH_TOLERANCE = 1e-3


def continuous(orientation: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (n, 3) [rad], unwrapped, with the first row within (−π, π]."""
    turned = np.unwrap(orientation, axis=0)
    return np.asarray(turned - 2 * np.pi * np.round(turned[:1] / (2 * np.pi)))


def orientation_of(rotation: FloatArray) -> FloatArray:
    """Continuous roll, pitch, yaw (n, 3) [rad] of rotation matrices (n, 3, 3).

    Raises
    ------
    MotionError
        A pitch near ±90°, where roll and yaw are undefined; names the row, counted from 1.
    """
    steep = np.flatnonzero(~(np.abs(rotation[:, 2, 0]) < np.sin(LARGEST_PITCH)))
    if steep.size:
        raise MotionError(f"in row {steep[0] + 1} the pitch is ±90°; expected a pitch between these limits")
    return continuous(orientation_from_matrix(rotation))


def of_quaternions(quaternion: FloatArray) -> FloatArray:
    """Continuous roll, pitch, yaw (n, 3) [rad] of unit quaternions (n, 4), scalar last; q and −q are the same.

    Raises
    ------
    MotionError
        A norm that is not 1; names the row, counted from 1.
    """
    length = np.linalg.norm(quaternion, axis=1)
    bad = np.flatnonzero(~(np.abs(length - 1) <= _LENGTH_TOLERANCE))
    if bad.size:
        raise MotionError(
            f"the quaternion in row {bad[0] + 1} has the norm {length[bad[0]]:.6g}; expected 1 "
            f"within {_LENGTH_TOLERANCE:g}"
        )
    return orientation_of(matrix_from_quaternion(quaternion))


def of_rotation_vectors(vector: FloatArray) -> FloatArray:
    """Continuous roll, pitch, yaw (n, 3) [rad] of rotation vectors (n, 3) [rad]: axis times angle.

    Raises
    ------
    MotionError
        As `orientation_of`.
    """
    from scipy.spatial.transform import Rotation  # rarely needed

    return orientation_of(Rotation.from_rotvec(vector).as_matrix())

"""Differences of orientations by SciPy."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

FloatArray = NDArray[np.float64]


def rotation_vectors(orientation: ArrayLike, to: ArrayLike) -> FloatArray:
    """The rotation vectors (..., 3) [rad] about the world's axes, from roll, pitch, yaw (..., 3) to others."""
    first, second = np.broadcast_arrays(np.asarray(orientation, float), np.asarray(to, float))
    turns = (Rotation.from_euler("xyz", each.reshape(-1, 3)) for each in (second, first))
    turn = next(turns) * next(turns).inv()
    return np.asarray(turn.as_rotvec()).reshape(first.shape)

"""Initial guess of a tracker's frame and the place of its target, from poses of the nominal platform."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gough_stewart.harness.identify.geometry.equations import SAME, Frames, Geometry, Measured, Poses, equations
from gough_stewart.model.vectors import FloatArray

Rows = NDArray[np.bool_]


def guessed_frames(geometry: Geometry, poses: Poses, measured: Measured) -> Frames:
    """The better of two guesses of X and (y, Y), which map poses in world to measured ones.

    One from the positions alone (Kabsch, Acta Cryst. A32, 1976, 922), accurate if the target is near Op; one from the
    rotations alone (Shah, J. Mechanisms Robotics 5, 2013, 031007), accurate if they differ enough.
    """
    at, turned = np.asarray(np.isfinite(measured.position).all(axis=1)), measured.has_rotation
    shown = np.zeros((len(at), 3, 3))
    if turned.any():
        shown[turned] = Rotation.from_euler("xyz", measured.orientation[turned]).as_matrix()
    R = poses.rotation
    guesses = []
    if at.any():
        centred = (each[at] - each[at].mean(axis=0) for each in (measured.position, poses.position))
        seen, true = centred
        guesses.append(_nearest_rotation(seen.T @ true))
    if turned.any():
        # shown Yᵀ = X R: vec X and vec Yᵀ are the first singular vectors of the sum of shown ⊗ R
        K = sum(np.kron(a, b) for a, b in zip(shown[turned], R[turned], strict=True))
        X = np.linalg.svd(K)[0][:, 0].reshape(3, 3)
        guesses.append(_nearest_rotation(X * np.sign(np.linalg.det(X))))
    made = [_with_the_rest(X, poses, measured, shown, at, turned) for X in guesses]
    return min(made, key=lambda frames: float((equations(geometry, frames, poses, measured).residual ** 2).sum()))


def _with_the_rest(
    X: FloatArray, poses: Poses, measured: Measured, shown: FloatArray, at: Rows, turned: Rows
) -> Frames:
    """Y as the mean of Rᵀ Xᵀ shown; X_t and y by least squares of X_t + X R y = seen − X t."""
    frames = SAME._replace(X=X)
    if turned.any():
        Y = (np.swapaxes(X @ poses.rotation[turned], 1, 2) @ shown[turned]).sum(axis=0)
        frames = frames._replace(Y=_nearest_rotation(Y))
    if at.any():
        blocks = X @ poses.rotation[at]
        rows = np.concatenate([np.broadcast_to(np.eye(3), blocks.shape), blocks], axis=-1).reshape(-1, 6)
        gap = (measured.position[at] - poses.position[at] @ X.T).reshape(-1)
        found = np.linalg.lstsq(rows, gap, rcond=1e-6)[0]
        frames = frames._replace(X_t=found[:3], y=found[3:])
    return frames


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation with the largest scalar product with a matrix."""
    U, _, Vh = np.linalg.svd(matrix)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vh)]) @ Vh)

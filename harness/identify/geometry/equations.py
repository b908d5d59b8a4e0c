"""Leg lengths and measured poses as equations in joints, offsets, frames and the true poses; exact derivatives.

L_i = |t + R p_i − B_i| + o_i is the reading of encoder i in the true pose (t, R); a tracker measures the position
X_t + X_R (t + R y) and the rotation X_R R Y of its target. X maps world to the tracker's frame, (y, Y) is the target's
place on the platform; if the log's poses are those of the platform in world, X and Y are 1, and y is 0.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gough_stewart.model.rotations import orientation_from_matrix, orientation_rate_from_angular_velocity
from gough_stewart.model.vectors import FloatArray, cross, skew

N_GEOMETRY, N_FRAMES, N_ROWS = 42, 12, 12


class Geometry(NamedTuple):
    """The calibrated geometry, in the order of the unknowns."""

    base: FloatArray  # B (6, 3) [m]
    platform: FloatArray  # p (6, 3) [m]
    offset: FloatArray  # o (6,) [m], encoder reading minus length

    def plus(self, change: FloatArray) -> "Geometry":
        """Changed by (42,) [m]."""
        return Geometry(
            self.base + change[:18].reshape(6, 3),
            self.platform + change[18:36].reshape(6, 3),
            self.offset + change[36:],
        )


class Poses(NamedTuple):
    """True poses of n rows."""

    position: FloatArray  # t (n, 3) [m]
    rotation: FloatArray  # R (n, 3, 3)

    def plus(self, change: FloatArray) -> "Poses":
        """Moved by δt, rotated by exp(δφ~) R, (n, 6) [m, rad]."""
        return Poses(self.position + change[:, :3], _turned(self.rotation, change[:, 3:]))


class Frames(NamedTuple):
    """The frames of the measured poses: the tracker's frame, and the place of its target on the platform."""

    X_t: FloatArray
    X: FloatArray
    y: FloatArray
    Y: FloatArray

    def plus(self, change: FloatArray) -> "Frames":
        """Changed by (12,): δX_t, X ← exp(δ~) X, δy, Y ← exp(δ~) Y."""
        return Frames(
            self.X_t + change[:3], _turned(self.X, change[3:6]), self.y + change[6:9], _turned(self.Y, change[9:])
        )


SAME = Frames(np.zeros(3), np.eye(3), np.zeros(3), np.eye(3))


class Measured(NamedTuple):
    """Rows of a log; NaN where not measured."""

    length: FloatArray  # (n, 6) [m]
    position: FloatArray  # (n, 3) [m]
    orientation: FloatArray  # (n, 3) [rad]
    deviation: FloatArray  # standard errors of the twelve numbers (12,) [m, rad]

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """Which of the twelve numbers of a row are measured (n, 12)."""
        return np.asarray(np.isfinite(np.concatenate([self.length, self.position, self.orientation], axis=1)))

    @property
    def has_rotation(self) -> NDArray[np.bool_]:
        """Which rows have a full orientation (n,)."""
        return np.asarray(np.isfinite(self.orientation).all(axis=1))


class Equations(NamedTuple):
    """Measured minus predicted, divided by standard errors, and derivatives of the predictions."""

    residual: FloatArray  # (n, 12), 0 where not measured
    by_pose: FloatArray  # (n, 12, 6)
    by_geometry: FloatArray  # (n, 12, 42)
    by_frames: FloatArray  # (n, 12, 12)


def equations(geometry: Geometry, frames: Frames, poses: Poses, measured: Measured) -> Equations:
    """The twelve equations of every row: six lengths, position, orientation; linear about the present values."""
    n = len(measured.length)
    t, R, X = poses.position, poses.rotation, frames.X
    r, A = np.zeros((n, N_ROWS)), np.zeros((n, N_ROWS, 6))
    G, F = np.zeros((n, N_ROWS, N_GEOMETRY)), np.zeros((n, N_ROWS, N_FRAMES))

    arm = np.einsum("nab,ib->nia", R, geometry.platform)
    l = t[:, None] + arm - geometry.base
    L = np.linalg.norm(l, axis=-1)
    u = l / L[..., None]
    r[:, :6] = measured.length - L - geometry.offset
    A[:, :6] = np.concatenate([u, cross(arm, u)], axis=-1)
    back = np.einsum("nab,nia->nib", R, u)  # Rᵀ u
    for i in range(6):
        G[:, i, 3 * i : 3 * i + 3] = -u[:, i]
        G[:, i, 18 + 3 * i : 21 + 3 * i] = back[:, i]
        G[:, i, 36 + i] = 1.0

    target = R @ frames.y
    seen = (t + target) @ X.T
    r[:, 6:9] = measured.position - seen - frames.X_t
    A[:, 6:9] = np.concatenate([np.broadcast_to(X, R.shape), -X @ skew(target)], axis=-1)
    F[:, 6:9, :3], F[:, 6:9, 3:6], F[:, 6:9, 6:9] = np.eye(3), -skew(seen), X @ R

    r[:, 9:], A[:, 9:, 3:] = _orientation_rows(frames, R, measured)
    F[:, 9:, 3:6], F[:, 9:, 9:] = np.eye(3), X @ R

    weight = np.where(measured.is_known, 1 / measured.deviation, 0.0)
    r = np.where(measured.is_known, r, 0.0) * weight
    return Equations(r, A * weight[..., None], G * weight[..., None], F * weight[..., None])


def _orientation_rows(frames: Frames, R: FloatArray, measured: Measured) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, 3) [rad] and derivatives by δφ (n, 3, 3): of the rotation if it is full, else of single angles.

    The rotation vector from the predicted to the measured rotation; single angles, of inclinometers, are in world.
    """
    whole = measured.has_rotation
    r, by_turn = np.zeros((len(R), 3)), np.zeros((len(R), 3, 3))
    if whole.any():
        predicted = frames.X @ R[whole] @ frames.Y
        shown = Rotation.from_euler("xyz", measured.orientation[whole])
        r[whole] = (shown * Rotation.from_matrix(predicted).inv()).as_rotvec()
        by_turn[whole] = frames.X
    if not whole.all():
        angles = orientation_from_matrix(R[~whole])
        gap = measured.orientation[~whole] - angles
        r[~whole] = np.remainder(gap + np.pi, 2 * np.pi) - np.pi
        units = [orientation_rate_from_angular_velocity(angles, np.broadcast_to(e, angles.shape)) for e in np.eye(3)]
        by_turn[~whole] = np.stack(units, axis=-1)
    return r, by_turn


def _turned(rotation: FloatArray, by: FloatArray) -> FloatArray:
    """exp(by~) R."""
    return np.asarray(Rotation.from_rotvec(by).as_matrix() @ rotation)

"""The fit of joints and offsets: Gauss–Newton on lengths and poses, weighted by their errors.

The true poses are unknowns, too, six per row. They are eliminated row by row: six lengths fix a pose, so each row
leaves as many equations for the geometry as it has measured numbers of its pose.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.harness.identify.geometry.equations import (
    Equations,
    Frames,
    Geometry,
    Measured,
    Poses,
    equations,
)
from gough_stewart.model.vectors import FloatArray

_MOST_STEPS, _MOST_HALVINGS = 50, 12
_CONVERGED = 1e-10  # relative change of the cost


class Fit(NamedTuple):
    """The result of the fit."""

    geometry: Geometry
    frames: Frames
    poses: Poses
    singular_values: FloatArray  # (k,) in units of 1/scale
    directions: FloatArray  # (k, p), of all unknowns
    rank: int
    cost: float  # ∑ (residual / standard error)²
    is_converged: bool


def fitted(
    nominal: Geometry,
    frames: Frames,
    poses: Poses,
    measured: Measured,
    unknowns: FloatArray,
    scale: float,
    *,
    is_frame_known: bool,
) -> Fit:
    """The geometry that explains the log best and stays nominal where it is unobservable.

    With z = Z d the remaining equations, d in units of `scale`, Z = U S Vᵀ: d = V₁ S₁⁻¹ U₁ᵀ z in the directions
    V₁ whose standard error 1/S is below 1, that is, `scale`; zero in the others, which keep their nominal values.

    Parameters
    ----------
    unknowns
        Which of the 42 numbers are estimated.
    scale
        Uncertainty of the nominal geometry [m].
    """
    geometry = nominal
    d: FloatArray = np.zeros(len(unknowns))
    rank: int | None = None
    now = equations(geometry, frames, poses, measured)
    cost = float((now.residual**2).sum())
    for _ in range(_MOST_STEPS):
        left = _without_poses(now)
        F = left.by_frames if not is_frame_known else left.by_frames[:, :0]
        Z = left.by_geometry[:, unknowns] * scale
        Q = _span(F)
        z, seen = left.residual - Q @ (Q.T @ left.residual), Z - Q @ (Q.T @ Z)
        U, S, Vh, small = _small_svd(seen, z)
        if rank is None:
            rank = int((S > 1).sum())
        U, V, rest = U[:, :rank], Vh[:rank], Vh[rank:]
        step = V.T @ ((U.T @ small) / S[:rank]) - rest.T @ (rest @ d)
        turn: FloatArray = np.zeros(12)
        if not is_frame_known:
            turn = np.asarray(np.linalg.lstsq(F, left.residual - Z @ step, rcond=1e-12)[0], dtype=np.float64)
        move = _pose_change(now, unknowns, scale * step, turn)
        share, before = 1.0, cost
        for _ in range(_MOST_HALVINGS):
            change = np.zeros(42)
            change[unknowns] = scale * (d + share * step)
            tried = nominal.plus(change), frames.plus(share * turn), poses.plus(share * move)
            then = equations(*tried, measured)
            cost = float((then.residual**2).sum())
            # unobservable directions may return to nominal, which costs rounding only
            if cost <= before * (1 + 1e-9) + 1e-12:
                break
            share /= 2
        else:
            return Fit(geometry, frames, poses, S, Vh, rank, before, is_converged=False)
        d = d + share * step
        (geometry, frames, poses), now = tried, then
        if before - cost <= _CONVERGED * before + 1e-18 and np.abs(step).max() < 1e-6:
            return Fit(geometry, frames, poses, S, Vh, rank, cost, is_converged=True)
    return Fit(geometry, frames, poses, S, Vh, rank or 0, cost, is_converged=False)


class _Reduced(NamedTuple):
    """Equations of geometry and frames with the poses eliminated; rows of all poses."""

    residual: FloatArray  # (6 n,)
    by_geometry: FloatArray  # (6 n, 42)
    by_frames: FloatArray  # (6 n, 12)


def _without_poses(of: Equations) -> _Reduced:
    """Nᵀ times every row's equations, with Nᵀ A = 0, A their derivatives with respect to the pose."""
    N = np.linalg.qr(of.by_pose, mode="complete")[0][:, :, 6:]
    back = np.swapaxes(N, 1, 2)
    return _Reduced(
        (back @ of.residual[..., None]).reshape(-1),
        (back @ of.by_geometry).reshape(-1, of.by_geometry.shape[-1]),
        (back @ of.by_frames).reshape(-1, of.by_frames.shape[-1]),
    )


def _pose_change(now: Equations, unknowns: FloatArray, step: FloatArray, turn: FloatArray) -> FloatArray:
    """The least-squares pose changes for the residuals (n, 6) that geometry and frames leave."""
    rest = now.residual - now.by_geometry[:, :, unknowns] @ step - now.by_frames @ turn
    Q, R = np.linalg.qr(now.by_pose)
    return np.asarray(np.linalg.solve(R, np.swapaxes(Q, 1, 2) @ rest[..., None])[..., 0])


def _small_svd(matrix: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """U, S (p,) and full Vh (p, p) of a tall matrix, and the compressed z, by QR first."""
    p = matrix.shape[1]
    tall = np.pad(matrix, ((0, max(0, p - len(matrix))), (0, 0)))
    Q, R = np.linalg.qr(tall)
    U, S, Vh = np.linalg.svd(R)
    return U, S, Vh, Q[: len(z)].T @ z


def _span(matrix: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns; empty for a zero matrix."""
    if not matrix.size:
        return np.zeros((len(matrix), 0))
    basis, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-10 * sizes[0]])

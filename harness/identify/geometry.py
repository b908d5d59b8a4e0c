"""Joints and leg offsets from leg lengths and full or partial poses; unobservable combinations stay nominal.

L_i = |t + R p_i − B_i| + o_i is the reading of encoder i in the true pose (t, R); a tracker measures the position
X_t + X_R (t + R y) and the rotation X_R R Y of its target. X maps world to the tracker's frame, (y, Y) is the target's
place on the platform; if the log's poses are those of the platform in world, X and Y are 1, and y is 0.

The true poses are unknowns, too, six per row. They are eliminated row by row: six lengths fix a pose, so each row
leaves as many equations for the geometry as it has measured numbers of its pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space, orth
from scipy.spatial.transform import Rotation
from scipy.special import fdtrc

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import Estimate, Residuals, combination_text, nominal_values, rms
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import expanded
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.forward_kinematics import forward_kinematics
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    orientation_from_matrix,
    orientation_rate_from_angular_velocity,
)
from gough_stewart.model.vectors import FloatArray, cross, skew

PoseFrame = Literal["world", "own"]
GEOMETRY = ("base_points", "platform_points", "leg_length_offset")
_N_GEOMETRY, _N_FRAMES, _N_ROWS = 42, 12, 12
# Default uncertainty of the nominal geometry, as a share of the platform's size.
_NOMINAL_SHARE = 0.01
# An element has no interval if what is unobservable may move it by more than this share of its standard error.
_MOVED = 0.3
# Larger residuals, in standard errors, are not noise.
_CONTRADICTION = 100.0
# Probability that a right log has a row that is left out as an outlier, and the largest share of rows that may be.
_OUTLIER, _MOST_OUTLIERS = 1e-3, 0.1
# Share of the rows, at the end, that a second fit leaves out.
_KEPT_ASIDE = 0.2
_FAR = 10.0  # times nominal_error: a different geometry, not an error of this one
_SHOWN_UNSEEN = 3
_MOST_STEPS, _MOST_HALVINGS = 50, 12
_CONVERGED = 1e-12  # decrease of the cost that is left, of 1 + the cost
_REMEDY = (
    "expected legs and joints in the same order, lengths from joint to joint, poses of Op in world, or pose_frame 'own'"
)


class PoseAccuracy(NamedTuple):
    """Standard errors of the measurements; only their ratios matter for the values."""

    leg_length: float = 5e-6  # [m]
    position: float = 5e-5  # [m]
    orientation: float | None = None  # [rad]; that of the position over the platform's characteristic length


class Geometry(NamedTuple):
    """The calibrated geometry, in the order of the unknowns."""

    base: FloatArray  # B (6, 3) [m]
    platform: FloatArray  # p (6, 3) [m]
    offset: FloatArray  # o (6,) [m], encoder reading minus length

    @property
    def numbers(self) -> FloatArray:
        """All unknowns (42,)."""
        return np.concatenate([self.base.ravel(), self.platform.ravel(), self.offset])

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

    def rows(self, chosen: NDArray[np.intp]) -> "Measured":
        """Some of the rows."""
        return Measured(self.length[chosen], self.position[chosen], self.orientation[chosen], self.deviation)

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
    r, A = np.zeros((n, _N_ROWS)), np.zeros((n, _N_ROWS, 6))
    G, F = np.zeros((n, _N_ROWS, _N_GEOMETRY)), np.zeros((n, _N_ROWS, _N_FRAMES))

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


def _turned(rotation: FloatArray, turn: FloatArray) -> FloatArray:
    """exp(turn~) R."""
    return np.asarray(Rotation.from_rotvec(turn).as_matrix() @ rotation)


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
        seen, true = (place[at] - place[at].mean(axis=0) for place in (measured.position, poses.position))
        guesses.append(_nearest_rotation(seen.T @ true))
    if turned.any():
        # shown Yᵀ = X R: vec X and vec Yᵀ are the first singular vectors of the sum of shown ⊗ R
        K = sum(np.kron(a, b) for a, b in zip(shown[turned], R[turned], strict=True))
        X = np.linalg.svd(K)[0][:, 0].reshape(3, 3)
        guesses.append(_nearest_rotation(X * np.sign(np.linalg.det(X))))
    made = [_with_the_rest(X, poses, measured, shown, at, turned) for X in guesses]
    return min(made, key=lambda frames: float((equations(geometry, frames, poses, measured).residual ** 2).sum()))


def _with_the_rest(
    X: FloatArray, poses: Poses, measured: Measured, shown: FloatArray, at: NDArray[np.bool_], turned: NDArray[np.bool_]
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
        places = np.linalg.lstsq(rows, gap, rcond=1e-6)[0]
        frames = frames._replace(X_t=places[:3], y=places[3:])
    return frames


def _nearest_rotation(matrix: FloatArray) -> FloatArray:
    """The rotation with the largest scalar product with a matrix."""
    U, _, Vh = np.linalg.svd(matrix)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vh)]) @ Vh)


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """The geometry that explains a log best, and stays nominal where it is unobservable."""

    geometry: Geometry
    frames: Frames
    poses: Poses
    singular_values: FloatArray  # (k,) in units of 1/scale
    directions: FloatArray  # (p, p), of the unknowns, the observable ones first
    rank: int  # of these, how many are observable
    cost: float  # ∑ (residual / standard error)²
    redundant: int  # measured numbers of poses
    of_frames: int  # numbers of the frames that are observable
    is_converged: bool

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.redundant - self.rank - self.of_frames

    @property
    def factor(self) -> float:
        """Residuals in stated standard errors; without redundancy to estimate it from, 1."""
        return float(np.sqrt(self.cost / self.freedom)) if self.freedom > 0 else 1.0


@dataclass(frozen=True, eq=False)
class _Calibration:
    """A log of poses, and what is estimated from it."""

    measured: Measured
    nominal: Geometry
    frames: Frames  # to start from
    poses: Poses  # to start from
    unknowns: NDArray[np.intp]  # which of the 42 numbers are estimated (p,)
    scale: float  # uncertainty of the nominal geometry [m]
    is_frame_known: bool

    def rows(self, chosen: NDArray[np.intp]) -> "_Calibration":
        """The same with some of the rows."""
        poses = Poses(self.poses.position[chosen], self.poses.rotation[chosen])
        return replace(self, measured=self.measured.rows(chosen), poses=poses)

    def fitted(self) -> GeometryFit:
        """The best fit among the geometries that differ from the nominal one in observable combinations only.

        First all unknowns d, in units of `scale`, are fitted with the nominal geometry as prior knowledge, |d|² ≤ 1:
        a problem with one solution. With z = Z d the equations there, Z = U S Vᵀ, the directions V₁ with a standard
        error 1/S below 1, that is, `scale`, are observable; in these the fit is repeated without prior knowledge.
        """
        p = len(self.unknowns)
        d, frames, poses, is_near = self._minimised(np.zeros(p), self.frames, self.poses, np.eye(p), prior=1.0)
        _, _, Z, F = self._equations(d, frames, poses)
        tall = np.pad(_beside(Z, F), ((0, max(0, p - len(Z))), (0, 0)))
        _, S, V = np.linalg.svd(np.linalg.qr(tall, mode="r"))
        rank = int((S > 1).sum())
        start = V[:rank].T @ (V[:rank] @ d)
        d, frames, poses, is_best = self._minimised(start, frames, poses, V[:rank], prior=0.0)
        now, _, Z, F = self._equations(d, frames, poses)
        if rank:
            _, S[:rank], turned = np.linalg.svd(np.linalg.qr(_beside(Z, F) @ V[:rank].T, mode="r"))
            V[:rank] = turned @ V[:rank]
        return GeometryFit(
            self._geometry(d),
            frames,
            poses,
            S,
            V,
            rank,
            float((now.residual**2).sum()),
            int(self.measured.is_known[:, 6:].sum()),
            int(np.linalg.matrix_rank(F, tol=1e-9 * np.linalg.norm(F))) if F.size else 0,
            is_near and is_best,
        )

    def _minimised(
        self, d: FloatArray, frames: Frames, poses: Poses, basis: FloatArray, prior: float
    ) -> tuple[FloatArray, Frames, Poses, bool]:
        """Gauss–Newton over d in the span of `basis` (k, p), frames and poses; whether it converged.

        Minimises the sum of squared residuals + prior |d|².
        """

        def cost_of(d: FloatArray, now: Equations) -> float:
            return float((now.residual**2).sum() + prior * d @ d)

        for _ in range(_MOST_STEPS):
            now, z, Z, F = self._equations(d, frames, poses)
            columns = np.block([[Z @ basis.T, F], [np.sqrt(prior) * basis.T, np.zeros((len(d), F.shape[1]))]])
            x = np.linalg.lstsq(columns, np.concatenate([z, -np.sqrt(prior) * d]), rcond=1e-12)[0]
            step, turn = x[: len(basis)] @ basis, np.zeros(_N_FRAMES)
            turn[: F.shape[1]] = x[len(basis) :]
            change = self.scale * now.by_geometry[:, :, self.unknowns] @ step + now.by_frames @ turn
            Q, R = np.linalg.qr(now.by_pose)
            of_poses = np.swapaxes(Q, 1, 2) @ (now.residual - change)[..., None]
            move = np.linalg.solve(R, of_poses)[..., 0]
            left = float(((columns @ x) ** 2).sum() + (of_poses**2).sum())
            before, share = cost_of(d, now), 1.0
            for _ in range(_MOST_HALVINGS):
                moved = d + share * step, frames.plus(share * turn), poses.plus(share * move)
                then = equations(self._geometry(moved[0]), *moved[1:], self.measured)
                if cost_of(moved[0], then) <= before * (1 + 1e-9) + 1e-12:
                    break
                share /= 2
            else:
                return d, frames, poses, False
            d, frames, poses = moved
            if left <= _CONVERGED * (1 + before):
                return d, frames, poses, True
        return d, frames, poses, False

    def _geometry(self, d: FloatArray) -> Geometry:
        change = np.zeros(_N_GEOMETRY)
        change[self.unknowns] = self.scale * d
        return self.nominal.plus(change)

    def _equations(
        self, d: FloatArray, frames: Frames, poses: Poses
    ) -> tuple[Equations, FloatArray, FloatArray, FloatArray]:
        """The equations; and without poses their residual (6 n,), Z (6 n, p), and F (6 n, 12), or (6 n, 0) in world.

        Without poses: Nᵀ times every row's equations, where Nᵀ A = 0 with A the derivatives by the pose.
        """
        now = equations(self._geometry(d), frames, poses, self.measured)
        back = np.swapaxes(np.linalg.qr(now.by_pose, mode="complete")[0][:, :, 6:], 1, 2)
        Z = self.scale * (back @ now.by_geometry[:, :, self.unknowns])
        F = back @ now.by_frames[:, :, : 0 if self.is_frame_known else _N_FRAMES]
        z = (back @ now.residual[..., None]).ravel()
        return now, z, Z.reshape(len(z), -1), F.reshape(len(z), -1)

    def outlier(self, fit: GeometryFit) -> tuple[int, float] | None:
        """The row that the others contradict most, and its residuals in standard errors; None if none does.

        A fit without row k has a cost that is smaller by Δ = eᵀ (1 − H)⁻¹ e, e and H = Q Qᵀ its residuals and its
        block of the hat matrix; (Δ/q)/((cost − Δ)/(ν − q)) has the distribution F(q, ν − q).
        """
        d = (fit.geometry.numbers - self.nominal.numbers)[self.unknowns] / self.scale
        _, z, Z, F = self._equations(d, fit.frames, fit.poses)
        Q = orth(np.concatenate([Z @ fit.directions[: fit.rank].T, F], axis=1), rcond=1e-10)
        e = (z - Q @ (Q.T @ z)).reshape(len(self.measured.length), -1)
        Q = Q.reshape(*e.shape, -1)
        left = np.eye(e.shape[1]) - Q @ np.swapaxes(Q, 1, 2)
        decrease = (e * (np.linalg.pinv(left, rcond=1e-6, hermitian=True) @ e[..., None])[..., 0]).sum(axis=1)
        numbers = np.maximum(self.measured.is_known[:, 6:].sum(axis=1), 1)
        freedom = fit.freedom - numbers
        rest = np.maximum(fit.cost - decrease, 1e-12 * fit.cost + 1e-300) / np.maximum(freedom, 1)
        p = np.where(freedom > 0, fdtrc(numbers, np.maximum(freedom, 1), decrease / numbers / rest), 1.0)
        worst = int(p.argmin())
        is_outlier = p[worst] * len(p) < _OUTLIER
        return (worst, float(np.sqrt(decrease[worst] / numbers[worst] / rest[worst]))) if is_outlier else None


def _beside(Z: FloatArray, F: FloatArray) -> FloatArray:
    """What of the columns Z the columns F do not explain."""
    Q = orth(F, rcond=1e-10) if F.size else F
    return np.asarray(Z - Q @ (Q.T @ Z))


def identify_geometry(
    log: Log,
    platform: Platform,
    names: Sequence[str] = GEOMETRY,
    *,
    accuracy: tuple[float, float, float | None] = PoseAccuracy(),
    pose_frame: PoseFrame = "world",
    nominal_error: float | None = None,
) -> Estimate:
    """Joint points and leg offsets from poses at rest: least squares of lengths and poses, both with errors.

    Minimises ∑ (L − |t + R p − B| − o)²/σ_L² + ∑ (pose − measured)²/σ² over geometry and true poses, an
    errors-in-variables problem. A row gives as many equations as it has numbers of its pose: three for a position, two
    for an inclinometer. Lengths alone give none, since some pose fits any six lengths. Rows that the others contradict
    are left out.

    Parameters
    ----------
    names
        `base_points`, `platform_points`, `leg_length_offset` (encoder reading minus length [m]), or elements.
    accuracy
        Standard errors of the log: leg length [m], position [m], orientation [rad]; see `PoseAccuracy`.
    pose_frame
        "world": poses are those of the platform in world. "own": a tracker's frame and the place of its target are
        unknown, and estimated as far as fixed joints determine them; the other joints stay as close as possible to
        their nominal places, since the base and the platform as a whole are unobservable.
    nominal_error
        Uncertainty of the nominal geometry [m]; combinations with a larger standard error count as unobservable, and
        elements that they move have no interval. By default 1 % of the platform's characteristic length.

    Raises
    ------
    IdentificationError
        No poses, names that are not geometry, nothing observable, or a geometry that the log contradicts.
    """
    elements = expanded(names, platform)
    unknowns = _unknowns(elements)
    accuracy = PoseAccuracy(*accuracy)
    sigma_length, sigma_position, sigma_turn = accuracy
    sigma_turn = sigma_position / platform.characteristic_length if sigma_turn is None else sigma_turn
    deviations = np.repeat([sigma_length, sigma_position, sigma_turn], [6, 3, 3]).astype(float)
    if not (np.isfinite(deviations).all() and (deviations > 0).all()):
        raise IdentificationError(f"accuracy is {tuple(accuracy)}; expected standard errors > 0 m, m, rad")
    measured = _measured(log, deviations, pose_frame)
    scale = _NOMINAL_SHARE * platform.characteristic_length if nominal_error is None else nominal_error
    if not (np.isfinite(scale) and scale > 0):
        raise IdentificationError(f"nominal_error is {scale!r} m; expected > 0")
    nominal = Geometry(platform.base_points, platform.platform_points, np.zeros(6))
    poses = _first_poses(platform, measured, pose_frame, log.where)
    is_known = pose_frame == "world"
    frames = SAME if is_known else guessed_frames(nominal, poses, measured)
    whole = _Calibration(measured, nominal, frames, poses, unknowns, scale, is_known)

    kept, notes = np.arange(len(log)), list[str]()
    used, fit = whole, whole.fitted()
    while (worst := used.outlier(fit)) is not None and len(notes) < max(1, int(_MOST_OUTLIERS * len(log))):
        row, size = worst
        notes.append(
            f"row {kept[row] + 1} is left out: the other rows contradict it by {size:.3g} standard errors; it was not "
            "at rest, or was read wrongly"
        )
        kept = np.delete(kept, row)
        used = whole.rows(kept)
        fit = used.fitted()
    alarms: tuple[str, ...] = ()
    if worst is not None:
        alarms = (
            f"{len(notes)} of {len(log)} rows were left out, and others are contradicted as strongly, row "
            f"{kept[worst[0]] + 1} by {worst[1]:.3g} standard errors: errors of the poses are not those of noise",
        )
    values, before = fit.geometry.numbers[unknowns], nominal_values(elements, platform)
    _check(fit, elements, log, used.measured, values - before, scale)
    aside = np.arange(max(1, round(_KEPT_ASIDE * len(kept))))[::-1]
    without = used.rows(np.arange(len(kept) - len(aside))).fitted()
    validation = _length_error(
        without.geometry, without.frames, without.poses, used.measured.rows(len(kept) - 1 - aside)
    )
    V, S = fit.directions[: fit.rank], fit.singular_values[: fit.rank]
    covariance = (fit.factor * scale) ** 2 * (V.T / S**2) @ V
    is_moved = _moved_by_unseen(fit, nominal, unknowns, is_known) * scale > _MOVED * np.sqrt(np.diag(covariance))
    covariance[is_moved] = covariance[:, is_moved] = np.nan
    notes = [
        f"residuals are {fit.factor:.3g} times the stated standard errors; intervals are scaled by this factor",
        *_unseen(
            fit, elements, scale, pose_frame, [name for name, is_it in zip(elements, is_moved, strict=True) if is_it]
        ),
        *notes,
    ]
    return Estimate(
        method="geometry",
        names=elements,
        values=values,
        nominal=before,
        covariance=covariance,
        freedom=fit.freedom if fit.freedom > 0 else np.inf,
        singular_values=fit.singular_values,
        directions=fit.directions,
        scale=np.full(len(elements), scale),
        rank=fit.rank,
        residuals=Residuals(
            "length of leg",
            "m",
            rms(_length_error(fit.geometry, fit.frames, fit.poses, used.measured)),
            rms(validation) if len(validation) else None,
            used.measured.length.std(axis=0),
            None,
        ),
        notes=tuple(notes),
        alarms=alarms,
        details={
            "poses": fit.poses,
            "frames": fit.frames,
            "nominal_rms": rms(_length_error(nominal, frames, fit.poses, used.measured)),
            "equations": fit.redundant,
            "factor": fit.factor,
        },
    )


def _moved_by_unseen(
    fit: GeometryFit, nominal: Geometry, unknowns: NDArray[np.intp], is_frame_known: bool
) -> FloatArray:
    """By how much unobservable combinations of unit size move each unknown (p,).

    In a tracker's own frame, motions of the base and of the platform as a whole are no errors of the geometry.
    """
    unseen = fit.directions[fit.rank :]
    if not is_frame_known:
        motions = np.zeros((12, _N_GEOMETRY))
        for at, points in ((0, nominal.base), (18, nominal.platform)):
            for k, axis in enumerate(np.eye(3)):
                motions[at // 3 + k, at : at + 18] = np.tile(axis, 6)
                motions[at // 3 + 3 + k, at : at + 18] = np.cross(axis, points).ravel()
        others = np.delete(motions, unknowns, axis=1)
        possible = null_space(others.T) if others.size else np.eye(12)
        rigid = orth((possible.T @ motions[:, unknowns]).T) if possible.size else np.zeros((len(unknowns), 0))
        unseen = unseen - (unseen @ rigid) @ rigid.T
    return np.asarray(np.linalg.norm(unseen, axis=0))


def _unknowns(elements: Sequence[str]) -> NDArray[np.intp]:
    """The positions of the elements in the 42 unknowns."""
    every = [f"{name}[{i + 1},{j + 1}]" for name in GEOMETRY[:2] for i in range(6) for j in range(3)]
    every += [f"{GEOMETRY[2]}[{i + 1}]" for i in range(6)]
    foreign = [name for name in elements if name not in every]
    if foreign:
        raise IdentificationError(
            f"estimate: {', '.join(foreign)} with the method geometry; expected {', '.join(GEOMETRY)} or elements "
            "of them: poses at rest carry no information on masses and friction",
            foreign,
        )
    return np.array([every.index(name) for name in elements])


def _measured(log: Log, deviations: FloatArray, pose_frame: PoseFrame) -> Measured:
    none = np.full((len(log), 3), np.nan)
    measured = Measured(
        log.leg_length,
        none if log.position is None else log.position,
        none if log.orientation is None else log.orientation,
        deviations,
    )
    known = measured.is_known
    if not known[:, :6].all():
        row = int(np.argmin(known[:, :6].all(axis=1))) + 1
        raise IdentificationError(f"{log.where}: row {row} lacks a leg length; expected all six for every pose")
    if not known[:, 6:].any():
        raise IdentificationError(
            f"{log.where}: no measured poses, and leg lengths alone do not determine the geometry: some pose fits any "
            "six of them; expected columns position[1..3] and orientation[1..3], or some of them"
        )
    parts = known[:, 9:].any(axis=1) & ~known[:, 9:].all(axis=1)
    if pose_frame == "own" and parts.any():
        raise IdentificationError(
            f"{log.where}: row {int(parts.argmax()) + 1} has some angles of three in an own frame; expected all "
            "three, or pose_frame 'world'"
        )
    return measured


def _first_poses(platform: Platform, measured: Measured, pose_frame: PoseFrame, where: str) -> Poses:
    """The measured poses if they are full and in world, else those of the nominal platform at these lengths."""
    position, orientation = np.empty((2, len(measured.length), 3))
    near = platform.home_position, platform.home_orientation
    for k, length in enumerate(measured.length):
        if pose_frame == "world" and measured.is_known[k].all():
            position[k], orientation[k] = measured.position[k], measured.orientation[k]
            continue
        try:
            pose = forward_kinematics(platform, length, *near)
        except GoughStewartError as error:
            raise IdentificationError(
                f"{where}: row {k + 1}: the nominal platform has no pose with these leg lengths ({error}); expected a "
                "log of this platform, legs in its order, lengths from joint to joint"
            ) from None
        position[k], orientation[k] = pose.position, pose.orientation
    return Poses(position, matrix_from_orientation(orientation))


def _check(
    fit: GeometryFit, elements: Sequence[str], log: Log, measured: Measured, change: FloatArray, scale: float
) -> None:
    if fit.rank == 0:
        raise IdentificationError(
            f"{log.where}: {len(log)} poses with {fit.redundant} measured numbers do not determine "
            f"{', '.join(elements)} better than to {scale:.3g} m; expected more poses, or poses that differ more",
            elements,
        )
    if fit.factor > _CONTRADICTION:
        worst = rms(_length_error(fit.geometry, fit.frames, fit.poses, measured))
        leg = int(worst.argmax())
        raise IdentificationError(
            f"{log.where}: contradicts any geometry near the nominal one: residuals are {fit.factor:.3g} times their "
            f"standard errors, leg {leg + 1} the worst with {worst[leg]:.3g} m; {_REMEDY}"
        )
    farthest = int(np.abs(change).argmax())
    if abs(change[farthest]) > _FAR * scale:
        raise IdentificationError(
            f"{log.where}: contradicts the nominal geometry: {elements[farthest]} would be {change[farthest]:.3g} m "
            f"from its nominal value; {_REMEDY}, or a nominal_error above {scale:.3g} m"
        )
    if not fit.is_converged:
        raise IdentificationError(
            f"{log.where}: the fit did not converge in {_MOST_STEPS} steps; expected more poses, poses that differ "
            "more, or a smaller nominal_error"
        )


def _length_error(geometry: Geometry, frames: Frames, poses: Poses, measured: Measured) -> FloatArray:
    """Measured minus predicted lengths (n, 6) [m] in the measured poses, or in fitted ones if some are partial.

    Of rows that have no fitted poses, with partial ones among them, there are none (0, 6).
    """
    t, R = measured.position, np.zeros((len(measured.length), 3, 3))
    full = np.asarray(measured.is_known.all(axis=1))
    R[full] = matrix_from_orientation(measured.orientation[full])
    R[full] = frames.X.T @ R[full] @ frames.Y.T
    t = (t - frames.X_t) @ frames.X - R @ frames.y
    if not full.all():
        if len(poses.position) != len(t):
            return np.zeros((0, 6))
        t = np.where(full[:, None], t, poses.position)
        R = np.where(full[:, None, None], R, poses.rotation)
    l = t[:, None] + np.einsum("nab,ib->nia", R, geometry.platform) - geometry.base
    return np.asarray(measured.length - np.linalg.norm(l, axis=-1) - geometry.offset)


def _unseen(
    fit: GeometryFit, elements: Sequence[str], scale: float, pose_frame: PoseFrame, moved: Sequence[str]
) -> list[str]:
    """What is unobservable, and which elements have no interval for it."""
    unseen = fit.directions[fit.rank :]
    if not len(unseen):
        return []
    why = "; pose_frame 'own' makes the positions of base and platform unobservable" if pose_frame == "own" else ""
    notes = [
        f"{fit.rank} of {len(elements)} combinations are observable, to better than {scale:.3g} m{why}; "
        "the others keep their nominal values: "
        + "; ".join(combination_text(row, elements) for row in unseen[:_SHOWN_UNSEEN])
        + ("; …" if len(unseen) > _SHOWN_UNSEEN else "")
    ]
    if moved:
        notes.append(f"no interval, since combinations that keep their nominal values move them: {', '.join(moved)}")
    return notes

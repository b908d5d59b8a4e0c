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
from gough_stewart.harness.identify.regressor import expanded
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
_UNKNOWNS = (
    *(f"{name}[{i + 1},{j + 1}]" for name in GEOMETRY[:2] for i in range(6) for j in range(3)),
    *(f"{GEOMETRY[2]}[{i + 1}]" for i in range(6)),
)
# Standard errors of leg length [m], position [m] and orientation [rad], by default that of the position over the
# platform's characteristic length; only their ratios matter for the values.
ACCURACY = (5e-6, 5e-5, None)
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
_CONVERGED = 1e-10  # decrease of the cost that is left, of 1 + the cost; rounding alone may make 1e-11
_REMEDY = (
    "expected legs and joints in the same order, lengths from joint to joint, poses of Op in world, or pose_frame 'own'"
)


class CalibrationState(NamedTuple):
    """All unknowns: the geometry, the frames of the measured poses, and the true poses of n rows."""

    geometry: FloatArray  # B, p and o (42,) [m]; o is encoder reading minus length
    X_t: FloatArray  # (3,) [m]
    X: FloatArray  # (3, 3)
    y: FloatArray
    Y: FloatArray
    t: FloatArray  # (n, 3) [m]
    R: FloatArray  # (n, 3, 3)

    @property
    def legs(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """B (6, 3), p (6, 3) and o (6,)."""
        return self.geometry[:18].reshape(6, 3), self.geometry[18:36].reshape(6, 3), self.geometry[36:]

    def moved(self, geometry: FloatArray, frames: FloatArray, poses: FloatArray) -> "CalibrationState":
        """Changed by (42,), by δX_t, X ← exp(δ~) X, δy, Y ← exp(δ~) Y (12,), and by δt, R ← exp(δ~) R (n, 6)."""
        turn_X, turn_Y, turn_R = (
            Rotation.from_rotvec(turn).as_matrix() for turn in (frames[3:6], frames[9:], poses[:, 3:])
        )
        X_t, y, t = self.X_t + frames[:3], self.y + frames[6:9], self.t + poses[:, :3]
        return CalibrationState(self.geometry + geometry, X_t, turn_X @ self.X, y, turn_Y @ self.Y, t, turn_R @ self.R)


class Measured(NamedTuple):
    """Lengths, positions and orientations of a log; NaN where not measured."""

    values: FloatArray  # (n, 12) [m, rad]
    deviation: FloatArray  # standard errors of the twelve numbers (12,) [m, rad]

    @property
    def is_known(self) -> NDArray[np.bool_]:
        """Which of the twelve numbers of a row are measured (n, 12)."""
        return np.asarray(np.isfinite(self.values))

    @property
    def has_rotation(self) -> NDArray[np.bool_]:
        """Which rows have a full orientation (n,)."""
        return np.asarray(self.is_known[:, 9:].all(axis=1))

    @property
    def rotations(self) -> FloatArray:
        """Of the rows with a full orientation (k, 3, 3)."""
        if not self.has_rotation.any():
            return np.zeros((0, 3, 3))
        return np.asarray(Rotation.from_euler("xyz", self.values[self.has_rotation, 9:]).as_matrix())


class Equations(NamedTuple):
    """Measured minus predicted, divided by standard errors, and derivatives of the predictions."""

    residual: FloatArray  # (n, 12), 0 where not measured
    by_pose: FloatArray  # (n, 12, 6)
    by_geometry: FloatArray  # (n, 12, 42)
    by_frames: FloatArray  # (n, 12, 12)


def equations(now: CalibrationState, measured: Measured) -> Equations:
    """The twelve equations of every row: six lengths, position, orientation; linear about the present values."""
    n, R, X = len(measured.values), now.R, now.X
    r, A = np.zeros((n, 12)), np.zeros((n, 12, 6))
    G, F = np.zeros((n, 12, 42)), np.zeros((n, 12, 12))

    base, platform, offset = now.legs
    arm = np.einsum("nab,ib->nia", R, platform)
    l = now.t[:, None] + arm - base
    L = np.linalg.norm(l, axis=-1)
    u = l / L[..., None]
    r[:, :6] = measured.values[:, :6] - L - offset
    A[:, :6] = np.concatenate([u, cross(arm, u)], axis=-1)
    back = np.einsum("nab,nia->nib", R, u)  # Rᵀ u
    for i in range(6):
        G[:, i, 3 * i : 3 * i + 3] = -u[:, i]
        G[:, i, 18 + 3 * i : 21 + 3 * i] = back[:, i]
        G[:, i, 36 + i] = 1.0

    target = R @ now.y
    seen = (now.t + target) @ X.T
    r[:, 6:9] = measured.values[:, 6:9] - seen - now.X_t
    A[:, 6:9] = np.concatenate([np.broadcast_to(X, R.shape), -X @ skew(target)], axis=-1)
    F[:, 6:9, :3], F[:, 6:9, 3:6], F[:, 6:9, 6:9] = np.eye(3), -skew(seen), X @ R

    # of the rotation if it is full, by the vector from the predicted to the measured one; single angles, of
    # inclinometers, are in world
    whole = measured.has_rotation
    if whole.any():
        predicted = Rotation.from_matrix(X @ R[whole] @ now.Y)
        r[whole, 9:] = (Rotation.from_matrix(measured.rotations) * predicted.inv()).as_rotvec()
        A[whole, 9:, 3:] = X
    if not whole.all():
        angles = orientation_from_matrix(R[~whole])
        r[~whole, 9:] = np.remainder(measured.values[~whole, 9:] - angles + np.pi, 2 * np.pi) - np.pi
        units = [orientation_rate_from_angular_velocity(angles, np.broadcast_to(e, angles.shape)) for e in np.eye(3)]
        A[~whole, 9:, 3:] = np.stack(units, axis=-1)
    F[:, 9:, 3:6], F[:, 9:, 9:] = np.eye(3), X @ R

    weight = np.where(measured.is_known, 1 / measured.deviation, 0.0)
    r = np.where(measured.is_known, r, 0.0) * weight
    return Equations(r, A * weight[..., None], G * weight[..., None], F * weight[..., None])


def with_guessed_frames(start: CalibrationState, measured: Measured) -> CalibrationState:
    """The better of two guesses of X and (y, Y), which map poses in world to measured ones.

    One from the positions alone (Kabsch, Acta Cryst. A32, 1976, 922), accurate if the target is near Op; one from the
    rotations alone (Shah, J. Mechanisms Robotics 5, 2013, 031007), accurate if they differ enough.
    """

    def nearest_rotation(matrix: FloatArray) -> FloatArray:
        U, _, Vh = np.linalg.svd(matrix)
        return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vh)]) @ Vh)

    at, turned, shown = measured.is_known[:, 6:9].all(axis=1), measured.has_rotation, measured.rotations
    seen, true, R = measured.values[at, 6:9], start.t[at], start.R[turned]
    guesses = []
    if at.any():
        guesses.append(nearest_rotation((seen - seen.mean(axis=0)).T @ (true - true.mean(axis=0))))
    if turned.any():
        # shown Yᵀ = X R: vec X and vec Yᵀ are the first singular vectors of the sum of shown ⊗ R
        K = sum(np.kron(a, b) for a, b in zip(shown, R, strict=True))
        X = np.linalg.svd(K)[0][:, 0].reshape(3, 3)
        guesses.append(nearest_rotation(X * np.sign(np.linalg.det(X))))
    made = []
    for X in guesses:
        # Y is the mean of Rᵀ Xᵀ shown; X_t and y are least squares of X_t + X R y = seen − X t
        guess = start._replace(X=X)
        if turned.any():
            guess = guess._replace(Y=nearest_rotation((np.swapaxes(X @ R, 1, 2) @ shown).sum(axis=0)))
        if at.any():
            blocks = X @ start.R[at]
            rows = np.concatenate([np.broadcast_to(np.eye(3), blocks.shape), blocks], axis=-1).reshape(-1, 6)
            places = np.linalg.lstsq(rows, (seen - true @ X.T).reshape(-1), rcond=1e-6)[0]
            guess = guess._replace(X_t=places[:3], y=places[3:])
        made.append(guess)
    return min(made, key=lambda guess: float((equations(guess, measured).residual ** 2).sum()))


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """The geometry that explains a log best, and stays nominal where it is unobservable."""

    found: CalibrationState
    singular_values: FloatArray  # (k,) in units of 1/scale
    directions: FloatArray  # (p, p), of the unknowns, the observable ones first
    rank: int  # of these, how many are observable
    cost: float  # ∑ (residual / standard error)²
    redundant: int  # measured numbers of poses
    freedom: int  # of the residuals
    is_converged: bool

    @property
    def factor(self) -> float:
        """Residuals in stated standard errors; without redundancy to estimate it from, 1."""
        return float(np.sqrt(self.cost / self.freedom)) if self.freedom > 0 else 1.0


@dataclass(frozen=True, eq=False)
class _Calibration:
    """A log of poses, and what is estimated from it."""

    measured: Measured
    start: CalibrationState  # with the nominal geometry
    unknowns: NDArray[np.intp]  # which of the 42 numbers are estimated (p,)
    scale: float  # uncertainty of the nominal geometry [m]
    is_frame_known: bool

    def rows(self, chosen: NDArray[np.intp]) -> "_Calibration":
        """The same with some of the rows."""
        start = self.start._replace(t=self.start.t[chosen], R=self.start.R[chosen])
        return replace(self, measured=self.measured._replace(values=self.measured.values[chosen]), start=start)

    def fitted(self) -> GeometryFit:
        """The best fit among the geometries that differ from the nominal one in observable combinations only.

        First all unknowns d, in units of `scale`, are fitted with the nominal geometry as prior knowledge, |d|² ≤ 1:
        a problem with one solution. With z = Z d the equations there, Z = U S Vᵀ, the directions V₁ with a standard
        error 1/S below 1, that is, `scale`, are observable; in these the fit is repeated without prior knowledge.
        """
        p = len(self.unknowns)
        near, is_near = self._minimised(self.start, np.eye(p), prior=1.0)
        _, _, Z, F = self._eliminated(near)
        tall = np.pad(_beside(Z, F), ((0, max(0, p - len(Z))), (0, 0)))
        _, S, V = np.linalg.svd(np.linalg.qr(tall, mode="r"))
        rank = int((S > 1).sum())
        geometry = self.start.geometry.copy()
        change = (near.geometry - geometry)[self.unknowns]
        geometry[self.unknowns] += V[:rank].T @ (V[:rank] @ change)
        best, is_best = self._minimised(near._replace(geometry=geometry), V[:rank], prior=0.0)
        now, _, Z, F = self._eliminated(best)
        if rank:
            _, S[:rank], turned = np.linalg.svd(np.linalg.qr(_beside(Z, F) @ V[:rank].T, mode="r"))
            V[:rank] = turned @ V[:rank]
        redundant = int(self.measured.is_known[:, 6:].sum())
        of_frames = int(np.linalg.matrix_rank(F, tol=1e-9 * np.linalg.norm(F))) if F.size else 0
        cost, freedom = float((now.residual**2).sum()), redundant - rank - of_frames
        return GeometryFit(best, S, V, rank, cost, redundant, freedom, is_near and is_best)

    def _minimised(self, now: CalibrationState, basis: FloatArray, prior: float) -> tuple[CalibrationState, bool]:
        """Gauss–Newton over d in the span of `basis` (k, p), frames and poses; whether it converged.

        Minimises the sum of squared residuals + prior |d|².
        """
        for _ in range(_MOST_STEPS):
            d = (now.geometry - self.start.geometry)[self.unknowns] / self.scale
            linear, z, Z, F = self._eliminated(now)
            columns = np.block([[Z @ basis.T, F], [np.sqrt(prior) * basis.T, np.zeros((len(d), F.shape[1]))]])
            x = np.linalg.lstsq(columns, np.concatenate([z, -np.sqrt(prior) * d]), rcond=1e-12)[0]
            step, geometry, frames = x[: len(basis)] @ basis, np.zeros(42), np.zeros(12)
            geometry[self.unknowns], frames[: F.shape[1]] = self.scale * step, x[len(basis) :]
            change = linear.by_geometry @ geometry + linear.by_frames @ frames
            Q, R = np.linalg.qr(linear.by_pose)
            of_poses = np.swapaxes(Q, 1, 2) @ (linear.residual - change)[..., None]
            poses = np.linalg.solve(R, of_poses)[..., 0]
            left = float(((columns @ x) ** 2).sum() + (of_poses**2).sum())
            before, share = float((linear.residual**2).sum() + prior * d @ d), 1.0
            for _ in range(_MOST_HALVINGS):
                tried, e = now.moved(share * geometry, share * frames, share * poses), d + share * step
                cost = float((equations(tried, self.measured).residual ** 2).sum() + prior * e @ e)
                if cost <= before * (1 + 1e-9) + 1e-12:
                    break
                share /= 2
            else:
                return now, False
            now = tried
            if left <= _CONVERGED * (1 + before):
                return now, True
        return now, False

    def _eliminated(self, now: CalibrationState) -> tuple[Equations, FloatArray, FloatArray, FloatArray]:
        """The equations; and without poses their residual (6 n,), Z (6 n, p), and F (6 n, 12), or (6 n, 0) in world.

        Without poses: Nᵀ times every row's equations, where Nᵀ A = 0 with A the derivatives by the pose.
        """
        linear = equations(now, self.measured)
        back = np.swapaxes(np.linalg.qr(linear.by_pose, mode="complete")[0][:, :, 6:], 1, 2)
        Z = self.scale * (back @ linear.by_geometry[:, :, self.unknowns])
        F = back @ linear.by_frames[:, :, : 0 if self.is_frame_known else 12]
        z = (back @ linear.residual[..., None]).ravel()
        return linear, z, Z.reshape(len(z), -1), F.reshape(len(z), -1)

    def outlier(self, fit: GeometryFit) -> tuple[int, float] | None:
        """The row that the others contradict most, and its residuals in standard errors; None if none does.

        A fit without row k has a cost that is smaller by Δ = eᵀ (1 − H)⁻¹ e, e and H = Q Qᵀ its residuals and its
        block of the hat matrix; (Δ/q)/((cost − Δ)/(ν − q)) has the distribution F(q, ν − q).
        """
        _, z, Z, F = self._eliminated(fit.found)
        Q = orth(np.concatenate([Z @ fit.directions[: fit.rank].T, F], axis=1), rcond=1e-10)
        e = (z - Q @ (Q.T @ z)).reshape(len(self.measured.values), -1)
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

    def moved_by_unseen(self, fit: GeometryFit) -> FloatArray:
        """By how much unobservable combinations of unit size move each unknown (p,).

        In a tracker's own frame, motions of the base and of the platform as a whole are no errors of the geometry.
        """
        unseen = fit.directions[fit.rank :]
        if not self.is_frame_known:
            motions = np.zeros((12, 42))
            for k, points in enumerate(self.start.legs[:2]):
                for j, axis in enumerate(np.eye(3)):
                    motions[6 * k + j, 18 * k : 18 * k + 18] = np.tile(axis, 6)
                    motions[6 * k + 3 + j, 18 * k : 18 * k + 18] = np.cross(axis, points).ravel()
            others = np.delete(motions, self.unknowns, axis=1)
            possible = null_space(others.T) if others.size else np.eye(12)
            rigid = orth((possible.T @ motions[:, self.unknowns]).T) if possible.size else np.zeros((len(unseen.T), 0))
            unseen = unseen - (unseen @ rigid) @ rigid.T
        return np.asarray(np.linalg.norm(unseen, axis=0))


def _beside(Z: FloatArray, F: FloatArray) -> FloatArray:
    """What of the columns Z the columns F do not explain."""
    Q = orth(F, rcond=1e-10) if F.size else F
    return np.asarray(Z - Q @ (Q.T @ Z))


def identify_geometry(  # noqa: PLR0912, PLR0915 - one station after the other
    log: Log,
    platform: Platform,
    names: Sequence[str] = GEOMETRY,
    *,
    accuracy: tuple[float, float, float | None] = ACCURACY,
    pose_frame: PoseFrame = "world",
    nominal_error: float | None = None,
) -> Estimate:
    """Joint points and leg offsets from poses at rest: least squares of lengths and poses, both with errors.

    Minimises ∑ (L − |t + R p − B| − o)²/σ_L² + ∑ (pose − measured)²/σ² over geometry and true poses, an
    errors-in-variables problem. A row gives as many equations as it has numbers of its pose: three for a position, two
    for an inclinometer. Lengths alone give none, since some pose fits any six lengths. Rows that the others contradict
    are left out.
    """
    elements = expanded(names)
    foreign = [name for name in elements if name not in _UNKNOWNS]
    if foreign:
        raise IdentificationError(
            f"estimate: {', '.join(foreign)} with the method geometry; expected {', '.join(GEOMETRY)} or elements "
            "of them: poses at rest carry no information on masses and friction",
            foreign,
        )
    unknowns = np.array([_UNKNOWNS.index(name) for name in elements])
    sigma_length, sigma_position, sigma_turn = accuracy
    sigma_turn = sigma_position / platform.characteristic_length if sigma_turn is None else sigma_turn
    deviations = np.repeat([sigma_length, sigma_position, sigma_turn], [6, 3, 3]).astype(float)
    if not (np.isfinite(deviations).all() and (deviations > 0).all()):
        raise IdentificationError(f"accuracy is {tuple(accuracy)}; expected standard errors > 0 m, m, rad")
    none = np.full((len(log), 3), np.nan)
    pose = (none if values is None else values for values in (log.position, log.orientation))
    measured = Measured(np.concatenate([log.leg_length, *pose], axis=1), deviations)
    known = measured.is_known
    if not known[:, :6].all():
        row = int(np.argmin(known[:, :6].all(axis=1))) + 1
        raise IdentificationError(f"{log.where}: row {row} lacks a leg length; expected all six for every pose")
    if not known[:, 6:].any():
        raise IdentificationError(
            f"{log.where}: no measured poses, and leg lengths alone do not determine the geometry: some pose fits any "
            "six of them; expected columns position[1..3] and orientation[1..3], or some of them"
        )
    partial = known[:, 9:].any(axis=1) & ~known[:, 9:].all(axis=1)
    if pose_frame == "own" and partial.any():
        raise IdentificationError(
            f"{log.where}: row {int(partial.argmax()) + 1} has some angles of three in an own frame; expected all "
            "three, or pose_frame 'world'"
        )
    scale = _NOMINAL_SHARE * platform.characteristic_length if nominal_error is None else nominal_error
    if not (np.isfinite(scale) and scale > 0):
        raise IdentificationError(f"nominal_error is {scale!r} m; expected > 0")
    nominal = np.concatenate([platform.base_points.ravel(), platform.platform_points.ravel(), np.zeros(6)])
    # the measured poses if they are full and in world, else those of the nominal platform at these lengths
    is_known, first = pose_frame == "world", measured.values[:, 6:].copy()
    for k in np.flatnonzero(~(known.all(axis=1) & is_known)):
        try:
            at = platform.home_position, platform.home_orientation
            near = forward_kinematics(platform, measured.values[k, :6], *at)
        except GoughStewartError as error:
            raise IdentificationError(
                f"{log.where}: row {k + 1}: the nominal platform has no pose with these leg lengths ({error}); "
                "expected a log of this platform, legs in its order, lengths from joint to joint"
            ) from None
        first[k] = np.concatenate([near.position, near.orientation])
    poses = first[:, :3], matrix_from_orientation(first[:, 3:])
    start = CalibrationState(nominal, np.zeros(3), np.eye(3), np.zeros(3), np.eye(3), *poses)
    start = start if is_known else with_guessed_frames(start, measured)
    whole = _Calibration(measured, start, unknowns, scale, is_known)

    # rows that the others contradict are left out, one after the other
    kept, left_out = np.arange(len(log)), list[str]()
    used, fit = whole, whole.fitted()
    while (worst := used.outlier(fit)) is not None and len(left_out) < max(1, int(_MOST_OUTLIERS * len(log))):
        row, size = worst
        left_out.append(
            f"row {kept[row] + 1} is left out: the other rows contradict it by {size:.3g} standard errors; it was not "
            "at rest, or was read wrongly"
        )
        kept = np.delete(kept, row)
        used = whole.rows(kept)
        fit = used.fitted()
    alarms: tuple[str, ...] = ()
    if worst is not None:
        alarms = (
            f"{len(left_out)} of {len(log)} rows were left out, and others are contradicted as strongly, row "
            f"{kept[worst[0]] + 1} by {worst[1]:.3g} standard errors: errors of the poses are not those of noise",
        )
    values, before = fit.found.geometry[unknowns], nominal_values(elements, platform)
    errors = rms(_length_error(fit.found, used.measured))
    change = values - before
    leg, farthest = int(errors.argmax()), int(np.abs(change).argmax())
    if fit.rank == 0:
        raise IdentificationError(
            f"{log.where}: {len(log)} poses with {fit.redundant} measured numbers do not determine "
            f"{', '.join(elements)} better than to {scale:.3g} m; expected more poses, or poses that differ more",
            elements,
        )
    if fit.factor > _CONTRADICTION:
        raise IdentificationError(
            f"{log.where}: contradicts any geometry near the nominal one: residuals are {fit.factor:.3g} times their "
            f"standard errors, leg {leg + 1} the worst with {errors[leg]:.3g} m; {_REMEDY}"
        )
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

    # a second fit, without the last rows
    aside = np.arange(max(1, round(_KEPT_ASIDE * len(kept))))[::-1]
    without = used.rows(np.arange(len(kept) - len(aside))).fitted()
    last = used.measured._replace(values=used.measured.values[len(kept) - 1 - aside])
    validation = _length_error(without.found, last)

    V, S = fit.directions[: fit.rank], fit.singular_values[: fit.rank]
    covariance = (fit.factor * scale) ** 2 * (V.T / S**2) @ V
    is_moved = used.moved_by_unseen(fit) * scale > _MOVED * np.sqrt(np.diag(covariance))
    covariance[is_moved] = covariance[:, is_moved] = np.nan
    notes = [f"residuals are {fit.factor:.3g} times the stated standard errors; intervals are scaled by this factor"]
    unseen = fit.directions[fit.rank :]
    if len(unseen):
        own = "; pose_frame 'own' makes the positions of base and platform unobservable" if not is_known else ""
        notes.append(
            f"{fit.rank} of {len(elements)} combinations are observable, to better than {scale:.3g} m{own}; "
            "the others keep their nominal values: "
            + "; ".join(combination_text(row, elements) for row in unseen[:_SHOWN_UNSEEN])
            + ("; …" if len(unseen) > _SHOWN_UNSEEN else "")
        )
    moved = [name for name, is_it in zip(elements, is_moved, strict=True) if is_it]
    if moved:
        notes.append(f"no interval, since combinations that keep their nominal values move them: {', '.join(moved)}")
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
            errors,
            rms(validation) if len(validation) else None,
            used.measured.values[:, :6].std(axis=0),
            None,
        ),
        notes=(*notes, *left_out),
        alarms=alarms,
        details={"found": fit.found, "factor": fit.factor},
    )


def _length_error(found: CalibrationState, measured: Measured) -> FloatArray:
    """Measured minus predicted lengths (n, 6) [m] in the measured poses, or in fitted ones if some are partial.

    Of rows that have no fitted poses, with partial ones among them, there are none (0, 6).
    """
    full = np.asarray(measured.is_known.all(axis=1))
    R = np.zeros((len(full), 3, 3))
    R[full] = found.X.T @ matrix_from_orientation(measured.values[full, 9:]) @ found.Y.T
    t = (measured.values[:, 6:9] - found.X_t) @ found.X - R @ found.y
    if not full.all():
        if len(found.t) != len(t):
            return np.zeros((0, 6))
        t = np.where(full[:, None], t, found.t)
        R = np.where(full[:, None, None], R, found.R)
    base, platform, offset = found.legs
    l = t[:, None] + np.einsum("nab,ib->nia", R, platform) - base
    return np.asarray(measured.values[:, :6] - np.linalg.norm(l, axis=-1) - offset)

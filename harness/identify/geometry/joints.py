"""Joints and leg offsets from leg lengths and full or partial poses; unobservable combinations stay nominal."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import Estimate, Residuals, combination_text, nominal_values
from gough_stewart.harness.identify.geometry.equations import SAME, Geometry, Measured, Poses, equations
from gough_stewart.harness.identify.geometry.fit import Fit, fitted
from gough_stewart.harness.identify.geometry.frames import guessed_frames
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import expanded
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.forward_kinematics import forward_kinematics
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

PoseFrame = Literal["world", "own"]
GEOMETRY = ("base_points", "platform_points", "leg_length_offset")
# Default uncertainty of the nominal geometry, as a share of the platform's size.
_NOMINAL_SHARE = 0.01
# Larger residuals, in standard errors, are not noise, and the row is an outlier.
_CONTRADICTION, _OUTLIER = 100.0, 6.0
# Share of the rows, at the end, that a second fit leaves out.
_KEPT_ASIDE = 0.2
_FAR = 10.0  # times nominal_error: a different geometry, not an error of this one
_SHOWN_UNSEEN = 3
_REMEDY = (
    "expected legs and joints in the same order, lengths from joint to joint, poses of Op in world, or pose_frame 'own'"
)


class PoseAccuracy(NamedTuple):
    """Standard errors of the measurements; only their ratios matter for the values."""

    leg_length: float = 5e-6  # [m]
    position: float = 5e-5  # [m]
    orientation: float | None = None  # [rad]; that of the position over the platform's characteristic length


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
    for an inclinometer. Lengths alone give none, since some pose fits any six lengths.

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
        Uncertainty of the nominal geometry [m]; combinations with a larger standard error count as unobservable.
        By default 1 % of the platform's characteristic length.

    Raises
    ------
    IdentificationError
        No poses, names that are not geometry, nothing observable, or a geometry that the log contradicts.
    """
    elements = expanded(names, platform)
    unknowns = _unknowns(elements)
    deviations = _deviations(PoseAccuracy(*accuracy), platform)
    measured = _measured(log, deviations, pose_frame)
    scale = _NOMINAL_SHARE * platform.characteristic_length if nominal_error is None else nominal_error
    if not (np.isfinite(scale) and scale > 0):
        raise IdentificationError(f"nominal_error is {scale!r} m; expected > 0")
    nominal = Geometry(platform.base_points, platform.platform_points, np.zeros(6))
    poses = _first_poses(platform, measured, pose_frame, log.where)
    frames = SAME if pose_frame == "world" else guessed_frames(nominal, poses, measured)

    def fit(rows: slice) -> Fit:
        some = Measured(measured.length[rows], measured.position[rows], measured.orientation[rows], measured.deviation)
        begun = Poses(poses.position[rows], poses.rotation[rows])
        return fitted(nominal, frames, begun, some, unknowns, scale, is_frame_known=pose_frame == "world")

    found = fit(slice(None))
    redundant = int(measured.is_known[:, 6:].sum())
    freedom = redundant - found.rank - _seen_of_frames(found, measured, pose_frame)
    every = np.concatenate([found.geometry.base.ravel(), found.geometry.platform.ravel(), found.geometry.offset])
    values, before = every[unknowns], nominal_values(elements, platform)
    # without redundancy to estimate the errors from, the stated ones are used
    factor = float(np.sqrt(found.cost / freedom)) if freedom > 0 else 1.0
    _check(found, redundant, factor, elements, log, measured, values - before, scale)
    kept = max(1, round(_KEPT_ASIDE * len(log)))
    aside = _length_error(fit(slice(0, -kept)), measured, slice(-kept, None))
    V, S = found.directions[: found.rank], found.singular_values[: found.rank]
    covariance = (factor * scale) ** 2 * (V.T / S**2) @ V
    length_rms = _rms(_length_error(found, measured, slice(None)))
    return Estimate(
        method="geometry",
        names=elements,
        values=values,
        nominal=before,
        covariance=covariance,
        singular_values=found.singular_values,
        directions=found.directions,
        scale=np.full(len(elements), scale),
        rank=found.rank,
        residuals=Residuals(
            "length of leg", "m", length_rms, _rms(aside) if len(aside) else None, measured.length.std(axis=0), None
        ),
        notes=tuple(_notes(found, measured, elements, factor, scale, pose_frame)),
        details={
            "poses": found.poses,
            "frames": found.frames,
            "nominal_rms": _rms(_length_error(found._replace(geometry=nominal, frames=frames), measured, slice(None))),
            "equations": redundant,
            "factor": factor,
        },
    )


def _unknowns(elements: Sequence[str]) -> FloatArray:
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


def _deviations(accuracy: PoseAccuracy, platform: Platform) -> FloatArray:
    orientation = accuracy.orientation
    if orientation is None:
        orientation = accuracy.position / platform.characteristic_length
    deviations = np.repeat([accuracy.leg_length, accuracy.position, orientation], [6, 3, 3]).astype(float)
    if not (np.isfinite(deviations).all() and (deviations > 0).all()):
        raise IdentificationError(f"accuracy is {tuple(accuracy)}; expected standard errors > 0 m, m, rad")
    return deviations


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
            found = forward_kinematics(platform, length, *near)
        except GoughStewartError as error:
            raise IdentificationError(
                f"{where}: row {k + 1}: the nominal platform has no pose with these leg lengths ({error}); expected a "
                "log of this platform, legs in its order, lengths from joint to joint"
            ) from None
        position[k], orientation[k] = found.position, found.orientation
    return Poses(position, matrix_from_orientation(orientation))


def _seen_of_frames(found: Fit, measured: Measured, pose_frame: PoseFrame) -> int:
    """How many of the twelve numbers of the frames are observable."""
    if pose_frame == "world":
        return 0
    F = equations(found.geometry, found.frames, found.poses, measured).by_frames.reshape(-1, 12)
    return int(np.linalg.matrix_rank(F, tol=1e-9 * np.linalg.norm(F)))


def _check(
    found: Fit,
    redundant: int,
    factor: float,
    elements: Sequence[str],
    log: Log,
    measured: Measured,
    change: FloatArray,
    scale: float,
) -> None:
    if found.rank == 0:
        raise IdentificationError(
            f"{log.where}: {len(log)} poses with {redundant} measured numbers do not determine "
            f"{', '.join(elements)} better than to {scale:.3g} m; expected more poses, or poses that differ more",
            elements,
        )
    if factor > _CONTRADICTION or not found.is_converged:
        worst = _rms(_length_error(found, measured, slice(None)))
        leg = int(worst.argmax())
        raise IdentificationError(
            f"{log.where}: contradicts any geometry near the nominal one: residuals are {factor:.3g} times their "
            f"standard errors, leg {leg + 1} the worst with {worst[leg]:.3g} m; {_REMEDY}"
        )
    farthest = int(np.abs(change).argmax())
    if abs(change[farthest]) > _FAR * scale:
        raise IdentificationError(
            f"{log.where}: contradicts the nominal geometry: {elements[farthest]} would be {change[farthest]:.3g} m "
            f"from its nominal value; {_REMEDY}, or a nominal_error above {scale:.3g} m"
        )


def _length_error(found: Fit, measured: Measured, rows: slice) -> FloatArray:
    """Measured minus predicted lengths (n, 6) [m] in the measured poses, or in fitted ones if some are partial."""
    geometry, frames = found.geometry, found.frames
    t, R, length = measured.position[rows], np.zeros((len(measured.length[rows]), 3, 3)), measured.length[rows]
    whole = np.asarray(measured.is_known[rows].all(axis=1))
    R[whole] = matrix_from_orientation(measured.orientation[rows][whole])
    R[whole] = frames.X.T @ R[whole] @ frames.Y.T
    t = (t - frames.X_t) @ frames.X - R @ frames.y
    fitted_all = len(found.poses.position) == len(length)
    if not whole.all():
        if not fitted_all:
            return np.zeros((0, 6))
        t = np.where(whole[:, None], t, found.poses.position)
        R = np.where(whole[:, None, None], R, found.poses.rotation)
    l = t[:, None] + np.einsum("nab,ib->nia", R, geometry.platform) - geometry.base
    return np.asarray(length - np.linalg.norm(l, axis=-1) - geometry.offset)


def _rms(errors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((errors**2).mean(axis=0)))


def _notes(
    found: Fit, measured: Measured, elements: Sequence[str], factor: float, scale: float, pose_frame: PoseFrame
) -> list[str]:
    notes = [f"residuals are {factor:.3g} times the stated standard errors; intervals are scaled by this factor"]
    unseen = found.directions[found.rank :]
    if len(unseen):
        why = "; pose_frame 'own' makes the positions of base and platform unobservable" if pose_frame == "own" else ""
        notes.append(
            f"{found.rank} of {len(elements)} combinations are observable, to better than {scale:.3g} m{why}; "
            "the others keep their nominal values, and intervals leave them out: "
            + "; ".join(combination_text(row, elements) for row in unseen[:_SHOWN_UNSEEN])
            + ("; …" if len(unseen) > _SHOWN_UNSEEN else "")
        )
    r = equations(found.geometry, found.frames, found.poses, measured).residual
    free = np.maximum(measured.is_known[:, 6:].sum(axis=1), 1)
    size = np.sqrt((r**2).sum(axis=1) / free) / np.median(np.sqrt((r**2).sum(axis=1) / free))
    notes += [
        f"the residuals of row {k + 1} are {size[k]:.3g} times those of most rows; remove it if it was not at rest"
        for k in np.flatnonzero(size > _OUTLIER)
    ]
    return notes

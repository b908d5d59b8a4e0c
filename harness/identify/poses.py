"""The poses of a log of leg lengths: their table, and a report of how sure they are."""

from io import BytesIO
from typing import NamedTuple

import numpy as np
import polars

from gough_stewart.harness.errors import LogError, MotionError
from gough_stewart.harness.identify.log import Log, check_poses
from gough_stewart.harness.motion.recorded.recording import LegLengths, absolute_lengths, poses_of_lengths
from gough_stewart.harness.pose_convention import OURS, QUATERNION, PoseConvention
from gough_stewart.harness.report.chart import Axis, Chart, Series, time_axis
from gough_stewart.harness.report.document import Column, Note, Number, Report, Section, Status, Table, Value, Verdict
from gough_stewart.harness.report.quantities import ANGLE, COUNT, LENGTH, NUMBER, POSITION, counted, sentence
from gough_stewart.model.forward_kinematics import ForwardKinematics
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

FILES = ("poses.csv", "poses.parquet")
NUMBERS = ("rows", "residual", "condition_number", "stroke", "deviation")
_DRAWN = 2000  # rows of charts
_COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")


class Poses(NamedTuple):
    """The poses of a log."""

    found: ForwardKinematics
    lengths: FloatArray  # (n, 6), absolute [m]
    table: polars.DataFrame  # in the convention that was asked for, SI units

    @property
    def files(self) -> dict[str, bytes]:
        """The table as CSV and Parquet."""
        parquet = BytesIO()
        self.table.write_parquet(parquet)
        return dict(zip(FILES, (self.table.write_csv().encode(), parquet.getvalue()), strict=True))


def poses_of_log(
    log: Log, platform: Platform, leg_lengths: LegLengths = "absolute", convention: PoseConvention = OURS
) -> Poses:
    """The poses with the leg lengths of a log, each beside its residual and condition number."""
    lengths = absolute_lengths(platform, log.leg_length, leg_lengths)
    check_poses(log, platform, lengths)
    try:
        found = poses_of_lengths(platform, lengths, conditioning=True)
        position, turning = convention.written(found.position, found.orientation)
    except (MotionError, ValueError) as error:
        raise LogError(f"{log.where}: {error}") from error
    kind = "quaternion" if convention.rotation_order == QUATERNION else "orientation"
    columns = {} if log.time is None else {"time": log.time}
    for name, values in (("position", position), (kind, turning)):
        columns |= {f"{name}[{k + 1}]": values[:, k] for k in range(values.shape[1])}
    columns |= {"residual": np.asarray(found.residual), "condition_number": np.asarray(found.condition_number)}
    return Poses(found, lengths, polars.DataFrame(columns))


def pose_charts(along: Axis, position: FloatArray, orientation: FloatArray) -> list[Chart]:
    """Positions (n, 3) [m] and angles (n, 3) [rad] along an axis."""
    charts = []
    for name, quantity, values, first in (("position", LENGTH, position, 0), ("orientation", ANGLE, orientation, 3)):
        coordinates = enumerate(_COORDINATES[first : first + 3])
        series = tuple(Series(axis, quantity, values[:, k], component=axis) for k, axis in coordinates)
        charts.append(Chart(name, along, series, y=Axis(name, quantity), group="pose"))
    return charts


def poses_report(poses: Poses, log: Log, platform: Platform, convention: PoseConvention = OURS) -> Report:
    """The report of the poses of a log."""
    found, n, title = poses.found, len(poses.lengths), f"Poses of {platform.name}"
    known = np.asarray(found.converged)
    residual, condition = np.asarray(found.residual)[known], np.asarray(found.condition_number)[known]
    numbers = [Number("rows.poses", "rows with a pose", float(known.sum()), COUNT)]
    numbers.append(Number("rows.gaps", "rows without all lengths", float(n - known.sum()), COUNT))
    if not known.any():
        text = f"none of {counted(n, 'row')} has six lengths"
        return Report(title, Verdict(sentence([text]), "bad", tuple(numbers)), study="poses")
    least, worst = float(condition.min()), float(condition.max())
    numbers += [
        Number("residual", "largest error of a leg length", float(residual.max()), LENGTH),
        Number("condition_number", "largest condition number", worst, low=least, high=worst),
    ]
    parts: list[str | None] = [
        f"{counted(int(known.sum()), 'row')} of {n:,} {'has' if known.sum() == 1 else 'have'} a pose",
        f"largest error of a length {LENGTH.text(float(residual.max()))}",
        f"condition number {NUMBER.text(least)} to {NUMBER.text(worst)}, the largest in row "
        f"{np.flatnonzero(known)[condition.argmax()] + 1}",
    ]
    status: Status = "good" if known.all() else "told"
    notes = [Note(f"Poses are written with {convention.settings}.")] if convention != OURS else []
    if convention.is_left_handed:
        notes.append(Note("The frame of the poses written is left-handed (mirrored).", "warning"))

    # the least distance from an end of the stroke
    low, high = platform.leg_length_min, platform.leg_length_max
    beyond = None
    if low is not None or high is not None:
        lengths = poses.lengths[known]
        margins = (lengths - (-np.inf if low is None else low), (np.inf if high is None else high) - lengths)
        margin = float(min(of_end.min() for of_end in margins))
        numbers.append(Number("stroke.margin", "least distance from an end of the stroke", margin, LENGTH))
        if margin < 0:
            excess = LENGTH.text(-margin)
            status, beyond = "marginal", f"lengths up to {excess} beyond the stroke"
            notes.append(Note(f"Lengths are up to {excess} beyond the stroke of {platform.name}.", "warning"))

    # the largest distance and angle from poses that were measured beside the lengths
    pose = np.hstack([found.position, found.orientation])
    R = matrix_from_orientation(found.orientation)
    if log.position is not None and log.orientation is not None:
        away = float(np.nanmax(np.linalg.norm(found.position - log.position, axis=1)))
        # |R − R_m| = 2√2 sin(φ/2), exact also for small angles
        chord = np.linalg.norm(R - matrix_from_orientation(log.orientation), axis=(1, 2))
        turned = float(np.nanmax(2 * np.arcsin(np.clip(chord / np.sqrt(8), 0.0, 1.0))))
        numbers += [
            Number("deviation.position", "largest deviation from the measured position", away, LENGTH),
            Number("deviation.orientation", "largest deviation from the measured orientation", turned, ANGLE),
        ]
        parts.append(f"largest deviation from the measured poses {LENGTH.text(away)} and {ANGLE.text(turned)}")
        # the point that measured positions are of, if one point at Rᵀ (p_m − p) explains most of their deviation
        offsets = np.einsum("nji,nj->ni", R, log.position - found.position)
        offset = np.nanmean(offsets, axis=0)
        left = float(np.nanmax(np.linalg.norm(offsets - offset, axis=1)))
        size = float(np.abs(log.leg_length[np.isfinite(log.leg_length)]).max())
        if away > max(5 * left, 1e-6 * size):
            at = f"pivot = {np.round(offset + log.convention.pivot, 6).tolist()} m, within {LENGTH.text(left)}"
            notes.append(Note(f"The measured positions fit another pivot than the one read: {at}.", "warning"))
    parts.append(beyond)

    ranges = Table(
        "Range of the poses",
        (Column("coordinate"), Column("from"), Column("to")),
        tuple(
            (name, *(Value(float(end(pose[known, k])), POSITION if k < 3 else ANGLE) for end in (np.min, np.max)))
            for k, name in enumerate(_COORDINATES)
        ),
    )
    rows = np.unique(np.linspace(0, n - 1, _DRAWN).astype(int))
    along = Axis("row", COUNT, rows + 1.0) if log.time is None else time_axis(log.time[rows])
    charts = pose_charts(along, pose[rows, :3], pose[rows, 3:])
    return Report(
        title,
        Verdict(sentence(parts), status, tuple(numbers)),
        (Section("Poses", (ranges, *charts)),),
        study="poses",
        lead=f"{counted(n, 'row')} of {log.where}, by forward kinematics from the home pose",
        numbers=tuple(numbers),
        notes=tuple(notes),
    )

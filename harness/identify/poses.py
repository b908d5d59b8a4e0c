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
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict
from gough_stewart.harness.report.quantities import ANGLE, COUNT, LENGTH, NUMBER, POSITION, Quantity
from gough_stewart.harness.report.table import Column, Table, Value
from gough_stewart.harness.report.words import counted, sentence
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
    """The poses with the leg lengths of a log, each beside its residual and condition number.

    Parameters
    ----------
    leg_lengths
        Whether the log has lengths, or changes from those at home.
    convention
        How the poses are written.

    Raises
    ------
    LogError
        Lengths that no pose has; measured poses that contradict the lengths, and not in another convention; angles
        that the convention does not have; names the row.
    """
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


def poses_report(poses: Poses, log: Log, platform: Platform, convention: PoseConvention = OURS) -> Report:
    """The report of the poses of a log."""
    found, n = poses.found, len(poses.lengths)
    known = np.asarray(found.converged)
    residual, condition = np.asarray(found.residual)[known], np.asarray(found.condition_number)[known]
    numbers = [Number("rows.poses", "rows with a pose", float(known.sum()), COUNT)]
    numbers.append(Number("rows.gaps", "rows without all lengths", float(n - known.sum()), COUNT))
    if not known.any():
        text = f"none of {counted(n, 'row')} has six lengths"
        return Report(_title(platform), Verdict(sentence([text]), "bad", tuple(numbers)), study="poses")
    least, worst = float(condition.min()), float(condition.max())
    numbers += [
        Number("residual", "largest error of a leg length", float(residual.max()), LENGTH),
        Number("condition_number", "largest condition number", worst, low=least, high=worst),
    ]
    notes = [Note(f"Poses are written with {convention.settings}.")] if convention != OURS else []
    if convention.is_left_handed:
        notes.append(Note("The frame of the poses written is left-handed (mirrored).", "warning"))
    margin = _stroke_margin(platform, poses.lengths[known])
    if margin is not None:
        numbers.append(Number("stroke.margin", "least distance from an end of the stroke", margin, LENGTH))
        if margin < 0:
            beyond = f"Lengths are up to {LENGTH.text(-margin)} beyond the stroke of {platform.name}."
            notes.append(Note(beyond, "warning"))
    away = _deviation(found, log)
    if away is not None:
        numbers += [
            Number("deviation.position", "largest deviation from the measured position", away[0], LENGTH),
            Number("deviation.orientation", "largest deviation from the measured orientation", away[1], ANGLE),
        ]
        pivot = _pivot(found, log, away[0])
        if pivot is not None:
            notes.append(Note(f"The measured positions fit another pivot than the one read: {pivot}.", "warning"))
    text = sentence(
        [
            f"{counted(int(known.sum()), 'row')} of {n:,} {'has' if known.sum() == 1 else 'have'} a pose",
            f"largest error of a length {LENGTH.text(float(residual.max()))}",
            f"condition number {NUMBER.text(least)} to {NUMBER.text(worst)}, the largest in row "
            f"{np.flatnonzero(known)[condition.argmax()] + 1}",
            away and f"largest deviation from the measured poses {LENGTH.text(away[0])} and {ANGLE.text(away[1])}",
            None if margin is None or margin >= 0 else f"lengths up to {LENGTH.text(-margin)} beyond the stroke",
        ]
    )
    status: Status = "good" if known.all() else "told"
    if margin is not None and margin < 0:
        status = "marginal"
    pose = np.hstack([found.position, found.orientation])
    ranges = Table(
        "Range of the poses",
        (Column("coordinate"), Column("from"), Column("to")),
        tuple(
            (name, *(Value(float(end(pose[known, k])), POSITION if k < 3 else ANGLE) for end in (np.min, np.max)))
            for k, name in enumerate(_COORDINATES)
        ),
    )
    return Report(
        _title(platform),
        Verdict(text, status, tuple(numbers)),
        (Section("Poses", (ranges, *_charts(log, pose))),),
        study="poses",
        lead=f"{counted(n, 'row')} of {log.where}, by forward kinematics from the home pose",
        numbers=tuple(numbers),
        notes=tuple(notes),
    )


def _title(platform: Platform) -> str:
    return f"Poses of {platform.name}"


def _stroke_margin(platform: Platform, lengths: FloatArray) -> float | None:
    """The least distance of lengths (n, 6) from an end of the stroke [m], < 0 beyond; None without a stroke."""
    low, high = platform.leg_length_min, platform.leg_length_max
    if low is None and high is None:
        return None
    margins = (lengths - (-np.inf if low is None else low), (np.inf if high is None else high) - lengths)
    return float(min(margin.min() for margin in margins))


def _deviation(found: ForwardKinematics, log: Log) -> tuple[float, float] | None:
    """The largest distance [m] and angle [rad] between poses and those that were measured beside the lengths."""
    if log.position is None or log.orientation is None:
        return None
    distance = np.linalg.norm(found.position - log.position, axis=1)
    R, measured = matrix_from_orientation(found.orientation), matrix_from_orientation(log.orientation)
    # |R − R_m| = 2√2 sin(φ/2), exact also for small angles
    angle = 2 * np.arcsin(np.clip(np.linalg.norm(R - measured, axis=(1, 2)) / np.sqrt(8), 0.0, 1.0))
    return float(np.nanmax(distance)), float(np.nanmax(angle))


def _pivot(found: ForwardKinematics, log: Log, away: float) -> str | None:
    """The point that measured positions are of, if one point at Rᵀ (p_m − p) explains most of their deviation."""
    if log.position is None:
        return None
    R = matrix_from_orientation(found.orientation)
    offsets = np.einsum("nji,nj->ni", R, log.position - found.position)
    offset = np.nanmean(offsets, axis=0)
    left = float(np.nanmax(np.linalg.norm(offsets - offset, axis=1)))
    if not away > max(5 * left, 1e-6 * float(np.abs(log.leg_length[np.isfinite(log.leg_length)]).max())):
        return None
    return f"pivot = {np.round(offset + log.convention.pivot, 6).tolist()} m, within {LENGTH.text(left)}"


def _charts(log: Log, pose: FloatArray) -> tuple[Chart, ...]:
    rows = np.unique(np.linspace(0, len(pose) - 1, _DRAWN).astype(int))
    along = Axis("row", COUNT, rows + 1.0) if log.time is None else time_axis(log.time[rows])

    def chart(title: str, quantity: Quantity, first: int) -> Chart:
        series = tuple(
            Series(_COORDINATES[k], quantity, pose[rows, k], component=_COORDINATES[k]) for k in range(first, first + 3)
        )
        return Chart(title, along, series, y=Axis(title, quantity), group="pose")

    return chart("position", LENGTH, 0), chart("orientation", ANGLE, 3)

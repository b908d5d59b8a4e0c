"""Recorded motions: poses from logs, checked row by row, in SI units, and moved to the home pose of a platform."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import MotionError, TableError
from gough_stewart.harness.motion.recorded.columns import LEGS, LogColumn, columns_of, leg_columns
from gough_stewart.harness.motion.recorded.table import FromTable, check_increasing
from gough_stewart.harness.pose_convention import OURS, QUATERNION, PoseConvention, check_convention
from gough_stewart.harness.table_file import numbers_of, read_table, times_of, timestamps_of, without_repeated_rows
from gough_stewart.model.errors import NoPoseError
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.rotations import (
    matrix_from_orientation,
    matrix_from_quaternion,
    nearest_angle,
    orientation_from_matrix,
)
from gough_stewart.model.vectors import FloatArray, Scalars

if TYPE_CHECKING:
    import polars

    from gough_stewart.model.forward_kinematics import ForwardKinematics

# A longer time step, in median steps, is a gap.
_LONGEST_STEP = 5.0
# Shipped recordings are in the folder `shipped` of this package.
_SHIPPED_FROM = "gough_stewart.harness.motion"
# Logs round to at least four digits; a larger deviation from norm 1 is an error.
_LENGTH_TOLERANCE = 1e-3
# The pose of a recording that becomes the platform's home pose.
AtHome = Literal["start", "mean"]
# What leg lengths of a file are.
LegLengths = Literal["absolute", "from_home"]


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded motion: its poses with times since the first row, and the file's time there and unit [s]."""

    table: FromTable
    first: float
    time_unit: float


def recording_path(folder: Path, file: str) -> Path | Traversable:
    """The file in a folder; if it does not exist, the shipped recording of that name."""
    path = folder / file
    shipped = resources.files(_SHIPPED_FROM).joinpath("shipped", Path(file).name)
    return shipped if file == shipped.name and shipped.is_file() and not path.exists() else path


def read_recording(
    path: Path | Traversable,
    columns: Mapping[str, str] | str = "",
    largest_gap: float | None = None,
    convention: PoseConvention = OURS,
    platform: Platform | None = None,
    leg_lengths: LegLengths = "absolute",
) -> Recording:
    """A motion from a CSV or Parquet file.

    Parameters
    ----------
    columns
        The columns to read, if the header uses other names; see `columns_of`.
    largest_gap
        The longest time between two rows [s]; by default five times the median.
    convention
        How the file writes poses.
    platform
        Whose leg lengths the file may have; where it has them beside poses, both are compared.
    leg_lengths
        Whether they are absolute, or changes from those at home.

    Raises
    ------
    MotionError
        The file cannot be read; a column or its unit is missing; a row has a non-numeric value, a time that does not
        increase, a gap before it, a quaternion whose norm is not 1, or leg lengths that no pose has; names file, column
        and row. Poses that contradict leg lengths in this convention, and not in another.
    """
    try:
        table = read_table(path, "reference")
        chosen = columns_of(table.columns, columns, timestamps=timestamps_of(table))
        first, since = times_of(table, chosen["time"].name)
        first, since = chosen["time"].factor * first, chosen["time"].factor * since
        values = _values(table, chosen)
        rows = without_repeated_rows(since, np.stack(list(values.values()), axis=1), first)
        since, values = since[rows], {name: column[rows] for name, column in values.items()}
        check_increasing(since, first)
        _check_gaps(since, first, largest_gap)
        if LEGS[0] in chosen:
            pose = _poses_of_legs(values, platform, leg_lengths)
        else:
            pose = _poses(values, convention)
            if platform is not None and not (columns and isinstance(columns, str)):  # a record's own names
                angles = "orientation[1]" in chosen
                how = convention if angles else replace(convention, rotation_order=QUATERNION)
                _compare(table, rows, platform, pose, how, leg_lengths)
        return Recording(FromTable(since, *pose), first, chosen["time"].factor)
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def read_poses(
    path: Path | Traversable, columns: Mapping[str, str] | str = "", convention: PoseConvention = OURS
) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and orientations [rad], each (n, 3), from a CSV or Parquet file, ignoring times.

    Raises
    ------
    MotionError
        As `read_recording`.
    """
    try:
        table = read_table(path, "reference")
        chosen = columns_of(table.columns, columns, timed=False)
        if LEGS[0] in chosen:
            raise MotionError("has leg lengths and no positions; expected poses")  # noqa: TRY301 - named with the file
        return _poses(_values(table, chosen), convention)
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def _values(table: "polars.DataFrame", columns: Mapping[str, LogColumn]) -> dict[str, FloatArray]:
    return {name: column.factor * numbers_of(table, column.name) for name, column in columns.items() if name != "time"}


def _poses(values: Mapping[str, FloatArray], convention: PoseConvention) -> tuple[FloatArray, FloatArray]:
    names = list(values)
    position, turning = _stacked(values, names[:3]), _stacked(values, names[3:])
    kind = names[3].partition("[")[0]
    if convention == OURS:
        return position, _ORIENTATION_FROM[kind](turning)
    return converted(position, turning, kind, convention)


def converted(
    position: FloatArray, turning: FloatArray, kind: str, convention: PoseConvention
) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and continuous roll, pitch, yaw [rad] of Op, each (n, 3), from poses in a convention.

    Parameters
    ----------
    kind
        What `turning` has: "orientation" (n, 3), three angles, "quaternion" (n, 4) or "rotation_vector" (n, 3).

    Raises
    ------
    MotionError
        An order of rotations where there are no angles; a norm that is not 1; a pitch near ±90°.
    """
    if kind == "orientation":
        place, rotation = convention.read(position, turning)
        return place, orientation_of(rotation)
    if (convention.rotation_order, convention.rotation_about) not in (("XYZ", "fixed"), (QUATERNION, "fixed")):
        raise MotionError(
            f"rotation_order is '{convention.rotation_order}', about {convention.rotation_about} axes, but the "
            f"orientations are a {kind.replace('_', ' ')}; leave both keys out"
        )
    place, rotation = convention.read_matrices(position, matrix_from_orientation(_ORIENTATION_FROM[kind](turning)))
    return place, orientation_of(rotation)


def _poses_of_legs(
    values: Mapping[str, FloatArray], platform: Platform | None, leg_lengths: LegLengths
) -> tuple[FloatArray, FloatArray]:
    if platform is None:
        raise MotionError("has leg lengths and no positions; expected poses")
    found = poses_of_lengths(platform, absolute_lengths(platform, _stacked(values, list(LEGS)), leg_lengths))
    return found.position, found.orientation


def absolute_lengths(platform: Platform, leg_length: FloatArray, leg_lengths: LegLengths) -> FloatArray:
    """Leg lengths (n, 6) [m], of changes from those at home too."""
    if leg_lengths == "absolute":
        return leg_length
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    return np.asarray(leg_length + home)


def poses_of_lengths(platform: Platform, leg_length: FloatArray, *, conditioning: bool = False) -> "ForwardKinematics":
    """The poses with these leg lengths (n, 6) [m], as one continuous motion from home; rows with NaN have none.

    Raises
    ------
    MotionError
        Lengths that no pose has; names the row.
    """
    from gough_stewart.model.forward_kinematics import forward_kinematics  # loads CasADi, and is rarely needed

    refused, cause = np.flatnonzero(((leg_length <= 0) | np.isinf(leg_length)).any(axis=1)), "expected lengths > 0"
    try:
        if not refused.size:
            return forward_kinematics(platform, leg_length, conditioning=conditioning)
    except NoPoseError as error:
        refused, cause = np.array(error.row), str(error.__cause__)
    lengths = leg_length[refused[0]]
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    is_change = np.nanmax(np.abs(leg_length)) < 0.5 * float(home.min())
    hint = '; if they are changes from the lengths at home, leg_lengths = "from_home"' if is_change else ""
    raise MotionError(
        f"no pose of this platform has the leg lengths {np.round(lengths, 5).tolist()} m of row {refused[0] + 1} "
        f"({cause}); check the platform's joints, the order of the legs, and the unit of the lengths{hint}"
    )


def _compare(
    table: "polars.DataFrame",
    rows: NDArray[np.intp],
    platform: Platform,
    pose: tuple[FloatArray, FloatArray],
    convention: PoseConvention,
    leg_lengths: LegLengths,
) -> None:
    """Refuse poses that contradict the leg lengths beside them, if the file has such columns with units."""
    try:
        columns = leg_columns(table.columns)
    except MotionError:  # none, or without units
        return
    lengths = _stacked(_values(table, columns), list(LEGS))[rows]
    try:
        check_convention(platform, absolute_lengths(platform, lengths, leg_lengths), *pose, convention)
    except ValueError as error:
        raise MotionError(str(error)) from error


def _stacked(values: Mapping[str, FloatArray], names: list[str]) -> FloatArray:
    return np.stack([values[name] for name in names], axis=1)


def _check_gaps(time: FloatArray, first: float, largest: float | None) -> None:
    steps = np.diff(time)
    if not steps.size:
        return
    median = float(np.median(steps))
    bound = _LONGEST_STEP * median if largest is None else largest
    long = np.flatnonzero(steps > bound * (1 + 1e-9))
    if long.size:
        k = int(long[0])
        raise MotionError(
            f"a gap of {steps[k]:.6g} s before row {k + 2}, at {first + time[k + 1]:.10g} s; expected steps of at most "
            f"{bound:.6g} s; the median is {median:.6g} s; cut the file there, or let the spline bridge the gap: "
            f"largest_gap = {steps[k]:.6g}"
        )


def continuous(orientation: FloatArray, near: Scalars = 0.0) -> FloatArray:
    """Roll, pitch, yaw (n, 3) [rad], unwrapped, with the first row in the turns of some angles, by default (−π, π]."""
    turned = np.unwrap(orientation, axis=0)
    return np.asarray(turned + (nearest_angle(turned[:1], near) - turned[:1]))


def orientation_of(rotation: FloatArray, near: Scalars = 0.0) -> FloatArray:
    """`continuous` roll, pitch, yaw (n, 3) [rad] of rotation matrices (n, 3, 3).

    Raises
    ------
    MotionError
        A pitch near ±90°, where roll and yaw are undefined; names the row, counted from 1.
    """
    steep = np.flatnonzero(~(np.abs(rotation[:, 2, 0]) < np.sin(LARGEST_PITCH)))
    if steep.size:
        raise MotionError(f"in row {steep[0] + 1} the pitch is ±90°; expected a pitch between these limits")
    return continuous(orientation_from_matrix(rotation), near)


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


_ORIENTATION_FROM: dict[str, Callable[[FloatArray], FloatArray]] = {
    "orientation": continuous,
    "quaternion": of_quaternions,
    "rotation_vector": of_rotation_vectors,
}


def moved_home(table: FromTable, platform: Platform, pose: AtHome, start: float) -> FromTable:
    """Move a motion rigidly, so that its pose at a time, or its mean pose, becomes the home pose.

    p = p_home + R_home R₀ᵀ (p − p₀) and R = R_home R₀ᵀ R: displacements stay the same in the axes of the platform in
    the pose p₀, R₀, so surge of a vehicle stays surge, whatever its heading. Means are over time; the mean rotation is
    the rotation nearest to the mean of the matrices.

    Parameters
    ----------
    start
        The time of the pose "start" [s].

    Raises
    ------
    MotionError
        The time is outside the table, or a pitch reaches ±90°.
    """
    if pose == "start":
        at = table(np.array([start]))
        position, rotation = at.position[0], matrix_from_orientation(at.orientation[0])
    else:
        position, rotation = _mean_pose(table)
    turn = matrix_from_orientation(platform.home_orientation) @ rotation.T
    return FromTable(
        table.time,
        platform.home_position + (table.position - position) @ turn.T,
        orientation_of(turn @ matrix_from_orientation(table.orientation), platform.home_orientation),
    )


def _mean_pose(table: FromTable) -> tuple[FloatArray, FloatArray]:
    """Mean position (3,) [m] and rotation (3, 3) over time, by the trapezoidal rule."""
    from scipy.spatial.transform import Rotation  # rarely needed

    steps = np.diff(table.time)
    weights = (np.append(steps, 0.0) + np.append(0.0, steps)) / 2
    rotations = Rotation.from_matrix(matrix_from_orientation(table.orientation))
    position: FloatArray = np.average(table.position, axis=0, weights=weights)
    return position, rotations.mean(weights=weights).as_matrix()

"""Recorded motions: poses from logs, checked row by row, in SI units, and moved to the home pose of a platform."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gough_stewart.harness.errors import MotionError, TableError
from gough_stewart.harness.motion.recorded.columns import Column, columns_of
from gough_stewart.harness.motion.recorded.table import FromTable, check_increasing
from gough_stewart.harness.table_file import numbers_of, read_table, times_of
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

# A longer time step, in median steps, is a gap.
_LONGEST_STEP = 5.0
# Shipped recordings are in the folder `shipped` of this package.
_SHIPPED_FROM = "gough_stewart.harness.motion"
# Logs round to at least four digits; a larger deviation from norm 1 is an error.
_LENGTH_TOLERANCE = 1e-3
# The pose of a recording that becomes the platform's home pose.
AtHome = Literal["start", "mean"]


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
    path: Path | Traversable, columns: Mapping[str, str] | str = "", largest_gap: float | None = None
) -> Recording:
    """A motion from a CSV or Parquet file.

    Parameters
    ----------
    columns
        The columns to read, if the header uses other names; see `columns_of`.
    largest_gap
        The longest time between two rows [s]; by default five times the median.

    Raises
    ------
    MotionError
        The file cannot be read; a column or its unit is missing; a row has a non-numeric value, a time that does not
        increase, a gap before it, or a quaternion whose norm is not 1; names file, column and row.
    """
    try:
        table = read_table(path, "reference")
        chosen = columns_of(table.columns, columns)
        first, since = times_of(table, chosen["time"].name)
        first, since = chosen["time"].factor * first, chosen["time"].factor * since
        check_increasing(since, first)
        _check_gaps(since, first, largest_gap)
        return Recording(FromTable(since, *_poses(table, chosen)), first, chosen["time"].factor)
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def read_poses(path: Path | Traversable, columns: Mapping[str, str] | str = "") -> tuple[FloatArray, FloatArray]:
    """Positions [m] and orientations [rad], each (n, 3), from a CSV or Parquet file, ignoring times.

    Raises
    ------
    MotionError
        As `read_recording`.
    """
    try:
        table = read_table(path, "reference")
        return _poses(table, columns_of(table.columns, columns, timed=False))
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def _poses(table: "polars.DataFrame", columns: Mapping[str, Column]) -> tuple[FloatArray, FloatArray]:
    values = {
        name: column.factor * numbers_of(table, column.name) for name, column in columns.items() if name != "time"
    }
    position, turning = list(values)[:3], list(values)[3:]
    return _stacked(values, position), _ORIENTATION_FROM[turning[0].partition("[")[0]](_stacked(values, turning))


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

"""Recorded motions: poses from motion logs, checked row by row, in SI units."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gough_stewart.harness.errors import MotionError, TableError
from gough_stewart.harness.motion.columns import Column, columns_of
from gough_stewart.harness.motion.table import FromTable, check_increasing
from gough_stewart.harness.motion.turning import continuous, of_quaternions, of_rotation_vectors
from gough_stewart.harness.table_file import numbers_of, read_table, times_of
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    import polars

# A longer time step, in median steps, is a gap.
_LONGEST_STEP = 5.0
# Shipped recordings are in the folder `shipped` of this package.
_SHIPPED_FROM = "gough_stewart.harness.motion"
_ORIENTATION_FROM: dict[str, Callable[[FloatArray], FloatArray]] = {
    "orientation": continuous,
    "quaternion": of_quaternions,
    "rotation_vector": of_rotation_vectors,
}


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
    values = {name: each.factor * numbers_of(table, each.name) for name, each in columns.items() if name != "time"}
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

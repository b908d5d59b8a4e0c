"""Recorded motions: poses from logs, checked row by row, in SI units, and moved to the home pose of a platform."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gough_stewart.harness.errors import MotionError, TableError
from gough_stewart.harness.motion.recorded.columns import LEGS, LogColumn, columns_of
from gough_stewart.harness.motion.recorded.from_table import FromTable, check_increasing
from gough_stewart.harness.pose_convention import OURS, QUATERNION, PoseConvention, check_convention
from gough_stewart.harness.table_file import numbers_of, read_table, times_of, timestamps_of, without_repeated_rows
from gough_stewart.model.errors import NoPoseError
from gough_stewart.model.kinematics import LARGEST_PITCH, leg_geometry
from gough_stewart.model.platform import Platform
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


def recording_path(folder: Path, file: str) -> Path | Traversable:
    """The file in a folder; if it does not exist, the shipped recording of that name."""
    path = folder / file
    shipped = resources.files(_SHIPPED_FROM).joinpath("shipped", Path(file).name)
    return shipped if file == shipped.name and shipped.is_file() and not path.exists() else path


def read_recording(
    path: Path | Traversable,
    columns: Mapping[str, str] | str = "",  # to read, if the header uses other names; see `columns_of`
    largest_gap: float | None = None,  # the longest time between two rows [s]; by default five times the median
    convention: PoseConvention = OURS,  # how the file writes poses
    platform: Platform | None = None,  # whose leg lengths it may have; beside poses both are compared
    leg_lengths: LegLengths = "absolute",
) -> tuple[FromTable, float, float]:
    """A motion from a CSV or Parquet file with times since its first row; the file's time there and unit [s].

    A `MotionError` names file, column and row: no table, a missing column or unit, no number, times that do not
    increase, a gap, no unit quaternion, lengths that no pose has, or poses that contradict them in this convention.
    """
    try:
        table = read_table(path, "reference")
        chosen = columns_of(table.columns, columns, timestamps=timestamps_of(table))
        unit = chosen["time"].factor
        first, since = times_of(table, chosen["time"].name)
        first, since = unit * first, unit * since
        values = _values(table, chosen)
        rows = without_repeated_rows(since, values, first)
        since, values = since[rows], values[rows]
        check_increasing(since, first)

        steps = np.diff(since)
        median = float(np.median(steps)) if steps.size else 0.0
        bound = _LONGEST_STEP * median if largest_gap is None else largest_gap
        for k in np.flatnonzero(steps > bound * (1 + 1e-9))[:1].tolist():
            raise MotionError(  # noqa: TRY301 - named with the file
                f"a gap of {steps[k]:.6g} s before row {k + 2}, at {first + since[k + 1]:.10g} s; expected steps of at "
                f"most {bound:.6g} s; the median is {median:.6g} s; cut the file there, or let the spline bridge the "
                f"gap: largest_gap = {steps[k]:.6g}"
            )

        if LEGS[0] in chosen:
            if platform is None:
                raise MotionError("has leg lengths and no positions; expected poses")  # noqa: TRY301 - as above
            found = poses_of_lengths(platform, absolute_lengths(platform, values, leg_lengths))
            return FromTable(since, found.position, found.orientation), first, unit

        # poses, which must not contradict leg lengths beside them
        pose = _poses(values, chosen, convention)
        of_legs = dict[str, LogColumn]()
        if platform is not None and not (columns and isinstance(columns, str)):  # a record's own names
            with suppress(MotionError):  # none, or without units
                of_legs = columns_of(table.columns, columns, timed=False, only_legs=True)
        if platform is not None and of_legs:
            lengths = absolute_lengths(platform, _values(table, of_legs)[rows], leg_lengths)
            how = convention if "orientation[1]" in chosen else replace(convention, rotation_order=QUATERNION)
            try:
                check_convention(platform, lengths, *pose, how)
            except ValueError as error:
                raise MotionError(str(error)) from error
        return FromTable(since, *pose), first, unit
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def read_poses(path: Path | Traversable, convention: PoseConvention) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and orientations [rad], each (n, 3), from a CSV or Parquet file, ignoring times."""
    try:
        table = read_table(path, "reference")
        chosen = columns_of(table.columns, timed=False)
        if LEGS[0] in chosen:
            raise MotionError("has leg lengths and no positions; expected poses")  # noqa: TRY301 - named with the file
        return _poses(_values(table, chosen), chosen, convention)
    except (MotionError, TableError) as error:
        raise MotionError(f"{path}: {error}") from error


def _values(table: "polars.DataFrame", columns: Mapping[str, LogColumn]) -> FloatArray:
    """The columns (n, k) but for the time, in SI units."""
    numbers = [column.factor * numbers_of(table, column.name) for name, column in columns.items() if name != "time"]
    return np.stack(numbers, axis=1)


def _poses(values: FloatArray, columns: Iterable[str], convention: PoseConvention) -> tuple[FloatArray, FloatArray]:
    position, turning = values[:, :3], values[:, 3:]
    kind = list(columns)[-1].partition("[")[0]
    if convention == OURS:
        return position, orientation_from(kind, turning)
    return converted(position, turning, kind, convention)


def converted(
    position: FloatArray, turning: FloatArray, kind: str, convention: PoseConvention
) -> tuple[FloatArray, FloatArray]:
    """Positions [m] and continuous roll, pitch, yaw [rad] of Op, each (n, 3), from poses in a convention.

    By kind `turning` has three angles, "orientation" (n, 3), a "quaternion" (n, 4) or a "rotation_vector" (n, 3).
    """
    if kind == "orientation":
        place, rotation = convention.read(position, turning)
        return place, orientation_of(rotation)
    if (convention.rotation_order, convention.rotation_about) not in (("XYZ", "fixed"), (QUATERNION, "fixed")):
        raise MotionError(
            f"rotation_order is '{convention.rotation_order}', about {convention.rotation_about} axes, but the "
            f"orientations are a {kind.replace('_', ' ')}; leave both keys out"
        )
    place, rotation = convention.read_matrices(position, matrix_from_orientation(orientation_from(kind, turning)))
    return place, orientation_of(rotation)


def absolute_lengths(platform: Platform, leg_length: FloatArray, leg_lengths: LegLengths) -> FloatArray:
    """Leg lengths (n, 6) [m], of changes from those at home too."""
    if leg_lengths == "absolute":
        return leg_length
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    return np.asarray(leg_length + home)


def poses_of_lengths(platform: Platform, leg_length: FloatArray, *, conditioning: bool = False) -> "ForwardKinematics":
    """The poses with these leg lengths (n, 6) [m], as one continuous motion from home; rows with NaN have none."""
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


def continuous(orientation: FloatArray, near: Scalars = 0.0) -> FloatArray:
    """Roll, pitch, yaw (n, 3) [rad], unwrapped, with the first row in the turns of some angles, by default (−π, π]."""
    turned = np.unwrap(orientation, axis=0)
    return np.asarray(turned + (nearest_angle(turned[:1], near) - turned[:1]))


def orientation_of(rotation: FloatArray, near: Scalars = 0.0) -> FloatArray:
    """`continuous` roll, pitch, yaw (n, 3) [rad] of rotation matrices (n, 3, 3), with a pitch away from ±90°."""
    steep = np.flatnonzero(~(np.abs(rotation[:, 2, 0]) < np.sin(LARGEST_PITCH)))
    if steep.size:
        raise MotionError(f"in row {steep[0] + 1} the pitch is ±90°; expected a pitch between these limits")
    return continuous(orientation_from_matrix(rotation), near)


def orientation_from(kind: str, turning: FloatArray) -> FloatArray:
    """Continuous roll, pitch, yaw (n, 3) [rad] of such angles, "orientation" (n, 3), or of another kind.

    Of a unit "quaternion" (n, 4), scalar last; q and −q are the same. Of a "rotation_vector" (n, 3) [rad], axis times
    angle.
    """
    if kind == "orientation":
        return continuous(turning)
    if kind == "rotation_vector":
        from scipy.spatial.transform import Rotation  # rarely needed

        return orientation_of(Rotation.from_rotvec(turning).as_matrix())
    length = np.linalg.norm(turning, axis=1)
    bad = np.flatnonzero(~(np.abs(length - 1) <= _LENGTH_TOLERANCE))
    if bad.size:
        raise MotionError(
            f"the quaternion in row {bad[0] + 1} has the norm {length[bad[0]]:.6g}; expected 1 "
            f"within {_LENGTH_TOLERANCE:g}"
        )
    return orientation_of(matrix_from_quaternion(turning))


def moved_home(table: FromTable, platform: Platform, pose: AtHome, start: float) -> FromTable:
    """Move a motion rigidly, so that its pose at the time `start` [s], or its mean pose, becomes the home pose.

    p = p_home + R_home R₀ᵀ (p − p₀) and R = R_home R₀ᵀ R: displacements stay the same in the axes of the platform in
    the pose p₀, R₀, so surge of a vehicle stays surge, whatever its heading. Means are over time, by the trapezoidal
    rule; the mean rotation is the rotation nearest to the mean of the matrices.
    """
    rotations = matrix_from_orientation(table.orientation)
    if pose == "start":
        at = table(np.array([start]))
        position, rotation = at.position[0], matrix_from_orientation(at.orientation[0])
    else:
        from scipy.spatial.transform import Rotation  # rarely needed

        steps = np.diff(table.time)
        weights = (np.append(steps, 0.0) + np.append(0.0, steps)) / 2
        position = np.average(table.position, axis=0, weights=weights)
        rotation = Rotation.from_matrix(rotations).mean(weights=weights).as_matrix()
    turn = matrix_from_orientation(platform.home_orientation) @ rotation.T
    return FromTable(
        table.time,
        platform.home_position + (table.position - position) @ turn.T,
        orientation_of(turn @ rotations, platform.home_orientation),
    )

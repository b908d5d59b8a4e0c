"""Logs of machines: records of encoders, force sensors or motor currents, and possibly a tracker."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError, TableError
from gough_stewart.harness.motion.recorded.columns import chosen_headings, usual_headings
from gough_stewart.harness.motion.recorded.recording import converted
from gough_stewart.harness.plants.signals import Side
from gough_stewart.harness.polars_paths import readable
from gough_stewart.harness.pose_convention import OURS, QUATERNION, PoseConvention, RotationAbout, check_convention
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.table_file import (
    Heading,
    numbers_of,
    read_table,
    times_of,
    timestamps_of,
    without_repeated_rows,
)
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.units import UNITS
from gough_stewart.model.vectors import FloatArray

# A name, optionally with an index: "leg_length[1]", "leg_length_1".
_ELEMENT = re.compile(r"([A-Za-z][\w.]*?)(?:\[(\d+)\]|_(\d+))?")
_UNITS: dict[str, Mapping[str, float]] = {**UNITS, "A": {"A": 1, "mA": 1e-3}, "": {"": 1, "1": 1, "-": 1}}
# Possible column names of each quantity, preferred first, with size and unit.
_QUANTITIES = {
    "time": (("time",), 1, "s"),
    "leg_length": (("measured.leg_length", "leg_length"), 6, "m"),
    "motor_position": (("motor_position",), 6, "m"),
    "actuator_force": (("measured.actuator_force", "actuator_force", "controller.force"), 6, "N"),
    "motor_current": (("motor_current",), 6, "A"),
    "position": (("measured.position", "position"), 3, "m"),
    "orientation": (("measured.orientation", "orientation"), 3, "rad"),
    "quaternion": (("quaternion",), 4, ""),
}
# Only records of runs have it: their forces are held from row to row.
_OF_RUNS = "controller.force[1]"
_REMEDY = ": cut the log there, or fill the gap where it was recorded"
_FORM = "expected columns time, leg_length[1..6], actuator_force[1..6] or motor_current[1..6], units in the header"
# Tolerance of a row's time, in samples.
_JITTER = 0.1
_SLOWEST_SAMPLES = 0.1  # [s]
# Factor between lengths or forces and those at home beyond which another unit is likely.
_LENGTH_FACTOR = 3.0
_FORCE_FACTOR = 50.0
_OVER_LIMIT = 3.0
# Share of each log, taken from its end, that validates the fit.
VALIDATION = 0.2


@dataclass(frozen=True, eq=False)
class Log:
    """Recorded data of a machine, row by row, in SI units; `read_log` reads it from a file."""

    leg_length: FloatArray  # (n, 6) [m]
    time: FloatArray | None = None  # (n,) [s]; poses at rest need none
    actuator_force: FloatArray | None = None  # (n, 6) [N]; positive extends the leg
    position: FloatArray | None = None  # (n, 3) of Op [m]
    orientation: FloatArray | None = None  # (n, 3) roll, pitch, yaw [rad]
    # whether a force acts from its row to the next, as with a sampled controller; else it is instantaneous
    holds_force: bool = False
    where: str = "log"
    # of legs that give: where `leg_length` was measured; if at both sides, the motors' in `motor_position` (n, 6) [m]
    side: Side = "leg"
    motor_position: FloatArray | None = None
    convention: PoseConvention = OURS  # in which the file had the poses

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.leg_length)

    def rows(self, which: slice | NDArray[np.intp]) -> "Log":
        """The log with some of its rows."""
        kept: dict[str, Any] = {}
        for name in ("leg_length", "time", "actuator_force", "position", "orientation", "motor_position"):
            values = getattr(self, name)
            kept[name] = None if values is None else values[which]
        return replace(self, **kept)


class Part(NamedTuple):
    """A segment of a log; its rows before `fitted_until` are fitted, the later ones validate the fit."""

    log: Log
    fitted_until: float = math.inf  # [s]
    which: int = 0  # the log that it is from, in their order

    def is_fitted(self, time: FloatArray) -> np.ndarray:
        """Which times (n,) [s] are fitted (n,)."""
        return np.asarray(time < self.fitted_until)


def read_log(
    path: Path | str,
    force_per_current: float | None = None,
    *,
    holds_force: bool | None = None,
    side: Side | None = None,
    columns: Mapping[str, str] | None = None,
    rotation_order: str = "XYZ",
    rotation_about: RotationAbout = "fixed",
    frame: str = "z_up",
    pivot: Sequence[float] = (0.0, 0.0, 0.0),
    gaps: bool = False,
) -> Log:
    """Read a log from CSV or Parquet: a record of `run`, or columns of a machine with units in their names.

    Columns: `time`, `leg_length[1..6]`, `actuator_force[1..6]` or `motor_current[1..6]`, and, if poses were measured,
    `position[1..3]` and `orientation[1..3]` or `quaternion[1..4]`, scalar last. Usual names, such as `leg_1`, `x`,
    `roll`, `pose.orientation.x`, are known, too. Write units after the names: `time [ms]`, `leg_length[1] [mm]`;
    without a unit, values are in SI. `leg_length_1` is the same as `leg_length[1]`. From a record of a run, sensor
    values are used, and true values of signals without a sensor. Times may be dates by ISO 8601, or seconds since 1970;
    the log's then begin at 0. Rows that repeat the one before, with its time, are left out with a warning.

    Parameters
    ----------
    path
        The file, or the folder of a record.
    force_per_current
        Of each motor [N/A], if the log has currents.
    holds_force
        Whether each force acts from its row to the next, as commands of a sampled controller do, or is a reading at
        the time of its row; by default, forces of records are held, and others are not.
    side
        Of legs that give, where `leg_length` was measured, "leg" or "motor"; by default that of a record's sensors,
        else the leg's. Columns `motor_position[1..6]` are the motors', alone or beside `leg_length`.
    columns
        Columns of the file by these names, where its header has other ones: {"leg_length[1]": "S1 [mm]"}.
    rotation_order, rotation_about
        The order of the rotations about x, y and z, such as "ZYX", about "fixed" axes or those "moving" with the
        platform.
    frame
        "z_up", "z_down" (x forward, y right), or the file's axes in those of this project, such as "y,x,-z".
    pivot
        The point whose position the file has, in the axes of the platform [m].
    gaps
        Whether leg lengths may be empty or NaN, for the poses of the other rows.

    Returns
    -------
    Log
        Arrays in SI units, a row for each time; None for signals that the log does not have.

    Raises
    ------
    LogError
        The file cannot be read, lacks columns, or has a value that is not a finite number; names column and row. An
        unknown order, frame or pivot; two rows of one time with different values.

    Examples
    --------
    >>> files = gs.save_record(gs.run("heave_step", {"loop.duration": 0.1}), "results/heave")
    >>> gs.read_log("results/heave").leg_length.shape
    (101, 6)
    """
    path = Path(path)
    if path.is_dir():
        path = next((path / name for name in ("record.parquet", "record.csv") if (path / name).is_file()), path)
    table = _table(path)
    if rotation_order == QUATERNION:
        raise LogError(f"{path}: rotation_order is '{QUATERNION}'; expected that of angles; quaternions need none")
    try:
        convention = PoseConvention(rotation_order, rotation_about, frame, tuple(map(float, pivot)))
        table = _renamed(table, columns or {})
        log = _log_of(table, _metadata(path), str(path), force_per_current, side, convention, gaps=gaps)
    except LogError:
        raise
    except ValueError as error:  # of the convention, a motion, a table
        raise LogError(f"{path}: {error}") from error
    return log if holds_force is None else replace(log, holds_force=holds_force)


def check_poses(log: Log, platform: Platform, leg_length: FloatArray | None = None) -> None:
    """Refuse measured poses that contradict the leg lengths as they were read, and fit them in another convention.

    Parameters
    ----------
    leg_length
        (n, 6) [m], if those of the log are no lengths.

    Raises
    ------
    LogError
        Names the other order of rotations, or frame.
    """
    if log.position is None or log.orientation is None:
        return
    try:
        lengths = log.leg_length if leg_length is None else leg_length
        check_convention(platform, lengths, log.position, log.orientation, log.convention)
    except ValueError as error:
        raise LogError(f"{log.where}: {error}") from error


def log_of(record: Record) -> Log:
    """The log of a run: sensor values, true values of signals without a sensor, and forces.

    Raises
    ------
    LogError
        As `read_log`.
    """
    return _log_of(record.table, record.metadata, "record", None)


def _log_of(
    table: polars.DataFrame,
    metadata: Mapping[str, Any],
    path: str,
    force_per_current: float | None,
    side: Side | None = None,
    convention: PoseConvention = OURS,
    *,
    gaps: bool = False,
) -> Log:
    found = _columns(table.columns, path)
    values = {
        name: _numbers(table, columns, path, gaps=gaps and name == "leg_length")
        for name, columns in found.items()
        if name != "time"
    }
    if "time" in found:
        [(column, factor)] = found["time"]
        first, since = times_of(table, column, _REMEDY)
        values["time"] = factor * (since if column in timestamps_of(table) else first + since)[:, None]
        if _OF_RUNS not in table.columns and len(values) > 1:
            rows = without_repeated_rows(since, np.hstack([values[name] for name in values if name != "time"]))
            values = {name: value[rows] for name, value in values.items()}
    own_side = _sides(values, metadata, side, "measured.leg_length[1]" in table.columns, path)
    position, orientation = values.get("position"), values.get("orientation")
    if position is not None and orientation is None and "quaternion" in values:
        position, orientation = converted(position, values["quaternion"], "quaternion", convention)
        convention = replace(convention, rotation_order=QUATERNION)
    elif convention != OURS and position is not None and orientation is not None:
        position, orientation = converted(position, orientation, "orientation", convention)
    force = values.get("actuator_force")
    if "motor_current" in values and force is None:
        if force_per_current is None or not (math.isfinite(force_per_current) and force_per_current != 0):
            raise LogError(
                f"{path}: has motor currents, but force_per_current is {force_per_current}; expected the factor "
                "[N/A], torque constant · 2π · efficiency / lead"
            )
        force = values["motor_current"] * force_per_current
    log = Log(
        values["leg_length"],
        values["time"][:, 0] if "time" in values else None,
        force,
        position,
        orientation,
        _OF_RUNS in table.columns,
        path,
        own_side,
        values.get("motor_position"),
        convention,
    )
    if len(log) < 2:
        raise LogError(f"{path}: {len(log)} rows; expected a log of some seconds, or of several poses")
    return _at_samples(log, metadata)


def _sides(
    values: dict[str, FloatArray], metadata: Mapping[str, Any], side: Side | None, has_readings: bool, path: str
) -> Side:
    """The side of the lengths; a record of a run read at the motors has no lengths of the legs, which none measured."""
    if side is not None and side not in get_args(Side):
        raise LogError(f"{path}: side is {side!r}; expected one of {', '.join(get_args(Side))}")
    of_run = _sensors(metadata).get("side", "leg") if _sensors(metadata) else None
    if of_run == "motor":
        motors = values.pop("motor_position", None)
        if not has_readings and motors is not None:
            values["leg_length"] = motors
        return side or "motor"
    if "leg_length" not in values:
        if "motor_position" not in values:
            raise LogError(f"{path}: no leg lengths; {_FORM}")
        values["leg_length"] = values.pop("motor_position")
        if side == "leg":
            raise LogError(f"{path}: has motor_position only, but side is 'leg'; expected leg_length[1..6]")
        return "motor"
    if side == "motor" and "motor_position" in values:
        raise LogError(
            f"{path}: has motor_position beside leg_length, so the latter is the legs', but side is 'motor'; leave "
            "side away, or remove one of both"
        )
    return side or "leg"


def _sensors(metadata: Mapping[str, Any]) -> Mapping[str, Any]:
    """The sensors of a run's experiment; empty for other logs."""
    experiment = metadata.get("experiment")
    found = experiment.get("sensors") if isinstance(experiment, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _table(path: Path) -> polars.DataFrame:
    if not path.is_file():
        raise LogError(f"{path}: no such file; expected a log as CSV or Parquet")
    try:
        return read_table(path, "log")
    except TableError as error:
        raise LogError(f"{path}: {error}") from error


def _columns(heads: list[str], path: str) -> dict[str, list[tuple[str, float]]]:
    """The columns of each available quantity in order, each with its factor to SI units."""
    elements: dict[tuple[str, int], Heading] = {}
    for heading in map(Heading.of, heads):
        match = _ELEMENT.fullmatch(heading.name)
        if match is not None:
            name, bracket, tail = match.groups()
            elements[(name, int(bracket or tail or 1))] = heading
    found = {}
    for quantity, (names, size, unit) in _QUANTITIES.items():
        for name in names:
            present = [k for k in range(1, size + 1) if (name, k) in elements]
            if not present:
                continue
            if len(present) < size:
                missing = ", ".join(f"{name}[{k}]" for k in range(1, size + 1) if k not in present)
                raise LogError(f"{path}: has no column {missing}; {_FORM}")
            try:
                headings = [elements[(name, k)] for k in present]
                found[quantity] = [(each.column, each.factor(_UNITS[unit])) for each in headings]
            except ValueError as error:
                raise LogError(f"{path}: {error}") from None
            break
    return found


def _renamed(table: polars.DataFrame, chosen: Mapping[str, str]) -> polars.DataFrame:
    """The table with this project's names for the chosen columns, and for those with usual names.

    Raises
    ------
    LogError
        A column under a usual name without a unit, whose numbers could be in any.
    MotionError
        A chosen column that the file does not have, or several for one quantity.
    """
    headings = {**usual_headings(table.columns), **chosen_headings(table.columns, chosen)}
    present = {_name_of(heading.name) for heading in map(Heading.of, table.columns)} - set(chosen)
    timestamps, names = timestamps_of(table), dict[str, str]()
    for name, heading in headings.items():
        kind = name.partition("[")[0]
        if name in present or any(other.startswith("measured." + kind) for other in present):
            continue
        plain = kind == "quaternion" or (kind == "time" and heading.column in timestamps)
        if heading.unit is None and not plain:
            raise LogError(
                f"the column {heading.column} is {name}, without a unit; expected it in the header, as "
                f"'{heading.name} [{'ms' if kind == 'time' else 'deg' if kind == 'orientation' else 'mm'}]', or in "
                f"columns={{'{name}': '{heading.name} [UNIT]'}}"
            )
        names[heading.column] = name if plain or heading.unit is None else f"{name} [{heading.unit}]"
    replaced = [name for name in table.columns if name not in names and _name_of(Heading.of(name).name) in chosen]
    return table.drop(replaced).rename(names)


def _name_of(name: str) -> str:
    """The project's name for an element, which files may write with an underscore: `leg_length_1`."""
    match = _ELEMENT.fullmatch(name)
    index = match and (match[2] or match[3])
    return f"{match[1]}[{index}]" if match and index else name


def _numbers(table: polars.DataFrame, columns: list[tuple[str, float]], path: str, *, gaps: bool = False) -> FloatArray:
    try:
        return np.stack([factor * numbers_of(table, head, _REMEDY, gaps=gaps) for head, factor in columns], axis=1)
    except TableError as error:
        raise LogError(f"{path}: {error}") from error


def _metadata(path: Path) -> Mapping[str, Any]:
    """The metadata of a run's record; empty for other logs."""
    try:
        if path.suffix == ".parquet":
            text = polars.read_parquet_metadata(readable(path)).get("gough_stewart", "null")
        else:
            text = path.with_name("metadata.json").read_text("utf-8")
        found = json.loads(text)
    except (OSError, ValueError, polars.exceptions.PolarsError):
        return {}
    return found if isinstance(found, dict) else {}


def _at_samples(log: Log, metadata: Mapping[str, Any]) -> Log:
    """The rows of a run at which its controller, and sensors of their own rhythm, were sampled, with mean forces.

    Readings of slower sensors then repeat, which `without_held_rows` recognises.
    """
    sample, step = metadata.get("sample_time"), metadata.get("plant_step")
    if not log.holds_force or not sample or not step or log.actuator_force is None:
        return log
    own = _sensors(metadata).get("sample_time")
    # a force that varies between two readings has no one time, so its samples are kept
    every = math.gcd(round(sample / step), round(max(sample, own or 0.0) / step))
    n = len(log) // every
    if every < 2 or n < 2:
        return log
    force = log.actuator_force[: n * every].reshape(n, every, 6).mean(axis=1)
    return replace(log.rows(slice(0, n * every, every)), actuator_force=force)


def sample_time_of(log: Log) -> float:
    """The constant sample time of the rows [s].

    Raises
    ------
    LogError
        No time, times that do not increase, gaps, or rows too slow for a motion.
    """
    number, h = rows_apart(log)
    assert log.time is not None  # checked by rows_apart
    gaps = np.flatnonzero(number > 1)
    if gaps.size:
        k = int(gaps[0])
        raise LogError(
            f"{log.where}: a gap of {log.time[k + 1] - log.time[k]:.6g} s after row {k + 1} (time {log.time[k]:.6g} "
            f"s), where rows are {h:.6g} s apart, and {gaps.size - 1} more; expected even times: use the longest part "
            "without a gap, or record again"
        )
    return h


def rows_apart(log: Log) -> tuple[NDArray[np.intp], float]:
    """How many sample times each row is after the one before it (n − 1,), 1 without gaps; and the sample time [s].

    Raises
    ------
    LogError
        No time, times that do not increase or are uneven, or rows too slow for a motion.
    """
    if log.time is None:
        raise LogError(f"{log.where}: no column time; expected one, since the motion between rows is needed")
    if len(log) < 2:
        raise LogError(f"{log.where}: {len(log)} rows; expected a log of some seconds")
    steps = np.diff(log.time)
    h = float(np.median(steps))
    back = np.flatnonzero(steps <= 0)
    if back.size:
        k = int(back[0])
        raise LogError(
            f"{log.where}: time goes from {log.time[k]:.9g} to {log.time[k + 1]:.9g} s in row {k + 2}; expected "
            "increasing times"
        )
    resolution = float(np.spacing(np.float32(np.abs(log.time).max())))
    if resolution > _JITTER * h and (log.time.astype(np.float32) == log.time).all():
        raise LogError(
            f"{log.where}: times are numbers of 32 bits, {resolution:.2g} s apart at {np.abs(log.time).max():.6g} s, "
            f"where rows are {h:.2g} s apart; expected even times: write 64 bits, or count from the first row"
        )
    number = np.rint(steps / h)
    uneven = np.flatnonzero(np.abs(steps - number * h) > _JITTER * h)
    # of a long gap, the clock's own error adds up
    uneven = uneven[np.abs(steps - number * h)[uneven] > 1e-3 * steps[uneven]]
    if uneven.size:
        k = int(uneven[0])
        raise LogError(
            f"{log.where}: a step of {steps[k]:.6g} s after row {k + 1} (time {log.time[k]:.6g} s), where rows are "
            f"{h:.6g} s apart, and {uneven.size - 1} more; expected even times, or gaps of whole rows: record "
            "again, or interpolate to even times"
        )
    if h > _SLOWEST_SAMPLES:
        raise LogError(
            f"{log.where}: rows are {h:g} s apart; expected at most {_SLOWEST_SAMPLES:g} s for a motion. If time is "
            "in ms, name the column 'time [ms]'"
        )
    number = np.maximum(number, 1)
    return number.astype(np.intp), float(log.time[-1] - log.time[0]) / float(number.sum())


def check_finite(log: Log) -> None:
    """Refuse a log of a motion with readings that are no numbers.

    Raises
    ------
    LogError
        Names the signal and the row.
    """
    for name in ("time", "leg_length", "actuator_force", "motor_position"):
        values = getattr(log, name)
        bad = np.zeros((0, 1), dtype=int) if values is None else np.argwhere(~np.isfinite(values))
        if len(bad):
            row, *leg = bad[0].tolist()
            index = f"[{leg[0] + 1}]" if leg else ""
            raise LogError(
                f"{log.where}: {name}{index} in row {row + 1} is {values[tuple(bad[0])]}; expected a finite number: "
                "cut the log there, or fill the gap where it was recorded"
            )


def force_of(log: Log) -> FloatArray:
    """The actuator forces (n, 6) [N].

    Raises
    ------
    LogError
        There are none.
    """
    if log.actuator_force is None:
        raise LogError(
            f"{log.where}: no forces; expected columns actuator_force[1..6], or motor_current[1..6] with "
            "force_per_current"
        )
    return log.actuator_force


def check_lengths(log: Log, platform: Platform) -> None:
    """Refuse leg lengths in another unit, or of another platform.

    Raises
    ------
    LogError
        Names the leg, its length, and what was expected.
    """
    home = np.asarray(leg_geometry(platform, platform.home_position, platform.home_orientation).length)
    found = np.median(log.leg_length, axis=0)
    ratio = found / home
    k = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
    if not 1 / _LENGTH_FACTOR < ratio[k] < _LENGTH_FACTOR:
        unit = _unit_for(ratio[k], {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6})
        raise LogError(
            f"{log.where}: leg {k + 1} has a median length of {found[k]:.6g} m, but {home[k]:.6g} m at home; expected "
            f"similar lengths. {unit}If encoders count from home, add the length at home"
        )


def check_forces(log: Log, platform: Platform) -> None:
    """Refuse forces in another unit, or beyond the actuators' limit.

    Raises
    ------
    LogError
        Names the forces, and what was expected.
    """
    force = force_of(log)
    weight = float(np.linalg.norm(static_leg_forces(platform, platform.home_position, platform.home_orientation)))
    found = float(np.median(np.linalg.norm(force, axis=1)))
    shares = np.abs(force).max(axis=0) / of_legs(platform, "actuator_force_max", np.inf)
    leg = int(shares.argmax())
    ratio = found / weight if weight > 0 else 1.0
    if not 1 / _FORCE_FACTOR < ratio < _FORCE_FACTOR:
        unit = _unit_for(ratio, {"N": 1.0, "kN": 1e-3, "mN": 1e3})
        raise LogError(
            f"{log.where}: the six forces have a median norm of {found:.4g} N, but those that hold the platform at "
            f"home have {weight:.4g} N; expected similar forces. {unit}Otherwise check force_per_current"
        )
    if shares[leg] > _OVER_LIMIT:
        strongest = float(np.abs(force[:, leg]).max())
        raise LogError(
            f"{log.where}: a force of {strongest:.6g} N exceeds actuator_force_max, {strongest / shares[leg]:g} N; "
            "check the unit, force_per_current, and the platform's limit"
        )


def _unit_for(ratio: float, units: dict[str, float]) -> str:
    """A sentence with the unit that would explain a ratio."""
    for unit, factor in units.items():
        if unit not in ("m", "N") and 1 / _LENGTH_FACTOR < ratio / factor < _LENGTH_FACTOR:
            return f"They look like {unit}: write the unit into the column names, such as 'name[1] [{unit}]'. "
    return ""


def on_one_axis(parts: Sequence[Part], times: Sequence[FloatArray]) -> tuple[FloatArray, list[tuple[float, float]]]:
    """Times (n,) of the rows of all parts for one chart, logs after each other, and the spans that validate [s]."""
    shifted, spans, end, shift = [], [], -math.inf, 0.0
    for k, (part, time) in enumerate(zip(parts, times, strict=True)):
        if not len(time):
            continue
        if k and part.which != parts[k - 1].which:
            shift = end - float(time[0]) + (float(np.median(np.diff(time))) if len(time) > 1 else 0.0)
        shifted.append(time + shift)
        end = float(shifted[-1][-1])
        aside = np.flatnonzero(~part.is_fitted(time))
        if aside.size:
            spans.append((float(shifted[-1][aside[0]]), end))
    return np.concatenate(shifted), spans

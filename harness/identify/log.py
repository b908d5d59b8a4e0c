"""Logs of machines: records of encoders, force sensors or motor currents, and possibly a tracker."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self, cast, get_args

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.motion.recorded.columns import other_headings
from gough_stewart.harness.motion.recorded.recording import converted
from gough_stewart.harness.plants.signals import Side
from gough_stewart.harness.pose_convention import OURS, QUATERNION, PoseConvention, RotationAbout, check_convention
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.table_file import (
    Heading,
    numbers_of,
    read_table,
    readable,
    times_of,
    timestamps_of,
    without_repeated_rows,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.units import UNITS
from gough_stewart.model.vectors import FloatArray

# A name, optionally with an index: "leg_length[1]", "leg_length_1".
_ELEMENT = re.compile(r"([A-Za-z][\w.]*?)(?:\[(\d+)\]|_(\d+))?")
_UNITS: dict[str, Mapping[str, float]] = {
    **UNITS,
    "N": {**UNITS["N"], "lbf": 4.4482216152605},
    "A": {"A": 1, "mA": 1e-3},
    "": {"": 1, "1": 1, "-": 1},
}
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
_NAMES = {name for names, _, _ in _QUANTITIES.values() for name in names}
# Only records of runs have it: their forces are held from row to row.
_OF_RUNS = "controller.force[1]"
_REMEDY = ": cut the log there, or fill the gap where it was recorded"
_FORM = "expected columns time, leg_length[1..6], actuator_force[1..6] or motor_current[1..6], units in the header"
_JITTER = 0.1  # of a row's time, in samples
_SLOWEST_SAMPLES = 0.1  # [s]
# Share of each log, taken from its end, that validates the fit.
VALIDATION = 0.2
# The arrays of a log.
_ARRAYS = ("leg_length", "time", "actuator_force", "position", "orientation", "motor_position")


class _Rows:
    """Arrays with a row for each sample."""

    def rows(self, which: slice | NDArray[np.intp]) -> Self:
        """The same with some of the rows."""
        signals = {name: values for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        some: Any = replace(cast(Any, self), **{name: values[which] for name, values in signals.items()})
        return cast(Self, some)


@dataclass(frozen=True, eq=False)
class Log(_Rows):
    """Recorded data of a machine in SI units, one row per sample; read from a file by `read_log`."""

    leg_length: FloatArray
    """Leg lengths (n, 6) [m]."""
    time: FloatArray | None = None
    """Times (n,) [s]; poses at rest need none."""
    actuator_force: FloatArray | None = None
    """Actuator forces (n, 6) [N]; positive extends the leg."""
    position: FloatArray | None = None
    """Positions of Op (n, 3) [m]."""
    orientation: FloatArray | None = None
    """Roll, pitch, yaw (n, 3) [rad]."""
    holds_force: bool = False
    """Whether a force acts from its row to the next, as with a sampled controller; else it is instantaneous."""
    where: str = "log"
    """The name of the log in messages."""
    side: Side = "leg"
    """For elastic legs: the side at which `leg_length` was measured, "leg" or "motor"."""
    motor_position: FloatArray | None = None
    """The motors' side of elastic legs (n, 6) [m], where both sides were measured."""
    convention: PoseConvention = OURS
    """In which the file had the poses."""

    def __post_init__(self) -> None:
        """Convert the arrays, and refuse shapes that do not belong together."""
        rows: tuple[int, ...] = ()
        for name in _ARRAYS:
            if (value := getattr(self, name)) is None and rows:
                continue
            try:
                values = np.asarray(value, dtype=float)
            except (ValueError, TypeError):  # ragged, or no numbers
                raise LogError(f"{self.where}: {name} is {value!r:.60}; expected an array of numbers") from None
            rows, size = rows or values.shape[:1], () if name == "time" else _QUANTITIES[name][1:2]
            if not rows or values.shape != (*rows, *size):
                expected = f"{(*rows, *size)}, a row for each of leg_length"
                if name == "leg_length":
                    expected = "(n, 6), a row for each time"
                raise LogError(f"{self.where}: {name} has the shape {values.shape}; expected {expected}")
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.leg_length)


@dataclass(frozen=True, eq=False)
class Part(_Rows):
    """A screened segment of a log at even times; rows before `fitted_until` are fitted, later ones validate the fit."""

    time: FloatArray  # (n,) [s]
    length: FloatArray  # (n, 6) [m]
    force: FloatArray  # (n, 6) [N]
    holds_force: bool = False
    side: Side = "leg"  # of the lengths
    motor: FloatArray | None = None  # the motors' positions (n, 6) [m], if legs are measured at both sides
    where: str = "log"
    which: int = 0  # the log that it is from, in their order
    fitted_until: float = math.inf  # [s]

    @property
    def step(self) -> float:
        """Time between rows [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    def is_fitted(self, time: FloatArray) -> NDArray[np.bool_]:
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
        For elastic legs: the side at which `leg_length` was measured, "leg" or "motor"; by default that of a record's
        sensors, else the leg's. Columns `motor_position[1..6]` are the motors', alone or beside `leg_length`.
    columns
        Columns of the file by these names, where its header has other ones: {"leg_length[1]": "S1 [mm]"}.
    rotation_order, rotation_about
        The order of the rotations about x, y and z, such as "ZYX", about "fixed" axes or those "moving" with the
        platform.
    frame
        "z_up", "z_down" (x forward, y right), or the file's axes in those of this project, such as "y,x,-z".
    pivot
        The point (3,) [m] whose position the file has, in the axes of the platform.
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

    See Also
    --------
    identify, Log, read_record

    Examples
    --------
    >>> files = gs.save_record(gs.run("heave_step", {"loop.duration": 0.1}), "results/heave")
    >>> gs.read_log("results/heave").leg_length.shape
    (101, 6)
    """
    path = Path(path)
    if path.is_dir():
        path = next((path / name for name in ("record.parquet", "record.csv") if (path / name).is_file()), path)
    if not path.is_file():
        raise LogError(f"{path}: no such file; expected a log as CSV or Parquet")
    try:
        table = read_table(path, "log")
        if rotation_order == QUATERNION:
            raise LogError(f"rotation_order is '{QUATERNION}'; expected that of angles; quaternions need none")
        convention = PoseConvention(rotation_order, rotation_about, frame, tuple(map(float, pivot)))
        table = _renamed(table, columns or {})
        metadata: Any = None  # of a run's record; other logs have none
        with suppress(OSError, ValueError, polars.exceptions.PolarsError):
            if path.suffix == ".parquet":
                text = polars.read_parquet_metadata(readable(path)).get("gough_stewart", "null")
            else:
                text = path.with_name("metadata.json").read_text("utf-8")
            metadata = json.loads(text)
        metadata = metadata if isinstance(metadata, dict) else {}
        log = _log_of(table, metadata, str(path), force_per_current, side, convention, gaps=gaps)
    except ValueError as error:  # of the convention, a motion, a table
        raise LogError(f"{path}: {error}") from error
    return log if holds_force is None else replace(log, holds_force=holds_force)


def log_of(record: Record) -> Log:
    """The log of a run: sensor values, true values of signals without a sensor, and forces."""
    try:
        return _log_of(record.table, record.metadata, "record")
    except ValueError as error:
        raise LogError(f"record: {error}") from error


def _log_of(  # noqa: PLR0912, PLR0915 - one quantity after the other
    table: polars.DataFrame,
    metadata: Mapping[str, Any],
    where: str,
    force_per_current: float | None = None,
    side: Side | None = None,
    convention: PoseConvention = OURS,
    *,
    gaps: bool = False,
) -> Log:
    """The log of a table; errors are without its name."""
    elements: dict[tuple[str, int], Heading] = {}
    for heading in map(Heading.of, table.columns):
        match = _ELEMENT.fullmatch(heading.name)
        if match is not None and match[1] in _NAMES:
            element = match[1], int(match[2] or match[3] or 1)
            if (other := elements.setdefault(element, heading)) is not heading:
                raise LogError(f"has {other.column} and {heading.column}, which mean the same; remove one of them")
    columns: dict[str, list[tuple[str, float]]] = {}  # of each quantity, with factors to SI units
    for quantity, (names, size, unit) in _QUANTITIES.items():
        name = next((name for name in names if any((name, k) in elements for k in range(1, size + 1))), None)
        if name is None:
            continue
        missing = [f"{name}[{k}]" for k in range(1, size + 1) if (name, k) not in elements]
        if missing:
            raise LogError(f"has no column {', '.join(missing)}; {_FORM}")
        headings = [elements[name, k] for k in range(1, size + 1)]
        columns[quantity] = [(heading.column, heading.factor(_UNITS[unit])) for heading in headings]
    values = dict[str, FloatArray]()
    for quantity, heads in columns.items():
        if quantity != "time":
            may_lack = gaps and quantity == "leg_length"
            numbers = [factor * numbers_of(table, head, _REMEDY, gaps=may_lack) for head, factor in heads]
            values[quantity] = np.stack(numbers, axis=1)
    time = None
    if "time" in columns:
        [(column, factor)] = columns["time"]
        first, since = times_of(table, column, _REMEDY)
        time = factor * (since if column in timestamps_of(table) else first + since)
        if _OF_RUNS not in table.columns and values:
            rows = without_repeated_rows(since, np.hstack(list(values.values())))
            time, values = time[rows], {name: readings[rows] for name, readings in values.items()}
    # of a run's experiment
    tables = metadata.get("experiment")
    of_sensors = tables.get("sensors") if isinstance(tables, Mapping) else None
    sensors: Mapping[str, Any] = of_sensors if isinstance(of_sensors, Mapping) else {}
    log_side = _sides(values, sensors.get("side", "leg") == "motor", side, "measured.leg_length[1]" in table.columns)
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
                f"has motor currents, but force_per_current is {force_per_current}; expected the factor [N/A], torque "
                "constant · 2π · efficiency / lead"
            )
        force = values["motor_current"] * force_per_current
    holds_force, motor = _OF_RUNS in table.columns, values.get("motor_position")
    log = Log(values["leg_length"], time, force, position, orientation, holds_force, where, log_side, motor, convention)
    if len(log) < 2:
        raise LogError(f"{len(log)} rows; expected a log of some seconds, or of several poses")
    # of a run the rows at which its controller, and sensors of their own rhythm, were sampled, with mean forces;
    # readings of slower sensors then repeat, which `without_held_rows` recognises
    sample, step = metadata.get("sample_time"), metadata.get("plant_step")
    if not holds_force or not sample or not step or force is None:
        return log
    # a force that varies between two readings has no one time, so its samples are kept
    reading = sensors.get("sample_time") or 0.0
    every = math.gcd(round(sample / step), round(max(sample, reading) / step))
    n = len(log) // every
    if every < 2 or n < 2:
        return log
    mean = force[: n * every].reshape(n, every, 6).mean(axis=1)
    return replace(log.rows(slice(0, n * every, every)), actuator_force=mean)


def _sides(values: dict[str, FloatArray], is_read_at_motors: bool, side: Side | None, has_readings: bool) -> Side:
    """The side of the lengths; a record of a run read at the motors has no lengths of the legs, which none measured."""
    if side is not None and side not in get_args(Side):
        raise LogError(f"side is {side!r}; expected one of {', '.join(get_args(Side))}")
    if is_read_at_motors:
        motors = values.pop("motor_position", None)
        if not has_readings and motors is not None:
            values["leg_length"] = motors
        return side or "motor"
    if "leg_length" not in values:
        if "motor_position" not in values:
            raise LogError(f"no leg lengths; {_FORM}")
        values["leg_length"] = values.pop("motor_position")
        if side == "leg":
            raise LogError("has motor_position only, but side is 'leg'; expected leg_length[1..6]")
        return "motor"
    if side == "motor" and "motor_position" in values:
        raise LogError(
            "has motor_position beside leg_length, so the latter is the legs', but side is 'motor'; leave side away, "
            "or remove one of both"
        )
    return side or "leg"


def _renamed(table: polars.DataFrame, chosen: Mapping[str, str]) -> polars.DataFrame:
    """The table with this project's names for the chosen columns, and for those with usual names.

    Refuses a column under a usual name without a unit, whose numbers could be in any.
    """

    def name_of(column: str) -> str:
        match = _ELEMENT.fullmatch(name := Heading.of(column).name)
        index = match and (match[2] or match[3])
        return f"{match[1]}[{index}]" if match and index else name

    headings = other_headings(table.columns, chosen)
    present = set(map(name_of, table.columns)) - set(chosen)
    timestamps, names = timestamps_of(table), dict[str, str]()
    for name, heading in headings.items():
        kind = name.partition("[")[0]
        if name in present or any(other.startswith("measured." + kind) for other in present):
            continue
        needs_none = kind == "quaternion" or (kind == "time" and heading.column in timestamps)
        if heading.unit is None and not needs_none:
            raise LogError(
                f"the column {heading.column} is {name}, without a unit; expected it in the header, as "
                f"'{heading.name} [{'ms' if kind == 'time' else 'deg' if kind == 'orientation' else 'mm'}]', or in "
                f"columns={{'{name}': '{heading.name} [UNIT]'}}"
            )
        names[heading.column] = name if needs_none or heading.unit is None else f"{name} [{heading.unit}]"
    replaced = [column for column in table.columns if column not in names and name_of(column) in chosen]
    return table.drop(replaced).rename(names)


def check_poses(log: Log, platform: Platform, leg_length: FloatArray | None = None) -> None:
    """Refuse measured poses that contradict the leg lengths, or `leg_length`, and fit them in another convention."""
    if log.position is None or log.orientation is None:
        return
    try:
        lengths = log.leg_length if leg_length is None else leg_length
        check_convention(platform, lengths, log.position, log.orientation, log.convention)
    except ValueError as error:
        raise LogError(f"{log.where}: {error}") from error


def rows_apart(log: Log) -> tuple[FloatArray, NDArray[np.intp], float]:
    """The times (n,) [s], how many sample times each is after the one before (n − 1,), and the sample time."""
    if log.time is None:
        raise LogError(f"{log.where}: no column time; expected one, since the motion between rows is needed")
    time, steps = log.time, np.diff(log.time)
    h = float(np.median(steps))
    back = np.flatnonzero(steps <= 0)
    if back.size:
        k = int(back[0])
        raise LogError(
            f"{log.where}: time goes from {time[k]:.9g} to {time[k + 1]:.9g} s in row {k + 2}; expected increasing "
            "times"
        )
    resolution = float(np.spacing(np.float32(np.abs(time).max())))
    if resolution > _JITTER * h and (time.astype(np.float32) == time).all():
        raise LogError(
            f"{log.where}: times are numbers of 32 bits, {resolution:.2g} s apart at {np.abs(time).max():.6g} s, "
            f"where rows are {h:.2g} s apart; expected even times: write 64 bits, or count from the first row"
        )
    number = np.rint(steps / h)
    off = np.abs(steps - number * h)
    # of a long gap, the clock's own error adds up
    uneven = np.flatnonzero((off > _JITTER * h) & (off > 1e-3 * steps))
    if uneven.size:
        k = int(uneven[0])
        raise LogError(
            f"{log.where}: a step of {steps[k]:.6g} s after row {k + 1} (time {time[k]:.6g} s), where rows are "
            f"{h:.6g} s apart, and {uneven.size - 1} more; expected even times, or gaps of whole rows: record "
            "again, or interpolate to even times"
        )
    if h > _SLOWEST_SAMPLES:
        raise LogError(
            f"{log.where}: rows are {h:g} s apart; expected at most {_SLOWEST_SAMPLES:g} s for a motion. If time is "
            "in ms, name the column 'time [ms]'"
        )
    number = np.maximum(number, 1)
    return time, number.astype(np.intp), float(time[-1] - time[0]) / float(number.sum())

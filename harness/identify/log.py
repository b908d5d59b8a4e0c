"""Logs of machines: records of encoders, force sensors or motor currents, and possibly a tracker."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError, TableError
from gough_stewart.harness.plants.signals import Side
from gough_stewart.harness.polars_paths import readable
from gough_stewart.harness.results.record import Record
from gough_stewart.harness.table_file import Heading, numbers_of, read_table
from gough_stewart.model.units import UNITS
from gough_stewart.model.vectors import FloatArray

# A name, optionally with an index: "leg_length[1]", "leg_length_1".
_ELEMENT = re.compile(r"([A-Za-z][\w.]*?)(?:\[(\d+)\]|_(\d+))?")
_UNITS = {**UNITS, "A": {"A": 1, "mA": 1e-3}}
# Possible column names of each quantity, preferred first, with size and unit.
_QUANTITIES = {
    "time": (("time",), 1, "s"),
    "leg_length": (("measured.leg_length", "leg_length"), 6, "m"),
    "motor_position": (("motor_position",), 6, "m"),
    "actuator_force": (("measured.actuator_force", "actuator_force", "controller.force"), 6, "N"),
    "motor_current": (("motor_current",), 6, "A"),
    "position": (("measured.position", "position"), 3, "m"),
    "orientation": (("measured.orientation", "orientation"), 3, "rad"),
}
# Only records of runs have it: their forces are held from row to row.
_OF_RUNS = "controller.force[1]"
_FORM = "expected columns time, leg_length[1..6], actuator_force[1..6] or motor_current[1..6], units in the header"


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


def read_log(
    path: Path | str,
    force_per_current: float | None = None,
    *,
    holds_force: bool | None = None,
    side: Side | None = None,
) -> Log:
    """Read a log from CSV or Parquet: a record of `run`, or columns of a machine with units in their names.

    Columns: `time`, `leg_length[1..6]`, `actuator_force[1..6]` or `motor_current[1..6]`, and, if poses were measured,
    `position[1..3]` and `orientation[1..3]`. Write units after the names: `time [ms]`, `leg_length[1] [mm]`; without a
    unit, values are in SI. `leg_length_1` is the same as `leg_length[1]`. From a record of a run, sensor values are
    used, and true values of signals without a sensor.

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

    Returns
    -------
    Log
        Arrays in SI units, a row for each time; None for signals that the log does not have.

    Raises
    ------
    LogError
        The file cannot be read, lacks columns, or has a value that is not a finite number; names column and row.

    Examples
    --------
    >>> files = gs.save_record(gs.run("heave_step", {"loop.duration": 0.1}), "results/heave")
    >>> gs.read_log("results/heave").leg_length.shape
    (101, 6)
    """
    path = Path(path)
    if path.is_dir():
        path = next((path / name for name in ("record.parquet", "record.csv") if (path / name).is_file()), path)
    log = _log_of(_table(path), _metadata(path), str(path), force_per_current, side)
    return log if holds_force is None else replace(log, holds_force=holds_force)


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
) -> Log:
    found = _columns(table.columns, path)
    values = {name: _numbers(table, columns, path) for name, columns in found.items()}
    own_side = _sides(values, metadata, side, "measured.leg_length[1]" in table.columns, path)
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
        values.get("position"),
        values.get("orientation"),
        _OF_RUNS in table.columns,
        path,
        own_side,
        values.get("motor_position"),
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


def _numbers(table: polars.DataFrame, columns: list[tuple[str, float]], path: str) -> FloatArray:
    remedy = ": cut the log there, or fill the gap where it was recorded"
    try:
        return np.stack([factor * numbers_of(table, head, remedy) for head, factor in columns], axis=1)
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

"""The rows of a run as a table, one per time, in SI units; how much they use of limits, and what failed in them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import polars

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.plants.signals import AT_MOTORS
from gough_stewart.harness.report.quantities import FORCE, POWER, VELOCITY, Quantity, listed
from gough_stewart.model import interface
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, repr=False)
class RecordData:
    """Table and metadata of a record, by the names of signals."""

    table: polars.DataFrame
    metadata: dict[str, Any]

    def __getitem__(self, name: str) -> FloatArray:
        """A column (n,), or all columns of a variable (n, size): `record["position"]`, `record["error.leg_length"]`.

        A RecordError for another name suggests the nearest one.
        """
        if name in self.table.columns:
            return self.table.get_column(name).to_numpy()
        columns = self.columns_of(name)
        if not columns:
            variables = list(dict.fromkeys(column.partition("[")[0] for column in self.table.columns))
            raise RecordError(f"the record has no '{name}'{interface.nearest(name, variables)}")
        return np.column_stack([self.table.get_column(column).to_numpy() for column in columns])

    def __contains__(self, name: str) -> bool:
        """Whether a column or variable of this name exists."""
        return any(column == name or column.startswith(f"{name}[") for column in self.table.columns)

    def columns_of(self, name: str) -> list[str]:
        """The columns of a variable."""
        return [column for column in self.table.columns if column.startswith(f"{name}[")]


class DriveLimit(NamedTuple):
    """A limit of the platform on what its drives do."""

    name: str  # of the platform's parameter
    text: str
    quantity: Quantity


DRIVE_LIMITS = (
    DriveLimit("leg_velocity_max", "leg velocity", VELOCITY),
    DriveLimit("actuator_force_max", "actuator force", FORCE),
    DriveLimit("actuator_power_max", "actuator power", POWER),
)


def column_of_drives(record: RecordData, name: str) -> str:
    """The column with what the drives move, by the motors' name: `leg_length`, `leg_velocity` if legs are rigid."""
    legs = {motor: leg for leg, motor in AT_MOTORS.items()}
    return name if name in record else legs.get(name, name)


def shares_of_limits(record: RecordData, platform: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Share of each stated limit that each leg uses (n, 6) [1], by the limit's name; 1 is at the limit.

    Limits are those of |ṡ|, |F|, and |F ṡ|, the larger of the values at both ends of the row. The force is held over
    its row, so ṡ at its end is that of the next row; the last row has none. Nothing of a record without ṡ or F.
    """
    names = (column_of_drives(record, "motor_velocity"), "actuator_force")
    if not all(name in record for name in names):
        return {}
    velocity, force = (np.abs(record[name]) for name in names)
    power = np.concatenate([np.maximum(velocity[:-1], velocity[1:]), velocity[-1:]]) * force
    return {
        limit.name: values / np.asarray(platform[limit.name])
        for limit, values in zip(DRIVE_LIMITS, (velocity, force, power), strict=True)
        if platform.get(limit.name) is not None
    }


def nearness_to_limits(record: RecordData, platform: Platform) -> dict[str, FloatArray]:
    """Nearness of each leg to each limit of the platform or its actuators (n, 6) [1]; 1 is at the limit.

    - `stroke`: |L − middle| over half the stroke;
    - `force`: |F| over the limit of the actuators in the loop;
    - `velocity`, `power`: |ṡ| and |F ṡ| of the drives over the platform's limits;
    - `joint angle`: the larger angle of the leg's two joints from home over the largest allowed.
    """
    nearness: dict[str, FloatArray] = {}
    low, high = (of_legs(platform, name, np.nan) for name in ("leg_length_min", "leg_length_max"))
    if platform.stroke is not None:
        nearness["stroke"] = np.abs(record["leg_length"] - (low + high) / 2) / ((high - low) / 2)
    if record.metadata.get("force_limit"):
        nearness["force"] = np.abs(record["actuator_force"]) / record.metadata["force_limit"]
    shares = shares_of_limits(record, platform.as_dict())
    names = {"velocity": "leg_velocity_max", "power": "actuator_power_max"}
    nearness |= {drive: shares[name] for drive, name in names.items() if name in shares}
    if platform.joint_angle_max is not None:
        pose = (record["position"], record["orientation"])
        angles = joint_angles(platform, *pose, platform.home_position, platform.home_orientation)
        nearness["joint angle"] = np.maximum(*angles) / platform.joint_angle_max
    return nearness


class FaultSpan(NamedTuple):
    """A fault of an experiment, or its controller off: what failed, and when."""

    text: str  # "leg 3 without force"
    begin: float  # [s]
    end: float | None  # [s]; None if it lasts

    def __str__(self) -> str:
        return f"{self.text} from {self.begin:.4g}{'' if self.end is None else f' to {self.end:.4g}'} s"


def faults_of(metadata: Mapping[str, Any]) -> list[FaultSpan]:
    """Of a run's or ensemble's metadata, the faults and when the controller is off, in order of time."""
    spans, experiment = list[FaultSpan](), metadata.get("experiment") or {}
    switches = [change for change in experiment.get("change") or () if change.get("enabled") is not None]
    begin: float | None = None
    for change in sorted(switches, key=lambda change: float(change["at"])):
        if change["enabled"] and begin is not None:
            spans.append(FaultSpan("controller off", begin, float(change["at"])))
        begin = None if change["enabled"] else float(change["at"]) if begin is None else begin
    spans += [] if begin is None else [FaultSpan("controller off", begin, None)]
    for fault in experiment.get("fault") or ():
        cut, texts = fault.get("cut") or [], list[str]()
        if cut:
            texts.append(f"{'leg' if len(cut) == 1 else 'legs'} {listed(list(map(str, cut)))} without force")
        for name, elements in (fault.get("freeze") or {}).items():
            texts.append(f"{name} {listed(list(map(str, elements)))} frozen")
        end = None if fault.get("duration") is None else fault["at"] + fault["duration"]
        spans.append(FaultSpan(listed(texts), float(fault["at"]), end))
    return sorted(spans, key=lambda span: span.begin)

"""Signals of records for charts, with unit, components and group: from columns and from kinematics."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from gough_stewart.harness.loop.folds import error_between
from gough_stewart.harness.output.display_resolution import factor_to
from gough_stewart.harness.results.limits import column_of_drives
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.model import interface
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

AXES = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")
LEGS = tuple(f"leg {i}" for i in range(1, 7))
# The charts shown when a page opens.
SHOWN = (
    "position from home",
    "orientation from home",
    "error.position",
    "error.orientation",
    "actuator_force",
    "leg_length",
    "leg_velocity",
    "actuator power",
    "condition number",
)
# Groups, in the order of the list of charts.
GROUPS = (
    "pose",
    "velocities",
    "legs",
    "actuators",
    "errors",
    "reference",
    "disturbance",
    "controller",
    "sensors",
    "flags",
    "energy",
    "parameters",
    "other",
)
_GROUP_OF_VARIABLE = {
    **dict.fromkeys(("position", "orientation"), "pose"),
    **dict.fromkeys(("velocity", "angular_velocity", "acceleration", "angular_acceleration"), "velocities"),
    **dict.fromkeys(("leg_length", "leg_velocity", "joint_force"), "legs"),
    **dict.fromkeys(("external_force", "external_torque"), "disturbance"),
    **dict.fromkeys(("kinetic_energy", "potential_energy"), "energy"),
    **dict.fromkeys(("actuator_force", "motor_position", "motor_velocity"), "actuators"),
    **dict.fromkeys(("leg_force", "leg_bristle"), "legs"),
}
_GROUP_OF_PREFIX = {
    "error": "errors",
    "reference": "reference",
    "controller": "controller",
    "measured": "sensors",
    "flag": "flags",
}
# Units of signals that the interface does not declare; the states of a controller have no common unit.
_CONTROLLER_UNITS = {"force": "N", "feedforward": "N", "injection": "N"}
# Display units of errors; other angles are shown in degrees, everything else in its declared unit.
_ERROR_UNITS = {"m": "mm", "rad": "deg"}
_TITLES = {
    "error.position": "position error",
    "error.orientation": "orientation error",
    "error.leg_length": "leg length error",
    "leg_velocity": "sliding velocity of legs",
    "leg_length": "length of legs",
    "flag.force_limited": "force limit active",
    "flag.rate_limited": "force rate limit active",
    "flag.stroke_exceeded": "beyond the stroke",
}
_TIME = "time"


@dataclass(frozen=True)
class Signal:
    """A variable of records over time, as displayed."""

    name: str
    title: str
    group: str
    unit: str
    # A name for each column; legs and axes can be selected.
    components: tuple[str, ...]
    kind: Literal["axes", "legs", "other"]
    # Columns (n, size) in the unit, by record; None where a record has no such variable.
    values: tuple[FloatArray | None, ...]
    # Name of the signal drawn with it as its reference.
    reference: str | None = None
    # Limits [unit].
    limits: tuple[float, ...] = ()

    @property
    def is_flag(self) -> bool:
        """Whether it is a boolean, which is held from row to row."""
        return self.group == "flags"


def signals_of(records: Sequence[RecordData], platforms: Sequence[Platform]) -> list[Signal]:
    """All numeric columns of the records as variables, and signals computed by kinematics; `SHOWN` first."""
    names = dict.fromkeys(
        column.partition("[")[0] for record in records for column in record.table.columns if column != _TIME
    )
    found = [signal for name in names for signal in _variable(name, records)]
    found = _with_limits([*_from_home(records, platforms), *found, *_computed(records, platforms)], records, platforms)
    found = [signal for signal in found if any(values is not None for values in signal.values)]
    known = {signal.name for signal in found}
    found = [s if s.reference in known else replace(s, reference=None) for s in found]
    order = {name: k for k, name in enumerate(SHOWN)}
    return sorted(found, key=lambda signal: (order.get(signal.name, len(SHOWN)), GROUPS.index(signal.group)))


def _variable(name: str, records: Sequence[RecordData]) -> list[Signal]:
    """The signal of a variable; for forces at the joints, one signal per axis."""
    prefix, _, rest = name.rpartition(".")
    declared = interface.BY_NAME.get(rest) if prefix in ("", "reference", "error", "measured") else None
    shape: tuple[int, ...] = (6,) if prefix == "flag" or (prefix == "controller" and rest in _CONTROLLER_UNITS) else ()
    unit = _CONTROLLER_UNITS.get(rest, "") if prefix == "controller" else ""
    if declared is not None:
        unit, shape = declared.unit, declared.shape
    group = _GROUP_OF_PREFIX.get(prefix, _GROUP_OF_VARIABLE.get(name, "other"))
    if group == "other" and declared is not None:
        group = "parameters"
    shown = _ERROR_UNITS.get(unit, unit) if prefix == "error" else {"rad": "deg"}.get(unit, unit)
    columns = [_columns(record, name, factor_to(shown) if unit else 1.0) for record in records]
    sizes = {values.shape[1] for values in columns if values is not None}
    words = _TITLES.get(name, f"{prefix} {rest}".strip().replace("_", " "))
    signal = Signal(name, words, group, shown, (), "other", tuple(columns))
    if shape == (6, 3) and sizes == {18}:
        parts = [tuple(None if c is None else c[:, k::3] for c in columns) for k in range(3)]
        return [
            replace(signal, name=f"{name} {axis}", title=f"{words}, {axis}", components=LEGS, kind="legs", values=part)
            for axis, part in zip(AXES, parts, strict=True)
        ]
    if shape == (3,) and sizes == {3}:
        is_pose = rest == "orientation"
        return [
            replace(
                signal,
                components=_ANGLES if is_pose else AXES,
                kind="axes",
                reference=_reference(name, records),
            )
        ]
    if shape == (6,) and sizes == {6}:
        return [replace(signal, components=LEGS, kind="legs", reference=_reference(name, records))]
    size = max(sizes)
    widened = tuple(None if c is None or c.shape[1] < size else c for c in columns)
    components = (words,) if size == 1 else tuple(str(k + 1) for k in range(size))
    return [replace(signal, components=components, values=widened)]


def _columns(record: RecordData, name: str, factor: float) -> FloatArray | None:
    if name not in record:
        return None
    values: FloatArray = np.asarray(record[name], dtype=float)
    return factor * values.reshape(len(values), -1)


def _reference(name: str, records: Sequence[RecordData]) -> str | None:
    reference = f"reference.{name}"
    return reference if any(reference in record for record in records) else None


def _from_home(records: Sequence[RecordData], platforms: Sequence[Platform]) -> list[Signal]:
    """The pose relative to home, with the rotation from home as vector about the world's axes, and its reference."""
    found = []
    for name, unit, components in (("position", "mm", AXES), ("orientation", "deg", _ANGLES)):
        for prefix in ("", "reference."):
            values = tuple(
                factor_to(unit)
                * error_between(name, record[prefix + name].T, getattr(platform, f"home_{name}")[:, None]).T
                if prefix + name in record
                else None
                for record, platform in zip(records, platforms, strict=True)
            )
            title = f"{prefix.replace('.', ' ')}{name} from home"
            group = "reference" if prefix else "pose"
            reference = None if prefix else f"reference.{name} from home"
            found.append(Signal(f"{prefix}{name} from home", title, group, unit, components, "axes", values, reference))
    return found


def _computed(records: Sequence[RecordData], platforms: Sequence[Platform]) -> list[Signal]:
    """Power of the actuators, and condition number of the leg Jacobian."""
    powers = tuple(r["actuator_force"] * r[column_of_drives(r, "motor_velocity")] for r in records)
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        condition = tuple(
            conditioning(p, r["position"], r["orientation"]).condition_number[:, None]
            for r, p in zip(records, platforms, strict=True)
        )
    return [
        Signal("actuator power", "actuator power of legs", "actuators", "W", LEGS, "legs", powers),
        Signal(
            "condition number",
            "condition number of the leg Jacobian",
            "legs",
            "1",
            ("condition number",),
            "other",
            condition,
        ),
    ]


def _with_limits(
    signals: Iterable[Signal], records: Sequence[RecordData], platforms: Sequence[Platform]
) -> list[Signal]:
    """Limits that are the same in all records."""

    def common(limit: Callable[[RecordData, Platform], float | None]) -> tuple[float, ...]:
        different = {limit(record, platform) for record, platform in zip(records, platforms, strict=True)}
        (one,) = different if len(different) == 1 else (None,)
        return () if one is None else (float(one),)

    def both(limit: Callable[[RecordData, Platform], float | None]) -> tuple[float, ...]:
        return tuple(sign * size for size in common(limit) for sign in (1, -1))

    velocity = "motor_velocity" if any("motor_velocity" in record for record in records) else "leg_velocity"
    limits = {
        "leg_length": common(lambda _, p: p.leg_length_min) + common(lambda _, p: p.leg_length_max),
        velocity: both(lambda _, p: p.leg_velocity_max),
        "actuator_force": both(lambda r, _: r.metadata.get("force_limit")),
        "actuator power": both(lambda _, p: p.actuator_power_max),
    }
    return [replace(signal, limits=limits.get(signal.name, ())) for signal in signals]

"""Scene and charts of runs for a report: bodies in motion, and all signals over time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.loop.folds import error_between
from gough_stewart.harness.report.chart import Axis, Chart, Flag, Mark, Scene, Series, Strip, strip_of, time_axis
from gough_stewart.harness.report.document import Section
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import NUMBER, Quantity, fineness_of, of_unit
from gough_stewart.harness.results.metrics import finite_part
from gough_stewart.harness.results.record_data import (
    RecordData,
    column_of_drives,
    faults_of,
    nearness_to_limits,
    shares_of_limits,
)
from gough_stewart.model import interface
from gough_stewart.model.kinematics import conditioning
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

# Frames of all records of a page together; for 10 s at 1 kHz, 200 frames per second.
FRAMES = 2001
FLAGS = ("force_limited", "rate_limited", "stroke_exceeded")
# Shares by which the two parts of a leg overlap at its longest, and keep clear of the other's joint at its shortest.
_OVERLAP, _SHORTEST = 0.06, 0.97
AXES, _ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
LEGS = tuple(f"leg {i}" for i in range(1, 7))
# The charts that a report has before all others.
FIRST = (
    *("error.position", "error.orientation", "position from home", "orientation from home", "actuator_force"),
    "leg_length",
)
# Those that follow first among the others.
_SECOND = ("leg_velocity", "actuator power", "condition number")
# Groups of signals, in the order of the list of charts, with the prefix or the variables of a record.
_GROUPED: Mapping[str, tuple[str, ...]] = {
    "pose": ("position", "orientation"),
    "velocities": ("velocity", "angular_velocity", "acceleration", "angular_acceleration"),
    "legs": ("leg_length", "leg_velocity", "joint_force", "leg_force", "leg_bristle"),
    "actuators": ("actuator_force", "motor_position", "motor_velocity"),
    "errors": ("error",),
    "reference": ("reference",),
    "disturbance": ("external_force", "external_torque"),
    "controller": ("controller",),
    "sensors": ("measured",),
    "flags": ("flag",),
    "energy": ("kinetic_energy", "potential_energy"),
    "parameters": (),
    "other": (),
}
_GROUP_OF = {name: group for group, names in _GROUPED.items() for name in names}
# Those of a controller [N]; its states have no common unit.
_CONTROLLER_FORCES = ("force", "feedforward", "injection")
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
# Strips for what acts or is exceeded.
_REACHED: Mapping[str, tuple[str, Role]] = {
    "force_limited": ("force at its limit", "bad"),
    "rate_limited": ("force rate at its limit", "neutral"),
    "stroke_exceeded": ("beyond the stroke", "marginal"),
    "leg_velocity_max": ("leg speed beyond its limit", "published"),
    "actuator_power_max": ("power beyond its limit", "measured"),
}
# Larger values overflow the arithmetic of axes, and no platform has them.
_LARGEST = 1e9
_DRAWN = ("position", "orientation", "leg_length", "actuator_force")


@dataclass(frozen=True, eq=False)
class DrawnRun:
    """A run as it is drawn: its rows that are finite, and its machine."""

    record: RecordData
    machine: Platform
    name: str


def shown(record: RecordData, machine: Platform, name: str) -> DrawnRun | None:
    """The drawable part of a record; None if it has no row."""
    finite = finite_part(record)
    if not all(name in finite for name in _DRAWN):
        return None
    small = np.max([np.abs(finite[column]).max(axis=1, initial=0.0) for column in _DRAWN], axis=0) < _LARGEST
    rows = finite.table.height if small.all() else int(small.argmin())
    return DrawnRun(RecordData(finite.table.head(rows), record.metadata), machine, name) if rows else None


# --- the scene -------------------------------------------------------------------------------------------------------


def scenes(runs: Sequence[DrawnRun]) -> list[Scene]:
    """The platforms in motion; they share the frames.

    Frames have the values of their rows: time, pose, leg lengths, forces, reference, neither interpolated nor rounded.
    Flags cover the time from each frame to the next, and are set if they are set in any row of it.
    """
    of_runs, most = list[Scene](), max(FRAMES // len(runs), 101)
    for k, run in enumerate(runs):
        record, platform = run.record, run.machine
        # every s-th row and the last, with the smallest s that keeps to this number of frames
        stride = max(1, math.ceil((record.table.height - 1) / (most - 1)))
        rows = np.unique(np.append(np.arange(0, record.table.height, stride), record.table.height - 1))
        few = RecordData(record.table[rows], record.metadata)
        # drawn parts of a leg overlap at all lengths that occur or are allowed; no parameter sets their shape
        low = min(float(record["leg_length"].min()), float(of_legs(platform, "leg_length_min", math.inf).min()))
        high = max(float(record["leg_length"].max()), float(of_legs(platform, "leg_length_max", 0.0).max()))
        lower = min(_SHORTEST * low, (0.5 + _OVERLAP / 2) * high)
        upper = min(_SHORTEST * low, high - lower + _OVERLAP * high)
        nearness, flags = nearness_to_limits(few, platform), list[Flag]()
        for flag in FLAGS:
            if f"flag.{flag}" in record:
                is_set = np.asarray(record[f"flag.{flag}"].astype(bool).any(axis=1))
                flags.append(Flag(flag, "".join("01"[int(is_set[a:b].any())] for a, b in pairwise(rows))))
        has_reference = "reference.position" in few
        scene = Scene(
            run.name,
            platform.base_points,
            platform.platform_points,
            lower,
            upper,
            few["time"],
            _poses(few["position"], few["orientation"]),
            few["leg_length"],
            home=_poses(platform.home_position, platform.home_orientation),
            orientation=few["orientation"],
            reference=_poses(few["reference.position"], few["reference.orientation"]) if has_reference else None,
            actuator_force=few["actuator_force"],
            external_force=few["external_force"] if few["external_force"].any() else None,
            nearness=np.max(list(nearness.values()), axis=0) if nearness else None,
            nearness_of=tuple(nearness),
            flags=tuple(flags),
            rows=record.table.height,
            run=k if len(runs) > 1 else None,
            decimals=max(4, 3 + round(-math.log10(fineness_of(platform)))),
        )
        of_runs.append(scene)
    return of_runs


def _poses(position: FloatArray, orientation: FloatArray) -> FloatArray:
    """Position and quaternion (x, y, z, w) of platforms (…, 7)."""
    from scipy.spatial.transform import Rotation  # needed only for pages, and slow to import (0.2 s)

    rotation = matrix_from_orientation(orientation)
    return np.concatenate([position, Rotation.from_matrix(rotation).as_quat()], axis=-1)


# --- signals ---------------------------------------------------------------------------------------------------------


class Signal(NamedTuple):
    """A variable of runs over time, as displayed."""

    name: str
    title: str
    group: str
    quantity: Quantity
    components: tuple[str, ...]  # a name for each column; those of `LEGS` can be selected
    values: tuple[FloatArray | None, ...]  # columns (n, size) in SI units, by run; None where a record has none
    reference: str = ""  # name of the signal drawn with it as its reference


def _signals(runs: Sequence[DrawnRun]) -> dict[str, Signal]:
    """All numeric columns of runs as variables, and signals computed by kinematics, by name, in order."""
    signals, records = list[Signal](), [run.record for run in runs]
    # the pose from home, its rotation as a vector about the world's axes, and the same of its reference
    for name, unit, components in (("position", "mm", AXES), ("orientation", "deg", _ANGLES)):
        for prefix, group in (("", "pose"), ("reference.", "reference")):
            poses = tuple(
                error_between(name, run.record[prefix + name].T, getattr(run.machine, f"home_{name}")[:, None]).T
                if prefix + name in run.record
                else None
                for run in runs
            )
            from_home = f"{prefix}{name} from home"
            title, reference = from_home.replace(".", " "), "" if prefix else f"reference.{from_home}"
            signals.append(Signal(from_home, title, group, of_unit(unit), components, poses, reference))
    for name in dict.fromkeys(column.partition("[")[0] for record in records for column in record.table.columns):
        if name == "time":
            continue
        prefix, _, rest = name.rpartition(".")
        unit, shape = "", tuple[int, ...]()
        declared = interface.BY_NAME.get(rest) if prefix in ("", "reference", "error", "measured") else None
        if declared is not None:
            unit, shape = declared.unit, declared.shape
        elif prefix == "flag":
            shape = (6,)
        elif prefix == "controller" and rest in _CONTROLLER_FORCES:
            unit, shape = "N", (6,)
        group = _GROUP_OF.get(prefix or name, "other" if declared is None else "parameters")
        quantity = of_unit("mm" if prefix == "error" and unit == "m" else unit) if unit else NUMBER
        columns = tuple(
            np.asarray(record[name], dtype=float).reshape(record.table.height, -1) if name in record else None
            for record in records
        )
        title = _TITLES.get(name, f"{prefix} {rest}".strip().replace("_", " "))
        sizes = {values.shape[1] for values in columns if values is not None}
        signal = Signal(name, title, group, quantity, LEGS, columns, f"reference.{name}")
        if shape == (6, 3) and sizes == {18}:
            for k, axis in enumerate(AXES):
                values = tuple(None if values is None else values[:, k::3] for values in columns)
                signals.append(signal._replace(name=f"{name} {axis}", title=f"{title}, {axis}", values=values))
        elif shape == (6,) and sizes == {6}:
            signals.append(signal)
        elif shape == (3,) and sizes == {3}:
            signals.append(signal._replace(components=_ANGLES if rest == "orientation" else AXES))
        else:
            size = max(sizes)
            numbered = (title,) if size == 1 else tuple(str(k + 1) for k in range(size))
            complete = tuple(None if values is None or values.shape[1] < size else values for values in columns)
            signals.append(signal._replace(components=numbered, values=complete, reference=""))
    velocities = [column_of_drives(record, "motor_velocity") for record in records]
    powers = tuple(
        record["actuator_force"] * record[velocity] if "actuator_force" in record and velocity in record else None
        for record, velocity in zip(records, velocities, strict=True)
    )
    signals.append(Signal("actuator power", "actuator power of legs", "actuators", of_unit("W"), LEGS, powers))
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        numbers = tuple(
            conditioning(run.machine, run.record["position"], run.record["orientation"]).condition_number[:, None]
            for run in runs
        )
    name = "condition number"
    signals.append(Signal(name, f"{name} of the leg Jacobian", "legs", of_unit("1"), (name,), numbers))
    groups, order = list(_GROUPED), [*FIRST, *_SECOND]
    signals.sort(key=lambda s: (order.index(s.name) if s.name in order else len(order), groups.index(s.group)))
    return {signal.name: signal for signal in signals if any(values is not None for values in signal.values)}


# --- charts ----------------------------------------------------------------------------------------------------------


def run_charts(runs: Sequence[DrawnRun]) -> tuple[Section, Section]:
    """The charts of runs over time, one series per run and component; and all other signals, which open if needed."""
    several, times, signals = len(runs) > 1, [run.record["time"] for run in runs], _signals(runs)
    references = {signal.reference for signal in signals.values()}
    # limits of signals that are the same in all runs: one number, or one of each leg
    velocity = "motor_velocity" if any("motor_velocity" in run.record for run in runs) else "leg_velocity"
    limits = dict[str, list[float]]()
    for name, parameter, signs in (
        ("leg_length", "leg_length_min", (1,)),
        ("leg_length", "leg_length_max", (1,)),
        (velocity, "leg_velocity_max", (1, -1)),
        ("actuator_force", "", (1, -1)),
        ("actuator power", "actuator_power_max", (1, -1)),
    ):
        of_runs: list[Any] = [
            getattr(run.machine, parameter) if parameter else run.record.metadata.get("force_limit") for run in runs
        ]
        first, *different = {tuple(np.ravel(limit).tolist()) for limit in of_runs}
        if not different and None not in first:
            limits.setdefault(name, []).extend(sign * value for value in first for sign in signs)
    strips: tuple[Strip, ...] = ()
    if not several:  # when a limit of the drives acts on any leg, or a leg exceeds what the machine allows
        record = runs[0].record
        is_beyond = {name: share > 1 for name, share in shares_of_limits(record, runs[0].machine.as_dict()).items()}
        is_beyond |= {name: record[f"flag.{name}"].astype(bool) for name in FLAGS if f"flag.{name}" in record}
        reached = (
            strip_of(text, times[0], is_beyond[name].any(axis=1), role_of_strip)
            for name, (text, role_of_strip) in _REACHED.items()
            if name in is_beyond
        )
        strips = tuple(strip for strip in reached if strip is not None)
    # where faults that all runs have begin and end, in the part that is drawn
    marks_of_runs = list[list[Mark]]()
    for run, time in zip(runs, times, strict=True):
        marks = list[Mark]()
        for fault in faults_of(run.record.metadata):
            marks += [Mark(fault.begin, f"{fault.text} from", "vertical", "bad")] if fault.begin <= time[-1] else []
            if fault.end is not None and fault.end <= time[-1]:
                marks.append(Mark(fault.end, f"{fault.text} until", "vertical", "neutral"))
        marks_of_runs.append(marks)
    faults = [mark for mark in marks_of_runs[0] if all(mark in marks for marks in marks_of_runs[1:])]
    charts: dict[str, Chart] = {}
    for name, signal in signals.items():
        if name in references:
            continue
        reference, quantity = signals.get(signal.reference), signal.quantity
        role: Role = "error" if signal.group == "errors" else "reference" if signal.group == "reference" else "actual"
        series = []
        for k, run in enumerate(runs):
            columns, targets = (
                None if values is None else np.where(np.isfinite(values), values, np.nan)
                for values in (signal.values[k], None if reference is None else reference.values[k])
            )
            if columns is None:
                continue
            for j, component in enumerate(signal.components):
                options: dict[str, Any] = {"leg": j + 1 if signal.components == LEGS else None, "component": component}
                options |= {"run": k, "x": times[k]} if several else {}
                title = f"{run.name}: {component}" if several else component
                series.append(Series(title, quantity, columns[:, j], role, **options))
                if targets is not None:
                    title = f"{title}, reference"
                    series.append(Series(title, quantity, targets[:, j], "reference", **options))
        charts[name] = Chart(
            signal.title,
            time_axis(times[0]),
            tuple(series),
            "step" if signal.group in ("flags", "actuators", "controller") else "line",
            y=Axis("", labels=("no", "yes")) if signal.group == "flags" else None,
            marks=(*(Mark(limit, "limit") for limit in limits.get(name, ())), *faults),
            strips=strips,
            group=signal.group,
            detail=name not in FIRST,
        )
    shown_first = [charts[name] for name in FIRST if name in charts]
    rest = [chart for name, chart in charts.items() if name not in FIRST]
    return Section("Over time", tuple(shown_first)), Section("All other signals", tuple(rest), detail=True)

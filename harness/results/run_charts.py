"""Charts and scene of runs for a report: all signals over time, those that matter most first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, Strip, strip_of, time_axis
from gough_stewart.harness.report.document import Section
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import NUMBER, Quantity, of_unit
from gough_stewart.harness.report.scene import Scene
from gough_stewart.harness.results.limits import shares_of_limits
from gough_stewart.harness.results.metrics import finite_part
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.harness.results.scene import FRAMES, scene_of
from gough_stewart.harness.results.signals import Signal, signals_of
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Signals that a report shows at first; the others are a choice away.
FIRST = (
    "error.position",
    "error.orientation",
    "position from home",
    "orientation from home",
    "actuator_force",
    "leg_length",
)
# Larger values overflow the arithmetic of axes, and no platform has them.
_LARGEST = 1e9
_DRAWN = ("position", "orientation", "leg_length", "actuator_force")


@dataclass(frozen=True, eq=False)
class Shown:
    """A run as it is drawn: its rows that are finite, and its machine."""

    record: RecordData
    machine: Platform
    name: str


def shown(record: RecordData, machine: Platform, name: str) -> Shown | None:
    """The drawable part of a record; None if it has no row."""
    finite = finite_part(record)
    if not all(name in finite for name in _DRAWN):
        return None
    small = np.max([np.abs(finite[column]).max(axis=1, initial=0.0) for column in _DRAWN], axis=0) < _LARGEST
    rows = finite.table.height if small.all() else int(small.argmin())
    return Shown(RecordData(finite.table.head(rows), record.metadata), machine, name) if rows else None


def run_charts(runs: Sequence[Shown]) -> tuple[Section, Section]:
    """The charts of runs over time, one series per run and component; and all other signals, which open if needed."""
    several = len(runs) > 1
    times = [run.record["time"] for run in runs]
    signals = {each.name: each for each in signals_of([run.record for run in runs], [run.machine for run in runs])}
    references = {each.reference for each in signals.values()}
    strips = () if several else limits_reached(runs[0].record, runs[0].machine)
    charts: dict[str, Chart] = {}
    for name, signal in signals.items():
        if name in references:
            continue
        reference = signals.get(signal.reference or "")
        charts[name] = _chart(signal, reference, runs, times, strips, several=several)
    first = [charts[name] for name in FIRST if name in charts]
    others = [chart for name, chart in charts.items() if name not in FIRST]
    return Section("Over time", tuple(first)), Section("All other signals", tuple(others), detail=True)


def limits_reached(record: RecordData, machine: Platform) -> tuple[Strip, ...]:
    """When a limit of the drives acts on any leg, or a leg exceeds what the machine allows."""
    time = record["time"]
    flags: dict[str, tuple[str, Role]] = {
        "force_limited": ("force at its limit", "bad"),
        "rate_limited": ("force rate at its limit", "neutral"),
        "stroke_exceeded": ("beyond the stroke", "marginal"),
    }
    beyond: dict[str, tuple[str, Role]] = {
        "leg_velocity_max": ("leg speed beyond its limit", "published"),
        "actuator_power_max": ("power beyond its limit", "measured"),
    }
    found = [
        strip_of(text, time, record[f"flag.{name}"].astype(bool).any(axis=1), role)
        for name, (text, role) in flags.items()
        if f"flag.{name}" in record
    ]
    shares = shares_of_limits(record, machine.as_dict())
    found += [
        strip_of(text, time, (shares[name] > 1).any(axis=1), role)
        for name, (text, role) in beyond.items()
        if name in shares
    ]
    return tuple(each for each in found if each is not None)


def scenes(runs: Sequence[Shown], frames: int = FRAMES) -> list[Scene]:
    """The platforms in motion; they share the frames."""
    each = max(frames // len(runs), 101)
    return [
        scene_of(run.record, run.machine, run.name, each, k if len(runs) > 1 else None) for k, run in enumerate(runs)
    ]


def _chart(
    signal: Signal,
    reference: Signal | None,
    runs: Sequence[Shown],
    times: list[FloatArray],
    strips: tuple[Strip, ...],
    *,
    several: bool,
) -> Chart:
    quantity = of_unit(signal.unit) if signal.unit else NUMBER
    role: Role = "error" if signal.group == "errors" else "reference" if signal.group == "reference" else "actual"
    series = []
    for k, run in enumerate(runs):
        values = signal.values[k]
        if values is None:
            continue
        for j, component in enumerate(signal.components):
            name = f"{run.name}: {component}" if several else component
            own: dict[str, Any] = {
                "leg": j + 1 if signal.kind == "legs" else None,
                "run": k if several else None,
                "component": component,
                "x": times[k] if several else None,
            }
            series.append(Series(name, quantity, _stored(values[:, j], quantity), role, **own))
            wanted = None if reference is None else reference.values[k]
            if wanted is not None:
                series.append(
                    Series(f"{name}, reference", quantity, _stored(wanted[:, j], quantity), "reference", **own)
                )
    return Chart(
        signal.title,
        time_axis(times[0]),
        tuple(series),
        "step" if signal.is_flag or signal.group in ("actuators", "controller") else "line",
        y=Axis("", labels=("no", "yes")) if signal.is_flag else None,
        marks=tuple(Mark(limit / quantity.factor, "limit") for limit in signal.limits),
        strips=strips,
        group=signal.group,
        detail=signal.name not in FIRST,
    )


def _stored(values: FloatArray, quantity: Quantity) -> FloatArray:
    """From the unit of display to that in which a report stores numbers; NaN where they are not finite."""
    return np.where(np.isfinite(values), values, np.nan) / quantity.factor

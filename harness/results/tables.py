"""Metrics of a run as tables: tracking, step response, legs."""

from collections.abc import Mapping, Sequence
from typing import Any

from gough_stewart.harness.report.quantities import ANGLE, LENGTH, PERCENT, POSITION, SHARE, TIME, Quantity
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.results.metric_folds import metric_of

_LEGS = tuple(Column(f"{i}") for i in range(1, 7))
_POSE = (("position", ("x", "y", "z"), LENGTH), ("orientation", ("roll", "pitch", "yaw"), ANGLE))


def metrics_tables(metrics: Mapping[str, Any]) -> list[Table]:
    """Tables of tracking, step response and legs, where the record has their columns."""
    parts = (("tracking", _tracking), ("step_response", _steps))
    tables = [make(metrics[name]) for name, make in parts if metrics[name]]
    return [*tables, _legs(metrics)] if metrics["force"] else tables


def _tracking(tracking: Mapping[str, Any]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    ends = []
    for name, axes, quantity in _POSE:
        if name not in tracking:
            continue
        part = tracking[name]
        of_axes = zip(axes, part["rms"], part["peak"], strict=True)
        for what, *values in (*of_axes, (f"|{name}|", part["norm_rms"], part["norm_peak"])):
            rows.append((what, *(Value(each, quantity) for each in values)))
        ends.append(len(rows) - 1)
    columns = (Column(""), Column("RMS"), Column("peak"))
    return Table("Tracking error", columns, tuple(rows), group_ends=tuple(ends[:-1]))


def _steps(responses: Sequence[Mapping[str, Any]]) -> Table:
    columns = (
        Column(""),
        Column("from"),
        Column("to"),
        Column("at", TIME),
        Column("overshoot", PERCENT),
        Column("rise", TIME, "from 10 to 90 % of the step"),
        Column("settling", TIME, "until it stays within 2 % of the step"),
        Column("final error"),
    )
    rows = []
    for r in responses:
        is_length = r["axis"] in "xyz"
        pose, error = (POSITION, LENGTH) if is_length else (ANGLE, ANGLE)
        times = (r[key] for key in ("at", "overshoot_percent", "rise_time", "settling_time"))
        rows.append((r["axis"], Value(r["from"], pose), Value(r["to"], pose), *times, Value(r["final_error"], error)))
    return Table("Step response", columns, tuple(rows))


def _legs(metrics: Mapping[str, Any]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    energy, stroke = metrics["energy"], metrics["stroke"]

    def row(what: str, quantity: Quantity, values: Sequence[float | None], total: float | str | None = "") -> None:
        last: Cell = total if isinstance(total, str) else Value(total, quantity)
        rows.append((what, *(Value(value, quantity) for value in values), last))

    if "leg_length" in (metrics["tracking"] or {}):
        error = metrics["tracking"]["leg_length"]
        row("RMS error", LENGTH, error["rms"])
        row("peak error", LENGTH, error["peak"])
    row("shortest", POSITION, stroke["shortest"])
    row("longest", POSITION, stroke["longest"])
    for part, name in (("force", "peak"), ("force", "rms"), ("power", "peak"), ("power", "mean")):
        metric = metric_of(f"{part}.{name}")
        row(metric.text, metric.quantity, metrics[part][name])
    for name, what in (("net", "net work"), ("absolute", "work, absolute")):
        row(what, metric_of(f"energy.{name}").quantity, energy[name], energy[f"{name}_total"])
    for name, part in (metrics["limits"] or {}).items():
        used, first = (metric_of(f"limits.{name}.{which}") for which in ("used", "first_exceeded"))
        row(used.text, used.quantity, part["used"])
        if any(each is not None for each in part["first_exceeded"]):
            row(first.text, first.quantity, part["first_exceeded"])
    shares = {**(metrics["saturation"] or {}), "stroke_exceeded": stroke["exceeded"]}
    for name, share in shares.items():
        # rows of zeros say nothing
        if share and share["any"]:
            row(name.replace("_", " "), SHARE, share["legs"], share["any"])
    return Table("Legs", (Column(""), *_LEGS, Column("all")), tuple(rows))

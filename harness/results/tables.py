"""Metrics as tables."""

from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from gough_stewart.harness.output.tables import Named, Sheet, number_text, quantity_text, to_terminal
from gough_stewart.harness.results.metric_folds import shown_metric
from gough_stewart.harness.results.outcome import is_sound, outcome_text


def metrics_table(metrics: dict[str, Any]) -> RenderableType:
    """Tables for the terminal, after the outcome if the run did not complete, or its loop oscillates or grows."""
    parts: list[RenderableType] = []
    outcome = metrics["outcome"]
    if not is_sound(outcome):
        parts.append(Text(outcome_text(outcome), "bold red"))
    return Group(*parts, *map(to_terminal, metrics_sheets(metrics)))


def metrics_sheets(metrics: dict[str, Any]) -> list[Sheet]:
    """Tables of tracking, step response and legs, where the record has their columns."""
    parts = (("tracking", _tracking), ("step_response", _steps))
    sheets = [make(metrics[name]) for name, make in parts if metrics[name]]
    return [*sheets, _legs(metrics)] if metrics["force"] else sheets


def _tracking(tracking: dict[str, Any]) -> Sheet:
    sheet = Sheet("Tracking error", ("", "RMS", "peak", ""))
    for name, axes, unit in (("position", "xyz", "mm"), ("orientation", ("roll", "pitch", "yaw"), "mrad")):
        if name in tracking:
            part = tracking[name]
            rows = [
                *zip(axes, part["rms"], part["peak"], strict=True),
                (f"|{name}|", part["norm_rms"], part["norm_peak"]),
            ]
            for what, rms, peak in rows:
                sheet.add(what, _milli(rms, unit), _milli(peak, unit), unit, ends_group=what.startswith("|"))
    return sheet


def _steps(responses: list[dict[str, Any]]) -> Sheet:
    heads = ("from", "to", "at s", "overshoot %", "rise s", "settling s", "final error")
    sheet = Sheet("Step response", ("", *heads))
    for r in responses:
        unit = "m" if r["axis"] in "xyz" else "rad"
        numbers = [number_text(r[key]) for key in ("at", "overshoot_percent", "rise_time", "settling_time")]
        error = f"{_milli(r['final_error'], f'm{unit}')} m{unit}"
        ends = [number_text(r[key]) for key in ("from", "to")]
        sheet.add(Named(r["axis"], unit), *ends, *numbers, error)
    return sheet


def _legs(metrics: dict[str, Any]) -> Sheet:
    sheet = Sheet("Legs", ("", *(f"{i}" for i in range(1, 7)), "all"))
    energy, stroke = metrics["energy"], metrics["stroke"]

    def row(what: str, unit: str, values: list[float | None], total: str = "") -> None:
        sheet.add(Named(what, unit), *(quantity_text(value, unit) for value in values), total)

    if "leg_length" in (metrics["tracking"] or {}):
        error = metrics["tracking"]["leg_length"]
        row("RMS error", "mm", [None if e is None else 1e3 * e for e in error["rms"]])
        row("peak error", "mm", [None if e is None else 1e3 * e for e in error["peak"]])
    row("shortest", "m", stroke["shortest"])
    row("longest", "m", stroke["longest"])
    for part, name in (("force", "peak"), ("force", "rms"), ("power", "peak"), ("power", "mean")):
        shown = shown_metric(f"{part}.{name}")
        row(shown.text, shown.unit, metrics[part][name])
    row("net work", "J", energy["net"], number_text(energy["net_total"]))
    row("work, absolute", "J", energy["absolute"], number_text(energy["absolute_total"]))
    for name, part in (metrics["limits"] or {}).items():
        used, first = (shown_metric(f"limits.{name}.{which}") for which in ("used", "first_exceeded"))
        row(used.text, used.unit, [None if each is None else used.factor * each for each in part["used"]])
        if any(each is not None for each in part["first_exceeded"]):
            row(first.text, first.unit, part["first_exceeded"])
    shares = {**(metrics["saturation"] or {}), "stroke_exceeded": stroke["exceeded"]}
    for name, share in shares.items():
        # skip rows of zeros
        if share and share["any"]:
            row(name.replace("_", " "), "%", [100 * leg for leg in share["legs"]], number_text(100 * share["any"]))
    return sheet


def _milli(value: float | None, unit: str) -> str:
    return quantity_text(None if value is None else 1e3 * value, unit)

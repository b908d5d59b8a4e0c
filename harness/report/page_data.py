"""Charts and scenes of a report as data for the scripts of its page."""

from typing import Any

import numpy as np

from gough_stewart.harness.output.display_resolution import least_span
from gough_stewart.harness.report.document import Axis, Chart, Report, Scene, Series
from gough_stewart.harness.report.packing import MOST_ROWS, Arrays, blocks
from gough_stewart.harness.report.quantities import TIME, Quantity
from gough_stewart.model.vectors import FloatArray

# Letters of a vertical title that fit beside a chart.
_LONGEST = 28


def chart_data(chart: Chart, arrays: Arrays) -> dict[str, Any]:
    quantity = chart.series[0].quantity
    is_time = chart.kind in ("line", "step") and chart.x.quantity == TIME
    found: dict[str, Any] = {
        "title": chart.title,
        "kind": chart.kind,
        "isTime": is_time,
        "x": _axis(chart.x, arrays),
        "y": {**_shown(quantity, chart), "title": _y_title(chart), "scale": chart.y.scale if chart.y else "linear"},
        "series": [_series(each, chart, arrays) for each in chart.series],
        "marks": [
            {"value": mark.value, "text": mark.text, "vertical": mark.direction == "vertical", "role": mark.role}
            for mark in chart.marks
        ],
    }
    if chart.kind == "heat" and chart.y is not None:
        found["rows"] = _axis(chart.y, arrays)
    return found


def _y_title(chart: Chart) -> str:
    """Name and unit of the vertical axis; without words of its own, those of the chart."""
    quantity = chart.series[0].quantity
    if chart.y is not None or quantity.name:
        return chart.y_title
    # the title above the chart says the rest
    return quantity.headed(chart.title if len(chart.title) <= _LONGEST else chart.title.partition(",")[0][:_LONGEST])


def _shown(quantity: Quantity, chart: Chart) -> dict[str, Any]:
    """How numbers of a quantity are written, and the least span of an axis for those of a chart [shown unit]."""
    sizes = [np.abs(each.values[np.isfinite(each.values)]).max(initial=0.0) for each in chart.series]
    return {**_written(quantity), "least": least_span(quantity.unit or "1", quantity.factor * float(max(sizes)))}


def _written(quantity: Quantity) -> dict[str, Any]:
    return {"unit": quantity.unit, "factor": quantity.factor, "digits": quantity.digits}


def _axis(axis: Axis, arrays: Arrays) -> dict[str, Any]:
    values = axis.values
    if len(values) > MOST_ROWS:
        values, _ = blocks(values, values)
    return {
        **_written(axis.quantity),
        "title": axis.title,
        "name": axis.name,
        "scale": axis.scale,
        "labels": axis.labels,
        "values": arrays.add(values),
    }


def _series(series: Series, chart: Chart, arrays: Arrays) -> dict[str, Any]:
    x = chart.x_of(series)

    def kept(values: FloatArray | None) -> int | None:
        if values is None:
            return None
        is_long = chart.kind in ("line", "step") and len(x) > MOST_ROWS
        return arrays.add(blocks(x, values)[1] if is_long else values, series.quantity)

    found: dict[str, Any] = {"name": series.name, "role": series.role, "values": kept(series.values)}
    found |= {"leg": series.leg, "run": series.run, "component": series.component}
    found |= {"low": kept(series.low), "high": kept(series.high)}
    if series.x is not None:
        found["x"] = arrays.add(blocks(x, x)[0] if len(x) > MOST_ROWS else x)
    if series.members is not None:
        found["members"] = arrays.add(series.members)
    return {name: value for name, value in found.items() if value not in (None, "")}


def member_data(report: Report, arrays: Arrays) -> dict[str, Any] | None:
    """The members of an ensemble, and their values of the metrics that have a chart; None without such."""
    titles = [chart.title for chart in report.charts]
    shown = [each for each in report.numbers if each.members is not None and each.name in titles]
    points = [series for chart in report.charts for series in chart.series if series.members is not None]
    if not shown or not points or points[0].members is None:
        return None
    return {
        "ids": arrays.add(points[0].members),
        "numbers": [
            {"name": each.name, **_written(each.quantity), "values": arrays.add(each.members, each.quantity)}
            for each in shown
            if each.members is not None
        ],
    }


def scene_data(scene: Scene, arrays: Arrays) -> dict[str, Any]:
    names = ("time", "pose", "reference", "orientation", "leg_length", "actuator_force", "external_force", "nearness")
    values = {name: getattr(scene, name) for name in names}
    return {
        "name": scene.name,
        "run": scene.run,
        "base": scene.base_points.tolist(),
        "platform": scene.platform_points.tolist(),
        "lower": scene.lower,
        "upper": scene.upper,
        "home": scene.home.tolist(),
        "rows": scene.rows,
        "nearnessOf": scene.nearness_of,
        "flags": {flag.name: flag.values for flag in scene.flags},
        "arrays": {name: arrays.add(each) for name, each in values.items() if each is not None},
    }

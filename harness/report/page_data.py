"""Charts and scenes of a report as data for the scripts of its page."""

import re
from typing import Any

import numpy as np

from gough_stewart.harness.report.chart import Axis, Chart, Map, Samples, Series
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.packing import MOST_ROWS, Arrays, blocks
from gough_stewart.harness.report.quantities import Quantity, least_span
from gough_stewart.harness.report.scene import Scene, Surface
from gough_stewart.harness.report.words import percent
from gough_stewart.model.vectors import FloatArray

# Letters of a vertical title that fit beside a chart.
_LONGEST = 28
# Steps of the range of a signal in which those of single members are stored.
_SAMPLE_STEPS = 1000.0


def chart_data(chart: Chart, arrays: Arrays, *, has_time: bool = True) -> dict[str, Any]:
    """A chart as data; it shares the time of the page if that `has_time`."""
    quantity = chart.series[0].quantity
    found: dict[str, Any] = {
        "title": chart.title,
        "kind": chart.kind,
        "isTime": has_time and chart.is_over_time,
        "x": _axis(chart.x, arrays),
        "y": {**_shown(quantity, chart), "title": _y_title(chart), "scale": chart.y.scale if chart.y else "linear"}
        | ({"labels": chart.y.labels} if chart.y and chart.y.labels and chart.kind != "heat" else {}),
        "series": [_series(each, chart, arrays) for each in chart.series],
        "marks": [
            {"value": mark.value, "text": mark.text, "vertical": mark.direction == "vertical", "role": mark.role}
            | ({} if mark.tells else {"said": True})
            for mark in chart.marks
        ],
        "spans": [{"at": e.at, "low": e.low, "high": e.high, "text": e.text, "role": e.role} for e in chart.spans],
        "strips": [
            {"name": e.name, "role": e.role, "share": percent(e.share), "intervals": e.intervals} for e in chart.strips
        ],
    }
    if chart.samples is not None:
        found["samples"] = _samples(chart, chart.samples, arrays)
    if chart.kind == "heat" and chart.y is not None:
        found["rows"] = _axis(chart.y, arrays)
        found["map"] = None if chart.map is None else _map(chart.map, arrays)
    return found


def _samples(chart: Chart, samples: Samples, arrays: Arrays) -> dict[str, int]:
    return {
        "members": arrays.add(samples.members),
        "x": arrays.add(samples.x),
        # a chart has some 200 pixels of height
        "values": arrays.add(samples.values, chart.series[0].quantity, _SAMPLE_STEPS),
    }


def _map(of: Map, arrays: Arrays) -> dict[str, Any]:
    return {
        "inside": None if of.inside is None else arrays.add(_single(of.inside)),
        "scale": of.scale,
        "classes": of.classes,
        "slices": None if of.slices is None else _axis(of.slices, arrays),
        "first": of.first,
        "point": of.point,
        "pointName": of.point_name,
    }


def _single(values: FloatArray) -> FloatArray:
    """Seven digits of each number, which compress to half; those of a map may be far apart, or infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32).astype(float)


def _y_title(chart: Chart) -> str:
    """Name and unit of the vertical axis; without words of its own, those of the chart."""
    quantity = chart.series[0].quantity
    if chart.y is not None or quantity.name:
        return chart.y_title
    # the title above the chart says the rest
    is_long = len(chart.title) > _LONGEST
    return quantity.headed(re.split(", | of ", chart.title)[0][:_LONGEST] if is_long else chart.title)


def _shown(quantity: Quantity, chart: Chart) -> dict[str, Any]:
    """How numbers of a quantity are written, and the least span of an axis for those of a chart [shown unit]."""
    sizes = [np.abs(each.values[np.isfinite(each.values)]).max(initial=0.0) for each in chart.series]
    least = least_span(quantity.unit or "1", quantity.factor * float(max(sizes)), quantity.least)
    return {**_written(quantity), "least": least}


def _written(quantity: Quantity) -> dict[str, Any]:
    return {"unit": quantity.unit_text, "factor": quantity.factor, "digits": quantity.digits}


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
        if chart.map is not None:
            return arrays.add(_single(values))
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
    # the first chart is of the metric that the ensemble is judged by
    shown.sort(key=lambda each: titles.index(each.name))
    points = [series for chart in report.charts for series in chart.series if series.members is not None]
    if not shown or not points or points[0].members is None:
        return None
    return {
        "ids": arrays.add(points[0].members),
        "repeat": report.repeat,
        "numbers": [
            {
                "name": each.name,
                **_written(each.quantity),
                "smallIsWorse": each.small_is_worse,
                "values": arrays.add(each.members, each.quantity),
            }
            for each in shown
            if each.members is not None
        ],
    }


def surface_data(surface: Surface, arrays: Arrays) -> dict[str, Any]:
    ends = zip(surface.names, surface.quantities, surface.low, surface.high, strict=True)
    return {
        "title": surface.title,
        "axes": [
            {**_written(quantity), "name": name, "low": float(low), "high": float(high)}
            for name, quantity, low, high in ends
        ],
        "vertices": arrays.add(_single(surface.vertices)),
        "triangles": arrays.add(surface.triangles),
        "values": arrays.add(_single(surface.values)),
        "of": {**_written(surface.quantity), "name": surface.name, "scale": surface.scale},
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
        "digits": scene.decimals,
        "nearnessOf": scene.nearness_of,
        "flags": {flag.name: flag.values for flag in scene.flags},
        "arrays": {name: arrays.add(each) for name, each in values.items() if each is not None},
    }

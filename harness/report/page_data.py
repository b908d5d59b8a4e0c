"""Charts and scenes of a report as data for the scripts of its page."""

import re
from dataclasses import asdict
from typing import Any

import numpy as np

from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.packing import Arrays, blocks
from gough_stewart.harness.report.quantities import Quantity, least_span
from gough_stewart.harness.report.scene import COLUMNS, Scene, Surface
from gough_stewart.harness.report.words import percent
from gough_stewart.model.vectors import FloatArray

# Letters of a vertical title that fit beside a chart.
_LONGEST = 28
# Steps of the range of a signal in which those of single members are stored.
_SAMPLE_STEPS = 1000.0


def chart_data(chart: Chart, arrays: Arrays, *, has_time: bool = True) -> dict[str, Any]:
    """A chart as data; it shares the time of the page if that `has_time`."""
    quantity = chart.series[0].quantity
    sizes = [np.abs(series.values[np.isfinite(series.values)]).max(initial=0.0) for series in chart.series]
    # the least span of an axis for these values [shown unit]
    least = least_span(quantity.unit or "1", quantity.factor * float(max(sizes)), quantity.least)
    scale = chart.y.scale if chart.y else "linear"
    labels = {"labels": chart.y.labels} if chart.y and chart.y.labels and chart.kind != "heat" else {}
    data: dict[str, Any] = {
        "title": chart.title,
        "kind": chart.kind,
        "isTime": has_time and chart.is_over_time,
        "x": _axis(chart.x, arrays),
        "y": {**_written(quantity), "least": least, "title": _y_title(chart), "scale": scale, **labels},
        "series": [_series(series, chart, arrays) for series in chart.series],
        "marks": [
            {"value": mark.value, "text": mark.text, "vertical": mark.direction == "vertical", "role": mark.role}
            | ({} if mark.tells else {"said": True})
            for mark in chart.marks
        ],
        "spans": [asdict(span) for span in chart.spans],
        "strips": [{**asdict(strip), "share": percent(strip.share)} for strip in chart.strips],
    }
    if chart.samples is not None:
        data["samples"] = {
            "members": arrays.add(chart.samples.members),
            "x": arrays.add(chart.samples.x),
            # a chart has some 200 pixels of height
            "values": arrays.add(chart.samples.values, quantity, _SAMPLE_STEPS),
        }
    if chart.kind == "heat" and chart.y is not None:
        over = chart.map
        data["rows"] = _axis(chart.y, arrays)
        data["map"] = over and {
            "inside": None if over.inside is None else arrays.add(_single(over.inside)),
            "scale": over.scale,
            "classes": over.classes,
            "slices": None if over.slices is None else _axis(over.slices, arrays),
            "first": over.first,
            "point": over.point,
            "pointName": over.point_name,
        }
    return data


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


def _written(quantity: Quantity) -> dict[str, Any]:
    return {"unit": quantity.unit_text, "factor": quantity.factor, "digits": quantity.digits}


def _axis(axis: Axis, arrays: Arrays) -> dict[str, Any]:
    words = {"title": axis.title, "name": axis.name, "scale": axis.scale, "labels": axis.labels}
    return {**_written(axis.quantity), **words, "values": arrays.add(blocks(axis.values, axis.values)[0])}


def _series(series: Series, chart: Chart, arrays: Arrays) -> dict[str, Any]:
    x, is_curve = chart.x_of(series), chart.kind in ("line", "step")

    def kept(values: FloatArray | None) -> int | None:
        if values is None:
            return None
        if chart.map is not None:
            return arrays.add(_single(values))
        return arrays.add(blocks(x, values)[1] if is_curve else values, series.quantity)

    data = {"name": series.name, "role": series.role, "values": kept(series.values)}
    data |= {"leg": series.leg, "run": series.run, "component": series.component}
    data |= {"low": kept(series.low), "high": kept(series.high)}
    data["x"] = None if series.x is None else arrays.add(blocks(x, x)[0])
    data["members"] = None if series.members is None else arrays.add(series.members)
    return {name: value for name, value in data.items() if value not in (None, "")}


def member_data(report: Report, arrays: Arrays) -> dict[str, Any] | None:
    """The members of an ensemble, and their values of the metrics that have a chart; None without such."""
    titles = [chart.title for chart in report.charts]
    # the first chart is of the metric that the ensemble is judged by
    known = sorted((n for n in report.numbers if n.name in titles), key=lambda number: titles.index(number.name))
    numbers = [(number, number.members) for number in known if number.members is not None]
    ids = (series.members for chart in report.charts for series in chart.series if series.members is not None)
    members = next(ids, None)
    if not numbers or members is None:
        return None
    listed = [
        {
            "name": number.name,
            **_written(number.quantity),
            "smallIsWorse": number.small_is_worse,
            "values": arrays.add(values, number.quantity),
        }
        for number, values in numbers
    ]
    return {"ids": arrays.add(members), "repeat": report.repeat, "numbers": listed}


def surface_data(surface: Surface, arrays: Arrays) -> dict[str, Any]:
    """A surface as data."""
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
    """A scene as data."""
    in_frames = {name: getattr(scene, name) for name in ("time", *COLUMNS)}
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
        "arrays": {name: arrays.add(values) for name, values in in_frames.items() if values is not None},
    }

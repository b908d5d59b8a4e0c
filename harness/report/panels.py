"""How charts share a figure: the panels of each row, their heights, and which lines are one.

Components that have a reference get a panel each, so that no line hides another.
"""

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.report.chart import Chart, Series
from gough_stewart.harness.report.heat_figures import height_over_width, slice_title, slices_shown
from gough_stewart.harness.report.quantities import least_span
from gough_stewart.model.vectors import FloatArray

WIDTH, ROW = 8.0, 1.9  # of a figure, and the height of a row [inch]
# Larger values overflow matplotlib's arithmetic.
_LARGEST = 1e100
# Lines that stay within this share of the axis hide each other.
_HIDES = 4e-3
# Lines that can be told apart in one panel.
_MOST_LINES = 12
# Of a group, so many charts of one kind with the same series are small panels with one legend.
_SMALL = 3


class Panel(NamedTuple):
    """Some of the series of a chart, in axes of their own; wide, or a small one in a grid."""

    chart: Chart
    title: str
    series: tuple[Series, ...]
    is_wide: bool
    least: float = 0.0  # span of the vertical axis
    names: tuple[str, ...] = ()  # of its series in the legend of the grid
    slice: int | None = None  # of a heat map


def rows_of(charts: Sequence[Chart]) -> list[list[Panel]]:
    """The panels of a figure: a row for each chart, or a grid for several of one kind with the same series."""

    def look(chart: Chart) -> object:
        if chart.map is not None:
            return "map"
        return chart.kind, tuple((each.name, each.role) for each in chart.series)

    rows: list[list[Panel]] = []
    for _, alike in groupby(charts, key=look):
        some = list(alike)
        if some[0].map is not None:
            rows += _maps(some)
        elif len(some) >= _SMALL and some[0].kind not in ("bars", "heat"):
            names = tuple(each.name for each in some[0].series)
            rows.append([Panel(each, _small_title(each), each.series, False, names=names) for each in some])
        else:
            rows += [_panels(each) for each in some]
    return rows


def _maps(charts: Sequence[Chart]) -> list[list[Panel]]:
    """Maps side by side, two in a row; those in slices have a row each."""
    if charts[0].map is not None and charts[0].map.slices is not None:
        return [
            [Panel(each, slice_title(each, k), each.series, False, slice=k) for k in slices_shown(each)]
            for each in charts
        ]
    panels = [Panel(each, each.series[0].quantity.headed(each.title), each.series, False) for each in charts]
    return [panels[k : k + 2] for k in range(0, len(panels), 2)]


def _small_title(chart: Chart) -> str:
    """The name and unit of the vertical axis, or the chart's title with the unit."""
    return chart.y_title if chart.y is not None and chart.y.name else chart.series[0].quantity.headed(chart.title)


def _panels(chart: Chart) -> list[Panel]:
    has_reference = len({each.role for each in chart.series}) > 1 and any(s.role == "reference" for s in chart.series)
    components = list(dict.fromkeys(each.component for each in chart.series))
    if not has_reference or len(components) < 2 or len({each.run for each in chart.series}) > 1:
        return [Panel(chart, chart.title, chart.series, True)]
    # an axis that hardly moves compared with the others should look like it
    least = max(_extent(chart.series, component) for component in components) / 50
    parts = {each: tuple(s for s in chart.series if s.component == each) for each in components}
    quantity = chart.series[0].quantity
    return [
        Panel(chart, quantity.headed(f"{chart.title}, {each}"), part, False, least, tuple(s.role for s in part))
        for each, part in parts.items()
    ]


def _extent(series: Sequence[Series], component: str | None = None) -> float:
    """The span of the values of a component, or of all, as shown."""
    values = [drawable(s.quantity.factor * s.values) for s in series if component is None or s.component == component]
    finite = np.concatenate([each[np.isfinite(each)] for each in values])
    return float(np.ptp(finite)) if finite.size else 0.0


def columns_of(row: Sequence[Panel]) -> int:
    """Panels side by side: one that is wide, at most three small ones, two of four; all of a row of maps."""
    if row[0].chart.map is not None:
        return max(len(row), 2)
    return 2 if len(row) == 4 else min(len(row), 3)


def height_of(row: Sequence[Panel]) -> float:
    """The height of a row, in panels."""
    if row[0].chart.map is not None:
        # what is left of the width of a panel beside titles and bar
        wide = WIDTH / columns_of(row) - (1.3 if row[0].slice is None else 0.5)
        return (wide * height_over_width(row[0].chart) + 0.7) / ROW
    return 1.5 if row[0].is_wide else float(-(-len(row) // columns_of(row)))


def drawable(values: FloatArray) -> FloatArray:
    """Values with gaps where they would overflow the arithmetic of axes."""
    return np.where(np.abs(values) <= _LARGEST, values, np.nan)


def told_apart(panel: Panel) -> list[tuple[int, str]]:
    """The series to draw, with their names; those that would hide each other are one line with all their names."""
    if panel.chart.kind == "points" or not panel.is_wide:
        return [(k, each.name) for k, each in enumerate(panel.series)]
    is_log = panel.chart.y is not None and panel.chart.y.scale == "log"
    quantity = panel.series[0].quantity
    near = _HIDES if is_log else max(_extent(panel.series) * _HIDES, least_span(quantity.unit, least=quantity.least))
    groups: list[list[int]] = []
    for k, series in enumerate(panel.series):
        for group in groups:
            if _coincide(panel.chart, panel.series[group[0]], series, near, is_log=is_log):
                group.append(k)
                break
        else:
            groups.append([k])
    return [(group[0], _common_name([panel.series[k] for k in group])) for group in groups[:_MOST_LINES]]


def _coincide(chart: Chart, one: Series, other: Series, near: float, *, is_log: bool) -> bool:
    """Whether two series stay as near as this to each other, on a logarithmic axis as a share of the value."""
    if one.role != other.role or one.low is not None or other.low is not None:
        return False
    if len(one.values) != len(other.values) or not np.array_equal(chart.x_of(one), chart.x_of(other)):
        return False
    first, second = (drawable(each.quantity.factor * each.values) for each in (one, other))
    gap = np.abs(first - second)
    return bool(
        np.all((gap <= near * (np.abs(first) if is_log else 1)) | (np.isnan(one.values) & np.isnan(other.values)))
    )


def _common_name(series: Sequence[Series]) -> str:
    legs = [each.leg for each in series if each.leg is not None]
    if len(series) > 2 and len(legs) == len(series) and legs == list(range(legs[0], legs[0] + len(legs))):
        return f"legs {legs[0]}–{legs[-1]}"
    return ", ".join(each.name for each in series)

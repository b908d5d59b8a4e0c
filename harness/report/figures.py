"""The charts of a report as figures for print: PDF, PNG and SVG by matplotlib; the same report gives the same bytes.

Charts of a group are panels of one figure. Components that have a reference get a panel each, so that no line hides
another; others share one, with a legend.
"""

import re
from collections.abc import Sequence
from functools import partial
from itertools import groupby
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gough_stewart.harness.report.chart import Chart, Series
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.heat_figures import (
    draw_heat,
    height_over_width,
    kind_patches,
    slice_title,
    slices_shown,
)
from gough_stewart.harness.report.packing import decimated
from gough_stewart.harness.report.palette import DASHES, SIX_DASHES, colour_of, colour_of_six
from gough_stewart.harness.report.plotting import entitle, files_of
from gough_stewart.harness.report.quantities import least_span
from gough_stewart.harness.report.words import percent
from gough_stewart.model.vectors import FloatArray

KINDS = ("pdf", "png", "svg")
WIDTH, ROW = 8.0, 1.9  # of a figure, and the height of a row [inch]
# Larger values overflow matplotlib's arithmetic.
_LARGEST = 1e100
# Lines that stay within this share of the axis hide each other.
_HIDES = 4e-3
# Lines that can be told apart in one panel.
_MOST_LINES = 12
# Of a group, so many charts of one kind with the same series are small panels with one legend.
_SMALL = 3
_HEAD = 0.55  # [inch]
# Points of a line in a panel of about 400 pixels.
_POINTS = 800
_MOST_BARS = 20
# More markers are pixels, also in PDF and SVG.
_MOST_MARKERS = 2000
# Longer labels below an axis are turned.
_SHORT_LABEL = 3
# Characters in a line of a note.
_NOTE = 100
# And of a name in a legend beside its chart.
_LABEL = 24
# Height of a strip, of the axes.
_STRIP = 0.022
# Opacity of one band over another.
_SHADE = 0.22


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
    """The panels of a figure: a row for each chart, or a grid for several of one kind with the same series.

    Maps stand side by side, two in a row; those in slices have a row each.
    """

    def look(chart: Chart) -> object:
        if chart.map is not None:
            return "map"
        return chart.kind, tuple((series.name, series.role) for series in chart.series)

    rows: list[list[Panel]] = []
    for kind, group in groupby(charts, key=look):
        alike = list(group)
        if kind == "map" and slices_shown(alike[0])[0] is not None:
            for chart in alike:
                slices = slices_shown(chart)
                rows.append([Panel(chart, slice_title(chart, k), chart.series, False, slice=k) for k in slices])
        elif kind == "map":
            maps = [Panel(c, c.series[0].quantity.headed(c.title), c.series, False) for c in alike]
            rows += [maps[k : k + 2] for k in range(0, len(maps), 2)]
        elif len(alike) >= _SMALL and alike[0].kind not in ("bars", "heat"):
            names = tuple(series.name for series in alike[0].series)
            rows.append([Panel(chart, _small_title(chart), chart.series, False, names=names) for chart in alike])
        else:
            rows += map(_panels, alike)
    return rows


def _small_title(chart: Chart) -> str:
    """The name and unit of the vertical axis, or the chart's title with the unit."""
    return chart.y_title if chart.y is not None and chart.y.name else chart.series[0].quantity.headed(chart.title)


def _panels(chart: Chart) -> list[Panel]:
    roles, runs = {series.role for series in chart.series}, {series.run for series in chart.series}
    components = list(dict.fromkeys(series.component for series in chart.series))
    if "reference" not in roles or len(roles) < 2 or len(components) < 2 or len(runs) > 1:
        return [Panel(chart, chart.title, chart.series, True)]
    parts = {name: tuple(series for series in chart.series if series.component == name) for name in components}
    # an axis that hardly moves compared with the others should look like it
    least = max(map(_extent, parts.values())) / 50
    quantity = chart.series[0].quantity
    return [
        Panel(chart, quantity.headed(f"{chart.title}, {name}"), part, False, least, tuple(s.role for s in part))
        for name, part in parts.items()
    ]


def _extent(series: Sequence[Series]) -> float:
    values = np.concatenate([drawable(line.quantity.factor * line.values) for line in series])
    finite = values[np.isfinite(values)]
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
        return [(k, series.name) for k, series in enumerate(panel.series)]
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


def _coincide(chart: Chart, first: Series, second: Series, near: float, *, is_log: bool) -> bool:
    """Whether two series stay as near as this to each other, on a logarithmic axis as a share of the value."""
    if first.role != second.role or first.low is not None or second.low is not None:
        return False
    if len(first.values) != len(second.values) or not np.array_equal(chart.x_of(first), chart.x_of(second)):
        return False
    a, b = (drawable(series.quantity.factor * series.values) for series in (first, second))
    is_gap = np.isnan(first.values) & np.isnan(second.values)
    return bool(np.all((np.abs(a - b) <= near * (np.abs(a) if is_log else 1)) | is_gap))


def _common_name(series: Sequence[Series]) -> str:
    legs = [line.leg for line in series if line.leg is not None]
    if len(series) > 2 and len(legs) == len(series) and legs == list(range(legs[0], legs[0] + len(legs))):
        return f"legs {legs[0]}–{legs[-1]}"
    return ", ".join(line.name for line in series)


def figures(report: Report, kinds: Sequence[str] = KINDS, group: str | None = None) -> dict[str, bytes]:
    """The figures of all charts but those of details, by file name; of one group alone if it is given."""
    drawn = [
        part
        for section in report.sections
        if not section.detail
        for part in section.parts
        if isinstance(part, Chart) and not part.detail and group in (None, part.group)
    ]
    files: dict[str, bytes] = {}
    taken: set[str] = set()
    for title, charts in groupby(drawn, key=lambda chart: chart.group or chart.title):
        name = _name(title, taken)
        panels = rows_of(list(charts))
        height = _HEAD + sum(ROW * height_of(row) for row in panels)
        # what did not go well should look like it
        is_well = report.verdict.status in ("good", "told")
        head = report.title if is_well else f"{report.title} — {report.verdict.text}"
        head += f" ({', '.join(setting.text for setting in report.settings)})" if report.changed else ""
        written = files_of(partial(_draw, head, panels), WIDTH, height, tuple(kinds))
        files |= {f"{name}.{kind}": file for kind, file in written.items()}
    return files


def _name(title: str, taken: set[str]) -> str:
    """A file name of a title, that no earlier one has."""
    stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "chart"
    name, k = stem, 2
    while name in taken:
        name, k = f"{stem}-{k}", k + 1
    taken.add(name)
    return name


def _draw(title: str, rows: Sequence[Sequence[Panel]], figure: Figure) -> None:
    entitle(figure, title)
    parts: Any = figure.subfigures(len(rows), 1, height_ratios=[height_of(row) for row in rows], squeeze=False)[:, 0]
    for k, (part, row) in enumerate(zip(parts, rows, strict=True)):
        columns = columns_of(row)
        grid = part.subplots(-(-len(row) // columns), columns, squeeze=False)
        for axes in grid.flat[len(row) :]:
            axes.set_axis_off()
        if row[0].chart.map is not None:
            _draw_maps(part, list(grid.flat[: len(row)]), row)
        elif row[0].is_wide:
            _draw_wide(grid.flat[0], row[0])
        else:
            # panels with the same names below have the same legend
            has_legend = not any(row[0].names == later[0].names for later in rows[k + 1 :])
            _draw_small(part, list(grid.flat[: len(row)]), row, has_legend=has_legend)


def _draw_wide(axes: Axes, panel: Panel) -> None:
    chart = panel.chart
    is_named = chart.kind in ("heat", "bars") or (chart.y is not None and chart.y.name != "")
    title = panel.title if is_named else panel.series[0].quantity.headed(panel.title)
    axes.set_title(title, parse_math=False)
    _draw_panel(axes, panel)
    if chart.y is not None and chart.y.name and chart.kind not in ("heat", "bars"):
        axes.set_ylabel(chart.y_title)
    if chart.kind != "bars":
        axes.set_xlabel(chart.x.title)
    if chart.note:
        axes.annotate(_note(chart.note), (0, 0), (0, -34), "axes fraction", "offset points", fontsize=7, va="top")
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > 1:
        labels = ["\n".join(wrap(label, _LABEL)) for label in labels]
        axes.legend(handles, labels, loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0, handlelength=3.2)


def _draw_small(part: Any, grid: Sequence[Axes], row: Sequence[Panel], *, has_legend: bool) -> None:
    """Draw a grid of panels; what is the same for all is said once: an axis, the legend, the note."""
    is_one_x = len({panel.chart.x.title for panel in row}) == 1
    is_one_y = not is_one_x and len({panel.chart.y_title for panel in row}) == 1
    columns = columns_of(row)
    for k, (panel, axes) in enumerate(zip(row, grid, strict=True)):
        _draw_panel(axes, panel)
        axes.tick_params(labelsize=7.5)
        if panel.chart.x.scale == "linear":
            axes.xaxis.set_major_locator(MaxNLocator(4))
        if not is_one_y:
            axes.set_title(panel.title, fontsize=8.5, parse_math=False)
        elif k % columns == 0:
            axes.set_ylabel(panel.chart.y_title, fontsize=8.5)
        if not is_one_x or k + columns >= len(row):
            axes.set_xlabel(panel.chart.x.title, fontsize=8.5)
    handles, labels = grid[0].get_legend_handles_labels()
    if has_legend and len(labels) > 1:
        names = [*row[0].names, *labels[len(row[0].names) :]]
        note = _note(" ".join(dict.fromkeys(panel.chart.note for panel in row if panel.chart.note)))
        under: dict[str, Any] = {"title": note, "title_fontsize": 7, "ncols": len(names), "handlelength": 3.2}
        part.legend(handles, names, loc="outside lower center", **under)


def _note(text: str) -> str:
    """A note on as many lines as it needs; it begins at the left end of axes."""
    return "\n".join(wrap(text, _NOTE))


def _draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw the series and marks of a panel, without its words."""
    chart = panel.chart
    draw = {"heat": _heat, "bars": _bars, "histogram": _histogram}.get(chart.kind, _lines)
    draw(axes, panel)
    if chart.kind != "bars":
        if chart.x.scale == "log":
            axes.set_xscale("log")
        if chart.y is not None and chart.y.scale == "log":
            axes.set_yscale("log")
        elif chart.kind != "heat":
            # 0.9995 is plainer than -0.0005 with +1 above
            axes.ticklabel_format(axis="y", useOffset=False)
        if chart.kind != "heat" and chart.y is not None and chart.y.labels:
            axes.set_yticks(range(len(chart.y.labels)), chart.y.labels)
    _marks(axes, panel)
    _spans(axes, panel)
    _strips(axes, panel)


def _styles(panel: Panel) -> list[dict[str, Any]]:
    """Colour and dashes of each series: by role, or by run, leg or order where several have one role.

    No two share both.
    """
    styles, taken = [], set[tuple[str, tuple[float, ...]]]()
    for series in panel.series:
        alike = [beside for beside in panel.series if beside.role == series.role]
        colour, dashes = colour_of(series.role), DASHES.get(series.role, ())
        if len(alike) > 1 and series.role not in ("reference", "limit", "band"):
            same = [beside for beside in alike if beside.run == series.run].index(series)
            place = series.run if series.run is not None else series.leg - 1 if series.leg else same
            # of more than six, the colours come again with other dashes
            colour, dashes = colour_of_six(place), SIX_DASHES[(same if series.run else place + place // 6) % 6]
        while series.role != "band" and (colour, dashes) in taken:
            dashes = (*dashes, 1.0, 3.0) if dashes else (6.0, 3.0)
        taken.add((colour, dashes))
        styles.append({"color": colour, "linestyle": (0, dashes) if dashes else "-"})
    return styles


def _lines(axes: Axes, panel: Panel) -> None:
    chart, styles = panel.chart, _styles(panel)
    for k, label in told_apart(panel):
        series, style = panel.series[k], styles[k]
        scale = series.quantity.factor
        x, values = chart.x.quantity.factor * chart.x_of(series), drawable(scale * series.values)
        if series.low is not None and series.high is not None:
            low, high = scale * series.low, scale * series.high
            if chart.kind == "points":
                axes.errorbar(x, values, [values - low, high - values], fmt="none", ecolor=style["color"], elinewidth=1)
            else:
                axes.fill_between(x, low, high, color=style["color"], alpha=_SHADE, linewidth=0)
        if series.role == "band":
            # bands lie within each other, the widest first
            above = sum(below.role == "band" for below in panel.series[: k + 1])
            axes.fill([], [], color=style["color"], alpha=1 - (1 - _SHADE) ** above, label=label)
            continue
        if chart.kind == "points":
            is_many = len(x) > _MOST_MARKERS
            axes.plot(x, values, ".", color=style["color"], markersize=3, label=label, rasterized=is_many)
            continue
        held: dict[str, Any] = {"drawstyle": "steps-post"} if chart.kind == "step" else {}
        marker: dict[str, Any] = {"marker": "o", "markersize": 4} if len(x) == 1 else {}
        order = 3 if series.role == "reference" else 2
        axes.plot(*decimated(x, values, _POINTS), label=label, zorder=order, **style, **held, **marker)
    axes.margins(x=0.03 if chart.kind == "points" else 0)
    _span(axes, panel)


def _span(axes: Axes, panel: Panel) -> None:
    """Widen the vertical axis to the resolution of display, so that rounding does not fill it."""
    series = panel.series[0]
    if panel.chart.y is not None and panel.chart.y.scale == "log":
        return
    low, high = axes.get_ylim()
    least = max(panel.least, least_span(series.quantity.unit, max(abs(low), abs(high)), series.quantity.least))
    if high - low < least:
        middle = (low + high) / 2
        axes.set_ylim(middle - least / 2, middle + least / 2)


def _histogram(axes: Axes, panel: Panel) -> None:
    edges = panel.chart.x.quantity.factor * panel.chart.x.values
    for k, series in enumerate(panel.series):
        axes.stairs(series.values, edges, fill=True, color=_styles(panel)[k]["color"], alpha=0.8, label=series.name)
    axes.set_ylim(bottom=0)


def _bars(axes: Axes, panel: Panel) -> None:
    chart, count = panel.chart, len(panel.series)
    labels = chart.x.labels or tuple(chart.x.quantity.number(value) for value in chart.x.values)
    shown = slice(0, _MOST_BARS)
    at = np.arange(len(labels[shown]), dtype=float)
    thickness = 0.75 / count
    for k, series in enumerate(panel.series):
        values = series.quantity.factor * series.values[shown]
        error = None
        if series.low is not None and series.high is not None:
            low, high = (series.quantity.factor * ends[shown] for ends in (series.low, series.high))
            error = np.stack([values - low, high - values])
        place = at + (k - (count - 1) / 2) * thickness
        style: dict[str, Any] = {
            "color": _styles(panel)[k]["color"],
            "label": series.name,
            "error_kw": {"elinewidth": 1, "capsize": 2},
        }
        axes.barh(place, values, 0.9 * thickness, xerr=error, **style)
    axes.set_yticks(at, labels[shown], parse_math=False)
    axes.invert_yaxis()
    axes.axvline(0, color="black", linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(chart.y_title)


def _heat(axes: Axes, panel: Panel) -> None:
    draw_heat(axes, panel.chart, panel.slice)
    if any(len(label) > _SHORT_LABEL for label in panel.chart.x.labels):
        axes.tick_params(axis="x", labelrotation=90)


def _draw_maps(part: Any, grid: Sequence[Axes], row: Sequence[Panel]) -> None:
    """Draw maps side by side; slices share their axes and one bar of colours at the right."""
    for k, (panel, axes) in enumerate(zip(row, grid, strict=True)):
        chart, is_slice = panel.chart, panel.slice is not None
        draw_heat(axes, chart, panel.slice, has_bar=not is_slice or k == len(row) - 1)
        axes.tick_params(labelsize=7.5)
        axes.set_title(panel.title, fontsize=8.5, parse_math=False)
        axes.set_xlabel(chart.x.title, fontsize=8.5)
        axes.set_ylabel(chart.y_title if k == 0 or not is_slice else "", fontsize=8.5)
    if row[0].slice is not None:
        chart = row[0].chart
        part.suptitle(chart.series[0].quantity.headed(chart.title), fontsize=9.5, x=0.01, ha="left", parse_math=False)
    kinds = [panel.chart for panel in row if panel.chart.map is not None and panel.chart.map.classes]
    if kinds:
        cross, names = grid[0].get_legend_handles_labels()
        patches = kind_patches(kinds[0])
        labels = [*(str(patch.get_label()) for patch in patches), *names]
        part.legend([*patches, *cross], labels, loc="outside lower left", ncols=4, fontsize=8)


def _marks(axes: Axes, panel: Panel) -> None:
    chart, named = panel.chart, set[str]()
    limits = {True: axes.get_ylim(), False: axes.get_xlim()}
    for mark in chart.marks:
        style: dict[str, Any] = {
            "color": colour_of(mark.role),
            "linewidth": 1.1,
            "linestyle": (0, DASHES.get(mark.role, (1, 1.5))),
        }
        is_across = mark.direction == "horizontal"
        value = mark.value * (panel.series[0] if is_across else chart.x).quantity.factor
        low, high = limits[is_across]
        # a distant limit would flatten the lines
        if not low - 2 * (high - low) <= value <= high + 2 * (high - low):
            continue
        draw = axes.axhline if is_across else axes.axvline
        # in a grid, marks of one role have one entry
        at = "" if is_across or not mark.tells else f" {chart.x.quantity.text(mark.value)}"
        text = f"{mark.text}{at}" if panel.is_wide else ", ".join(m.text for m in chart.marks if m.role == mark.role)
        draw(value, label=None if text in named else text, **style)
        named.add(text)


def _spans(axes: Axes, panel: Panel) -> None:
    """Margins as thick lines from end to end, with their text beside them."""
    chart = panel.chart
    across, up = chart.x.quantity.factor, panel.series[0].quantity.factor
    for span in chart.spans:
        x, (low, high), colour = across * span.at, (up * span.low, up * span.high), colour_of(span.role)
        axes.plot([x, x], [low, high], color=colour, linewidth=2.2, marker="_", markersize=7, zorder=4)
        # left of its lower end, where a loop that falls leaves room
        start, end = axes.get_xlim()
        is_left = x > (start**0.65 * end**0.35 if chart.x.scale == "log" else 0.65 * start + 0.35 * end)
        place: dict[str, Any] = {"ha": "right" if is_left else "left", "va": "top", "fontsize": 7.5, "zorder": 5}
        boxed = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
        shift = (-5 if is_left else 5, -2)
        axes.annotate(span.text, (x, low), shift, textcoords="offset points", color=colour, bbox=boxed, **place)


def _strips(axes: Axes, panel: Panel) -> None:
    """When limits are active: bars at the lower edge of the axes, one above the other."""
    chart, (low, high) = panel.chart, axes.get_ylim()
    ends, room = axes.get_xlim(), 1.4 * _STRIP * len(chart.strips)
    for k, strip in enumerate(chart.strips):
        bars = [(chart.x.quantity.factor * a, chart.x.quantity.factor * (b - a)) for a, b in strip.intervals]
        label = f"{strip.name}, {percent(strip.share)}"
        place = (_STRIP * (1.4 * k + 0.4), _STRIP)
        where: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "zorder": 4}
        axes.broken_barh(bars, place, color=colour_of(strip.role), label=label, linewidth=0.8, **where)
    axes.set_xlim(ends)
    # below all curves
    axes.set_ylim(low - (high - low) * room / (1 - room), high)

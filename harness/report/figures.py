"""The charts of a report as figures for print: PDF, PNG and SVG by matplotlib; the same report gives the same bytes.

Charts of a group are panels of one figure. Components that have a reference get a panel each, so that no line hides
another; others share one, with a legend. Maps stand side by side, with colours, border and contour lines; one with a
third coordinate is shown in slices.
"""

import re
from collections.abc import Sequence
from functools import partial
from itertools import count, groupby
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from gough_stewart.harness.report.chart import Chart, Map, Series, looks_of
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.packing import decimated
from gough_stewart.harness.report.palette import DASHES, INK, MARK_DASHES, colour_of
from gough_stewart.harness.report.palette import KINDS as COLOURS_OF_KINDS
from gough_stewart.harness.report.plotting import entitle, files_of
from gough_stewart.harness.report.quantities import least_span, number_text, percent
from gough_stewart.model.vectors import FloatArray

KINDS = ("pdf", "png", "svg")
# Width of a figure, and the heights of its title and of a row of panels [inch].
WIDTH, _HEAD, ROW = 8.0, 0.55, 1.9
# Larger values overflow matplotlib's arithmetic.
_LARGEST = 1e100
# Lines that stay within this share of the axis hide each other; so many can be told apart in one panel.
_HIDES, _MOST_LINES = 4e-3, 12
# Of a group, so many charts of one kind with the same series are small panels with one legend.
_SMALL = 3
# Points of a line in a panel of about 400 pixels; more markers than these are pixels, also in PDF and SVG.
_POINTS, _MOST_MARKERS, _MOST_BARS = 800, 2000, 20
# Letters: longer labels below an axis are turned; in a line of a note; of a name in a legend beside its chart.
_SHORT_LABEL, _NOTE, _LABEL = 3, 100, 24
# Height of a strip, of the axes; opacity of one band over another.
_STRIP, _SHADE = 0.022, 0.22
# Slices of a map that a figure shows; decades of logarithmic colours, since next to a singular pose all other values
# would share one colour otherwise; more of labelled contour lines hide the map.
_SLICES, _DECADES, _LEVELS = 4, 3, 7
_GREY, _INK = "#f0f0f0", INK["light"]


class Panel(NamedTuple):
    """Some of the series of a chart, in axes of their own; wide, or a small one in a grid."""

    chart: Chart
    title: str
    series: tuple[Series, ...]
    is_wide: bool
    least: float = 0.0  # span of the vertical axis
    names: tuple[str, ...] = ()  # of its series in the legend of the grid
    slice: int | None = None  # of a map


def figures(report: Report, kinds: Sequence[str] = KINDS, group: str | None = None) -> dict[str, bytes]:
    """The figures of all charts but those of details, by file name; of one group alone if it is given."""
    shown = [
        part
        for section in report.sections
        if not section.detail
        for part in section.parts
        if isinstance(part, Chart) and not part.detail and group in (None, part.group)
    ]
    # what did not go well should look like it
    is_well = report.verdict.status in ("good", "told")
    head = report.title if is_well else f"{report.title} — {report.verdict.text}"
    head += f" ({', '.join(setting.text for setting in report.settings)})" if report.changed else ""
    files: dict[str, bytes] = {}
    used = set[str]()
    for title, charts in groupby(shown, key=lambda chart: chart.group or chart.title):
        stem = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-") or "chart"
        names = (stem if k == 1 else f"{stem}-{k}" for k in count(1))
        name = next(name for name in names if name not in used)
        used.add(name)
        rows = _rows(list(charts))
        height = _HEAD + sum(ROW * _height_of(row) for row in rows)
        written = files_of(partial(_draw, head, rows), WIDTH, height, tuple(kinds))
        files |= {f"{name}.{kind}": file for kind, file in written.items()}
    return files


# --- panels ----------------------------------------------------------------------------------------------------------


def _rows(charts: Sequence[Chart]) -> list[list[Panel]]:
    """The panels of a figure: a row for each chart, or a grid for several of one kind with the same series.

    Maps stand side by side, two in a row; those in slices have a row each.
    """

    def look(chart: Chart) -> object:
        if chart.map is not None:
            return "map" if chart.map.slices is None else "slices"
        return chart.kind, tuple((series.name, series.role) for series in chart.series)

    rows: list[list[Panel]] = []
    for kind, group in groupby(charts, key=look):
        alike = list(group)
        if kind == "slices":
            rows += map(_slices, alike)
        elif kind == "map":
            maps = [Panel(chart, chart.series[0].quantity.headed(chart.title), chart.series, False) for chart in alike]
            rows += [maps[k : k + 2] for k in range(0, len(maps), 2)]
        elif len(alike) >= _SMALL and alike[0].kind not in ("bars", "heat"):
            names = tuple(series.name for series in alike[0].series)
            # named by the vertical axis, or else by the chart
            titles = [
                chart.y_title if chart.y is not None and chart.y.name else chart.series[0].quantity.headed(chart.title)
                for chart in alike
            ]
            rows.append([Panel(c, title, c.series, False, names=names) for c, title in zip(alike, titles, strict=True)])
        else:
            rows += map(_components, alike)
    return rows


def _slices(chart: Chart) -> list[Panel]:
    """Four slices of those with values inside the border, but not its ends, at which the region closes."""
    assert chart.map is not None
    axis, inside = chart.map.slices, chart.map.inside
    assert axis is not None
    filled = np.arange(len(axis.values)) if inside is None else np.flatnonzero((inside > 0).any(axis=(1, 2)))
    low, high = (int(filled[0]), int(filled[-1])) if filled.size else (0, len(axis.values) - 1)
    chosen = sorted({round(low + (k + 0.5) / _SLICES * (high - low)) for k in range(_SLICES)})
    values = [number_text(axis.quantity.factor * float(axis.values[k]), 3) for k in chosen]
    titles = [f"{axis.name} {value} {axis.quantity.unit_text}".strip() for value in values]
    return [Panel(chart, title, chart.series, False, slice=k) for k, title in zip(chosen, titles, strict=True)]


def _components(chart: Chart) -> list[Panel]:
    """A panel for each component that has a reference, or one for all series."""
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
    values = np.concatenate([_drawable(line.quantity.factor * line.values) for line in series])
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _drawable(values: FloatArray) -> FloatArray:
    """Values with gaps where they would overflow the arithmetic of axes."""
    return np.where(np.abs(values) <= _LARGEST, values, np.nan)


def _columns_of(row: Sequence[Panel]) -> int:
    """Panels side by side: one that is wide, at most three small ones, two of four; all of a row of maps."""
    if row[0].chart.map is not None:
        return max(len(row), 2)
    return 2 if len(row) == 4 else min(len(row), 3)


def _height_of(row: Sequence[Panel]) -> float:
    """The height of a row, in panels."""
    chart = row[0].chart
    if chart.map is None:
        return 1.5 if row[0].is_wide else float(-(-len(row) // _columns_of(row)))
    assert chart.y is not None
    # equal scales if both coordinates have the same unit, within limits that fit a page
    shape = float(np.clip(np.ptp(chart.y.values) / np.ptp(chart.x.values), 0.4, 1.6)) if _is_even(chart) else 0.8
    # what is left of the width of a panel beside titles and bar
    wide = WIDTH / _columns_of(row) - (1.3 if row[0].slice is None else 0.5)
    return (wide * shape + 0.7) / ROW


def _draw(title: str, rows: Sequence[Sequence[Panel]], figure: Figure) -> None:
    entitle(figure, title)
    parts: Any = figure.subfigures(len(rows), 1, height_ratios=[_height_of(row) for row in rows], squeeze=False)[:, 0]
    for k, (part, row) in enumerate(zip(parts, rows, strict=True)):
        columns = _columns_of(row)
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
    axes.set_title(panel.title if is_named else panel.series[0].quantity.headed(panel.title), parse_math=False)
    _draw_panel(axes, panel)
    if chart.y is not None and chart.y.name and chart.kind not in ("heat", "bars"):
        axes.set_ylabel(chart.y_title)
    if chart.kind != "bars":
        axes.set_xlabel(chart.x.title)
    if chart.note:
        note = "\n".join(wrap(chart.note, _NOTE))
        axes.annotate(note, (0, 0), (0, -34), "axes fraction", "offset points", fontsize=7, va="top")
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > 1:
        labels = ["\n".join(wrap(label, _LABEL)) for label in labels]
        axes.legend(handles, labels, loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0, handlelength=3.2)


def _draw_small(part: Any, grid: Sequence[Axes], row: Sequence[Panel], *, has_legend: bool) -> None:
    """Draw a grid of panels; what is the same for all is said once: an axis, the legend, the note."""
    is_one_x = len({panel.chart.x.title for panel in row}) == 1
    is_one_y = not is_one_x and len({panel.chart.y_title for panel in row}) == 1
    columns = _columns_of(row)
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
        note = "\n".join(wrap(" ".join(dict.fromkeys(panel.chart.note for panel in row if panel.chart.note)), _NOTE))
        under: dict[str, Any] = {"title": note, "title_fontsize": 7, "ncols": len(names), "handlelength": 3.2}
        part.legend(handles, names, loc="outside lower center", **under)


def _draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw the series and marks of a panel, without its words."""
    chart = panel.chart
    if chart.kind == "heat":
        _draw_map(axes, chart, panel.slice)
        if any(len(label) > _SHORT_LABEL for label in chart.x.labels):
            axes.tick_params(axis="x", labelrotation=90)
    elif chart.kind == "histogram":
        edges = chart.x.quantity.factor * chart.x.values
        for series, style in zip(panel.series, _styles(panel), strict=True):
            axes.stairs(series.values, edges, fill=True, color=style["color"], alpha=0.8, label=series.name)
        axes.set_ylim(bottom=0)
    elif chart.kind == "bars":
        _draw_bars(axes, panel)
    else:
        _draw_lines(axes, panel)
    if chart.kind != "bars" and chart.x.scale == "log":
        axes.set_xscale("log")
    if chart.kind != "bars" and chart.y is not None and chart.y.scale == "log":
        axes.set_yscale("log")
    elif chart.kind not in ("bars", "heat"):
        # 0.9995 is plainer than -0.0005 with +1 above
        axes.ticklabel_format(axis="y", useOffset=False, scilimits=(-3, 6))
    if chart.kind not in ("bars", "heat") and chart.y is not None and chart.y.labels:
        axes.set_yticks(range(len(chart.y.labels)), chart.y.labels)
    _draw_marks(axes, panel)


# --- lines, bars, marks ----------------------------------------------------------------------------------------------


def _styles(panel: Panel) -> list[dict[str, Any]]:
    """Colour and dashes of each series."""
    looks = looks_of(panel.series, in_print=True)
    return [{"color": look.shade, "linestyle": (0, look.dashes) if look.dashes else "-"} for look in looks]


def _told_apart(panel: Panel) -> list[tuple[int, str]]:
    """The series to draw, with their names; those that would hide each other are one line with all their names."""
    chart = panel.chart
    if chart.kind == "points" or not panel.is_wide:
        return [(k, series.name) for k, series in enumerate(panel.series)]
    is_log, quantity = chart.y is not None and chart.y.scale == "log", panel.series[0].quantity
    near = _HIDES if is_log else max(_extent(panel.series) * _HIDES, least_span(quantity.unit, least=quantity.least))

    def coincide(first: Series, second: Series) -> bool:
        # on a logarithmic axis, as near as a share of the value
        if first.role != second.role or first.low is not None or second.low is not None:
            return False
        if len(first.values) != len(second.values) or not np.array_equal(chart.x_of(first), chart.x_of(second)):
            return False
        a, b = (_drawable(series.quantity.factor * series.values) for series in (first, second))
        is_gap = np.isnan(first.values) & np.isnan(second.values)
        return bool(np.all((np.abs(a - b) <= near * (np.abs(a) if is_log else 1)) | is_gap))

    groups: list[list[int]] = []
    for k, series in enumerate(panel.series):
        group = next((group for group in groups if coincide(panel.series[group[0]], series)), None)
        if group is None:
            groups.append([k])
        else:
            group.append(k)
    named = []
    for group in groups[:_MOST_LINES]:
        legs = [panel.series[k].leg or 0 for k in group]
        name = ", ".join(panel.series[k].name for k in group)
        if len(legs) > 2 and legs[0] and legs == list(range(legs[0], legs[0] + len(legs))):
            name = f"legs {legs[0]}–{legs[-1]}"
        named.append((group[0], name))
    return named


def _draw_lines(axes: Axes, panel: Panel) -> None:
    chart, styles = panel.chart, _styles(panel)
    for k, label in _told_apart(panel):
        series, style = panel.series[k], styles[k]
        scale = series.quantity.factor
        x, values = chart.x.quantity.factor * chart.x_of(series), _drawable(scale * series.values)
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
        elif chart.kind == "points":
            is_many = len(x) > _MOST_MARKERS
            axes.plot(x, values, ".", color=style["color"], markersize=3, label=label, rasterized=is_many)
        else:
            look: dict[str, Any] = {"drawstyle": "steps-post"} if chart.kind == "step" else {}
            look |= {"marker": "o", "markersize": 4} if len(x) == 1 else {}
            order = 3 if series.role == "reference" else 2
            axes.plot(*decimated(x, values, _POINTS), label=label, zorder=order, **style, **look)
    axes.margins(x=0.03 if chart.kind == "points" else 0)
    if chart.y is None or chart.y.scale != "log":
        # at least the resolution of display, so that rounding does not fill the axis
        (bottom, top), quantity = axes.get_ylim(), panel.series[0].quantity
        least = max(panel.least, least_span(quantity.unit, max(abs(bottom), abs(top)), quantity.least, is_axis=True))
        if top - bottom < least:
            middle = (bottom + top) / 2
            axes.set_ylim(middle - least / 2, middle + least / 2)


def _draw_bars(axes: Axes, panel: Panel) -> None:
    chart, number = panel.chart, len(panel.series)
    values = chart.x.values.tolist()
    labels = (chart.x.labels or tuple(chart.x.quantity.text(value, unit=False) for value in values))[:_MOST_BARS]
    at, thickness = np.arange(len(labels), dtype=float), 0.75 / number
    for k, (series, style) in enumerate(zip(panel.series, _styles(panel), strict=True)):
        factor, error = series.quantity.factor, None
        values = factor * series.values[:_MOST_BARS]
        if series.low is not None and series.high is not None:
            error = np.stack([values - factor * series.low[:_MOST_BARS], factor * series.high[:_MOST_BARS] - values])
        place = at + (k - (number - 1) / 2) * thickness
        look: dict[str, Any] = {"color": style["color"], "label": series.name}
        axes.barh(place, values, 0.9 * thickness, xerr=error, error_kw={"elinewidth": 1, "capsize": 2}, **look)
    axes.set_yticks(at, labels, parse_math=False)
    axes.invert_yaxis()
    axes.axvline(0, color="black", linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(chart.y_title)


def _draw_marks(axes: Axes, panel: Panel) -> None:
    """Lines across at values; distances with their texts; bars at the lower edge for when limits are active."""
    chart, named = panel.chart, set[str]()
    across, up = chart.x.quantity.factor, panel.series[0].quantity.factor
    limits = {True: axes.get_ylim(), False: axes.get_xlim()}
    for mark in chart.marks:
        is_across = mark.direction == "horizontal"
        value, (low, high) = mark.value * (up if is_across else across), limits[is_across]
        # a distant limit would flatten the lines
        if not low - 2 * (high - low) <= value <= high + 2 * (high - low):
            continue
        # in a grid, marks of one role have one entry
        at = "" if is_across or not mark.tells else f" {chart.x.quantity.text(mark.value)}"
        text = f"{mark.text}{at}" if panel.is_wide else ", ".join(m.text for m in chart.marks if m.role == mark.role)
        style: dict[str, Any] = {"linewidth": 1.1, "linestyle": (0, DASHES.get(mark.role, MARK_DASHES))}
        draw = axes.axhline if is_across else axes.axvline
        draw(value, label=None if text in named else text, color=colour_of(mark.role), **style)
        named.add(text)
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
    (low, high), ends, room = axes.get_ylim(), axes.get_xlim(), 1.4 * _STRIP * len(chart.strips)
    for k, strip in enumerate(chart.strips):
        bars = [(across * a, across * (b - a)) for a, b in strip.intervals]
        where: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "zorder": 4, "linewidth": 0.8}
        place = {"color": colour_of(strip.role), "label": f"{strip.name}, {percent(strip.share)}"}
        axes.broken_barh(bars, (_STRIP * (1.4 * k + 0.4), _STRIP), **place, **where)
    axes.set_xlim(ends)
    # strips are below all curves
    axes.set_ylim(low - (high - low) * room / (1 - room), high)


# --- maps ------------------------------------------------------------------------------------------------------------


def _draw_maps(part: Any, grid: Sequence[Axes], row: Sequence[Panel]) -> None:
    """Draw maps side by side; slices share their axes and one bar of colours at the right."""
    for k, (panel, axes) in enumerate(zip(row, grid, strict=True)):
        is_slice = panel.slice is not None
        _draw_map(axes, panel.chart, panel.slice, has_bar=not is_slice or k == len(row) - 1)
        axes.tick_params(labelsize=7.5)
        axes.set_title(panel.title, fontsize=8.5, parse_math=False)
        axes.set_xlabel(panel.chart.x.title, fontsize=8.5)
        axes.set_ylabel(panel.chart.y_title if k == 0 or not is_slice else "", fontsize=8.5)
    chart = row[0].chart
    if row[0].slice is not None:
        part.suptitle(chart.series[0].quantity.headed(chart.title), fontsize=9.5, x=0.01, ha="left", parse_math=False)
    kinds = next((panel.chart for panel in row if panel.chart.map is not None and panel.chart.map.classes), None)
    if kinds is not None and kinds.map is not None:
        cross, names = grid[0].get_legend_handles_labels()
        # what the colours mean, of those that occur
        codes, colours = sorted({int(value) for value in kinds.series[0].values.ravel()}), COLOURS_OF_KINDS["light"]
        edges = ["none" if k else _INK for k in codes]
        patches = [Patch(facecolor=colours[k % len(colours)], edgecolor=e) for k, e in zip(codes, edges, strict=True)]
        labels = [*(kinds.map.classes[k] for k in codes), *names]
        part.legend([*patches, *cross], labels, loc="outside lower left", ncols=4, fontsize=8)


def _is_even(chart: Chart) -> bool:
    """Whether both coordinates of a map have one unit, and so one scale."""
    assert chart.y is not None
    has_labels = bool(chart.x.labels or chart.y.labels)
    return not has_labels and chart.map is not None and chart.x.quantity.unit == chart.y.quantity.unit


def _draw_map(axes: Axes, chart: Chart, k: int | None = None, *, has_bar: bool = True) -> None:
    """Draw a heat map, or slice k of one, with its axes' titles."""
    assert chart.y is not None
    over = chart.map or Map()
    x, y = (axis.quantity.factor * axis.values for axis in (chart.x, chart.y))
    whole, inside = chart.series[0].quantity.factor * chart.series[0].values, over.inside
    values, field = whole if k is None else whole[k], inside if inside is None or k is None else inside[k]
    has_border = field is not None and bool(field.min() < 0 < field.max())
    if over.classes:
        kinds = [COLOURS_OF_KINDS["light"][k % len(COLOURS_OF_KINDS["light"])] for k in range(len(over.classes))]
        norm = BoundaryNorm(np.arange(len(kinds) + 1) - 0.5, len(kinds))
        spread = values
        # kinds beyond the border, also in the cells that it crosses, where the border is drawn finer than the grid;
        # two rounds: one that reaches every neighbour, and one for corners
        for _ in range(0 if field is None else 2):
            around = np.pad(spread, 1)
            for neighbour in (around[1:-1, 2:], around[1:-1, :-2], around[2:, 1:-1], around[:-2, 1:-1]):
                spread = np.where(spread == 0, neighbour, spread)
        axes.pcolormesh(x, y, spread, shading="nearest", cmap=ListedColormap(kinds), norm=norm, rasterized=True)
        if field is not None and has_border:
            axes.contourf(x, y, field, levels=[0, np.inf], colors=kinds[:1])
    else:
        # the scale of colours is over all slices, of the values inside the border
        seen = whole[np.isfinite(whole)] if inside is None else whole[(inside > 0) & np.isfinite(whole)]
        seen = seen[seen > 0] if over.scale == "log" else seen
        low, high = (float(seen.min()), float(seen.max())) if seen.size else (1.0, 2.0)
        high = high if high > low or over.scale == "log" else low + 1.0
        colours = Normalize(low, high)
        if over.scale == "log":
            colours = LogNorm(low, max(min(high, low * 10**_DECADES), 1.01 * low))
        _draw_colours(axes, chart, (x, y), values, field, colours, has_bar=has_bar, has_border=has_border)
    if field is not None and has_border:
        axes.contour(x, y, field, levels=[0], colors=_INK, linewidths=1.1)
    if over.point and k in (None, over.first):
        place = [axis.quantity.factor * at for axis, at in zip((chart.x, chart.y), over.point, strict=True)]
        cross: dict[str, Any] = {"marker": "+", "color": _INK, "linestyle": "none", "label": over.point_name}
        axes.plot(*place, markersize=8, markeredgewidth=1.4, zorder=5, **cross)
    axes.grid(visible=False)
    axes.set_ylabel(chart.y.title)
    if _is_even(chart) and field is not None:
        axes.set_aspect("equal", adjustable="datalim" if k is None else "box")
    for drawn_axis, axis in ((axes.xaxis, chart.x), (axes.yaxis, chart.y)):
        if axis.labels:
            drawn_axis.set_ticks(axis.quantity.factor * axis.values, axis.labels, fontsize=7, parse_math=False)
    if chart.y.labels:
        axes.invert_yaxis()


def _draw_colours(
    axes: Axes, chart: Chart, at: tuple[FloatArray, FloatArray], values: FloatArray, field: FloatArray | None,
    norm: Normalize, *, has_bar: bool, has_border: bool,
) -> None:  # fmt: skip
    low, high, is_log = float(norm.vmin or 0.0), float(norm.vmax or 0.0), isinstance(norm, LogNorm)
    look: dict[str, Any] = {"cmap": "cividis", "norm": norm, "rasterized": True}
    is_beyond = False
    if field is None:
        drawn: Any = axes.pcolormesh(*at, np.ma.masked_invalid(values), shading="nearest", **look)
    else:
        axes.set_facecolor(_GREY)
        bounded = np.clip(np.nan_to_num(values, nan=high, posinf=high), low / 2 if is_log else None, None)
        drawn = axes.pcolormesh(*at, bounded, shading="gouraud", **look)
        finite, drawings = np.isfinite(values), [drawn]
        drawn.set_visible(bool((field > 0).any()))
        is_beyond = bool((np.where(finite, values, np.inf)[field > 0] > 1.001 * high).any())
        levels = [level for level in MaxNLocator(_LEVELS).tick_values(low, high) if low < level < high]
        if levels and (field > 0).any():
            contours = np.where(finite, values, np.nan)
            lines = axes.contour(*at, contours, levels=levels, colors="white", linewidths=0.7)
            axes.clabel(lines, fmt=lambda level: number_text(level, 3), fontsize=6.5)
            drawings.append(lines)
        if has_border:
            # all ends there, and labels that reach over it are left out
            border = axes.contourf(*at, field, levels=[0, np.inf], colors="none")
            path = border.get_paths()[0]
            border.remove()
            for drawing in drawings:
                drawing.set_clip_path(path, axes.transData)
            across, up = (np.ptp(ends) / 12 for ends in at)
            for text in axes.texts:
                x, y = text.get_position()
                around = [(x + a * across, y + b * up) for a in (-1, 0, 1) for b in (-0.5, 0, 0.5)]
                text.set_visible(bool(path.contains_points(around).all()))
    if has_bar:
        label = chart.series[0].quantity.headed("" if chart.map else chart.series[0].name)
        bar: Any = axes.figure.colorbar(drawn, ax=axes, label=label, extend="max" if is_beyond else "neither")
        if is_log:
            # round numbers without powers of ten
            span = high / low
            steps = (1, 2, 3, 5, 7) if span < 40 else (1, 2, 5)
            bar.ax.yaxis.set_major_locator(LogLocator(10, subs=steps) if span > 4 else MaxNLocator(6))
            bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            bar.ax.yaxis.set_minor_formatter(NullFormatter())

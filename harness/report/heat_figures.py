"""Heat maps as panels of a figure: colours, border, contour lines, slices of a third coordinate."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from gough_stewart.harness.report.chart import Chart
from gough_stewart.harness.report.palette import INK, KINDS
from gough_stewart.harness.report.words import number_text
from gough_stewart.model.vectors import FloatArray

# Slices of a heat map that a figure shows.
SLICES = 4
# Decades of logarithmic colours; next to a singular pose all other values would share one colour otherwise.
_DECADES = 3
# More of labelled contour lines hide the map.
_LEVELS = 7
_GREY = "#f0f0f0"


def slices_shown(chart: Chart) -> Sequence[int | None]:
    """The slices that a figure shows: four of those with values inside the border, but not its ends; None of a map."""
    if chart.map is None or chart.map.slices is None:
        return [None]
    inside = chart.map.inside
    there = np.arange(len(chart.map.slices.values)) if inside is None else np.flatnonzero((inside > 0).any(axis=(1, 2)))
    low, high = (int(there[0]), int(there[-1])) if there.size else (0, len(chart.map.slices.values) - 1)
    # the region closes at its ends
    return sorted({round(low + (k + 0.5) / SLICES * (high - low)) for k in range(SLICES)})


def slice_title(chart: Chart, k: int | None) -> str:
    """Name and value of the third coordinate; "" of a map without slices."""
    if k is None or chart.map is None or chart.map.slices is None:
        return ""
    axis = chart.map.slices
    value = number_text(axis.quantity.factor * float(axis.values[k]), 3)
    return f"{axis.name} {value} {axis.quantity.unit_text}".strip()


def height_over_width(chart: Chart) -> float:
    """Of a map: equal scales if both coordinates have the same unit, within limits that fit a page."""
    if not _is_even(chart):
        return 0.8
    assert chart.y is not None
    return float(np.clip(np.ptp(chart.y.values) / np.ptp(chart.x.values), 0.4, 1.6))


def draw_heat(axes: Axes, chart: Chart, k: int | None = None, *, has_bar: bool = True) -> None:
    """Draw a heat map, or slice k of one, with its axes' titles."""
    assert chart.y is not None
    x, y = (axis.quantity.factor * axis.values for axis in (chart.x, chart.y))
    whole = chart.series[0].quantity.factor * chart.series[0].values
    inside = None if chart.map is None else chart.map.inside
    values, field = whole if k is None else whole[k], inside if inside is None or k is None else inside[k]
    if chart.map is not None and chart.map.classes:
        _kinds(axes, x, y, values, field, chart.map.classes)
    else:
        _colours(axes, chart, (x, y), values, field, _norm(chart, whole, inside), has_bar=has_bar)
    if field is not None and _has_border(field):
        axes.contour(x, y, field, levels=[0], colors=INK["light"], linewidths=1.1)
    if chart.map is not None and chart.map.point and k in (None, chart.map.first):
        place = [axis.quantity.factor * at for axis, at in zip((chart.x, chart.y), chart.map.point, strict=True)]
        cross: dict[str, Any] = {"marker": "+", "color": INK["light"], "linestyle": "none"}
        axes.plot(*place, markersize=8, markeredgewidth=1.4, zorder=5, label=chart.map.point_name, **cross)
    axes.grid(visible=False)
    axes.set_ylabel(chart.y.title)
    if _is_even(chart) and field is not None:
        axes.set_aspect("equal", adjustable="datalim" if k is None else "box")
    for drawn_axis, axis in ((axes.xaxis, chart.x), (axes.yaxis, chart.y)):
        if axis.labels:
            drawn_axis.set_ticks(axis.quantity.factor * axis.values, axis.labels, fontsize=7, parse_math=False)
    if chart.y.labels:
        axes.invert_yaxis()


def kind_patches(chart: Chart) -> list[Patch]:
    """What the colours of a map of kinds mean, of those that occur."""
    assert chart.map is not None
    kinds, ink, colours = sorted({int(value) for value in chart.series[0].values.ravel()}), INK["light"], KINDS["light"]
    return [
        Patch(facecolor=colours[k % len(colours)], edgecolor="none" if k else ink, label=chart.map.classes[k])
        for k in kinds
    ]


def _is_even(chart: Chart) -> bool:
    assert chart.y is not None
    has_labels = bool(chart.x.labels or chart.y.labels)
    return not has_labels and chart.map is not None and chart.x.quantity.unit == chart.y.quantity.unit


def _has_border(field: FloatArray) -> bool:
    return bool(field.min() < 0 < field.max())


def _norm(chart: Chart, values: FloatArray, inside: FloatArray | None) -> Normalize:
    """The scale of colours, over all slices, of the values inside the border."""
    seen = values[np.isfinite(values)] if inside is None else values[(inside > 0) & np.isfinite(values)]
    is_log = chart.map is not None and chart.map.scale == "log"
    seen = seen[seen > 0] if is_log else seen
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (1.0, 2.0)
    if is_log:
        return LogNorm(low, max(min(high, low * 10**_DECADES), 1.01 * low))
    return Normalize(low, high if high > low else low + 1.0)


def _kinds(
    axes: Axes, x: FloatArray, y: FloatArray, values: FloatArray, field: FloatArray | None, classes: tuple[str, ...]
) -> None:
    colours = ListedColormap([KINDS["light"][k % len(KINDS["light"])] for k in range(len(classes))])
    norm = BoundaryNorm(np.arange(len(classes) + 1) - 0.5, len(classes))
    shown = values if field is None else _spread(values)
    axes.pcolormesh(x, y, shown, shading="nearest", cmap=colours, norm=norm, rasterized=True)
    if field is not None and _has_border(field):
        axes.contourf(x, y, field, levels=[0, np.inf], colors=[KINDS["light"][0]])


def _spread(values: FloatArray) -> FloatArray:
    """Kinds beyond the border, also in the cells that it crosses, where the border is drawn finer than the grid."""
    spread = values
    # two rounds: one that reaches every neighbour, and one for corners
    for _ in range(2):
        around = np.pad(spread, 1)
        for neighbour in (around[1:-1, 2:], around[1:-1, :-2], around[2:, 1:-1], around[:-2, 1:-1]):
            spread = np.where(spread == 0, neighbour, spread)
    return spread


def _colours(
    axes: Axes, chart: Chart, at: tuple[FloatArray, FloatArray], values: FloatArray, field: FloatArray | None,
    norm: Normalize, *, has_bar: bool,
) -> None:  # fmt: skip
    series, is_log = chart.series[0], isinstance(norm, LogNorm)
    low, high = float(norm.vmin or 0.0), float(norm.vmax or 0.0)
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
        if _has_border(field):
            _clip(axes, at, field, drawings)
    if has_bar:
        label = series.quantity.headed("" if chart.map else series.name)
        bar = axes.figure.colorbar(drawn, ax=axes, label=label, extend="max" if is_beyond else "neither")
        if is_log:
            _plain_ticks(bar, norm)


def _clip(axes: Axes, at: tuple[FloatArray, FloatArray], field: FloatArray, drawings: Sequence[Any]) -> None:
    """Clip to the border; labels that reach over it are left out."""
    border = axes.contourf(*at, field, levels=[0, np.inf], colors="none")
    path = border.get_paths()[0]
    border.remove()
    for drawing in drawings:
        drawing.set_clip_path(path, axes.transData)
    across, up = (np.ptp(values) / 12 for values in at)
    for text in axes.texts:
        x, y = text.get_position()
        around = [(x + a * across, y + b * up) for a in (-1, 0, 1) for b in (-0.5, 0, 0.5)]
        text.set_visible(bool(path.contains_points(around).all()))


def _plain_ticks(bar: Any, norm: Normalize) -> None:
    """Round numbers without powers of ten."""
    span = (norm.vmax or 1.0) / (norm.vmin or 1.0)
    locator: Any = LogLocator(10, subs=(1, 2, 3, 5, 7) if span < 40 else (1, 2, 5)) if span > 4 else MaxNLocator(6)
    bar.ax.yaxis.set_major_locator(locator)
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.yaxis.set_minor_formatter(NullFormatter())

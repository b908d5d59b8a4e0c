"""Figures of a run for screen and print: pose, errors, forces, leg lengths."""

import textwrap
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.display_resolution import decimated, least_span
from gough_stewart.harness.output.plotting import entitle, pictures, png
from gough_stewart.harness.results.outcome import is_sound, outcome_of, outcome_text
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.model.vectors import FloatArray

WIDTH = 8.0  # [inch]
# Points of a line and spans of a strip, for a panel of about 400 pixels; six panels of two lines give a 200 kB SVG.
_POINTS, _SPANS = 800, 200
# Larger values overflow matplotlib's axis arithmetic.
_LARGEST = 1e100
# An axis spans at least this share of its values, so that rounding does not fill it.
_LEAST = 1e-6
# Layout engines and title placement measure everything again for each file, which takes half of the time.
_PLACED_BY_HAND: dict[Any, Any] = {"figure.constrained_layout.use": False, "axes.titley": 1.0}
_LEFT, _RIGHT, _TITLE_LINE, _PANEL_TITLE, _PAD, _DIGIT = 0.15, 0.15, 0.19, 0.34, 0.07, 0.083  # [inch]
_FOOT = 0.72  # below the panels, for times and legend [inch]
# Dashes that tell six lines apart without colour.
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), "-.", (0, (1, 1)), (0, (8, 1.5, 1, 1.5, 1, 1.5)), (0, (2.5, 1)))
_ACTUAL: dict[str, Any] = {"color": COLOURS[0], "linewidth": 1.8}
_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (4, 3))}
_GRID: dict[str, Any] = {"color": "#DDDDDD", "linewidth": 0.6, "zorder": 0.5}
_LIMIT: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.2, "linestyle": (0, (1, 1.5))}
# Strips at the top of a panel: colour and lower edge.
_STRIPS = {"force_limited": ("black", 0.955), "rate_limited": ("#999999", 0.90)}
_STRIP_HEIGHT = 0.045
_LEGS = tuple(f"leg {i}" for i in range(1, 7))


def run_figures(record: RecordData) -> dict[str, bytes]:
    """Draw `pose`, `errors`, `forces` and `legs` as PNG and SVG, by file name; no `errors` without a reference.

    The same record gives the same bytes. Lines are `decimated`. If a run ended early, the title says when and why.
    """
    draws: dict[str, tuple[Callable[[Figure, RecordData], None], float]] = {"pose": (_pose, 4.6)}
    if "error.position" in record and "error.orientation" in record:
        draws["errors"] = (_errors, 6.2)
    draws |= {"forces": (_forces, 4.6), "legs": (_legs, 4.6)}
    files = {}
    for name, (draw, height) in draws.items():
        files.update(pictures(name, partial(_placed, draw, record), WIDTH, height))
    return files


def pose_png(record: RecordData) -> bytes:
    """Only the figure `pose`, as PNG."""
    return png(partial(_placed, _pose, record), WIDTH, 4.6)


def _placed(draw: Callable[[Figure, RecordData], None], record: RecordData, figure: Figure) -> None:
    # read again for each file; the caller restores the settings
    mpl.rcParams.update(_PLACED_BY_HAND)
    figure.set_layout_engine(None)
    draw(figure, record)


class _View(NamedTuple):
    """Limits of an axis."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


def _pose(figure: Figure, record: RecordData) -> None:
    parts = (("position", 1.0, "m", ("x", "y", "z")), ("orientation", 180 / np.pi, "deg", ("roll", "pitch", "yaw")))
    lines, panels = [], []
    for name, scale, unit, names in parts:
        curves = [_shown(record[column], scale) for column in (name, f"reference.{name}") if column in record]
        each = [np.stack([curve[:, k] for curve in curves]) for k in range(3)]
        # an axis that hardly moves compared with the others should look like it
        smallest = least_span(unit)
        views = [_view(values, smallest) for values in each]
        least = max(smallest, *((view.high - view.low) / 50 for view in views))
        lines += each
        panels += [(f"{names[k]} [{unit}]", _view(each[k], least)) for k in range(3)]
    for axes, both in zip(_panels(figure, record, "pose", panels, columns=3), lines, strict=True):
        _actual_and_reference(axes, record, list(both))
    _legend(figure, _names(len(lines[0])))


def _errors(figure: Figure, record: RecordData) -> None:
    parts = [
        ("position", "position [mm]", ("x", "y", "z")),
        ("orientation", "orientation [deg]", ("roll", "pitch", "yaw")),
        ("leg_length", "leg length [mm]", _LEGS),
    ]
    parts = [part for part in parts if f"error.{part[0]}" in record]
    scales = [180 / np.pi if name == "orientation" else 1e3 for name, _, _ in parts]
    values = [_shown(record[f"error.{name}"], scale) for (name, _, _), scale in zip(parts, scales, strict=True)]
    least = [least_span("deg" if name == "orientation" else "mm") for name, _, _ in parts]
    panels = [(title, _view(each, span)) for (_, title, _), each, span in zip(parts, values, least, strict=True)]
    all_axes = _panels(figure, record, "errors, reference − actual", panels, columns=1, right=1.25, foot=0.5)
    for axes, each, span, (_, _, names) in zip(all_axes, values, least, parts, strict=True):
        for k, name in enumerate(_told_apart(each, span, names)):
            style = {"color": COLOURS[k], "linestyle": _DASHES[k], "linewidth": 1.3, "label": name}
            _line(axes, record, each[:, k], **style)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0, handlelength=3.2)


def _told_apart(values: FloatArray, span: float, names: Sequence[str]) -> Sequence[str]:
    """Names of the lines (n, k) to draw; six legs that stay within a span of each other share one line."""
    spread = values.max(axis=1) - values.min(axis=1)
    return ("legs 1–6",) if names == _LEGS and bool((spread < span).all()) else names


def _forces(figure: Figure, record: RecordData) -> None:
    limit = record.metadata.get("force_limit")
    bounds = () if limit is None else (-float(limit), float(limit))
    flags = {name: record[f"flag.{name}"].astype(bool) for name in _STRIPS if f"flag.{name}" in record}
    flags = {name: each for name, each in flags.items() if each.any()}
    force = _shown(record["actuator_force"])
    view = _view(force, least_span("N"), bounds, top=0.16 if flags else 0.06)
    title = "actuator forces" + _unseen(bounds, view, f"limit ±{limit:g} N" if bounds else "")
    for k, axes in enumerate(_panels(figure, record, title, [(f"{leg} [N]", view) for leg in _LEGS], columns=3)):
        # held constant from row to row
        _line(axes, record, force[:, k], drawstyle="steps-post", **_ACTUAL)
        _bounds(axes, bounds, view)
        for name, each in flags.items():
            _strip(axes, record, name, each[:, k])
    styles = {"force": _ACTUAL} | ({"limit": _LIMIT} if any(map(view.holds, bounds)) else {})
    _legend(figure, styles, [Patch(color=_STRIPS[name][0], label=name.replace("_", " ")) for name in flags])


def _legs(figure: Figure, record: RecordData) -> None:
    platform = record.metadata["platform"]
    limits = [platform.get(f"leg_length_{end}") for end in ("min", "max")]
    bounds = [float(limit) for limit in limits if limit is not None]
    curves = [_shown(record[name]) for name in ("leg_length", "reference.leg_length") if name in record]
    view = _view(np.stack(curves), least_span("m"), bounds)
    stroke = " to ".join("…" if limit is None else f"{limit:g}" for limit in limits)
    title = "leg lengths" + _unseen(bounds, view, f"stroke {stroke} m")
    for k, axes in enumerate(_panels(figure, record, title, [(f"{leg} [m]", view) for leg in _LEGS], columns=3)):
        _actual_and_reference(axes, record, [curve[:, k] for curve in curves])
        _bounds(axes, bounds, view)
    _legend(figure, _names(len(curves)) | ({"stroke limit": _LIMIT} if any(map(view.holds, bounds)) else {}))


def _panels(
    figure: Figure,
    record: RecordData,
    what: str,
    panels: Sequence[tuple[str, _View]],
    columns: int,
    right: float = _RIGHT,
    foot: float = _FOOT,
) -> list[Axes]:
    """Axes row by row, each with a title and limits, over the time of the record, with room for their tick labels.

    If all panels have the same limits, only the first of a row has tick labels.
    """
    lines = _title(record, what)
    entitle(figure, "\n".join(lines))
    rows = len(panels) // columns
    ticks = [_ticks(*view) for _, view in panels]
    time = record["time"]
    start, end = float(time[0]), float(time[-1])
    span = _View(start, end) if end > start else _View(start - 0.5, start + 0.5)
    instants, times = _ticks(*span)
    numbers = _LEFT + _PAD + _room(text for _, texts in ticks for text in texts)
    once = columns > 1 and len({view for _, view in panels}) == 1
    # keep the last time of a panel clear of the first of the next
    gap = _PAD + _room(times) if once else numbers
    width = (figure.get_figwidth() - right - numbers + gap) / columns - gap
    top = _TITLE_LINE * len(lines) + 0.1 + _PANEL_TITLE
    height = (figure.get_figheight() - top - foot + _PANEL_TITLE) / rows - _PANEL_TITLE
    all_axes = []
    for k, ((title, view), (values, texts)) in enumerate(zip(panels, ticks, strict=True)):
        row, column = divmod(k, columns)
        left = numbers + column * (gap + width)
        bottom = figure.get_figheight() - top - height - row * (height + _PANEL_TITLE)
        box = np.array([left, bottom, width, height]) / np.tile(figure.get_size_inches(), 2)
        axes = figure.add_axes(tuple(box), xlim=span, ylim=view)
        axes.set_title(title)
        _grid(axes, (instants, times if row == rows - 1 else []), (values, [] if once and column > 0 else texts))
        all_axes.append(axes)
    middle = (numbers + figure.get_figwidth() - right) / 2 / figure.get_figwidth()
    figure.text(middle, (foot - 0.42) / figure.get_figheight(), "time [s]", ha="center")
    return all_axes


def _grid(axes: Axes, across: tuple[list[float], list[str]], up: tuple[list[float], list[str]]) -> None:
    """Grid lines and tick labels at round values; matplotlib's own ticks would add a quarter to the drawing time."""
    across_axes, up_axes = axes.get_xaxis_transform(), axes.get_yaxis_transform()
    for axis, ends, along in (
        (axes.xaxis, [((value, 0), (value, 1)) for value in across[0]], across_axes),
        (axes.yaxis, [((0, value), (1, value)) for value in up[0]], up_axes),
    ):
        axis.set_visible(False)
        axes.add_collection(LineCollection(ends, transform=along, **_GRID), autolim=False)
    pixels = _PAD * axes.figure.dpi
    width, height = pixels / axes.bbox.width, pixels / axes.bbox.height
    for value, text in zip(*across, strict=False):
        axes.text(value, -height, text, transform=across_axes, ha="center", va="top")
    for value, text in zip(*up, strict=False):
        axes.text(-width, value, text, transform=up_axes, ha="right", va="center_baseline")


def _room(texts: Iterable[str]) -> float:
    """Width of the longest of these labels [inch]."""
    return _DIGIT * max(map(len, texts), default=0)


def _title(record: RecordData, what: str) -> list[str]:
    outcome = outcome_of(record)
    lines = textwrap.wrap(f"{record.metadata.get('title', 'untitled')} — {what}", 85, max_lines=2, placeholder=" …")
    if not is_sound(outcome):
        lines += textwrap.wrap(outcome_text(outcome), 85, max_lines=2, placeholder=" …")
    return lines


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Round values from low to high, and their labels with as few digits as tell them apart."""
    found = MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    values = [float(value) + 0.0 for value in found if low <= value <= high]
    step = float(found[1] - found[0])
    texts = min((_texts(values, step, form) for form in "fe"), key=_room)
    return values, [text.replace("-", "−") for text in texts]


def _texts(values: Sequence[float], step: float, form: str) -> list[str]:
    texts: list[str] = []
    for digits in range(17):
        texts = [f"{value:.{digits}{form}}" for value in values]
        if all(abs(float(text) - value) < 1e-3 * step for text, value in zip(texts, values, strict=True)):
            break
    return texts


def _actual_and_reference(axes: Axes, record: RecordData, curves: Sequence[FloatArray]) -> None:
    for values, style in zip(curves, (_ACTUAL, _REFERENCE), strict=False):
        _line(axes, record, values, **style)


def _line(axes: Axes, record: RecordData, values: FloatArray, **style: Any) -> None:
    time = record["time"]
    marker = "o" if len(time) == 1 else None
    axes.plot(*decimated(time, values, _POINTS), marker=marker, markersize=4, **style)


def _strip(axes: Axes, record: RecordData, name: str, flags: NDArray[np.bool_]) -> None:
    """Mark the times at which a flag is set; a bucket of rows is marked if any of its rows is."""
    time, (colour, low) = record["time"], _STRIPS[name]
    n = len(time)
    if n == 1:
        return
    buckets = np.unique(np.linspace(0, n - 1, _SPANS + 1).astype(int))
    marked = np.logical_or.reduceat(flags[:-1], buckets[:-1]).astype(int)
    edges = time[buckets[np.flatnonzero(np.diff(marked, prepend=0, append=0))]]
    spans = list(zip(edges[::2], edges[1::2] - edges[::2], strict=True))
    axes.broken_barh(spans, (low, _STRIP_HEIGHT), transform=axes.get_xaxis_transform(), color=colour, linewidth=0.5)


def _bounds(axes: Axes, bounds: Sequence[float], view: _View) -> None:
    for bound in filter(view.holds, bounds):
        axes.axhline(bound, **_LIMIT)


def _unseen(bounds: Sequence[float], view: _View, text: str) -> str:
    """A remark on limits that are too far away to be drawn."""
    return f" ({text})" if bounds and not any(map(view.holds, bounds)) else ""


def _view(values: FloatArray, least: float, bounds: Sequence[float] = (), top: float = 0.06) -> _View:
    """Axis limits that fit values and nearby bounds, at least `least` apart, with some margin."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    span = max(high - low, least, _LEAST * abs(low), _LEAST * abs(high))
    low, high = (low + high - span) / 2, (low + high + span) / 2
    # distant bounds would flatten the lines
    near = [bound for bound in bounds if low - 2 * span <= bound <= high + 2 * span]
    low, high = min([low, *near]), max([high, *near])
    return _View(low - 0.06 * (high - low), high + top * (high - low))


def _shown(values: FloatArray, scale: float = 1.0) -> FloatArray:
    """Values times a scale; those too large for an axis become gaps."""
    shown: FloatArray = scale * np.where(np.abs(values) <= _LARGEST, values, np.nan)
    return shown


def _names(curves: int) -> dict[str, dict[str, Any]]:
    return dict(list({"actual": _ACTUAL, "reference": _REFERENCE}.items())[:curves])


def _legend(figure: Figure, styles: dict[str, dict[str, Any]], patches: Sequence[Artist] = ()) -> None:
    handles: list[Artist] = [Line2D([], [], label=name, **style) for name, style in styles.items()]
    handles += patches
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), handlelength=3.2, borderaxespad=0.2)

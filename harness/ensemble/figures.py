"""Figures of an ensemble: bands over time, histograms, dependence of a metric on its inputs, sensitivity."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import polars
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from gough_stewart.harness.ensemble.columns import OUTCOME
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.ensemble.statistics import counted, left_out
from gough_stewart.harness.ensemble.tables import shown_input, shown_signal, usual_metrics
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.harness.output.plotting import entitle, png
from gough_stewart.harness.results.bands import MOST_MEMBERS, QUANTILES
from gough_stewart.harness.results.metric import Shown
from gough_stewart.harness.results.metric_folds import shown_metric
from gough_stewart.model.vectors import FloatArray

_WIDTH, _ROW = 8.0, 1.9  # [inch]
_COLUMNS = 3
_MOST_PANELS = 12
_MOST_BANDS = 15
_MOST_POINTS = 3000
_MOST_BARS = 12
# Smaller spans are rounding, or too small to measure.
_LEAST_SPAN = {"m": 1e-5, "mm": 1e-2, "rad": 1e-5, "deg": 1e-3, "N": 1.0, "m/s": 1e-4, "rad/s": 1e-4}


def ensemble_figures(ensemble: Ensemble, by: str, found: Sensitivity | None = None) -> dict[str, bytes]:
    """Draw `bands`, `histograms`, `dependence` on the varied quantities, and `sensitivity` as PNG, by file name.

    The same ensemble gives the same bytes. SVG would double the time, and the page has zoom.

    Parameters
    ----------
    by
        The metric of `dependence`.
    found
        The sensitivity to draw; None for no such figure.
    """
    files = {}
    columns = list(dict.fromkeys(ensemble.bands["signal"].to_list()))
    if columns:
        files.update(_grid("bands", partial(_bands, ensemble, columns), min(len(columns), _MOST_BANDS)))
    names = usual_metrics(ensemble.members)
    if names:
        files.update(_grid("histograms", partial(_histograms, ensemble, names), min(len(names), _MOST_PANELS)))
    inputs = _inputs(ensemble, found)
    if inputs:
        files.update(_grid("dependence", partial(_dependence, ensemble, by, inputs), min(len(inputs), _MOST_PANELS)))
    if found is not None:
        bars = min(len(found.inputs), _MOST_BARS)
        files["sensitivity.png"] = png(partial(_sensitivity, found), _WIDTH * 0.8, 1.3 + 0.28 * bars)
    return files


def _grid(name: str, draw: Callable[[Figure], None], panels: int) -> dict[str, bytes]:
    rows = -(-panels // _COLUMNS)
    return {f"{name}.png": png(draw, _WIDTH, 0.6 + _ROW * rows)}


def _panels(figure: Figure, title: str, number: int) -> list[Axes]:
    entitle(figure, title)
    # automatic placement of panels would take half of the time
    figure.set_layout_engine("none")
    rows, columns = -(-number // _COLUMNS), min(number, _COLUMNS)
    width, height = figure.get_size_inches()
    place = {
        "left": 0.62 / width,
        "right": 1 - 0.15 / width,
        "bottom": 0.45 / height,
        "top": 1 - 0.58 / height,
        "wspace": 0.3,
        "hspace": 0.45,
    }
    grid = figure.subplots(rows, columns, squeeze=False, gridspec_kw=place)
    for axes in grid.flat[number:]:
        axes.set_axis_off()
    return list(grid.flat[:number])


def _bands(ensemble: Ensemble, columns: list[str], figure: Figure) -> None:
    members = ensemble.members.height
    some = f" of the first {MOST_MEMBERS}" if members > MOST_MEMBERS else ""
    title = f"{ensemble.title}: {members} members; median, 25 to 75 %, 5 to 95 %{some}, extremes"
    title += _some(_MOST_BANDS, len(columns), "signals")
    columns = columns[:_MOST_BANDS]
    for k, (axes, column) in enumerate(zip(_panels(figure, title, len(columns)), columns, strict=True)):
        part = ensemble.bands.filter(polars.col("signal") == column)
        shown, time = shown_signal(column), part["time"].to_numpy()
        low, quarter, half, threequarters, high = (_scaled(part, name, shown) for name in QUANTILES)
        axes.fill_between(time, low, high, color=COLOURS[0], alpha=0.22, linewidth=0)
        axes.fill_between(time, quarter, threequarters, color=COLOURS[0], alpha=0.35, linewidth=0)
        for name in ("lowest", "highest"):
            axes.plot(time, _scaled(part, name, shown), color="#777777", linewidth=0.7)
        axes.plot(time, half, color=COLOURS[0], linewidth=1.4)
        _entitle(axes, shown)
        axes.margins(x=0)
        _show_at_least(axes, _LEAST_SPAN.get(shown.unit, 0.0))
        if k + _COLUMNS >= len(columns):
            axes.set_xlabel("time [s]")


def _histograms(ensemble: Ensemble, names: list[str], figure: Figure) -> None:
    without = left_out(ensemble.members)
    which = f"the members that completed ({without} did not)" if without else f"{ensemble.members.height} members"
    title = f"{ensemble.title}: metrics of {which}; 5, 50, 95 % dashed"
    title += _some(_MOST_PANELS, len(names), "metrics")
    names = names[:_MOST_PANELS]
    for axes, name in zip(_panels(figure, title, len(names)), names, strict=True):
        shown = shown_metric(name)
        values = shown.factor * counted(ensemble.members, name)
        inside = _within(values)
        counts, edges = np.histogram(inside, bins=min(40, max(8, int(np.sqrt(len(values))))))
        axes.stairs(counts, edges, fill=True, color=COLOURS[4])
        for quantile in np.quantile(values, (0.05, 0.5, 0.95)):
            axes.axvline(quantile, color="black", linewidth=0.9, linestyle=(0, (4, 3)))
        _entitle(axes, shown)
        axes.grid(visible=False, axis="x")
        if len(inside) < len(values):
            _note(axes, f"{len(values) - len(inside)} outside; {values.min():.3g} to {values.max():.3g} in all")


def _dependence(ensemble: Ensemble, by: str, inputs: list[str], figure: Figure) -> None:
    shown = shown_metric(by)
    unit = f" [{shown.unit}]" if shown.unit else ""
    merit = shown.factor * ensemble.values(by)
    completed = (ensemble.members[OUTCOME] == "completed").to_numpy()
    some = slice(0, _MOST_POINTS)
    title = f"{ensemble.title}: {shown.text}{unit} against what varies"
    title += _some(_MOST_POINTS, len(merit), "members") + _some(_MOST_PANELS, len(inputs), "inputs")
    inputs = inputs[:_MOST_PANELS]
    panels = _panels(figure, title, len(inputs))
    for axes, name in zip(panels, inputs, strict=True):
        x = ensemble.values(name)
        for which, colour, label in ((completed, COLOURS[0], "completed"), (~completed, COLOURS[1], "ended early")):
            axes.plot(x[some][which[some]], merit[some][which[some]], ".", color=colour, markersize=2.5, label=label)
        _entitle(axes, shown_input(name))
        axes.xaxis.set_major_locator(MaxNLocator(4))
        if np.isfinite(merit).any():
            low, high = np.nanquantile(merit, (0.0, 0.999))
            low, high = low - 0.05 * (high - low or 1), high + 0.1 * (high - low or 1)
            axes.set_ylim(low, high)
            if above := np.count_nonzero(merit[some] > high):
                _note(axes, f"{above} above; the largest: {np.nanmax(merit[some]):.3g}")
    if not completed.all():
        panels[0].legend(loc="upper left", markerscale=3, handletextpad=0.2, fontsize=8)


def _sensitivity(found: Sensitivity, figure: Figure) -> None:
    shown = shown_metric(found.metric)
    entitle(figure, f"What makes the {shown.text} vary")
    axes: Axes = figure.subplots()
    order = found.order[:_MOST_BARS][::-1]
    at = np.arange(len(order), dtype=float)
    style: dict[str, Any] = {"error_kw": {"elinewidth": 1, "capsize": 2}}
    if found.total is None or found.total_confidence is None:
        axes.barh(at, found.main[order], 0.6, xerr=found.main_confidence[order], color=COLOURS[0], **style)
        axes.set_xlabel("standardised regression coefficient β")
    else:
        axes.barh(
            at - 0.19,
            found.total[order],
            0.36,
            xerr=found.total_confidence[order],
            color=COLOURS[4],
            label="in total",
            **style,
        )
        axes.barh(
            at + 0.19,
            found.main[order],
            0.36,
            xerr=found.main_confidence[order],
            color=COLOURS[0],
            label="alone",
            **style,
        )
        axes.set_xlabel("share of the variance (Sobol' index)")
        axes.legend(loc="lower right")
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(at, [found.inputs[k] for k in order])
    axes.grid(visible=False, axis="y")
    axes.set_title(found.remark.partition("; whiskers")[0], fontsize=8.5)


def _inputs(ensemble: Ensemble, found: Sensitivity | None) -> list[str]:
    """Varied quantities that are numbers, most influential first."""
    names = [name for name in ensemble.varied if np.isfinite(ensemble.values(name)).any()]
    if found is None or found.method == "sobol":
        return names
    first = [found.inputs[k] for k in found.order]
    return [*first, *(name for name in names if name not in first)]


def _scaled(part: polars.DataFrame, name: str, shown: Shown) -> FloatArray:
    return np.asarray(shown.factor * part[name].fill_null(np.nan).to_numpy())


def _some(most: int, number: int, what: str) -> str:
    """The end of a title that shows only the first of them."""
    return f"; {most} of {number} {what}" if number > most else ""


def _note(axes: Axes, text: str) -> None:
    """What the axes do not show, in a corner."""
    axes.text(0.98, 0.95, text, transform=axes.transAxes, ha="right", va="top", fontsize=7)


def _within(values: FloatArray) -> FloatArray:
    """The values without the few outliers that would hide all others."""
    low, high = np.quantile(values, (0.005, 0.995))
    width = high - low
    return np.asarray(values[(values >= low - 2 * width) & (values <= high + 2 * width)]) if width > 0 else values


def _show_at_least(axes: Axes, span: float) -> None:
    """Widen the vertical axis about its middle to at least a span."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = (low + high) / 2
        axes.set_ylim(middle - span / 2, middle + span / 2)


def _entitle(axes: Axes, shown: Shown) -> None:
    axes.set_title(f"{shown.text} [{shown.unit}]" if shown.unit else shown.text, fontsize=8.5, y=1.0)
    axes.tick_params(labelsize=7.5)
    axes.yaxis.get_offset_text().set(x=-0.2, fontsize=7)  # beside the title, not over it

"""The charts of an ensemble: distributions, bands over time, dependence on what varies, sensitivity."""

from dataclasses import replace
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble.data import (
    ENDED,
    MEMBER,
    OUTCOME,
    EnsembleData,
    counted,
    finite,
    left_out,
    named_signal,
    quantity_of_input,
    usual_metrics,
)
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Samples, Series, time_axis
from gough_stewart.harness.report.document import Part, Report, Section
from gough_stewart.harness.report.quantities import NUMBER
from gough_stewart.harness.report.words import counted as count
from gough_stewart.harness.results.bands import MOST_MEMBERS, QUANTILES
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.vectors import FloatArray

# The groups of charts.
FIGURES = ("distribution", "bands", "dependence", "sensitivity")
_MOST_BARS, _BINS = 15, 40
# Inputs that have a chart at first.
_MOST_FIRST = 4


def ensemble_charts(ensemble: EnsembleData, by: str, known: Sensitivity | None) -> list[Section]:
    """Distributions, bands over time, dependence on what varies, and sensitivity."""
    names = [by, *(name for name in usual_metrics(ensemble.members) if name != by)]
    histograms = [_histogram(ensemble, name) for name in names if len(counted(ensemble.members, name)) > 1]
    sections = [Section("Distribution", tuple(histograms))] if histograms else []
    signals = list(dict.fromkeys(ensemble.bands["signal"].to_list()))
    signals.sort(key=lambda name: not name.startswith("error."))
    if signals:
        sections.append(Section("Over time", tuple(_band(ensemble, name) for name in signals)))
    inputs = [known.inputs[k] for k in known.order] if known is not None else list(ensemble.varied)
    shown = [name for name in inputs if name in ensemble.varied and len(finite(ensemble.values(name)))][:_MOST_BARS]
    if shown:
        charts = [replace(_dependence(ensemble, by, name), detail=k >= _MOST_FIRST) for k, name in enumerate(shown)]
        sections.append(Section("Dependence", tuple(charts)))
    if known is not None:
        sections.append(Section("Sensitivity", (_bars(known),)))
    return sections


def _histogram(ensemble: EnsembleData, name: str) -> Chart:
    metric, values = metric_of(name), counted(ensemble.members, name)
    # without the few that would hide how all others are distributed
    low, high = np.quantile(values, (0.005, 0.995))
    width = high - low
    inside = values[(values >= low - 2 * width) & (values <= high + 2 * width)] if width > 0 else values
    low, high = float(inside.min()), float(inside.max())
    ends = (low, high) if high > low else (low - 0.5, high + 0.5)
    counts, edges = np.histogram(inside, min(_BINS, max(5, int(np.sqrt(len(values))) + 1)), ends)
    note = ""
    if outside := len(values) - len(inside):
        ends_of_all = metric.quantity.telling(float(values.max())).range_text(values.min(), values.max())
        note = f"{metric.text}: {count(outside, 'member')} outside, {ends_of_all} in all."
    levels = (0.05, 0.5, 0.95)
    at = np.quantile(values, levels).tolist()
    marks = tuple(Mark(x, f"{100 * level:g} %", "vertical", "median") for x, level in zip(at, levels, strict=True))
    series = Series("members", NUMBER, counts, "neutral")
    axis = Axis(metric.text, metric.quantity, edges)
    return Chart(metric.text, axis, (series,), "histogram", y=Axis("members"), marks=marks, note=note,
                 group="distribution")  # fmt: skip


def _band(ensemble: EnsembleData, name: str) -> Chart:
    part, (words, quantity) = ensemble.bands.filter(polars.col("signal") == name), named_signal(name)
    values = {level: part[level].fill_null(np.nan).to_numpy() for level in ("lowest", *QUANTILES, "highest")}
    series = (
        Series("lowest to highest", quantity, values["q50"], "band", low=values["lowest"], high=values["highest"]),
        Series("5 to 95 %", quantity, values["q50"], "band", low=values["q05"], high=values["q95"]),
        Series("25 to 75 %", quantity, values["q50"], "band", low=values["q25"], high=values["q75"]),
        Series("median", quantity, values["q50"], "median"),
    )
    is_large = ensemble.members.height > MOST_MEMBERS
    of_first = f" Quantiles are of the first {MOST_MEMBERS:,} members." if is_large else ""
    # of others, each time has fewer members than the first
    ends_early = left_out(ensemble.members) or ensemble.members[ENDED].n_unique() > 1
    note = f"{'Of the members still running.' if ends_early else ''}{of_first}".strip()
    time, samples = time_axis(part["time"].to_numpy()), _samples(ensemble.samples, name, ensemble.members.height)
    return Chart(words, time, series, y=Axis(words, quantity), note=note, group="bands", samples=samples)


def _samples(frame: polars.DataFrame | None, name: str, total: int) -> Samples | None:
    """The signal of the first members, from which the page draws the bands of those that are marked."""
    if frame is None or name not in frame.columns or not frame.height:
        return None
    members = frame[MEMBER].unique(maintain_order=True).to_numpy()
    values = frame[name].fill_null(np.nan).to_numpy().reshape(len(members), -1)
    return Samples(members, frame["time"].to_numpy()[: values.shape[1]], values, total)


def with_samples(report: Report, frame: polars.DataFrame) -> Report:
    """A report that was read back, with the samples of its members, which its data leave out."""
    members = max((len(number.members) for number in report.numbers if number.members is not None), default=0)
    names = {named_signal(name)[0]: name for name in frame.columns if name not in (MEMBER, "time")}

    def filled(part: Part) -> Part:
        if not isinstance(part, Chart) or part.group != "bands" or part.title not in names:
            return part
        return replace(part, samples=_samples(frame, names[part.title], members))

    sections = tuple(replace(section, parts=tuple(map(filled, section.parts))) for section in report.sections)
    return replace(report, sections=sections)


def _dependence(ensemble: EnsembleData, by: str, name: str) -> Chart:
    metric = metric_of(by)
    completed = (ensemble.members[OUTCOME] == "completed").to_numpy()
    x, y = ensemble.values(name), np.where(completed, ensemble.values(by), np.nan)
    series = Series("members", metric.quantity, y, "actual", members=ensemble.members[MEMBER].to_numpy().astype(float))
    axes = Axis(name, quantity_of_input(name), x), Axis(metric.text, metric.quantity)
    return Chart(f"{metric.text} by {name}", axes[0], (series,), "points", y=axes[1], group="dependence")


def _bars(known: Sensitivity) -> Chart:
    order = known.order[:_MOST_BARS]
    parts: list[tuple[str, FloatArray, FloatArray, Any]] = [
        ("alone" if known.total is not None else "β", known.main, known.main_confidence, "actual")
    ]
    if known.total is not None and known.total_confidence is not None:
        parts.append(("in total", known.total, known.total_confidence, "neutral"))
    series = tuple(
        Series(name, NUMBER, values[order], role, low=(values - half)[order], high=(values + half)[order])
        for name, values, half, role in parts
    )
    measure = "share of the variance" if known.total is not None else "standardised regression coefficient β"
    title = f"what makes the {metric_of(known.metric).text} vary"
    return Chart(title, Axis("input", labels=tuple(known.inputs[k] for k in order)), series, "bars", y=Axis(measure),
                 note=known.remark, group="sensitivity")  # fmt: skip

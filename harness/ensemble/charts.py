"""The charts of an ensemble: distributions, bands over time, dependence on what varies, sensitivity."""

from dataclasses import replace

import numpy as np
import polars

from gough_stewart.harness.ensemble.member_table import MemberTable, quantity_of_input
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Samples, Series, time_axis
from gough_stewart.harness.report.document import Report, Section
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import NUMBER, Quantity, of_unit
from gough_stewart.harness.report.quantities import counted as count
from gough_stewart.harness.results.bands import MOST_MEMBERS, QUANTILES
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import BY_NAME

# The groups of charts.
FIGURES = ("distribution", "bands", "dependence", "sensitivity")
_MOST_BARS, _BINS = 15, 40
# Inputs that have a chart at first.
_MOST_FIRST = 4
# The displayed units of errors.
_OF_ERRORS = {"m": "mm", "rad": "deg"}
_AXES = {"position": "xyz", "orientation": ("roll", "pitch", "yaw")}


def named_signal(column: str) -> tuple[str, Quantity]:
    """A signal of bands, `position[3]` or `error.position.norm`, in words, and how it is written."""
    is_error, is_norm = column.startswith("error."), column.endswith(".norm")
    name, _, rest = column.removeprefix("error.").removesuffix(".norm").partition("[")
    unit, words = BY_NAME[name].unit, name.replace("_", " ")
    if rest:
        k = int(rest.removesuffix("]")) - 1
        words = str(_AXES[name][k]) if name in _AXES else f"{words} {k + 1}"
    if not is_error:
        return words, of_unit(unit)
    return f"error of {words}" + (", norm" if is_norm else ""), of_unit(_OF_ERRORS.get(unit, unit))


def ensemble_charts(ensemble: MemberTable, by: str, sensitivity: Sensitivity | None) -> list[Section]:
    """Distributions, bands over time, dependence on what varies, and sensitivity; those that have something to show."""
    names = [by, *(name for name in ensemble.usual_metrics if name != by)]
    signals = list(dict.fromkeys(ensemble.bands["signal"].to_list()))
    signals.sort(key=lambda name: not name.startswith("error."))
    inputs = [sensitivity.inputs[k] for k in sensitivity.order] if sensitivity is not None else list(ensemble.varied)
    shown = [name for name in inputs if name in ensemble.varied and np.isfinite(ensemble.values(name)).any()]
    metric, y = metric_of(by), np.where(ensemble.is_complete, ensemble.values(by), np.nan)
    series = Series("members", metric.quantity, y, "actual", members=ensemble.numbers("member"))
    dependence = [
        Chart(
            f"{metric.text} by {name}",
            Axis(name, quantity_of_input(name), ensemble.values(name)),
            (series,),
            "points",
            y=Axis(metric.text, metric.quantity),
            group="dependence",
            detail=k >= _MOST_FIRST,
        )
        for k, name in enumerate(shown[:_MOST_BARS])
    ]
    bars = []
    if sensitivity is not None:
        order, is_sobol = sensitivity.order[:_MOST_BARS], sensitivity.method == "sobol"
        roles: tuple[tuple[str, Role], ...] = (("alone" if is_sobol else "β", "actual"), ("in total", "neutral"))
        effects = tuple(
            Series(name, NUMBER, values[order], role, low=(values - half)[order], high=(values + half)[order])
            for (name, role), (values, half) in zip(roles, sensitivity.effects, strict=False)
        )
        measure = "share of the variance" if is_sobol else "standardised regression coefficient β"
        labels = Axis("input", labels=tuple(sensitivity.inputs[k] for k in order))
        title = f"what makes the {metric.text} vary"
        bars = [Chart(title, labels, effects, "bars", y=Axis(measure), note=sensitivity.remark, group="sensitivity")]
    charts = {
        "Distribution": [_histogram(ensemble, name) for name in names if len(ensemble.counted(name)) > 1],
        "Over time": [_band(ensemble, name) for name in signals],
        "Dependence": dependence,
        "Sensitivity": bars,
    }
    return [Section(title, tuple(parts)) for title, parts in charts.items() if parts]


def _histogram(ensemble: MemberTable, name: str) -> Chart:
    metric, values = metric_of(name), ensemble.counted(name)
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
    marks = tuple(
        Mark(float(np.quantile(values, level)), f"{100 * level:g} %", "vertical", "median")
        for level in (0.05, 0.5, 0.95)
    )
    series = Series("members", NUMBER, counts, "neutral")
    axis = Axis(metric.text, metric.quantity, edges)
    return Chart(metric.text, axis, (series,), "histogram", y=Axis("members"), marks=marks, note=note,
                 group="distribution")  # fmt: skip


def _band(ensemble: MemberTable, name: str) -> Chart:
    part, (words, quantity) = ensemble.bands.filter(polars.col("signal") == name), named_signal(name)
    values = {level: part[level].fill_null(np.nan).to_numpy() for level in ("lowest", *QUANTILES, "highest")}
    bands = (("lowest to highest", "lowest", "highest"), ("5 to 95 %", "q05", "q95"), ("25 to 75 %", "q25", "q75"))
    series = (
        *(Series(title, quantity, values["q50"], "band", low=values[a], high=values[b]) for title, a, b in bands),
        Series("median", quantity, values["q50"], "median"),
    )
    is_large = ensemble.members.height > MOST_MEMBERS
    of_first = f" Quantiles are of the first {MOST_MEMBERS:,} members." if is_large else ""
    # of others, each time has fewer members than the first
    ends_early = not ensemble.is_complete.all() or ensemble.members["ended"].n_unique() > 1
    note = f"{'Of the members still running.' if ends_early else ''}{of_first}".strip()
    time, samples = time_axis(part["time"].to_numpy()), _samples(ensemble.samples, name, ensemble.members.height)
    return Chart(words, time, series, y=Axis(words, quantity), note=note, group="bands", samples=samples)


def _samples(frame: polars.DataFrame | None, name: str, total: int) -> Samples | None:
    """The signal of the first members, from which the page draws the bands of those that are marked."""
    if frame is None or name not in frame.columns or not frame.height:
        return None
    members = frame["member"].unique(maintain_order=True).to_numpy()
    values = frame[name].fill_null(np.nan).to_numpy().reshape(len(members), -1)
    return Samples(members, frame["time"].to_numpy()[: values.shape[1]], values, total)


def with_samples(report: Report, frame: polars.DataFrame) -> Report:
    """A report that was read back, with the samples of its members, which its data leave out."""
    members = max((len(number.members) for number in report.numbers if number.members is not None), default=0)
    names = {named_signal(name)[0]: name for name in frame.columns if name not in ("member", "time")}

    sections = list[Section]()
    for section in report.sections:
        parts = list(section.parts)
        for k, part in enumerate(parts):
            if isinstance(part, Chart) and part.group == "bands" and part.title in names:
                parts[k] = replace(part, samples=_samples(frame, names[part.title], members))
        sections.append(replace(section, parts=tuple(parts)))
    return replace(report, sections=tuple(sections))

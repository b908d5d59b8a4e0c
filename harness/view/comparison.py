"""Several runs side by side, as a report: what differs between their files, their metrics, and their differences."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gough_stewart.harness.experiment.overrides import value_text
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Note, Number, Report, Section, Setting, Verdict
from gough_stewart.harness.report.quantities import LENGTH, Quantity
from gough_stewart.harness.report.small_machine import fine, fineness_of
from gough_stewart.harness.report.table import Cell, Column, Table
from gough_stewart.harness.report.words import at_most, listed
from gough_stewart.harness.results.metric_folds import METRICS, metric_of
from gough_stewart.harness.results.metrics import flattened, metrics, metrics_tables
from gough_stewart.harness.results.oscillation import is_sound, outcome_text
from gough_stewart.harness.results.record import Record, platform_of
from gough_stewart.harness.results.run_charts import DrawnRun, run_charts, scenes
from gough_stewart.harness.results.run_report import parameters_table, run_table, versions_table
from gough_stewart.model.vectors import FloatArray

_BEST = "★ "
_PEAK = "tracking.position.norm_peak"
# Times of two clocks closer than this are the same, computed differently [s].
_SAME_TIME = 1e-9
# Letters of values that stand beside a key in a sentence.
_SHORT = 40


def comparison_report(records: Sequence[Record], shown: Sequence[DrawnRun], title: str) -> Report:
    """The report of several runs; charts show the runs over each other, and each run minus the first."""
    names, found = tuple(each.name for each in shown), [metrics(record) for record in records]
    first, others = run_charts(shown)
    fineness = min(fineness_of(each.machine) for each in shown)
    sections = [
        Section("Motion", tuple(scenes(shown))),
        Section("Metrics side by side", (side_by_side(records, found, names, fineness),)),
        first,
        Section(f"Differences from {names[0]}", tuple(differences(first, names))),
        others,
    ]
    for record, each, measured in zip(records, shown, found, strict=True):
        believed = platform_of(record)
        tables = (*metrics_tables(measured), run_table(record, believed), parameters_table(each.machine, believed))
        sections.append(Section(f"{each.name}: all metrics, run, parameters", (*tables, versions_table(record)), True))
    return fine(
        Report(
            title,
            _verdict(records, found, names, fine(LENGTH, fineness)),
            tuple(each for each in sections if each.parts),
            study="compare",
            lead=differ_in(differing_settings(records)),
            settings=differing_settings(records),
            runs=names,
            notes=tuple(
                Note(f"{name}: {outcome_text(each['outcome'])}", "warning")
                for name, each in zip(names, found, strict=True)
                if not is_sound(each["outcome"])
            ),
        ),
        fineness,
    )


def differ_in(settings: Sequence[Setting], most: int = 4) -> str:
    """The keys in which the runs differ, with their values, but for names; "" if there is none."""
    own = [each for each in settings if each.key not in ("title", "description")]
    values = [", ".join(each.values) for each in own[:most]]
    told = [each.key + (f" ({text})" if len(text) <= _SHORT else "") for each, text in zip(own, values, strict=False)]
    more = [f"{len(own) - most} more"] if len(own) > most else []
    return f"They differ in {listed([*told, *more])}" if told else ""


def _verdict(
    records: Sequence[Record], found: Sequence[Mapping[str, Any]], names: Sequence[str], length: Quantity
) -> Verdict:
    """Which run follows best, if all had the same task and completed it."""
    peaks = [((each["tracking"] or {}).get("position") or {}).get("norm_peak") for each in found]
    numbers = tuple(
        Number("", f"position error, peak: {name}", peak, LENGTH)
        for name, peak in zip(names, peaks, strict=True)
        if peak is not None
    )
    if not all(is_sound(each["outcome"]) for each in found):
        ended = [name for name, each in zip(names, found, strict=True) if not is_sound(each["outcome"])]
        return Verdict(f"{listed(ended)} did not end well; the others are side by side below", "marginal", numbers)
    if not has_same_task(records):
        return Verdict("The runs have different references or durations, so that none is best", "told", numbers)
    top = best(_PEAK, peaks, length)
    if not top:
        return Verdict(f"{listed(names)} follow equally well", "told", numbers)
    known = {k: peak for k, peak in enumerate(peaks) if peak is not None}
    last = max(known, key=lambda k: known[k])
    leaders = listed([names[k] for k in sorted(top)])
    follow = "follows" if len(top) == 1 else "follow"
    return Verdict(
        f"{leaders} {follow} best, within {at_most(length, known[min(top)])}; {names[last]} within "
        f"{at_most(length, known[last])}",
        "told",
        numbers,
    )


def side_by_side(
    records: Sequence[Record], found: Sequence[Mapping[str, Any]], names: Sequence[str], fineness: float = 1.0
) -> Table:
    """The metrics of the runs, one column each.

    The best values of a row are marked if all runs have the same reference and duration, all completed, and no loop
    oscillates or grows by itself.
    """
    flat = [flattened(each) for each in found]
    paths = dict.fromkeys(path for each in flat for path in each)
    marks = has_same_task(records) and all(is_sound(each["outcome"]) for each in found)
    rows: list[tuple[Cell, ...]] = [("outcome", *(outcome_text(each["outcome"]) for each in found))]
    for path in (metric.path for metric in METRICS if metric.is_compared and metric.path in paths):
        quantity = replace(fine(metric_of(path).quantity, fineness), digits=4)
        rows.append(_row(path, [each.get(path) for each in flat], quantity, marks=marks))
    note = f"{_BEST.strip()} is the best of its row." if marks else ""
    return Table("", (Column(""), *map(Column, names)), tuple(rows), note=note)


def _row(path: str, values: Sequence[float | None], quantity: Quantity, *, marks: bool) -> tuple[Cell, ...]:
    tops = best(path, values, quantity) if marks else set()
    return (
        quantity.headed(metric_of(path).text),
        *(f"{_BEST if k in tops else ''}{quantity.number(value)}" for k, value in enumerate(values)),
    )


def best(path: str, values: Sequence[float | None], quantity: Quantity) -> set[int]:
    """Indices of the best values of a metric, as displayed; none if all are equal or the metric is not ranked."""
    better = metric_of(path).better
    sign = 1.0 if better == "larger" else -1.0
    known = {k: abs(value) if sign < 0 else value for k, value in enumerate(values) if value is not None}
    if better is None or len(known) < 2:
        return set()
    most = max(sign * value for value in known.values())
    texts = {k: quantity.number(value) for k, value in known.items()}
    top = {texts[k] for k, value in known.items() if sign * value == most}
    found = {k for k, text in texts.items() if text in top}
    return found if len(found) < len(known) else set()


def has_same_task(records: Sequence[Record]) -> bool:
    """Whether all runs had the same reference for the same time."""
    first = records[0].metadata
    return all(
        each.metadata.get("duration") == first.get("duration")
        and (each.metadata.get("experiment") or {}).get("reference") == (first.get("experiment") or {}).get("reference")
        for each in records
    )


def differing_settings(records: Sequence[Record]) -> tuple[Setting, ...]:
    """The keys of the runs' files, and the parameters of their machines, that are not the same in all runs."""
    names = ("plant", "experiment")
    return differing(
        {**{name: each.metadata.get(name) for name in names}, "machine": each.metadata["platform"]} for each in records
    )


def differing(values: Iterable[Mapping[str, Any]]) -> tuple[Setting, ...]:
    """The keys, down to single values, that are not the same in all, with units; an experiment's as in its file."""
    files = [dict(_flat(each)) for each in values]
    keys = dict.fromkeys(key for each in files for key in each)
    rows = [
        (
            name := key.removeprefix("experiment."),
            [value_text(name, each[key]) if key in each else "–" for each in files],
        )
        for key in keys
    ]
    return tuple(Setting(key, tuple(each)) for key, each in rows if len(set(each)) > 1)


def _flat(value: Any, path: str = "") -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [pair for key, each in value.items() for pair in _flat(each, f"{path}.{key}" if path else str(key))]
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return [pair for k, each in enumerate(value) for pair in _flat(each, f"{path}[{k + 1}]")]
    return [] if value is None else [(path, value)]


def differences(section: Section, names: Sequence[str]) -> list[Chart]:
    """The charts of a section with every other run minus the first, component by component."""
    found = []
    for chart in section.parts:
        if not isinstance(chart, Chart):
            continue
        firsts = {(each.role, each.component): each for each in chart.series if each.run == 0}
        series = []
        for each in chart.series:
            first = firsts.get((each.role, each.component))
            if not each.run or first is None or each.role == "reference":
                continue
            times = (chart.x_of(first), chart.x_of(each))
            common, values = difference(times, (first.values, each.values), chart.kind == "step")
            if len(common):
                name = f"{names[each.run]}: {each.component}"
                series.append(replace(each, name=name, values=values, x=common, role="error"))
        if series:
            y = Axis("difference", series[0].quantity)
            found.append(Chart(f"{chart.title}, difference", _axis_of(chart, series), tuple(series), chart.kind, y))
    return found


def _axis_of(chart: Chart, series: Sequence[Series]) -> Axis:
    longest = max((each.x for each in series if each.x is not None), key=len)
    return replace(chart.x, values=longest)


def difference(
    time: tuple[FloatArray, FloatArray], values: tuple[FloatArray, FloatArray], holds: bool = False
) -> tuple[FloatArray, FloatArray]:
    """The second of two arrays (n,) and (m,) minus the first, at the times of both in their common span.

    Between rows, values are interpolated linearly, or held if `holds`. Without a common span there are no times.
    """
    if np.array_equal(*time):
        return time[0], values[1] - values[0]
    common = np.union1d(*time)
    # the last of those that are the same, at which both records have that row
    common = common[np.append(np.diff(common) > _SAME_TIME, True)]
    start, end = (pick(float(each[at]) for each in time) for pick, at in ((max, 0), (min, -1)))
    common = common[(common >= start) & (common <= end + _SAME_TIME)]
    first, second = (_at(common, each, held, holds) for each, held in zip(time, values, strict=True))
    return common, second - first


def _at(common: FloatArray, time: FloatArray, values: FloatArray, holds: bool) -> FloatArray:
    if holds:
        held: FloatArray = values[np.searchsorted(time, common, side="right") - 1]
        return held
    return np.interp(common, time, values)

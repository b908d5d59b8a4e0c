"""What a search found, as a report: the values, how much better they are, and whether that holds on fresh members."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from gough_stewart.harness.ensemble.data import DISK
from gough_stewart.harness.ensemble.report import number_of_members
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import NUMBER, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import counted, exactly, listed, percent, sentence
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.candidates import Evaluation
from gough_stewart.harness.tuning.search import Search
from gough_stewart.model.interface import unit_text
from gough_stewart.model.vectors import FloatArray

# A value so near to a bound, of the range, may be better beyond it.
_NEAR = 0.01
_KEPT: Role = "actual"
_BROKEN: Role = "bad"


class Found(Protocol):
    """What a search gives."""

    @property
    def title(self) -> str: ...
    @property
    def changed(self) -> Mapping[str, Mapping[str, Any]]: ...
    @property
    def values(self) -> dict[str, float | int]: ...
    @property
    def seen(self) -> Evaluation: ...
    @property
    def fresh(self) -> Evaluation | None: ...
    @property
    def before(self) -> Evaluation | None: ...
    @property
    def before_fresh(self) -> Evaluation | None: ...
    @property
    def search(self) -> Search: ...
    @property
    def members(self) -> int: ...
    @property
    def fresh_members(self) -> int: ...


def tuning_report(found: Found, statement: str, *, charts: bool = True) -> Report:
    """The report of a search."""
    sections = [Section("Values", (_values(found), _judged(found)))]
    if charts:
        sections.append(Section("Search", (_chart(found), *_landscape(found))))
    return Report(
        found.title,
        tuning_verdict(found),
        tuple(sections),
        study="tune",
        lead=f"{counted(len(found.search.tried), 'candidate')} tried",
        settings=settings_of(found.changed),
        numbers=_numbers(found),
        notes=(Note(statement),),
    )


def tuning_verdict(found: Found) -> Verdict:
    """From what to what the metric went, with which values; on fresh members if there are; what is near its bound."""
    goal = found.search.goal
    metric = metric_of(goal.metric)
    after, before = (found.fresh or found.seen), (found.before_fresh if found.fresh else found.before)
    of = (
        f", {percent(goal.quantile)} of {found.fresh_members} fresh members"
        if found.fresh and found.members > 1
        else ""
    )
    gain = ""
    if before is not None and np.isfinite(before.value) and before.value:
        change = (after.value - before.value) / abs(before.value)
        gain = f" ({percent(abs(change))} {'less' if change < 0 else 'more'})"
        was, now = (exactly(metric.quantity, each.value, 3) for each in (before, after))
        moved = f"{metric.text}{of}: from {was} to {now}{gain}"
    else:
        moved = f"{metric.text}{of}: {exactly(metric.quantity, after.value, 3)}"
    values = [f"{axis.key} {_text(found.values[axis.key], axis.unit)}" for axis in found.search.axes]
    near = [
        axis.key
        for axis in found.search.axes
        if min(found.values[axis.key] - axis.low, axis.high - found.values[axis.key]) <= _NEAR * (axis.high - axis.low)
    ]
    broken = [
        condition.text
        for condition, value in zip(goal.conditions, after.conditions, strict=True)
        if not condition.holds(value)
    ]
    parts: list[str | None] = [
        moved,
        f"with {listed(values)}",
        f"{listed(near)} at the end of {'its' if len(near) == 1 else 'their'} range, beyond which it may be better"
        if near
        else None,
        f"not held on fresh members: {listed(broken)}" if broken else None,
        "interrupted, and not tried on fresh members" if found.search.is_interrupted else None,
    ]
    was_allowed = before is not None and goal.violation(before) == 0
    if before is not None and not was_allowed:
        parts.insert(1, "the values before break a condition")
    is_better = not was_allowed or before is None or after.value < before.value
    status: Status = "bad" if broken or not is_better else "marginal" if near or found.search.is_interrupted else "good"
    fixed = 1 + (found.fresh is not None)
    return Verdict(sentence(parts), status, _numbers(found)[: fixed + len(found.search.axes)])


def _text(value: float, unit: str) -> str:
    return f"{value:.4g} {unit_text(unit)}".rstrip()


def _numbers(found: Found) -> tuple[Number, ...]:
    goal = found.search.goal
    metric = metric_of(goal.metric)
    made = [Number("value", f"{metric.text}, in the search", found.seen.value, metric.quantity)]
    if found.fresh is not None:
        made.append(Number("fresh", f"{metric.text}, on fresh members", found.fresh.value, metric.quantity))
    for axis in found.search.axes:
        quantity = of_unit(axis.unit) if axis.unit else NUMBER
        made.append(Number(f"values.{axis.key}", axis.key, float(found.values[axis.key]), quantity))
    for path, members in (found.fresh or found.seen).metrics.items():
        if path == DISK and np.isnan(members).all():
            continue  # the controller has no linear loop
        one = metric_of(path)
        made.append(
            number_of_members(path, members)
            if len(members) > 1
            else Number(path, one.text, float(members[0]), one.quantity, explanation=one.sentence)
        )
    return tuple(made)


def _values(found: Found) -> Table:
    """What was tuned, before and after, and its range."""
    rows: list[tuple[Cell, ...]] = []
    for axis in found.search.axes:
        quantity = replace(of_unit(axis.unit) if axis.unit else NUMBER, digits=5)
        ends = (axis.now, found.values[axis.key], axis.low, axis.high)
        rows.append((axis.key, *(Value(None if each is None else float(each), quantity) for each in ends)))
    return Table("Tuned", tuple(map(Column, ("", "was", "is", "from", "to"))), tuple(rows))


def _judged(found: Found) -> Table:
    """The metric and the conditions before and after, also on fresh members."""
    heads, over = ["was", "is"], found.members > 1
    evaluations = [found.before, found.seen]
    if found.fresh is not None:
        heads += ["was, fresh", "is, fresh"]
        evaluations += [found.before_fresh, found.fresh]
    goal = found.search.goal
    names = [goal.metric, *(condition.metric for condition in goal.conditions)]
    rows: list[tuple[Cell, ...]] = []
    for k, metric in enumerate(map(metric_of, names)):
        values = (None if each is None else (each.value, *each.conditions)[k] for each in evaluations)
        rows.append((metric.text, *(Value(each, metric.quantity) for each in values)))
    failed = "members that failed" if over else "runs that failed"
    rows.append((failed, *(None if each is None else each.failed for each in evaluations)))
    of = f", {percent(goal.quantile)} of {found.members} members" if over else ""
    return Table(f"Metric and conditions{of}", tuple(map(Column, ("", *heads))), tuple(rows))


def _landscape(found: Found) -> list[Chart]:
    """The metric of all candidates over each key: of those that meet all conditions, and of the others."""
    goal, tried = found.search.goal, found.search.tried
    metric = metric_of(goal.metric)
    values = np.array([each.value for each in tried])
    kept = np.isfinite(values) & np.array([goal.violation(each) == 0 for each in tried])
    seen = np.isfinite(values) & (values <= _most(values[kept]))
    note = f"{counted(above, 'candidate')} above the chart." if (above := int(np.count_nonzero(~seen))) else ""
    charts = []
    for k, axis in enumerate(found.search.axes):
        series = tuple(
            Series(name, metric.quantity, np.where(seen & which, values, np.nan), role)
            for name, which, role in (("meets all conditions", kept, _KEPT), ("breaks a condition", ~kept, _BROKEN))
            if (seen & which).any()
        )
        points = np.array([each.point[k] for each in tried], dtype=float)
        x = Axis(
            axis.key, of_unit(axis.unit) if axis.unit else NUMBER, points, scale="log" if axis.is_log else "linear"
        )
        y = Axis(metric.text, metric.quantity)
        if series:
            title = f"{metric.text} by {axis.key}"
            charts.append(Chart(title, x, series, "points", y=y, note=note, group="values"))
    return charts


def _most(values: FloatArray) -> float:
    """An upper end of the axis, so that a few large values do not hide the others."""
    if not len(values):
        return np.inf
    low, middle, high = np.quantile(values, (0, 0.5, 1))
    return float(min(high, middle + 4 * (middle - low))) if middle > low else float(high)


def _chart(found: Found) -> Chart:
    """The value of every candidate, and the best so far that meets all conditions."""
    goal, tried = found.search.goal, found.search.tried
    metric = metric_of(goal.metric)
    values = np.array([each.value if np.isfinite(each.value) else np.nan for each in tried])
    kept = np.array([each.value if goal.violation(each) == 0 else np.inf for each in tried])
    best = np.minimum.accumulate(kept)
    series = (
        Series("candidates", metric.quantity, values, "neutral"),
        Series("best so far", metric.quantity, np.where(np.isfinite(best), best, np.nan), "actual"),
    )
    axis = Axis("candidate", NUMBER, np.arange(1.0, len(tried) + 1))
    return Chart(f"{metric.text} of all candidates", axis, series, y=Axis(metric.text, metric.quantity), group="search")

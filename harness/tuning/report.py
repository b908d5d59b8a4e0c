"""What a search found, as a report: the values, how much better they are, and whether that holds on fresh members."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from gough_stewart.harness.output.tables import Sheet
from gough_stewart.harness.report.document import (
    Axis,
    Chart,
    Note,
    Number,
    Report,
    Section,
    Series,
    Status,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.quantities import NUMBER, of_unit
from gough_stewart.harness.report.sheets import table_of
from gough_stewart.harness.report.words import about, counted, listed, percent, sentence
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.candidates import Evaluation
from gough_stewart.harness.tuning.search import Search

# A value so near to a bound, of the range, may be better beyond it.
_NEAR = 0.01


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


def tuning_report(found: Found, tables: list[Sheet], statement: str, *, charts: bool = True) -> Report:
    """The report of a search."""
    sections = [Section("Values", tuple(map(table_of, tables)))]
    if charts:
        sections.append(Section("Search", (_chart(found),)))
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
        was, now = (about(metric.quantity, each.value, 3) for each in (before, after))
        moved = f"{metric.text}{of}: from {was} to {now}{gain}"
    else:
        moved = f"{metric.text}{of}: {about(metric.quantity, after.value, 3)}"
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
    is_better = before is None or after.value < before.value
    status: Status = "bad" if broken or not is_better else "marginal" if near or found.search.is_interrupted else "good"
    return Verdict(sentence(parts), status, _numbers(found)[:2])


def _text(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}".rstrip()


def _numbers(found: Found) -> tuple[Number, ...]:
    goal = found.search.goal
    metric = metric_of(goal.metric)
    made = [Number("value", f"{metric.text}, in the search", found.seen.value, metric.quantity)]
    if found.fresh is not None:
        made.append(Number("fresh", f"{metric.text}, on fresh members", found.fresh.value, metric.quantity))
    for axis in found.search.axes:
        quantity = of_unit(axis.unit) if axis.unit else NUMBER
        made.append(Number(f"values.{axis.key}", axis.key, float(found.values[axis.key]), quantity, limit=None))
    return tuple(made)


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

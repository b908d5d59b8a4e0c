"""The result of a search: values, how much better they are, and whether that holds on fresh members; its files."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble.data import DISK
from gough_stewart.harness.ensemble.report import number_of_members
from gough_stewart.harness.experiment.file import text_with_settings
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import NUMBER, Quantity, fine, fineness_of, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.report.versions import versions
from gough_stewart.harness.report.words import counted, exactly, listed, percent, sentence
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.goal import Evaluation
from gough_stewart.harness.tuning.search import Search
from gough_stewart.harness.tuning.space import SearchAxis
from gough_stewart.model.interface import unit_text
from gough_stewart.model.units import PLAIN
from gough_stewart.model.vectors import FloatArray

TUNED = "tuned.toml"
# A value so near to a bound, of the range, may be better beyond it.
_NEAR = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """The result of a search, from `tune`; displays tables and the statement on fresh members."""

    experiment: Experiment
    """The experiment with the values found."""
    values: dict[str, float | int]
    """Those values by key, in SI units, frequencies in Hz."""
    seen: Evaluation
    """Their evaluation on the members of the search."""
    fresh: Evaluation | None
    """Their evaluation on fresh members; None if nothing is random."""
    before: Evaluation | None
    """The evaluation of the original experiment on the members of the search."""
    before_fresh: Evaluation | None
    """The same on fresh members."""
    search: Search
    """All candidates tried."""
    members: int
    """Number of members that evaluated candidates."""
    fresh_members: int
    left_out: int
    """Number of impossible members that were left out."""
    integration_error: float
    """The largest error estimate of a plant step."""

    def report(self, *, charts: bool = True) -> Report:
        """From what to what the metric went, with which values, and whether that holds on fresh members.

        Returns
        -------
        Report
            Verdict, the values as numbers, tables, and with `charts` all candidates.
        """
        sections = [Section("Values", (_values(self), _judged(self)))]
        if charts:
            sections.append(Section("Search", (_history(self.search), *_landscape(self.search))))
        report = Report(
            self.title,
            _verdict(self),
            tuple(sections),
            study="tune",
            lead=f"{counted(len(self.search.tried), 'candidate')} tried",
            settings=settings_of(self.changed),
            numbers=_numbers(self),
            notes=(Note(statement(self)),),
        )
        return fine(report, fineness_of(platforms_of(self.experiment)[1]))

    def __repr__(self) -> str:
        return "\n".join([f"Tuning: {self.title}", text_of(self.report(charts=False))])

    def _repr_html_(self) -> str:
        return to_html(self.report(charts=False))

    @property
    def title(self) -> str:
        """Title of the experiment."""
        return self.experiment.title

    @property
    def changed(self) -> dict[str, dict[str, Any]]:
        """What was set of the experiment's file."""
        return self.experiment.changed

    @property
    def is_interrupted(self) -> bool:
        """Whether Ctrl-C ended the search."""
        return self.search.is_interrupted

    @property
    def candidates(self) -> polars.DataFrame:
        """All candidates: `generation`, a column for each key, `value`, the conditions, `failed`, `kept`."""
        goal, tried = self.search.goal, self.search.tried
        columns: dict[str, object] = {"generation": self.search.generation}
        columns |= {axis.key: [evaluation.point[k] for evaluation in tried] for k, axis in enumerate(self.search.axes)}
        columns["value"] = [evaluation.value for evaluation in tried]
        columns |= {c.metric: [evaluation.conditions[k] for evaluation in tried] for k, c in enumerate(goal.conditions)}
        columns["failed"] = [evaluation.failed for evaluation in tried]
        columns["kept"] = [goal.violation(evaluation) == 0 for evaluation in tried]
        return polars.DataFrame(columns, strict=False)


def statement(tuning: Tuning) -> str:
    """The value on the members of the search and on fresh members."""
    goal, metric = tuning.search.goal, metric_of(tuning.search.goal.metric)
    seen = f"{metric.text}: {exactly(metric.quantity, tuning.seen.value, 4)}"
    if tuning.fresh is None:
        why = "the search was interrupted" if tuning.is_interrupted else "nothing is random, so other runs are the same"
        return f"{seen} in the search; not evaluated again: {why}."
    broken = goal.broken(tuning.fresh)
    also = f" On these, {' and '.join(map(repr, broken))} does not hold." if broken else ""
    by = f"the {tuning.members} members" if tuning.members > 1 else "the one run"
    return (
        f"{seen} on {by} of the search; {100 * goal.quantile:g} % of {tuning.fresh_members} fresh members "
        f"have at most {exactly(metric.quantity, tuning.fresh.value, 4)}.{also}"
    )


def _verdict(tuning: Tuning) -> Verdict:
    """From what to what the metric went, with which values; on fresh members if there are; what is near its bound."""
    goal, axes, is_interrupted = tuning.search.goal, tuning.search.axes, tuning.is_interrupted
    metric = metric_of(goal.metric)
    before, after = (tuning.before, tuning.seen) if tuning.fresh is None else (tuning.before_fresh, tuning.fresh)
    share = f", {percent(goal.quantile)} of {tuning.fresh_members} fresh members"
    name = metric.text + (share if tuning.fresh is not None and tuning.members > 1 else "")
    moved = f"{name}: {exactly(metric.quantity, after.value, 3)}"
    if before is not None and np.isfinite(before.value) and before.value:
        change = (after.value - before.value) / abs(before.value)
        was, now = (exactly(metric.quantity, evaluation.value, 3) for evaluation in (before, after))
        moved = f"{name}: from {was} to {now} ({percent(abs(change))} {'less' if change < 0 else 'more'})"
    values = [f"{axis.key} {tuning.values[axis.key]:.4g} {unit_text(axis.unit)}".rstrip() for axis in axes]
    near = [
        axis.key
        for axis in axes
        if min(tuning.values[axis.key] - axis.low, axis.high - tuning.values[axis.key])
        <= _NEAR * (axis.high - axis.low)
    ]
    its, broken = "its" if len(near) == 1 else "their", goal.broken(after)
    was_allowed = before is not None and goal.violation(before) == 0
    parts = [
        moved,
        "the values before break a condition" if before is not None and not was_allowed else None,
        f"with {listed(values)}",
        f"{listed(near)} at the end of {its} range, beyond which it may be better" if near else None,
        f"not held on fresh members: {listed(broken)}" if broken else None,
        "interrupted, and not tried on fresh members" if is_interrupted else None,
    ]
    is_better = not was_allowed or before is None or after.value < before.value
    status: Status = "bad" if broken or not is_better else "marginal" if near or is_interrupted else "good"
    return Verdict(sentence(parts), status, _numbers(tuning)[: 1 + (tuning.fresh is not None) + len(axes)])


def _numbers(tuning: Tuning) -> tuple[Number, ...]:
    metric = metric_of(tuning.search.goal.metric)
    numbers = [Number("value", f"{metric.text}, in the search", tuning.seen.value, metric.quantity)]
    if tuning.fresh is not None:
        numbers.append(Number("fresh", f"{metric.text}, on fresh members", tuning.fresh.value, metric.quantity))
    numbers += [
        Number(f"values.{axis.key}", axis.key, float(tuning.values[axis.key]), _quantity(axis))
        for axis in tuning.search.axes
    ]
    for path, members in (tuning.fresh or tuning.seen).metrics.items():
        one = metric_of(path)
        if len(members) > 1 and not (path == DISK and np.isnan(members).all()):
            numbers.append(number_of_members(path, members))
        elif path != DISK or not np.isnan(members[0]):  # without a linear loop there is no disk margin
            numbers.append(Number(path, one.text, float(members[0]), one.quantity, explanation=one.sentence))
    return tuple(numbers)


def _quantity(axis: SearchAxis) -> Quantity:
    return of_unit(axis.unit) if axis.unit else NUMBER


def _values(tuning: Tuning) -> Table:
    """What was tuned, before and after, and its range."""
    rows: list[tuple[Cell, ...]] = []
    for axis in tuning.search.axes:
        quantity = replace(_quantity(axis), digits=5)
        ends = (axis.now, tuning.values[axis.key], axis.low, axis.high)
        rows.append((axis.key, *(Value(None if end is None else float(end), quantity) for end in ends)))
    return Table("Tuned", tuple(map(Column, ("", "was", "is", "from", "to"))), tuple(rows))


def _judged(tuning: Tuning) -> Table:
    """The metric and the conditions before and after, also on fresh members."""
    heads, goal, over = ["was", "is"], tuning.search.goal, tuning.members > 1
    evaluations = [tuning.before, tuning.seen]
    if tuning.fresh is not None:
        heads += ["was, fresh", "is, fresh"]
        evaluations += [tuning.before_fresh, tuning.fresh]
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate([goal.metric, *(condition.metric for condition in goal.conditions)]):
        metric = metric_of(name)
        values = (
            None if evaluation is None else (evaluation.value, *evaluation.conditions)[k] for evaluation in evaluations
        )
        rows.append((metric.text, *(Value(value, metric.quantity) for value in values)))
    failed = (None if evaluation is None else evaluation.failed for evaluation in evaluations)
    rows.append((f"{'members' if over else 'runs'} that failed", *failed))
    share = f", {percent(goal.quantile)} of {tuning.members} members" if over else ""
    return Table(f"Metric and conditions{share}", tuple(map(Column, ("", *heads))), tuple(rows))


def _history(search: Search) -> Chart:
    """The value of every candidate, and the best so far that meets all conditions."""
    metric, tried = metric_of(search.goal.metric), search.tried
    values = np.array([evaluation.value if np.isfinite(evaluation.value) else np.nan for evaluation in tried])
    best = np.minimum.accumulate(
        [evaluation.value if search.goal.violation(evaluation) == 0 else np.inf for evaluation in tried]
    )
    series = (
        Series("candidates", metric.quantity, values, "neutral"),
        Series("best so far", metric.quantity, np.where(np.isfinite(best), best, np.nan), "actual"),
    )
    axis = Axis("candidate", NUMBER, np.arange(1.0, len(tried) + 1))
    return Chart(f"{metric.text} of all candidates", axis, series, y=Axis(metric.text, metric.quantity), group="search")


def _landscape(search: Search) -> list[Chart]:
    """The metric of all candidates over each key: of those that meet all conditions, and of the others."""
    metric, tried = metric_of(search.goal.metric), search.tried
    values = np.array([evaluation.value for evaluation in tried])
    kept = np.isfinite(values) & np.array([search.goal.violation(evaluation) == 0 for evaluation in tried])
    shown = np.isfinite(values) & (values <= _most(values[kept]))
    above = int(np.count_nonzero(~shown))
    kinds: tuple[tuple[str, Any, Role], ...] = (
        ("meets all conditions", shown & kept, "actual"),
        ("breaks a condition", shown & ~kept, "bad"),
    )
    series = tuple(
        Series(name, metric.quantity, np.where(chosen, values, np.nan), role)
        for name, chosen, role in kinds
        if chosen.any()
    )
    return [
        Chart(
            f"{metric.text} by {axis.key}",
            Axis(
                axis.key,
                _quantity(axis),
                np.array([evaluation.point[k] for evaluation in tried], dtype=float),
                scale="log" if axis.is_log else "linear",
            ),
            series,
            "points",
            y=Axis(metric.text, metric.quantity),
            note=f"{counted(above, 'candidate')} above the chart." if above else "",
            group="values",
        )
        for k, axis in enumerate(search.axes)
        if series
    ]


def _most(values: FloatArray) -> float:
    """An upper end of the axis, so that a few large values do not hide the others."""
    if not len(values):
        return np.inf
    low, middle, high = np.quantile(values, (0, 0.5, 1))
    return float(min(high, middle + 4 * (middle - low))) if middle > low else float(high)


# --- files ------------------------------------------------------------------------------------------------------


def tuning_files(tuning: Tuning, name: Path | str | None, folder: Path, settings: Settings = ()) -> dict[str, bytes]:
    """The files by name: the experiment's own text with changed keys and its comments, and all candidates.

    Parameters
    ----------
    name
        The file or shipped name of the experiment; None if it has no file.
    folder
        Their folder: file names in the experiment become relative to it.
    settings
        Other changed settings.
    """
    numbers = {**_summary(tuning), "versions": versions()}
    values = {".".join(axis.place.path): _written(tuning.values[axis.key], axis.unit) for axis in tuning.search.axes}
    source = tuning.experiment if name is None else name
    return {
        TUNED: text_with_settings(source, settings, values, folder=folder).encode(),
        "tuning.json": (json.dumps(numbers, indent=2, ensure_ascii=False) + "\n").encode(),
        "candidates.csv": tuning.candidates.write_csv().encode(),
    }


def _written(value: float | int, unit: str) -> float | int | str:
    """With its unit, for a reader; plain numbers and shares have none."""
    return value if unit in (PLAIN, "1") else f"{value!r} {unit}"


def _summary(tuning: Tuning) -> dict[str, Any]:
    """The result as plain types; None for infinite values."""
    search, goal = tuning.search, tuning.search.goal

    def plain(evaluation: Evaluation | None) -> dict[str, Any] | None:
        if evaluation is None:
            return None
        value, *conditions = (v if np.isfinite(v) else None for v in (evaluation.value, *evaluation.conditions))
        names = [condition.metric for condition in goal.conditions]
        return {
            "value": value,
            "conditions": dict(zip(names, conditions, strict=True)),
            "failed": evaluation.failed,
        }

    return {
        "metric": goal.metric,
        "subject_to": [condition.text for condition in goal.conditions],
        "quantile": goal.quantile if tuning.members > 1 else None,
        "values": tuning.values,
        "units": {axis.key: axis.unit for axis in search.axes},
        "members": tuning.members,
        "seen": plain(tuning.seen),
        "before": plain(tuning.before),
        "fresh_members": tuning.fresh_members,
        "fresh": plain(tuning.fresh),
        "before_fresh": plain(tuning.before_fresh),
        "candidates": len(search.tried),
        "ending": search.ending,
        "left_out": tuning.left_out,
        "integration_error": tuning.integration_error,
    }

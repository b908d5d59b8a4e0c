"""The result of a search: values, how much better they are, and whether that holds on fresh members; its files."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars

from gough_stewart.harness.ensemble.ensemble_report import number_of_members
from gough_stewart.harness.experiment.file import text_with_settings
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.chart import Axis, Chart, Series
from gough_stewart.harness.report.document import (
    Cell,
    Column,
    Note,
    Number,
    Report,
    Section,
    Status,
    Table,
    Value,
    Verdict,
    settings_of,
)
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.quantities import (
    NUMBER,
    counted,
    exactly,
    fine,
    fineness_of,
    listed,
    percent,
    sentence,
)
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.search import Evaluation, Search
from gough_stewart.model.interface import unit_text
from gough_stewart.model.process.installed import versions
from gough_stewart.model.units import PLAIN

TUNED = "tuned.toml"
# A value so near to a bound, of the range, may be better beyond it.
_NEAR = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """The result of a search, from `tune`; its display shows tables and the result on fresh members."""

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
        """Report the metric before and after, the values found, and the result on fresh members.

        Returns
        -------
        Report
            Verdict, the values as numbers, tables, and with `charts` all candidates.
        """
        sections = [Section("Values", _tables(self))]
        if charts:
            sections.append(Section("Search", tuple(_charts(self.search))))
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
        """Keys of the experiment that were changed."""
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
    goal, axes, values, is_fresh = tuning.search.goal, tuning.search.axes, tuning.values, tuning.fresh is not None
    metric = metric_of(goal.metric)
    before, after = (tuning.before, tuning.seen) if tuning.fresh is None else (tuning.before_fresh, tuning.fresh)
    share = f", {percent(goal.quantile)} of {tuning.fresh_members} fresh members"
    name = metric.text + (share if is_fresh and tuning.members > 1 else "")
    moved = f"{name}: {exactly(metric.quantity, after.value, 3)}"
    if before is not None and np.isfinite(before.value) and before.value:
        change = (after.value - before.value) / abs(before.value)
        was, now = (exactly(metric.quantity, evaluation.value, 3) for evaluation in (before, after))
        moved = f"{name}: from {was} to {now} ({percent(abs(change))} {'less' if change < 0 else 'more'})"
    texts = [f"{axis.key} {values[axis.key]:.4g} {unit_text(axis.unit)}".rstrip() for axis in axes]
    gaps = [min(values[axis.key] - axis.low, axis.high - values[axis.key]) for axis in axes]
    near = [axis.key for axis, gap in zip(axes, gaps, strict=True) if gap <= _NEAR * (axis.high - axis.low)]
    its, broken = "its" if len(near) == 1 else "their", goal.broken(after)
    was_allowed = before is not None and goal.violation(before) == 0
    parts = [
        moved,
        "the values before break a condition" if before is not None and not was_allowed else None,
        f"with {listed(texts)}",
        f"{listed(near)} at the end of {its} range, beyond which it may be better" if near else None,
        f"not held on fresh members: {listed(broken)}" if broken else None,
        "interrupted, and not tried on fresh members" if tuning.is_interrupted else None,
    ]
    is_better = not was_allowed or before is None or after.value < before.value
    status: Status = "good"
    if broken or not is_better:
        status = "bad"
    elif near or tuning.is_interrupted:
        status = "marginal"
    return Verdict(sentence(parts), status, _numbers(tuning)[: 1 + is_fresh + len(axes)])


def _numbers(tuning: Tuning) -> tuple[Number, ...]:
    """The metric, the values, and what the members of the best candidate have; those of the verdict come first."""
    sought = metric_of(tuning.search.goal.metric)
    numbers = [Number("value", f"{sought.text}, in the search", tuning.seen.value, sought.quantity)]
    if tuning.fresh is not None:
        numbers.append(Number("fresh", f"{sought.text}, on fresh members", tuning.fresh.value, sought.quantity))
    for axis in tuning.search.axes:
        numbers.append(Number(f"values.{axis.key}", axis.key, float(tuning.values[axis.key]), axis.quantity))
    for path, members in (tuning.fresh or tuning.seen).metrics.items():
        metric = metric_of(path)
        if path == "margins.disk" and np.isnan(members).all():
            continue  # without a linear loop there is no disk margin
        if len(members) > 1:
            numbers.append(number_of_members(path, members))
        else:
            numbers.append(Number(path, metric.text, float(members[0]), metric.quantity, explanation=metric.sentence))
    return tuple(numbers)


def _tables(tuning: Tuning) -> tuple[Table, Table]:
    """What was tuned, with its range; the metric and the conditions; each before and after, also on fresh members."""
    values: list[tuple[Cell, ...]] = []
    for axis in tuning.search.axes:
        ends = (axis.now, tuning.values[axis.key], axis.low, axis.high)
        quantity = replace(axis.quantity, digits=5)
        values.append((axis.key, *(Value(None if end is None else float(end), quantity) for end in ends)))
    goal, over = tuning.search.goal, tuning.members > 1
    evaluations = {"was": tuning.before, "is": tuning.seen}
    if tuning.fresh is not None:
        evaluations |= {"was, fresh": tuning.before_fresh, "is, fresh": tuning.fresh}
    rows: list[tuple[Cell, ...]] = []
    for k, name in enumerate([goal.metric, *(condition.metric for condition in goal.conditions)]):
        metric = metric_of(name)
        numbers = (None if e is None else (e.value, *e.conditions)[k] for e in evaluations.values())
        rows.append((metric.text, *(Value(number, metric.quantity) for number in numbers)))
    failed = (None if e is None else e.failed for e in evaluations.values())
    rows.append((f"{'members' if over else 'runs'} that failed", *failed))
    share = f", {percent(goal.quantile)} of {tuning.members} members" if over else ""
    return (
        Table("Tuned", tuple(map(Column, ("", "was", "is", "from", "to"))), tuple(values), beside=True),
        Table(f"Metric and conditions{share}", tuple(map(Column, ("", *evaluations))), tuple(rows), beside=True),
    )


def _charts(search: Search) -> list[Chart]:
    """The value of every candidate with the best so far, then by each key, with those that break conditions."""
    metric, tried = metric_of(search.goal.metric), search.tried
    values = np.array([evaluation.value for evaluation in tried])
    meets = np.array([search.goal.violation(evaluation) == 0 for evaluation in tried])
    best = np.minimum.accumulate(np.where(meets, values, np.inf))
    y = Axis(metric.text, metric.quantity)
    series: tuple[Series, ...] = (
        Series("candidates", metric.quantity, np.where(np.isfinite(values), values, np.nan), "neutral"),
        Series("best so far", metric.quantity, np.where(np.isfinite(best), best, np.nan), "actual"),
    )
    axis = Axis("candidate", NUMBER, np.arange(1.0, len(tried) + 1))
    charts = [Chart(f"{metric.text} of all candidates", axis, series, y=y, group="search")]

    # an upper end of the axis, so that a few large values do not hide the others
    most, kept = np.inf, values[np.isfinite(values) & meets]
    if len(kept):
        low, middle, high = np.quantile(kept, (0, 0.5, 1))
        most = min(high, middle + 4 * (middle - low)) if middle > low else high
    shown = np.isfinite(values) & (values <= most)
    above = int(np.count_nonzero(~shown))
    kinds: tuple[tuple[str, Any, Role], ...] = (
        ("meets all conditions", shown & meets, "actual"),
        ("breaks a condition", shown & ~meets, "bad"),
    )
    series = tuple(
        Series(name, metric.quantity, np.where(chosen, values, np.nan), role)
        for name, chosen, role in kinds
        if chosen.any()
    )
    note = f"{counted(above, 'candidate')} above the chart." if above else ""
    for k, key in enumerate(search.axes if series else ()):
        points = np.array([evaluation.point[k] for evaluation in tried], dtype=float)
        axis = Axis(key.key, key.quantity, points, scale="log" if key.is_log else "linear")
        charts.append(Chart(f"{metric.text} by {key.key}", axis, series, "points", y=y, note=note, group="values"))
    return charts


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
    search, goal = tuning.search, tuning.search.goal
    # values have their units, for a reader; plain numbers and shares have none
    values: dict[str, float | int | str] = {}
    for axis in search.axes:
        value = tuning.values[axis.key]
        values[".".join(axis.place.path)] = value if axis.unit in (PLAIN, "1") else f"{value!r} {axis.unit}"

    def plain(evaluation: Evaluation | None) -> dict[str, Any] | None:
        """Of plain types; None for infinite values."""
        if evaluation is None:
            return None
        value, *conditions = (v if np.isfinite(v) else None for v in (evaluation.value, *evaluation.conditions))
        names = [condition.metric for condition in goal.conditions]
        return {"value": value, "conditions": dict(zip(names, conditions, strict=True)), "failed": evaluation.failed}

    numbers = {
        "metric": goal.metric,
        "subject_to": [condition.requirement.text for condition in goal.conditions],
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
        "versions": versions(),
    }
    source = tuning.experiment if name is None else name
    return {
        TUNED: text_with_settings(source, settings, values, folder=folder).encode(),
        "tuning.json": (json.dumps(numbers, indent=2, ensure_ascii=False) + "\n").encode(),
        "candidates.csv": tuning.candidates.write_csv().encode(),
    }

"""The result of a search: values found, their evaluation, and all of it as a report."""

from dataclasses import dataclass
from typing import Any

import polars

from gough_stewart.harness.experiment.preparation import platforms_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.document import Report
from gough_stewart.harness.report.page import to_html
from gough_stewart.harness.report.quantities import fine, fineness_of
from gough_stewart.harness.report.terminal import text_of
from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.candidates import Evaluation
from gough_stewart.harness.tuning.report import tuning_report
from gough_stewart.harness.tuning.search import Search


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
        machine = platforms_of(self.experiment)[1]
        return fine(tuning_report(self, statement(self), charts=charts), fineness_of(machine))

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
    def search_is_over_members(self) -> bool:
        """Whether values are quantiles over members."""
        return self.members > 1

    @property
    def candidates(self) -> polars.DataFrame:
        """All candidates: `generation`, a column for each key, `value`, the conditions, `failed`, `kept`."""
        goal, tried = self.search.goal, self.search.tried
        columns: dict[str, object] = {"generation": self.search.generation}
        columns |= {axis.key: [each.point[k] for each in tried] for k, axis in enumerate(self.search.axes)}
        columns["value"] = [each.value for each in tried]
        columns |= {c.metric: [each.conditions[k] for each in tried] for k, c in enumerate(goal.conditions)}
        columns["failed"] = [each.failed for each in tried]
        columns["kept"] = [goal.violation(each) == 0 for each in tried]
        return polars.DataFrame(columns, strict=False)


def statement(found: Tuning) -> str:
    """The value on the members of the search and on fresh members."""
    metric = metric_of(found.search.goal.metric)
    seen = f"{metric.text}: {exactly(metric.quantity, found.seen.value, 4)}"
    if found.fresh is None:
        why = "the search was interrupted" if found.is_interrupted else "nothing is random, so other runs are the same"
        return f"{seen} in the search; not evaluated again: {why}."
    broken = [
        condition.text
        for condition, value in zip(found.search.goal.conditions, found.fresh.conditions, strict=True)
        if not condition.holds(value)
    ]
    also = f" On these, {' and '.join(repr(each) for each in broken)} does not hold." if broken else ""
    by = f"the {found.members} members" if found.search_is_over_members else "the one run"
    return (
        f"{seen} on {by} of the search; {100 * found.search.goal.quantile:g} % of {found.fresh_members} fresh members "
        f"have at most {exactly(metric.quantity, found.fresh.value, 4)}.{also}"
    )

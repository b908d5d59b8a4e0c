"""A search: the metric to minimise, conditions such as `margins.disk > 0.5`, and the candidates that were tried."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.ensemble.member_table import SHORT
from gough_stewart.harness.errors import RequirementError, SearchError
from gough_stewart.harness.report.requirements import Required, required
from gough_stewart.harness.report.words import exactly
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.harness.tuning.space import SearchAxis
from gough_stewart.model.interface import nearest
from gough_stewart.model.vectors import FloatArray

Point = tuple[float | int, ...]


@dataclass(frozen=True)
class Condition:
    """A metric with an upper or lower bound."""

    requirement: Required
    metric: str  # its full name
    bound: float  # in the unit of the metric

    def holds(self, value: float) -> bool:
        """Whether a value meets it; false for NaN."""
        return bool(self.requirement.holds(np.array(value), self.bound))

    def violation(self, value: float) -> float:
        """The violation by a value, as a share of the bound; 0 if the condition holds."""
        if self.holds(value):
            return 0.0
        gap = abs(value - self.bound) / max(abs(self.bound), 1e-9)
        # a strict bound is not met by equality
        return float(min(max(gap, 1e-12), 1e6)) if np.isfinite(gap) else 1e6


class Evaluation(NamedTuple):
    """The evaluation of a candidate."""

    point: Point
    value: float  # of the metric; infinite if too many members failed
    conditions: tuple[float, ...]  # the metric of each
    failed: int  # number of members that did not complete
    reason: str  # cause of the first failure
    metrics: Mapping[str, FloatArray] = {}  # further metrics of its members (members,), NaN of those that failed


@dataclass(frozen=True)
class Goal:
    """The objective of the search."""

    metric: str  # to be minimised
    conditions: tuple[Condition, ...]
    quantile: float  # over the members, of the metric and of metrics with an upper bound

    def violation(self, evaluation: Evaluation) -> float:
        """The violation of all conditions, 0 if they hold; failed members count as the worst."""
        pairs = zip(self.conditions, evaluation.conditions, strict=True)
        total = sum(condition.violation(value) for condition, value in pairs)
        return total + (0.0 if np.isfinite(evaluation.value) else 1e6 * (1 + evaluation.failed))

    def broken(self, evaluation: Evaluation) -> list[str]:
        """The conditions that do not hold, as they were written."""
        pairs = zip(self.conditions, evaluation.conditions, strict=True)
        return [condition.requirement.text for condition, value in pairs if not condition.holds(value)]

    def evaluation(self, point: Point, numbers: FloatArray, completed: "np.ndarray[tuple[int], np.dtype[np.bool_]]",
                   reason: str, further: Iterable[str]) -> Evaluation:  # fmt: skip
        """Quantiles over the members; a member that failed, or has no value, counts as the worst.

        `numbers` (members, k) are the metric, that of each condition, and `further` ones, kept for each member.
        """

        def quantile(column: int, is_upper: bool) -> float:
            worst = np.inf if is_upper else -np.inf
            values = np.sort(np.where(completed & np.isfinite(numbers[:, column]), numbers[:, column], worst))
            # the value that this share of the members reaches, without interpolation, which could involve infinity
            rank = math.ceil(self.quantile * len(values) - 1e-9)
            return float(values[rank - 1] if is_upper else values[-rank])

        conditions = tuple(
            quantile(k, condition.requirement.is_upper) for k, condition in enumerate(self.conditions, 1)
        )
        metrics = dict(zip(further, numbers.T[1 + len(conditions) :], strict=True))
        return Evaluation(point, quantile(0, True), conditions, int((~completed).sum()), reason, metrics)


@dataclass
class Search:
    """All candidates tried, in order."""

    axes: tuple[SearchAxis, ...]
    goal: Goal
    tried: list[Evaluation] = field(default_factory=list)
    generation: list[int] = field(default_factory=list)  # of each candidate
    ending: str = ""
    is_interrupted: bool = False

    @property
    def best(self) -> Evaluation | None:
        """The best candidate that meets all conditions."""
        kept = [
            evaluation
            for evaluation in self.tried
            if self.goal.violation(evaluation) == 0 and np.isfinite(evaluation.value)
        ]
        return min(kept, key=lambda evaluation: evaluation.value, default=None)

    def broken_most(self) -> str:
        """The condition that most candidates break, as text."""
        if not self.tried:
            return "no candidate was tried"
        failed = [evaluation for evaluation in self.tried if not np.isfinite(evaluation.value)]
        reason = next((f"; the first: {evaluation.reason}" for evaluation in failed if evaluation.reason), "")
        lack = "members that do not complete" if reason else f"no value of {self.goal.metric}"
        counts = {f"{len(failed)} of {len(self.tried)} candidates have {lack}{reason}": len(failed)}
        for k, condition in enumerate(self.goal.conditions):
            values = [evaluation.conditions[k] for evaluation in self.tried]
            count = sum(not condition.holds(value) for value in values)
            closest = min(filter(np.isfinite, values), key=condition.violation, default=None)
            quantity = metric_of(condition.metric).quantity
            reached = "" if closest is None else f", the nearest reached {exactly(quantity, closest, 4)}"
            counts[
                f"'{condition.requirement.text}' was not met by {count} of {len(self.tried)} candidates{reached}"
            ] = count
        return max(counts, key=lambda text: counts[text])


def condition_of(text: str, known: Iterable[str]) -> Condition:
    """Parse a condition on one of the known metrics; nothing is executed.

    `SearchError` if it is none, of an unknown metric, in a unit of another kind, or on a share of members, which is
    that of the search.
    """
    try:
        requirement = required(text)
        metric = check_metric(requirement.path, known, f"--subject-to '{text}'")
        bound = requirement.bound_of(metric_of(metric).quantity)
    except RequirementError as error:
        raise SearchError(f"--subject-to: {error}") from None
    if requirement.share is not None:
        raise SearchError(
            f"--subject-to '{text}' is on a share of members; expected a condition without one: it is that of "
            "--over-ensemble for all conditions"
        )
    return Condition(requirement, metric, bound)


def check_metric(name: str, known: Iterable[str], where: str) -> str:
    """The full name of a metric; `SearchError` if it is unknown, with the nearest name."""
    full, margins = SHORT.get(name, name), tuple(SHORT.values())
    is_margin = full.startswith("margins.")
    names = [*(() if is_margin else known), *margins]
    if full in names:
        return full
    hint = nearest(name, [*names, *SHORT])
    for short, margin in SHORT.items():  # a search may use the older names, but is told those of today
        hint = hint.replace(f"'{short}'", f"'{margin}'")
    raise SearchError(f"{where}: no {'margin' if is_margin else 'metric'} '{name}'{hint}")

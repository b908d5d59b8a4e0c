"""A search: keys between two bounds, the metric to minimise, conditions such as `margins.disk > 0.5`, candidates."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.ensemble.member_table import SHORT
from gough_stewart.harness.errors import RequirementError, SearchError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Place, place_of
from gough_stewart.harness.report.quantities import NUMBER, Quantity, exactly, of_unit
from gough_stewart.harness.report.requirements import Required, required
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import nearest
from gough_stewart.model.units import PLAIN, number
from gough_stewart.model.vectors import FloatArray

Point = tuple[float | int, ...]
_DIGITS = 5
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*([^\d.,\s][^.,]*?)?\s*\.\.\s*({_NUMBER})\s*([^,]*?)\s*(,\s*log)?\s*")


@dataclass(frozen=True)
class SearchAxis:
    """One number to search."""

    key: str
    place: Place
    low: float
    high: float
    now: float | int | None = None  # the value in the experiment
    is_log: bool = False
    is_whole: bool = False

    @property
    def unit(self) -> str:
        """SI unit, Hz for frequencies, "" for plain numbers."""
        return self.place.target.unit or ""

    @property
    def quantity(self) -> Quantity:
        """How its values are written."""
        return of_unit(self.unit) if self.unit else NUMBER

    def value(self, u: float) -> float | int:
        """The value for a number in [0, 1]."""
        if self.is_whole:
            return min(int(self.low) + int(u * (self.high - self.low + 1)), int(self.high))
        if self.is_log:
            value = math.exp(math.log(self.low) + u * math.log(self.high / self.low))
        else:
            value = self.low + u * (self.high - self.low)
        # rounded first, so that the written value is the one tried
        return min(max(float(f"{value:.{_DIGITS}g}"), self.low), self.high)

    def share(self, value: float) -> float:
        """The number in [0, 1] for a value."""
        if self.is_whole:
            return (value - self.low + 0.5) / (self.high - self.low + 1)
        if self.is_log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def axes_of(  # noqa: PLR0912 - one check after the other
    texts: Sequence[str], members: Members
) -> tuple[SearchAxis, ...]:
    """The axes of strings such as `controller.bandwidth=1..6Hz`; `,log` after it selects a logarithmic scale.

    `SearchError` for no range, reversed bounds, an unknown key, or one that is not a single number or also varies.
    """
    if not texts:
        raise SearchError("nothing to vary; expected --vary KEY=LOW..HIGH, for instance controller.bandwidth=1..6Hz")
    axes = list[SearchAxis]()
    for text in texts:
        key, equals, range_text = (part.strip() for part in text.partition("="))
        parts = _RANGE.fullmatch(range_text)
        if not equals or not key or parts is None:
            raise SearchError(f"--vary {text}: expected KEY=LOW..HIGH, for instance controller.bandwidth=1..6Hz")
        low_text, low_unit, high_text, unit, log = parts.groups()
        try:
            place = place_of(key, members.nominal, *members.platforms, members.controller is not None)
        except ValueError as error:
            raise SearchError(f"--vary {text}: {key}: {error}") from None
        target = place.target
        # the value in the experiment, integers as such; None if it is left out
        now: Any = members.nominal
        for name in place.path:
            is_list, is_table = isinstance(now, list), isinstance(now, dict)
            now = now[int(name) - 1] if is_list else now.get(name) if is_table else getattr(now, name)
        if not isinstance(now, int) or isinstance(now, bool):
            now = None if target.nominal is None or target.nominal.ndim else float(target.nominal)
        # integers, such as a delay in samples; a quantity of 2 kg is none
        is_whole = isinstance(now, int) and target.unit is None
        if place.path[:2] == ("controller", "parameters"):
            # 2 may be a gain: only whole bounds make it a whole number
            is_whole = isinstance(now, int) and low_text.lstrip("+-").isdigit() and high_text.lstrip("+-").isdigit()
        if target.shape or (target.unit is None and not is_whole):
            raise SearchError(f"--vary {text}: {key} is not a single number; expected the key of a number")
        if any(varied.place.path == place.path for varied in members.inputs):
            raise SearchError(f"--vary {text}: {key} also varies in [ensemble]; expected it in one of them")
        try:
            low, high = (
                number(digits + its_unit if its_unit else float(digits), target.unit or PLAIN)
                for digits, its_unit in ((low_text, low_unit or unit), (high_text, unit))
            )
        except ValueError as error:
            raise SearchError(f"--vary {text}: {error}") from None
        if not low < high:
            raise SearchError(f"--vary {text}: the bounds are {low:g} and {high:g}; expected the lower one first")
        if log and not low > 0:
            raise SearchError(f"--vary {text}: the lower bound is {low:g}; expected > 0 for a logarithmic scale")
        axis = SearchAxis(key, place, low, high, now if is_whole or now is None else float(now), bool(log), is_whole)
        if axis.is_whole and (low % 1 or high % 1):
            raise SearchError(f"--vary {text}: {key} is a whole number; expected whole bounds")
        if any(place.path == before.place.path for before in axes):
            raise SearchError(f"--vary {key}: is repeated; expected every key once")
        axes.append(axis)
    return tuple(axes)


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

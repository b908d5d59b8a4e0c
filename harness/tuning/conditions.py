"""Conditions on a solution: `disk_margin > 0.5`, `stroke.margin >= 10 mm`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.ensemble.columns import MARGINS, SHORT
from gough_stewart.harness.errors import SearchError
from gough_stewart.harness.quantities import PLAIN, UNITS, number
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import nearest

_CONDITION = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(<=|>=|<|>)\s*(\S.*?)\s*")


@dataclass(frozen=True)
class Condition:
    """A metric with an upper or lower bound."""

    text: str
    metric: str  # its full name
    is_upper: bool  # whether the bound is an upper one
    is_strict: bool
    bound: float  # in the unit of the metric

    def holds(self, value: float) -> bool:
        """Whether a value meets it; false for NaN."""
        if self.is_upper:
            return value < self.bound if self.is_strict else value <= self.bound
        return value > self.bound if self.is_strict else value >= self.bound

    def violation(self, value: float) -> float:
        """The violation by a value, as a share of the bound; 0 if the condition holds."""
        if self.holds(value):
            return 0.0
        gap = abs(value - self.bound) / max(abs(self.bound), 1e-9)
        # a strict bound is not met by equality
        return float(min(max(gap, 1e-12), 1e6)) if np.isfinite(gap) else 1e6


def condition_of(text: str, known: Iterable[str]) -> Condition:
    """Parse a condition on one of the known metrics; nothing is executed.

    Raises
    ------
    SearchError
        Not a condition, or an unknown metric; states what was expected.
    """
    parts = _CONDITION.fullmatch(text)
    if parts is None:
        raise SearchError(
            f"--subject-to '{text}': cannot be read; expected METRIC < NUMBER or METRIC > NUMBER, for instance "
            "disk_margin > 0.5"
        )
    name, sign, bound = parts.groups()
    metric = check_metric(name, known, f"--subject-to '{text}'")
    try:
        size = _bound(bound, metric)
    except ValueError:
        units = UNITS.get(metric_of(metric).quantity.si, {})
        expected = f"a number, or one with a unit such as {', '.join(list(units)[:3])}" if units else "a number"
        raise SearchError(f"--subject-to '{text}': the bound is '{bound}'; expected {expected}") from None
    return Condition(text.strip(), metric, sign.startswith("<"), "=" not in sign, size)


def _bound(text: str, metric: str) -> float:
    """A plain number is in the unit of the metric itself: 5 for an overshoot of 5 %."""
    try:
        return number(float(text), PLAIN)
    except ValueError:
        quantity = metric_of(metric).quantity
        size = number(text, quantity.si)
        return size if quantity.si == PLAIN else size / (UNITS[quantity.si][quantity.unit] * quantity.factor)


def check_metric(name: str, known: Iterable[str], where: str) -> str:
    """The full name of a metric.

    Raises
    ------
    SearchError
        Unknown; suggests the nearest name.
    """
    full, known = SHORT.get(name, name), list(known)
    if full not in known and not full.startswith(MARGINS):
        raise SearchError(f"{where}: no metric '{name}'{nearest(name, [*known, *SHORT])}")
    if full.startswith(MARGINS) and full not in SHORT.values():
        raise SearchError(f"{where}: no margin '{name}'{nearest(name, SHORT)}")
    return full

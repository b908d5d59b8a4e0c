"""Conditions on a solution, written as requirements are: `disk_margin > 0.5`, `stroke.margin >= 10 mm`."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.ensemble.data import MARGINS, SHORT
from gough_stewart.harness.errors import RequirementError, SearchError
from gough_stewart.harness.report.requirements import Required, required
from gough_stewart.harness.results.metric_folds import metric_of
from gough_stewart.model.interface import nearest


@dataclass(frozen=True)
class Condition:
    """A metric with an upper or lower bound."""

    wanted: Required
    metric: str  # its full name
    bound: float  # in the unit of the metric

    @property
    def text(self) -> str:
        """As it was written."""
        return self.wanted.text

    @property
    def is_upper(self) -> bool:
        """Whether the bound is an upper one."""
        return self.wanted.is_upper

    def holds(self, value: float) -> bool:
        """Whether a value meets it; false for NaN."""
        return bool(self.wanted.holds(np.array(value), self.bound))

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
        Not a condition, an unknown metric, a unit of another kind, or a share of members, which is that of the search;
        states what was expected.
    """
    try:
        wanted = required(text)
        metric = check_metric(wanted.path, known, f"--subject-to '{text}'")
        bound = wanted.bound_of(metric_of(metric).quantity)
    except RequirementError as error:
        raise SearchError(f"--subject-to: {error}") from None
    if wanted.share is not None:
        raise SearchError(
            f"--subject-to '{text}' is on a share of members; expected a condition without one: it is that of "
            "--over-ensemble for all conditions"
        )
    return Condition(wanted, metric, bound)


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

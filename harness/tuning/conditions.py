"""Conditions on a solution: `disk_margin > 0.5`, `stroke.margin >= 10 mm`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.ensemble.result import MARGINS, SHORT
from gough_stewart.harness.errors import SearchError
from gough_stewart.harness.quantities import PLAIN, UNITS, number
from gough_stewart.harness.results.metric_names import shown_metric
from gough_stewart.model.interface import nearest

_CONDITION = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(<=|>=|<|>)\s*(\S.*?)\s*")
# The SI unit of quantities that are displayed in another unit.
_SI = {"mm": "m", "mrad": "rad", "N": "N", "W": "W", "s": "s"}


@dataclass(frozen=True)
class Condition:
    """A metric with an upper or lower bound."""

    text: str
    metric: str  # its full name
    is_upper: bool  # whether the bound is an upper one
    is_strict: bool
    bound: float  # SI

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


def condition_of(text: str) -> Condition:
    """Parse a condition; nothing is executed.

    Raises
    ------
    SearchError
        Not a condition; states what was expected.
    """
    parts = _CONDITION.fullmatch(text)
    if parts is None:
        raise SearchError(
            f"--subject-to '{text}': cannot be read; expected METRIC < NUMBER or METRIC > NUMBER, for instance "
            "disk_margin > 0.5"
        )
    name, sign, bound = parts.groups()
    metric = SHORT.get(name, name)
    unit = _SI.get(shown_metric(metric).unit, PLAIN) if metric.partition(".")[0] in _KNOWN else PLAIN
    try:
        # plain numbers are in SI units
        size = number(bound if bound[-1:].isalpha() and unit in UNITS else float(bound), unit)
    except ValueError:
        expected = f"a number, or one with a unit such as {', '.join(list(UNITS[unit])[:3])}" if unit else "a number"
        raise SearchError(f"--subject-to '{text}': the bound is '{bound}'; expected {expected}") from None
    return Condition(text.strip(), metric, sign.startswith("<"), "=" not in sign, size)


_KNOWN = ("tracking", "step_response", "force", "power", "energy", "stroke", "saturation", "limits", "margins")


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

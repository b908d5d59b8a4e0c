"""Conditions that a solution has to keep: `disk_margin > 0.5`, `stroke.margin >= 10 mm`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.ensemble.result import MARGINS, SHORT
from gough_stewart.harness.errors import TuningError
from gough_stewart.harness.quantities import PLAIN, UNITS, number
from gough_stewart.harness.results.metric_names import shown_metric
from gough_stewart.model.interface import nearest

_CONDITION = re.compile(r"\s*([A-Za-z_][\w.]*)\s*(<=|>=|<|>)\s*(\S.*?)\s*")
# The SI unit of what is shown in another.
_SI = {"mm": "m", "mrad": "rad", "N": "N", "W": "W", "s": "s"}


@dataclass(frozen=True)
class Condition:
    """A metric, which side it has to be on, and of what."""

    text: str
    metric: str  # by its whole name
    is_upper: bool  # whether the bound is an upper one
    is_strict: bool
    bound: float  # SI

    def holds(self, value: float) -> bool:
        """Whether a value keeps it; NaN does not."""
        if self.is_upper:
            return value < self.bound if self.is_strict else value <= self.bound
        return value > self.bound if self.is_strict else value >= self.bound

    def violation(self, value: float) -> float:
        """How far a value is on the wrong side, as a share of the bound; 0 where the condition holds."""
        if self.holds(value):
            return 0.0
        gap = abs(value - self.bound) / max(abs(self.bound), 1e-9)
        # a strict bound that is met exactly is not kept
        return float(min(max(gap, 1e-12), 1e6)) if np.isfinite(gap) else 1e6


def condition_of(text: str) -> Condition:
    """Read a condition; nothing of it is executed.

    Raises
    ------
    TuningError
        It is none; says what was expected.
    """
    parts = _CONDITION.fullmatch(text)
    if parts is None:
        raise TuningError(
            f"--subject-to '{text}': cannot be read; expected METRIC < NUMBER or METRIC > NUMBER, for instance "
            "disk_margin > 0.5"
        )
    name, sign, bound = parts.groups()
    metric = SHORT.get(name, name)
    unit = _SI.get(shown_metric(metric).unit, PLAIN) if metric.partition(".")[0] in _KNOWN else PLAIN
    try:
        # numbers alone are in SI units
        size = number(bound if bound[-1:].isalpha() and unit in UNITS else float(bound), unit)
    except ValueError:
        expected = f"a number, or one with a unit such as {', '.join(list(UNITS[unit])[:3])}" if unit else "a number"
        raise TuningError(f"--subject-to '{text}': the bound is '{bound}'; expected {expected}") from None
    return Condition(text.strip(), metric, sign.startswith("<"), "=" not in sign, size)


_KNOWN = ("tracking", "step_response", "force", "power", "energy", "stroke", "saturation", "limits", "margins")


def check_metric(name: str, known: Iterable[str], where: str) -> str:
    """The whole name of a metric.

    Raises
    ------
    TuningError
        There is none of that name; the nearest is suggested.
    """
    full, known = SHORT.get(name, name), list(known)
    if full not in known and not full.startswith(MARGINS):
        raise TuningError(f"{where}: no metric '{name}'{nearest(name, [*known, *SHORT])}")
    if full.startswith(MARGINS) and full not in SHORT.values():
        raise TuningError(f"{where}: no margin '{name}'{nearest(name, SHORT)}")
    return full

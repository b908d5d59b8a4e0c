"""The search space: keys of an experiment, each between two bounds, as `controller.bandwidth=1..6Hz`."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gough_stewart.harness.errors import SearchError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.overrides import Place
from gough_stewart.harness.report.quantities import NUMBER, Quantity, of_unit
from gough_stewart.model.units import PLAIN, number

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

    @property
    def is_within(self) -> bool:
        """Whether the experiment's value is within the bounds."""
        return self.now is not None and self.low <= self.now <= self.high


def axes_of(texts: Sequence[str], members: Members) -> tuple[SearchAxis, ...]:
    """The axes of strings such as `controller.bandwidth=1..6Hz`; `,log` after it selects a logarithmic scale.

    `SearchError` for no range, reversed bounds, an unknown key, or one that is not a single number or also varies.
    """
    if not texts:
        raise SearchError("nothing to vary; expected --vary KEY=LOW..HIGH, for instance controller.bandwidth=1..6Hz")
    axes = list[SearchAxis]()
    for text in texts:
        axes.append(_axis(text, members))
        if axes[-1].place.path in (axis.place.path for axis in axes[:-1]):
            raise SearchError(f"--vary {axes[-1].key}: is repeated; expected every key once")
    return tuple(axes)


def _axis(text: str, members: Members) -> SearchAxis:
    key, equals, range_text = (part.strip() for part in text.partition("="))
    parts = _RANGE.fullmatch(range_text)
    if not equals or not key or parts is None:
        raise SearchError(f"--vary {text}: expected KEY=LOW..HIGH, for instance controller.bandwidth=1..6Hz")
    low_text, low_unit, high_text, unit, log = parts.groups()
    try:
        place = members.place_of(key)
    except ValueError as error:
        raise SearchError(f"--vary {text}: {key}: {error}") from None
    members.check_acts(key, place)
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
    return axis

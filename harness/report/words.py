"""Numbers in sentences: few digits, bounds rounded to the side on which the sentence holds, lists and counts."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gough_stewart.harness.report.quantities import LENGTH, Quantity

# Significant digits of a number in a sentence; tables have more.
DIGITS = 2
METRES = Quantity("m", "m")
_NEGATIVE = re.compile(r"(?<![^\s(±\[])-(?=\.?\d|∞)")


def about(quantity: Quantity, value: float | None, digits: int = DIGITS) -> str:
    """A number with its unit and few digits."""
    return replace(quantity, digits=digits).text(value)


def exactly(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same, also of what is below the resolution of display."""
    return about(quantity.telling(value), value, digits)


def at_most(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as an upper bound, rounded up: "within 0.81 mm" holds for 0.8012 mm.

    Lengths from a metre on are in metres; what is below the resolution of display is within that.
    """
    kind = METRES if quantity == LENGTH and abs(value) >= 1 else quantity
    return about(kind, _rounded(kind, value, digits, math.ceil), digits).removeprefix("< ")


def at_least(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as a lower bound, rounded down."""
    return about(quantity, _rounded(quantity, value, digits, math.floor), digits)


def _rounded(quantity: Quantity, value: float, digits: int, side: object) -> float:
    shown = abs(value * quantity.factor)
    if not math.isfinite(shown) or shown == 0:
        return value
    step = 10.0 ** (math.floor(math.log10(shown)) + 1 - digits)
    # what is 0.8 up to rounding errors stays 0.8
    ratio = value * quantity.factor / step
    assert callable(side)
    return float(side(round(ratio, 9))) * step / quantity.factor


def percent(share: float, digits: int = DIGITS) -> str:
    """A share in percent; 100 % only if it is 1: 99.96 % gets as many digits as that takes."""
    if not math.isfinite(share):
        return "beyond"
    for more in range(digits, 16):
        text = f"{100 * share:.{more}g}"
        text = f"{100 * share:.0f}" if "e+" in text else text
        if share == 1 or text != "100":
            return f"{text} %"
    return "100 %"


def counted(number: int, one: str, many: str | None = None) -> str:
    """A count with its noun: 1 member, 1,000 members."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words with commas and a last conjunction."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else ""


def sentence(parts: Iterable[str | None]) -> str:
    """Parts of a verdict with semicolons between them, the first with a capital letter."""
    text = "; ".join(part for part in parts if part)
    return text[:1].upper() + text[1:]


def with_minus(text: str) -> str:
    """A text whose negative numbers have a minus sign instead of a hyphen, as on a page."""
    return _NEGATIVE.sub("−", text)


def number_text(value: float | None, digits: int = 4) -> str:
    """A number with at most this many significant digits."""
    return Quantity("", "", digits=digits).number(value)


def plain_text(value: Any) -> str:
    """A value of a file as text, numbers with six digits."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        rows = [plain_text(item) for item in value]
        return "; ".join(rows) if value and isinstance(value[0], list) else ", ".join(rows)
    if isinstance(value, dict):
        return ", ".join(f"{key} {plain_text(item)}" for key, item in value.items())
    return str(value)

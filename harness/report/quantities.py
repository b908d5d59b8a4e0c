"""How quantities are written, the same in the terminal, on pages and in figures: unit, significant digits, words.

In sentences numbers have few digits, and bounds are rounded to the side on which they hold.

Numbers of a report are stored in SI units, a percentage in percent; `factor` converts one to the unit in which it is
shown. Angles are shown in degrees.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Annotated, Any, TypeVar, cast

import numpy as np
from pydantic import ConfigDict, Field, SerializationInfo, ValidationInfo, model_serializer, model_validator
from pydantic.dataclasses import dataclass

from gough_stewart.model.interface import unit_text
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.units import UNITS, unit_typed

_DEGREES = 180 / math.pi
# What a small machine has less of, and the units in which it is shown instead.
_MECHANICAL = ("m", "rad", "m/s", "rad/s", "m/s2", "N", "N.m", "W", "J", "kg", "kg.m2")
_FINER = {"m": "mm", "mm": "µm", "µm": "nm", "deg": "µrad", "m/s": "mm/s", "mm/s": "µm/s", "deg/s": "µrad/s"}
_FINER |= {"W": "mW", "mW": "µW", "J": "µJ"}
# Digits of a coordinate, of which pages have little more; the smallest share of a number that is told.
_OF_COORDINATES, _OF_ITSELF = 6, 1e-3
# A value that is not defined.
NOTHING = "–"
# The smallest difference that numbers tell, by unit, such as a micrometre or a ten-thousandth of a degree: smaller ones
# are rounding.
LEAST_SPANS: dict[str, float] = {
    **{"m": 1e-6, "mm": 1e-3, "rad": 1e-6, "mrad": 1e-3, "deg": 1e-4, "m/s": 1e-5, "mm/s": 1e-2},
    **{"rad/s": 1e-5, "deg/s": 1e-3, "m/s2": 1e-3, "rad/s2": 1e-3, "N": 1e-3, "N/s": 1e-1, "N.m": 1e-3},
    **{"W": 1e-3, "J": 1e-3, "kg": 1e-6, "kg.m2": 1e-6, "s": 1e-9, "Hz": 1e-6, "%": 1e-3, "1": 1e-3},
}
# The same for numbers without a unit, such as the states of a controller; and as a share of the values: single
# precision, in which curves are stored, has little more.
_LEAST_OF_OTHERS, _LEAST_SHARE = 1e-6, 1e-6
# Curves keep this share of it.
_OF_CURVES = 0.1
# From this stroke on, micrometres are told [m]; of a smaller one, a millionth. The stroke of a machine that does not
# state one, as a share of its legs.
_SMALL, _SHARE_OF_LEGS = 0.01, 0.01
_Part = TypeVar("_Part")


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Quantity:
    """A kind of number: its SI unit, as in `units.UNITS`, and how it is shown."""

    si: str  # "" for a plain number
    unit: str
    factor: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 1.0  # from the stored number to that in `unit`
    name: str = ""  # of an axis without words of its own
    symbol: str = ""
    digits: Annotated[int, Field(ge=1)] = 4  # significant
    least: float | None = None  # the smallest size that is told [unit]; None for that of the unit

    @model_validator(mode="wrap")
    @classmethod
    def _known(cls, value: Any, handler: Any, info: ValidationInfo) -> "Quantity":
        """Refuse an unknown unit. In JSON, a report lists its quantities once and names them elsewhere."""
        known = info.context or {}
        if isinstance(value, str) and value not in known:
            raise ValueError(f"the quantity '{value}'; expected one of {', '.join(known)}")
        quantity: Quantity = handler(known[value] if isinstance(value, str) else value)
        if quantity.si and quantity.si not in UNITS:
            raise ValueError(
                f"the SI unit '{quantity.si}'; expected one of {', '.join(UNITS)}, or '' for a plain number"
            )
        return quantity

    @model_serializer(mode="plain")
    def _key(self, info: SerializationInfo) -> Any:
        keys: dict[Quantity, str] | None = info.context
        if keys is None:
            # its fields that have not their default
            defaults = {field.name: field.default for field in fields(self)}
            return {name: value for name, value in asdict(self).items() if value != defaults[name]}
        if self not in keys:
            stem, used = self.name or self.unit or "number", set(keys.values())
            names = (stem, *(f"{stem} {k}" for k in range(2, len(used) + 3)))
            keys[self] = next(name for name in names if name not in used)
        return keys[self]

    @property
    def unit_text(self) -> str:
        """The unit as people write it: m/s² for m/s2, and none for 1."""
        return "" if self.unit == "1" else unit_text(self.unit)

    def text(self, value: float | None, *, unit: bool = True) -> str:
        """A stored number as shown, with its unit; "< 0.001 mm" below the resolution of display."""
        if value is None or math.isnan(value):
            return NOTHING
        shown, least = self.factor * value + 0.0, self.told  # no negative zero
        if unit and self.least is not None and self.unit in _FINER and 0 < abs(shown) < 1:
            return self.fine(1.0).text(value)
        if math.isinf(value):
            text = "∞" if value > 0 else "-∞"
        elif shown and abs(shown) < least:
            text = f"< {least:.3g}"
        else:
            text = f"{shown:.{self.digits}g}"
            # large numbers in full: 18610 is shorter than 1.861e+04
            text = f"{shown:.0f}" if "e+" in text and abs(shown) < 1e7 else text
        return f"{text} {self.unit_text}" if unit and self.unit_text else text

    @property
    def told(self) -> float:
        """The smallest size that is told [unit]."""
        return LEAST_SPANS.get(self.unit, 0.0) if self.least is None else self.least

    def fine(self, share: float) -> "Quantity":
        """The same for a small machine: told down to a share of what is usual, in a smaller unit if it has one."""
        if self.si not in _MECHANICAL:
            return self
        unit = _FINER.get(self.unit, self.unit)
        ratio = UNITS[self.si][self.unit] / UNITS[self.si][unit] if unit != self.unit else 1.0
        digits = max(self.digits, _OF_COORDINATES) if self.unit == "m" else self.digits
        return replace(self, unit=unit, factor=self.factor * ratio, digits=digits, least=share * ratio * self.told)

    def telling(self, size: float) -> "Quantity":
        """The same, `fine` if a number of this size [stored] would be below what is told."""
        size = abs(self.factor * size)
        return self.fine(_OF_ITSELF * size / self.told) if 0 < size < self.told else self

    def range_text(self, low: float | None, high: float | None) -> str:
        """Two stored numbers with one unit: 9.8 to 12.3 mm; "at least 9.8 mm" of an end that is not defined."""
        if low is high is None:
            return NOTHING
        if low is None or high is None:
            return f"at least {self.text(low)}" if high is None else f"at most {self.text(high)}"
        return f"{self.text(low, unit=False)} to {self.text(high, unit=False)} {self.unit_text}".rstrip()

    def headed(self, name: str = "") -> str:
        """A heading: the name, or the quantity's own, with the unit in brackets."""
        words = name or self.name
        return f"{words} [{self.unit_text}]" if self.unit_text else words

    def stored(self, number: float, unit: str) -> float:
        """A number in any unit of this kind as it is stored: 1 mm of a length is 0.001; others are a ValueError."""
        known, unit = UNITS.get(self.si, {self.unit: 1.0}), unit_typed(unit)
        if unit not in known:
            expected = ", ".join(filter(None, known)) or "no unit"
            raise ValueError(f"the unit '{unit}'; expected {expected}")
        # so that 800 µm are 0.0008 m to the last bit
        return number / (known[self.unit] * self.factor / known[unit])


def least_span(unit: str, largest: float = 0.0, least: float | None = None, *, is_axis: bool = False) -> float:
    """The smallest difference of curves in a unit, up to a largest magnitude; `least` is that of numbers.

    An axis spans what numbers tell on both sides of its middle, so that rounding looks flat.
    """
    told = LEAST_SPANS.get(unit, _LEAST_OF_OTHERS) if least is None else least
    return max((2 if is_axis else _OF_CURVES) * told, _LEAST_SHARE * abs(largest))


def fineness_of(platform: PlatformFields) -> float:
    """The smallest numbers that are told of a machine, as a share of those of a machine with a stroke of 1 m."""
    stroke = platform.stroke
    if stroke is None:
        legs = leg_geometry(platform, platform.home_position, platform.home_orientation).length
        stroke = _SHARE_OF_LEGS * float(legs.mean())
    return stroke if stroke < _SMALL else 1.0


def fine(part: _Part, fineness: float) -> _Part:
    """A report, a part of it or a quantity with all quantities as `Quantity.fine`; 1 changes nothing."""
    if fineness >= 1:
        return part
    changed: Any = part
    if isinstance(part, Quantity):
        changed = part.fine(fineness)
    elif isinstance(part, tuple):
        changed = tuple(fine(item, fineness) for item in part)
    elif is_dataclass(part) and not isinstance(part, type):
        changed = replace(part, **{field.name: fine(getattr(part, field.name), fineness) for field in fields(part)})
    return cast("_Part", changed)


def of_unit(unit: str) -> Quantity:
    """The quantity of a unit in `units.UNITS`, in which it is shown; angles in degrees."""
    shown = {"rad": "deg", "rad/s": "deg/s"}.get(unit, unit)
    # rad/s is the SI unit of a rate, but is also listed with Hz
    si = shown if shown in UNITS else next((si for si, others in UNITS.items() if shown in others), "")
    return Quantity(si, shown, 1 / UNITS[si][shown] if si not in ("", shown) else 1.0)


LENGTH = Quantity("m", "mm", 1e3, "length")
POSITION = Quantity("m", "m", 1.0, "position", digits=5)
ANGLE = Quantity("rad", "deg", _DEGREES, "angle")
VELOCITY = Quantity("m/s", "m/s", 1.0, "velocity", "v")
ANGULAR_VELOCITY = Quantity("rad/s", "deg/s", _DEGREES, "angular velocity", "ω")
FORCE = Quantity("N", "N", 1.0, "force", "F")
POWER = Quantity("W", "W", 1.0, "power", "P")
ENERGY = Quantity("J", "J", 1.0, "energy")
MASS = Quantity("kg", "kg", 1.0, "mass", "m")
TIME = Quantity("s", "s", 1.0, "time", "t")
FREQUENCY = Quantity("Hz", "Hz", 1.0, "frequency", "f")
DECIBEL = Quantity("", "dB", 1.0, "magnitude")
# A share is a number from 0 to 1, a percentage one in percent.
SHARE = Quantity("1", "%", 100.0, "share")
PERCENT = Quantity("1", "%", 1.0, "percentage")
NUMBER = Quantity("", "", 1.0, "number")
COUNT = Quantity("", "", 1.0, "count", digits=9)


# ---- in sentences ----

# Significant digits of a number; tables have more.
DIGITS = 2
METRES = Quantity("m", "m")


def about(
    quantity: Quantity, value: float | None, digits: int = DIGITS, side: Callable[[float], int] | None = None
) -> str:
    """A number with its unit and few digits; with `math.ceil` or `math.floor` rounded to that side."""
    shown = 0.0 if value is None else value * quantity.factor
    if side is not None and math.isfinite(shown) and shown != 0:
        step = 10.0 ** (math.floor(math.log10(abs(shown))) + 1 - digits)
        # what is 0.8 up to rounding errors stays 0.8
        value = side(round(shown / step, 9)) * step / quantity.factor
    return replace(quantity, digits=digits).text(value)


def exactly(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same, also of what is below the resolution of display."""
    return about(quantity.telling(value), value, digits)


def at_most(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as an upper bound, rounded up: "within 0.81 mm" holds for 0.8012 mm.

    Lengths from a metre on are in metres; what is below the resolution of display is within that.
    """
    kind = METRES if quantity == LENGTH and abs(value) >= 1 else quantity
    return about(kind, value, digits, math.ceil).removeprefix("< ")


def at_least(quantity: Quantity, value: float, digits: int = DIGITS) -> str:
    """The same as a lower bound, rounded down."""
    return about(quantity, value, digits, math.floor)


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


def number_text(value: float | None, digits: int = 4) -> str:
    """A number with at most this many significant digits."""
    return Quantity("", "", digits=digits).text(value)


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

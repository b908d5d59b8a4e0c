"""Quantities of experiments: numbers in SI units, or strings with a unit, "20 mm"; vectors are lists or arrays of them.

This small table replaces a units library: those treat Hz and rad/s as the same unit, and would read 31 rad/s as 31 Hz.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, GetCoreSchemaHandler
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function, no_info_plain_validator_function

from gough_stewart.model.vectors import real_array

# Each unit in the SI unit that heads its row.
UNITS: dict[str, dict[str, float]] = {
    "m": {"m": 1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
    "rad": {"rad": 1, "mrad": 1e-3, "urad": 1e-6, "µrad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180},
    "s": {"s": 1, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60},
    "Hz": {"Hz": 1, "kHz": 1e3, "rad/s": 1 / (2 * math.pi), "rpm": 1 / 60},
    "m/s": {"m/s": 1, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6},
    "rad/s": {"rad/s": 1, "mrad/s": 1e-3, "urad/s": 1e-6, "µrad/s": 1e-6, "deg/s": math.pi / 180},
    "N": {"N": 1, "kN": 1e3},
    "N/s": {"N/s": 1, "kN/s": 1e3},
    "N.m": {"N.m": 1, "N m": 1, "Nm": 1, "kN.m": 1e3},
    "N/m": {"N/m": 1, "kN/m": 1e3, "N/mm": 1e3, "N/um": 1e6, "N/µm": 1e6},
    "N.m/rad": {"N.m/rad": 1, "N m/rad": 1, "kN.m/rad": 1e3},
    "N.s/m": {"N.s/m": 1, "N s/m": 1, "kN.s/m": 1e3},
    "1": {"1": 1, "%": 1e-2},
    "N/(m.s)": {"N/(m.s)": 1, "N/(m s)": 1, "kN/(m.s)": 1e3},
    "kg": {"kg": 1, "g": 1e-3, "t": 1e3},
    "kg.m2": {"kg.m2": 1, "kg m2": 1},
    "m/s2": {"m/s2": 1},
    "W": {"W": 1, "mW": 1e-3, "uW": 1e-6, "µW": 1e-6, "kW": 1e3},
    "J": {"J": 1, "uJ": 1e-6, "µJ": 1e-6, "kJ": 1e3},
}

# The unit of plain numbers, never written out.
PLAIN = ""
LARGEST = 1e12
# A number and its unit, with or without a space between them.
_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")
ZEROS = (0.0, 0.0, 0.0)
# Keyboards and other programs write the Greek letter for the micro sign.
_TYPED = str.maketrans("·²³\N{GREEK SMALL LETTER MU}", ".23\N{MICRO SIGN}")


def unit_typed(text: str) -> str:
    """The unit of `UNITS` that a person wrote: the inverse of `interface.unit_text`."""
    return text.strip().translate(_TYPED)


def number(value: object, unit: str) -> float:
    """A quantity as a number in SI units.

    Raises
    ------
    ValueError
        Neither a finite number nor a string with a number and a unit of this kind.
    """
    if type(value) is float and abs(value) <= LARGEST:  # of many members most are, and the checks below are slow
        return value
    if unit == PLAIN:
        return plain_number(value)
    expected = f"expected a number of {unit}, or a string with one of the units {', '.join(UNITS[unit])}"
    if not isinstance(value, str):
        try:
            size = float(real_array(value, ()))
        except ValueError:
            raise ValueError(expected) from None
        return _of_this_world(size)
    parts = _QUANTITY.fullmatch(value.strip())
    if parts is None:
        raise ValueError(expected)
    digits, typed = parts[1], unit_typed(parts[2])
    if typed not in UNITS[unit]:
        raise ValueError(f"{expected}; found the unit '{typed}'" if typed else expected)
    return _of_this_world(float(digits) * UNITS[unit][typed])


def _of_this_world(size: float) -> float:
    """Refuse NaN and implausibly large values, whose squares and cubes would overflow."""
    if not abs(size) <= LARGEST:
        raise ValueError(f"expected a number of at most {LARGEST:g} in SI units")
    return size


def positive_or_word(value: object, unit: str, *words: str) -> float | str:
    """A quantity > 0 in SI units, or one of some keywords.

    Raises
    ------
    ValueError
        Neither.
    """
    if value in words:
        return str(value)
    or_words = "".join(f", or '{word}'" for word in words)
    try:
        size = number(value, unit)
    except ValueError as error:
        raise ValueError(f"{error}{or_words.replace(',', ';', 1)}") from None
    if not size > 0:
        raise ValueError(f"expected > 0 {unit}{or_words}")
    return size


def vector(value: object, unit: str, size: int) -> tuple[float, ...]:
    """A list or array of `size` quantities, as numbers in SI units.

    Raises
    ------
    ValueError
        Wrong length, or as `number`, with the index in the list.
    """
    values = _listed(value)
    if not isinstance(values, list | tuple) or len(values) != size:
        number_of_values = f"{len(values)} values" if isinstance(values, list | tuple) else "one value"
        raise ValueError(f"expected a list of {size} [{unit}]; found {number_of_values}")
    numbers = []
    for k, element in enumerate(values):
        try:
            numbers.append(number(element, unit))
        except ValueError as error:
            raise ValueError(f"value {k + 1} of {size}: {error}") from None
    return tuple(numbers)


def channels(value: object, unit: str, size: int) -> tuple[float, ...]:
    """`size` quantities as numbers in SI units: a list or array of them, or one quantity for all.

    Raises
    ------
    ValueError
        Wrong length, or an element that is no quantity, with its index in the list.
    """
    values = _listed(value)
    if not isinstance(values, list | tuple):
        return (number(values, unit),) * size
    if len(values) != size:
        raise ValueError(f"expected a number [{unit}] or a list of {size}; found {len(values)} values")
    return vector(values, unit, size)


def _listed(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray) else value


def plain_number(value: object) -> float:
    """A finite number without unit; neither a string nor a boolean.

    Raises
    ------
    ValueError
        Anything else.
    """
    try:
        return float(real_array(value, ()))
    except ValueError:
        raise ValueError("expected a number") from None


@dataclass(frozen=True)
class ScalarQuantity:
    """Annotates a field that accepts a string with a unit; it stores a number in SI units."""

    unit: str
    bound: Literal["> 0", ">= 0"] | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_before_validator_function(self._parsed, handler(source))

    def _parsed(self, value: object) -> float:
        size = number(value, self.unit)
        if (self.bound == "> 0" and not size > 0) or (self.bound == ">= 0" and not size >= 0):
            unit = "" if self.unit == PLAIN else f" {self.unit}"
            raise ValueError(f"expected {self.bound}{unit}")
        return size


@dataclass(frozen=True)
class Vector:
    """Annotates a field that accepts a list or array; it stores a tuple of numbers in SI units."""

    unit: str
    size: int
    parse: Callable[[object, str, int], tuple[float, ...]] = vector

    def __get_pydantic_core_schema__(self, _source: object, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_plain_validator_function(lambda value: self.parse(value, self.unit, self.size))


@dataclass(frozen=True)
class Unit:
    """Annotates the unit of a field that has its own parser."""

    unit: str


def quantity_in(*annotations: object) -> ScalarQuantity | Vector | Unit | None:
    """The annotation of a field as a quantity, or None if it has none."""
    for annotation in annotations:
        if isinstance(annotation, ScalarQuantity | Vector | Unit):
            return annotation
        if (quantity := quantity_in(*get_args(annotation))) is not None:
            return quantity
    return None


def _share(value: object) -> float:
    """A share from 0 to below 1: 0.1, or "10 %"."""
    try:
        size = number(value, "1")
    except ValueError:
        raise ValueError("expected a number from 0 to below 1, or a string such as '10 %'") from None
    if not 0 <= size < 1:
        raise ValueError("expected a number from 0 to below 1, or from '0 %' to below '100 %'")
    return size


Share = Annotated[float, Unit("1"), BeforeValidator(_share)]
Number = Annotated[float, ScalarQuantity(PLAIN)]
PositiveNumber = Annotated[float, ScalarQuantity(PLAIN, "> 0")]
AnyTime = Annotated[float, ScalarQuantity("s")]
Time = Annotated[float, ScalarQuantity("s", ">= 0")]
PositiveTime = Annotated[float, ScalarQuantity("s", "> 0")]
PositiveLength = Annotated[float, ScalarQuantity("m", "> 0")]
Angle = Annotated[float, ScalarQuantity("rad")]
Frequency = Annotated[float, ScalarQuantity("Hz", "> 0")]
Band = Annotated[ArrayLike, Vector("Hz", 2)]
PositiveForce = Annotated[float, ScalarQuantity("N", "> 0")]
PositiveForceRate = Annotated[float, ScalarQuantity("N/s", "> 0")]
Position = Annotated[ArrayLike, Vector("m", 3)]
Orientation = Annotated[ArrayLike, Vector("rad", 3)]
Velocity = Annotated[ArrayLike, Vector("m/s", 3)]
AngularVelocity = Annotated[ArrayLike, Vector("rad/s", 3)]
Force = Annotated[ArrayLike, Vector("N", 3)]
Torque = Annotated[ArrayLike, Vector("N.m", 3)]
LegForces = Annotated[ArrayLike, Vector("N", 6)]
# In task space the last three channels are torques per angle: N.m/rad and so on, plain numbers.
ProportionalGains = Annotated[ArrayLike, Vector("N/m", 6, channels)]
DerivativeGains = Annotated[ArrayLike, Vector("N.s/m", 6, channels)]
IntegralGains = Annotated[ArrayLike, Vector("N/(m.s)", 6, channels)]


def plain(value: Any) -> Any:
    """A value in types of JSON; None for what is no finite number."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""Quantities of experiments: numbers in SI units or with a unit, vectors of them, and annotations of fields."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, GetCoreSchemaHandler
from pydantic_core import CoreSchema
from pydantic_core.core_schema import no_info_before_validator_function, no_info_plain_validator_function

from gough_stewart.model.units import PLAIN, number

ZEROS = (0.0, 0.0, 0.0)


def positive_or_word(value: object, unit: str, *words: str) -> float | str:
    """A quantity > 0 in SI units, or one of some keywords."""
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


def vector(value: object, unit: str, size: int, *, one_for_all: bool = False) -> tuple[float, ...]:
    """A list or array of `size` quantities, as numbers in SI units; a `ValueError` has the index in the list.

    Or, if it is said so, one quantity for all of them.
    """
    values = value.tolist() if isinstance(value, np.ndarray) else value
    if one_for_all and not isinstance(values, list | tuple):
        return (number(values, unit),) * size
    if not isinstance(values, list | tuple) or len(values) != size:
        expected = f"a number [{unit}] or a list of {size}" if one_for_all else f"a list of {size} [{unit}]"
        number_of_values = f"{len(values)} values" if isinstance(values, list | tuple) else "one value"
        raise ValueError(f"expected {expected}; found {number_of_values}")
    numbers = []
    for k, element in enumerate(values):
        try:
            numbers.append(number(element, unit))
        except ValueError as error:
            raise ValueError(f"value {k + 1} of {size}: {error}") from None
    return tuple(numbers)


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
    one_for_all: bool = False  # whether one quantity stands for all of them

    def __get_pydantic_core_schema__(self, _source: object, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_plain_validator_function(
            lambda value: vector(value, self.unit, self.size, one_for_all=self.one_for_all)
        )


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
ProportionalGains = Annotated[ArrayLike, Vector("N/m", 6, one_for_all=True)]
DerivativeGains = Annotated[ArrayLike, Vector("N.s/m", 6, one_for_all=True)]
IntegralGains = Annotated[ArrayLike, Vector("N/(m.s)", 6, one_for_all=True)]


def plain(value: Any) -> Any:
    """A value in types of JSON; None for what is no finite number."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

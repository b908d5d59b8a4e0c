"""What the classes of a report share: pydantic dataclasses whose JSON leaves defaults out, with arrays of numbers.

JSON has neither NaN nor infinity: NaN is null, and infinite numbers are the strings "Infinity" and "-Infinity".
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict, GetCoreSchemaHandler, GetJsonSchemaHandler, model_serializer
from pydantic.dataclasses import dataclass
from pydantic_core import CoreSchema, core_schema

from gough_stewart.model.vectors import FloatArray

CONFIG = ConfigDict(extra="forbid", ser_json_inf_nan="strings", defer_build=True)


@dataclass(frozen=True, eq=False, config=CONFIG)
class Data:
    """A part of a report."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, handler: Any) -> dict[str, Any]:
        written = handler(self)
        return {field.name: written[field.name] for field in fields(self) if not _is_default(field, self)}


def _is_default(field: "Field[Any]", part: Data) -> bool:
    value = getattr(part, field.name)
    default = field.default if field.default_factory is MISSING else field.default_factory()
    if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
        return isinstance(default, np.ndarray) and np.array_equal(value, default)
    return default is not MISSING and type(value) is type(default) and bool(value == default)


class Numbers:
    """Annotates an array of numbers, NaN where there is none, which becomes a read-only copy.

    Parameters
    ----------
    dimensions
        Numbers of dimensions that it may have.
    """

    def __init__(self, *dimensions: int) -> None:
        self.dimensions = dimensions

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read from anything that NumPy makes numbers of, written as nested lists."""
        written = core_schema.plain_serializer_function_ser_schema(_listed)
        return core_schema.no_info_plain_validator_function(self._read_only, serialization=written)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Nested lists of numbers."""
        return {"type": "array"}

    def _read_only(self, values: Any) -> FloatArray:
        try:
            array = np.array(values, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"{type(values).__name__}; expected an array of numbers") from None
        if array.ndim not in self.dimensions:
            expected = " or ".join(map(str, self.dimensions))
            raise ValueError(f"an array of {array.ndim} dimensions; expected {expected}")
        array.setflags(write=False)
        return array


def _listed(array: FloatArray) -> list[Any]:
    if np.isfinite(array).all():
        numbers: list[Any] = array.tolist()
        return numbers
    return [_listed(part) if part.ndim else as_json(float(part)) for part in array]


def as_json(number: float) -> float | str | None:
    """A number as JSON has it."""
    if math.isnan(number):
        return None
    return number if math.isfinite(number) else ("Infinity" if number > 0 else "-Infinity")


Vector = Annotated[FloatArray, Numbers(1)]
Array = Annotated[FloatArray, Numbers(1, 2, 3)]
# A number, or None for one that is not defined, such as NaN.
Defined = Annotated[
    float | None, BeforeValidator(lambda value: None if isinstance(value, float) and math.isnan(value) else value)
]


def check_shapes(part: Any, name: str, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Refuse arrays of a part with other shapes than these; one that is None is not there."""
    for field, shape in shapes.items():
        array = getattr(part, field)
        if array is not None and array.shape != shape:
            raise ValueError(f"{field} of {name} has {array.shape} values; expected {shape}")

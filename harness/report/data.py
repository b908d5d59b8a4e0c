"""What the classes of a report share: pydantic dataclasses whose JSON leaves defaults out, with arrays of numbers.

JSON has neither NaN nor infinity: NaN is null, and infinite numbers are the strings "Infinity" and "-Infinity".
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, PlainValidator, WithJsonSchema, model_serializer
from pydantic.dataclasses import dataclass

from gough_stewart.model.vectors import FloatArray

CONFIG = ConfigDict(extra="forbid", ser_json_inf_nan="strings", defer_build=True)


@dataclass(frozen=True, eq=False, config=CONFIG)
class Data:
    """A part of a report."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, handler: Any) -> dict[str, Any]:
        written, kept = handler(self), {}
        for field in fields(self):
            value = getattr(self, field.name)
            default = field.default if field.default_factory is MISSING else field.default_factory()
            if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
                is_default = isinstance(default, np.ndarray) and np.array_equal(value, default)
            else:
                is_default = default is not MISSING and type(value) is type(default) and bool(value == default)
            if not is_default:
                kept[field.name] = written[field.name]
        return kept


def _array_of(*dimensions: int) -> PlainValidator:
    """Reads what NumPy makes numbers of, None as NaN, with one of these numbers of dimensions, as a read-only copy."""

    def read(values: Any) -> FloatArray:
        try:
            array = np.array(values, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"{type(values).__name__}; expected an array of numbers") from None
        if array.ndim not in dimensions:
            expected = " or ".join(map(str, dimensions))
            raise ValueError(f"an array of {array.ndim} dimensions; expected {expected}")
        array.setflags(write=False)
        return array

    return PlainValidator(read)


def _listed(array: FloatArray) -> list[Any]:
    if np.isfinite(array).all():
        numbers: list[Any] = array.tolist()
        return numbers
    if array.ndim > 1:
        return [_listed(part) for part in array]
    words = {math.inf: "Infinity", -math.inf: "-Infinity"}
    return [None if math.isnan(number) else words.get(number, number) for number in array.tolist()]


_LISTED, _SCHEMA = PlainSerializer(_listed), WithJsonSchema({"type": "array"})
Vector = Annotated[FloatArray, _array_of(1), _LISTED, _SCHEMA]
Rows = Annotated[FloatArray, _array_of(2), _LISTED, _SCHEMA]
Layers = Annotated[FloatArray, _array_of(2, 3), _LISTED, _SCHEMA]
Array = Annotated[FloatArray, _array_of(1, 2, 3), _LISTED, _SCHEMA]
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

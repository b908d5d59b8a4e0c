"""Checks of the fields of a report's data."""

import math
from collections.abc import Mapping
from typing import Any, get_args

import numpy as np

from gough_stewart.model.vectors import FloatArray


def array_of(values: Any, what: str, dimensions: tuple[int, ...] = (1,)) -> FloatArray:
    """A read-only array of numbers; NaN where there is none."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{what}: {type(values).__name__}; expected an array of numbers") from None
    if array.ndim not in dimensions:
        raise ValueError(f"{what}: an array of {array.ndim} dimensions; expected {' or '.join(map(str, dimensions))}")
    array.setflags(write=False)
    return array


def set_arrays(of: Any, shapes: Mapping[str, tuple[int, ...]], what: str) -> None:
    """Make the fields of these names read-only arrays of their shapes; those that are None stay so."""
    for name, shape in shapes.items():
        given = getattr(of, name)
        if given is None:
            continue
        array = array_of(given, f"{name} of {what}", (1, 2))
        if array.shape != shape:
            raise ValueError(f"{name} of {what} has {array.shape} values; expected {shape}")
        object.__setattr__(of, name, array)


def defined(value: float | None) -> float | None:
    """A number, or None for NaN."""
    return None if value is None or math.isnan(value) else float(value)


def one_of(value: str, kind: Any, what: str) -> None:
    if value not in get_args(kind):
        raise ValueError(f"{what} '{value}'; expected one of {', '.join(get_args(kind))}")

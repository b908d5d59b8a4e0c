"""How the numbers of many members lie in memory: element by element, the members side by side.

An array of shape (N, size) is a transposed (size, N) one, and over time (n, N, size) a transposed (n, size, N). NumPy's
elementwise operations keep that layout, and go through members in vectors.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray

# A number of a single run, or of many members an array (N,): the arithmetic is the same, so that this stays open.
PerMember = Any


def zeros(shape: tuple[int, ...], size: int, *rows: int) -> FloatArray:
    """Zeros (*rows, *shape, size), members last in memory."""
    return np.moveaxis(np.zeros((*rows, size, *shape)), len(rows), -1)


def flags(shape: tuple[int, ...], size: int, *rows: int) -> BoolArray:
    """As `zeros`, all false."""
    return np.moveaxis(np.zeros((*rows, size, *shape), dtype=bool), len(rows), -1)


def stacked(values: Sequence[Any]) -> Any:
    """Arrays of members (..., size), all of one shape, as one (..., N, size), members last in memory."""
    return np.moveaxis(np.stack([np.asarray(each) for each in values], axis=-1), -1, -2)


def all_below(values: FloatArray, bound: float) -> bool:
    """Whether vectors (size,) or (N, size) are all shorter than a bound for certain; where not, look more closely.

    The squares of all together are quickly summed up, and no vector's own are more; false of NaN, too.
    """
    row = values if values.ndim == 1 else values.T.reshape(-1)
    return bool(row.dot(row) < bound * bound)


def smallest(value: PerMember) -> Any:
    """Of all members."""
    return value.min() if isinstance(value, np.ndarray) else value


def of(value: PerMember, member: int) -> Any:
    """That of one member, of a number that all have alike or of an array (N,)."""
    return np.ravel(value)[member if np.ndim(value) else 0]

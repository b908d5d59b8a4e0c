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
    """Whether vectors (N, size) are certainly all shorter than a bound; where not, one has to look more closely.

    All squares together are at once at hand, and no sum of theirs is larger; false of NaN, too.
    """
    row = values.T.reshape(-1)
    return bool(row @ row < bound * bound)


def smallest(value: PerMember) -> Any:
    """Of all members."""
    return value.min() if isinstance(value, np.ndarray) else value


def of(value: PerMember, member: int) -> Any:
    """That of one member, of a number that all have alike or of an array (N,)."""
    return np.ravel(value)[member if np.ndim(value) else 0]

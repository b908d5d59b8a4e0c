"""Memory layout of the values of many members: element by element, members contiguous.

An array of shape (N, size) is a transposed (size, N) one, and over time (n, N, size) a transposed (n, size, N). NumPy's
elementwise operations keep that layout and process members as vectors.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gough_stewart.model.vectors import FloatArray

# A number of a single run, or an array (N,) for many members; the arithmetic is the same for both. Limits of legs that
# differ are (1, 6) or (N, 6).
PerMember = Any


def zeros(shape: tuple[int, ...], size: int, *rows: int) -> FloatArray:
    """Zeros (*rows, *shape, size), members contiguous."""
    return np.moveaxis(np.zeros((*rows, size, *shape)), len(rows), -1)


def stacked(values: Sequence[Any]) -> Any:
    """Arrays of members (..., size), of equal shape, as one (..., N, size), members contiguous."""
    return np.moveaxis(np.stack([np.asarray(value) for value in values], axis=-1), -1, -2)


def all_below(values: FloatArray, bound: float) -> bool:
    """Whether vectors (size, N) are certainly all shorter than a bound; if False, check each.

    Compares the sum of all squares, which no vector's own sum exceeds; also False for NaN.
    """
    flat = values.reshape(-1)
    return bool(flat.dot(flat) < bound * bound)


def of(value: PerMember, member: int) -> Any:
    """The value of one member, from a common number or an array (N,)."""
    return np.ravel(value)[member if np.ndim(value) else 0]


def of_legs(value: PerMember) -> FloatArray:
    """Limits of the legs (6, N) or (6, 1)."""
    values = np.asarray(value, dtype=float)
    return np.broadcast_to(values.T, (6, values.shape[0] if values.ndim else 1))

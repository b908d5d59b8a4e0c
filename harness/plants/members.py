"""How the numbers of many members lie in memory: element by element, the members side by side.

An array of shape (N, size) is a transposed (size, N) one, and over time (n, N, size) a transposed (n, size, N). NumPy's
elementwise operations keep that layout, and go through members in vectors.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray


def zeros(shape: tuple[int, ...], size: int) -> FloatArray:
    """Zeros (*shape, size), members last in memory."""
    return np.moveaxis(np.zeros((size, *shape)), 0, -1)


def flags(shape: tuple[int, ...], size: int) -> BoolArray:
    """As `zeros`, all false."""
    return np.moveaxis(np.zeros((size, *shape), dtype=bool), 0, -1)


def stacked(values: Sequence[Any]) -> Any:
    """Arrays of members (..., size), all of one shape, as one (..., N, size), members last in memory."""
    return np.moveaxis(np.stack([np.asarray(each) for each in values], axis=-1), -1, -2)

"""Arrays of numbers in a page: compressed, each once; long records as blocks with their smallest and largest value.

The browser unpacks an array when something that shows it is drawn (`web/page.js`).
"""

import base64
import zlib
from typing import Any

import numpy as np

from gough_stewart.harness.report.quantities import Quantity, least_span
from gough_stewart.model.vectors import Array, FloatArray

# Rows of a series that a page holds one by one; of a longer one it holds blocks.
MOST_ROWS = 20_001
# A curve is stored in steps of this share of its range, or of the resolution of display if that is more: no screen has
# more pixels.
_STEPS = 2.0**20
# Level 9 takes three times as long and saves a hundredth of the bytes (measured on the pages of an ensemble).
_LEVEL = 6
# Rows of a uniform clock are within this share of a step of where they are expected.
_UNIFORM = 1e-6


class Arrays:
    """The arrays of a page, in the order in which they were first added."""

    def __init__(self) -> None:
        self.packed: list[dict[str, Any]] = []
        self._known: dict[tuple[Any, ...], int] = {}

    def add(self, values: Array, quantity: Quantity | None = None, steps: float = _STEPS) -> int:
        """Keep an array of any shape, in C order, and return its number; the same values are kept once.

        With a quantity, the values are rounded to its resolution of display, or finer; otherwise all bits are kept.
        With fewer `steps` of the whole range they are rounded to these.
        """
        array = np.ascontiguousarray(values, dtype=float).ravel()
        least = None if quantity is None else _step(array, quantity, steps)
        key = (array.tobytes(), least)
        if key not in self._known:
            self._known[key] = len(self.packed)
            n = len(array)
            # evenly spaced numbers, such as most clocks, are the first, the last and their count
            even = np.linspace(array[0], array[-1], n) if n >= 3 and np.isfinite(array).all() else None
            if even is not None and np.abs(array - even).max() <= _UNIFORM * abs(even[1] - even[0]):
                packed = {"k": "even", "n": n, "a": float(array[0]), "b": float(array[-1])}
            elif least is None:
                packed = {"k": "f8", "n": n, "d": _planes(array.astype("<f8"))}
            else:
                packed = _rounded(array, least or 1.0)
            self.packed.append(packed)
        return self._known[key]


def blocks(time: FloatArray, values: FloatArray, most: int = MOST_ROWS) -> tuple[FloatArray, FloatArray]:
    """Times and values of a series (n,) with at most about this number of rows.

    A longer series becomes blocks of equally many rows. Each gives its smallest and its largest finite value, in the
    order in which they occur, at the times of its first and its middle row: every series of a record keeps the same
    times. No peak is lost; it moves by less than a block.
    """
    n = len(time)
    if n <= most:
        return time, values
    width = -(-2 * n // most)
    starts = np.arange(0, n, width)
    low, high = _buckets(np.concatenate([values, np.repeat(values[-1], -n % width)]), width)
    falls = low.argmin(axis=1) > high.argmax(axis=1)
    least, largest = low.min(axis=1), high.max(axis=1)
    pairs = np.stack([np.where(falls, largest, least), np.where(falls, least, largest)], axis=1)
    pairs[~np.isfinite(least)] = np.nan
    times = np.stack([time[starts], time[np.minimum(starts + width // 2, n - 1)]], axis=1)
    return times.ravel(), pairs.ravel()


def decimated(time: FloatArray, values: FloatArray, points: int) -> tuple[FloatArray, FloatArray]:
    """Times and values (m,), m ≤ max(points, 4), that look the same in a figure as all (n,).

    The first and last row stay. The rows between are divided into buckets; of each, the smallest and the largest finite
    value stay at their times, so no peak is lost. Curves with few enough points are returned unchanged.
    """
    n = len(time)
    if n <= max(points, 4):
        return time, values
    width = -(-(n - 2) // max(1, (points - 2) // 2))
    starts = np.arange(1, n - 1, width)
    low, high = _buckets(np.pad(values[1:-1], (0, (2 - n) % width), constant_values=np.nan), width)
    rows = np.unique(np.concatenate([[0, n - 1], starts + low.argmin(axis=1), starts + high.argmax(axis=1)]))
    return time[rows], values[rows]


def _buckets(values: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """The values in rows of this width, twice: what is not finite can be neither the smallest nor the largest."""
    table = values.reshape(-1, width)
    finite = np.isfinite(table)
    return np.where(finite, table, np.inf), np.where(finite, table, -np.inf)


def _step(array: FloatArray, quantity: Quantity, steps: float) -> float:
    finite = array[np.isfinite(array)]
    if not len(finite):
        return 1.0
    low, high = float(finite.min()), float(finite.max())
    # whole numbers, as of flags, stay whole
    if high - low < steps and np.array_equal(finite, np.rint(finite)):
        return 1.0
    resolution = least_span(quantity.unit, quantity.factor * max(abs(low), abs(high)), quantity.least)
    return max((high - low) / steps, resolution / quantity.factor / 8)


def _rounded(array: FloatArray, step: float) -> dict[str, Any]:
    """Whole numbers of steps from the smallest value, as second differences, which are small for smooth curves."""
    finite = np.isfinite(array)
    low = float(array[finite].min()) if finite.any() else 0.0
    # a gap holds the value before it, so that it costs nothing
    last = np.maximum.accumulate(np.where(finite, np.arange(len(array)), 0))
    filled = np.where(np.isfinite(array[last]), array[last], low) if len(array) else array
    steps = np.rint((filled - low) / step).astype(np.int64)
    differences = [steps, np.diff(steps, prepend=0), np.diff(steps, n=2, prepend=[0, 0])]
    # the order whose differences need the fewest bits, about Σ log₂(1 + |d|)
    order = int(np.argmin([np.log2(1.0 + np.abs(difference)).sum() for difference in differences]))
    # zigzag, so that small ones of both signs have empty high bytes
    zigzag = ((differences[order] << 1) ^ (differences[order] >> 63)).astype("<u4")
    edges = np.flatnonzero(np.diff(np.concatenate([[True], finite, [True]])))
    gaps = {"g": edges.tolist()} if len(edges) else {}
    return {"k": "q", "n": len(array), "o": order, "a": low, "s": step, "d": _planes(zigzag), **gaps}


def _planes(numbers: Array) -> str:
    """Their bytes compressed, the lowest of all first."""
    planes = np.ascontiguousarray(numbers.view(np.uint8).reshape(-1, numbers.itemsize).T)
    return base64.b64encode(zlib.compress(planes.tobytes(), _LEVEL)).decode()

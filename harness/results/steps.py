"""Step responses: where a reference steps, and metrics of the response, for one run or many at once."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray

AXES = (
    ("x", "position", 0),
    ("y", "position", 1),
    ("z", "position", 2),
    ("roll", "orientation", 0),
    ("pitch", "orientation", 1),
    ("yaw", "orientation", 2),
)
# The rise is from `LOW` to `HIGH`; a response has settled when it stays within `BAND` of its final value.
LOW, HIGH, BAND = 0.1, 0.9, 0.02
# References closer than this [m, rad], or this share of the largest, count as equal.
_ROUNDING = 1e-9
# The reference of a step has to be constant over this share of the rows at the end.
_REST = 0.1


class Step(NamedTuple):
    """The step of each reference (...)."""

    exists: NDArray[np.bool_]
    first: FloatArray
    last: FloatArray
    start: NDArray[np.intp]  # the row at which the response starts


def step_in(reference: FloatArray) -> Step:
    """The step in each reference (n, ...), from its first value to its last, at which it stays.

    It starts at the row of a jump, or else at the last row at which the reference has its first value.
    """
    n = len(reference)
    first, last = reference[0], reference[-1]
    rounding = _ROUNDING * np.maximum(1.0, np.abs(reference).max(axis=0))
    rest = max(2, math.ceil(_REST * n))
    exists = (np.abs(last - first) > rounding) & ~(np.abs(reference[-rest:] - last).max(axis=0) > rounding)
    start = n - 1 - (np.abs(reference - first) <= rounding)[::-1].argmax(axis=0)
    following = np.take_along_axis(reference, np.minimum(start + 1, n - 1)[None], axis=0)[0]
    # a jump is at the first row with the new value
    return Step(exists, first, last, start + (exists & (np.abs(following - last) <= rounding)))


class StepNumbers(NamedTuple):
    """Metrics of responses from 0 to 1 (...), as in python-control's `step_info`; NaN where undefined."""

    overshoot_percent: FloatArray
    rise_time: FloatArray
    settling_time: FloatArray


def step_numbers(
    time: FloatArray,
    start: NDArray[np.intp],
    highest: FloatArray,
    low: NDArray[np.intp],
    high: NDArray[np.intp],
    settled: NDArray[np.intp],
) -> StepNumbers:
    """Metrics of responses that start at row `start` of `time` (n,), from their largest value and crossings.

    Parameters
    ----------
    highest
        The largest value of each response.
    low, high
        The rows at which they first reach `LOW` and `HIGH`.
    settled
        The row after the last at which they are `BAND` or more from 1; n if that is the last row.
    """
    n = len(time)
    began = time[np.minimum(start, n - 1)]
    rose = highest >= HIGH

    def since(row: NDArray[np.intp]) -> FloatArray:
        return np.asarray(time[np.minimum(row, n - 1)] - began)

    return StepNumbers(
        np.where(rose, 100 * np.maximum(highest - 1, 0.0), 0.0),
        np.where(rose, since(high) - since(low), np.nan),
        np.where(rose & (settled < n), since(settled), np.nan),
    )

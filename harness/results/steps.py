"""Step responses: where a reference steps, and the numbers of a response; of one run, or of many side by side."""

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
# A response has risen from the one to the other of these, and has settled within this of its end.
LOW, HIGH, BAND = 0.1, 0.9, 0.02
# Wanted values closer than this [m, rad], or this share of the largest, are the same.
_ROUNDING = 1e-9
# A step's reference has to rest over this share of the rows at the end.
_REST = 0.1


class Step(NamedTuple):
    """Where references step, for every one of them (...)."""

    exists: NDArray[np.bool_]
    first: FloatArray
    last: FloatArray
    start: NDArray[np.intp]  # the row from which the response counts


def step_in(wanted: FloatArray) -> Step:
    """The step in each reference (n, ...): from its first value to its last one, where it rests.

    It counts from the row of a jump, or from the last row at which the reference is at its first value.
    """
    n = len(wanted)
    first, last = wanted[0], wanted[-1]
    rounding = _ROUNDING * np.maximum(1.0, np.abs(wanted).max(axis=0))
    rest = max(2, math.ceil(_REST * n))
    exists = (np.abs(last - first) > rounding) & ~(np.abs(wanted[-rest:] - last).max(axis=0) > rounding)
    start = n - 1 - (np.abs(wanted - first) <= rounding)[::-1].argmax(axis=0)
    following = np.take_along_axis(wanted, np.minimum(start + 1, n - 1)[None], axis=0)[0]
    # a jump is where the new value is first wanted
    return Step(exists, first, last, start + (exists & (np.abs(following - last) <= rounding)))


class StepNumbers(NamedTuple):
    """Of responses from 0 to 1 (...), as python-control's `step_info` has them; NaN for what is undefined."""

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
    """The numbers of responses that begin at the row `start` of `time` (n,), from what has been seen of them.

    Parameters
    ----------
    highest
        Their largest value.
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

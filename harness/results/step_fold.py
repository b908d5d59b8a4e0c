"""Step responses as a fold over the rows of a run: where a reference steps, and the metrics of the response."""

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.folds import Block, Fold, State
from gough_stewart.harness.report.quantities import ANGLE, LENGTH, PERCENT, TIME
from gough_stewart.harness.results.metric import Metric
from gough_stewart.model.vectors import FloatArray

# Axes of the pose: name, signal, and place in it.
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


def _of_axis(axis: str, signal: str) -> tuple[Metric, ...]:
    """The metrics of a response (y − from)/(to − from), as in python-control's `step_info`."""
    path, pose = f"step_response.{axis}", LENGTH if signal == "position" else ANGLE
    own = (
        Metric(f"{path}.from", f"{axis}: from", pose, "the reference before the step", None, False),
        Metric(f"{path}.to", f"{axis}: to", pose, "the reference after the step", None, False),
        Metric(f"{path}.at", f"{axis}: step at", TIME, "start of the response", None, False),
        Metric(
            *(f"{path}.overshoot_percent", f"{axis}: overshoot", PERCENT),
            *("overshoot in percent of the step; 0 if it did not rise", "smaller"),
        ),
        Metric(f"{path}.rise_time", f"{axis}: rise time", TIME, "from 10 to 90 % of the step"),
        Metric(
            f"{path}.settling_time", f"{axis}: settling time", TIME, "until it stays within 2 % of the step", "smaller"
        ),
        Metric(f"{path}.final_error", f"{axis}: final error", pose, "reference − actual at the end", "smaller"),
    )
    return tuple(each._replace(needs=(signal, f"reference.{signal}")) for each in own)


_OF_AXES = tuple(_of_axis(axis, signal) for axis, signal, _ in AXES)
STEP_METRICS = tuple(metric for each in _OF_AXES for metric in each)


class Steps(Fold):
    """The step responses of the axes on which the reference steps.

    A member that ended early has one if its reference steps in its part of the run as in the whole.

    Parameters
    ----------
    time
        Times of all rows (n,) [s].
    reference
        Reference poses at all rows, (n, 6 or more) or (n, N, 6 or more).
    """

    def __init__(self, time: FloatArray, reference: FloatArray) -> None:
        self._time = time
        # (n, 6, N), or (n, 6, 1) if common to all members
        self._pose = reference[:, :6, None] if reference.ndim == 2 else np.moveaxis(reference[..., :6], -1, 1)
        step = step_in(self._pose)
        self._axes = axes = np.flatnonzero(step.exists.any(axis=1))
        self.needs = tuple(dict.fromkeys(AXES[axis][1] for axis in axes))
        self.metrics = tuple(metric for axis in axes for metric in _OF_AXES[axis])
        self._exists, self._first, self._last = step.exists[axes], step.first[axes], step.last[axes]
        self._start = step.start[axes]
        # without a step, any value but 0 to avoid a division by zero
        self._span = np.where(self._exists, self._last - self._first, 1.0)
        # no member's response starts before the first of these rows, and all have started by the second
        ends = (int(self._start.min()), int(self._start.max())) if axes.size else (0, 0)
        self._begins, self._all_since = ends

    def start(self, members: int) -> State:
        """The largest response; rows: the first at each level, n if none, the one after the last outside the band."""
        size, n = (len(self._axes), members), len(self._time)
        return {
            "pose": np.zeros(size),
            "highest": np.full(size, -np.inf),
            "low": np.full(size, n, dtype=np.intp),
            "high": np.full(size, n, dtype=np.intp),
            "settled": np.zeros(size, dtype=np.intp),
        }

    def rows(self, state: State, block: Block) -> None:
        """Add the responses."""
        first, n, size = block.first, block.rows, state["pose"].shape
        response, none = block.scratch("first", n, *size), len(self._time)
        for j, axis in enumerate(self._axes):
            _, signal, k = AXES[axis]
            response[:, j] = block[signal][:, k]
        state["pose"][...] = response[-1]
        if first + n <= self._begins or not self._axes.size:
            return
        response -= self._first
        response /= self._span
        if first < self._all_since:
            early = np.arange(first, first + n)[:, None, None] < self._start
            response[np.broadcast_to(early, response.shape)] = -np.inf
        np.maximum(state["highest"], np.maximum.reduce(response), out=state["highest"])
        for name, level in (("low", LOW), ("high", HIGH)):
            # most blocks are before or after
            if (state[name] == none).any() and (reached := response >= level).any():
                at = np.where(reached.any(axis=0), first + reached.argmax(axis=0), none)
                np.minimum(state[name], at, out=state[name])
        response -= 1.0
        outside = np.abs(response, out=response) >= BAND
        if outside[-1].all():
            state["settled"][...] = first + n
        elif outside.any():
            after = first + n - outside[::-1].argmax(axis=0)
            np.copyto(state["settled"], after, where=outside.any(axis=0))

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Metrics of the steps by axis; NaN without a step."""
        size = state["pose"].shape
        first, last = np.broadcast_to(self._first, size), np.broadcast_to(self._last, size)
        start = np.broadcast_to(self._start, size)
        exists = self._exists & (rows > 0)
        for n in np.unique(rows[(rows > 0) & (rows < len(self._time))]).tolist():
            of = rows == n
            exists[:, of] &= self._is_same(n, of, last[:, of], start[:, of])

        def since_start(row: NDArray[np.intp]) -> FloatArray:
            # in a part of the run without a step, rows may be beyond its end
            return self._time[np.minimum(np.maximum(row, start), rows - 1)] - began

        highest, settled = state["highest"], np.maximum(state["settled"], start)
        began, rose = self._time[np.minimum(start, rows - 1)], highest >= HIGH
        numbers = (
            first,
            last,
            began,
            np.where(rose, 100 * np.maximum(highest - 1, 0.0), 0.0),
            np.where(rose, since_start(state["high"]) - since_start(state["low"]), np.nan),
            np.where(rose & (settled < rows), since_start(settled), np.nan),
            last - state["pose"],
        )
        by_axis = (values[j] for j in range(len(self._axes)) for values in numbers)
        there = np.repeat(exists, len(numbers), axis=0)
        return {
            metric.path: np.where(has & np.isfinite(values), values, np.nan)
            for metric, has, values in zip(self.metrics, there, by_axis, strict=True)
        }

    def _is_same(self, n: int, of: NDArray[np.bool_], last: FloatArray, start: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the first n rows of the reference of some members have the same steps."""
        pose = self._pose[:n, self._axes]
        part = step_in(pose if pose.shape[2] == 1 else pose[..., of])
        # a constant reference has values that are equal only up to rounding
        near = np.abs(part.last - last) <= 1e-9 * np.maximum(1.0, np.abs(last))
        return cast("NDArray[np.bool_]", part.exists & (part.start == start) & near)

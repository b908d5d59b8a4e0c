"""Step responses as a fold over the rows of a run: where a reference steps, and the metrics of the response."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.folds import State
from gough_stewart.harness.loop.term_folds import AfterLast, First, Given, Largest, Last, Reduction, TermFold
from gough_stewart.harness.report.quantities import ANGLE, LENGTH, PERCENT, TIME
from gough_stewart.harness.results.metric import Metric
from gough_stewart.model.operations import less, reached, where
from gough_stewart.model.vectors import Array, FloatArray

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


def steps_of(time: FloatArray, reference: FloatArray) -> list["StepResponse"]:
    """Folds of the axes on which the reference steps.

    Parameters
    ----------
    time
        Times of all rows (n,) [s].
    reference
        Reference poses at all rows, (n, 6 or more) or (n, N, 6 or more).
    """
    # (n, N), or (n, 1) if common to all members
    each = [np.atleast_2d(reference[..., axis].T).T for axis in range(len(AXES))]
    return [StepResponse(axis, time, own, step) for axis, own in enumerate(each) if (step := step_in(own)).exists.any()]


class StepResponse(TermFold):
    """The response of an axis to the step of its reference.

    A member that ended early has one if its reference steps in its part of the run as in the whole.

    Parameters
    ----------
    axis
        Its place in `AXES`.
    time
        Times of all rows (n,) [s].
    reference
        Of the axis, at all rows (n, N) or (n, 1).
    step
        Its steps (N,) or (1,).
    """

    kernel, sizes = "step_response", {"pose": 1}
    term_sizes: Mapping[str, int] = {"pose": 1, "response": 1, "distance": 1}
    reductions: Mapping[str, Reduction] = {
        "pose": Last("pose"),
        "highest": Largest("response"),
        "low": First("response", reached, LOW),
        "high": First("response", reached, HIGH),
        "settled": AfterLast("distance", reached, BAND),
    }

    def __init__(self, axis: int, time: FloatArray, reference: FloatArray, step: Step) -> None:
        _, signal, place = AXES[axis]
        self.needs, self.begins, self.metrics = (signal,), {"pose": place}, _OF_AXES[axis]
        self._time, self._reference, self._step = time, reference, step
        self.parameters = {
            "from": step.first,
            # without a step, any value but 0 to avoid a division by zero
            "span": np.where(step.exists, step.last - step.first, 1.0),
            "start": step.start.astype(float),
        }

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """The response (y − from)/(to − from), none before the start, and its distance from the end."""
        pose = row["pose"]
        response = where(less(row.index, row.of("start")), -np.inf, (pose - row.of("from")) / row.of("span"))
        yield "pose", pose
        yield "response", response
        yield "distance", np.abs(response - 1.0)

    def result(self, state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Metrics of the step; NaN without one."""
        pose, highest, low, high, settled = (state[name][0] for name in self.reductions)
        first, last, start = (np.broadcast_to(each, rows.shape) for each in self._step[1:])
        exists = self._step.exists & (rows > 0)
        for n in np.unique(rows[(rows > 0) & (rows < len(self._time))]).tolist():
            of = rows == n
            exists[of] &= self._is_same(n, of, last[of], start[of])

        def since_start(row: FloatArray) -> FloatArray:
            # in a part of the run without a step, rows may be beyond its end; of a level that was not reached, infinite
            return self._time[np.minimum(np.maximum(row, start), rows - 1).astype(np.intp)] - began

        began, rose = self._time[np.minimum(start, rows - 1)], highest >= HIGH
        settled = np.maximum(settled, start)
        numbers = (
            first,
            last,
            began,
            np.where(rose, 100 * np.maximum(highest - 1, 0.0), 0.0),
            np.where(rose, since_start(high) - since_start(low), np.nan),
            np.where(rose & (settled < rows), since_start(settled), np.nan),
            last - pose,
        )
        return {
            metric.path: np.where(exists & np.isfinite(values), values, np.nan)
            for metric, values in zip(self.metrics, numbers, strict=True)
        }

    def _is_same(self, n: int, of: NDArray[np.bool_], last: FloatArray, start: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the first n rows of the reference of some members have the same step."""
        part = step_in(self._reference[:n] if self._reference.shape[1] == 1 else self._reference[:n, of])
        # a constant reference has values that are equal only up to rounding
        near = np.abs(part.last - last) <= 1e-9 * np.maximum(1.0, np.abs(last))
        return cast("NDArray[np.bool_]", part.exists & (part.start == start) & near)

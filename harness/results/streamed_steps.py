"""Step responses of many runs at once, computed during the runs."""

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.results.steps import AXES, BAND, HIGH, LOW, StepNumbers, step_in, step_numbers
from gough_stewart.model.vectors import FloatArray

_LEVELS = np.array([LOW, HIGH])[:, None, None]
_NUMBERS = ("from", "to", "at", *StepNumbers._fields, "final_error")


class StreamedSteps:
    """Accumulates the step responses of the axes on which a reference (n, 30) or (n, N, 30) steps."""

    def __init__(self, reference: FloatArray, members: int) -> None:
        self._reference = reference if reference.ndim == 3 else reference[:, None]
        pose = np.moveaxis(self._reference[..., :6], -1, 1)
        step = step_in(pose)
        self._axes = np.flatnonzero(step.exists.any(axis=1))
        # a slice where possible, which needs no copy
        neighbours = len(self._axes) > 0 and self._axes[-1] - self._axes[0] == len(self._axes) - 1
        self._pick = slice(int(self._axes[0]), int(self._axes[-1]) + 1) if neighbours else self._axes
        size = (len(self._axes), members)
        self._exists = np.broadcast_to(step.exists[self._axes], size)
        self._first, self._last = (np.broadcast_to(each[self._axes], size).copy() for each in (step.first, step.last))
        self._start = start = np.broadcast_to(step.start[self._axes], size).copy()
        # without a step, any value but 0 to avoid a division by zero
        self._span = np.where(self._exists, self._last - self._first, 1.0)
        # no member's response starts before the first of these rows, and all have started by the second
        self._begins, self._all_since = (int(start.min()), int(start.max())) if start.size else (0, 0)
        self._pose, self._response = np.zeros(size), np.zeros(size)
        self._highest = np.full(size, -np.inf)
        # number of rows before each level
        self._below, self._is_below = np.full((2, *size), float(self._begins)), np.zeros((2, *size), dtype=bool)
        self._are_rising = True
        self._settled, self._is_outside = np.zeros(size), np.zeros(size, dtype=bool)
        self._gap = np.zeros(size)

    def row(self, k: int, signals: FloatArray) -> None:
        """Add the signals (24, N) of a row."""
        if not len(self._axes):
            return
        self._pose[:] = signals[self._pick]
        if k < self._begins:
            return
        response = self._response
        np.subtract(self._pose, self._first, out=response)
        response /= self._span
        if k < self._all_since:
            response[k < self._start] = -np.inf
        np.maximum(self._highest, response, out=self._highest)
        if self._are_rising:
            np.less(self._highest, _LEVELS, out=self._is_below)
            self._below += self._is_below
            self._are_rising = bool(self._is_below.any())
        np.subtract(response, 1.0, out=self._gap)
        np.abs(self._gap, out=self._gap)
        np.greater_equal(self._gap, BAND, out=self._is_outside)
        np.copyto(self._settled, k + 1.0, where=self._is_outside)

    def state(self) -> dict[str, FloatArray]:
        """The values that change from row to row, members last."""
        return {
            "step_pose": self._pose,
            "step_highest": self._highest,
            "step_below": self._below,
            "step_settled": self._settled,
        }

    def columns(self, rows: NDArray[np.intp], time: FloatArray, state: dict[str, FloatArray]) -> dict[str, FloatArray]:
        """Metrics of members with these numbers of rows, for the times of the whole run; NaN without a step."""
        numbers = np.full((len(_NUMBERS), *self._first.shape), np.nan)
        for n in np.unique(rows[rows > 0]).tolist():
            of = np.flatnonzero(rows == n)
            exists, start = self._exists[:, of], self._start[:, of]
            if n < len(time):
                exists = exists & self._is_same(n, of)
            settled = np.maximum(state["step_settled"][:, of].astype(np.intp), start)
            low, high = np.maximum(state["step_below"][..., of].astype(np.intp), start)
            found = step_numbers(time[:n], start, state["step_highest"][:, of], low, high, settled)
            at = time[np.minimum(start, n - 1)]
            last = self._last[:, of]
            of_steps = (self._first[:, of], last, at, *found, last - state["step_pose"][:, of])
            for k, each in enumerate(of_steps):
                numbers[k][:, of] = np.where(exists, each, np.nan)
        return {
            f"step_response.{AXES[axis][0]}.{name}": numbers[k, j]
            for j, axis in enumerate(self._axes)
            for k, name in enumerate(_NUMBERS)
        }

    def _is_same(self, n: int, of: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether the first n rows of the reference have the same steps."""
        reference = self._reference[:n] if self._reference.shape[1] == 1 else self._reference[:n, of]
        part = step_in(np.moveaxis(reference[..., self._axes], -1, 1))
        # a constant reference has values that are equal only up to rounding
        near = np.abs(part.last - self._last[:, of]) <= 1e-9 * np.maximum(1.0, np.abs(self._last[:, of]))
        return np.asarray(part.exists & (part.start == self._start[:, of]) & near)

"""Metrics of many runs at once, computed during the runs: the numbers of `metrics` without any record."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.observing import Row
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.results.streamed_columns import (
    BOUNDS,
    FV,
    FV_BEFORE,
    LONG,
    NORMS,
    SHORT,
    SIZE,
    SUMMED,
    E,
    F,
    V,
    columns_of,
)
from gough_stewart.harness.results.streamed_steps import StreamedSteps
from gough_stewart.model.vectors import FloatArray

_LARGEST = np.finfo(float).max
# Errors need no check of their own: where one is not finite, a norm or a length is not.
_CHECKED = slice(NORMS.start, SIZE)


class Merit:
    """A loop observer that accumulates what the metrics of each member need.

    The results equal `gough_stewart.harness.results.metrics.metrics` of each member's record, to rounding, by path,
    with one number for all legs or axes as in `flattened`. A member's rows end where it stops running, or before the
    first row that is not finite. A member that ended early has a step response if its reference steps in its part of
    the run as in the whole.

    Arrays have members on their last axis, and each row takes a fixed number of passes over them, without allocation.

    Parameters
    ----------
    loop
        The loop to be run.
    platform
        Limits of the nominal platform by name: a number, or one per member (N,); None or left out for no limit.
    members
        Number of members; 1 for a loop without leading axes.
    """

    def __init__(self, loop: Loop, platform: Mapping[str, Any], members: int = 1) -> None:
        self._loop = loop
        self._platform = {name: value for name, value in platform.items() if value is not None}
        self._steps = None if loop.reference is None else StreamedSteps(loop.reference, members)
        self._rows = np.zeros(members, dtype=np.intp)
        self._running, self._n_running = np.ones(members, dtype=bool), members
        self._k = 0

        def zeros(size: int) -> FloatArray:
            return np.zeros((size, members))

        self._latest, self._reference = b"", zeros(12)
        # values of this row and of the next; they swap once it is known which members are still running
        self._present, self._next = zeros(SIZE), zeros(SIZE)
        self._peak, self._total = np.full((SIZE, members), -np.inf), zeros(SUMMED)  # the sum lacks the present row
        self._force, self._work, self._net, self._absolute = zeros(6), zeros(6), zeros(6), zeros(6)
        self._flags, self._limited, self._any_limited = np.zeros((12, members), dtype=bool), zeros(12), zeros(2)
        self._stroke = tuple(np.broadcast_to(np.asarray(each, dtype=float), members) for each in loop.limits.stroke)
        self._is_stroke_left, self._beyond, self._any_beyond = False, zeros(6), zeros(1)
        self._first = np.full((len(BOUNDS), members), np.inf)  # row in which a limit was first exceeded
        # a value beyond its bound exceeds a limit, or is not finite, for the first time
        self._bounds = np.full((SIZE, members), _LARGEST)
        for name, parts in BOUNDS:
            for part in parts if name in self._platform else ():
                self._bounds[part] = np.asarray(self._platform[name], dtype=float) ** 2
        self._bounds[LONG], self._bounds[SHORT] = np.minimum(self._stroke[1], _LARGEST), -self._stroke[0]
        self._within: BoolArray = np.ones((SIZE, members), dtype=bool)
        self._n_within = self._within[_CHECKED].size
        self._final: dict[str, NDArray[Any]] | None = None

    def row(self, row: Row) -> None:
        """Add a row of all members that are still running."""
        signals, forces = _members_last(row.signals), _members_last(row.inputs)[:6]
        running = int(np.count_nonzero(row.running))
        if running != self._n_running:
            self._end(self._running & ~row.running)
            self._n_running = running
        with np.errstate(all="ignore"):
            self._take(signals, forces, row.reference)
            # false for NaN and infinite values
            np.less_equal(self._next[_CHECKED], self._bounds[_CHECKED], out=self._within[_CHECKED])
            if np.count_nonzero(self._within[_CHECKED]) != self._n_within:
                self._look_closer()
            self._go_on(signals[12:18], forces)
            self._flags[:6], self._flags[6:] = _members_last(row.force_limited), _members_last(row.rate_limited)
            if self._steps is not None:
                self._steps.row(self._k, signals)
        self._k += 1

    def columns(self) -> dict[str, FloatArray]:
        """All metrics (N,) by path, after the last row; NaN where undefined."""
        state = self._state()
        if self._final is not None:
            state = {name: np.where(self._running, values, self._final[name]) for name, values in state.items()}
        rows = np.where(self._running, self._k, self._rows)
        with np.errstate(all="ignore"):
            found = columns_of(state, rows, self._loop, self._platform)
            if self._steps is not None:
                found |= self._steps.columns(rows, self._loop.timing.times, state)
        return found

    def _take(self, signals: FloatArray, forces: FloatArray, reference: FloatArray | None) -> None:
        """Store the values of the next row."""
        after, lengths, velocities = self._next, signals[12:18], signals[18:24]
        if reference is not None:
            # a reference is often constant, and the same for all members
            latest = reference.tobytes() if reference.ndim == 1 else b""
            if latest != self._latest or not latest:
                columns, self._latest = _members_last(reference), latest
                self._reference[:6], self._reference[6:] = columns[:6], columns[12:18]
        np.subtract(self._reference[:6], signals[:6], out=after[:6])
        np.subtract(self._reference[6:], lengths, out=after[6:12])
        np.multiply(after[E], after[E], out=after[E])
        np.add.reduce(after[:6].reshape(2, 3, -1), axis=1, out=after[NORMS])
        np.multiply(forces, forces, out=after[F])
        np.multiply(velocities, velocities, out=after[V])
        np.multiply(after[F], after[V], out=after[FV])
        np.multiply(self._present[F], after[V], out=after[FV_BEFORE])
        after[LONG] = lengths
        np.negative(lengths, out=after[SHORT])

    def _go_on(self, lengths: FloatArray, forces: FloatArray) -> None:
        """Add the next row for all members, also those that have ended: their results are stored already."""
        np.maximum(self._peak, self._next, out=self._peak)
        if self._k:
            self._total += self._present[:SUMMED]
            np.subtract(lengths, self._present[LONG], out=self._work)
            self._work *= self._force
            self._net += self._work
            np.abs(self._work, out=self._work)
            self._absolute += self._work
            if np.count_nonzero(self._flags):
                self._limited += self._flags
                self._any_limited += self._flags.reshape(2, 6, -1).any(axis=1)
        self._force[:] = forces
        if self._is_stroke_left:
            beyond = (lengths < self._stroke[0]) | (lengths > self._stroke[1])
            self._beyond += beyond
            self._any_beyond += beyond.any(axis=0)
        self._present, self._next = self._next, self._present

    def _look_closer(self) -> None:
        """Handle values beyond their bound for the first time: over a limit, or not finite."""
        broken = self._running & ~np.isfinite(self._next).all(axis=0)
        if broken.any():
            self._end(broken)
            # ended members trigger no more
            self._bounds[:, broken] = np.nan
            self._n_within -= (SIZE - NORMS.start) * int(np.count_nonzero(broken))
            self._within[:, broken] = True
        for part in (LONG, SHORT):
            self._is_stroke_left |= not self._within[part].all()
        for k, (_, parts) in enumerate(BOUNDS):
            for part in parts:
                # this power is of the end of the previous row, and counts for that row
                at = self._k - 1 if part is FV_BEFORE else self._k
                beyond = ~self._within[part].all(axis=0) & self._running
                self._first[k] = np.where(beyond, np.minimum(self._first[k], at), self._first[k])
        self._bounds[_CHECKED][~self._within[_CHECKED] & ~np.isnan(self._bounds[_CHECKED])] = _LARGEST

    def _end(self, members: BoolArray) -> None:
        """Store the results of members that end here, before the next row is added."""
        if not members.any():
            return
        if self._final is None:
            self._final = {name: np.zeros_like(values) for name, values in self._state().items()}
        for name, values in self._state().items():
            self._final[name][..., members] = values[..., members]
        self._rows[members] = self._k
        self._running &= ~members

    def _state(self) -> dict[str, NDArray[Any]]:
        """The accumulated values by name, members last."""
        names = ("present", "peak", "total", "net", "absolute", "flags", "limited", "any_limited", "beyond")
        state = {name: getattr(self, f"_{name}") for name in (*names, "any_beyond", "first")}
        return state if self._steps is None else state | self._steps.state()


def _members_last(values: NDArray[Any]) -> NDArray[Any]:
    """(N, size) as (size, N), or (size,) as (size, 1)."""
    return values[:, None] if values.ndim == 1 else values.T

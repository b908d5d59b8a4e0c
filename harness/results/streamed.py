"""Figures of merit of many runs at once, while they go on: the numbers of `metrics`, and no record of any run."""

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
# Errors are not looked at for themselves: where they are not finite, norms or lengths are not.
_CHECKED = slice(NORMS.start, SIZE)


class Merit:
    """An observer of a loop that keeps, of every member, what its figures of merit are made of.

    Its numbers are those of `gough_stewart.harness.results.metrics.metrics` of each member's record, to rounding,
    under their paths, one number of the legs and axes as `flattened` has it. A member's rows end where it is no longer
    running, or before the first row that is not finite. Of a member that ended early a step response is known if its
    reference steps in the whole run as in its part.

    All is kept with members last in memory, and every row costs a fixed number of passes over arrays that are there.

    Parameters
    ----------
    loop
        What will be run.
    platform
        Limits that the designer believes in, by name, a number or one for each member (N,); None or left out for none.
    members
        How many there are; 1 for a loop without leading axes.
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
        # of this row and of the next, which becomes the present one when it is known who has it
        self._present, self._next = zeros(SIZE), zeros(SIZE)
        self._peak, self._total = np.full((SIZE, members), -np.inf), zeros(SUMMED)  # the sum lacks the present row
        self._force, self._work, self._net, self._absolute = zeros(6), zeros(6), zeros(6), zeros(6)
        self._flags, self._limited, self._any_limited = np.zeros((12, members), dtype=bool), zeros(12), zeros(2)
        self._stroke = tuple(np.broadcast_to(np.asarray(each, dtype=float), members) for each in loop.limits.stroke)
        self._is_stroke_left, self._beyond, self._any_beyond = False, zeros(6), zeros(1)
        self._first = np.full((len(BOUNDS), members), np.inf)  # row in which a limit was first exceeded
        # beyond these something happens for the first time
        self._bounds = np.full((SIZE, members), _LARGEST)
        for name, parts in BOUNDS:
            for part in parts if name in self._platform else ():
                self._bounds[part] = np.asarray(self._platform[name], dtype=float) ** 2
        self._bounds[LONG], self._bounds[SHORT] = np.minimum(self._stroke[1], _LARGEST), -self._stroke[0]
        self._within: BoolArray = np.ones((SIZE, members), dtype=bool)
        self._n_within = self._within[_CHECKED].size
        self._final: dict[str, NDArray[Any]] | None = None

    def row(self, row: Row) -> None:
        """One more row of all members that are still running."""
        signals, forces = _members_last(row.signals), _members_last(row.inputs)[:6]
        running = int(np.count_nonzero(row.running))
        if running != self._n_running:
            self._end(self._running & ~row.running)
            self._n_running = running
        with np.errstate(all="ignore"):
            self._take(signals, forces, row.reference)
            # false of NaN, and of what is infinite
            np.less_equal(self._next[_CHECKED], self._bounds[_CHECKED], out=self._within[_CHECKED])
            if np.count_nonzero(self._within[_CHECKED]) != self._n_within:
                self._look_closer()
            self._go_on(signals[12:18], forces)
            self._flags[:6], self._flags[6:] = _members_last(row.force_limited), _members_last(row.rate_limited)
            if self._steps is not None:
                self._steps.row(self._k, signals)
        self._k += 1

    def columns(self) -> dict[str, FloatArray]:
        """Every figure of merit by its path (N,); NaN for what is undefined. After the last row."""
        state = self._state()
        if self._final is not None:
            state = {name: np.where(self._running, values, self._final[name]) for name, values in state.items()}
        rows = np.where(self._running, self._k, self._rows)
        with np.errstate(all="ignore"):
            found = columns_of(state, rows, self._loop, self._platform)
            if self._steps is not None:
                found |= self._steps.columns(rows, self._loop.timing.times, state)
        return found

    def _take(self, signals: FloatArray, forces: FloatArray, wanted: FloatArray | None) -> None:
        """The numbers of the next row."""
        after, lengths, velocities = self._next, signals[12:18], signals[18:24]
        if wanted is not None:
            # much of the time a reference rests, and is the same for all
            latest = wanted.tobytes() if wanted.ndim == 1 else b""
            if latest != self._latest or not latest:
                reference, self._latest = _members_last(wanted), latest
                self._reference[:6], self._reference[6:] = reference[:6], reference[12:18]
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
        """Add the next row for all, also for those that have ended: their numbers are kept elsewhere."""
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
        """Some number is beyond its bound for the first time: that of a limit, or what is finite."""
        broken = self._running & ~np.isfinite(self._next).all(axis=0)
        if broken.any():
            self._end(broken)
            # nothing is within these, from now on
            self._bounds[:, broken] = np.nan
            self._n_within -= (SIZE - NORMS.start) * int(np.count_nonzero(broken))
            self._within[:, broken] = True
        for part in (LONG, SHORT):
            self._is_stroke_left |= not self._within[part].all()
        for k, (_, parts) in enumerate(BOUNDS):
            for part in parts:
                # what was beyond at the end of the row before belongs to that row
                at = self._k - 1 if part is FV_BEFORE else self._k
                beyond = ~self._within[part].all(axis=0) & self._running
                self._first[k] = np.where(beyond, np.minimum(self._first[k], at), self._first[k])
        self._bounds[_CHECKED][~self._within[_CHECKED] & ~np.isnan(self._bounds[_CHECKED])] = _LARGEST

    def _end(self, members: BoolArray) -> None:
        """Keep the numbers of members that go on no longer, before the next row is added to them."""
        if not members.any():
            return
        if self._final is None:
            self._final = {name: np.zeros_like(values) for name, values in self._state().items()}
        for name, values in self._state().items():
            self._final[name][..., members] = values[..., members]
        self._rows[members] = self._k
        self._running &= ~members

    def _state(self) -> dict[str, NDArray[Any]]:
        """What makes the numbers, by name, members last."""
        names = ("present", "peak", "total", "net", "absolute", "flags", "limited", "any_limited", "beyond")
        state = {name: getattr(self, f"_{name}") for name in (*names, "any_beyond", "first")}
        return state if self._steps is None else state | self._steps.state()


def _members_last(values: NDArray[Any]) -> NDArray[Any]:
    """(size, N) of (N, size), or (size, 1) of (size,)."""
    return values[:, None] if values.ndim == 1 else values.T

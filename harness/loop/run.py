"""A run with its complete history, row by row."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import LawFrom
from gough_stewart.harness.loop.loop import LENGTHS, Loop
from gough_stewart.harness.loop.observe import observe
from gough_stewart.harness.loop.observing import Observer, Row, Sampled
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import members, signals
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model import interface
from gough_stewart.model.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Run:
    """The history of a run up to its end, by row; the controller's by sample.

    With many members, arrays have the member axis after that of time, such as (n, N, 12). After a member has ended,
    its rows repeat the last state.
    """

    time: FloatArray  # (n,)
    results: FloatArray  # (n, N_RESULTS)
    inputs: FloatArray  # (n, 12)
    rate_limited: BoolArray  # (n, 6)
    stroke_exceeded: BoolArray  # (n, 6)
    sample_of_row: NDArray[np.intp]  # (n,), the last sample at or before each row
    measured: FloatArray  # (m, 24); of many members only the signals that controllers use
    command: FloatArray  # (m, 6), before limits
    controller_state: FloatArray  # (m, n_states), before the command was computed
    force_limited: BoolArray  # (m, 6)
    outcomes: tuple[Outcome, ...]  # one per member
    used: tuple[str, ...] = ()  # the measured signals that controllers use

    @property
    def outcome(self) -> Outcome:
        """The outcome of a single run."""
        (only,) = self.outcomes
        return only

    def of_member(self, member: int) -> "Run":
        """The history of one of many members, up to its end."""
        outcome = self.outcomes[member]
        # half a row later than its end, since times are rounded
        rows = np.searchsorted(self.time, outcome.time + (self.time[1] if len(self.time) > 1 else 1.0) / 2)
        by_member = self.sample_of_row if self.sample_of_row.ndim == 1 else self.sample_of_row[:, member]
        return replace(
            self,
            time=self.time[:rows],
            results=np.ascontiguousarray(self.results[:rows, member]),
            inputs=self.inputs[:rows, member],
            rate_limited=self.rate_limited[:rows, member],
            stroke_exceeded=self.stroke_exceeded[:rows, member],
            sample_of_row=by_member[:rows],
            measured=self.measured[:, member],
            command=self.command[:, member],
            controller_state=self.controller_state[:, member],
            force_limited=self.force_limited[:, member],
            outcomes=(outcome,),
        )


def simulate(plant: Plant, law_from: LawFrom | None, loop: Loop, progress: TimeProgress | None = None) -> Run:
    """`observe` with a complete history."""
    is_alone = not getattr(plant, "shape", ())
    everything = _Everything(plant, loop)
    run = everything.run(observe(plant, law_from, loop, everything, progress))
    return run.of_member(0) if is_alone else run


class _Everything(Observer):
    def __init__(self, plant: Plant, loop: Loop) -> None:
        shape: tuple[int, ...] = getattr(plant, "shape", ()) or (1,)
        self._plant, self._loop, self._shape = plant, loop, shape
        n, self._m = loop.timing.steps + 1, len(loop.timing.samples)
        self._rows: int  # so far
        self._results = members.zeros(shape, interface.size_of(interface.RESULTS), n)
        self._inputs = members.zeros(shape, interface.size_of(interface.INPUTS), n)
        self._rate_limited = members.flags(shape, 6, n)
        self._measured = members.zeros(shape, signals.SIZE, self._m)
        self._command = members.zeros(shape, 6, self._m)
        self._force_limited = members.flags(shape, 6, self._m)
        # of the controllers, known from their first sample on, in the first row
        self._state: FloatArray
        self._used: tuple[str, ...]

    def row(self, row: Row) -> None:
        # evaluated again: accelerations and joint forces under the forces that act from now on
        k = row.k
        self._results[k] = self._plant.results()
        self._inputs[k] = row.inputs
        self._rate_limited[k] = row.rate_limited
        self._rows = k + 1
        if row.sampled is not None:
            self._sample(row.sampled)

    def _sample(self, sampled: Sampled) -> None:
        j = sampled.j
        if j == 0:
            self._used = sampled.used
            self._state = members.zeros(self._shape, sampled.state.shape[-1], self._m)
        if sampled.due is None:
            self._measured[j], self._state[j] = sampled.measured, sampled.state
            self._command[j], self._force_limited[j] = sampled.command, sampled.force_limited
            return
        whose = sampled.due[:, None]
        np.copyto(self._measured[j], sampled.measured, where=whose)
        np.copyto(self._state[j], sampled.state, where=whose)
        np.copyto(self._command[j], sampled.command, where=whose)
        np.copyto(self._force_limited[j], sampled.force_limited, where=whose)

    def run(self, outcomes: tuple[Outcome, ...]) -> Run:
        """The history so far."""
        timing, rows = self._loop.timing, self._rows
        return Run(
            timing.times[:rows],
            self._results[:rows],
            self._inputs[:rows],
            self._rate_limited[:rows],
            self._loop.limits.beyond_stroke(self._results[:rows][..., LENGTHS]),
            _samples_of_rows(timing)[:rows],
            self._measured,
            self._command,
            self._state,
            self._force_limited,
            outcomes,
            self._used,
        )


def _samples_of_rows(timing: Timing) -> NDArray[np.intp]:
    """The last sample at or before each row (n,), or (n, N) where members differ."""
    rows, all_rows = timing.rows_of_samples, np.arange(timing.steps + 1)
    if rows.ndim == 1:
        return np.searchsorted(rows, all_rows, side="right") - 1
    return np.stack([np.searchsorted(each, all_rows, side="right") - 1 for each in rows.T], axis=-1)

"""A run with its complete history, row by row."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws_of_members import LawFrom
from gough_stewart.harness.loop.loop import LENGTHS, Loop
from gough_stewart.harness.loop.observe import observe
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.loop.rows import AllRows, Observer, Rows
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model.process.progress import TimeProgress
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
    host: str = "Python"  # what ran the loop, see `Rows`

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
    history = _History()
    outcomes = observe(plant, law_from, loop, history, progress)
    rows, timing = history.rows, loop.timing
    k = slice(1, history.count + 1)
    results = _of_members(rows.results[k])
    run = Run(
        timing.times[: history.count],
        results,
        _of_members(rows.inputs[k]),
        _of_members(rows.rate_limited[k]),
        loop.limits.beyond_stroke(results[..., LENGTHS]),
        samples_of_rows(timing)[: history.count],
        _of_members(rows.measured),
        _of_members(rows.command),
        _of_members(rows.state),
        _of_members(rows.limited),
        outcomes,
        rows.used,
        rows.host,
    )
    return run if getattr(plant, "shape", ()) else run.of_member(0)


def _of_members(rows: NDArray[Any]) -> NDArray[Any]:
    """(n, N, size) of rows (n, size, N)."""
    return np.moveaxis(rows, 1, 2)


class _History(Observer):
    """Keeps all rows."""

    rows: AllRows
    count = 0

    def start(self, timing: Timing, plant: Plant, members: int) -> Rows:
        self.rows = AllRows(timing, members, plant)
        return self.rows

    def block(self, rows: Rows) -> None:
        self.count = int(rows.counting.max())


def samples_of_rows(timing: Timing) -> NDArray[np.intp]:
    """The last sample at or before each row (n,), or (n, N) where members differ."""
    rows, all_rows = timing.rows_of_samples, np.arange(timing.steps + 1)
    if rows.ndim == 1:
        return np.searchsorted(rows, all_rows, side="right") - 1
    return np.stack([np.searchsorted(each, all_rows, side="right") - 1 for each in rows.T], axis=-1)

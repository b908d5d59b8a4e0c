"""How runs end: each member by itself, at its time and for its cause."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.plants.plant import BoolArray

Status = Literal["completed", "diverged", "stopped", "interrupted"]


class Outcome(NamedTuple):
    """How a run ended."""

    status: Status
    time: float  # [s]
    cause: str | None


class Outcomes:
    """Of a run, or of each of many members, while they go on."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._found: dict[int, Outcome] = {}
        self.time: float | None = None  # of the latest row; None before the first
        self.going = np.ones(shape, dtype=bool)  # who has no outcome yet
        self.running = np.ones(shape, dtype=bool)  # for whom the present row counts
        self.all_go = True
        self._before, self._ended_now = self.going.copy(), False

    def end(
        self,
        whose: BoolArray | np.bool_ | bool,
        status: Status,
        cause: str | Callable[[int], str],
        *,
        time: float | None = None,
        counts: bool = True,
    ) -> None:
        """For these members, as far as they still go on, at a time [s], that of the latest row by default.

        The present row is their last one, or where it does not count none of theirs.
        """
        at = (self.time or 0.0) if time is None else time
        ends = self.going & whose
        if not ends.any():
            return
        for member in np.flatnonzero(ends).tolist():
            words = cause if isinstance(cause, str) else cause(member)
            self._found[member] = Outcome(status, at, words)
        self.going[...] &= ~ends
        if not counts:
            self.running[...] &= ~ends
        self.all_go, self._ended_now = False, True

    def only(self, member: int) -> BoolArray:
        """That member as a mask."""
        return np.asarray(np.arange(self.going.size).reshape(self._shape) == member)

    def end_of_row(self) -> BoolArray | None:
        """Who has ended since the last time, None for nobody; from here on rows do not count for them."""
        if not self._ended_now:
            return None
        ended: BoolArray = self._before & ~self.going
        self.running[...] = self._before[...] = self.going
        self._ended_now = False
        return ended

    def at_last(self, time: float) -> tuple[Outcome, ...]:
        """Of all, at the end of the run [s]."""
        completed = Outcome("completed", time, None)
        return tuple(self._found.get(member, completed) for member in range(self.going.size))

"""How runs end: the time and cause of each member."""

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
    """The outcomes of a run, or of many members, so far."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._found: dict[int, Outcome] = {}
        self.time: float | None = None  # of the latest row; None before the first
        self.going = np.ones(shape, dtype=bool)  # members without an outcome
        self.running = np.ones(shape, dtype=bool)  # members for which the present row counts
        self.all_go = True
        self._ended_now = False

    def end(
        self,
        whose: BoolArray | np.bool_ | bool,
        status: Status,
        cause: str | Callable[[int], str],
        *,
        time: float | None = None,
        counts: bool = True,
    ) -> None:
        """End those of these members that still run, at a time [s], by default that of the latest row.

        The present row is their last one; if it does not count, the one before.
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
        """A mask of one member."""
        return np.asarray(np.arange(self.going.size).reshape(self._shape) == member)

    def end_of_row(self) -> BoolArray | None:
        """Members that have ended so far, None if none has since the last call; later rows do not count for them."""
        if not self._ended_now:
            return None
        self.running[...] = self.going
        self._ended_now = False
        return ~self.going

    def at_last(self, time: float) -> tuple[Outcome, ...]:
        """The outcomes of all members at the end of the run [s]."""
        completed = Outcome("completed", time, None)
        return tuple(self._found.get(member, completed) for member in range(self.going.size))

"""How runs end: the time and cause of each member."""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray

Status = Literal["completed", "diverged", "stopped", "interrupted"]


class Outcome(NamedTuple):
    """How a run ended."""

    status: Status
    time: float  # [s]
    cause: str | None


class Outcomes:
    """The outcomes of N members so far, in a run with rows at these times [s].

    Attributes
    ----------
    rows
        Number of rows so far.
    counting
        How many rows count for each member (N,).
    going, all_go
        Members without an outcome (N,); whether all are.
    ended_now
        Whether some have ended since this was set to False.
    """

    def __init__(self, members: int, times: FloatArray) -> None:
        self._times, self._found = times, dict[int, Outcome]()
        self._before_limits = set[int]()  # members that ended before their last row was checked
        self.rows = 0
        self.counting = np.full(members, len(times))
        self.going = np.ones(members, dtype=bool)
        self.all_go, self.ended_now = True, False

    def end(
        self,
        whose: BoolArray | np.bool_ | bool,
        status: Status,
        cause: str | Callable[[int], str],
        *,
        at_next: bool = False,
    ) -> None:
        """End those of these members that still run, at the latest row; or at the next one, before it is checked."""
        for member in np.flatnonzero(self.going & whose).tolist():
            self._put(member, status, cause if isinstance(cause, str) else cause(member), self.rows + at_next)
            if at_next:
                self._before_limits.add(member)

    def end_after(self, member: int, rows: int, status: Status, cause: str) -> None:
        """End a member that still runs after a number of rows."""
        if self.going[member]:
            self._put(member, status, cause, rows)

    def end_at_limit(self, member: int, rows: int, status: Status, cause: str) -> None:
        """End a member after a number of rows, the last of which is beyond a limit, if nothing ended it before."""
        before = self.counting[member]
        if rows < before or (rows == before and member not in self._before_limits):
            self._put(member, status, cause, rows)
            self._before_limits.add(member)

    def _put(self, member: int, status: Status, cause: str, rows: int) -> None:
        self._found[member] = Outcome(status, float(self._times[max(rows - 1, 0)]), cause)
        self.counting[member] = rows
        self.going[member] = self.all_go = False
        self.ended_now = True

    def only(self, member: int) -> BoolArray:
        """A mask of one member."""
        return np.asarray(np.arange(self.going.size) == member)

    def at_last(self) -> tuple[Outcome, ...]:
        """The outcomes of all members at the end of the run."""
        completed = Outcome("completed", float(self._times[-1]), None)
        return tuple(self._found.get(member, completed) for member in range(self.going.size))

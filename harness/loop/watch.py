"""The limits of a run, watched row by row; rows that have been checked go on to the observer."""

import numpy as np

from gough_stewart.harness.loop.loop import LENGTHS, Limits, Loop
from gough_stewart.harness.loop.outcomes import Outcomes
from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.plants import members, signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.interface import BY_NAME
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray


class Watch:
    """Ends members at their first row beyond a limit, and passes blocks of rows to the observer.

    `every` is the number of rows between checks: 1 where code of the user runs, which must not go on after an end.
    """

    def __init__(self, loop: Loop, rows: Rows, observer: Observer, outcomes: Outcomes) -> None:
        self.rows, self.outcomes, self.observer = rows, outcomes, observer
        self._limits = loop.limits
        self._wanted = loop.reference_rows
        self._checked = 0  # rows of the run
        self.every = 1

    def row(self, now: FloatArray, acting: FloatArray, force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row; see `Rows.add`."""
        self.rows.add(now, acting, force_limited, rate_limited)
        self.outcomes.rows += 1
        if self.outcomes.rows % self.every == 0:
            self.check()
            if self.rows.count + self.every > self.rows.most:
                self.pass_on()

    def plant_at(self, now: FloatArray, at_motors: FloatArray) -> None:
        """Keep the motors of the next row, and end members there whose plant gives no numbers, or too large ones.

        Signals (N, 24), and the same with the legs' at the motors' side.
        """
        # of rigid legs both sides are the same array
        given = now if at_motors is now else np.concatenate([now, at_motors[:, signals.LEGS]], axis=1)
        if self.rows.motors.size:
            self.rows.motors[self.rows.count + 1] = given.T[signals.SIZE :]
        if members.all_below(given.T, LARGEST_NUMBER):
            return
        broken = ~(np.abs(given) <= LARGEST_NUMBER)
        names = [*signals.NAMES, *signals.AT_MOTORS.values()]

        def cause(k: int) -> str:
            at = int(broken[k].argmax())
            column = signals.column_names(names)[at]
            return f"the plant gave {column} = {given[k, at]:g} {BY_NAME[column.partition('[')[0]].unit}"

        self.outcomes.end(broken.any(axis=1), "diverged", cause, at_next=True)

    def finish(self) -> None:
        """Check all rows, and pass them on."""
        self.check()
        self.pass_on()

    def has_checked(self) -> None:
        """The rows so far have been checked by somebody else, who calls `end_beyond`."""
        self._checked = self.outcomes.rows

    def end_beyond(self, k: int, row: int, now: FloatArray, *, stroke: bool) -> None:
        """End member k at a row with these signals (24,), beyond its stroke, or too far from the reference."""
        if stroke:
            lengths, low_high = now[LENGTHS], [members.of(each, k) for each in self._limits.stroke]
            beyond = (lengths < low_high[0]) | (lengths > low_high[1])
            self.outcomes.end_after(k, row + 1, "stopped", _beyond_stroke(self._limits, lengths, beyond, k))
        elif self._wanted is not None:
            wanted = self._wanted[row, :3, k if self._wanted.shape[2] > 1 else 0]
            self.outcomes.end_after(k, row + 1, "diverged", self._too_far(float(np.linalg.norm(wanted - now[:3])), k))

    def _too_far(self, error: float, k: int) -> str:
        limit = members.of(self._limits.largest_position_error, k)
        return f"the platform is {error:.3g} m from its reference; the limit is {limit:g} m"

    def check(self) -> None:
        """Check the new rows."""
        rows, first, last = self.rows, self._checked, self.outcomes.rows
        if last > first:
            self._checked = last
            with np.errstate(all="ignore"):  # members that have ended may compute NaN
                self._check(first, rows.signals[first - rows.first + 1 : last - rows.first + 1])

    def pass_on(self) -> None:
        """Give the rows since the last call to the observer."""
        rows = self.rows
        if rows.count:
            rows.counting = np.clip(self.outcomes.counting - rows.first, 0, rows.count)
            self.observer.block(rows)
            rows.clear()

    def _check(self, first: int, now: FloatArray) -> None:
        """Signals (rows, 24, N) from a row on."""
        limits, bound, end = self._limits, self._limits.largest_position_error, self.outcomes.end_at_limit
        may_end = self.outcomes.counting > first
        if limits.on_stroke == "stop":
            lengths = now[:, LENGTHS].swapaxes(1, 2)  # (rows, N, 6)
            beyond = limits.beyond_stroke(lengths)
            for row, k in _first_of_members(beyond.any(axis=-1) & may_end):
                end(k, first + row + 1, "stopped", _beyond_stroke(limits, lengths[row, k], beyond[row, k], k))
        if self._wanted is None:
            return
        gap = self._wanted[first : first + len(now), :3] - now[:, :3]
        if members.all_below(gap, float(np.min(bound))):
            return
        x, y, z = gap.swapaxes(0, 1)
        error = np.sqrt(x * x + y * y + z * z)
        for row, k in _first_of_members(~np.less_equal(error, bound) & may_end):  # also true for NaN
            end(k, first + row + 1, "diverged", self._too_far(error[row, k], k))


def _first_of_members(beyond: BoolArray) -> list[tuple[int, int]]:
    """The first row of each member at which it is beyond (rows, N), and the member."""
    return [(int(beyond[:, k].argmax()), k) for k in np.flatnonzero(beyond.any(axis=0)).tolist()]


def _beyond_stroke(limits: Limits, lengths: FloatArray, beyond: BoolArray, k: int) -> str:
    """The message for a member's first leg beyond its stroke."""
    leg = int(beyond.argmax())
    low, high = (members.of(each, k) for each in limits.stroke)
    return f"leg {leg + 1} is {lengths[leg]:.6g} m long; its stroke is {low:g} to {high:g} m"

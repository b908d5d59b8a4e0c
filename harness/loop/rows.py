"""The rows of a run: how they are kept, checked against limits, and passed on in blocks; and how members end."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.loop import LENGTHS, Loop, members_last
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model import interface
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# Rows times members in a block, and the fewest rows. Smaller blocks cost calls, larger ones no longer fit into the
# processor's cache.
BLOCK_SIZE, _FEWEST = 8192, 16

Status = Literal["completed", "diverged", "stopped", "interrupted"]


class Outcome(NamedTuple):
    """How a run ended."""

    status: Status
    time: float  # [s]
    cause: str | None


class RowBlock:
    """A block of consecutive rows of N members: arrays (rows + 1, size, N), after the last row of the block before.

    Signals have the size 24, forces, which act from the row on, and flags 6; motors, positions and velocities of those
    of elastic legs, 12.
    """

    host = "Python"  # what runs the loop, in words

    def __init__(self, timing: Timing, plant: Plant, members: int) -> None:
        self.first, self.count = 0, 0  # index of the first row, number of rows
        self.most = min(max(_FEWEST, BLOCK_SIZE // members), timing.steps + 1)
        sizes = signals.SIZE, 6, 12 if signals.MOTORS in plant.columns else 0
        self.signals, self.forces, self.motors = (np.zeros((self.most + 1, size, members)) for size in sizes)
        self.force_limited, self.rate_limited = np.zeros((2, self.most + 1, 6, members), dtype=bool)
        self.counting = np.zeros(members, dtype=np.intp)  # how many rows count for each, up to that of its outcome

    def add(self, now: FloatArray, inputs: FloatArray, force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row: signals (N, 24), inputs (N, 12), flags (N, 6)."""
        self.count += 1
        k = self.count
        self.signals[k], self.forces[k] = now.T, inputs.T[:6]
        self.force_limited[k], self.rate_limited[k] = force_limited.T, rate_limited.T


@dataclass
class RowSink:
    """Takes the rows of a run in the loop's machine code; then none are written, and no Python runs between them."""

    address: int  # of `taker` of c/loop/loop.h
    counting: NDArray[np.int64]  # how many rows count for each member (M,), -1 where all so far do
    owned: Any  # what the address leads to
    rows: int = 0  # how many rows the run has come to


class Observer(Protocol):
    """Gets the rows of a run in blocks, in order, after their limits have been checked.

    One with a `sink` gets none where machine code runs the loop, which gives them to that instead.
    """

    def sink(self) -> RowSink | None:
        """Asked for once, before the first row."""
        return None

    def start(self, timing: Timing, plant: Plant, members: int) -> RowBlock:
        """The rows to be filled."""
        return RowBlock(timing, plant, members)

    def block(self, rows: RowBlock) -> None:
        """Called with each block; views, valid during the call only."""


class AllRows(RowBlock, Observer):
    """Keeps all rows of a run as one block, with all results and inputs, and its samples, arrays (m, size, N).

    `state` gets room for the states of controllers when these are known.
    """

    used: tuple[str, ...] = ()  # the signals that controllers use

    def __init__(self) -> None:
        """Nothing before `start`."""

    def start(self, timing: Timing, plant: Plant, members: int) -> RowBlock:
        """Make room for all rows and samples."""
        n, m, self._plant = timing.steps + 3, len(timing.samples), plant
        self.first, self.count, self.most = 0, 0, n - 1  # one more than there are: they are passed on at the end
        self.results = np.zeros((n, len(plant.columns), members))
        self.inputs = np.zeros((n, interface.N_INPUTS, members))
        self.signals, self.forces = self.results[:, : signals.SIZE], self.inputs[:, :6]
        self.motors = self.results[:, :0]  # they are among the results
        self.force_limited, self.rate_limited = np.zeros((2, n, 6, members), dtype=bool)
        self.counting = np.zeros(members, dtype=np.intp)
        self.measured = np.zeros((m, signals.SIZE, members))  # of many members only the signals that are used
        self.state = np.zeros((m, 0, members))  # before the command was computed
        self.command = np.zeros((m, 6, members))  # before limits
        self.limited = np.zeros((m, 6, members), dtype=bool)  # which forces are limited
        return self

    def add(self, _now: FloatArray, inputs: FloatArray, _force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row, evaluated again: accelerations and joint forces under the forces that act from now on."""
        k = self.count + 1
        self.results[k], self.inputs[k], self.rate_limited[k] = self._plant.results().T, inputs.T, rate_limited.T
        self.count = k  # at last, since the plant may fail

    def block(self, rows: RowBlock) -> None:
        """Nothing: the rows are kept already."""


class RowMonitor:
    """Takes the rows of N members, ends members at limits and failures, and passes blocks of rows to an observer."""

    def __init__(self, loop: Loop, plant: Plant, observer: Observer) -> None:
        (n_members,) = plant.shape
        self._times, self._limits, self.observer = loop.timing.times, loop.limits, observer
        self._reference = members_last(loop.reference)
        self._nearest_limit = float(np.min(loop.limits.largest_position_error))
        self._outcomes: dict[int, Outcome] = {}
        self.rows = observer.start(loop.timing, plant, n_members)  # the block that is being filled
        self.n_rows = 0  # so far
        self.counting = np.full(n_members, len(self._times))  # how many rows count for each
        self.going = np.ones(n_members, dtype=bool)  # those without an outcome
        self.all_go, self.ended_now = True, False  # whether some have ended since this was set to False

    def end(
        self, whose: int | slice | BoolArray | np.bool_, rows: int, status: Status, cause: str | Callable[[int], str]
    ) -> None:
        """End those of these members, by number or flags (N,), that still run, after a number of rows."""
        for member in np.atleast_1d(np.arange(self.going.size)[whose]).tolist():
            if self.going[member]:
                text = cause if isinstance(cause, str) else cause(member)
                self._outcomes[member] = Outcome(status, float(self._times[max(rows - 1, 0)]), text)
                self.counting[member] = rows
                self.going[member] = self.all_go = False
                self.ended_now = True

    def add(self, now: FloatArray, inputs: FloatArray, force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row, see `RowBlock.add`, and end members that are beyond a limit there."""
        self.rows.add(now, inputs, force_limited, rate_limited)
        row, self.n_rows = self.n_rows, self.n_rows + 1
        if self._limits.on_stroke == "stop":
            beyond = self._limits.beyond_stroke(now[:, LENGTHS]).any(axis=1)
            self.end(beyond, row + 1, "stopped", lambda k: self.beyond_stroke(k, now[k]))
        if self._reference is not None:
            gap = self._reference[row, :3] - now.T[:3]
            if not signals.all_below(gap, self._nearest_limit):
                x, y, z = gap
                away = ~np.less_equal(np.sqrt(x * x + y * y + z * z), self._limits.largest_position_error)
                self.end(away, row + 1, "diverged", lambda k: self.too_far(k, row, now[k]))  # also for NaN
        if self.rows.count == self.rows.most:
            self.pass_on()

    def beyond_stroke(self, member: int, now: FloatArray) -> str:
        """Why a member with these signals (24,) is stopped: its first leg that is beyond its stroke."""
        ends = (signals.of_legs(end) for end in self._limits.stroke)
        low, high = (end[:, member if end.shape[1] > 1 else 0] for end in ends)
        lengths = now[LENGTHS]
        leg = int(((lengths < low) | (lengths > high)).argmax())
        return f"leg {leg + 1} is {lengths[leg]:.6g} m long; its stroke is {low[leg]:g} to {high[leg]:g} m"

    def too_far(self, member: int, row: int, now: FloatArray) -> str:
        """Why a member with these signals (24,) has diverged: its distance from the reference."""
        assert self._reference is not None
        wanted = self._reference[row, :3, member if self._reference.shape[2] > 1 else 0]
        limit = signals.of_member(self._limits.largest_position_error, member)
        error = np.linalg.norm(wanted - now[:3])
        return f"the platform is {error:.3g} m from its reference; the limit is {limit:g} m"

    def check_plant(self, now: FloatArray, at_motors: FloatArray) -> None:
        """Keep the motors of the next row, and end members there whose plant gives no numbers, or too large ones.

        Signals (N, 24), and the same with the legs' at the motors' side.
        """
        # of rigid legs both sides are the same array
        values = now if at_motors is now else np.concatenate([now, at_motors[:, signals.LEGS]], axis=1)
        if self.rows.motors.size:
            self.rows.motors[self.rows.count + 1] = values.T[signals.SIZE :]
        if signals.all_below(values.T, LARGEST_NUMBER):
            return
        broken = ~(np.abs(values) <= LARGEST_NUMBER)
        columns = signals.column_names([*signals.NAMES, *signals.AT_MOTORS.values()])

        def cause(k: int) -> str:
            at = int(broken[k].argmax())
            unit = interface.BY_NAME[columns[at].partition("[")[0]].unit
            return f"the plant gave {columns[at]} = {values[k, at]:g} {unit}"

        self.end(broken.any(axis=1), self.n_rows + 1, "diverged", cause)

    def pass_on(self) -> None:
        """Give the rows since the last call to the observer."""
        rows = self.rows
        if rows.count:
            rows.counting = np.clip(self.counting - rows.first, 0, rows.count)
            self.observer.block(rows)
            # the next block begins with the last row of this one
            for values in (rows.signals, rows.forces, rows.force_limited, rows.rate_limited, rows.motors):
                values[0] = values[rows.count]
            rows.first, rows.count = rows.first + rows.count, 0

    def outcomes(self) -> tuple[Outcome, ...]:
        """The outcomes of all members at the end of the run."""
        completed = Outcome("completed", float(self._times[-1]), None)
        return tuple(self._outcomes.get(member, completed) for member in range(self.going.size))

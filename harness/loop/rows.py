"""The rows of a run, as the loop fills them and as observers get them: in blocks, members last."""

from typing import TYPE_CHECKING, Protocol

import numpy as np

from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.loop.taking import RowTaker

# Rows times members in a block. Fewer cost calls, more no longer fit into the processor's cache.
_SIZE = 8192
# Rows that run before the limits are checked, of any number of members, so that this does not depend on it.
CHECKED = 16


class Rows:
    """Consecutive rows of N members: arrays (rows + 1, size, N), after the last row of the block before.

    Attributes
    ----------
    host
        What runs the loop, in words.
    first, count
        Index of the first row, and the number of rows.
    counting
        How many of these rows count for each member (N,): up to the row of its outcome.
    signals, forces, force_limited, rate_limited
        Sizes 24, 6, 6, 6; the forces act from the row on.
    motors
        Positions and velocities of the motors of legs that give, size 12; 0 of rigid ones.
    """

    host = "Python"

    def __init__(self, most: int, members: int, signals_: FloatArray, forces: FloatArray, motors: int = 0) -> None:
        self.most, self.first, self.count = most, 0, 0
        self.counting = np.zeros(members, dtype=np.intp)
        self.signals, self.forces = signals_, forces
        self.force_limited, self.rate_limited = np.zeros((2, most + 1, 6, members), dtype=bool)
        self.motors = np.zeros((most + 1, motors, members))

    @classmethod
    def of(cls, timing: Timing, members: int, motors: int = 0) -> "Rows":
        """Blocks that fit into the processor's cache."""
        most = min(max(CHECKED, _SIZE // members), timing.steps + 1)
        now, forces = (np.zeros((most + 1, size, members)) for size in (signals.SIZE, 6))
        return Rows(most, members, now, forces, motors)

    def add(self, now: FloatArray, acting: FloatArray, force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row: signals (N, 24), inputs (N, 12), flags (N, 6)."""
        self.count += 1
        k = self.count
        self.signals[k] = now.T
        self.forces[k] = acting.T[:6]
        self.force_limited[k], self.rate_limited[k] = force_limited.T, rate_limited.T

    def clear(self) -> None:
        """Begin the next block."""
        for each in (self.signals, self.forces, self.force_limited, self.rate_limited, self.motors):
            each[0] = each[self.count]
        self.first, self.count = self.first + self.count, 0


class AllRows(Rows):
    """All rows of a run, with all results and inputs, and its samples.

    Attributes
    ----------
    results, inputs
        Sizes N_RESULTS, or more of a plant with more states, and 12.
    measured, state, command, limited
        By sample, arrays (m, size, N): of many members only the signals that controllers use; before the command was
        computed; before limits; which forces are limited.
    used
        The signals that controllers use.
    """

    def __init__(self, timing: Timing, members: int, plant: Plant) -> None:
        n, m, self._plant = timing.steps + 2, len(timing.samples), plant
        self.results = np.zeros((n, len(plant.columns), members))
        self.inputs = np.zeros((n, interface.size_of(interface.INPUTS), members))
        # more than there will be: they are passed on at the end
        super().__init__(n + CHECKED, members, self.results[:, : signals.SIZE], self.inputs[:, :6])
        self.measured = np.zeros((m, signals.SIZE, members))
        self.command = np.zeros((m, 6, members))
        self.limited = np.zeros((m, 6, members), dtype=bool)
        self.state = np.zeros((m, 0, members))
        self.used: tuple[str, ...] = ()

    def add(self, _now: FloatArray, acting: FloatArray, _force_limited: BoolArray, rate_limited: BoolArray) -> None:
        """Add a row, evaluated again: accelerations and joint forces under the forces that act from now on."""
        k = self.count + 1
        self.results[k] = self._plant.results().T
        self.inputs[k] = acting.T
        self.rate_limited[k] = rate_limited.T
        self.count = k

    def begin(self, used: tuple[str, ...], n_states: int) -> None:
        """Before the first sample of controllers that use these signals and have this number of states."""
        self.used, self.state = used, np.zeros((len(self.measured), n_states, self.measured.shape[2]))

    def sample(
        self,
        j: int,
        due: BoolArray | None,
        measured: FloatArray,
        state: FloatArray,
        command: FloatArray,
        force_limited: BoolArray,
        used: tuple[str, ...],
    ) -> None:
        """Keep sample j of the members that are due (N,); None means all."""
        if j == 0:
            self.begin(used, state.shape[-1])
        if due is None:
            self.measured[j], self.state[j] = measured.T, state.T
            self.command[j], self.limited[j] = command.T, force_limited.T
            return
        np.copyto(self.measured[j], measured.T, where=due)
        np.copyto(self.state[j], state.T, where=due)
        np.copyto(self.command[j], command.T, where=due)
        np.copyto(self.limited[j], force_limited.T, where=due)


class Observer(Protocol):
    """Gets the rows of a run in blocks, in order, after their limits have been checked.

    One with a `taker` gets none where machine code runs the loop, which gives them to that instead.
    """

    def taker(self) -> "RowTaker | None":
        """Asked for once, before the first row."""
        return None

    def start(self, timing: Timing, plant: Plant, members: int) -> Rows:
        """The rows to be filled."""
        return Rows.of(timing, members, 12 if signals.MOTORS in plant.columns else 0)

    def block(self, rows: Rows) -> None:
        """Called with each block; views, valid during the call only."""

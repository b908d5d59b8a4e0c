"""Folds over the rows of a run: what is kept of them, for one member or many.

1. A fold names the columns it needs, as a record does. `start` gives its state: arrays with the members on their last
   axis; `rows` adds a block of rows to it in place; `result` reads it.
2. A row may be used with the one before it, which a block brings along: a result does not depend on where blocks end.
3. A sum takes one row after the other, with the state as its first term. So a member's sums have the same bits alone,
   among others, and for every size of blocks.
4. A fold need not look at which members have ended: their state is kept as it was at their last row. One that has to
   know, such as a count of running members, reads `running` and sets `keeps_ended` to False.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.rotations import rotation_between
from gough_stewart.model.vectors import FloatArray

FORCES, LIMITED = "actuator_force", ("flag.force_limited", "flag.rate_limited")
# What the drives move; of rigid legs their lengths and velocities.
MOTORS = tuple(signals.AT_MOTORS.values())
AT = {name: slice(int(at[0]), int(at[-1]) + 1) for name in signals.NAMES if len(at := signals.positions([name]))}
# Signals that have errors, see `error_between`, and their places among signals and references.
ERRORS: Mapping[str, slice] = {f"error.{name}": AT[name] for name in ("position", "orientation", "leg_length")}


def _row() -> dict[str, slice]:
    sizes = {
        **{name: at.stop - at.start for name, at in {**AT, **ERRORS}.items()},
        **dict.fromkeys((FORCES, *LIMITED, *MOTORS), 6),
    }
    found, end = dict[str, slice](), 0
    for name in (*AT, FORCES, *ERRORS, *LIMITED, *MOTORS):
        found[name] = slice(end, end + sizes[name])
        end += sizes[name]
    return found


# Places of columns in a row of machine code: signals, forces, errors, flags, motors; and where these parts begin.
ROW: Mapping[str, slice] = _row()
ROW_PARTS: Mapping[str, int] = {
    "FORCES": ROW[FORCES].start,
    "ERRORS": ROW[next(iter(ERRORS))].start,
    "FLAGS": ROW[LIMITED[0]].start,
    "MOTORS": ROW[MOTORS[0]].start,
    "ELEMENTS": ROW[MOTORS[-1]].stop,
}

State = dict[str, NDArray[Any]]


def error_between(name: str, reference: FloatArray, actual: FloatArray, out: FloatArray | None = None) -> FloatArray:
    """The error of a signal (..., size, N): reference − actual, or of orientations the rotation from actual to it."""
    if name != "orientation":
        return np.asarray(np.subtract(reference, actual, out=out))
    turn = rotation_between(*(np.moveaxis(each, -2, -1) for each in (actual, reference)))
    error: FloatArray = np.moveaxis(turn, -1, -2)
    if out is not None:
        np.copyto(out, error)
    return error


class Block:
    """Consecutive rows of N members; views, valid during the call only.

    Parameters
    ----------
    first, rows
        Index of the first row, and their number.
    columns
        Columns (rows + 1, size, N) by name, beginning with the row before, which is undefined in the first block.
    running
        Members (N,) for which these rows count.
    reference
        Reference signals (rows, 30, N), or (rows, 30, 1) if common to all members, for errors that are no columns.
    whole
        Contiguous arrays that have all numbers of the columns and the reference.
    """

    def __init__(
        self,
        first: int,
        rows: int,
        columns: Mapping[str, NDArray[Any]],
        running: BoolArray,
        reference: FloatArray | None = None,
        whole: Sequence[FloatArray] = (),
    ) -> None:
        self.first, self.rows, self.running, self.whole = first, rows, running, whole
        self._columns, self._reference = columns, reference

    def __contains__(self, name: str) -> bool:
        return name in self._columns or (self._reference is not None and name in ERRORS)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column (rows, size, N)."""
        return self.of_rows(slice(None), name)

    def of_rows(self, rows: slice | NDArray[np.intp], name: str, out: FloatArray | None = None) -> NDArray[Any]:
        """A column at some rows of the block, in `out` if there is one; else a view, or an error that is computed."""
        if name in self._columns:
            values = self._columns[name][1:][rows]
            if out is None:
                return values
            np.copyto(out, values)
            return out
        assert self._reference is not None
        signal = name.removeprefix("error.")
        return error_between(signal, self._reference[rows, ERRORS[name]], self._columns[signal][1:][rows], out)

    def stored(self, name: str) -> tuple[NDArray[Any], FloatArray | None]:
        """A column (rows, size, N) in memory, before which there is the row before unless it is the first row.

        Of an error that is no column, the signal and the reference (rows, size, N) or (rows, size, 1), of which it is
        the difference; an error of orientation is computed.
        """
        if name in self._columns:
            return self._columns[name][1:], None
        assert self._reference is not None
        if name == "error.orientation":
            error = self[name]
            return np.concatenate([error[:1], error])[1:], None
        return self._columns[name.removeprefix("error.")][1:], self._reference[:, ERRORS[name]]

    def before(self, name: str) -> NDArray[Any]:
        """A column of the row before each row (rows, size, N); before the first row, of the first row itself."""
        values = self._columns[name]
        return values[:-1] if self.first else np.concatenate((values[1:2], values[1:-1]))

    def part(self, first: int, last: int, running: BoolArray) -> "Block":
        """Rows first to last − 1 of the block, for these members."""
        reference = None if self._reference is None else self._reference[first:last]
        columns = {name: each[first : last + 1] for name, each in self._columns.items()}
        return Block(self.first + first, last - first, columns, running, reference)


class Fold(Protocol):
    """What is kept of the rows of a run; see the rules above."""

    needs: Sequence[str] = ()
    keeps_ended: bool = True

    def start(self, _members: int) -> State:
        """The state before the first row; by default none by member."""
        return {}

    def rows(self, _state: State, _block: Block) -> None:
        """Add a block to the state, in place; by default nothing."""
        return

    def result(self, _state: State, _rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Results (..., N) by name for members with these numbers of rows (N,); NaN where undefined."""
        return {}


class KeptRows(Fold):
    """A fold that keeps columns at some rows, also those after a member has ended.

    Attributes
    ----------
    at
        The rows, in order.
    kept
        By column (rows, size, N): where they are kept, from `start` on.
    """

    keeps_ended = False
    at: NDArray[np.intp]
    kept: Mapping[str, FloatArray] = {}

    def rows(self, _state: State, block: Block) -> None:
        """Keep the rows whose turn it is; of columns that the block lacks, NaN."""
        first, last = np.searchsorted(self.at, (block.first, block.first + block.rows))
        if first == last:
            return
        at = self.at[first:last] - block.first
        rows = slice(None) if last - first == block.rows else at
        for name, into in self.kept.items():
            if name in block:
                block.of_rows(rows, name, into[first:last])
            else:
                into[first:last] = np.nan

"""Folds over the rows of a run: what is kept of them, for one member or many.

1. A fold names the columns it needs, as a record does. `start` gives its state: arrays with the members on their last
   axis; `rows` adds a block of rows to it in place; `result` reads it.
2. A row may be used with the one before it, which a block brings along: a result does not depend on where blocks end.
3. A sum takes one row after the other, with the state as its first term: `add_rows`. So a member's sums have the same
   bits alone, among others, and for every size of blocks.
4. A fold need not look at which members have ended: their state is kept as it was at their last row. One that has to
   know, such as a count of running members, reads `running` and sets `keeps_ended` to False.
"""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.loop.loop import Loop

FORCES, LIMITED = "actuator_force", ("flag.force_limited", "flag.rate_limited")
_AT = {name: slice(int(at[0]), int(at[-1]) + 1) for name in signals.NAMES if len(at := signals.positions([name]))}
# Signals whose errors are reference − actual, and their places among signals and references.
ERRORS: Mapping[str, slice] = {f"error.{name}": _AT[name] for name in ("position", "orientation", "leg_length")}

State = dict[str, NDArray[Any]]


class Scratch:
    """Arrays for intermediate results, kept from block to block: fresh memory costs more than the arithmetic.

    Folds that use the same names use the same memory, one after the other, which is then in the processor's cache.
    """

    def __init__(self) -> None:
        self._kept = dict[str, FloatArray]()

    def __call__(self, name: str, rows: int, *size: int) -> FloatArray:
        """An array (rows, *size) of undefined values."""
        number = rows * math.prod(size)
        kept = self._kept.get(name)
        if kept is None or kept.size < number:
            kept = self._kept[name] = np.empty(number)
        return kept[:number].reshape(rows, *size)


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
    scratch
        For intermediate results.
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
        scratch: Scratch,
        reference: FloatArray | None = None,
        whole: Sequence[FloatArray] = (),
    ) -> None:
        self.first, self.rows, self.running, self.scratch, self.whole = first, rows, running, scratch, whole
        self._columns, self._reference = columns, reference

    def __contains__(self, name: str) -> bool:
        return name in self._columns or (self._reference is not None and name in ERRORS)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column (rows, size, N)."""
        return self.of_rows(slice(None), name)

    def of_rows(self, rows: slice, name: str, out: FloatArray | None = None) -> NDArray[Any]:
        """A column at some rows of the block, in `out` if there is one; else a view, or an error that is computed."""
        if name in self._columns:
            values = self._columns[name][1:][rows]
            if out is None:
                return values
            np.copyto(out, values)
            return out
        assert self._reference is not None
        actual = self._columns[name.removeprefix("error.")][1:][rows]
        error: FloatArray = np.subtract(self._reference[rows, ERRORS[name]], actual, out=out)
        return error

    def linked(self, name: str) -> NDArray[Any]:
        """A column after the row before it, if there is one: (rows + 1, size, N), or in the first block (rows, ...)."""
        return self._columns[name] if self.first else self._columns[name][1:]

    def part(self, first: int, last: int, running: BoolArray) -> "Block":
        """Rows first to last − 1 of the block, for these members."""
        reference = None if self._reference is None else self._reference[first:last]
        columns = {name: each[first : last + 1] for name, each in self._columns.items()}
        return Block(self.first + first, last - first, columns, running, self.scratch, reference)


class Fold(Protocol):
    """What is kept of the rows of a run; see the rules above."""

    needs: Sequence[str] = ()
    keeps_ended: bool = True

    def start(self, _members: int) -> State:
        """The state before the first row; by default none by member."""
        return {}

    def rows(self, state: State, block: Block) -> None:
        """Add a block to the state, in place."""

    def result(self, _state: State, _rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Results (..., N) by name for members with these numbers of rows (N,); NaN where undefined."""
        return {}


def add_rows(total: FloatArray, terms: FloatArray) -> None:
    """Add terms (rows, size, N), which change, to a total (size, N): one row after the other.

    NumPy adds along the first axis in this order if there are at least two columns, as there are of any fold, since a
    size is at least 2; a single one it adds in pairs.
    """
    if len(terms):
        terms[0] += total
        np.add.reduce(terms, axis=0, out=total)


class Folding:
    """Folds of some members, fed with blocks; members end at rows, or before one that is not finite."""

    def __init__(self, folds: Sequence[Fold], members: int) -> None:
        self._folds, self._states = tuple(folds), [fold.start(members) for fold in folds]
        self._checked = tuple(dict.fromkeys(name for fold in folds if fold.keeps_ended for name in fold.needs))
        self._final: list[State] | None = None  # of members that have ended
        self._rows = np.zeros(members, dtype=np.intp)
        self._count = 0
        self.running: BoolArray = np.ones(members, dtype=bool)

    def add(self, block: Block, counting: NDArray[np.intp] | None = None) -> None:
        """Add a block, of which some rows of each member count (N,), by default all.

        Members whose values are not finite from a row on end before it.
        """
        done = 0
        ends = [*self._breaks(block), *([] if counting is None else self._ends(counting, block.rows))]
        # members that have ended may compute NaN, and squares may overflow
        with np.errstate(all="ignore"):
            for row, ending in [*sorted(ends, key=lambda end: end[0]), (block.rows, None)]:
                if row > done:
                    part = block if row - done == block.rows else block.part(done, row, self.running)
                    for fold, state in zip(self._folds, self._states, strict=True):
                        fold.rows(state, part)
                    done, self._count = row, block.first + row
                if ending is not None:
                    self._end(ending & self.running)

    def _end(self, members: BoolArray) -> None:
        """End members (N,): later rows do not count for them."""
        if not members.any():
            return
        if self._final is None:
            self._final = [{name: np.zeros_like(each) for name, each in state.items()} for state in self._states]
        for final, state in zip(self._final, self._states, strict=True):
            for name, values in state.items():
                final[name][..., members] = values[..., members]
        self._rows[members] = self._count
        self.running &= ~members

    def results(self) -> dict[str, FloatArray]:
        """Results (..., N) of all folds by name, so far."""
        rows = np.where(self.running, self._count, self._rows)
        found = dict[str, FloatArray]()
        for k, (fold, state) in enumerate(zip(self._folds, self._states, strict=True)):
            kept = state
            if self._final is not None and fold.keeps_ended:
                kept = {name: np.where(self.running, each, self._final[k][name]) for name, each in state.items()}
            with np.errstate(all="ignore"):
                found |= fold.result(kept, rows)
        return found

    def _ends(self, counting: NDArray[np.intp], rows: int) -> list[tuple[int, BoolArray]]:
        """Rows of a block before which members end (N,), since no more rows of theirs count."""
        early = counting[self.running & (counting < rows)]
        return [(row, counting == row) for row in np.unique(early).tolist()]

    def _breaks(self, block: Block) -> list[tuple[int, BoolArray]]:
        """Rows of a block before which members end (N,), since values that a fold needs are not finite."""
        # squares are finite only if all values are; ones that overflow are looked at closely
        if block.whole and all(np.isfinite(np.vdot(each, each)) for each in block.whole):
            return []
        used = [each for name in self._checked if (each := block[name]).dtype != bool]
        broken = ~np.logical_and.reduce([np.isfinite(each).all(axis=1) for each in used]) & self.running
        at = np.where(broken.any(axis=0), broken.argmax(axis=0), block.rows)
        return [(row, at == row) for row in np.unique(at[at < block.rows]).tolist()]


class FoldsOfRows(Observer):
    """A loop observer that passes rows to folds.

    Parameters
    ----------
    loop
        The loop to be run.
    folds
        What is kept.
    members
        Their number.
    """

    def __init__(self, loop: "Loop", folds: Sequence[Fold], members: int = 1) -> None:
        self._folding = Folding(folds, members)
        self._reference = loop.reference_rows
        self._scratch = Scratch()

    def block(self, rows: Rows) -> None:
        """Fold a block."""
        n, first = rows.count, rows.first
        reference = None if self._reference is None else self._reference[first : first + n]
        columns = {
            **{name: rows.signals[: n + 1, at] for name, at in _AT.items()},
            FORCES: rows.forces[: n + 1],
            LIMITED[0]: rows.force_limited[: n + 1],
            LIMITED[1]: rows.rate_limited[: n + 1],
        }
        whole = [rows.signals[1 : n + 1], rows.forces[1 : n + 1], *([] if reference is None else [reference])]
        block = Block(first, n, columns, self._folding.running, self._scratch, reference, whole)
        self._folding.add(block, rows.counting)

    def results(self) -> dict[str, FloatArray]:
        """Results (..., N) of all folds by name, of the rows so far."""
        return self._folding.results()

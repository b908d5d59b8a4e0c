"""Folds of the members of a run, fed with the blocks of its rows: in machine code where they are described for it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.harness.loop.fold_kernels import CompiledFolds, FoldKernels
from gough_stewart.harness.loop.folds import AT, FORCES, LIMITED, MOTORS, ROW, Block, Fold, KeptRows, State
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.rows import Observer, Rows
from gough_stewart.harness.loop.taking import RowTaker
from gough_stewart.harness.loop.term_folds import TermFold
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.plants.signals import LEGS, N_LEGS
from gough_stewart.model.vectors import FloatArray


class Folding:
    """Folds of some members, fed with blocks; members end at rows, or before one that is not finite.

    Parameters
    ----------
    folds
        What is kept.
    members
        Their number.
    kernels
        Machine code of folds; others, or all without it, are computed by NumPy, with the same bits.
    """

    def __init__(self, folds: Sequence[Fold], members: int, kernels: FoldKernels | None = None) -> None:
        self._folds = tuple(folds)
        self._checked = tuple(dict.fromkeys(name for fold in folds if fold.keeps_ended for name in fold.needs))
        described: list[TermFold] = []
        self._compiled: CompiledFolds | None = None
        if kernels is not None:
            described = [fold for fold in folds if isinstance(fold, TermFold) and kernels.kernel(fold) is not None]
            self._compiled = CompiledFolds(kernels, described, self._checked, members) if described else None
        self._others = [fold for fold in folds if fold not in described]
        self._states = [fold.start(members) for fold in self._others]
        self._final: list[State] | None = None  # of members that have ended
        self._rows = np.zeros(members, dtype=np.intp)
        self._count = 0
        self._taker: RowTaker | None = None
        self.running: BoolArray = np.ones(members, dtype=bool)

    def add(self, block: Block, counting: NDArray[np.intp] | None = None) -> None:
        """Add a block, of which some rows of each member count (N,), by default all.

        Members whose values are not finite from a row on end before it.
        """
        done, others = 0, list(zip(self._others, self._states, strict=True))
        # members that have ended may compute NaN, and squares may overflow
        with np.errstate(all="ignore"):
            for row, ending in [*self._ends(block, counting), (block.rows, None)]:
                if row > done:
                    part = block if row - done == block.rows or not others else block.part(done, row, self.running)
                    for fold, state in others:
                        fold.rows(state, part)
                    done, self._count = row, block.first + row
                if ending is not None:
                    self._end(ending & self.running)

    def taker(self, timing: Timing) -> RowTaker | None:
        """What takes the rows of a run in machine code, in place of `add`; None if a fold needs blocks of rows."""
        is_known = all(name in ROW for fold in self._folds for name in fold.needs)
        kept = [fold for fold in self._others if isinstance(fold, KeptRows)]
        idle = [fold for fold in self._others if type(fold).rows is Fold.rows]
        if self._compiled is None or not is_known or len(kept) + len(idle) < len(self._others):
            return None
        self._taker = RowTaker(self._compiled, kept, timing, -(-len(self.running) // WIDTH))
        return self._taker

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
        if self._taker is not None:
            counting = self._taker.counting[: len(rows)]
            rows = np.where(counting < 0, self._taker.rows, counting)
        compiled = iter([] if self._compiled is None else self._compiled.states())
        others = iter(self._kept())
        found = dict[str, FloatArray]()
        for fold in self._folds:
            with np.errstate(all="ignore"):
                found |= fold.result(next(others if fold in self._others else compiled), rows)
        return found

    def _kept(self) -> list[State]:
        """The states at the members' last rows, of the folds without machine code."""
        if self._final is None:
            return self._states
        return [
            {name: np.where(self.running, each, final[name]) for name, each in state.items()}
            if fold.keeps_ended
            else state
            for fold, state, final in zip(self._others, self._states, self._final, strict=True)
        ]

    def _ends(self, block: Block, counting: NDArray[np.intp] | None) -> list[tuple[int, BoolArray]]:
        """Rows of a block before which members end (N,), in order: no more of theirs count, or one is not finite."""
        whole = np.full(self.running.shape, block.rows) if counting is None else np.minimum(counting, block.rows)
        count = np.where(self.running, whole, 0).astype(np.int64, copy=False)
        if self._compiled is not None:
            self._compiled.add(block, count)
        else:
            for row, broken in self._breaks(block):
                np.minimum(count, row, out=count, where=broken)
        early = count[self.running & (count < block.rows)]
        return [(row, count == row) for row in np.unique(early).tolist()]

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
    kernels
        Machine code of folds, see `Folding`.
    """

    def __init__(self, loop: Loop, folds: Sequence[Fold], members: int = 1, kernels: FoldKernels | None = None) -> None:
        self._folding = Folding(folds, members, kernels)
        self._reference, self._timing = loop.reference_rows, loop.timing

    def taker(self) -> RowTaker | None:
        """Folds and kept rows within the loop's machine code, if all can be."""
        return self._folding.taker(self._timing)

    def block(self, rows: Rows) -> None:
        """Fold a block."""
        n, first = rows.count, rows.first
        reference = None if self._reference is None else self._reference[first : first + n]
        columns = {
            **{name: rows.signals[: n + 1, at] for name, at in AT.items()},
            FORCES: rows.forces[: n + 1],
            LIMITED[0]: rows.force_limited[: n + 1],
            LIMITED[1]: rows.rate_limited[: n + 1],
        }
        whole = [
            rows.signals[1 : n + 1],
            rows.forces[1 : n + 1],
            *([] if reference is None else [reference]),
            rows.motors[1 : n + 1],
        ]
        motors = rows.motors if rows.motors.size else rows.signals[:, LEGS]
        columns |= {name: motors[: n + 1, k * N_LEGS : (k + 1) * N_LEGS] for k, name in enumerate(MOTORS)}
        block = Block(first, n, columns, self._folding.running, reference, whole)
        self._folding.add(block, rows.counting)

    def results(self) -> dict[str, FloatArray]:
        """Results (..., N) of all folds by name, of the rows so far."""
        return self._folding.results()

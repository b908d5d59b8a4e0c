"""What takes the rows of a loop in machine code while they are in the cache: folds with kernels, and kept rows.

Then no rows are written, and nothing of Python runs between blocks of them.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.loop.fold_kernels import CompiledFolds
from gough_stewart.harness.loop.folds import ROW, ROW_PARTS, KeptRows
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.lanes import lane_rows


class _KeptRows(ctypes.Structure):
    """`kept_rows` of c/loop/loop.h, as the structure below."""

    _fields_ = [
        ("place", ctypes.c_void_p),
        ("size", ctypes.c_int64),
        ("elements", ctypes.c_void_p),
        ("at", ctypes.c_void_p),
        ("row", ctypes.c_int64),
        ("element", ctypes.c_int64),
    ]


class _Taker(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("fold", "folding", "latest")),
        ("n_kept", ctypes.c_int64),
        ("kept", ctypes.c_void_p),
    ]


class RowTaker:
    """Takes the rows of some members in a run of the loop's machine code.

    Attributes
    ----------
    counting
        -1 for members (M,) all of whose rows count so far, else how many did.
    rows
        How many rows the run has come to.
    """

    def __init__(self, folds: CompiledFolds, kept: Sequence[KeptRows], timing: Timing, blocks: int) -> None:
        latest = lane_rows(ROW_PARTS["ELEMENTS"], blocks)
        self.counting = np.zeros(latest.shape[1], np.int64)
        self.rows = 0
        function, folding, owner = folds.in_loop(self.counting)
        self._arrays: list[Any] = [latest, owner]
        each = [self._kept_rows(name, values, fold, timing) for fold in kept for name, values in fold.kept.items()]
        of_folds = (_KeptRows * len(each))(*each)
        self._arrays.append(of_folds)
        self._c = _Taker(function, folding, latest.ctypes.data, len(each), ctypes.addressof(of_folds))

    @property
    def address(self) -> int:
        """Of what the loop gets; valid as long as this object."""
        return ctypes.addressof(self._c)

    def _kept_rows(self, name: str, values: NDArray[Any], fold: KeptRows, timing: Timing) -> _KeptRows:
        place = np.full(timing.steps + 1, -1, np.int64)
        place[fold.at] = np.arange(len(fold.at))
        elements = np.arange(ROW[name].start, ROW[name].stop, dtype=np.int64)
        self._arrays += [place, elements]
        row, element, _ = (stride // values.itemsize for stride in values.strides)
        return _KeptRows(place.ctypes.data, len(elements), elements.ctypes.data, values.ctypes.data, row, element)

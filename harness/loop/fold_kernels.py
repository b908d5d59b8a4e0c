"""Folds in machine code: those that are described by terms, for eight members at once."""

import ctypes
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.harness.loop.folds import LIMITED, ROW, Block, State
from gough_stewart.harness.loop.term_folds import TermFold
from gough_stewart.model.vectors import FloatArray

_NUMBERS, _FLAGS, _ERRORS = range(3)
_BYTES = {_NUMBERS: 8, _FLAGS: 1, _ERRORS: 8}


class _Fold(ctypes.Structure):
    """`fold` of c/folds/folds.h, as the structure below."""

    _fields_ = [
        ("kernel", ctypes.c_int64),
        ("places", ctypes.c_void_p),
        ("state", ctypes.c_int64),
        ("parameter", ctypes.c_int64),
    ]


class _RowsOfMembers(ctypes.Structure):
    _fields_ = [
        *(
            (name, ctypes.c_int64)
            for name in ("members", "first", "rows", "n_columns", "n_folds", "n_states", "n_parameters", "n_checked")
        ),
        *((name, ctypes.c_void_p) for name in ("columns", "folds", "parameters", "states", "counting", "checked")),
    ]


class FoldKernels:
    """A library of c/folds; it releases the GIL while it works."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))
        self._library.folds_add.restype = self._library.folds_kernel.restype = ctypes.c_int64

    def kernel(self, fold: TermFold) -> int | None:
        """The number of a fold's kernel, if there is one."""
        sizes = (ctypes.c_int64 * 3)()
        number = int(self._library.folds_kernel(fold.kernel.encode(), sizes))
        of_fold = [sum(fold.sizes.values()), sum(size for _, size, _ in fold.states), len(fold.parameters)]
        return number if number >= 0 and list(sizes) == of_fold else None

    @property
    def of_rows(self) -> int:
        """The address of `folds_rows`, which c/loop calls."""
        return int(ctypes.cast(self._library.folds_rows, ctypes.c_void_p).value or 0)

    def add(self, rows: _RowsOfMembers) -> None:
        """Add rows to states."""
        if self._library.folds_add(ctypes.byref(rows)):
            raise ValueError(f"rows of {rows.n_columns} columns; expected fewer elements, see MOST_COLUMNS")


class CompiledFolds:
    """Folds of some members that have kernels, and their states.

    Parameters
    ----------
    folds
        Each has a kernel.
    checked
        Columns whose numbers have to be finite; those of the folds' flags come besides.
    members
        Their number N.
    """

    def __init__(self, kernels: FoldKernels, folds: Sequence[TermFold], checked: Sequence[str], members: int) -> None:
        self._kernels, self._folds, self._members = kernels, folds, members
        self._names = tuple(dict.fromkeys((*checked, *(name for fold in folds for name in fold.needs))))
        vectors = -(-members // WIDTH)
        starts = np.array([value for fold in folds for _, size, value in fold.states for _ in range(size)])
        self._states = np.tile(starts[:, None], (vectors, 1, WIDTH))
        parameters = [value for fold in folds for value in fold.parameters.values()]
        self._parameters = np.zeros((vectors, len(parameters), WIDTH))
        for k, value in enumerate(parameters):
            padded = np.zeros(vectors * WIDTH)
            padded[:members] = value
            self._parameters[:, k] = padded.reshape(vectors, WIDTH)
        self._of_folds: Any = None
        self._elements = np.zeros(0, np.int64)  # that have to be finite
        self._kept: list[Any] = []

    def add(self, block: Block, counting: NDArray[np.int64]) -> None:
        """Add the rows of a block that count for each member (N,); then `counting` leaves out those not finite."""
        given = {name: block.stored(name) for name in self._names}
        arrays = dict(sorted(given.items(), key=lambda each: each[1][0].dtype == bool))
        columns = np.array([_column(*each) for each in arrays.values()], dtype=np.int64)
        if self._of_folds is None:
            ends = np.cumsum([0, *(values.shape[1] for values, _ in arrays.values())]).tolist()
            self._place(dict(zip(arrays, map(slice, ends, ends[1:]), strict=False)), flags=_flags_of(arrays))
        self._kernels.add(self._rows(counting, block.first, block.rows, columns))

    def in_loop(self, counting: NDArray[np.int64]) -> tuple[int, int, Any]:
        """For c/loop: the function that gets rows, its first argument, and what owns that; rows are as `ROW`.

        `counting` has -1 for members (M,) all of whose rows count so far, else how many did.
        """
        self._place(ROW, flags=LIMITED)
        rows = self._rows(counting)
        return self._kernels.of_rows, ctypes.addressof(rows), rows

    def _rows(
        self, counting: NDArray[np.int64], first: int = 0, rows: int = 0, columns: NDArray[np.int64] | None = None
    ) -> _RowsOfMembers:
        n_columns, at = (0, None) if columns is None else (len(columns), columns.ctypes.data)
        return _RowsOfMembers(
            *(self._members, first, rows, n_columns, len(self._folds)),
            *(self._states.shape[1], self._parameters.shape[1], len(self._elements)),
            *(at, ctypes.addressof(self._of_folds)),
            *(each.ctypes.data for each in (self._parameters, self._states, counting, self._elements)),
        )

    def _place(self, row: Mapping[str, slice], flags: Collection[str]) -> None:
        """Give the folds the places of their columns in a row, some of which are flags."""
        found, state, parameter = [], 0, 0
        for fold in self._folds:
            needs = zip(fold.sizes, fold.needs, strict=True)
            places = [row[need].start + fold.begins.get(of, 0) for of, need in needs]
            self._kept.append(np.array(places, dtype=np.int64))
            found.append(_Fold(self._kernels.kernel(fold), self._kept[-1].ctypes.data, state, parameter))
            state += sum(size for _, size, _ in fold.states)
            parameter += len(fold.parameters)
        self._of_folds = (_Fold * len(found))(*found)
        numbers = [range(row[name].start, row[name].stop) for name in self._names if name not in flags]
        self._elements = np.array([at for each in numbers for at in each], np.int64)

    def states(self) -> list[State]:
        """The states of each fold."""
        values = np.moveaxis(self._states, 1, 0).reshape(self._states.shape[1], -1)[:, : self._members]
        found, at = list[State](), 0
        for fold in self._folds:
            own = State()
            for name, size, _ in fold.states:
                own[name] = values[at : at + size]
                at += size
            found.append(own)
        return found


def _flags_of(arrays: Mapping[str, tuple[NDArray[Any], Any]]) -> list[str]:
    return [name for name, (values, _) in arrays.items() if values.dtype == bool]


def _column(values: NDArray[Any], reference: FloatArray | None) -> list[int]:
    """`column` of c/folds/folds.h."""
    kind = _FLAGS if values.dtype == bool else _NUMBERS if reference is None else _ERRORS
    given = _items(values, kind)
    return [kind, values.shape[1], *given, *(given if reference is None else _items(reference, kind))]


def _items(array: NDArray[Any], kind: int) -> list[int]:
    """`items`: where those of an array (rows, size, N) are; of one member, which is that of all, if N is 1."""
    size, (row, element, member) = _BYTES[kind], array.strides
    return [
        array.__array_interface__["data"][0],
        *(row // size, element // size, 0 if array.shape[2] == 1 else member // size),
    ]

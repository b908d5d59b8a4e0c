"""Folds of the members of a run: fed with blocks of its rows, or within the loop in machine code."""

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.harness.loop.folds import (
    AT,
    ERRORS,
    FORCES,
    LIMITED,
    MOTORS,
    ROW,
    ROW_PARTS,
    Columns,
    Fold,
    KeptRows,
    TermFold,
    error_between,
)
from gough_stewart.harness.loop.loop import Loop, members_last
from gough_stewart.harness.loop.rows import Observer, RowBlock, RowSink
from gough_stewart.harness.plants.lanes import lane_rows
from gough_stewart.harness.plants.signals import LEGS, N_LEGS
from gough_stewart.model.vectors import FloatArray

_INTEGER, _POINTER = ctypes.c_int64, ctypes.c_void_p
# Rows that machine code gets at once.
_ROWS = 256


class _Fold(ctypes.Structure):
    """`fold` of c/folds/folds.c, as the structure below."""

    _fields_ = [("kernel", _INTEGER), ("places", _POINTER), ("state", _INTEGER), ("parameter", _INTEGER)]


class _FoldsOfMembers(ctypes.Structure):
    _fields_ = [
        *((name, _INTEGER) for name in ("n_folds", "n_states", "n_parameters", "n_checked")),
        *((name, _POINTER) for name in ("folds", "parameters", "states", "counting", "checked")),
    ]


class _KeptRows(ctypes.Structure):
    """`kept_rows` of c/loop/loop.h."""

    _fields_ = [
        *(("place", _POINTER), ("size", _INTEGER), ("elements", _POINTER)),
        *(("at", _POINTER), ("row", _INTEGER), ("element", _INTEGER)),
    ]


class _SinkStructure(ctypes.Structure):
    """`taker` of c/loop/loop.h."""

    _fields_ = [
        *((name, _POINTER) for name in ("fold", "folding", "latest")),
        *(("n_kept", _INTEGER), ("kept", _POINTER)),
    ]


class FoldKernels:
    """A library of c/folds; it releases the GIL while it works."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))
        self._library.folds_kernel.restype = ctypes.c_int64
        self.add = self._library.folds_rows  # adds rows to states; c/loop calls it
        self.add.restype = None
        self.add.argtypes = (ctypes.c_void_p, *[ctypes.c_int64] * 4, ctypes.c_void_p, ctypes.c_void_p)

    def kernel(self, fold: TermFold) -> int | None:
        """The number of a fold's kernel, if there is one."""
        sizes = (ctypes.c_int64 * 3)()
        number = int(self._library.folds_kernel(fold.kernel.encode(), sizes))
        of_fold = [sum(fold.sizes.values()), sum(size for _, size, _ in fold.states), sum(fold.parameter_sizes)]
        return number if number >= 0 and list(sizes) == of_fold else None


class Folding:
    """Folds of some members, fed with blocks; members end at rows, or before one that is not finite.

    Without machine code, or if it lacks one of the folds, NumPy computes them with the same bits.
    """

    def __init__(self, folds: Sequence[Fold], members: int, kernels: FoldKernels | None = None) -> None:
        self._folds, self._members = tuple(folds), members
        self._described = [fold for fold in folds if isinstance(fold, TermFold)]
        self._kept = [fold for fold in folds if isinstance(fold, KeptRows)]
        # columns whose numbers have to be finite
        self._checked = list(
            dict.fromkeys(name for fold in folds if not isinstance(fold, KeptRows) for name in fold.needs)
        )
        has_kernels = kernels is not None and all(kernels.kernel(fold) is not None for fold in self._described)
        self._kernels = kernels if self._described and has_kernels else None
        self._states = [
            {name: np.full((size, members), value) for name, size, value in fold.states} for fold in self._described
        ]
        for fold in self._kept:
            fold.start(members)
        self._rows = 0
        self._counting = np.full(-(-members // WIDTH) * WIDTH, -1, np.int64)  # -1 while all rows count
        self._counting[members:] = 0
        self._sink: RowSink | None = None
        # of machine code: where columns are in a row, and the structure with the arrays that it points to
        self._places: Mapping[str, slice] = {}
        self._structure: _FoldsOfMembers | None = None
        self._lanes: FloatArray = np.zeros((0, 0, WIDTH))  # states (vectors, size, 8)
        self._owned: tuple[Any, ...] = ()

    def _compile(self, kernels: FoldKernels, places: Mapping[str, slice]) -> _FoldsOfMembers:
        """Folds in machine code, of eight members at once, with their states."""
        folds, vectors = self._described, len(self._counting) // WIDTH
        starts = np.array([value for fold in folds for _, size, value in fold.states for _ in range(size)])
        self._places, self._lanes = places, np.tile(starts[:, None], (vectors, 1, WIDTH))
        parameters = np.zeros((sum(sum(fold.parameter_sizes) for fold in folds), vectors * WIDTH))
        columns, records, state, parameter = [], [], 0, 0
        for fold in folds:
            firsts = [
                places[need].start + fold.begins.get(name, 0) for name, need in zip(fold.sizes, fold.needs, strict=True)
            ]
            columns.append(np.array(firsts, np.int64))
            records.append(_Fold(kernels.kernel(fold), columns[-1].ctypes.data, state, parameter))
            state += sum(size for _, size, _ in fold.states)
            for value, size in zip(fold.parameters.values(), fold.parameter_sizes, strict=True):
                parameters[parameter : parameter + size, : self._members] = value
                parameter += size
        by_vector = parameters.reshape(parameter, vectors, WIDTH).swapaxes(0, 1).copy()
        elements = np.array(
            [k for name in self._checked for k in range(places[name].start, places[name].stop)], np.int64
        )
        of_folds = (_Fold * len(records))(*records)
        self._owned = columns, by_vector, elements, of_folds
        self._structure = _FoldsOfMembers(
            n_folds=len(folds),
            n_states=state,
            n_parameters=parameter,
            n_checked=len(elements),
            folds=ctypes.addressof(of_folds),
            parameters=by_vector.ctypes.data,
            states=self._lanes.ctypes.data,
            counting=self._counting.ctypes.data,
            checked=elements.ctypes.data,
        )
        return self._structure

    def add(self, first: int, columns: Columns, counting: NDArray[np.intp] | None = None) -> None:
        """Add a block of rows from `first` on, of which some of each member count (N,), by default all.

        Columns (rows + 1, size, N) begin with the row before. Members whose values are not finite from a row on end
        before it.
        """
        n = self._members
        rows = len(next(iter(columns.values()))) - 1 if columns else 0
        ends = np.full(len(self._counting), rows + 1)
        if counting is not None:
            ends[:n] = np.where(counting < rows, counting, rows + 1)
        # members that have ended may compute NaN, and squares may overflow
        with np.errstate(all="ignore"):
            if self._kernels is not None:
                structure = self._structure
                if structure is None:
                    stops = np.cumsum([0, *(columns[name].shape[1] for name in self._checked)]).tolist()
                    places = dict(zip(self._checked, map(slice, stops, stops[1:]), strict=False))
                    structure = self._compile(self._kernels, places)
                vectors, width = len(ends) // WIDTH, max(at.stop for at in self._places.values())
                for begin in range(0, rows, _ROWS):
                    end = min(begin + _ROWS, rows)
                    padded = np.zeros((end - begin + 1, width, vectors * WIDTH))
                    for name, at in self._places.items():
                        padded[:, at, :n] = columns[name][begin : end + 1]
                    raw = np.zeros(padded.size + WIDTH)
                    aligned = raw[-raw.ctypes.data % 64 // raw.itemsize :][: padded.size]  # to 64 bytes, as vectors are
                    chunk = aligned.reshape(vectors, -1, width, WIDTH)
                    chunk[...] = padded.reshape(-1, width, vectors, WIDTH).transpose(2, 0, 1, 3)
                    to = ends - begin  # how many of these rows count for each member
                    for vector in range(vectors):
                        pointers = to[vector * WIDTH :].ctypes.data, chunk[vector].ctypes.data
                        sizes = vector, first + begin, end - begin, width
                        self._kernels.add(ctypes.byref(structure), *sizes, *pointers)
            else:
                finite = [np.isfinite(columns[name][1:]).all(axis=1) for name in self._checked]
                broken = ~np.logical_and.reduce(finite) if finite else np.zeros((rows, n), dtype=bool)
                ends[:n] = np.minimum(ends[:n], np.where(broken.any(axis=0), broken.argmax(axis=0), rows + 1))
                goes_on = self._counting[:n] < 0
                count = np.where(goes_on, np.minimum(ends[:n], rows), 0)
                for fold, state in zip(self._described, self._states, strict=True):
                    fold.add(state, first, columns, count)
                self._counting[:n] = np.where(goes_on & (ends[:n] <= rows), first + count, self._counting[:n])
        for kept in self._kept:
            kept.keep(first, columns)
        self._rows = first + rows

    def results(self) -> dict[str, FloatArray]:
        """Results (..., N) of all folds by name, so far."""
        counting = self._counting[: self._members]
        rows = np.where(counting < 0, self._rows if self._sink is None else self._sink.rows, counting)
        if self._structure is not None:
            lanes = np.moveaxis(self._lanes, 1, 0).reshape(self._lanes.shape[1], -1)[:, : self._members]
            sizes = [size for state in self._states for size in map(len, state.values())]
            parts = iter(np.split(lanes, np.cumsum(sizes)[:-1]))
            self._states = [{name: next(parts) for name in state} for state in self._states]
        states, results = iter(self._states), dict[str, FloatArray]()
        for fold in self._folds:
            with np.errstate(all="ignore"):
                results |= fold.result(next(states) if isinstance(fold, TermFold) else {}, rows)
        return results


class FoldsOfRows(Folding, Observer):
    """A loop observer that passes rows to folds; `loop` is the one to be run, for the rest see `Folding`."""

    def __init__(self, loop: Loop, folds: Sequence[Fold], members: int = 1, kernels: FoldKernels | None = None) -> None:
        super().__init__(folds, members, kernels)
        self._reference, self._timing = members_last(loop.reference), loop.timing

    def sink(self) -> RowSink | None:
        """What takes the rows of a run in machine code, in place of `block`; None without kernels of all folds."""
        kernels = self._kernels
        if kernels is None or not all(name in ROW for fold in self._folds for name in fold.needs):
            return None
        folding, records, owned = self._compile(kernels, ROW), [], list[Any]()
        latest = lane_rows(ROW_PARTS["ELEMENTS"], len(self._counting) // WIDTH)
        for fold in self._kept:
            place = np.full(self._timing.steps + 1, -1, np.int64)
            place[fold.at] = np.arange(len(fold.at))
            for name, values in fold.kept.items():
                elements = np.arange(ROW[name].start, ROW[name].stop, dtype=np.int64)
                row, element, _ = (stride // values.itemsize for stride in values.strides)
                arrays = place.ctypes.data, len(elements), elements.ctypes.data, values.ctypes.data
                records.append(_KeptRows(*arrays, row, element))
                owned += [place, elements]
        kept_rows = (_KeptRows * len(records))(*records)
        function = ctypes.cast(kernels.add, ctypes.c_void_p).value
        places = ctypes.addressof(folding), latest.ctypes.data, len(records), ctypes.addressof(kept_rows)
        structure = _SinkStructure(function, *places)
        owned += [latest, kept_rows, structure]
        self._sink = RowSink(ctypes.addressof(structure), self._counting, owned)
        return self._sink

    def block(self, rows: RowBlock) -> None:
        """Fold a block."""
        n, first = rows.count, rows.first
        columns = {name: rows.signals[: n + 1, at] for name, at in AT.items()}
        columns[FORCES] = rows.forces[: n + 1]
        columns |= zip(LIMITED, (rows.force_limited[: n + 1], rows.rate_limited[: n + 1]), strict=True)
        motors = rows.motors if rows.motors.size else rows.signals[:, LEGS]
        columns |= {name: motors[: n + 1, k * N_LEGS : (k + 1) * N_LEGS] for k, name in enumerate(MOTORS)}
        for name, at in ERRORS.items():
            if self._reference is not None and any(name in fold.needs for fold in self._folds):
                signal = name.removeprefix("error.")
                error = error_between(signal, self._reference[first : first + n, at], columns[signal][1:])
                columns[name] = np.concatenate([error[:1], error])  # no fold uses the one before
        self.add(first, columns, rows.counting)

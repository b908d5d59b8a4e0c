"""The rows of a run: how they are kept, checked against limits, and passed on in blocks; how members end.

And what takes them: folds, fed with blocks of rows, or within the loop in machine code.
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

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
from gough_stewart.harness.loop.loop import LENGTHS, Loop, Timing, members_last
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import lane_rows
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.harness.plants.signals import LEGS, N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# Rows times members in a block, and the fewest rows. Smaller blocks cost calls, larger ones no longer fit into the
# processor's cache.
BLOCK_SIZE, _FEWEST = 8192, 16
# Rows that the machine code of folds gets at once.
_ROWS = 256
_INTEGER, _POINTER = ctypes.c_int64, ctypes.c_void_p

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

    def add(self, _inputs: FloatArray) -> None:
        """Count a row that the loop's machine code has written; inputs (N, 12) act from it on."""
        self.count += 1


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

    def add(self, inputs: FloatArray) -> None:
        """Count a row, evaluated again under the inputs (N, 12) that act from now on."""
        k = self.count + 1
        self.results[k], self.inputs[k] = self._plant.results().T, inputs.T
        self.count = k  # at last, since the plant may fail

    def block(self, rows: RowBlock) -> None:
        """Nothing: the rows are kept already."""


class RowMonitor:
    """Takes the rows of N members, ends members at limits and failures, and passes blocks of rows to an observer."""

    def __init__(self, loop: Loop, plant: Plant, observer: Observer) -> None:
        (n_members,) = plant.shape
        self._times, self._limits, self.observer = loop.timing.times, loop.limits, observer
        self._reference = members_last(loop.reference)
        self.outcomes: dict[int, Outcome] = {}  # of those that have ended before the end of the run
        self.rows = observer.start(loop.timing, plant, n_members)  # the block that is being filled
        self.n_rows = 0  # so far
        self.counting = np.full(n_members, len(self._times))  # how many rows count for each
        self.going = np.ones(n_members, dtype=bool)  # those without an outcome

    def end(
        self, whose: int | slice | BoolArray | np.bool_, rows: int, status: Status, cause: str | Callable[[int], str]
    ) -> None:
        """End those of these members, by number or flags (N,), that still run, after a number of rows."""
        for member in np.atleast_1d(np.arange(self.going.size)[whose]).tolist():
            if self.going[member]:
                text = cause if isinstance(cause, str) else cause(member)
                self.outcomes[member] = Outcome(status, float(self._times[max(rows - 1, 0)]), text)
                self.counting[member] = rows
                self.going[member] = False

    def beyond_stroke(self, now: FloatArray) -> str:
        """Why a run with these signals (24,) is stopped: its first leg that is beyond its stroke."""
        low, high = (signals.of_legs(end)[:, 0] for end in self._limits.stroke)  # only a single run stops there
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


# --- folds -----------------------------------------------------------------------------------------------------------


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

"""Folds over the rows of a run: what is kept of them, for one member or many.

1. A fold names the columns it needs, as a record does. Rows come in blocks: columns (rows + 1, size, N) that begin with
   the row before, so that a result does not depend on where blocks end. The row before the first is the first itself.
2. A `TermFold` is described once, for one row after the other: traced to C, and in NumPy where there is no machine
   code. A sum takes one row after the other, with the state as its first term. So a member's sums have the same bits
   alone, among others, and for every size of blocks.
3. `terms` gives named arrays of a row: a pure function of columns of the row and the row before it, the row's index and
   the fold's parameters; not of the error of the row before. Nothing branches on a value: what compares is in
   `model/vectors.py`. Arrays have elements and members last, (size, N): numbers of N members, or CasADi symbols of
   one.
4. Each term has reductions, which `next` defines from row to row. A member's state stays as it was at its last row.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.plants import signals
from gough_stewart.model.rotations import rotation_between
from gough_stewart.model.vectors import Array, FloatArray, Scalars, maximum, minimum, where

if TYPE_CHECKING:
    from gough_stewart.fmu_build.libraries import FoldKernel

FORCES, LIMITED = "actuator_force", ("flag.force_limited", "flag.rate_limited")
# What the drives move; of rigid legs their lengths and velocities.
MOTORS = tuple(signals.AT_MOTORS.values())
AT = {name: slice(int(at[0]), int(at[-1]) + 1) for name in signals.NAMES if len(at := signals.positions([name]))}
# Signals that have errors, see `error_between`, and their places among signals and references.
ERRORS: Mapping[str, slice] = {f"error.{name}": AT[name] for name in ("position", "orientation", "leg_length")}


# Places of columns in a row of machine code: signals, forces, errors, flags, motors; and where these parts begin.
_NAMES = (*AT, FORCES, *ERRORS, *LIMITED, *MOTORS)
_WIDTHS = {name: at.stop - at.start for name, at in {**AT, **ERRORS}.items()}
_ENDS = list(accumulate(_WIDTHS.get(name, signals.N_LEGS) for name in _NAMES))
ROW: Mapping[str, slice] = dict(zip(_NAMES, map(slice, [0, *_ENDS], _ENDS), strict=True))
ROW_PARTS: Mapping[str, int] = {
    "FORCES": ROW[FORCES].start,
    "ERRORS": ROW[next(iter(ERRORS))].start,
    "FLAGS": ROW[LIMITED[0]].start,
    "MOTORS": ROW[MOTORS[0]].start,
    "ELEMENTS": ROW[MOTORS[-1]].stop,
}

State = dict[str, NDArray[Any]]
Columns = Mapping[str, NDArray[Any]]
# Whether elements of an array and a bound have a relation.
Comparison = Callable[[Array, Scalars], Array]


def error_between(name: str, reference: FloatArray, actual: FloatArray) -> FloatArray:
    """The error of a signal (..., size, N): reference − actual, or of orientations the rotation from actual to it."""
    if name != "orientation":
        return np.asarray(reference - actual)
    turn = rotation_between(*(np.moveaxis(angles, -2, -1) for angles in (actual, reference)))
    return np.moveaxis(turn, -1, -2)


class Fold(Protocol):
    """What is kept of the rows of a run: a `TermFold`, `KeptRows`, or only the number of rows."""

    needs: Sequence[str] = ()  # columns of the rows

    def result(self, _state: State, _rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """Results (..., N) by name for members with these numbers of rows (N,); NaN where undefined."""
        return {}


class KeptRows(Fold):
    """A fold that keeps columns at some rows, also those after a member has ended."""

    at: NDArray[np.intp]  # the rows, in order
    kept: Mapping[str, FloatArray] = {}  # by column (rows, size, N), from `start` on

    def start(self, members: int) -> State:
        """Make room for members; there is no other state."""
        raise NotImplementedError

    def keep(self, first: int, columns: Columns) -> None:
        """Keep those rows of a block whose turn it is; of columns that the block lacks, NaN."""
        n = len(next(iter(columns.values()))) - 1
        places = slice(*np.searchsorted(self.at, (first, first + n)).tolist())
        for name, values in self.kept.items():
            values[places] = columns[name][1:][self.at[places] - first] if name in columns else np.nan


@dataclass(frozen=True, eq=False)
class TermRow:
    """What the terms of a row are computed from."""

    columns: Mapping[str, Array]  # (size, N), by the names that the terms use
    before: Mapping[str, Array]  # those of the row before
    index: Array  # of the row (1, 1)
    parameters: Mapping[str, Array]  # of the fold (1, N) or (1, 1), by leg (6, N) or (6, 1)

    def __getitem__(self, column: str) -> Array:
        return self.columns[column]


Kind = Literal["sum", "sum but last", "largest", "smallest", "last", "first", "after last"]
# First values of what reductions keep of a term over the rows, by the name of the part, added to the reduction's.
STARTS: Mapping[Kind, Mapping[str, float]] = {
    "sum": {"": 0.0},
    "sum but last": {"": 0.0, ".last": 0.0},  # over the rows but the last, and the last
    "largest": {"": -np.inf},
    "smallest": {"": np.inf},
    "last": {"": 0.0},
    "first": {"": np.inf},  # the first row at which the term has a relation to a bound, infinite if none has
    "after last": {"": 0.0},  # the row after the last at which it has, 0 if none has
}


@dataclass(frozen=True)
class Reduction:
    """What is kept of a term over the rows, and of some kinds how it relates to a number or a parameter."""

    kind: Kind
    term: str
    relation: Comparison | None = None
    bound: str | float = 0.0

    def next(self, state: tuple[Array, ...], values: Array, row: TermRow) -> tuple[Array, ...]:
        """The state after a row in which the term has these values (size, N), from that before."""
        so_far = state[0]
        following = values
        if self.kind in ("sum", "sum but last"):
            following = so_far + (values if self.kind == "sum" else state[1])
        elif self.kind in ("largest", "smallest"):
            following = (maximum if self.kind == "largest" else minimum)(so_far, values)
        elif self.relation is not None:
            bound = row.parameters[self.bound] if isinstance(self.bound, str) else self.bound
            at = minimum(so_far, row.index) if self.kind == "first" else row.index + 1.0
            following = where(self.relation(values, bound), at, so_far)
        return (following, values) if self.kind == "sum but last" else (following,)


class TermFold(Fold):
    """A fold that is described by terms and reductions; see the rules above.

    Folds with a kernel of the same name differ in nothing but their columns' names and parameters.
    """

    kernel: str  # the description's name
    sizes: Mapping[str, int]  # of the columns, by the names that the terms use, in the order of `needs`
    begins: Mapping[str, int] = {}  # their first elements in the rows' columns, by default 0
    term_sizes: Mapping[str, int]
    reductions: Mapping[str, Reduction]  # by the names of their states
    parameters: Mapping[str, Any]  # a number, or one per member (N,); by leg (6, N) or (6, 1)

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """The terms of a row by name."""
        raise NotImplementedError

    @property
    def states(self) -> list[tuple[str, int, float]]:
        """Names, sizes and first values of the arrays that reductions keep, in order."""
        return [
            (f"{name}{part}", self.term_sizes[reduction.term], value)
            for name, reduction in self.reductions.items()
            for part, value in STARTS[reduction.kind].items()
        ]

    @property
    def parameter_sizes(self) -> list[int]:
        """How many numbers each parameter has for a member."""
        return [np.shape(value)[0] if np.ndim(value) > 1 else 1 for value in self.parameters.values()]

    def add(self, state: State, first: int, columns: Columns, counting: NDArray[np.int64]) -> None:
        """Reduce one row of a block after the other, as many of them as count for each member (N,)."""
        parts = {}
        for name, column in zip(self.sizes, self.needs, strict=True):
            begin = self.begins.get(name, 0)
            parts[name] = columns[column][:, begin : begin + self.sizes[name]]
        parameters = {name: np.atleast_2d(value) for name, value in self.parameters.items()}
        for k in range(int(counting.max(initial=0))):
            before = k if first + k else k + 1
            row = TermRow(
                {name: values[k + 1] for name, values in parts.items()},
                {name: values[before] for name, values in parts.items()},
                np.array([[first + k]], float),
                parameters,
            )
            for name, values in self._next(state, row).items():
                np.copyto(state[name], values, where=counting > k)

    def _next(self, state: State, row: TermRow) -> State:
        """The state after a row, from that before."""
        following = State()
        for term, values in self.terms(row):
            for name, reduction in self.reductions.items():
                if reduction.term == term:
                    names = [f"{name}{part}" for part in STARTS[reduction.kind]]
                    after = reduction.next(tuple(state[part] for part in names), values, row)
                    following |= dict(zip(names, after, strict=True))
        return following

    def traced(self) -> "FoldKernel":
        """The states after a row, from those before."""
        import casadi  # needed once, to build

        from gough_stewart.fmu_build.libraries import FoldKernel

        def symbols(name: str, size: int) -> Array:
            return column_of(casadi.SX.sym(name, size))

        row, before = (
            {name: symbols(f"{of_row}{k}", size) for k, (name, size) in enumerate(self.sizes.items())}
            for of_row in ("row", "before")
        )
        sizes = self.parameter_sizes
        index, parameters = symbols("index", 1), symbols("parameters", sum(sizes))
        state = {name: symbols("state", size) for name, size, _ in self.states}
        named = dict(zip(self.parameters, np.split(parameters, np.cumsum(sizes)[:-1]), strict=True)) if sizes else {}
        following = self._next(state, TermRow(row, before, index, named))
        columns = [*row.values(), *before.values()]
        inputs = [*(joined([part]) for part in (*columns, index, parameters)), joined(state.values())]
        names = [f"{of_row}{k}" for of_row in ("row", "before") for k in range(len(row))]
        names += ["index", "parameters", "state"]
        outputs = [joined(following[name] for name in state)]
        return FoldKernel(casadi.Function(self.kernel, inputs, outputs, names, ["next"]), len(row))


def column_of(vector: Any) -> Array:
    """The elements of a CasADi vector as an array (n, 1)."""
    return np.array([[vector[k]] for k in range(vector.numel())], dtype=object)


def joined(arrays: Iterable[Array]) -> Any:
    """The CasADi vector of the elements of arrays, one after the other."""
    import casadi

    return casadi.vertcat(*(element for array in arrays for element in np.ravel(array)))

"""Folds that are described once, for one row after the other: traced to C, and in NumPy where there is no machine code.

1. `terms` gives named arrays of a row: a pure function of columns of the row and the row before it, the row's index and
   the fold's parameters; not of the error of the row before. The row before the first is the first itself.
2. Nothing branches on a value: what compares is in `model/operations.py`. Arrays have elements and members last,
   (size, N): numbers of N members, or CasADi symbols of one.
3. Each term has reductions, which `next` defines from row to row.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gough_stewart.harness.loop.folds import Block, Fold, State
from gough_stewart.model.operations import maximum, minimum, where
from gough_stewart.model.vectors import Array, Scalars

if TYPE_CHECKING:
    from gough_stewart.fmu_build.libraries import FoldKernel

# Whether elements of an array and a bound have a relation.
Comparison = Callable[[Array, Scalars], Array]


@dataclass(frozen=True, eq=False)
class TermRow:
    """What the terms of a row are computed from."""

    columns: Mapping[str, Array]  # (size, N), by the names that the terms use
    before: Mapping[str, Array]  # those of the row before
    index: Array  # of the row (1, 1)
    parameters: Mapping[str, Array]  # of the fold (1, N) or (1, 1)

    def __getitem__(self, column: str) -> Array:
        return self.columns[column]

    def bound(self, bound: str | float) -> Any:
        """A number, or that of a parameter."""
        return self.parameters[bound] if isinstance(bound, str) else bound


class Reduction:
    """What is kept of a term over the rows: one array of its size, or several."""

    starts: ClassVar[Mapping[str, float]]  # by the part's name, which is added to that of the reduction

    def __init__(self, term: str) -> None:
        self.term = term

    def next(self, state: tuple[Array, ...], values: Array, row: TermRow) -> tuple[Array, ...]:
        """The state after a row in which the term has these values (size, N), from that before."""
        raise NotImplementedError


class Sum(Reduction):
    """The sum over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, state: tuple[Array, ...], values: Array, _row: TermRow) -> tuple[Array, ...]:
        return (state[0] + values,)


class SumButLast(Reduction):
    """The sum over the rows but the last, and, as `.last`, the last."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0, ".last": 0.0}

    def next(self, state: tuple[Array, ...], values: Array, _row: TermRow) -> tuple[Array, ...]:
        return state[0] + state[1], values


class Largest(Reduction):
    """The largest over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": -np.inf}

    def next(self, state: tuple[Array, ...], values: Array, _row: TermRow) -> tuple[Array, ...]:
        return (maximum(state[0], values),)


class Smallest(Reduction):
    """The smallest over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": np.inf}

    def next(self, state: tuple[Array, ...], values: Array, _row: TermRow) -> tuple[Array, ...]:
        return (minimum(state[0], values),)


class Last(Reduction):
    """The term of the last row."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, _state: tuple[Array, ...], values: Array, _row: TermRow) -> tuple[Array, ...]:
        return (values,)


class First(Reduction):
    """The first row at which the term has a relation to a number or a parameter, infinite if none has."""

    starts: ClassVar[Mapping[str, float]] = {"": np.inf}

    def __init__(self, term: str, relation: Comparison, bound: str | float) -> None:
        super().__init__(term)
        self.relation, self.bound = relation, bound

    def next(self, state: tuple[Array, ...], values: Array, row: TermRow) -> tuple[Array, ...]:
        holds = self.relation(values, row.bound(self.bound))
        return (where(holds, minimum(state[0], row.index), state[0]),)


class AfterLast(First):
    """The row after the last at which the term has a relation, 0 if none has."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, state: tuple[Array, ...], values: Array, row: TermRow) -> tuple[Array, ...]:
        holds = self.relation(values, row.bound(self.bound))
        return (where(holds, row.index + 1.0, state[0]),)


class TermFold(Fold):
    """A fold that is described by terms and reductions; see the rules above.

    Attributes
    ----------
    kernel
        The description's name; folds of the same name differ in nothing but their columns' names and parameters.
    needs
        Columns of the rows that the terms use.
    sizes
        Of the columns, by the names that the terms use, in the order of `needs`.
    begins
        Their first elements in the rows' columns, by default 0.
    term_sizes
        Of the terms.
    reductions
        By the names of their states.
    parameters
        A number, or one per member (N,).
    """

    kernel: str
    sizes: Mapping[str, int]
    begins: Mapping[str, int] = {}
    term_sizes: Mapping[str, int]
    reductions: Mapping[str, Reduction]
    parameters: Mapping[str, Any]

    def terms(self, row: TermRow) -> Iterator[tuple[str, Array]]:
        """The terms of a row by name."""
        raise NotImplementedError

    def start(self, members: int) -> State:
        """The reductions of no rows."""
        return {name: np.full((size, members), value) for name, size, value in self.states}

    @property
    def states(self) -> list[tuple[str, int, float]]:
        """Names, sizes and first values of the arrays that reductions keep, in order."""
        return [
            (f"{name}{part}", self.term_sizes[reduction.term], value)
            for name, reduction in self.reductions.items()
            for part, value in reduction.starts.items()
        ]

    def rows(self, state: State, block: Block) -> None:
        """Reduce the terms of one row after the other."""
        values, before = State(), State()
        for name, column in zip(self.sizes, self.needs, strict=True):
            elements = slice(self.begins.get(name, 0), self.begins.get(name, 0) + self.sizes[name])
            values[name] = block[column][:, elements]
            if not column.startswith("error."):  # computed from the reference, which the block has of its own rows
                before[name] = block.before(column)[:, elements]
        parameters = {name: np.atleast_2d(value) for name, value in self.parameters.items()}
        for k in range(block.rows):
            row, previous = ({name: column[k] for name, column in part.items()} for part in (values, before))
            following = self._next(state, TermRow(row, previous, np.array([[block.first + k]], float), parameters))
            for name, array in following.items():
                state[name][...] = array

    def _next(self, state: State, row: TermRow) -> State:
        """The state after a row, from that before."""
        following = State()
        for term, values in self.terms(row):
            for name, reduction in self.reductions.items():
                if reduction.term == term:
                    names = [f"{name}{part}" for part in reduction.starts]
                    after = reduction.next(tuple(state[part] for part in names), values, row)
                    following |= dict(zip(names, after, strict=True))
        return following

    def traced(self) -> "FoldKernel":
        """The states after a row, from those before."""
        import casadi  # needed once, to build

        from gough_stewart.fmu_build.libraries import FoldKernel

        def symbols(name: str, size: int) -> Array:
            vector = casadi.vertsplit(casadi.SX.sym(name, size)) if size else []
            return np.array([[symbol] for symbol in vector], dtype=object)

        def joined(arrays: Iterable[Array]) -> Any:
            return casadi.vertcat(*(symbol for array in arrays for symbol in np.ravel(array)))

        row, before = (
            {name: symbols(f"{of_row}{k}", size) for k, (name, size) in enumerate(self.sizes.items())}
            for of_row in ("row", "before")
        )
        index, parameters = symbols("index", 1), symbols("parameters", len(self.parameters))
        state = {name: symbols("state", size) for name, size, _ in self.states}
        named = {name: parameters[k : k + 1] for k, name in enumerate(self.parameters)}
        following = self._next(state, TermRow(row, before, index, named))
        columns = [*row.values(), *before.values()]
        inputs = [*(joined([part]) for part in (*columns, index, parameters)), joined(state.values())]
        names = [f"{of_row}{k}" for of_row in ("row", "before") for k in range(len(row))]
        names += ["index", "parameters", "state"]
        outputs = [joined(following[name] for name in state)]
        return FoldKernel(casadi.Function(self.kernel, inputs, outputs, names, ["next"]), len(row))

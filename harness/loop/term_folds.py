"""Folds that are described once, for blocks of rows in NumPy and, traced, for one row after the other in C.

1. `terms` gives named arrays of a row: a pure function of columns of the row and the row before it, the row's index and
   the fold's parameters. The row before the first is the first itself.
2. Nothing branches on a value: what compares is in `model/operations.py`. Arrays have elements and members last,
   (..., size, N): of all rows of a block, or one member of CasADi symbols.
3. Each term has reductions. `next` defines one, from row to row; `block` does the same for many rows at once, with the
   same bits: sums take one row after the other, and all else does not depend on the order.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from gough_stewart.harness.loop.folds import Block, Fold, State, add_rows
from gough_stewart.model.operations import maximum, minimum, where
from gough_stewart.model.vectors import Array, FloatArray, Scalars

if TYPE_CHECKING:
    from gough_stewart.fmu_build.libraries import FoldKernel

# Whether elements of an array and a bound have a relation; if any element has it, the largest has.
Comparison = Callable[[Array, Scalars], Array]


class Given(Protocol):
    """What the terms of a row are computed from."""

    index: Array  # of the row (..., 1, 1)

    def __getitem__(self, column: str) -> Array:
        """A column of the row (..., size, N)."""

    def before(self, column: str) -> Array:
        """A column of the row before."""

    def of(self, parameter: str) -> Array:
        """A parameter of the fold (1, N) or (1, 1)."""


class Term:
    """A term of a row, or of the rows of a block, with what several reductions use."""

    def __init__(self, given: Given, values: Array) -> None:
        self.given, self.values = given, values

    @cached_property
    def largest(self) -> FloatArray:
        """The largest over the rows (size, N)."""
        return np.asarray(np.maximum.reduce(self.values))

    def bound(self, bound: str | float) -> Any:
        """A number, or that of a parameter."""
        return self.given.of(bound) if isinstance(bound, str) else bound


class Reduction:
    """What is kept of a term over the rows: one array of its size, or several."""

    starts: ClassVar[Mapping[str, float]]  # by the part's name, which is added to that of the reduction

    def __init__(self, term: str) -> None:
        self.term = term

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        """The state after a row, from that before."""
        raise NotImplementedError

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        """The same in place, for the terms of a block (rows, size, N)."""
        raise NotImplementedError


class Sum(Reduction):
    """The sum over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        return (state[0] + term.values,)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        _add(state[0], term.values)


class SumButLast(Reduction):
    """The sum over the rows but the last, and, as `.last`, the last."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0, ".last": 0.0}

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        return state[0] + state[1], term.values

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        total, last = state
        total += last
        last[...] = term.values[-1]
        _add(total, term.values[:-1])


class Largest(Reduction):
    """The largest over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": -np.inf}

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        return (maximum(state[0], term.values),)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        np.maximum(state[0], term.largest, out=state[0])


class Smallest(Reduction):
    """The smallest over the rows."""

    starts: ClassVar[Mapping[str, float]] = {"": np.inf}

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        return (minimum(state[0], term.values),)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        np.minimum(state[0], np.minimum.reduce(term.values), out=state[0])


class Last(Reduction):
    """The term of the last row."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, _state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        return (term.values,)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        state[0][...] = term.values[-1]


class First(Reduction):
    """The first row at which the term has a relation to a number or a parameter, infinite if none has."""

    starts: ClassVar[Mapping[str, float]] = {"": np.inf}

    def __init__(self, term: str, has: Comparison, bound: str | float) -> None:
        super().__init__(term)
        self._has, self._bound = has, bound

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        here = self._has(term.values, term.bound(self._bound))
        return (where(here, minimum(state[0], term.given.index), state[0]),)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        bound = term.bound(self._bound)
        # most blocks are before or after
        new = np.asarray(self._has(term.largest, bound), dtype=bool) & np.isinf(state[0])
        if new.any():
            here = self._has(term.values, bound)
            np.copyto(state[0], term.given.index[0] + here.argmax(axis=0), where=new)


class AfterLast(First):
    """The row after the last at which the term has a relation, 0 if none has."""

    starts: ClassVar[Mapping[str, float]] = {"": 0.0}

    def next(self, state: tuple[Array, ...], term: Term) -> tuple[Array, ...]:
        here = self._has(term.values, term.bound(self._bound))
        return (where(here, term.given.index + 1.0, state[0]),)

    def block(self, state: tuple[FloatArray, ...], term: Term) -> None:
        here = np.asarray(self._has(term.values, term.bound(self._bound)), dtype=bool)
        if here[-1].all():
            state[0][...] = term.given.index[-1] + 1.0
        elif here.any():
            after = term.given.index[-1] + 1.0 - here[::-1].argmax(axis=0)
            np.copyto(state[0], after, where=here.any(axis=0))


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

    def terms(self, row: Given) -> Iterator[tuple[str, Array]]:
        """The terms of a row by name, one after the other, since few arrays fit into the processor's cache."""
        raise NotImplementedError

    def reductions_of(self, term: str) -> Iterator[tuple[tuple[str, ...], Reduction]]:
        """The reductions of a term, with the names of the arrays that they keep."""
        for name, reduction in self.reductions.items():
            if reduction.term == term:
                yield tuple(f"{name}{part}" for part in reduction.starts), reduction

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
        """Reduce the terms of a block."""
        given = _OfBlock(self, block)
        for name, values in self.terms(given):
            term = Term(given, values)
            for names, reduction in self.reductions_of(name):
                reduction.block(tuple(state[name] for name in names), term)

    def traced(self) -> "FoldKernel":
        """The states after a row, from those before."""
        import casadi  # needed once, to build

        from gough_stewart.fmu_build.libraries import FoldKernel

        def symbols(name: str, size: int) -> Array:
            return np.array(
                [[each] for each in casadi.vertsplit(casadi.SX.sym(name, size))] if size else [], dtype=object
            )

        columns, parameters = list(self.sizes.items()), list(self.parameters)
        row, before = ([symbols(f"{of}{k}", size) for k, (_, size) in enumerate(columns)] for of in ("row", "before"))
        index, given = symbols("index", 1), symbols("parameters", len(parameters))
        states = {name: symbols("state", size) for name, size, _ in self.states}
        of_row = _OfSymbols(
            dict(zip(self.sizes, row, strict=True)),
            dict(zip(self.sizes, before, strict=True)),
            index,
            {name: given[k : k + 1] for k, name in enumerate(parameters)},
        )
        found = dict[str, Array]()
        for name, values in self.terms(of_row):
            for names, reduction in self.reductions_of(name):
                following = reduction.next(tuple(states[each] for each in names), Term(of_row, values))
                found |= dict(zip(names, following, strict=True))

        def joined(arrays: Iterable[Array]) -> Any:
            return casadi.vertcat(*(each for array in arrays for each in np.ravel(array)))

        inputs = [*(joined([each]) for each in (*row, *before, index, given)), joined(states.values())]
        of_columns = (f"{of}{k}" for of in ("row", "before") for k in range(len(columns)))
        given_names, following_states = [*of_columns, "index", "parameters", "state"], joined(found[n] for n in states)
        return FoldKernel(casadi.Function(self.kernel, inputs, [following_states], given_names, ["next"]), len(columns))


class _OfSymbols:
    """What the terms of a row are computed from, as symbols."""

    def __init__(
        self, row: Mapping[str, Array], before: Mapping[str, Array], index: Array, parameters: Mapping[str, Array]
    ) -> None:
        self._row, self._before, self.index, self._parameters = row, before, index, parameters

    def __getitem__(self, column: str) -> Array:
        return self._row[column]

    def before(self, column: str) -> Array:
        return self._before[column]

    def of(self, parameter: str) -> Array:
        return self._parameters[parameter]


class _OfBlock:
    """What the terms of all rows of a block are computed from."""

    def __init__(self, fold: TermFold, block: Block) -> None:
        self._block, self._parameters = block, fold.parameters
        self._columns = {
            name: (column, slice(begin := fold.begins.get(name, 0), begin + fold.sizes[name]))
            for name, column in zip(fold.sizes, fold.needs, strict=True)
        }
        self.index: Array = np.arange(block.first, block.first + block.rows, dtype=float)[:, None, None]

    def __getitem__(self, column: str) -> Array:
        name, elements = self._columns[column]
        return self._block[name][:, elements]

    def before(self, column: str) -> Array:
        name, elements = self._columns[column]
        return self._block.before(name)[:, elements]

    def of(self, parameter: str) -> Array:
        return np.atleast_2d(self._parameters[parameter])


def _add(total: FloatArray, terms: Array) -> None:
    """Add terms (rows, size, N) to a total."""
    if terms.dtype != bool:
        add_rows(total, terms)
    elif terms.any():
        total += np.count_nonzero(terms, axis=0)

"""Products of many members' sparse matrices with their vectors, element by element in a fixed order.

BLAS sums in an order that depends on the sizes, so the last bits of a member's result would depend on the other
members. Here row i of y = M x is M_ij x_j + M_ik x_k + …, columns ascending, for every member alike. Elements are
grouped along chains of the matrix, (i, j), (i + r, j + c), (i + 2 r, j + 2 c), …: with six channels side by side, one
chain for each kind of element.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray


class _Chain(NamedTuple):
    rows: slice
    columns: slice
    values: FloatArray  # (length, N)
    rank: int  # of its elements within their rows

    @property
    def is_first(self) -> bool:
        """Whether its elements are the first of their rows."""
        return self.rank == 0


class Product:
    """y = M x for members whose matrices (N, rows, columns), or one for all (rows, columns), share a zero pattern."""

    def __init__(self, matrices: FloatArray, n_members: int) -> None:
        M = np.broadcast_to(matrices, (n_members, *matrices.shape[-2:]))
        self._chains = [
            _Chain(_every(rows), _every(columns), np.ascontiguousarray(M[:, rows, columns].T), rank)
            for rank, rows, columns in _chains((M != 0).any(axis=0))
        ]
        self._work = np.zeros((M.shape[1], n_members))

    def of(self, x: FloatArray, y: FloatArray) -> Callable[[], None]:
        """A function that writes M x of x (columns, N) into y (rows, N), always these arrays; empty rows stay."""
        # views are made in advance: making one takes Python as long as the arithmetic
        steps: list[tuple[np.ufunc, FloatArray, FloatArray, FloatArray]] = []
        for stack in _stacked(self._chains):
            first = stack[0]
            rows, size = (
                slice(first.rows.start, stack[-1].rows.stop, first.rows.step),
                (len(stack), *first.values.shape),
            )
            values, to = np.stack([each.values for each in stack]), y[rows]
            to.shape = size  # never a copy
            term = to if first.is_first else self._work[: math.prod(size[:2])].reshape(size)
            steps.append((np.multiply, values, x[first.columns], term))
            if not first.is_first:
                steps.append((np.add, to, term, to))

        def product() -> None:
            for operation, a, b, out in steps:
                operation(a, b, out)

        return product


def _stacked(chains: Sequence[_Chain]) -> list[list[_Chain]]:
    """Chains of the same columns whose rows follow each other, which are one operation."""
    by_column = sorted(chains, key=lambda each: (each.columns.start, each.rows.start))
    stacks: list[list[_Chain]] = []
    for chain in by_column if _in_order(by_column) else chains:
        last = stacks[-1][-1] if stacks else None
        if (
            last is not None
            and (last.columns, last.is_first, len(last.values)) == (chain.columns, chain.is_first, len(chain.values))
            and last.rows.step == chain.rows.step == 1
            and last.rows.stop == chain.rows.start
        ):
            stacks[-1].append(chain)
        else:
            stacks.append([chain])
    return stacks


def _in_order(chains: Sequence[_Chain]) -> bool:
    """Whether the terms of each row come columns ascending."""
    latest = dict[int, int]()
    for chain in chains:
        for row in range(chain.rows.start, chain.rows.stop, chain.rows.step):
            if latest.get(row, -1) != chain.rank - 1:
                return False
            latest[row] = chain.rank
    return True


class MatrixProducts:
    """M v of matrices (n, n, N) or (n, n, 1) and vectors (n, N), as a sum of columns in fixed order."""

    def __init__(self, n: int, n_members: int) -> None:
        # NumPy sums a single column in another order, so one member is there twice
        self._n_members = n_members
        self._terms = np.zeros((n, n, max(n_members, 2)))

    def __call__(self, matrices: FloatArray, vectors: FloatArray) -> FloatArray:
        """A new array (n, N)."""
        np.multiply(matrices, vectors, out=self._terms)
        return np.asarray(np.add.reduce(self._terms, axis=1)[:, : self._n_members])


def _every(numbers: NDArray[np.intp]) -> slice:
    """Indices as a slice, if they are equally spaced or all the same."""
    first, last = int(numbers[0]), int(numbers[-1])
    return slice(first, last + 1, max(1, int(numbers[1]) - first) if len(numbers) > 1 else 1)


def _chains(pattern: NDArray[np.bool_]) -> list[tuple[int, NDArray[np.intp], NDArray[np.intp]]]:
    """All elements of a pattern: their rank within their row, rows and columns, lower ranks first."""
    found = []
    rank = pattern.cumsum(axis=1) - 1
    for k in range(int(rank.max(initial=-1)) + 1):
        left = [(int(i), int(j)) for i, j in np.argwhere(pattern & (rank == k))]
        while left:
            chain = max((_chain_from(left[0], each, left) for each in left), key=len)
            left = [each for each in left if each not in chain]
            rows, columns = np.array(chain).T
            found.append((k, rows, columns))
    return found


def _chain_from(first: tuple[int, int], second: tuple[int, int], among: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Elements that continue the step between these two."""
    r, c = second[0] - first[0], second[1] - first[1]
    chain = [first]
    while r > 0 and c >= 0 and (chain[-1][0] + r, chain[-1][1] + c) in among:
        chain.append((chain[-1][0] + r, chain[-1][1] + c))
    return chain

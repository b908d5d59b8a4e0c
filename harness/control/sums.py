"""Products of many members' sparse matrices with their vectors, element by element in a fixed order.

BLAS sums in an order that depends on the sizes, so the last bits of a member's result would depend on the other
members. Here row i of y = M x is M_ij x_j + M_ik x_k + …, columns ascending, for every member alike. Elements are
grouped along chains of the matrix, (i, j), (i + r, j + c), (i + 2 r, j + 2 c), …: with six channels side by side, one
chain for each kind of element.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray


class _Chain(NamedTuple):
    rows: slice
    columns: slice
    values: FloatArray  # (length, N)
    is_first: bool  # element of its row


class Product:
    """y = M x for members whose matrices (N, rows, columns), or one for all (rows, columns), share a zero pattern."""

    def __init__(self, matrices: FloatArray, n_members: int) -> None:
        M = np.broadcast_to(matrices, (n_members, *matrices.shape[-2:]))
        self._chains = [
            _Chain(_every(rows), _every(columns), np.ascontiguousarray(M[:, rows, columns].T), rank == 0)
            for rank, rows, columns in _chains((M != 0).any(axis=0))
        ]
        self._work = np.zeros((M.shape[1], n_members))

    def of(self, x: FloatArray, y: FloatArray) -> Callable[[], None]:
        """A function that writes M x of x (columns, N) into y (rows, N), always these arrays; empty rows stay."""
        # views are made in advance: making one takes Python as long as the arithmetic
        steps: list[tuple[np.ufunc, FloatArray, FloatArray, FloatArray]] = []
        for rows, columns, values, is_first in self._chains:
            term = y[rows] if is_first else self._work[: len(values)]
            steps.append((np.multiply, values, x[columns], term))
            if not is_first:
                steps.append((np.add, y[rows], term, y[rows]))

        def product() -> None:
            for operation, a, b, out in steps:
                operation(a, b, out)

        return product


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
    return slice(first, last + 1, max(1, int(numbers[1]) - first)) if len(numbers) > 1 else slice(first, first + 1)


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

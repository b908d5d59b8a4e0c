"""CasADi symbols in the shapes that the equations use, and Functions of the symbols that an expression needs."""

from collections.abc import Iterable, Mapping
from typing import Any

import casadi
import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.parameters import Parameters, Variable
from gough_stewart.model.vectors import Array

Symbols = Mapping[str, casadi.SX]


def elements(vector: casadi.SX) -> Array:
    """(n,) object array of a vector's elements."""
    return np.array([vector[i] for i in range(vector.numel())], dtype=object)


def row(vector: casadi.SX) -> Array:
    """(1, n), as the equations require: NumPy turns object arrays without axes into bare scalars."""
    return elements(vector)[None, :]


def column(array: Any) -> casadi.SX:
    """casadi.SX (n, 1) of an array's elements, row by row."""
    return casadi.SX(casadi.vertcat(*np.asarray(array).reshape(-1)))


def sparse(matrix: Array) -> casadi.SX:
    """casadi.SX of an array (m, n), without its zeros."""
    m, n = matrix.shape
    return casadi.sparsify(casadi.reshape(column(matrix.T), m, n)) if matrix.size else casadi.SX(m, n)


def solve(matrix: Array, right: Array) -> Array:
    """As `numpy.linalg.solve`, for arrays (n, n) and (n,) or (n, m) of symbols; block by block where zeros allow it."""
    columns = right.reshape(len(right), -1)
    if not columns.size:
        return right
    A, b = sparse(matrix), sparse(columns)
    # block lower triangular: rows and columns of each block, in order
    _, rows, cols, row_ends, col_ends, _, _ = A.sparsity().btf()
    solution = casadi.SX(*b.shape)
    for k in range(len(row_ends) - 1):
        at_rows, at_cols = rows[row_ends[k] : row_ends[k + 1]], cols[col_ends[k] : col_ends[k + 1]]
        known = cols[: col_ends[k]]
        left = b[at_rows, :] - A[at_rows, known] @ solution[known, :] if known else b[at_rows, :]
        solution[at_cols, :] = casadi.solve(A[at_rows, at_cols], left)
    return elements(casadi.vec(casadi.densify(solution).T)).reshape(right.shape)


def platform_symbols(parameters: Iterable[Variable]) -> dict[str, casadi.SX]:
    """Physical parameters of the platform by name, flat, row by row."""
    return {v.name: casadi.SX.sym(v.name, v.size) for v in parameters}


def parameters_of(symbols: Symbols) -> Parameters:
    """The same parameters in the form of the equations; those that are missing are factors of 1."""
    values = {v.name: symbols.get(v.name, casadi.SX.ones(v.size)) for v in interface.PLATFORM_PARAMETERS}
    return Parameters(**{v.name: elements(values[v.name]).reshape(1, *v.shape) for v in interface.PLATFORM_PARAMETERS})


def function(name: str, inputs: Symbols, outputs: Mapping[str, casadi.SX]) -> casadi.Function:
    """A Function of those inputs on which the outputs depend."""
    results = casadi.cse([casadi.densify(v) for v in outputs.values()])
    everything = casadi.vertcat(*results)
    used = {key: v for key, v in inputs.items() if v.numel() and casadi.depends_on(everything, v)}
    return casadi.Function(name, list(used.values()), results, list(used), list(outputs))

"""CasADi symbols in the shapes that the equations use: vectors, linear equations, and what is relative to home.

A float resolves 0.24 µm at 3 m. Relative to home, positions and leg lengths are smaller, and they are computed from
differences, which single precision does not cancel: L − L₀ = (2 l₀ + Δ)·Δ/(L + L₀), with Δ = t − t₀ + (R − R₀) p.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import Array, FloatArray

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


class Home(NamedTuple):
    """What signals are relative to."""

    position: FloatArray  # [m]
    orientation: FloatArray  # [rad]
    leg_length: FloatArray  # [m]

    @property
    def pose(self) -> FloatArray:
        """Position and orientation (6,)."""
        return np.concatenate([self.position, self.orientation])

    def of(self, name: str, size: int) -> FloatArray:
        """The value of a signal at home (size,); zeros for rates."""
        return np.asarray(getattr(self, name, np.zeros(size)), dtype=float)


def home_of(platform: Platform) -> Home:
    """The home pose and its legs."""
    position, orientation = np.asarray(platform.home_position), np.asarray(platform.home_orientation)
    return Home(position, orientation, np.asarray(leg_geometry(platform, position, orientation).length))


def change_of_lengths(parameters: Parameters, home: Home, pose: casadi.SX) -> casadi.SX:
    """L − L₀ (6,) of symbols of a platform at a pose relative to home (6,).

    R − R₀ = ΔRz Ry Rx + Rz₀ ΔRy Rx + Rz₀ Ry₀ ΔRx; and cos(α₀ + δ) − cos α₀ = −2 sin(α₀ + δ/2) sin(δ/2),
    sin(α₀ + δ) − sin α₀ = 2 cos(α₀ + δ/2) sin(δ/2).
    """

    def about(axis: int, c: Any, s: Any, unit: float) -> casadi.SX:
        """A rotation about an axis, or its change, from the cosine and sine of its angle."""
        first, second = (axis + 1) % 3, (axis + 2) % 3
        matrix = casadi.SX(3, 3)
        matrix[axis, axis] = unit
        matrix[first, first] = matrix[second, second] = c
        matrix[second, first], matrix[first, second] = s, -casadi.SX(s)
        return casadi.sparsify(matrix)

    angles = home.orientation
    x0, y0, z0 = (about(axis, np.cos(angles[axis]), np.sin(angles[axis]), 1.0) for axis in range(3))
    middles, halves = angles + pose[3:] / 2, casadi.sin(pose[3:] / 2)
    dx, dy, dz = (
        about(k, -2 * casadi.sin(middles[k]) * halves[k], 2 * casadi.cos(middles[k]) * halves[k], 0.0) for k in range(3)
    )
    turn = dz @ (y0 + dy) @ (x0 + dx) + z0 @ dy @ (x0 + dx) + z0 @ y0 @ dx
    R0, changes = matrix_from_orientation(angles), []
    for leg in range(6):
        arm = column(parameters.platform_points[0, leg])
        at_home = casadi.SX(home.position) + casadi.SX(R0) @ arm - column(parameters.base_points[0, leg])
        change = pose[:3] + turn @ arm
        length = casadi.sqrt(casadi.sumsqr(at_home + change)) + casadi.sqrt(casadi.sumsqr(at_home))
        changes.append(casadi.dot(2 * at_home + change, change) / length)
    return casadi.vertcat(*changes)

"""Motions and legs relative to home, of CasADi symbols: differences that single precision does not cancel.

A float resolves 0.24 µm at 3 m. Relative to home, positions and leg lengths are smaller, and they are computed from
differences: L − L₀ = (2 l₀ + Δ)·Δ/(L + L₀), with Δ = t − t₀ + (R − R₀) p.
"""

from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.export import symbols
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray


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
    """L − L₀ (6,) of symbols of a platform at a pose relative to home (6,)."""
    turn = _change_of_rotation(home.orientation, pose[3:])
    R0 = matrix_from_orientation(home.orientation)
    changes = []
    for leg in range(6):
        arm = symbols.column(parameters.platform_points[0, leg])
        at_home = casadi.SX(home.position) + casadi.SX(R0) @ arm - symbols.column(parameters.base_points[0, leg])
        change = pose[:3] + turn @ arm
        length = casadi.sqrt(casadi.sumsqr(at_home + change)) + casadi.sqrt(casadi.sumsqr(at_home))
        changes.append(casadi.dot(2 * at_home + change, change) / length)
    return casadi.vertcat(*changes)


def _change_of_rotation(orientation: FloatArray, change: casadi.SX) -> casadi.SX:
    """R − R₀ = ΔRz Ry Rx + Rz₀ ΔRy Rx + Rz₀ Ry₀ ΔRx.

    cos(α₀ + δ) − cos α₀ = −2 sin(α₀ + δ/2) sin(δ/2), and sin(α₀ + δ) − sin α₀ = 2 cos(α₀ + δ/2) sin(δ/2).
    """
    at_home, changes = [], []
    for axis in range(3):
        middle, half = orientation[axis] + change[axis] / 2, casadi.sin(change[axis] / 2)
        c, s = -2 * casadi.sin(middle) * half, 2 * casadi.cos(middle) * half
        at_home.append(_about(axis, np.cos(orientation[axis]), np.sin(orientation[axis]), 1.0))
        changes.append(_about(axis, c, s, 0.0))
    (x0, y0, z0), (dx, dy, dz) = at_home, changes
    return dz @ (y0 + dy) @ (x0 + dx) + z0 @ dy @ (x0 + dx) + z0 @ y0 @ dx


def _about(axis: int, c: Any, s: Any, unit: float) -> casadi.SX:
    """A rotation about an axis from the cosine and sine of its angle."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = casadi.SX(3, 3)
    matrix[axis, axis] = unit
    matrix[first, first] = matrix[second, second] = c
    matrix[second, first], matrix[first, second] = s, -casadi.SX(s)
    return casadi.sparsify(matrix)

"""What the legs do along a path, and the largest squared rates along it under their limits, by toppra.

toppra handles limits that are linear in s̈ and x = ṡ². Velocity, acceleration and inertial force of the legs are;
viscous friction and power depend on ṡ = √x. They are linearised about the last solution; whoever solves again and
again finds limits that hold without conservative bounds.
"""

import logging
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gough_stewart.harness.motion.paths.path import PathPoint
from gough_stewart.harness.motion.paths.time_law import AlongPath
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.friction import friction_force
from gough_stewart.model.interface import SLIDING
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Share of the largest x below which √x is not linearised.
_SMALLEST_SQUARED_RATE = 1e-6
# The largest bound of x, in rough estimates of x: where the velocity is not limited.
_HIGHEST = 1e6


class DynamicLimits(NamedTuple):
    """Limits of every leg, less a margin; infinite if there is none."""

    velocity: FloatArray  # (6,) [m/s]
    acceleration: FloatArray  # (6,) [m/s²]
    force: FloatArray  # (6,) [N]
    power: FloatArray  # (6,) [W]


class Coefficients(NamedTuple):
    """Legs at points of a path; each (n, 6). L̇ = l ṡ, L̈ = l s̈ + k ṡ², F = a s̈ + b ṡ² + c + friction(L̇)."""

    l: FloatArray
    k: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray

    def shares(self, platform: Platform, limits: DynamicLimits, at: AlongPath) -> FloatArray:
        """|L̇|, |L̈|, |F| and |F L̇| relative to their limits, (4, n, 6)."""
        rate, acceleration = at.rate[:, None], at.acceleration[:, None]
        velocity = self.l * rate
        force = self.a * acceleration + self.b * rate**2 + self.c + friction_force(platform, velocity)
        used = (velocity, self.l * acceleration + self.k * rate**2, force, force * velocity)
        return np.stack([np.abs(values) / limit for values, limit in zip(used, limits, strict=True)])


def coefficients_at(platform: Platform, point: PathPoint) -> Coefficients:
    """From inverse dynamics at (ṡ, s̈) = (0, 0), (0, 1), and (±1, 0), whose mean cancels the odd friction."""
    n = len(point.position)
    zero, ones = np.zeros(n), np.ones(n)

    def forces(rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        motion = point.motion(rate, acceleration)
        return np.asarray(inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:])))

    c = forces(zero, zero)
    b = (forces(ones, zero) + forces(-ones, zero)) / 2 - c
    along = point.motion(ones, zero)
    legs = leg_geometry(platform, point.position, point.orientation)
    rates = rates_of_legs(legs, State(*along[:4]))
    return Coefficients(
        np.asarray(rates.length_rate),
        leg_accelerations(legs, State(*along[:4]), *along[4:]),
        forces(zero, ones) - c,
        b,
        c,
    )


@dataclass(frozen=True, eq=False)
class LegsAlong:
    """The coefficients at the points of a grid, and splines between them."""

    platform: Platform
    grid: FloatArray  # s (n,), from 0 to 1
    at_grid: Coefficients

    @cached_property
    def _spline(self) -> "CubicSpline":
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.grid, np.stack(self.at_grid, axis=1))

    def shares(self, limits: DynamicLimits, at: AlongPath) -> FloatArray:
        """|L̇|, |L̈|, |F| and |F L̇| relative to their limits (4, n, 6), at any points of the path."""
        parts = self._spline(np.clip(at.value, 0.0, 1.0))
        return Coefficients(*np.moveaxis(parts, 1, 0)).shares(self.platform, limits, at)


class _Rows(NamedTuple):
    """Linear conditions a u + b x + c ≤ 0, m at each of n points; each (n, m)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray


class TimeOptimal:
    """Solves for x at the grid of a path; limits are shares, one for each kind of limit, point and leg."""

    def __init__(self, legs: LegsAlong, limits: DynamicLimits) -> None:
        self.legs, self.limits = legs, limits
        at = legs.at_grid
        self._slowness = np.abs(at.l) / limits.velocity
        # of order 1 for the solver, whose tolerances are absolute
        self._size = float(np.median(np.minimum(self._bound(np.ones((6,))), self._rough)))
        # start of the iterations: x, at rest at both ends, and u = s̈
        self.x = np.full(len(legs.grid), self._size)
        self.x[[0, -1]] = 0.0
        self.u = np.zeros(len(legs.grid))

    def solve(self, allowed: FloatArray) -> FloatArray | None:
        """The largest x (n,) with all limits at both ends of every piece, linearised about the last; None if none.

        Parameters
        ----------
        allowed
            The share of each limit that may be used (4, n, 6), in the order of `DynamicLimits`.
        """
        size, s = self._size, self.legs.grid
        rows = self._rows(allowed)
        bound = np.minimum(self._bound(allowed[0]), _HIGHEST * size)
        solution = _solved(s, _Rows(rows.a * size, rows.b * size, rows.c), bound / size)
        if solution is None:
            return None
        self.x = solution * size
        u = np.diff(self.x) / (2 * np.diff(s))
        self.u = np.append(u, u[-1])
        return self.x

    def _bound(self, allowed: FloatArray) -> FloatArray:
        """The largest x (n,) within the limit of velocity."""
        with np.errstate(divide="ignore"):
            return np.asarray((allowed / self._slowness).min(axis=1) ** 2)

    @property
    def _rough(self) -> FloatArray:
        """A rough estimate of the largest x (n,), with u of the same size."""
        at, limits, tiny = self.legs.at_grid, self.limits, np.finfo(float).tiny
        by_force = (limits.force - np.abs(at.c)) / (np.abs(at.a) + np.abs(at.b) + tiny)
        by_acceleration = limits.acceleration / (np.abs(at.l) + np.abs(at.k) + tiny)
        return np.asarray(np.minimum(by_force, by_acceleration).min(axis=1))

    def _rows(self, allowed: FloatArray) -> _Rows:
        """All limits except that of velocity as shares, linearised about x and u.

        Coulomb friction is that of x: at the ends, where the legs stand still, there is none to help braking.
        """
        at, limits, platform = self.legs.at_grid, self.limits, self.legs.platform
        x, u = self.x[:, None], self.u[:, None]
        v = at.l * np.sqrt(x)  # L̇
        dv = at.l / (2 * np.sqrt(np.maximum(x, _SMALLEST_SQUARED_RATE * x.max())))  # dL̇/dx
        # viscous friction of each leg (6,) [N s/m]
        slope = friction_force(platform.with_parameters(SLIDING), np.ones(6)) * dv
        a, b, c = at.a, at.b + slope, at.c + friction_force(platform, v) - slope * x
        limited: list[tuple[Any, Any, Any, Any]] = []
        if np.isfinite(limits.acceleration).all():
            limited.append((at.l / limits.acceleration, at.k / limits.acceleration, 0 * at.l, allowed[1]))
        if np.isfinite(limits.force).all():
            limited.append((a / limits.force, b / limits.force, c / limits.force, allowed[2]))
        if np.isfinite(limits.power).all():
            # F L̇ linearised at F₀ L̇₀: L̇₀ F + F₀ dL̇/dx (x − x₀)
            F = a * u + b * x + c
            parts = (a * v, b * v + F * dv, c * v - F * dv * x)
            limited.append((*(part / limits.power for part in parts), allowed[3]))
        signed = [(sign * pa, sign * pb, sign * pc - most) for pa, pb, pc, most in limited for sign in (1, -1)]
        return _Rows(*(np.concatenate(part, axis=1) for part in zip(*signed, strict=True)))


def _solved(s: FloatArray, rows: _Rows, bound: FloatArray) -> FloatArray | None:
    """The largest x (n,) within the rows and its upper bound (n,), by toppra; None if there is none."""
    from toppra import constants
    from toppra.algorithm import TOPPRA
    from toppra.constraint import DiscretizationType, LinearConstraint, canlinear_colloc_to_interpolate
    from toppra.interpolator import AbstractGeometricPath

    logging.getLogger("toppra").setLevel(logging.CRITICAL)  # failures are visible in the result
    m = rows.a.shape[1]

    class Constraint(LinearConstraint):  # type: ignore[misc]
        """The rows, at both ends of every piece."""

        def compute_constraint_params(self, _path: Any, grid: Any, *_: Any) -> Any:
            conditions = canlinear_colloc_to_interpolate(
                *rows, np.eye(m), np.zeros(m), None, None, grid, identical=True
            )
            free = np.tile([-constants.MAXU, constants.MAXU], (len(s), 1)).astype(float)
            return *conditions[:5], free, np.stack([np.zeros_like(bound), bound], axis=1)

    class Straight(AbstractGeometricPath):  # type: ignore[misc]
        """toppra does not evaluate the path: the rows contain it."""

        dof, path_interval, waypoints = 1, np.array([0.0, 1.0]), None

        def __call__(self, at: Any, order: int = 0) -> Any:  # noqa: ARG002
            return np.zeros((np.size(at), 1))

    constraint = Constraint()
    constraint.identical = True
    constraint.set_discretization_type(DiscretizationType.Interpolation)
    _, rate, _ = TOPPRA([constraint], Straight(), gridpoints=s, solver_wrapper="seidel").compute_parameterization(0, 0)
    if rate is None or not np.isfinite(rate).all() or not rate[1:-1].all():
        return None
    return np.asarray(rate**2)

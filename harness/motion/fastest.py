"""The fastest motion along a path: time-optimal path parametrisation under the limits of the legs, by toppra.

toppra handles limits that are linear in s̈ and x = ṡ². Velocity, acceleration and inertial force of the legs are;
viscous friction and power depend on ṡ = √x. They are linearised about the last solution, and the problem is solved
again until x converges, so the nonlinear limits hold without conservative bounds.
"""

import logging
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.path import GeometricPath, PathPoint
from gough_stewart.harness.motion.shares import moving_limits
from gough_stewart.harness.motion.time_law import Averaged, Stepwise, Stretched, TimeLaw
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.leg_dynamics import friction_force
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray, per_leg

_PIECES = 1500
# Share of the grid spacing that follows a cosine: ṡ is zero at the ends, where pieces take the longest.
_DENSER_AT_ENDS = 0.95
# x has converged when it changes by less than this share of its largest value.
# Points in each piece at which limits are checked again.
_WITHIN_PIECES = np.array([0.05, 0.35, 0.65, 0.95])
_SETTLED, _MOST_SOLUTIONS = 1e-3, 15
# Share of the largest x below which √x is not linearised.
_SMALLEST_SQUARED_RATE = 1e-6


class _Limits(NamedTuple):
    """Limits of every leg, less the margin; infinite if there is none."""

    velocity: float  # [m/s]
    acceleration: float  # [m/s²]
    force: float  # [N]
    power: float  # [W]


class _Legs(NamedTuple):
    """Legs along a path; each (n, 6). L̇ = l ṡ, L̈ = l s̈ + k ṡ², F = a s̈ + b ṡ² + c + friction(L̇)."""

    l: FloatArray
    k: FloatArray
    a: FloatArray
    b: FloatArray
    c: FloatArray


class _Rows(NamedTuple):
    """Linear conditions a u + b x + c ≤ 0, m at each of n points; each (n, m)."""

    a: FloatArray
    b: FloatArray
    c: FloatArray


def fastest(platform: Platform, path: GeometricPath, margin: float = 0.0, ramp: float = 0.0) -> TimeLaw:
    """The time law that follows a path from rest to rest in the least time within the platform's limits.

    Limits are `leg_velocity_max`, `leg_acceleration_max`, `actuator_force_max` and `actuator_power_max`, as far as the
    platform states them; forces are those of its inverse dynamics, including friction.

    Parameters
    ----------
    margin
        Share of every limit reserved for the controller, 0 to 1.
    ramp
        Time [s] over which s̈ is averaged, so that no force jumps; the motion takes at least that much longer.

    Raises
    ------
    MotionError
        The platform states no limit that bounds the acceleration, or cannot rest on the path.
    """
    limits = _limits(platform, margin)
    sharp = _optimal(platform, path, limits)
    return _within(platform, path, Averaged(sharp, ramp) if ramp > 0 else sharp, margin)


def _limits(platform: Platform, margin: float) -> _Limits:
    names = ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max")
    stated = [getattr(platform, name) for name in names]
    if stated[1] is None and stated[2] is None:
        raise MotionError(
            "timing is 'fastest', but the platform states neither leg_acceleration_max nor actuator_force_max; "
            "expected at least one, for instance by platform.parameters.actuator_force_max, or a duration as timing"
        )
    return _Limits(*(np.inf if each is None else each * (1 - margin) for each in stated))


def _optimal(platform: Platform, path: GeometricPath, limits: _Limits) -> Stepwise:
    """Optimal on a grid: all limits hold at both ends of every piece, and s̈ is constant in between."""
    even = np.linspace(0.0, 1.0, _PIECES + 1)
    s = (1 - _DENSER_AT_ENDS) * even + _DENSER_AT_ENDS * (1 - np.cos(np.pi * even)) / 2
    legs = _legs_along(platform, path(s))
    _check_standing(legs, limits, s, path)
    fastest_rate = np.abs(legs.l).max(axis=1)
    with np.errstate(divide="ignore"):
        bound = (limits.velocity / fastest_rate) ** 2
    # scaled to order 1 for the solver, whose tolerances are absolute
    size = float(np.median(np.minimum(bound, _rough(legs, limits))))
    bound = np.minimum(bound, 1e6 * size)
    x, u = np.full(len(s), size), np.zeros(len(s))
    for _ in range(_MOST_SOLUTIONS):
        rows = _rows(platform, legs, limits, x, u)
        found = _solved(s, _Rows(rows.a * size, rows.b * size, rows.c), bound / size)
        if found is None:
            raise MotionError(
                "no fastest motion along this path was found; expected poses farther from the platform's limits, a "
                "smaller margin, or a duration as timing"
            )
        before, x = x, found * size
        u = np.diff(x) / (2 * np.diff(s))
        u = np.append(u, u[-1])
        if np.abs(x - before).max() < _SETTLED * x.max():
            break
    return Stepwise(s, x)


def _legs_along(platform: Platform, point: PathPoint) -> _Legs:
    """From inverse dynamics at (ṡ, s̈) = (0, 0), (0, 1), and (±1, 0), whose mean cancels the odd friction."""
    n = len(point.position)
    zero, one = np.zeros(n), np.ones(n)

    def forces(rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        motion = point.motion(rate, acceleration)
        return np.asarray(inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:])))

    c = forces(zero, zero)
    b = (forces(one, zero) + forces(-one, zero)) / 2 - c
    along = point.motion(one, zero)
    legs = leg_geometry(platform, point.position, point.orientation)
    rates = rates_of_legs(legs, State(*along[:4]))
    return _Legs(
        np.asarray(rates.length_rate),
        leg_accelerations(legs, State(*along[:4]), *along[4:]),
        forces(zero, one) - c,
        b,
        c,
    )


def _check_standing(legs: _Legs, limits: _Limits, s: FloatArray, path: GeometricPath) -> None:
    """Refuse a path on which the actuators cannot hold the platform at rest."""
    if not (np.abs(legs.c) < limits.force).all():
        row, leg = np.unravel_index(int(np.abs(legs.c).argmax()), legs.c.shape)
        nearest = int(np.abs(path.at - s[row]).argmin())
        raise MotionError(
            f"rest near pose {nearest + 1} of the path takes {abs(legs.c[row, leg]):.4g} N in leg {leg + 1}; "
            f"the limit less the margin is {limits.force:.4g} N; expected other poses, stronger actuators, a "
            "lighter platform, or a smaller margin"
        )


def _rough(legs: _Legs, limits: _Limits) -> FloatArray:
    """A rough estimate of the largest x (n,), with u of the same size."""
    tiny = np.finfo(float).tiny
    by_force = (limits.force - np.abs(legs.c)) / (np.abs(legs.a) + np.abs(legs.b) + tiny)
    by_acceleration = limits.acceleration / (np.abs(legs.l) + np.abs(legs.k) + tiny)
    return np.asarray(np.minimum(by_force, by_acceleration).min(axis=1))


def _rows(platform: Platform, legs: _Legs, limits: _Limits, x: FloatArray, u: FloatArray) -> _Rows:
    """All limits except that of velocity as shares, linearised about x and u (n,)."""
    x = np.maximum(x, _SMALLEST_SQUARED_RATE * x.max())[:, None]
    u = u[:, None]
    rate = np.sqrt(x)
    v, dv = legs.l * rate, legs.l / (2 * rate)  # L̇ and dL̇/dx
    friction = friction_force(platform, v)
    slope = per_leg(np.asarray(platform.leg_viscous_friction)) * dv
    a, b, c = legs.a, legs.b + slope, legs.c + friction - slope * x
    both: list[tuple[Any, Any, Any]] = []
    if np.isfinite(limits.force):
        both.append((a / limits.force, b / limits.force, c / limits.force))
    if np.isfinite(limits.acceleration):
        both.append((legs.l / limits.acceleration, legs.k / limits.acceleration, 0 * legs.l))
    if np.isfinite(limits.power):
        # F L̇ linearised at F₀ L̇₀: L̇₀ F + F₀ dL̇/dx (x − x₀)
        F = a * u + b * x + c
        both.append((a * v / limits.power, (b * v + F * dv) / limits.power, (c * v - F * dv * x) / limits.power))
    parts = [(sign * pa, sign * pb, sign * pc - 1) for pa, pb, pc in both for sign in (1, -1)]
    return _Rows(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True)))


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
            both = canlinear_colloc_to_interpolate(*rows, np.eye(m), np.zeros(m), None, None, grid, identical=True)
            free = np.tile([-constants.MAXU, constants.MAXU], (len(s), 1)).astype(float)
            return *both[:5], free, np.stack([np.zeros_like(bound), bound], axis=1)

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


def _within(platform: Platform, path: GeometricPath, law: TimeLaw, margin: float) -> TimeLaw:
    """The law, slowed down slightly if limits are exceeded between grid points or by averaging."""
    factor = 1.0
    for _ in range(_MOST_SOLUTIONS):
        stretched = Stretched(law, factor)
        largest = _largest_share(platform, path, stretched) / (1 - margin)
        if largest <= 1:
            break
        factor *= largest
    return stretched


def _largest_share(platform: Platform, path: GeometricPath, law: TimeLaw) -> float:
    """The largest share of any limit at times between the law's knots."""
    knots = law.knots
    time = (knots[:-1, None] + np.diff(knots)[:, None] * _WITHIN_PIECES).reshape(-1)
    at = law(time)
    motion = path(at.value).motion(at.rate, at.acceleration)
    legs = leg_geometry(platform, motion.position, motion.orientation)
    return max(float(limited.share.max()) for limited in moving_limits(platform, motion, legs))

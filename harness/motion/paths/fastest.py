"""The fastest motion along a path: time-optimal path parametrisation under the limits of the legs.

A plan is optimal on a grid of the path. Limits are exceeded elsewhere: between the points of the grid, where Coulomb
friction changes within one piece, and, with a ramp, wherever an average over time does not fit. There, and only there,
the plan is made again with less of the limit. The last, smallest excess is removed by slowing the whole motion down,
until the largest share of a limit at any time shows that none is left.

A plan is the largest squared rates along the path, by toppra, which handles limits that are linear in s̈ and x = ṡ².
Velocity, acceleration and inertial force of the legs are; viscous friction and power depend on ṡ = √x. They are
linearised about the last plan; whoever plans again and again finds limits that hold without conservative bounds.
"""

import logging
import math
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.limits.shares import DYNAMIC, loads_of_legs
from gough_stewart.harness.motion.motion import Profile
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.time_law import (
    Averaged,
    Polynomials,
    Stepwise,
    Stretched,
    TimedPath,
    TimeLaw,
    polynomials_of,
)
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.friction import friction_force
from gough_stewart.model.interface import SLIDING, State
from gough_stewart.model.kinematics import leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

_PIECES = 1500
# Share of the grid spacing that follows a cosine: ṡ is zero at the ends, where pieces take the longest.
_DENSER_AT_ENDS = 0.95
# Where in each piece the plan is compared with the limits: after its beginning, in the middle, before its end.
_WITHIN_PIECES = np.array([0.0, 0.5, 1 - 1e-9])
_MOST_PLANS = 12
# Plans are made again while they become shorter by more than this share.
_WORTHWHILE = 2e-5
# Of an excess, the share by which a limit is reduced for the next plan; all of it makes plans alternate.
_REDUCED_BY = 0.5
# Of what a leg has beyond holding the platform at rest, the share that a reduced limit leaves.
_LEFT = 0.05
# The smallest share of a limit in a plan.
_LEAST = 0.05
# Slowed down by at least this share, four times as much each time: rounding of short pieces differs from time to time.
_ROUNDING = 1e-8
_MOST_STRETCHES = 15
# Samples of each piece in the search for the largest share, how often those around it are refined, and the share of
# the largest within which a piece is searched on: far more than the error of the first samples, and less with each
# refinement, as the error is.
_SAMPLES = np.linspace(0.0, 1.0, 5)
_REFINEMENTS = 12
_NEAR = 1e-3
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


class LegsAlong:
    """Legs at the points of a grid of a path, each (n, 6), and splines between them.

    L̇ = l ṡ, L̈ = l s̈ + k ṡ², F = a s̈ + b ṡ² + c + friction(L̇), from inverse dynamics at (ṡ, s̈) = (0, 0), (0, 1), and
    (±1, 0), whose mean cancels the odd friction.
    """

    def __init__(self, platform: Platform, path: GeometricPath, grid: FloatArray) -> None:
        self.platform, self.grid = platform, grid
        point = path(grid)
        zero, ones = np.zeros(len(grid)), np.ones(len(grid))

        def forces(rate: FloatArray, acceleration: FloatArray) -> FloatArray:
            motion = point.motion(rate, acceleration)
            return np.asarray(inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:])))

        along = point.motion(ones, zero)
        legs = leg_geometry(platform, point.position, point.orientation)
        self.l = np.asarray(rates_of_legs(legs, State(*along[:4])).length_rate)
        self.k = leg_accelerations(legs, State(*along[:4]), *along[4:])
        self.c = forces(zero, zero)
        self.a = forces(zero, ones) - self.c
        self.b = (forces(ones, zero) + forces(-ones, zero)) / 2 - self.c
        from scipy.interpolate import CubicSpline

        self._spline = CubicSpline(grid, np.stack([self.l, self.k, self.a, self.b, self.c], axis=1))

    def shares(self, limits: DynamicLimits, at: Profile) -> FloatArray:
        """|L̇|, |L̈|, |F| and |F L̇| relative to their limits (4, n, 6), at any points of the path."""
        l, k, a, b, c = np.moveaxis(self._spline(np.clip(at.value, 0.0, 1.0)), 1, 0)
        rate, acceleration = at.rate[:, None], at.acceleration[:, None]
        velocity = l * rate
        force = a * acceleration + b * rate**2 + c + friction_force(self.platform, velocity)
        used = (velocity, l * acceleration + k * rate**2, force, force * velocity)
        return np.stack([np.abs(values) / limit for values, limit in zip(used, limits, strict=True)])


class TimeOptimal:
    """Solves for x at the grid of a path; limits are shares, one for each kind of limit, point and leg."""

    def __init__(self, legs: LegsAlong, limits: DynamicLimits) -> None:
        self.legs, self.limits = legs, limits
        self._slowness = np.abs(legs.l) / limits.velocity
        # a rough estimate of the largest x (n,), with u of the same size: of order 1 for the solver, whose tolerances
        # are absolute
        tiny = np.finfo(float).tiny
        by_force = (limits.force - np.abs(legs.c)) / (np.abs(legs.a) + np.abs(legs.b) + tiny)
        by_acceleration = limits.acceleration / (np.abs(legs.l) + np.abs(legs.k) + tiny)
        rough = np.minimum(by_force, by_acceleration).min(axis=1)
        self._size = float(np.median(np.minimum(self._bound(np.ones((6,))), rough)))
        # start of the iterations: x, at rest at both ends, and u = s̈
        self.x = np.full(len(legs.grid), self._size)
        self.x[[0, -1]] = 0.0
        self.u = np.zeros(len(legs.grid))

    def _bound(self, allowed: FloatArray) -> FloatArray:
        """The largest x (n,) within the limit of velocity."""
        with np.errstate(divide="ignore"):
            return np.asarray((allowed / self._slowness).min(axis=1) ** 2)

    def solve(self, allowed: FloatArray) -> FloatArray | None:
        """The largest x (n,) with all limits at both ends of every piece, linearised about the last; None if none.

        Of each limit the share that is allowed (4, n, 6), in the order of `DynamicLimits`. Coulomb friction is that of
        x: at the ends, where the legs stand still, there is none to help braking.
        """
        at, limits, platform, size = self.legs, self.limits, self.legs.platform, self._size
        x, u = self.x[:, None], self.u[:, None]
        v = at.l * np.sqrt(x)  # L̇
        dv = at.l / (2 * np.sqrt(np.maximum(x, _SMALLEST_SQUARED_RATE * x.max())))  # dL̇/dx
        # viscous friction of each leg (6,) [N s/m]
        slope = friction_force(platform.with_parameters(SLIDING), np.ones(6)) * dv
        a, b, c = at.a, at.b + slope, at.c + friction_force(platform, v) - slope * x
        # conditions a u + b x + c ≤ 0 as shares, m at each of n points
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
        of_u, of_x, constant = (np.concatenate(part, axis=1) for part in zip(*signed, strict=True))
        bound = np.minimum(self._bound(allowed[0]), _HIGHEST * size)
        solution = _solved(self.legs.grid, (of_u * size, of_x * size, constant), bound / size)
        if solution is None:
            return None
        self.x = solution * size
        u = np.diff(self.x) / (2 * np.diff(self.legs.grid))
        self.u = np.append(u, u[-1])
        return self.x


def _solved(s: FloatArray, rows: tuple[FloatArray, ...], bound: FloatArray) -> FloatArray | None:
    """The largest x (n,) within the rows and its upper bound (n,), by toppra; None if there is none."""
    from toppra import constants
    from toppra.algorithm import TOPPRA
    from toppra.constraint import DiscretizationType, LinearConstraint, canlinear_colloc_to_interpolate
    from toppra.interpolator import AbstractGeometricPath

    logging.getLogger("toppra").setLevel(logging.CRITICAL)  # failures are visible in the result
    m = rows[0].shape[1]

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


def fastest(platform: Platform, path: GeometricPath, margin: float = 0.0, ramp: float = 0.0) -> TimeLaw:
    """The time law that follows a path from rest to rest in the least time within the platform's limits.

    Limits are `leg_velocity_max`, `leg_acceleration_max`, `actuator_force_max` and `actuator_power_max`, as far as the
    platform states them, less a margin, the share reserved for the controller; forces are those of its inverse
    dynamics, including friction. No limit is exceeded at any time, between rows too: see `largest_share`. Over a ramp
    [s] s̈ is averaged, so that no force jumps; the motion takes about 1.0 to 2.3 times that longer.
    """
    if platform.leg_acceleration_max is None and platform.actuator_force_max is None:
        raise MotionError(
            "timing is 'fastest', but the platform states neither leg_acceleration_max nor actuator_force_max; "
            "expected at least one, for instance by platform.parameters.actuator_force_max, or a duration as timing"
        )
    limits = DynamicLimits(*(of_legs(platform, name, np.inf) * (1 - margin) for name in DYNAMIC))
    plan = _planned(platform, path, limits, ramp)
    # slowed down by the last excess, until the motion as it is played exceeds no limit at any time
    factor = plan.factor
    for k in range(_MOST_STRETCHES):
        law = Stretched(plan.law, factor)
        excess = largest_share(platform, polynomials_of(TimedPath(path, law)), limits) - 1
        if excess <= 0:
            return law
        factor *= 1 + excess + _ROUNDING * 4**k
    raise MotionError(
        f"the fastest motion along this path exceeds a limit by {100 * excess:.3g} %, however slow; expected poses "
        "farther from the platform's limits, or a smaller margin"
    )


def _planned(platform: Platform, path: GeometricPath, limits: DynamicLimits, ramp: float) -> Stretched:
    """The shortest of the plans, each made with less of the limits that the last exceeded where it did."""
    even = np.linspace(0.0, 1.0, _PIECES + 1)
    s = (1 - _DENSER_AT_ENDS) * even + _DENSER_AT_ENDS * (1 - np.cos(np.pi * even)) / 2
    legs = LegsAlong(platform, path, s)
    weight = np.abs(legs.c)
    if not (weight < limits.force).all():
        row, leg = np.unravel_index(int((weight / limits.force).argmax()), weight.shape)
        nearest = int(np.abs(path.at - s[row]).argmin())
        raise MotionError(
            f"rest near pose {nearest + 1} of the path takes {weight[row, leg]:.4g} N in leg {leg + 1}; "
            f"the limit less the margin is {limits.force[leg]:.4g} N; expected other poses, stronger actuators, a "
            "lighter platform, or a smaller margin"
        )
    problem = TimeOptimal(legs, limits)
    allowed = np.ones((len(limits), len(s), 6))
    least = np.full_like(allowed, _LEAST)
    at_rest = weight / limits.force
    least[2] = at_rest + _LEFT * (1 - at_rest)
    best: Stretched | None = None
    for _ in range(_MOST_PLANS):
        x = problem.solve(allowed)
        if x is None:
            break
        sharp = Stepwise(s, x)
        law = Averaged(sharp, ramp) if ramp > 0 else sharp
        time = (law.knots[:-1, None] + np.diff(law.knots)[:, None] * _WITHIN_PIECES).reshape(-1)
        at = law(time)
        # how many times as long it has to take to be within the limits at these points
        factor = 1.0
        for _ in range(_MOST_STRETCHES):
            slower = Profile(at.value, at.rate / factor, at.acceleration / factor**2)
            largest = float(legs.shares(limits, slower).max())
            if largest <= 1 + _ROUNDING:
                break
            # a force that is not at its limit at rest falls with the square of the factor
            factor *= largest if largest < 1.001 else math.sqrt(largest)
        plan = Stretched(law, factor)
        before, best = best, plan if best is None or plan.duration < best.duration else best
        if before is not None and plan.factor < 1 + _WORTHWHILE and plan.duration > before.duration * (1 - _WORTHWHILE):
            break
        excess = _largest_near(legs.shares(limits, at) - 1, time, sharp.knots, ramp)
        allowed = np.clip(allowed - _REDUCED_BY * excess, least, 1.0)
    if best is None:
        raise MotionError(
            "no fastest motion along this path was found; expected poses farther from the platform's limits, a "
            "smaller margin, or a duration as timing"
        )
    return best


def _largest_near(values: FloatArray, time: FloatArray, knots: FloatArray, window: float) -> FloatArray:
    """For every knot k the largest of values (4, m, 6) at times (m,) from knot k − 1 to a window after knot k + 1.

    The largest of 2ʲ neighbours for every j, of which two cover any stretch.
    """
    begins = np.searchsorted(time, np.append(0.0, knots[:-1]))
    ends = np.searchsorted(time, np.append(knots[1:], knots[-1]) + window, side="right")
    levels = np.log2(ends - begins).astype(int)
    largest = np.empty((len(values), len(knots), 6))
    for level in range(int(levels.max()) + 1):
        at_level = levels == level
        largest[:, at_level] = np.maximum(values[:, begins[at_level]], values[:, ends[at_level] - 2**level])
        values = np.maximum(values[:, : -(2**level)], values[:, 2**level :])
    return largest


def largest_share(platform: Platform, motion: Polynomials, limits: DynamicLimits) -> float:
    """The largest share that a motion uses of the limits at any time, also between rows, to about 1e-9.

    Each piece is sampled, and the neighbourhood of its largest share sampled again, until it is shorter by 2¹².
    """
    limited = {name: limit for name, limit in limits._asdict().items() if np.min(limit) < np.inf}
    low = motion.begins
    high = np.nextafter(np.append(low[1:], motion.end), 0)  # the acceleration may jump at the end
    largest = 0.0
    for refinement in range(_REFINEMENTS + 1):
        time = low[:, None] + (high - low)[:, None] * _SAMPLES
        rows = motion(time.reshape(-1))
        legs = leg_geometry(platform, rows.position, rows.orientation)
        loads = loads_of_legs(platform, rows, legs, names=limited)
        used = [np.abs(loads[name]) / limit for name, limit in limited.items()]
        share = np.max(used, axis=(0, 2)).reshape(time.shape)
        largest = max(largest, float(share.max()))
        near = np.flatnonzero(share.max(axis=1) >= largest * (1 - _NEAR / 2**refinement))
        peak = share[near].argmax(axis=1)
        low, high = time[near, np.maximum(peak - 1, 0)], time[near, np.minimum(peak + 1, len(_SAMPLES) - 1)]
    return largest

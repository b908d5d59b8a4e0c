"""The fastest motion along a path: time-optimal path parametrisation under the limits of the legs.

A plan is optimal on a grid of the path. Limits are exceeded elsewhere: between the points of the grid, where Coulomb
friction changes within one piece, and, with a ramp, wherever an average over time does not fit. There, and only there,
the plan is made again with less of the limit. The last, smallest excess is removed by slowing the whole motion down,
until the largest share of a limit at any time shows that none is left.
"""

import math

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.limits.needs import LegLoads
from gough_stewart.harness.motion.limits.shares import DYNAMIC
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.polynomials import Polynomials, polynomials_of
from gough_stewart.harness.motion.paths.time_law import AlongPath, Averaged, Stepwise, Stretched, TimedPath, TimeLaw
from gough_stewart.harness.motion.paths.time_optimal import DynamicLimits, LegsAlong, TimeOptimal, coefficients_at
from gough_stewart.model.kinematics import leg_geometry
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
# the largest within which a piece is searched on: far more than the error of the first samples.
_SAMPLES = np.linspace(0.0, 1.0, 9)
_REFINEMENTS = 6
_NEAR = 1e-3


def fastest(platform: Platform, path: GeometricPath, margin: float = 0.0, ramp: float = 0.0) -> TimeLaw:
    """The time law that follows a path from rest to rest in the least time within the platform's limits.

    Limits are `leg_velocity_max`, `leg_acceleration_max`, `actuator_force_max` and `actuator_power_max`, as far as the
    platform states them; forces are those of its inverse dynamics, including friction. No limit is exceeded at any
    time, between rows too: see `largest_share`.

    Parameters
    ----------
    margin
        Share of every limit reserved for the controller, 0 to 1.
    ramp
        Time [s] over which s̈ is averaged, so that no force jumps; the motion takes about 1.0 to 2.3 times that longer.

    Raises
    ------
    MotionError
        The platform states no limit that bounds the acceleration, or cannot rest on the path.
    """
    limits = _limits(platform, margin)
    return _within(platform, path, _planned(platform, path, limits, ramp), limits)


def _limits(platform: Platform, margin: float) -> DynamicLimits:
    if platform.leg_acceleration_max is None and platform.actuator_force_max is None:
        raise MotionError(
            "timing is 'fastest', but the platform states neither leg_acceleration_max nor actuator_force_max; "
            "expected at least one, for instance by platform.parameters.actuator_force_max, or a duration as timing"
        )
    return DynamicLimits(*(of_legs(platform, name, np.inf) * (1 - margin) for name in DYNAMIC))


def _planned(platform: Platform, path: GeometricPath, limits: DynamicLimits, ramp: float) -> Stretched:
    """The shortest of the plans, each made with less of the limits that the last exceeded where it did."""
    even = np.linspace(0.0, 1.0, _PIECES + 1)
    s = (1 - _DENSER_AT_ENDS) * even + _DENSER_AT_ENDS * (1 - np.cos(np.pi * even)) / 2
    legs = LegsAlong(platform, s, coefficients_at(platform, path(s)))
    _check_standing(legs, limits, path)
    problem = TimeOptimal(legs, limits)
    allowed = np.ones((len(limits), len(s), 6))
    least = np.full_like(allowed, _LEAST)
    at_rest = np.abs(legs.at_grid.c) / limits.force
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
        plan = Stretched(law, _slowing(legs, limits, at))
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


def _check_standing(legs: LegsAlong, limits: DynamicLimits, path: GeometricPath) -> None:
    """Refuse a path on which the actuators cannot hold the platform at rest."""
    weight = np.abs(legs.at_grid.c)
    if not (weight < limits.force).all():
        row, leg = np.unravel_index(int((weight / limits.force).argmax()), weight.shape)
        nearest = int(np.abs(path.at - legs.grid[row]).argmin())
        raise MotionError(
            f"rest near pose {nearest + 1} of the path takes {weight[row, leg]:.4g} N in leg {leg + 1}; "
            f"the limit less the margin is {limits.force[leg]:.4g} N; expected other poses, stronger actuators, a "
            "lighter platform, or a smaller margin"
        )


def _slowing(legs: LegsAlong, limits: DynamicLimits, at: AlongPath) -> float:
    """How many times as long a motion has to take to be within the limits at these points."""
    factor = 1.0
    for _ in range(_MOST_STRETCHES):
        slower = AlongPath(at.value, at.rate / factor, at.acceleration / factor**2)
        largest = float(legs.shares(limits, slower).max())
        if largest <= 1 + _ROUNDING:
            break
        # a force that is not at its limit at rest falls with the square of the factor
        factor *= largest if largest < 1.001 else math.sqrt(largest)
    return factor


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

    Each piece is sampled, and the neighbourhood of its largest share sampled again, until it is shorter by 4⁶.
    """
    low = motion.begins
    high = np.nextafter(np.append(low[1:], motion.end), 0)  # the acceleration may jump at the end
    largest = 0.0
    for _ in range(_REFINEMENTS + 1):
        time = low[:, None] + (high - low)[:, None] * _SAMPLES
        rows = motion(time.reshape(-1))
        loads = LegLoads(platform, rows, leg_geometry(platform, rows.position, rows.orientation))
        used = [
            np.abs(getattr(loads, name)) / limit for name, limit in limits._asdict().items() if np.min(limit) < np.inf
        ]
        share = np.max(used, axis=(0, 2)).reshape(time.shape)
        largest = max(largest, float(share.max()))
        near = np.flatnonzero(share.max(axis=1) >= largest * (1 - _NEAR))
        peak = share[near].argmax(axis=1)
        low, high = time[near, np.maximum(peak - 1, 0)], time[near, np.minimum(peak + 1, len(_SAMPLES) - 1)]
    return largest


def _within(platform: Platform, path: GeometricPath, plan: Stretched, limits: DynamicLimits) -> TimeLaw:
    """The plan, slowed down by the last excess, until the motion as it is played exceeds no limit at any time."""
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

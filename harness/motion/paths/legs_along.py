"""What the legs do along a path: velocity, acceleration, force and power as functions of s, ṡ and s̈."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

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


class DynamicLimits(NamedTuple):
    """Limits of every leg, less a margin; infinite if there is none."""

    velocity: float  # [m/s]
    acceleration: float  # [m/s²]
    force: float  # [N]
    power: float  # [W]


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
    zero, one = np.zeros(n), np.ones(n)

    def forces(rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        motion = point.motion(rate, acceleration)
        return np.asarray(inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:])))

    c = forces(zero, zero)
    b = (forces(one, zero) + forces(-one, zero)) / 2 - c
    along = point.motion(one, zero)
    legs = leg_geometry(platform, point.position, point.orientation)
    rates = rates_of_legs(legs, State(*along[:4]))
    return Coefficients(
        np.asarray(rates.length_rate),
        leg_accelerations(legs, State(*along[:4]), *along[4:]),
        forces(zero, one) - c,
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
        """As `Coefficients.shares`, at any points of the path."""
        parts = self._spline(np.clip(at.value, 0.0, 1.0))
        return Coefficients(*np.moveaxis(parts, 1, 0)).shares(self.platform, limits, at)


def dry_friction(platform: Platform, velocity: FloatArray) -> FloatArray:
    """Coulomb friction (..., 6) [N] alone: odd in the velocity (..., 6) [m/s], and never decreasing."""
    return friction_force(platform.with_parameters({"leg_viscous_friction": 0.0}), velocity)


def without_dry_friction(platform: Platform) -> Platform:
    """The platform without Coulomb friction."""
    return platform.with_parameters(SLIDING)

"""Random platforms, states and inputs: all dissimilar legs, inertias and axes that a Platform admits."""

from typing import Any

import numpy as np

from gough_stewart import GoughStewartError, Platform, State, leg_jacobian
from tests.support.arrays import FloatArray

# Agreement is asked for at regular poses: rounding grows with the condition number.
REGULAR = 100.0
_OF_LEGS = ("lower_mass", "upper_mass", "lower_com", "upper_com", "lower_inertia", "upper_inertia", "armature")


def random_platform(rng: np.random.Generator) -> Platform:
    """Irregular joints and masses over three decades of size; valid by construction or drawn again."""
    (legs,) = rng.spawn(1)
    while True:
        size = 10 ** rng.uniform(-1, 0.7)
        mass = size**3 * 10 ** rng.uniform(0, 1.5)
        azimuth = np.radians([15, -15, 135, 105, 255, 225]) + rng.uniform(-0.15, 0.15, 6)
        twist = np.radians([30, -30] * 3) + rng.uniform(-0.2, 0.2, 6)
        base = _circle(azimuth, size * rng.uniform(0.8, 1.2, 6), size * rng.uniform(-0.1, 0.1, 6))
        top = _circle(azimuth + twist, size * rng.uniform(0.4, 0.7, 6), size * rng.uniform(-0.1, 0.1, 6))
        height = size * rng.uniform(1.0, 1.6)
        # inertia of random point masses: meets every condition an inertia has to meet
        points = rng.normal(scale=0.4 * size, size=(8, 3))
        points -= points.mean(axis=0)
        inertia = mass / 8 * (np.eye(3) * (points**2).sum() - points.T @ points)
        of_legs: dict[str, Any] = {f"leg_{name}_factor": legs.uniform(0.6, 1.3, 6) for name in _OF_LEGS}
        try:
            platform = Platform(
                base_points=base,
                platform_points=top,
                platform_mass=mass,
                platform_com=rng.normal(scale=0.2 * size, size=3),
                platform_inertia=inertia,
                leg_lower_mass=mass * rng.uniform(0.02, 0.3),
                leg_upper_mass=mass * rng.uniform(0.02, 0.3),
                leg_lower_com=size * rng.uniform(0.1, 0.5),
                leg_upper_com=size * rng.uniform(0.1, 0.5),
                leg_lower_inertia=mass * size**2 * rng.uniform(0.001, 0.02),
                leg_upper_inertia=mass * size**2 * rng.uniform(0.001, 0.02),
                leg_viscous_friction=mass * rng.uniform(0, 3),
                leg_coulomb_friction=mass * rng.uniform(0, 1),
                leg_friction_velocity=size * rng.uniform(0.01, 0.1),
                gravity=rng.normal(scale=6.0, size=3),
                home_position=np.append(size * rng.uniform(-0.1, 0.1, 2), height),
                home_orientation=rng.uniform(-0.2, 0.2, 3),
                leg_armature=mass * rng.uniform(0.1, 0.5),
                leg_viscous_friction_factor=legs.uniform(0.3, 1.7, 6),
                leg_coulomb_friction_factor=legs.uniform(0.3, 1.7, 6),
                **of_legs,
            )
        except GoughStewartError:
            continue
        if _condition_number(platform, platform.home_position, platform.home_orientation) < REGULAR:
            return platform


def random_state(platform: Platform, rng: np.random.Generator) -> State:
    """A regular pose about home, and a lively motion."""
    size = platform.characteristic_length
    while True:
        position = platform.home_position + size * rng.uniform(-0.3, 0.3, 3)
        orientation = platform.home_orientation + rng.uniform(-0.3, 0.3, 3)
        if _condition_number(platform, position, orientation) < REGULAR:
            return State(position, orientation, size * rng.normal(size=3), rng.normal(size=3))


def random_inputs(platform: Platform, rng: np.random.Generator) -> FloatArray:
    """Forces and a wrench (12,) of the order of the weight."""
    weight, size = 10 * platform.platform_mass, platform.characteristic_length
    return np.asarray(weight * rng.uniform(-1, 1, 12) * np.repeat([1.0, size], [9, 3]))


def _condition_number(platform: Platform, position: FloatArray, orientation: FloatArray) -> float:
    lever = np.repeat([1.0, platform.characteristic_length], 3)
    return float(np.linalg.cond(leg_jacobian(platform, position, orientation) / lever))


def _circle(azimuth: FloatArray, radius: FloatArray, height: FloatArray) -> FloatArray:
    return np.stack([radius * np.sin(azimuth), radius * np.cos(azimuth), height], axis=1)

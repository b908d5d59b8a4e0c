"""Twenty random paths on each of three presets: limits, how much of them is used, and durations by another solver."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart.harness.motion.fastest import fastest
from gough_stewart.harness.motion.path import GeometricPath
from gough_stewart.harness.motion.shares import shares_along
from gough_stewart.harness.motion.timed_path import TimedPath
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from tests.support.direct_transcription import least_time

pytestmark = pytest.mark.evidence

PLATFORMS = {
    "motion_base": load_preset("motion_base"),
    "desktop_hexapod": load_preset("desktop_hexapod"),
    # states no limits
    "liu2000": replace(
        load_preset("liu2000"), leg_velocity_max=0.5, leg_acceleration_max=4.0, actuator_force_max=150.0
    ),
}
DYNAMIC = ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max")


def random_path(platform: Platform, seed: int) -> GeometricPath:
    random = np.random.default_rng(seed)
    reach = 0.05 * float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    position = platform.home_position + reach * random.uniform(-1, 1, (5, 3))
    angle = reach / platform.characteristic_length * random.uniform(-1, 1, (5, 3))
    return GeometricPath(position, platform.home_orientation + angle, platform.characteristic_length)


@pytest.mark.parametrize("name", PLATFORMS)
@pytest.mark.parametrize("seed", range(20))
def test_limits_are_used_and_not_exceeded(name: str, seed: int) -> None:
    platform, path = PLATFORMS[name], random_path(PLATFORMS[name], seed)
    motion = TimedPath(path, fastest(platform, path))
    knots, within = motion.law.knots, (np.arange(10) + 0.5) / 10
    time = (knots[:-1, None] + np.diff(knots)[:, None] * within).reshape(-1)
    weight = np.repeat(np.diff(knots), len(within))
    of = shares_along(platform, time, motion(time)).of
    largest = np.max([of[limit].max(axis=1) for limit in DYNAMIC if limit in of], axis=0)
    assert largest.max() <= 1.001
    assert weight[largest >= 0.98].sum() >= 0.99 * weight.sum()


@pytest.mark.parametrize("name", PLATFORMS)
def test_durations_are_those_of_a_direct_transcription(name: str) -> None:
    path = random_path(PLATFORMS[name], 0)
    assert fastest(PLATFORMS[name], path).duration == pytest.approx(least_time(PLATFORMS[name], path, 400), rel=0.01)

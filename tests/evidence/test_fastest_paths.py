"""Random paths on three presets: limits at every start and ramp, how much is used, and durations by another solver."""

from dataclasses import replace

import numpy as np
import pytest

from gough_stewart import Platform, leg_geometry, load_preset
from gough_stewart.harness.motion.limits.shares import DYNAMIC, shares_along
from gough_stewart.harness.motion.paths.fastest import fastest
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.time_law import TimedPath, polynomials_of
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
    assert largest.max() <= 1
    assert weight[largest >= 0.98].sum() >= 0.99 * weight.sum()


@pytest.mark.parametrize("name", PLATFORMS)
@pytest.mark.parametrize("ramp", [0.0, 0.005, 0.02, 0.05])
@pytest.mark.parametrize("seed", range(20, 25))
def test_plans_without_margin_pass_the_check_at_forty_starts(name: str, ramp: float, seed: int) -> None:
    """Expected: the shares at rows from any start, also of 0.1 ms, and within the last millisecond."""
    platform, path = PLATFORMS[name], random_path(PLATFORMS[name], seed)
    law, random = fastest(platform, path, ramp=ramp), np.random.default_rng(seed)
    for start in random.uniform(0, 0.1, 40):
        motion = polynomials_of(TimedPath(path, law, start))
        step = random.choice([1e-4, 1e-3, 2e-3, 5e-3], p=[0.1, 0.4, 0.3, 0.2])
        time = np.sort(np.concatenate([np.arange(0, motion.end + 0.1, step), motion.end - random.uniform(0, 1e-3, 50)]))
        of = shares_along(platform, time, motion(time)).of
        assert max(of[limit].max() for limit in DYNAMIC if limit in of) <= 1


@pytest.mark.parametrize("name", PLATFORMS)
@pytest.mark.parametrize("seed", range(5))
def test_a_ramp_costs_what_the_manual_says(name: str, seed: int) -> None:
    """Expected: docs/motion.md, "The fastest motion along a path"."""
    path = random_path(PLATFORMS[name], seed)
    sharp = fastest(PLATFORMS[name], path).duration
    for ramp, most in ((0.005, 1.5), (0.02, 2.1), (0.05, 2.4)):
        assert sharp + 0.9 * ramp < fastest(PLATFORMS[name], path, ramp=ramp).duration < sharp + most * ramp


@pytest.mark.parametrize("name", PLATFORMS)
def test_durations_are_those_of_a_direct_transcription(name: str) -> None:
    path = random_path(PLATFORMS[name], 0)
    assert fastest(PLATFORMS[name], path).duration == pytest.approx(least_time(PLATFORMS[name], path, 400), rel=0.01)

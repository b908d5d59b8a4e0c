"""The fastest way along paths: against closed forms, and against the limits, of which one is used at any time."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.harness.motion.forces import actuator_forces, pose_along
from tests.support.arrays import FloatArray
from tests.support.lagrangian import legs_along
from tests.support.uneven import UNEVEN

LIMITED = replace(
    UNEVEN, leg_velocity_max=0.9, leg_acceleration_max=7.0, actuator_force_max=190.0, actuator_power_max=95.0
)


def random_poses() -> FloatArray:
    """Five about home, so large that the legs use a good part of their stroke."""
    random, reach = np.random.default_rng(3), 0.35
    position = LIMITED.home_position + reach * random.uniform(-1, 1, (5, 3))
    angle = reach / LIMITED.characteristic_length * random.uniform(-1, 1, (5, 3))
    return np.hstack([position, LIMITED.home_orientation + angle])


@cache
def along_it(**keys: Any) -> Any:
    """The fastest motion through the random poses; each is planned once."""
    return gs.ViaPath(poses=random_poses(), timing="fastest", **keys).about(LIMITED)


def largest_shares(motion: Any, every: int) -> FloatArray:
    """Of any limit in the middle of some of the pieces, by a Lagrangian and differences of leg velocities."""
    begins, h = np.append(motion.pieces[0], motion.end), 1e-6
    time = (begins[:-1] + np.diff(begins) / 2)[np.diff(begins) > 2.2 * h][::every]
    (_, before), (_, velocity), (_, after) = (legs_along(LIMITED, pose_along(motion, time + k * h)) for k in (-1, 0, 1))
    force = actuator_forces(LIMITED, pose_along(motion, time), velocity)
    used = [velocity / 0.9, (after - before) / (2 * h) / 7.0, force / 190.0, force * velocity / 95.0]
    return np.asarray(np.max(np.abs(used), axis=(0, 2)))


def test_no_limit_is_exceeded_and_one_is_always_used() -> None:
    shares = largest_shares(along_it(), 20)
    assert len(shares) > 60
    assert shares.max() < 1 + 1e-6
    assert np.mean(shares > 0.98) > 0.95  # pieces near the ends last longer than others


def test_a_margin_leaves_its_share_of_every_limit() -> None:
    shares = largest_shares(along_it(margin=0.2), 20)
    assert np.median(shares) > 0.78
    assert shares.max() < 0.8 + 1e-6


def test_a_ramp_bounds_how_fast_accelerations_change_and_costs_one_ramp_or_two() -> None:
    sharp, ramped = along_it(), along_it(ramp=0.05)
    time = np.linspace(0, ramped.end, 4001)
    changes = [np.abs(np.diff(motion(time).acceleration, axis=0)).max() for motion in (ramped, sharp)]
    assert changes[0] < 0.1 * changes[1]
    assert sharp.end + 0.05 < ramped.end < sharp.end + 2 * 0.05
    assert largest_shares(ramped, 40).max() < 1 + 1e-6


@pytest.mark.parametrize("keys", [{}, {"ramp": 0.05}], ids=str)
def test_polynomials_are_the_motion_along_the_path(keys: dict[str, float]) -> None:
    """Expected: pose, rates and accelerations of path and time law at 4,000 times, with jumps and short pieces."""
    motion = along_it(**keys)
    time = np.linspace(0.0, motion.end + 0.1, 4001)
    for one, other, tolerance in zip(
        motion(time), motion.source(time), (1e-9, 1e-9, 1e-7, 1e-7, 1e-4, 1e-4), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=tolerance * max(1, np.abs(other).max()))


def lifted(**changes: Any) -> tuple[gs.Platform, float]:
    """Six legs at the corners of a hexagon that stand upright but for 1/40; and how long a lift of 0.5 m takes."""
    angle = np.pi / 3 * np.arange(6)
    base = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    slant = 0.05 * np.array([1, -1] * 3)[:, None] * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    upright: dict[str, Any] = {
        **{"base_points": base, "platform_points": base + slant, "platform_com": np.zeros(3)},
        **{"gravity": np.array([0, 0, -9.81]), "home_position": np.array([0, 0, 2.0]), "home_orientation": np.zeros(3)},
        **dict.fromkeys(("leg_length_min", "leg_length_max", "joint_angle_max", "actuator_force_max")),
    }
    platform = replace(UNEVEN, **{**upright, **changes})
    poses: Any = [[0] * 6, [0, 0, 0.5, 0, 0, 0]]
    return platform, gs.ViaPath(poses=poses, relative_to="home", timing="fastest").about(platform).end


@pytest.mark.parametrize(("velocity", "duration"), [(None, 2 * np.sqrt(0.5 / 3.0)), (0.8, (0.5 + 0.8**2 / 3.0) / 0.8)])
def test_a_straight_lift_takes_the_time_of_bang_bang_or_of_a_trapezoid(velocity: Any, duration: float) -> None:
    """Expected: T = 2 √(d/a), or d = v T − v²/a; legs that nearly all point up, to (1/40)², move as the platform."""
    assert lifted(leg_acceleration_max=3.0, leg_velocity_max=velocity)[1] == pytest.approx(duration, rel=2e-3)


def test_a_straight_lift_under_a_force_limit_accelerates_by_what_gravity_leaves() -> None:
    """Expected: six forces F against weight m g up and down: a₁ = 6 F/m − g, a₂ = 6 F/m + g; v²/2 (1/a₁ + 1/a₂) = d."""
    platform, found = lifted(actuator_force_max=400.0, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    mass = platform.platform_mass + 6 * (platform.leg_upper_mass + platform.leg_armature)
    weight = 9.81 * (platform.platform_mass + 6 * platform.leg_upper_mass)
    up, down = (2400 - weight) / mass, (2400 + weight) / mass
    speed = np.sqrt(2 * 0.5 / (1 / up + 1 / down))
    # down by gravity and actuators is faster than up
    assert found == pytest.approx(speed / up + speed / down, rel=3e-3)


def test_a_fastest_path_is_planned_for_the_forces_that_the_actuators_have() -> None:
    """Expected: the experiment's own limit less the margin, not the platform's; at every row, and nearly all of it."""
    found = gs.check("fastest_path", {"actuators.force_limit": "9 kN", "loop.sample_time": "2 ms"})
    assert found.keeps_margin
    assert 0.88 < found.shares.peak("actuator_force_max").share <= 0.9 + 1e-9


def test_platforms_without_a_fastest_way_are_refused() -> None:
    """Expected: the larger of the static forces at the ends of a short path, with its leg; 40 % of the limit."""
    poses = random_poses()[[3, 1]]
    weight = np.abs(gs.static_leg_forces(LIMITED, poses[:, :3], poses[:, 3:]))
    pose, leg = np.unravel_index(weight.argmax(), weight.shape)
    too_weak = rf"rest near pose {pose + 1} of the path takes {weight.max():.4g} N in leg {leg + 1}; .* is 48 N"
    no_limit: dict[str, Any] = {"leg_acceleration_max": None, "actuator_force_max": None}
    for changes, message in (
        (no_limit, "states neither leg_acceleration_max nor actuator_force_max"),
        ({"actuator_force_max": 120.0}, too_weak),
    ):
        with pytest.raises(gs.GoughStewartError, match=message):
            gs.ViaPath(poses=poses, timing="fastest", margin=0.6).about(replace(LIMITED, **changes))

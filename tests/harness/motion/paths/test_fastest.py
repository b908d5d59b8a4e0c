"""The fastest way along paths: against a closed form, against what bounds it, and by an independent solver."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart import GoughStewartError, Platform, check, leg_geometry, load_preset
from gough_stewart.harness.motion.limits.shares import DYNAMIC, shares_along
from gough_stewart.harness.motion.paths.fastest import fastest
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.polynomials import polynomials_of
from gough_stewart.harness.motion.paths.time_law import TimedPath
from tests.support.arrays import FloatArray
from tests.support.direct_transcription import least_time
from tests.support.forces import forces_by_newton_euler
from tests.support.uneven import UNEVEN

LIMITED = replace(
    UNEVEN, leg_velocity_max=0.9, leg_acceleration_max=7.0, actuator_force_max=190.0, actuator_power_max=95.0
)


def random_path(platform: Platform, seed: int, n: int = 5, size: float = 0.12) -> GeometricPath:
    """Through random poses about home, so large that the legs use a good part of their stroke."""
    random = np.random.default_rng(seed)
    reach = size * float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    position = platform.home_position + reach * random.uniform(-1, 1, (n, 3))
    angle = reach / platform.characteristic_length * random.uniform(-1, 1, (n, 3))
    return GeometricPath(position, platform.home_orientation + angle, platform.characteristic_length)


def shares(platform: Platform, motion: TimedPath) -> tuple[FloatArray, FloatArray]:
    """Times in the middle of pieces, and the largest share of any limit there, by differences and Newton–Euler."""
    knots, h = motion.law.knots, 1e-5
    time = (knots[:-1] + np.diff(knots) / 2)[np.diff(knots) > 2.2 * h]
    before, now, after = (
        np.asarray(leg_geometry(platform, at.position, at.orientation).length)
        for at in (motion(time - h), motion(time), motion(time + h))
    )
    velocity, acceleration = (after - before) / (2 * h), (after - 2 * now + before) / h**2
    force = forces_by_newton_euler(platform, motion, time)
    used = {
        "leg_velocity_max": velocity,
        "leg_acceleration_max": acceleration,
        "actuator_force_max": force,
        "actuator_power_max": force * velocity,
    }
    each = [
        np.abs(values) / getattr(platform, name) for name, values in used.items() if getattr(platform, name) is not None
    ]
    return time, np.max(each, axis=(0, 2))


def test_no_limit_is_exceeded_and_one_is_always_used() -> None:
    motion = TimedPath(random_path(LIMITED, 1), fastest(LIMITED, random_path(LIMITED, 1)))
    # some of the pieces are enough, and Newton–Euler is slow
    time, largest = shares(LIMITED, replace_knots(motion, 40))
    assert largest.max() < 1.001
    assert np.mean(largest > 0.98) > 0.95  # pieces near the ends last longer than others
    assert len(time) > 30


def replace_knots(motion: TimedPath, every: int) -> TimedPath:
    """The same motion, looked at in fewer places."""

    class Coarser:
        duration = motion.law.duration
        knots = motion.law.knots[::every]

        def __call__(self, time: FloatArray) -> Any:
            return motion.law(time)

    return TimedPath(motion.path, Coarser(), motion.start)


SLOWER_CASES = (("motion_base", 0.0), ("desktop_hexapod", 0.0), ("desktop_hexapod", 0.02))
LIFT = GeometricPath(np.array([[0, 0, 2.0], [0, 0, 2.5]]), np.zeros((2, 3)), 1.0)


@pytest.mark.parametrize(("velocity", "duration"), [(None, 2 * np.sqrt(0.5 / 3.0)), (0.8, (0.5 + 0.8**2 / 3.0) / 0.8)])
def test_a_straight_lift_takes_the_time_of_bang_bang_or_of_a_trapezoid(velocity: Any, duration: float) -> None:
    """Expected: T = 2 √(d/a), or d = v T − v²/a; legs that nearly all point up, to (1/40)², move as the platform."""
    law = fastest(upright(leg_acceleration_max=3.0, leg_velocity_max=velocity), LIFT)
    assert law.duration == pytest.approx(duration, rel=2e-3)


def test_a_straight_lift_under_a_force_limit_accelerates_by_what_gravity_leaves() -> None:
    # six forces F against weight m g up and down: a₁ = 6 F/m − g, a₂ = 6 F/m + g; v²/2 (1/a₁ + 1/a₂) = d
    platform = upright(actuator_force_max=400.0, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    mass = platform.platform_mass + 6 * (platform.leg_upper_mass + platform.leg_armature)
    weight = 9.81 * (platform.platform_mass + 6 * platform.leg_upper_mass)
    law = fastest(platform, LIFT)
    up, down = (2400 - weight) / mass, (2400 + weight) / mass
    speed = np.sqrt(2 * 0.5 / (1 / up + 1 / down))
    # down by gravity and actuators is faster than up
    assert law.duration == pytest.approx(speed / up + speed / down, rel=3e-3)


def upright(**changes: Any) -> Platform:
    """Six legs at the corners of a hexagon that stand upright but for 1/40, to the left and to the right by turns."""
    angle = np.pi / 3 * np.arange(6)
    radial, tangential = (
        np.stack([c, s, 0 * c], axis=1) for c, s in ((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle)))
    )
    base, slant = radial, 0.05 * np.array([1, -1] * 3)[:, None] * tangential
    return replace(
        UNEVEN,
        base_points=base,
        platform_points=base + slant,
        platform_com=np.zeros(3),
        gravity=np.array([0, 0, -9.81]),
        home_position=np.array([0, 0, 2.0]),
        home_orientation=np.zeros(3),
        leg_length_min=None,
        leg_length_max=None,
        joint_angle_max=None,
        **{"actuator_force_max": None, **changes},
    )


def test_a_margin_leaves_its_share_of_every_limit() -> None:
    path = random_path(LIMITED, 2)
    motion = TimedPath(path, fastest(LIMITED, path, margin=0.2))
    _, largest = shares(LIMITED, replace_knots(motion, 60))
    assert 0.78 < np.median(largest) < 0.801
    assert largest.max() < 0.801


def test_a_ramp_bounds_how_fast_accelerations_change() -> None:
    path = random_path(LIMITED, 3)
    motion = TimedPath(path, fastest(LIMITED, path, ramp=0.05))
    sharp = TimedPath(path, fastest(LIMITED, path))
    time = np.linspace(0, motion.end, 4001)
    changes = [np.abs(np.diff(each(time).acceleration, axis=0)).max() for each in (motion, sharp)]
    assert changes[0] < 0.1 * changes[1]
    # a ramp costs one ramp time, and little more where this motion is longer than many of them
    assert sharp.end + 0.05 < motion.end < sharp.end + 2 * 0.05
    _, largest = shares(LIMITED, replace_knots(motion, 120))
    assert largest.max() < 1.001


@pytest.mark.parametrize(
    ("preset", "ramp"),
    [
        ("motion_base", 0.02),
        *(pytest.param(*case, marks=pytest.mark.evidence) for case in SLOWER_CASES),
    ],
)
def test_a_plan_without_margin_is_within_its_limits_at_rows_from_any_start(preset: str, ramp: float) -> None:
    """Expected: the check's own shares, and rows that fall anywhere between the points of the plan."""
    platform = load_preset(preset)
    path = random_path(platform, 6, size=0.05)
    law, random = fastest(platform, path, ramp=ramp), np.random.default_rng(2)
    largest = []
    for start in random.uniform(0, 0.01, 12):
        motion = polynomials_of(TimedPath(path, law, start))
        time = np.append(np.arange(0, motion.end, 1e-3), motion.end - random.uniform(0, 1e-3, 20))
        of = shares_along(platform, time, motion(time)).of
        largest.append(max(of[limit].max() for limit in DYNAMIC if limit in of))
    assert max(largest) <= 1
    # and none of the limits is left unused
    assert max(largest) > 1 - 1e-4


def test_a_ramp_slows_down_where_its_average_exceeds_a_limit_and_nowhere_else() -> None:
    """Expected: 1 to 1.6 ramp times in a motion of eleven; slower as a whole it would take two more."""
    platform = load_preset("desktop_hexapod")
    path = random_path(platform, 6, size=0.05)
    sharp, averaged = (fastest(platform, path, ramp=ramp).duration for ramp in (0.0, 0.02))
    assert sharp + 0.02 < averaged < sharp + 1.6 * 0.02


@pytest.mark.evidence
@pytest.mark.parametrize(("ramp", "at"), [("0 s", "77.6683114 ms"), ("20 ms", "2.75591132 ms")])
def test_the_shipped_fastest_path_without_margin_passes_the_check(ramp: str, at: str) -> None:
    found = check("fastest_path", {"reference.margin": 0, "reference.ramp": ramp, "reference.at": at})
    assert found.within
    assert found.shares.largest.share > 1 - 1e-3


def test_the_duration_is_that_of_a_direct_transcription() -> None:
    path = random_path(LIMITED, 4)
    assert fastest(LIMITED, path).duration == pytest.approx(least_time(LIMITED, path, 60), rel=0.01)


@pytest.mark.evidence
def test_the_same_path_takes_the_same_time_backwards_without_friction() -> None:
    # time reversed is a motion of the same forces, where nothing dissipates; velocities are not limited by direction
    free = replace(LIMITED, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    there = random_path(free, 5)
    back = GeometricPath(there.position[::-1], there.orientation[::-1], there.length)
    # the rotation vectors count from another pose, so that only the straight path is the same
    straight = [GeometricPath(each.position[[0, -1]], each.orientation[[0, -1]], each.length) for each in (there, back)]
    durations = [fastest(free, each).duration for each in straight]
    assert_allclose(durations[0], durations[1], rtol=2e-4)


def test_a_platform_that_states_no_limit_of_acceleration_has_no_fastest_way() -> None:
    lazy = load_preset("liu2000")
    with pytest.raises(GoughStewartError, match="states neither leg_acceleration_max nor actuator_force_max"):
        fastest(replace(lazy, leg_velocity_max=1.0), random_path(lazy, 0))


def test_limits_that_do_not_hold_the_platform_are_refused_with_leg_and_force() -> None:
    weak = replace(LIMITED, actuator_force_max=40.0)
    with pytest.raises(GoughStewartError, match=r"rest near pose \d of the path takes .* N in leg \d; the limit"):
        fastest(weak, random_path(LIMITED, 1))

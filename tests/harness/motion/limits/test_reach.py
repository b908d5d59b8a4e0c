"""What motions ask of the legs, and the first time at which a platform cannot follow, against brute force."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, Hold, Platform, PointToPoint, Sine, leg_jacobian, load_preset
from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.limits.reach import check_reach, legs_of
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.kinematics import joint_angles
from gough_stewart.model.pose_limits import LARGEST_PITCH
from tests.support.arrays import FloatArray
from tests.support.random_platforms import random_platform

TIMES = np.linspace(0, 1, 101)
# velocity and power have tests of their own
DESKTOP = replace(load_preset("desktop_hexapod"), leg_velocity_max=None, actuator_power_max=None)
PAPER = load_preset("liu2000")
UNLIMITED: dict[str, Any] = {"leg_length_min": None, "leg_length_max": None, "joint_angle_max": None}
FREE = replace(DESKTOP, **UNLIMITED)
# the names of quantities in the error
LENGTH, PITCH, NUMBER = "the length", "the pitch", "the condition number of the leg Jacobian"
BASE_JOINT, PLATFORM_JOINT = "the angle of the base joint", "the angle of the platform joint"
SIDE = "the side of the singular poses (sign of det J against home)"

seeds = st.integers(0, 2**32 - 1)


def home(platform: Platform) -> dict[str, Any]:
    return {"position": platform.home_position, "orientation": platform.home_orientation}


def swing(platform: Platform, by: Any, turned: Any, frequency: float = 0.6, phase: float = 0.0) -> Sine:
    amplitudes: dict[str, Any] = {"position_amplitude": by, "orientation_amplitude": turned}
    return Sine(**home(platform), **amplitudes, frequency=frequency, phase=phase)


def poses(position: Any, orientation: Any) -> Motion:
    """A motion of which only the poses matter; rows broadcast."""
    position, orientation = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
    none = np.zeros_like(position)
    return Motion(position, orientation, none, none, none, none)


def from_home(platform: Platform, along: Any, turned: Any) -> Motion:
    """Home at time 0, changed at time 1."""
    shares = np.array([[0.0], [1.0]])
    position = platform.home_position + shares * np.asarray(along, float)
    return poses(position, platform.home_orientation + shares * np.asarray(turned, float))


def slow_legs(platform: Platform, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Leg vectors (6, 3) and rotation matrix at one pose, leg by leg with SciPy's rotation."""
    turn = Rotation.from_euler("xyz", orientation).as_matrix()
    points = zip(platform.platform_points, platform.base_points, strict=True)
    return np.array([position + turn @ p - b for p, b in points]), turn


def slow_joint_angles(platform: Platform, position: FloatArray, orientation: FloatArray) -> tuple[FloatArray, ...]:
    """Angles (6,) at base and platform by arc cosines of directions in world and in platform axes."""
    seen = []
    for pose in ((position, orientation), (platform.home_position, platform.home_orientation)):
        legs, turn = slow_legs(platform, *pose)
        u = legs / np.linalg.norm(legs, axis=1)[:, None]
        seen.append((u, np.array([turn.T @ one for one in u])))
    return tuple(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)) for a, b in zip(*seen, strict=True))


def slow_offences(platform: Platform, position: FloatArray, orientation: FloatArray) -> set[tuple[str, int | None]]:
    """All quantities, with their legs, that are beyond their limit at one pose."""

    def jacobian(*pose: Any) -> FloatArray:
        legs, turn = slow_legs(platform, *pose)
        u = legs / np.linalg.norm(legs, axis=1)[:, None]
        return np.hstack([u, np.cross([turn @ p for p in platform.platform_points], u)])

    lengths = np.linalg.norm(slow_legs(platform, position, orientation)[0], axis=1)
    low, high, largest = platform.leg_length_min, platform.leg_length_max, platform.joint_angle_max
    J, J_home = jacobian(position, orientation), jacobian(platform.home_position, platform.home_orientation)
    rho = np.sqrt((platform.platform_points**2).sum(axis=1).mean())
    found: set[tuple[str, int | None]] = set()
    if abs(orientation[1]) >= LARGEST_PITCH:
        found.add((PITCH, None))
    if np.linalg.cond(J / [1, 1, 1, rho, rho, rho]) > 100:
        found.add((NUMBER, None))
    if np.linalg.det(J) * np.linalg.det(J_home) <= 0:
        found.add((SIDE, None))
    angles = slow_joint_angles(platform, position, orientation)
    for i in range(6):
        if (low is not None and lengths[i] < low) or (high is not None and lengths[i] > high):
            found.add((LENGTH, i + 1))
        for name, values in zip((BASE_JOINT, PLATFORM_JOINT), angles, strict=True):
            if largest is not None and values[i] > largest:
                found.add((name, i + 1))
    return found


def test_legs_at_home_have_the_published_length() -> None:
    """Expected: cosine rule, L² = 2² + 1² − 2·2·1 cos 30° + 3²; at rest."""
    legs = legs_of(PAPER, Hold(**home(PAPER))(TIMES))
    assert legs.leg_length.shape == legs.leg_velocity.shape == (101, 6)
    assert np.allclose(legs.leg_length, np.sqrt(14 - 2 * np.sqrt(3)), rtol=1e-15)
    assert not np.any(legs.leg_velocity)


@pytest.mark.parametrize("platform", [DESKTOP, PAPER], ids=["desktop_hexapod", "liu2000"])
def test_leg_velocities_are_those_of_the_jacobian_and_of_the_lengths(platform: Platform) -> None:
    """Expected: J [v; ω], and central differences of the lengths."""
    size = 0.1 * platform.characteristic_length
    reference = swing(platform, [size, -size, size], [0.1, -0.2, 0.15], phase=0.4)
    motion = reference(TIMES)
    legs = legs_of(platform, motion)
    J = leg_jacobian(platform, motion.position, motion.orientation)
    twist = np.hstack([motion.velocity, motion.angular_velocity])
    assert np.allclose(legs.leg_velocity, (J @ twist[:, :, None])[:, :, 0], rtol=1e-12, atol=1e-14)
    ahead, behind = (legs_of(platform, reference(TIMES + s * 1e-5)).leg_length for s in (1, -1))
    assert np.allclose(legs.leg_velocity, (ahead - behind) / 2e-5, atol=1e-8)


@pytest.mark.parametrize("platform", [DESKTOP, PAPER], ids=["desktop_hexapod", "liu2000"])
def test_home_and_small_motions_about_it_can_be_reached(platform: Platform) -> None:
    size = 0.05 * platform.characteristic_length
    for reference in (Hold(**home(platform)), swing(platform, [size, -size, size], [0.05, 0.05, -0.05])):
        check_reach(platform, TIMES, reference(TIMES))


def test_no_times_are_no_offence() -> None:
    check_reach(DESKTOP, TIMES[:0], Hold(**home(DESKTOP))(TIMES[:0]))


LEFT_OUT: dict[str, dict[str, Any]] = {
    "nothing": {},
    "joints": {"joint_angle_max": None},
    "stroke": {"leg_length_min": None, "leg_length_max": None},
    "both": UNLIMITED,
}
amplitudes = st.tuples(*[st.floats(-1, 1)] * 6).map(np.array)


@given(amplitudes, st.floats(0.01, 3), st.floats(-3, 3), st.sampled_from(sorted(LEFT_OUT)))
def test_the_first_offence_is_that_of_an_independent_loop(
    amplitude: FloatArray, size: float, phase: float, limits: str
) -> None:
    """Expected: time after time, leg after leg, with SciPy's rotations, arc cosines and NumPy's cond and det."""
    platform, times = replace(DESKTOP, **LEFT_OUT[limits]), TIMES[::4]
    motion = swing(platform, 0.1 * size * amplitude[:3], size * amplitude[3:], phase=phase)(times)
    every = ((t, slow_offences(platform, *pose)) for t, *pose in zip(times, *motion[:2], strict=True))
    expected = next(((t, offences) for t, offences in every if offences), None)
    if expected is None:
        check_reach(platform, times, motion)
        return
    with pytest.raises(ReachError) as caught:
        check_reach(platform, times, motion)
    assert caught.value.time == expected[0]
    assert (caught.value.quantity, caught.value.leg) in expected[1]
    # of the legs beyond the same limit, the first
    same = [leg for quantity, leg in expected[1] if quantity == caught.value.quantity]
    assert caught.value.leg is None or caught.value.leg == min(leg for leg in same if leg)


def straight_up(by: float) -> FloatArray:
    """Leg lengths of the desktop hexapod when it is lifted: √(horizontal² + height²)."""
    flat = DESKTOP.platform_points - DESKTOP.base_points
    return np.asarray(np.sqrt((flat[:, :2] ** 2).sum(axis=1) + (0.15 + by) ** 2))


@pytest.mark.parametrize(("by", "beyond"), [(0.04, np.greater), (-0.04, np.less)])
def test_a_leg_that_leaves_its_stroke_is_named_with_time_and_length(by: float, beyond: np.ufunc) -> None:
    """Expected: the first time at which √(horizontal² + height²) is beyond the limit; all legs alike but rounding."""
    change: dict[str, Any] = {"position_change": [0, 0, by], "orientation_change": np.zeros(3)}
    motion = PointToPoint(**home(DESKTOP), **change, at=0.2, duration=0.5)(TIMES)
    limit = DESKTOP.leg_length_max if by > 0 else DESKTOP.leg_length_min
    assert limit is not None
    lengths = np.array([straight_up(z - 0.15) for z in motion.position[:, 2]])
    row = int(beyond(lengths, limit).any(axis=1).argmax())
    with pytest.raises(ReachError) as caught:
        check_reach(DESKTOP, TIMES, motion)
    error = caught.value
    assert (error.time, error.quantity) == (TIMES[row], LENGTH)
    assert error.leg is not None
    assert error.value == pytest.approx(lengths[row, error.leg - 1], rel=1e-14)
    # how far the platform may be lifted: the same triangle backwards; slower does not help
    heights = np.sqrt(limit**2 - (straight_up(0.0) ** 2 - 0.15**2))
    share = float((np.abs(heights - 0.15) / 0.04).min())
    assert str(error) == (
        f"the reference cannot be reached: at time {TIMES[row]:.6g} s the length of leg {error.leg} is "
        f"{error.value:.6g} m; expected 0.145 to 0.195 m; it would fit if it were {np.floor(1000 * share) / 1000:g} "
        "times as large (reference.amplitude_scale)"
    )


@pytest.mark.parametrize("name", ["leg_length_min", "leg_length_max"])
def test_one_end_of_the_stroke_may_be_open(name: str) -> None:
    """Expected: with one limit alone, only motions beyond that one are refused."""
    platform = replace(FREE, **{name: getattr(DESKTOP, name)})
    up, down = (from_home(platform, [0, 0, by], [0, 0, 0]) for by in (0.04, -0.04))
    refused, reached = (up, down) if name == "leg_length_max" else (down, up)
    check_reach(platform, TIMES[:2], reached)
    with pytest.raises(ReachError, match=r"the length of leg \d"):
        check_reach(platform, TIMES[:2], refused)


def test_a_motion_exactly_to_the_end_of_the_stroke_can_be_reached() -> None:
    longest = float(legs_of(FREE, from_home(FREE, [0, 0, 0.03], [0, 0, 0])).leg_length.max())
    check_reach(replace(FREE, leg_length_max=longest), TIMES[:2], from_home(FREE, [0, 0, 0.03], [0, 0, 0]))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_pitch_of_90_degrees_is_refused(sign: int) -> None:
    """Expected: as the plant refuses it, at `LARGEST_PITCH` and not just below."""
    limitless = 1e9
    with pytest.raises(ReachError, match="the pitch is") as caught:
        check_reach(FREE, TIMES[:2], from_home(FREE, [0, 0, 0], [0, sign * LARGEST_PITCH, 0]), limitless)
    assert (caught.value.quantity, caught.value.leg) == (PITCH, None)
    assert caught.value.value == sign * LARGEST_PITCH
    motion = from_home(FREE, [0, 0, 0], [0, sign * (LARGEST_PITCH - 1e-9), 0])
    try:
        check_reach(FREE, TIMES[:2], motion, limitless)
    except ReachError as error:
        assert error.quantity != PITCH  # noqa: PT017 - another quantity may refuse it


def test_a_motion_close_to_a_singular_pose_is_refused() -> None:
    """Expected: Fichter's singularity at 90° of yaw from the symmetric pose; the limit is the caller's."""
    with pytest.raises(ReachError, match=r"the condition number .* is .*; expected 1 to 100;") as caught:
        check_reach(PAPER, TIMES[:2], from_home(PAPER, [0, 0, 0], [0, 0, np.radians(89.9)]))
    assert caught.value.quantity == NUMBER
    assert caught.value.value > 100
    check_reach(PAPER, TIMES[:2], from_home(PAPER, [0, 0, 0], [0, 0, np.radians(89.9)]), 1e4)


def test_a_motion_that_jumped_over_a_singular_pose_is_refused() -> None:
    """Expected: beyond 90° of yaw det J has the other sign, though the condition number is good again."""
    with pytest.raises(ReachError, match=r"sign of det J against home\) is -1; expected 1; ") as caught:
        check_reach(PAPER, TIMES[:2], from_home(PAPER, [0, 0, 0], [0, 0, np.radians(130)]))
    assert (caught.value.time, caught.value.quantity, caught.value.leg) == (TIMES[1], SIDE, None)


@pytest.mark.parametrize("quantity", [BASE_JOINT, PLATFORM_JOINT])
def test_a_joint_beyond_its_angle_is_refused(quantity: str) -> None:
    """Expected: arc cosines of the directions; a shift turns both ends alike, a tilt mostly those at the platform."""
    along, turned = ([0.05, 0, 0], [0, 0, 0]) if quantity == BASE_JOINT else ([0, 0, 0], [0.3, 0, 0])
    motion = from_home(FREE, along, turned)
    base, at_platform = slow_joint_angles(FREE, motion.position[1], motion.orientation[1])
    angles = base if quantity == BASE_JOINT else at_platform
    largest = float(max(base.max(), at_platform.max()))
    assert angles.max() == pytest.approx(largest)
    with pytest.raises(ReachError) as caught:
        check_reach(replace(FREE, joint_angle_max=0.999 * largest), TIMES[:2], motion)
    assert caught.value.quantity == quantity
    assert caught.value.leg is not None
    assert caught.value.value == pytest.approx(angles[caught.value.leg - 1], rel=1e-9)
    check_reach(replace(FREE, joint_angle_max=1.001 * largest), TIMES[:2], motion)


def test_joint_angles_are_zero_at_home_and_right_close_to_it() -> None:
    """Expected: lifted by dz, a leg at horizontal distance d and length L turns by dz d/L², alike at both ends."""
    pose = (PAPER.home_position, PAPER.home_orientation)
    assert not np.any(joint_angles(PAPER, *pose, *pose))
    flat = np.linalg.norm((PAPER.platform_points - PAPER.base_points)[:, :2], axis=1)
    base, at_platform = joint_angles(PAPER, PAPER.home_position + np.array([0, 0, 1e-9]), PAPER.home_orientation, *pose)
    assert np.allclose(base, 1e-9 * flat / (14 - 2 * np.sqrt(3)), rtol=1e-6)
    assert np.allclose(at_platform, base, rtol=1e-6)


def test_a_leg_of_no_length_is_refused_without_a_warning() -> None:
    """Expected: where P₁ is at B₁ exactly, leg 1 has no direction, so the condition number is infinite."""
    # multiples of 1/64 m, whose sums have no rounding
    base, at_platform = (np.round(64 * points) / 64 for points in (PAPER.base_points, PAPER.platform_points))
    platform = replace(PAPER, base_points=base, platform_points=at_platform)
    corner = base[0] - at_platform[0]
    assert not np.any(slow_legs(platform, corner, np.zeros(3))[0][0])
    with pytest.raises(ReachError, match="the condition number of the leg Jacobian is inf"):
        check_reach(platform, TIMES[:2], poses([platform.home_position, corner], [0, 0, 0]))


def test_poses_that_are_not_numbers_are_refused() -> None:
    """Expected: at their time, not before."""
    for part in (0, 1):
        motion = from_home(DESKTOP, [0, 0, 0], [0, 0, 0])
        motion[part][1, 1] = np.nan
        with pytest.raises(ReachError) as caught:
            check_reach(DESKTOP, TIMES[:2], motion)
        assert caught.value.time == TIMES[1]


def test_the_error_carries_its_data_to_another_process() -> None:
    with pytest.raises(ReachError) as caught:
        check_reach(DESKTOP, TIMES[:2], from_home(DESKTOP, [0, 0, 0.04], [0, 0, 0]))
    copy = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(copy, GoughStewartError)
    assert (str(copy), vars(copy)) == (str(caught.value), vars(caught.value))


def first_beyond(time: FloatArray, values: FloatArray, limit: float) -> tuple[float, int, float]:
    """Time, leg and value where values (n, 6) first leave ±limit."""
    row = int((np.abs(values) > limit).any(axis=1).argmax())
    leg = int((np.abs(values[row]) > limit).argmax())
    return float(time[row]), leg + 1, float(values[row, leg])


@given(seeds)
def test_a_leg_that_would_be_too_fast_is_named_with_the_time(seed: int) -> None:
    """Expected: rates by differences of leg lengths, leg by leg; just above the fastest of them nothing is refused."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    size = platform.characteristic_length
    motion = swing(platform, 0.1 * size * rng.uniform(0.2, 1, 3), rng.uniform(-0.1, 0.1, 3), phase=0.3)(TIMES)
    h, turned = 1e-6, Rotation.from_euler("xyz", motion.orientation)
    ahead, behind = (
        np.array(
            [
                np.linalg.norm(slow_legs(platform, *pose)[0], axis=1)
                for pose in zip(
                    motion.position + s * motion.velocity,
                    (Rotation.from_rotvec(s * motion.angular_velocity) * turned).as_euler("xyz"),
                    strict=True,
                )
            ]
        )
        for s in (h, -h)
    )
    rates = (ahead - behind) / (2 * h)
    fastest = float(np.abs(rates).max())
    check_reach(replace(platform, leg_velocity_max=1.001 * fastest), TIMES, motion)
    limit = 0.8 * fastest
    with pytest.raises(ReachError, match="the velocity of leg") as caught:
        check_reach(replace(platform, leg_velocity_max=limit), TIMES, motion)
    error = caught.value
    time, leg, value = first_beyond(TIMES, rates, limit)
    assert (error.quantity, error.time, error.leg) == ("the velocity", time, leg)
    assert error.value == pytest.approx(value, rel=1e-5)


def test_power_at_a_singular_pose_does_not_hide_what_is_wrong() -> None:
    """Expected: Fichter's pose, a quarter turn about z, is refused for its condition number."""
    motion = from_home(replace(PAPER, actuator_power_max=1.0), [0, 0, 0], [0, 0, np.pi / 2])
    with pytest.raises(ReachError) as caught:
        check_reach(replace(PAPER, actuator_power_max=1.0), TIMES[:2], motion)
    assert caught.value.quantity == NUMBER

"""Reach, conditioning and static strength at poses, and the grid over them, against closed forms and other methods."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from gough_stewart.model import workspace as module
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import conditioning, leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, evaluate_poses, limits_at
from tests.support.random_platforms import random_platform
from tests.support.uneven import UNEVEN

MOTION_BASE, DESKTOP, PAPER = (load_preset(name) for name in ("motion_base", "desktop_hexapod", "liu2000"))

LEVEL = np.zeros(3)
seeds = st.integers(0, 2**32 - 1)


def limited(seed: int) -> tuple[Platform, FloatArray, FloatArray, np.random.Generator]:
    """A random platform with every limit, and poses (20, 3) about its home, within them and beyond."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    home = (platform.home_position, platform.home_orientation)
    length = leg_geometry(platform, *home).length
    force = np.abs(static_leg_forces(platform, *home)).max()
    platform = replace(
        platform,
        leg_length_min=0.8 * length.min(),
        leg_length_max=1.2 * length.max(),
        joint_angle_max=0.4,
        actuator_force_max=float(force * rng.uniform(0.8, 4)),
        leg_velocity_max=float(rng.uniform(0.1, 2)),
    )
    position = home[0] + 0.4 * platform.characteristic_length * rng.normal(size=(20, 3))
    return platform, position, home[1] + 0.3 * rng.normal(size=(20, 3)), rng


def test_a_level_symmetric_platform_heaves_as_far_as_its_legs() -> None:
    """Expected: L² = z² + h², h the horizontal distance of the joints; all legs alike."""
    h = np.hypot(*(DESKTOP.platform_points - DESKTOP.base_points)[:, :2].T).mean()
    assert DESKTOP.leg_length_min is not None
    assert DESKTOP.leg_length_max is not None
    low, high = (np.sqrt(L**2 - h**2) for L in (DESKTOP.leg_length_min, DESKTOP.leg_length_max))
    z = np.array([low - 1e-6, low + 1e-6, 0.5 * (low + high), high - 1e-6, high + 1e-6])
    free = replace(DESKTOP, joint_angle_max=None)
    q = evaluate_poses(free, np.stack([0 * z, 0 * z, z], axis=-1), LEVEL)
    assert q.limit.tolist() == [Limit.LEG_TOO_SHORT, 0, 0, 0, Limit.LEG_TOO_LONG]
    assert q.leg_length_margin is not None
    expected = np.minimum(np.hypot(z, h) - DESKTOP.leg_length_min, DESKTOP.leg_length_max - np.hypot(z, h))
    assert np.allclose(q.leg_length_margin, expected, atol=1e-9)
    assert q.joint_angle_margin is None


def test_at_home_a_symmetric_platform_holds_six_legs_force_less_its_own_weight() -> None:
    """Expected: 6 F cos = (m + payload) g, cos = z/L; legs of next to no mass."""
    light = replace(MOTION_BASE, leg_lower_mass=1e-6, leg_upper_mass=1e-6)
    q = evaluate_poses(light, light.home_position, light.home_orientation)
    L = leg_geometry(light, light.home_position, light.home_orientation).length.mean()
    assert q.payload is not None
    assert q.payload == pytest.approx(6 * 20000 * 2.0 / L / 9.81 - light.platform_mass, rel=1e-7)


@given(seeds)
@settings(max_examples=25)
def test_at_its_limit_a_payload_loads_one_leg_to_the_force_limit_and_none_beyond(seed: int) -> None:
    """Expected: static leg forces under the payload's weight at Op, from the dynamics."""
    platform, position, orientation, _ = limited(seed)
    limit = platform.actuator_force_max
    assert limit is not None
    q = evaluate_poses(platform, position, orientation)
    assert q.payload is not None
    for k in np.flatnonzero(q.condition_number < 1e3):
        pose = (position[k], orientation[k])
        bare = np.abs(static_leg_forces(platform, *pose)).max()
        if bare > limit:
            assert q.payload[k] == 0
            continue
        weight = np.concatenate([q.payload[k] * platform.gravity, LEVEL])
        assert np.abs(static_leg_forces(platform, *pose, weight)).max() == pytest.approx(limit, rel=1e-9)


@given(seeds)
@settings(max_examples=15)
def test_the_force_margin_is_the_least_of_what_linear_programs_find(seed: int) -> None:
    """Expected: along ±A_i the largest force with all legs within the limit, by SciPy; less along no direction."""
    platform, position, orientation, rng = limited(seed)
    limit = platform.actuator_force_max
    assert limit is not None
    pose = (position[0], orientation[0])
    qualities = evaluate_poses(platform, *pose)
    assert qualities.force_margin is not None
    found = float(qualities.force_margin)
    f0 = static_leg_forces(platform, *pose)
    if np.abs(f0).max() > limit:
        assert found == 0
        return
    A = np.linalg.inv(leg_jacobian(platform, *pose).T)[:, :3]
    directions = np.concatenate([A, -A, rng.normal(size=(20, 3))])
    strengths = []
    for d in directions / np.linalg.norm(directions, axis=1)[:, None]:
        along = (A @ d)[:, None]
        done = linprog([-1.0], A_ub=np.vstack([-along, along]), b_ub=np.concatenate([limit - f0, limit + f0]))
        assert done.x is not None
        strengths.append(float(done.x[0]))
    assert min(strengths) == pytest.approx(found, rel=1e-7)


@given(seeds)
@settings(max_examples=25)
def test_condition_numbers_are_those_of_the_kinematics(seed: int) -> None:
    """Expected: `kinematics.conditioning`, bit for bit; the margin is its smallest singular value, signed by det J."""
    platform, position, orientation, _ = limited(seed)
    q = evaluate_poses(platform, position, orientation)
    expected = conditioning(platform, position, orientation)
    home = np.linalg.det(leg_jacobian(platform, platform.home_position, platform.home_orientation))
    side = np.sign(np.linalg.det(leg_jacobian(platform, position, orientation)) * home)
    assert np.array_equal(q.condition_number, expected.condition_number)
    assert np.array_equal(q.singular_margin, side * expected.smallest_singular_value)


@given(seeds)
@settings(max_examples=15)
def test_no_leg_is_too_fast_at_the_largest_speed_in_any_direction(seed: int) -> None:
    """Expected: leg rates by differences of lengths; within the limit in random directions, at it in the worst one."""
    platform, position, orientation, rng = limited(seed)
    speed = evaluate_poses(platform, position, orientation).largest_speed
    assert speed is not None
    assert platform.leg_velocity_max is not None
    t, R, rho, h = position[0], Rotation.from_euler("xyz", orientation[0]), platform.characteristic_length, 1e-6
    twists = np.concatenate([np.eye(6), rng.normal(size=(500, 6))])
    twists /= np.linalg.norm(twists, axis=1)[:, None]

    def lengths(sign: int) -> np.ndarray:
        turned = (Rotation.from_rotvec(sign * h * twists[:, 3:] / rho) * R).as_euler("xyz")
        return np.asarray(leg_geometry(platform, t + sign * h * twists[:, :3], turned).length)

    rates = (lengths(1) - lengths(-1)) / (2 * h)
    fastest = speed[0] * np.abs(rates).max()
    assert fastest <= platform.leg_velocity_max * (1 + 1e-6)
    # by linearity the rates of the first six are a leg's gradient, along which it is fastest
    assert speed[0] * np.linalg.norm(rates[:6], axis=0).max() == pytest.approx(platform.leg_velocity_max, rel=1e-6)


@given(seeds, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
@settings(max_examples=25)
def test_a_third_of_a_turn_changes_nothing_on_a_symmetric_platform(seed: int, roll: float, pitch: float) -> None:
    """Expected: motion_base, whose legs go into each other by 120° about z; margins to the digits of its file."""
    rng = np.random.default_rng(seed)
    position = MOTION_BASE.home_position + rng.uniform(-0.5, 0.5, 3)
    R = Rotation.from_euler("xyz", [roll, pitch, rng.uniform(-0.3, 0.3)])
    turn = Rotation.from_euler("z", 2 * np.pi / 3)
    # the platform is carried on by as much in its own axes
    turned = (turn * R * turn.inv()).as_euler("xyz")
    a = evaluate_poses(MOTION_BASE, position, R.as_euler("xyz"))
    b = evaluate_poses(MOTION_BASE, turn.apply(position), turned)
    for name in (
        "leg_length_margin",
        "joint_angle_margin",
        "singular_margin",
        "payload",
        "force_margin",
        "largest_speed",
    ):
        x, y = getattr(a, name), getattr(b, name)
        assert y == pytest.approx(x, rel=1e-6, abs=1e-6 * (1 + abs(float(x)))), name


def test_poses_beyond_a_singular_one_and_at_a_pitch_of_90_degrees_are_out_of_reach() -> None:
    """Expected: below the base the mirror image has the same legs but the other sign of det J."""
    free = replace(DESKTOP, joint_angle_max=None)
    mirrored = free.home_position * [1, 1, -1]
    assert evaluate_poses(free, mirrored, LEVEL).limit == Limit.SINGULAR
    assert evaluate_poses(PAPER, PAPER.home_position, np.array([0, np.pi / 2, 0])).limit == Limit.PITCH
    assert evaluate_poses(PAPER, PAPER.home_position, np.array([0, np.nan, 0])).limit == Limit.PITCH


def test_each_joint_limit_is_told_apart() -> None:
    """Expected: a level platform moved sideways turns both ends of a leg alike, base first; a tilt more at the top."""
    narrow = replace(DESKTOP, leg_length_min=None, leg_length_max=None, joint_angle_max=0.2)
    assert evaluate_poses(narrow, DESKTOP.home_position + np.array([0.06, 0, 0]), LEVEL).limit == Limit.BASE_JOINT
    assert evaluate_poses(narrow, DESKTOP.home_position, np.array([0.25, 0, 0])).limit == Limit.PLATFORM_JOINT


def test_at_a_singular_pose_nothing_is_held() -> None:
    """Expected: liu2000 turned by 90° about z is Fichter's singular pose; where P₁ is at B₁, leg 1 has no direction."""
    base, top = (np.round(64 * points) / 64 for points in (PAPER.base_points, PAPER.platform_points))
    platform = replace(PAPER, base_points=base, platform_points=top, actuator_force_max=1e4)
    q = evaluate_poses(platform, np.stack([platform.home_position, base[0] - top[0]]), LEVEL)
    assert q.payload is not None
    assert q.force_margin is not None
    assert q.condition_number[1] == np.inf
    assert q.payload[1] == q.force_margin[1] == 0 < q.payload[0]
    speed = evaluate_poses(replace(platform, leg_velocity_max=1.0), base[0] - top[0], LEVEL).largest_speed
    assert speed == 0
    fichter = evaluate_poses(replace(PAPER, actuator_force_max=1e4), PAPER.home_position, np.array([0, 0, np.pi / 2]))
    assert fichter.condition_number > 1e10


def test_without_gravity_any_payload_is_held() -> None:
    """Expected: no leg feels it."""
    q = evaluate_poses(replace(MOTION_BASE, gravity=np.zeros(3)), MOTION_BASE.home_position, LEVEL)
    assert q.payload == np.inf
    assert q.force_margin is not None
    assert np.isfinite(q.force_margin)


def test_limits_that_are_not_stated_keep_from_nothing() -> None:
    q = evaluate_poses(PAPER, PAPER.home_position, LEVEL)
    assert (q.leg_length_margin, q.joint_angle_margin, q.payload, q.force_margin, q.largest_speed) == (None,) * 5
    assert q[8:] == (None,) * 5
    one_sided = evaluate_poses(replace(PAPER, leg_length_max=3.3), np.array([0, 0, 3.5]), LEVEL)
    assert one_sided.limit == Limit.LEG_TOO_LONG


def test_chunks_and_leading_axes_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same poses all at once; progress counts them."""
    rng = np.random.default_rng(1)
    position = DESKTOP.home_position + 0.04 * rng.normal(size=(3, 7, 3))
    soft = replace(DESKTOP, leg_armature=0.2, leg_stiffness=1e6)
    whole = evaluate_poses(soft, position, LEVEL)
    monkeypatch.setattr(module, "CHUNK", 4)
    done: list[int] = []
    parts = evaluate_poses(soft, position, LEVEL, done.append)
    assert done == [4, 8, 12, 16, 20, 21]
    for a, b in zip(whole, parts, strict=True):
        assert a is not None
        assert b is not None
        assert a.shape == (3, 7)
        assert np.allclose(a, b, rtol=1e-12)
    assert np.array_equal(whole.limit, limits_at(DESKTOP, position, LEVEL))
    assert evaluate_poses(DESKTOP, np.zeros((0, 3)), LEVEL).limit.shape == (0,)


# Six different poses about and beyond the limits of the uneven platform.
POSES = np.array(
    [
        [0.10, -0.05, 2.92, 0.07, -0.09, 0.14],
        [0.31, -0.22, 3.05, -0.10, 0.08, 0.25],
        [-0.60, 0.45, 2.60, 0.15, 0.12, -0.20],
        [0.90, 0.10, 3.40, 0.02, -0.30, 0.05],
        [0.05, 0.02, 1.60, 0.00, 0.05, 0.10],
        [0.10, -0.10, 2.95, 0.30, -0.20, 0.90],
    ]
)


def test_every_quality_of_a_pose_is_that_of_an_independent_calculation() -> None:
    """Expected: NumPy and SciPy's rotations, pose by pose; static forces by balances of bodies; a batch of a batch."""
    platform = replace(UNEVEN, leg_velocity_max=0.8, actuator_force_max=75.0, leg_stiffness=2.7e6)
    found = evaluate_poses(platform, POSES[:, :3].reshape(2, 3, 3), POSES[:, 3:].reshape(2, 3, 3))
    home = Rotation.from_euler("xyz", UNEVEN.home_orientation)
    rho = np.sqrt((UNEVEN.platform_points**2).sum() / 6)

    def legs(t: FloatArray, R: Rotation) -> tuple[FloatArray, FloatArray, FloatArray]:
        arm = R.apply(UNEVEN.platform_points.copy())
        l = t + arm - UNEVEN.base_points
        return arm, np.linalg.norm(l, axis=1), l / np.linalg.norm(l, axis=1)[:, None]

    def angle(a: FloatArray, b: FloatArray) -> float:
        return float(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)).max())

    u0 = legs(UNEVEN.home_position, home)[2]
    for k, pose in enumerate(POSES):
        R = Rotation.from_euler("xyz", pose[3:])
        arm, L, u = legs(pose[:3], R)
        scaled = np.hstack([u, np.cross(arm, u) / rho])
        sigma = np.linalg.svd(scaled, compute_uv=False)
        of_base = 0.7 - angle(u, u0)
        of_platform = 0.7 - angle(R.inv().apply(u), home.inv().apply(u0))
        f0 = _static_forces(pose[:3], R)
        # a mass of 1 kg, and a force of 1 N in any direction, at Op
        J = np.hstack([u, np.cross(arm, u)])
        f1 = np.linalg.solve(J.T, np.concatenate([-UNEVEN.gravity, np.zeros(3)]))
        A = np.linalg.inv(J.T)[:, :3]
        C = np.linalg.inv(2.7e6 * J.T @ J)
        holds = bool((np.abs(f0) <= 75.0).all())
        expected = {
            "leg_length_margin": min(L.min() - 2.3, 3.9 - L.max()),
            "joint_angle_margin": min(of_base, of_platform),
            "singular_margin": sigma[5],
            "condition_number": sigma[0] / sigma[5],
            "payload": ((75.0 - np.sign(f1) * f0) / np.abs(f1)).min() if holds else 0.0,
            "force_margin": ((75.0 - np.abs(f0)) / np.linalg.norm(A, axis=1)).min() if holds else 0.0,
            "largest_speed": 0.8 / np.linalg.norm(scaled, axis=1).max(),
            "translational_stiffness": 1 / np.linalg.eigvalsh(C[:3, :3]).max(),
            "translational_stiffness_max": 1 / np.linalg.eigvalsh(C[:3, :3]).min(),
            "rotational_stiffness": 1 / np.linalg.eigvalsh(C[3:, 3:]).max(),
            "rotational_stiffness_max": 1 / np.linalg.eigvalsh(C[3:, 3:]).min(),
        }
        for name, value in expected.items():
            own = getattr(found, name)
            assert own.shape == (2, 3)
            assert own.reshape(6)[k] == pytest.approx(value, rel=1e-8, abs=1e-8), (name, k)
        first = [L.min() < 2.3, L.max() > 3.9, of_base < 0, of_platform < 0]
        kinds = [Limit.LEG_TOO_SHORT, Limit.LEG_TOO_LONG, Limit.BASE_JOINT, Limit.PLATFORM_JOINT]
        limit = next((kind for is_beyond, kind in zip(first, kinds, strict=True) if is_beyond), Limit.NONE)
        assert found.limit.reshape(6)[k] == limit
        assert found.reachable.reshape(6)[k] == (limit == Limit.NONE)
        assert limits_at(platform, pose[:3], pose[3:]) == limit
    assert len(set(found.limit.ravel().tolist())) >= 3
    assert found.payload is not None
    assert 0 < np.count_nonzero(found.payload) < 6


def _static_forces(position: FloatArray, R: Rotation) -> FloatArray:
    """Leg forces at rest: weight of platform, of upper parts along the legs, of all leg parts by moments about B."""
    g = UNEVEN.gravity
    arm = R.apply(UNEVEN.platform_points.copy())
    l = position + arm - UNEVEN.base_points
    L = np.linalg.norm(l, axis=1)
    u = l / L[:, None]
    # what each leg takes at its platform joint: along u the upper part, across it the moment of both about B
    first = 2.3 * 0.47 + 1.2 * (L - 0.58)
    across = (first / L)[:, None] * (g - (u @ g)[:, None] * u)
    onto = 1.2 * (u @ g)[:, None] * u + across
    force = 11.5 * g + onto.sum(axis=0)
    torque = np.cross(R.apply(UNEVEN.platform_com.copy()), 11.5 * g) + np.cross(arm, onto).sum(axis=0)
    J = np.hstack([u, np.cross(arm, u)])
    return np.asarray(np.linalg.solve(J.T, -np.concatenate([force, torque])))


def test_limits_have_their_order_and_their_words() -> None:
    """Expected: the documentation's order; each pose beyond several limits is out of reach by the first."""
    words = ["reachable", "pitch at ±90°", "beyond a singular pose", "a leg too short", "a leg too long"]
    words += ["angle of a base joint", "angle of a platform joint"]
    assert [limit.text for limit in Limit] == words
    assert [int(limit) for limit in Limit] == list(range(7))
    narrow = replace(UNEVEN, joint_angle_max=1e-6, leg_length_min=2.9, leg_length_max=3.3)
    home, level = UNEVEN.home_position, UNEVEN.home_orientation
    poses = [
        (home, np.array([0.0, np.pi / 2 - 0.9e-3, 2.5]), Limit.PITCH),
        (home, np.array([0.0, -np.pi / 2 + 0.9e-3, 2.5]), Limit.PITCH),
        (home, np.array([0.0, 0.0, 2.5]), Limit.SINGULAR),
        (home + np.array([1.5, 0.0, -0.3]), level, Limit.LEG_TOO_SHORT),
        (home + np.array([0.0, 0.0, 0.4]), level, Limit.LEG_TOO_LONG),
        (home + np.array([0.01, 0.0, 0.0]), level, Limit.BASE_JOINT),
    ]
    lengths = leg_geometry(narrow, poses[3][0], level).length
    assert lengths.min() < 2.9
    assert lengths.max() > 3.3
    narrow = replace(narrow, joint_angle_max=1e-6)
    position, orientation = (np.array([pose[k] for pose in poses]) for k in (0, 1))
    assert evaluate_poses(narrow, position, orientation).limit.tolist() == [pose[2] for pose in poses]
    assert limits_at(narrow, position, orientation).tolist() == [pose[2] for pose in poses]
    turned = replace(narrow, joint_angle_max=0.02)
    tilted = evaluate_poses(turned, home, level + np.array([0.05, 0.0, 0.0]))
    assert tilted.limit == Limit.PLATFORM_JOINT


def test_poses_at_a_limit_can_be_reached() -> None:
    """Expected: a margin of nothing is within, the least of all beyond is not; for strokes and for forces."""
    pose = UNEVEN.home_position + np.array([0.5, 0.3, 0.02]), UNEVEN.home_orientation
    free = replace(UNEVEN, joint_angle_max=None)
    length = leg_geometry(free, *pose).length
    exact = replace(free, leg_length_min=float(length.min()), leg_length_max=float(length.max()))
    exact_limits = [(exact, Limit.NONE)]
    for name, end, limit in (("leg_length_min", 9.0, Limit.LEG_TOO_SHORT), ("leg_length_max", 0.0, Limit.LEG_TOO_LONG)):
        beyond: dict[str, Any] = {name: float(np.nextafter(getattr(exact, name), end))}
        exact_limits.append((replace(exact, **beyond), limit))
    for platform, limit in exact_limits:
        assert evaluate_poses(platform, *pose).limit == limit
    force = np.abs(static_leg_forces(UNEVEN, *pose)).max()
    for share, is_held in ((1 + 1e-9, True), (1 - 1e-9, False)):
        q = evaluate_poses(replace(UNEVEN, actuator_force_max=float(share * force)), *pose)
        assert q.force_margin is not None
        assert (q.force_margin > 0) == is_held

"""Reach, conditioning and static strength at poses, and the grid over them, against closed forms and other methods."""

import re
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
from gough_stewart.model.errors import GoughStewartError, WorkspaceError
from gough_stewart.model.kinematics import conditioning, leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, evaluate_poses, limits_at
from gough_stewart.model.workspace_grid import COORDINATES, LARGEST_GRID, POINTS, default_ranges, sweep
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
    one_sided = evaluate_poses(replace(PAPER, leg_length_max=3.3), np.array([0, 0, 3.5]), LEVEL)
    assert one_sided.limit == Limit.LEG_TOO_LONG


def test_chunks_and_leading_axes_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the same poses all at once; progress counts them."""
    rng = np.random.default_rng(1)
    position = DESKTOP.home_position + 0.04 * rng.normal(size=(3, 7, 3))
    whole = evaluate_poses(DESKTOP, position, LEVEL)
    monkeypatch.setattr(module, "CHUNK", 4)
    done: list[int] = []
    parts = evaluate_poses(DESKTOP, position, LEVEL, done.append)
    assert done == [4, 8, 12, 16, 20, 21]
    for a, b in zip(whole, parts, strict=True):
        assert a is not None
        assert b is not None
        assert a.shape == (3, 7)
        assert np.allclose(a, b, rtol=1e-12)
    assert np.array_equal(whole.limit, limits_at(DESKTOP, position, LEVEL))
    assert evaluate_poses(DESKTOP, np.zeros((0, 3)), LEVEL).limit.shape == (0,)


@pytest.mark.parametrize("over", [("x", "y"), ("z", "yaw"), ("roll", "pitch")])
@pytest.mark.parametrize("platform", [MOTION_BASE, DESKTOP], ids=["motion_base", "desktop_hexapod"])
def test_default_ranges_hold_what_can_be_reached_and_little_else(platform: Platform, over: tuple[str, ...]) -> None:
    """Expected: nothing reached at the ends of the grid; a grid over three times the range reaches no more."""
    w = sweep(platform, dict.fromkeys(over), points=61)
    reached = w.qualities.reachable
    assert not reached[[0, -1]].any()
    assert not reached[:, [0, -1]].any()
    ends = {name: (values[0], values[-1]) for name, values in w.swept.items()}
    for axis, name in enumerate(over):
        rows = np.flatnonzero(reached.any(axis=1 - axis))
        assert rows[-1] - rows[0] > 0.6 * 60, name
    wide = {n: (1.5 * a - 0.5 * b, 1.5 * b - 0.5 * a) for n, (a, b) in ends.items()}
    wide = {n: (max(a, -1.5), min(b, 1.5)) if COORDINATES[n] == "rad" else (a, b) for n, (a, b) in wide.items()}
    far = sweep(platform, wide, points=61)
    first, second = (far.swept[name] for name in over)
    i, j = np.nonzero(far.qualities.reachable)
    (a, b), (c, d) = (ends[name] for name in over)
    assert ((a < first[i]) & (first[i] < b) & (c < second[j]) & (second[j] < d)).all()


def test_without_limits_a_range_about_home_is_assumed_and_said() -> None:
    """Expected: as documented, one characteristic length (here 1 m), and 90°."""
    w = sweep(PAPER, {"z": None, "roll": None}, points=3)
    assert w.assumed == ("z", "roll")
    assert w.found == ()
    assert w.swept["z"] == pytest.approx([2, 3, 4])
    assert w.swept["roll"] == pytest.approx([-np.pi / 2, 0, np.pi / 2])


@pytest.mark.parametrize(
    ("home", "ends"), [(0.1, (-1.470796, np.pi / 2)), (1.2, (-0.370796, np.pi / 2)), (-1.2, (-np.pi / 2, 0.370796))]
)
def test_a_pitch_without_limits_goes_90_degrees_about_home_but_not_beyond_90(
    home: float, ends: tuple[float, float]
) -> None:
    """Expected: home ± π/2 = 1.570796, cut at ± π/2."""
    tilted = replace(PAPER, home_orientation=np.array([0.0, home, 0.0]))
    w = sweep(tilted, {"pitch": None, "x": (-0.1, 0.1)}, points=2)
    assert w.swept["pitch"] == pytest.approx(ends, abs=1e-6)


def test_a_map_has_101_points_per_coordinate_unless_told_otherwise() -> None:
    """Expected: as documented."""
    assert sweep(PAPER, {"x": (-0.1, 0.1), "yaw": (0.0, 0.1)}).shape == (101, 101)


def test_a_grid_has_its_poses_in_order() -> None:
    w = sweep(DESKTOP, {"z": (0.14, 0.16), "x": (0.0, 0.02)}, {"yaw": 0.1}, points=3)
    poses = w.coordinates()
    assert w.shape == (3, 3)
    assert poses[2, 1] == pytest.approx([0.01, 0, 0.16, 0, 0, 0.1])
    alone = evaluate_poses(DESKTOP, poses[2, 1, :3], poses[2, 1, 3:])
    assert w.qualities.condition_number[2, 1] == pytest.approx(float(alone.condition_number))


def test_where_nothing_can_be_reached_there_is_still_a_range() -> None:
    fixed = {"z": 5.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}
    for low, high in default_ranges(MOTION_BASE, {"x": None, "y": None}, fixed).values():
        assert low < high


BAD: list[tuple[dict[str, Any], str]] = [
    ({"over": {"x": None, "q": None}}, "unknown coordinate 'q'; expected one of x, y, z"),
    ({"at": {"w": 1.0}}, "unknown coordinate 'w'"),
    ({"over": {"x": None}}, "1 swept coordinates; expected two"),
    ({"over": dict.fromkeys("xyz") | {"yaw": None}}, "4 swept coordinates"),
    ({"at": {"x": 0.1}}, "x is both swept and fixed"),
    ({"over": {"x": (1.0, -1.0), "y": None}}, "x goes from 1 m to -1 m; expected a range from low to high"),
    ({"over": {"x": (0.0, np.inf), "y": None}}, "x is inf; expected a finite number of m"),
    ({"at": {"pitch": 5.0}}, "pitch is 5 rad, 286.479°; expected from −90° to 90°; numbers without a unit are in rad"),
    ({"points": 1}, "1 points per coordinate for 2 swept coordinates; expected from 2 to 500"),
    ({"points": 501}, "in all 251,001 poses, for 2 swept coordinates; expected from 2 to 500"),
    ({"over": dict.fromkeys("xyz"), "points": 63}, "expected from 2 to 62"),
]


@pytest.mark.parametrize(("asked", "text"), BAD, ids=[text[:24] for _, text in BAD])
def test_what_makes_no_grid_is_refused(asked: dict[str, Any], text: str) -> None:
    with pytest.raises(WorkspaceError, match=text.replace("?", r"\?")) as caught:
        sweep(DESKTOP, **asked)
    assert isinstance(caught.value, GoughStewartError)
    assert 500**2 <= LARGEST_GRID < 501**2


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
    platform = replace(UNEVEN, leg_velocity_max=0.8, actuator_force_max=75.0)
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
        holds = bool((np.abs(f0) <= 75.0).all())
        expected = {
            "leg_length_margin": min(L.min() - 2.3, 3.9 - L.max()),
            "joint_angle_margin": min(of_base, of_platform),
            "singular_margin": sigma[5],
            "condition_number": sigma[0] / sigma[5],
            "payload": ((75.0 - np.sign(f1) * f0) / np.abs(f1)).min() if holds else 0.0,
            "force_margin": ((75.0 - np.abs(f0)) / np.linalg.norm(A, axis=1)).min() if holds else 0.0,
            "largest_speed": 0.8 / np.linalg.norm(scaled, axis=1).max(),
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


def test_a_sweep_over_an_uneven_platform_says_what_it_did() -> None:
    """Expected: the grid's poses by hand, what was found and assumed, defaults of what is fixed; progress."""
    done: list[int] = []
    w = sweep(UNEVEN, {"roll": (-0.1, 0.3), "y": (0.2, 0.4)}, {"z": 3}, points=3, progress=done.append)
    assert done == [9]
    assert list(w.swept) == ["roll", "y"]
    assert w.swept["roll"] == pytest.approx([-0.1, 0.1, 0.3])
    assert w.swept["y"] == pytest.approx([0.2, 0.3, 0.4])
    assert w.fixed == {"x": 0.08, "z": 3.0, "pitch": -0.07, "yaw": 0.11}
    assert (w.found, w.assumed) == ((), ())
    assert w.coordinates()[2, 0] == pytest.approx([0.08, 0.2, 3.0, 0.3, -0.07, 0.11])
    assert w.coordinates()[0, 2] == pytest.approx([0.08, 0.4, 3.0, -0.1, -0.07, 0.11])
    for (i, j), number in np.ndenumerate(w.qualities.condition_number):
        pose = w.coordinates()[i, j]
        assert number == pytest.approx(float(conditioning(UNEVEN, pose[:3], pose[3:]).condition_number), rel=1e-12)
    half = replace(UNEVEN, leg_length_max=None)
    w = sweep(half, {"x": None, "yaw": None, "pitch": (-0.1, 0.1)}, points=2)
    assert (w.found, w.assumed, w.shape) == (("yaw",), ("x",), (2, 2, 2))
    rho = UNEVEN.characteristic_length
    assert w.swept["x"] == pytest.approx([0.08 - rho, 0.08 + rho])
    assert tuple(sweep(UNEVEN, points=2).swept) == ("x", "y")
    free = sweep(replace(half, joint_angle_max=None), points=2)
    assert tuple(free.swept) == free.assumed == ("roll", "pitch")
    assert free.swept["roll"] == pytest.approx([0.04 - np.pi / 2, 0.04 + np.pi / 2])
    assert free.swept["pitch"] == pytest.approx([-np.pi / 2, -0.07 + np.pi / 2])
    assert POINTS == {2: 101, 3: 31}


# Platform, coordinates whose ranges are looked for, given ranges, fixed values.
RANGES: list[tuple[Platform, tuple[str, ...], dict[str, Any], dict[str, float]]] = [
    (UNEVEN, ("x", "y"), {}, {}),
    (UNEVEN, ("z", "pitch"), {}, {"x": 0.4, "yaw": -0.2}),
    (UNEVEN, ("yaw",), {"x": (-0.2, 0.5)}, {"z": 3.1}),
    (UNEVEN, ("y", "roll"), {"z": (2.7, 3.2)}, {}),
    (replace(UNEVEN, joint_angle_max=0.05), ("x", "roll"), {}, {}),
    (replace(UNEVEN, joint_angle_max=None, leg_length_max=8.0), ("y", "z"), {}, {}),
    (replace(UNEVEN, joint_angle_max=None, leg_length_min=None), ("x", "yaw"), {}, {"z": 3.4}),
    (replace(DESKTOP, joint_angle_max=0.02), ("z", "x", "pitch"), {}, {}),
    # regions on either side of home, which cannot be reached
    (replace(UNEVEN, joint_angle_max=0.25), ("x", "roll"), {}, {"pitch": 0.23, "z": 2.85}),
    (replace(UNEVEN, joint_angle_max=0.25), ("x", "roll"), {}, {"pitch": -0.37, "z": 2.85}),
]


@pytest.mark.parametrize(("platform", "looked_for", "given", "fixed"), RANGES)
def test_a_range_is_that_of_what_can_be_reached_rounded_outward(
    platform: Platform, looked_for: tuple[str, ...], given: dict[str, Any], fixed: dict[str, float]
) -> None:
    """Expected: the extent by bisection along random rays and by a random search; a margin of a tenth on either side.

    Ends are multiples of 1, 2 or 5 times a power of ten, of degrees for angles; a range that is nearly symmetric about
    home is made so.
    """
    over = {**dict.fromkeys(looked_for), **given}
    w = sweep(platform, over, fixed, points=2)
    names = list(COORDINATES)
    home = dict(zip(names, [*platform.home_position, *platform.home_orientation], strict=True)) | fixed
    assert w.found == looked_for
    rng = np.random.default_rng(5)
    # poses that can be reached, found by spreading from home along all that is swept
    poses = np.array([[home[name] for name in names]])
    axes = [names.index(name) for name in over]
    low, high = (np.array([w.swept[name][k] for name in over]) for k in (0, -1))
    wide_low, wide_high = 1.6 * low - 0.6 * high, 1.6 * high - 0.6 * low
    for name, (a, b) in given.items():
        k = list(over).index(name)
        wide_low[k], wide_high[k] = a, b
        assert (low[k], high[k]) == (a, b)
    # home is not always among them
    poses = np.repeat(poses, 6000, axis=0)
    poses[1:, axes] = rng.uniform(wide_low, wide_high, (5999, len(axes)))
    for name, (a, b) in given.items():
        poses[:, names.index(name)] = rng.uniform(a, b, 6000)
    poses = poses[limits_at(platform, poses[:, :3], poses[:, 3:]) == Limit.NONE]
    for size in (0.5, 0.3, 0.1, 0.05, 0.05, 0.03, 0.02, 0.02, 0.01, 0.01):
        # the outermost so far, and some others, are moved on
        outer = [f(poses[:, axis]) for axis in axes for f in (np.argmin, np.argmax)]
        some = poses[np.concatenate([np.tile(outer, 60), rng.integers(0, len(poses), 1200)])]
        some[:, axes] += size * (wide_high - wide_low) * rng.normal(size=(len(some), len(axes)))
        some[:, axes] = np.clip(some[:, axes], wide_low, wide_high)
        poses = np.concatenate([poses, some[limits_at(platform, some[:, :3], some[:, 3:]) == Limit.NONE]])
    for name, a, b in zip(over, low, high, strict=True):
        if name in given:
            continue
        values = poses[:, names.index(name)]
        first, last = float(values.min()), float(values.max())
        size, unit = last - first, np.pi / 180 if COORDINATES[name] == "rad" else 1.0
        is_whole_turn = np.isclose([a, b], [-np.pi, np.pi]).any() and name == "yaw"
        assert a <= first, name
        assert last <= b, name
        below, above = home[name] - first, last - home[name]
        ratio = min(below, above) / max(below, above)
        if 0.65 < ratio < 0.85:  # with its margins it is perhaps nearly symmetric
            continue
        if ratio >= 0.85 and not is_whole_turn:
            assert home[name] - a == pytest.approx(b - home[name], abs=0.06 * size), name
            first, last = home[name] - max(below, above), home[name] + max(below, above)
        assert first - a < 0.16 * size, (name, first, a)
        assert b - last < 0.16 * size, (name, last, b)
        steps = [k * 10.0**e * unit for e in range(-7, 3) for k in (1, 2, 5)]
        step = max(each for each in steps if each <= (b - a) / 25)
        finer = [each for each in steps if each <= step * 1.001][-3:]
        box = _box(platform, name, looked_for, fixed)
        ends = [end for end, of_box in zip((a, b), box, strict=True) if end != pytest.approx(of_box, abs=1e-9)]
        is_rounded = [all(end / each == pytest.approx(round(end / each), abs=1e-6) for end in ends) for each in finer]
        assert any(is_rounded), (name, a, b, step)


def _box(platform: Platform, name: str, looked_for: tuple[str, ...], fixed: dict[str, float]) -> tuple[float, float]:
    """Where no leg is longer than allowed from its base joint, whatever the other coordinates; half turns."""
    if COORDINATES[name] == "rad":
        return (-np.pi / 2, np.pi / 2) if name == "pitch" else (-np.pi, np.pi)
    assert platform.leg_length_max is not None
    angles = [
        fixed.get(angle, home) for angle, home in zip(("roll", "pitch", "yaw"), platform.home_orientation, strict=True)
    ]
    arm = Rotation.from_euler("xyz", angles).apply(platform.platform_points.copy())
    reach = np.full(6, platform.leg_length_max)
    if {"roll", "pitch", "yaw"} & set(looked_for):
        arm, reach = np.zeros((6, 3)), reach + np.linalg.norm(platform.platform_points, axis=1)
    centre = (platform.base_points - arm)[:, "xyz".index(name)]
    return float((centre - reach).max()), float((centre + reach).min())


def test_errors_of_a_grid_are_whole_sentences() -> None:
    """Expected: name, value in its unit and in degrees, range; bounds of angles from both sides."""
    x_and = {"x": (0.0, 0.1)}
    for asked, text in (
        ({"over": {"x": None, "q": None}}, "unknown coordinate 'q'; expected one of x, y, z, roll, pitch, yaw"),
        (
            {"over": {**x_and, "yaw": (-1.0, 3.2)}},
            "yaw is 3.2 rad, 183.346°; expected from −180° to 180°; numbers w",
        ),
        ({"over": {**x_and, "roll": (0.5, 0.5)}}, "roll goes from 0.5 rad to 0.5 rad; expected a range from low to hi"),
        ({"over": {**x_and, "pitch": (-1.6, 0.0)}}, "pitch is -1.6 rad, -91.6732°; expected from −90° to 90°; numbers"),
        ({"over": x_and}, "1 swept coordinates; expected two for maps, or three for a volume"),
        ({"over": {**x_and, "y": None}, "at": {"y": 0.1}}, "y is both swept and fixed; expected one of them: leave it"),
        ({"over": {**x_and, "y": (np.nan, 1.0)}}, "y is nan; expected a finite number of m"),
        ({"over": {**x_and, "z": (0.0, np.inf)}}, "z is inf; expected a finite number of m"),
        ({"over": {**x_and, "roll": (-np.inf, 0.0)}}, "roll is -inf; expected a finite number of rad"),
        ({"over": {"x": (0.3, 0.1), "z": None}}, "x goes from 0.3 m to 0.1 m; expected a range from low to high"),
        (
            {"points": 501},
            "501 points per coordinate, in all 251,001 poses, for 2 swept coordinates; expected",
        ),
        (
            {"over": dict.fromkeys("xyz"), "points": 1},
            "1 points per coordinate for 3 swept coordinates; expected",
        ),
    ):
        with pytest.raises(WorkspaceError, match=f"^{re.escape(text)}"):
            sweep(UNEVEN, **asked)
    for name, largest in (("roll", np.pi), ("pitch", np.pi / 2), ("yaw", np.pi)):
        for sign in (1, -1):
            sweep(UNEVEN, {"x": (0.0, 0.1), "y": (0.0, 0.1)}, {name: sign * largest}, points=2)
            with pytest.raises(WorkspaceError, match=f"^{name} is "):
                sweep(UNEVEN, {"x": (0.0, 0.1), "y": (0.0, 0.1)}, {name: sign * (largest + 1e-9)}, points=2)


def test_where_nothing_can_be_reached_given_ranges_stay_and_others_are_the_box() -> None:
    """Expected: of the box of the legs, by hand, the next multiples; about home by a radius where there is no box."""
    fixed = {"z": 5.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}
    found = default_ranges(MOTION_BASE, {"x": None, "y": (0.123, 0.456)}, fixed)
    assert found["y"] == (0.123, 0.456)
    low, high = _box(MOTION_BASE, "x", ("x",), fixed)
    assert 0 <= low - found["x"][0] < (high - low) / 10
    assert 0 <= found["x"][1] - high < (high - low) / 10
    parts: tuple[str, ...] = (
        "platform_mass",
        "platform_inertia",
        "leg_lower_mass",
        "leg_upper_mass",
        "leg_lower_com",
        "leg_upper_com",
    )
    parts += ("leg_lower_inertia", "leg_upper_inertia")
    others = {name: getattr(PAPER, name) for name in parts}
    flat = Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=1.5, leg_length_max=1.6, **others)
    turned = default_ranges(flat, {"x": None, "y": None}, {"z": 0.8, "roll": 0.0, "pitch": 0.0, "yaw": np.pi})
    assert turned == {"x": (-1.0, 1.0), "y": (-1.0, 1.0)}

"""What a motion uses of each limit of its platform, what it needs, and where it is refused, against plain geometry."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.harness.motion.forces import actuator_forces
from tests.support.arrays import FloatArray
from tests.support.lagrangian import Pose, legs_along
from tests.support.motions import experiment, motion_of
from tests.support.uneven import UNEVEN

PAPER = gs.load_preset("liu2000")
# velocity and power have tests of their own
DESKTOP = replace(gs.load_preset("desktop_hexapod"), leg_velocity_max=None, actuator_power_max=None)
FREE = replace(DESKTOP, leg_length_min=None, leg_length_max=None, joint_angle_max=None)
LENGTH, PITCH, NUMBER = "the length", "the pitch", "the condition number of the leg Jacobian"
BASE_JOINT, PLATFORM_JOINT = "the angle of the base joint", "the angle of the platform joint"
SIDE = "the side of the singular poses (sign of det J against home)"
# Six equal legs without mass, and rotors of 9 kg.
LIGHT = replace(
    PAPER, leg_armature=9.0, leg_lower_mass=1e-12, leg_upper_mass=1e-12, leg_lower_inertia=0, leg_upper_inertia=0
)
HEAVE = {"type": "sine", "position_amplitude": [0, 0, 0.2], "frequency": 1.0, "orientation": [0, 0, 0]}
FINE: Any = {"loop": {"duration": 1.0, "sample_time": 0.005}}


class Heave:
    """A heave of 0.2 m at 1 Hz, and what it asks of each of six equal legs, by Pythagoras and Newton."""

    time = 0.005 * np.arange(201)
    z = PAPER.home_position[2] + 0.2 * np.sin(2 * np.pi * time)
    rate = 0.2 * 2 * np.pi * np.cos(2 * np.pi * time)
    acceleration = -0.2 * (2 * np.pi) ** 2 * np.sin(2 * np.pi * time)
    length = np.hypot(z, np.linalg.norm(PAPER.base_points[0] - PAPER.platform_points[0]))
    velocity = z * rate / length
    second = (rate**2 + z * acceleration - velocity**2) / length
    # a sixth of the weight and inertia of 10 kg, along an inclined leg, and the rotor
    force = 10 * (acceleration + 9.81) * length / z / 6 + 9 * second


ASKED = {
    "leg_velocity_max": ("the velocity", "m/s", Heave.velocity),
    "leg_acceleration_max": ("the acceleration", "m/s²", Heave.second),
    "actuator_force_max": ("the force", "N", Heave.force),
    "actuator_power_max": ("the power", "W", Heave.force * Heave.velocity),
}


def refused(tried: gs.Experiment) -> Any:
    """The error of a run, with its data."""
    with pytest.raises(gs.GoughStewartError, match="the reference cannot be reached: at time") as caught:
        gs.run(tried)
    return caught.value


def test_a_heave_uses_what_its_closed_form_says() -> None:
    """Expected: of each limit the closed form over it; of the stroke the distance from its middle over half of it."""
    low, high = 0.9 * Heave.length.min(), 1.05 * Heave.length.max()
    stated = dict(zip(ASKED, (2.0, 11.0, 150.0, 130.0), strict=True))
    platform = LIGHT.with_parameters({**stated, "leg_length_min": low, "leg_length_max": high})
    found = gs.check(experiment(platform, HEAVE, **FINE))
    expected = {name: np.abs(values) / stated[name] for name, (_, _, values) in ASKED.items()}
    expected |= {"stroke": np.abs(2 * Heave.length - low - high) / (high - low)}
    assert set(found.shares.of) - set(expected) == {"pitch", "side", "condition_number"}
    for name, share in expected.items():
        np.testing.assert_allclose(found.shares.of[name], np.tile(share[:, None], 6), rtol=1e-9, atol=1e-12)
        assert found.shares.peak(name).share == pytest.approx(share.max())
    largest = max(expected, key=lambda name: expected[name].max())
    assert found.shares.largest.limit == largest
    assert found.shares.largest.time == pytest.approx(Heave.time[expected[largest].argmax()])
    assert found.shares.total == pytest.approx(np.max(list(expected.values()), axis=0))
    for end, share in (({"leg_length_min": low}, low / Heave.length), ({"leg_length_max": high}, Heave.length / high)):
        one = gs.check(experiment(LIGHT.with_parameters(end), HEAVE, **FINE)).shares.of["stroke"]
        np.testing.assert_allclose(one, np.tile(share[:, None], 6))


@pytest.mark.parametrize("limit", ASKED)
def test_a_leg_that_would_need_too_much_is_refused_with_what_would_fit(limit: str) -> None:
    """Expected: the first time at which the closed form is beyond its limit; just above its largest value nothing."""
    quantity, unit, values = ASKED[limit]
    most = float(np.abs(values).max())
    assert gs.check(experiment(LIGHT.with_parameters({limit: 1.001 * most}), HEAVE, **FINE)).within
    error = refused(experiment(LIGHT.with_parameters({limit: 0.6 * most}), HEAVE, **FINE))
    row = int((np.abs(values) > 0.6 * most).argmax())
    assert (error.quantity, error.time) == (quantity, pytest.approx(Heave.time[row]))
    assert error.value == pytest.approx(values[row], rel=1e-9)
    allowed = f"{-0.6 * most:g} to {0.6 * most:g} {unit}"
    assert f"{quantity} of leg {error.leg} is {error.value:.6g} {unit}; expected {allowed}; " in str(error)
    ways = str(error).partition("it would fit if it were ")[2]
    assert ways.endswith(" times as large (reference.amplitude_scale)")
    if limit == "leg_velocity_max":
        assert ways.startswith("1.67 times as long (reference.time_scale) or ")  # 1/0.6, to the safe side
    if limit == "leg_acceleration_max":
        assert ways.startswith("1.3 times as long")  # √(1/0.6)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), vars(again)) == (str(error), vars(error))


def test_limits_of_motion_may_be_passed_with_a_warning_and_those_of_poses_not() -> None:
    """Expected: a weight that the legs cannot hold is helped by nothing; a leg too long is refused all the same."""
    static = 10 * 9.81 / 6 * Heave.length[0] / Heave.z[0]
    text = str(refused(experiment(replace(LIGHT, actuator_force_max=10.0), HEAVE, **FINE)))
    assert "neither slower nor smaller helps" in text
    assert f"actuator force max is already at {100 * static / 10:.4g} %" in text
    slow = replace(LIGHT, leg_velocity_max=0.1)
    assert refused(experiment(slow, HEAVE, **FINE)).quantity == "the velocity"
    short = replace(slow, leg_length_max=float(Heave.length.max()) * 0.999)
    assert refused(experiment(short, HEAVE, limits={"reference": "warn"}, **FINE)).quantity == LENGTH


def legs_at(platform: gs.Platform, position: Any, orientation: Any) -> tuple[FloatArray, FloatArray]:
    """Leg vectors (6, 3) and the rotation matrix, leg by leg with SciPy's rotation."""
    turn = Rotation.from_euler("xyz", orientation).as_matrix()
    points = zip(platform.platform_points, platform.base_points, strict=True)
    return np.array([position + turn @ p - b for p, b in points]), turn


def joint_angles(platform: gs.Platform, position: Any, orientation: Any) -> tuple[FloatArray, ...]:
    """Angles (6,) from home at base and platform, by arc cosines of directions in world and in platform axes."""
    seen = []
    for pose in ((position, orientation), (platform.home_position, platform.home_orientation)):
        legs, turn = legs_at(platform, *pose)
        u = legs / np.linalg.norm(legs, axis=1)[:, None]
        seen.append((u, u @ turn))
    return tuple(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)) for a, b in zip(*seen, strict=True))


def offences(platform: gs.Platform, position: FloatArray, orientation: FloatArray) -> set[tuple[str, int | None]]:
    """All quantities, with their legs, that are beyond their limit at one pose."""

    def jacobian(*pose: Any) -> FloatArray:
        legs, turn = legs_at(platform, *pose)
        u = legs / np.linalg.norm(legs, axis=1)[:, None]
        return np.hstack([u, np.cross(platform.platform_points @ turn.T, u)])

    lengths = np.linalg.norm(legs_at(platform, position, orientation)[0], axis=1)
    J, at_home = jacobian(position, orientation), jacobian(platform.home_position, platform.home_orientation)
    rho = np.sqrt((platform.platform_points**2).sum(axis=1).mean())
    found: set[tuple[str, int | None]] = set()
    if abs(orientation[1]) >= np.pi / 2 - 1e-3:
        found.add((PITCH, None))
    if np.linalg.cond(J / [1, 1, 1, rho, rho, rho]) > 100:
        found.add((NUMBER, None))
    if np.linalg.det(J) * np.linalg.det(at_home) <= 0:
        found.add((SIDE, None))
    low, high, largest = platform.leg_length_min or 0.0, platform.leg_length_max or np.inf, platform.joint_angle_max
    found |= {(LENGTH, k + 1) for k in np.flatnonzero((lengths < low) | (lengths > high)).tolist()}
    for name, values in zip((BASE_JOINT, PLATFORM_JOINT), joint_angles(platform, position, orientation), strict=True):
        beyond = values > (np.inf if largest is None else largest)
        found |= {(name, k + 1) for k in np.flatnonzero(beyond).tolist()}
    return found


def test_the_share_of_a_joints_limit_is_that_of_the_larger_angle_of_its_leg() -> None:
    """Expected: at each row the larger arc cosine of a leg's two joints, in some that of the base, else the other."""
    swing: dict[str, Any] = {"type": "sine", "frequency": 0.6, "phase": 0.4}
    swing |= {"position_amplitude": [0.01, 0.012, 0.0], "orientation_amplitude": [-0.05, 0.04, 0.06]}
    found = gs.check(experiment(DESKTOP, swing, loop={"duration": 0.5, "sample_time": 0.05})).shares.of
    motion = motion_of(DESKTOP, **swing)(0.05 * np.arange(11))
    angles = np.array([joint_angles(DESKTOP, *pose) for pose in zip(*motion[:2], strict=True)])
    assert DESKTOP.joint_angle_max is not None
    assert 10 < (angles[:, 0] > 1.1 * angles[:, 1]).sum() < 56
    assert found["joint_angle_max"] == pytest.approx(angles.max(axis=1) / DESKTOP.joint_angle_max, rel=1e-6)


LEFT_OUT: dict[str, dict[str, Any]] = {
    "nothing": {},
    "joints": {"joint_angle_max": None},
    "stroke": {"leg_length_min": None, "leg_length_max": None},
    "both": {"joint_angle_max": None, "leg_length_min": None, "leg_length_max": None},
}
amplitudes = st.tuples(*[st.floats(-1, 1)] * 6).map(np.array)


@given(amplitudes, st.floats(0.01, 3), st.floats(-3, 3), st.sampled_from(sorted(LEFT_OUT)))
def test_the_first_offence_is_that_of_an_independent_loop(
    amplitude: FloatArray, size: float, phase: float, limits: str
) -> None:
    """Expected: time after time, leg after leg, with SciPy's rotations, arc cosines and NumPy's cond and det."""
    platform = replace(DESKTOP, **LEFT_OUT[limits])
    along = {"position_amplitude": 0.1 * size * amplitude[:3], "orientation_amplitude": size * amplitude[3:]}
    swing = {"type": "sine", **{name: part.tolist() for name, part in along.items()}, "frequency": 0.6, "phase": phase}
    tried = experiment(platform, swing, loop={"duration": 0.96, "sample_time": 0.08}, limits={"reference": "warn"})
    times = 0.08 * np.arange(13)
    motion = motion_of(platform, **swing)(times)
    every = ((t, offences(platform, *pose)) for t, *pose in zip(times, *motion[:2], strict=True))
    expected = next(((t, found) for t, found in every if found), None)
    if expected is None:
        shares = gs.check(tried).shares.of
        assert all(shares[name].max() <= 1 for name in ("pitch", "side", "condition_number"))
        assert all(shares[name].max() <= 1 for name in ("stroke", "joint_angle_max") if name in shares)
        return
    error = refused(tried)
    assert error.time == pytest.approx(expected[0], abs=1e-12)
    assert (error.quantity, error.leg) in expected[1]
    # of the legs beyond the same limit, the first
    same = [leg for quantity, leg in expected[1] if quantity == error.quantity]
    assert error.leg is None or error.leg == min(leg for leg in same if leg)


@pytest.mark.parametrize("by", [0.04, -0.04])
def test_a_leg_that_leaves_its_stroke_is_named_with_time_and_length(by: float) -> None:
    """Expected: lifted by dz, lengths √(horizontal² + height²); how far it may be lifted by the same triangle."""
    lift: dict[str, Any] = {"type": "point_to_point", "position_change": [0, 0, by], "at": 0.2, "duration": 0.5}
    limit = DESKTOP.leg_length_max if by > 0 else DESKTOP.leg_length_min
    assert limit is not None
    z = motion_of(DESKTOP, **lift)(0.01 * np.arange(101)).position[:, 2]
    flat = (((DESKTOP.platform_points - DESKTOP.base_points)[:, :2]) ** 2).sum(axis=1)
    lengths = np.sqrt(flat + z[:, None] ** 2)
    row = int((lengths > limit if by > 0 else lengths < limit).any(axis=1).argmax())
    error = refused(experiment(DESKTOP, lift))
    assert (error.time, error.quantity) == (pytest.approx(0.01 * row), LENGTH)
    assert error.value == pytest.approx(lengths[row, error.leg - 1], rel=1e-14)
    share = float((np.abs(np.sqrt(limit**2 - flat) - DESKTOP.home_position[2]) / 0.04).min())
    assert str(error).endswith(
        f"at time {0.01 * row:.6g} s the length of leg {error.leg} is {error.value:.6g} m; expected 0.145 to 0.195 m; "
        f"it would fit if it were {np.floor(1000 * share) / 1000:g} times as large (reference.amplitude_scale)"
    )
    # with the other limit alone it is reached
    other = {"leg_length_min": DESKTOP.leg_length_min} if by > 0 else {"leg_length_max": DESKTOP.leg_length_max}
    assert gs.check(experiment(FREE.with_parameters(other), lift)).within


CORNERS = [np.round(64 * points) / 64 for points in (PAPER.base_points, PAPER.platform_points)]
POSES: dict[str, tuple[gs.Platform, Any, Any, str, str]] = {
    "near Fichter's singular pose": (PAPER, None, [0, 0, np.radians(89.9)], NUMBER, "expected 1 to 100; "),
    "beyond it, with a good condition number": (PAPER, None, [0, 0, np.radians(130)], SIDE, "is -1; expected 1; "),
    "in it, where power is not defined": (
        replace(PAPER, actuator_power_max=1.0), None, [0, 0, np.pi / 2], NUMBER, "expected 1 to 100; "
    ),
    # multiples of 1/64 m, whose sums have no rounding
    "a leg of no length": (
        replace(PAPER, base_points=CORNERS[0], platform_points=CORNERS[1]), CORNERS[0][0] - CORNERS[1][0], [0, 0, 0],
        NUMBER, "is inf; ",
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", POSES)
def test_poses_that_the_legs_cannot_hold_are_refused(what: str) -> None:
    platform, position, orientation, quantity, text = POSES[what]
    place = platform.home_position if position is None else position
    hold = {"type": "hold", "position": place.tolist(), "orientation": orientation}
    error = refused(experiment(platform, hold))
    assert (error.quantity, error.leg) == (quantity, None)
    assert text in str(error)


def test_how_near_to_a_singular_pose_is_the_experiments_choice() -> None:
    """Expected: at 89.9° of yaw, beyond the default of 100; up to 1.5697 rad of pitch, as the plant has it."""
    hold: dict[str, Any] = {"type": "hold", "orientation": [0, 0, np.radians(89.9)]}
    assert gs.check(experiment(PAPER, hold, limits={"condition_number": 1e4})).within
    shares = [gs.check(experiment(FREE, {"type": "hold", "orientation": [0, pitch, 0]})).shares.of["pitch"][0]
              for pitch in (1.5697, -1.5697, 1.56985, -1.56985)]  # fmt: skip
    assert max(shares[:2]) < 1 < min(shares[2:])


def test_small_joint_angles_keep_their_digits() -> None:
    """Expected: lifted by dz, a leg at horizontal distance d and length L turns by dz d/L², alike at both ends."""
    lift = {"type": "point_to_point", "position_change": [0, 0, 1e-9], "duration": 0.5}
    needs = gs.check(experiment(PAPER, lift)).needs
    flat = np.linalg.norm((PAPER.platform_points - PAPER.base_points)[:, :2], axis=1)
    expected = 1e-9 * flat / (flat**2 + PAPER.home_position[2] ** 2)
    for end in ("base", "platform"):
        assert needs[f"{end}_joint_angle_peak"] == pytest.approx(expected, rel=1e-6)


def test_energies_of_each_sign_are_exact_where_power_is_linear_between_rows() -> None:
    """Expected: of a Lagrangian's forces at rows 0.1 s apart, interpolated finely: crossings are within the rows."""
    along = np.array([0.1, -0.16, 0.2, 0.05, -0.08, 0.07])
    sway = {"type": "sine", "position_amplitude": along[:3].tolist(), "orientation_amplitude": along[3:].tolist()}
    sway |= {"frequency": 1.1, "phase": 0.3}
    needs = gs.check(experiment(UNEVEN, sway, loop={"duration": 0.4, "sample_time": 0.1})).needs
    time, w = 0.1 * np.arange(5), 2 * np.pi * 1.1
    turn = w * time + 0.3
    home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
    waves = (np.sin(turn), w * np.cos(turn), -(w**2) * np.sin(turn))
    q, rate, acceleration = (np.outer(wave, along) for wave in waves)
    pose = Pose(home + q, rate, acceleration)
    velocity = legs_along(UNEVEN, pose)[1]
    power = actuator_forces(UNEVEN, pose, velocity) * velocity
    assert (power[:-1] * power[1:] < 0).any()
    fine = np.linspace(0, 0.4, 200_001)
    for sign, name in ((1, "motoring_energy"), (-1, "regenerated_energy")):
        parts = [np.maximum(sign * np.interp(fine, time, power[:, leg]), 0) for leg in range(6)]
        assert needs[name] == pytest.approx([np.trapezoid(part, fine) for part in parts], rel=1e-6, abs=1e-6)


def test_needs_say_what_they_leave_out() -> None:
    """Expected: a jump and its time; friction or armature that the platform lacks; no forces in a singular pose."""
    first, *others = gs.check(experiment(UNEVEN, {"type": "hold"})).needs.notes
    assert "without external forces" in first
    assert others == []
    step = {"type": "step", "position_change": [0, 0, 0.05], "at": 0.505}
    assert "the reference jumps at 0.51 s" in "; ".join(gs.check(experiment(UNEVEN, step)).needs.notes)
    bare: dict[str, Any] = {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0}
    for change, says in (
        ({"leg_viscous_friction": 0.0}, None),
        (bare, "the platform states no friction, so"),
        ({"leg_armature": 0.0}, "the platform states no inertia of motors and screws (leg_armature), so"),
        ({**bare, "leg_armature": 0.0}, "the platform states no friction and no inertia of motors and screws (leg_"),
    ):
        _, *notes = gs.check(experiment(replace(UNEVEN, **change), {"type": "hold"})).needs.notes
        assert len(notes) == (says is not None)
        assert says is None or notes[0].startswith(says)
    singular = gs.check(experiment(PAPER, {"type": "hold", "orientation": [0, 0, np.pi / 2]})).needs
    assert np.isnan(singular["actuator_force_peak"]).all()
    assert np.isnan(singular["motoring_energy"]).all()
    assert np.isfinite([singular["leg_length_max"], singular["leg_velocity_rms"]]).all()

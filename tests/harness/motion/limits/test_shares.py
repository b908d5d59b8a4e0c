"""Shares of limits against closed forms, finite differences and invariants; scaled motions and what fits."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart import Platform, Sine, load_preset
from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.limits.fitting import factor_that_fits, shrinking_that_fits, slowing_that_fits
from gough_stewart.harness.motion.limits.reach import check_reach, legs_of
from gough_stewart.harness.motion.limits.shares import WORST_CONDITION_NUMBER, Shares, shares_along
from gough_stewart.harness.motion.motion import Motion, Scaled, slower, smaller
from tests.support.arrays import FloatArray
from tests.support.random_platforms import random_platform

TIMES = np.linspace(0, 1, 201)
PAPER = load_preset("liu2000")
DESKTOP = load_preset("desktop_hexapod")
seeds = st.integers(0, 2**32 - 1)
# Six equal legs without mass, and rotors of 9 kg.
LIGHT = replace(
    PAPER, leg_armature=9.0, leg_lower_mass=1e-12, leg_upper_mass=1e-12, leg_lower_inertia=0, leg_upper_inertia=0
)
UP = np.array([0.0, 0.0, 1.0])


class Heave:
    """A heave of 0.2 m at 1 Hz, and what it asks of each of six equal legs, by hand."""

    z = PAPER.home_position[2] + 0.2 * np.sin(2 * np.pi * TIMES)
    rate = 0.2 * 2 * np.pi * np.cos(2 * np.pi * TIMES)
    acceleration = -0.2 * (2 * np.pi) ** 2 * np.sin(2 * np.pi * TIMES)
    length = np.hypot(z, np.linalg.norm(PAPER.base_points[0] - PAPER.platform_points[0]))
    velocity = z * rate / length
    second = (rate**2 + z * acceleration - velocity**2) / length
    # a sixth of the weight and inertia of 10 kg, along an inclined leg, and the rotor
    force = 10 * (acceleration + 9.81) * length / z / 6 + 9 * second
    none = np.zeros((len(TIMES), 3))
    motion = Motion(np.outer(z, UP), none, np.outer(rate, UP), none, np.outer(acceleration, UP), none)


def swing(platform: Platform, rng: np.random.Generator, size: float = 0.1) -> Sine:
    """A motion of all six coordinates about home."""
    return Sine(
        position=platform.home_position,
        orientation=platform.home_orientation,
        position_amplitude=size * platform.characteristic_length * rng.uniform(0.2, 1, 3),
        orientation_amplitude=size * rng.uniform(-1, 1, 3),
        frequency=rng.uniform(0.4, 1.2),
        phase=rng.uniform(-3, 3),
    )


def limited(platform: Platform, **limits: float) -> Platform:
    """With these dynamic limits, and no others."""
    names = ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max", "joint_angle_max")
    none: dict[str, Any] = dict.fromkeys((*names, "leg_length_min", "leg_length_max"))
    return replace(platform, **{**none, **limits})


def test_a_heave_uses_what_its_closed_form_says() -> None:
    """Expected: Pythagoras for the legs, Newton for a sixth of the mass and for the rotor."""
    platform = limited(
        LIGHT, leg_velocity_max=2.0, leg_acceleration_max=11.0, actuator_force_max=150.0, actuator_power_max=130.0
    )
    shares = shares_along(platform, TIMES, Heave.motion)
    expected = {
        "leg_velocity_max": np.abs(Heave.velocity) / 2,
        "leg_acceleration_max": np.abs(Heave.second) / 11,
        "actuator_force_max": np.abs(Heave.force) / 150,
        "actuator_power_max": np.abs(Heave.force * Heave.velocity) / 130,
    }
    for name, share in expected.items():
        assert shares.of[name].shape == (len(TIMES), 6)
        assert np.allclose(shares.of[name], share[:, None], rtol=1e-9, atol=1e-12), name
        assert shares.peak(name).share == pytest.approx(share.max())
    largest = max(expected, key=lambda name: expected[name].max())
    assert shares.largest.limit == largest
    assert shares.largest.time == pytest.approx(TIMES[expected[largest].argmax()])
    assert {"pitch", "side", "condition_number"} == set(shares.of) - set(expected)


def test_at_rest_only_the_static_force_is_used() -> None:
    """Expected: a sixth of the weight over the cosine of the leg's inclination, L/z."""
    rest = Motion(*(part[:1] for part in (Heave.motion.position, *[Heave.none] * 5)))
    platform = limited(LIGHT, leg_velocity_max=1.0, leg_acceleration_max=1.0, actuator_force_max=40.0)
    shares = shares_along(platform, TIMES[:1], rest)
    assert not np.any(shares.of["leg_velocity_max"])
    assert not np.any(shares.of["leg_acceleration_max"])
    static = 10 * 9.81 / 6 * Heave.length[0] / Heave.z[0]
    assert np.allclose(shares.of["actuator_force_max"], static / 40)


def test_of_the_stroke_nothing_is_used_in_its_middle_and_all_at_its_ends() -> None:
    """Expected: |L − middle| over half the stroke; with one end alone, the ratio of length and end."""
    motion = Heave.motion
    length = legs_of(PAPER, motion).leg_length
    low, high = 0.9 * length.min(), 1.05 * length.max()
    both = shares_along(replace(PAPER, leg_length_min=low, leg_length_max=high), TIMES, motion).of["stroke"]
    assert np.allclose(both, np.abs(2 * length - low - high) / (high - low))
    lower = shares_along(replace(PAPER, leg_length_min=low), TIMES, motion).of["stroke"]
    upper = shares_along(replace(PAPER, leg_length_max=high), TIMES, motion).of["stroke"]
    assert np.allclose(lower, low / length)
    assert np.allclose(upper, length / high)


@given(seeds)
def test_the_active_limit_and_the_peaks_are_those_of_a_plain_search(seed: int) -> None:
    """Expected: loops over times, limits and legs."""
    rng = np.random.default_rng(seed)
    platform = limited(
        random_platform(rng), leg_velocity_max=0.5, leg_acceleration_max=2.0, actuator_force_max=rng.uniform(1, 1e3)
    )
    times = TIMES[::20]
    shares = shares_along(platform, times, swing(platform, rng)(times))
    for row in range(len(times)):
        each = {name: float(np.max(share[row])) for name, share in shares.of.items()}
        assert shares.active[row] == max(each, key=lambda name: each[name])
        assert shares.total[row] == max(each.values())
    for name, share in shares.of.items():
        if share.ndim == 2:
            for leg in range(6):
                peak = shares.peak(name, leg + 1)
                row = times.tolist().index(peak.time)
                assert (peak.share, peak.leg) == (share[row, leg], leg + 1)
                assert all(share[k, leg] < peak.share for k in range(row))
                assert share[:, leg].max() == peak.share


def test_what_is_no_number_is_beyond_every_limit() -> None:
    motion = Motion(*(part.copy() for part in Heave.motion))
    motion.velocity[7, 2] = np.nan
    shares = shares_along(limited(PAPER, leg_velocity_max=1e6), TIMES, motion)
    assert not shares.within
    assert shares.largest.share == np.inf
    assert shares.largest.time == TIMES[7]


def frictionless(platform: Platform) -> Platform:
    return replace(platform, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)


@given(seeds, st.floats(0.3, 5))
def test_a_motion_k_times_slower_needs_velocities_and_inertial_forces_of_1_over_k_and_k_squared(
    seed: int, k: float
) -> None:
    """Expected: without friction F = static + inertial, of which only the second knows of the time."""
    rng = np.random.default_rng(seed)
    platform = frictionless(random_platform(rng))
    platform = limited(platform, leg_velocity_max=1.0, leg_acceleration_max=1.0, actuator_force_max=1.0)
    reference = swing(platform, rng)

    def signed(motion: Motion) -> dict[str, FloatArray]:
        return {each.limit: each.values for each in shares_along(platform, TIMES, motion).limited}

    once, later, rest = (signed(slower(reference(TIMES), s)) for s in (1.0, k, math.inf))
    assert np.allclose(later["leg_velocity_max"], once["leg_velocity_max"] / k)
    assert np.allclose(later["leg_acceleration_max"], once["leg_acceleration_max"] / k**2)
    static = rest["actuator_force_max"]
    inertial = once["actuator_force_max"] - static
    size = float(np.abs(once["actuator_force_max"]).max())
    assert np.allclose(later["actuator_force_max"], static + inertial / k**2, rtol=0, atol=1e-9 * size)


@given(seeds, st.floats(0.2, 4), st.floats(-1.5, 1.5))
def test_a_scaled_motion_is_that_of_scaled_frequency_and_amplitude(seed: int, slow: float, size: float) -> None:
    """Expected: the sine of a frequency over s and of amplitudes times a, with its own derivatives."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    reference = swing(platform, rng)
    other = reference.model_copy(
        update={
            "frequency": reference.frequency / slow,
            "position_amplitude": size * np.asarray(reference.position_amplitude),
            "orientation_amplitude": size * np.asarray(reference.orientation_amplitude),
        }
    )
    for found, expected in zip(Scaled(reference, slow, size)(TIMES), other(TIMES), strict=True):
        assert np.allclose(found, expected, rtol=1e-9, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_amplitudes_are_about_the_first_pose_where_a_motion_has_no_centre() -> None:
    """Expected: at 0 times its size a motion stays where it begins."""
    still = Scaled(Sine(**HOME, position_amplitude=UP, frequency=1.0, phase=0.7).__call__, 1.0, 0.0)(TIMES)
    assert np.allclose(still.position, PAPER.home_position + UP * math.sin(0.7))
    assert not np.any(still.velocity)


HOME: dict[str, Any] = {"position": PAPER.home_position, "orientation": PAPER.home_orientation}


def share_of(platform: Platform, motion: Motion) -> Shares:
    return shares_along(platform, TIMES, motion)


@given(
    seeds,
    st.sampled_from(["leg_velocity_max", "leg_acceleration_max", "actuator_force_max"]),
    st.floats(1.05, 4),
    st.booleans(),
)
def test_what_fits_uses_its_limit_and_not_more(seed: int, limit: str, over: float, is_smaller: bool) -> None:
    """Expected: of a motion beyond one limit, the slowed and the shrunk one use 100 % ± 1e-6, never more."""
    rng = np.random.default_rng(seed)
    platform = limited(random_platform(rng))
    reference = swing(platform, rng)
    motion, centre = reference(TIMES), np.concatenate([platform.home_position, platform.home_orientation])
    most = share_of(limited(platform, **{limit: 1.0}), motion).peak(limit).share
    bound = most / over
    if limit == "actuator_force_max":
        rest = share_of(limited(platform, **{limit: 1.0}), slower(motion, math.inf)).peak(limit).share
        bound = rest + (most - rest) / over
        if not bound < 0.999 * most:
            return  # a motion that is lighter on its legs than standing still
    platform = limited(platform, **{limit: bound})
    if is_smaller:
        small = shrinking_that_fits(platform, motion, centre, WORST_CONDITION_NUMBER)
        assert small is not None
        assert 0 < small < 1
        used = share_of(platform, smaller(motion, small, centre))
        assert used.within
        assert used.total.max() == pytest.approx(1, abs=1e-6)
        return
    slow = slowing_that_fits(platform, motion, WORST_CONDITION_NUMBER)
    assert slow is not None
    used = share_of(platform, slower(motion, slow))
    assert used.within
    assert used.total.max() == pytest.approx(1, abs=1e-6)
    if limit == "leg_velocity_max":
        assert slow == pytest.approx(over, rel=1e-6)
    if limit == "leg_acceleration_max":
        assert slow == pytest.approx(math.sqrt(over), rel=1e-6)


@pytest.mark.parametrize("power", [0.5, 1, 2, 7])
def test_the_factor_is_the_root_of_a_power_law(power: float) -> None:
    """Expected: (3/x)^p = 1 at x = 3."""
    assert factor_that_fits(lambda x: (3 / x) ** power) == pytest.approx(3, rel=1e-6)


def test_the_factor_is_found_beyond_infinite_shares_and_is_1_or_none_where_there_is_nothing_to_find() -> None:
    jump = factor_that_fits(lambda x: math.inf if x < 5 else 0.2)
    assert jump is not None
    assert 5 <= jump < 5 * 1.001
    assert factor_that_fits(lambda x: 0.99 / x) == 1
    assert factor_that_fits(lambda x: 1 + 1 / x) is None


def test_a_leg_that_would_accelerate_too_much_is_refused_with_what_would_fit() -> None:
    """Expected: of the heave at half its largest acceleration, √2 times as long; rounded to the safe side."""
    platform = limited(LIGHT, leg_acceleration_max=float(np.abs(Heave.second).max()) / 2)
    with pytest.raises(ReachError, match=r"the acceleration of leg \d is .* m/s²; .* if it were 1\.42 times as long"):
        check_reach(platform, TIMES, Heave.motion)


@pytest.mark.parametrize(
    ("limit", "quantity", "unit", "values"),
    [
        ("actuator_force_max", "the force", "N", Heave.force),
        ("actuator_power_max", "the power", "W", Heave.force * Heave.velocity),
    ],
)
def test_an_actuator_that_would_need_too_much_is_refused_with_what_would_fit(
    limit: str, quantity: str, unit: str, values: FloatArray
) -> None:
    """Expected: the heave's closed form; just above its largest value nothing is refused."""
    most = float(np.abs(values).max())
    row = int((np.abs(values) > 0.999 * most).argmax())
    check_reach(limited(LIGHT, **{limit: 1.001 * most}), TIMES, Heave.motion)
    text = rf"{quantity} of leg . is .* {unit}; expected .* times as long .* or .* times as large"
    with pytest.raises(ReachError, match=text) as no:
        check_reach(limited(LIGHT, **{limit: 0.999 * most}), TIMES, Heave.motion)
    assert (no.value.quantity, no.value.time) == (quantity, TIMES[row])
    assert no.value.value == pytest.approx(values[row], rel=1e-9)


def test_a_weight_that_the_legs_cannot_hold_is_helped_by_no_scale() -> None:
    """Expected: a sixth of the weight along the leg against a limit of 10 N."""
    static = 10 * 9.81 / 6 * Heave.length[0] / Heave.z[0]
    text = rf"neither slower nor smaller helps: .* actuator force max is already at {100 * static / 10:.4g} %"
    with pytest.raises(ReachError, match=text):
        check_reach(limited(LIGHT, actuator_force_max=10.0), TIMES, Heave.motion)


def test_limits_of_motion_may_be_passed_with_a_warning_and_those_of_poses_not() -> None:
    """Expected: a line for velocity and force; a leg too long is refused all the same."""
    platform = limited(LIGHT, leg_velocity_max=0.1, actuator_force_max=15.0)
    found = check_reach(platform, TIMES, Heave.motion, dynamic="warn")
    assert len(found) == 2
    assert all(text.startswith("the reference exceeds a limit: at time 0 s the ") for text in found)
    with pytest.raises(ReachError, match="the velocity of leg"):
        check_reach(platform, TIMES, Heave.motion)
    short = replace(platform, leg_length_max=float(Heave.length.max()) * 0.999)
    with pytest.raises(ReachError, match="the length of leg"):
        check_reach(short, TIMES, Heave.motion, dynamic="warn")
    assert check_reach(LIGHT, TIMES, Heave.motion, dynamic="warn") == []

"""Reference motions against closed forms, central differences and what no motion may be."""

import itertools
import math
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.harness.errors import ExperimentError, MotionError
from gough_stewart.harness.motion.motion import Motion, Reference, extrapolated, motion_of
from gough_stewart.harness.motion.recorded.low_pass import smoothed
from gough_stewart.harness.motion.recorded.recording import read_recording
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.harness.motion.references import (
    Chirp,
    Circle,
    FromFile,
    Hold,
    PointToPoint,
    ReferenceChoice,
    Sine,
    Step,
)
from gough_stewart.harness.quantities import Velocity
from gough_stewart.harness.section import ByType, Section
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import FloatArray

POSITION, ORIENTATION = np.array([0.1, -0.2, 3.0]), np.array([0.2, -0.3, 0.4])
POSE: dict[str, Any] = {"position": POSITION, "orientation": ORIENTATION}
CHANGE: dict[str, Any] = {"position_change": [0.1, 0.2, -0.3], "orientation_change": [0.3, -0.2, 0.5]}
AMPLITUDE: dict[str, Any] = {"position_amplitude": [0.1, 0.2, -0.3], "orientation_amplitude": [0.3, -0.2, 0.5]}
STILL: dict[str, Any] = {"position": np.zeros(3), "orientation": np.zeros(3)}
HEAVE: dict[str, Any] = {"position_amplitude": [0, 0, 1], "orientation_amplitude": np.zeros(3)}


def table_of(reference: Reference, time: FloatArray) -> FromTable:
    motion = reference(time)
    return FromTable(time, motion.position, motion.orientation)


# Jumps of position or acceleration are at 0.5 and 2.0 s, between the times below.
KINDS: dict[str, Reference] = {
    "hold": Hold(**POSE),
    "step": Step(**POSE, **CHANGE, at=0.5),
    "point_to_point": PointToPoint(**POSE, **CHANGE, at=0.5, duration=1.5),
    "sine": Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=0.3),
    "faded sine": Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=0.3, fade_in=1.1),
    "circle xy": Circle(**POSE, radius=0.2, frequency=0.7),
    "circle xz": Circle(**POSE, radius=0.2, frequency=0.7, plane="xz"),
    "faded circle": Circle(**POSE, radius=0.2, frequency=0.7, plane="yz", fade_in=1.1),
    "chirp": Chirp(**POSE, **AMPLITUDE, from_frequency=0.2, to_frequency=1.5, duration=2.0),
    "faded falling chirp": Chirp(**POSE, **AMPLITUDE, from_frequency=1.5, to_frequency=0.2, duration=2.0, fade_in=1.1),
    "table": table_of(Sine(**POSE, **AMPLITUDE, frequency=0.7), np.linspace(-0.1, 3.1, 50)),
}
SLOW, SIZE = 1.3, -0.7
SCALED: dict[str, Reference] = {
    name: kind.model_copy(update={"time_scale": SLOW, "amplitude_scale": SIZE})
    for name, kind in KINDS.items()
    if isinstance(kind, ReferenceChoice)
}
SCALED["table"] = KINDS["table"].scaled(SLOW, SIZE)  # type: ignore[attr-defined]
UNSCALED = dict(KINDS)
KINDS |= {f"scaled {name}": kind for name, kind in SCALED.items()}
TIMES = np.linspace(0.003, 2.997, 500)

numbers = st.floats(-0.4, 0.4)
vectors = st.tuples(numbers, numbers, numbers).map(np.array)
durations = st.floats(0.05, 5)
frequencies = st.floats(0.05, 5)


def central_difference(function: Callable[[FloatArray], FloatArray], time: FloatArray, h: float = 1e-5) -> FloatArray:
    return (function(time + h) - function(time - h)) / (2 * h)


def turning(reference: Reference, time: FloatArray) -> FloatArray:
    """Angular velocity from Ṙ Rᵀ = ω~, by central differences of the rotation matrix."""
    rate = central_difference(lambda t: matrix_from_orientation(reference(t).orientation), time)
    spin = rate @ np.swapaxes(matrix_from_orientation(reference(time).orientation), -1, -2)
    return np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)


def at_rest(motion: Motion) -> bool:
    return all(np.allclose(part, 0, atol=1e-12) for part in motion[2:])


@pytest.mark.parametrize("kind", KINDS)
def test_velocities_and_accelerations_are_the_derivatives(kind: str) -> None:
    """Expected: central differences, and those of the rotation matrix for ω; good to h² times third derivatives."""
    reference = KINDS[kind]
    motion = reference(TIMES)
    assert np.allclose(motion.velocity, central_difference(lambda t: reference(t).position, TIMES), atol=1e-7)
    assert np.allclose(motion.angular_velocity, turning(reference, TIMES), atol=1e-6)
    assert np.allclose(motion.acceleration, central_difference(lambda t: reference(t).velocity, TIMES), atol=1e-6)
    by_differences = central_difference(lambda t: reference(t).angular_velocity, TIMES)
    assert np.allclose(motion.angular_acceleration, by_differences, atol=1e-6)


@pytest.mark.parametrize("kind", SCALED)
def test_a_scaled_motion_is_in_the_poses_of_the_other_one_that_much_earlier_and_nearer(kind: str) -> None:
    """Expected: pose₀ + a (pose(t/s) − pose₀), with pose₀ that of a table at time 0; velocities by the chain rule."""
    found, other = SCALED[kind](TIMES), UNSCALED[kind](TIMES / SLOW)
    centre = UNSCALED[kind](np.zeros(1)) if kind == "table" else Hold(**POSE)(np.zeros(1))
    for part in (0, 1):
        assert np.allclose(found[part], centre[part] + SIZE * (other[part] - centre[part]), rtol=0, atol=1e-12)
    assert np.allclose(found.velocity, SIZE / SLOW * other.velocity, rtol=0, atol=1e-11)
    assert np.allclose(found.acceleration, SIZE / SLOW**2 * other.acceleration, rtol=0, atol=1e-10)


def test_the_highest_frequency_follows_the_time_scale() -> None:
    """Expected: as many times less as the motion takes longer."""
    for kind, highest in (("sine", 0.7), ("chirp", 1.5), ("faded falling chirp", 1.5), ("circle xy", 0.7)):
        assert SCALED[kind].highest_frequency == pytest.approx(highest / SLOW)  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", KINDS)
def test_every_part_has_a_row_for_every_time(kind: str) -> None:
    assert [part.shape for part in KINDS[kind](TIMES)] == [(500, 3)] * 6
    assert [part.shape for part in KINDS[kind](TIMES[:0])] == [(0, 3)] * 6


@pytest.mark.parametrize("kind", KINDS)
def test_integers_are_times_too(kind: str) -> None:
    """Expected: the same as at floating-point times."""
    of_integers, of_floats = (KINDS[kind](np.array([0, 1, 2, 3], dtype=t)) for t in (int, float))
    assert all(np.array_equal(a, b) for a, b in zip(of_integers, of_floats, strict=True))


@pytest.mark.parametrize("kind", KINDS)
def test_a_reference_survives_a_copy_to_another_process(kind: str) -> None:
    copy = pickle.loads(pickle.dumps(KINDS[kind]))
    assert all(np.array_equal(a, b) for a, b in zip(copy(TIMES), KINDS[kind](TIMES), strict=True))


@given(vectors, vectors, vectors, vectors, durations, frequencies)
def test_what_starts_softly_starts_in_its_pose_and_at_rest(
    position: FloatArray,
    orientation: FloatArray,
    by: FloatArray,
    turned: FloatArray,
    duration: float,
    frequency: float,
) -> None:
    """Expected: the quintic and its first two derivatives are 0 at its start."""
    pose: dict[str, Any] = {"position": position, "orientation": orientation}
    change: dict[str, Any] = {"position_change": by, "orientation_change": turned}
    amplitude: dict[str, Any] = {"position_amplitude": by, "orientation_amplitude": turned}
    sweep: dict[str, Any] = {"from_frequency": frequency, "to_frequency": 3.0, "duration": duration}
    references: Sequence[Reference] = (
        Hold(**pose),
        Step(**pose, **change, at=duration),
        PointToPoint(**pose, **change, at=0.0, duration=duration),
        Sine(**pose, **amplitude, frequency=frequency, phase=1.0, fade_in=duration),
        Circle(**pose, radius=duration, frequency=frequency, fade_in=duration),
        Chirp(**pose, **amplitude, **sweep, fade_in=duration),
    )
    for reference in references:
        start = reference(np.zeros(1))
        assert np.array_equal(start.position[0], position)
        assert np.array_equal(start.orientation[0], orientation)
        assert at_rest(start)


@given(vectors, vectors, frequencies, st.floats(-3, 3))
def test_angular_velocity_turns_the_matrix_whatever_the_motion(
    amplitude: FloatArray, orientation: FloatArray, frequency: float, phase: float
) -> None:
    """Expected: Ṙ Rᵀ = ω~ by central differences, scaled by the motion's third derivative."""
    swing: dict[str, Any] = {"position_amplitude": np.zeros(3), "orientation_amplitude": amplitude}
    sine = Sine(position=POSITION, orientation=orientation, **swing, frequency=frequency, phase=phase)
    size = 1 + np.abs(amplitude).max() * (2 * np.pi * frequency) ** 3
    assert np.allclose(sine(TIMES).angular_velocity, turning(sine, TIMES), atol=1e-9 * size)


def test_hold_stays() -> None:
    motion = Hold(**POSE)(TIMES)
    assert np.array_equal(motion.position, np.tile(POSITION, (500, 1)))
    assert np.array_equal(motion.orientation, np.tile(ORIENTATION, (500, 1)))
    assert at_rest(motion)


def test_step_jumps_at_its_time_up_to_rounding() -> None:
    """Expected: at `at` it has jumped, and 1e-9 s earlier; not 2e-9 s earlier."""
    step = Step(**POSE, **CHANGE, at=0.2)
    motion = step(np.array([0.0, 0.2 - 2e-9, 0.2 - 5e-10, 0.2, 1.0]))
    jumped = np.array([0, 0, 1, 1, 1])[:, None]
    assert np.allclose(motion.position, POSITION + jumped * CHANGE["position_change"], atol=1e-15)
    assert np.allclose(motion.orientation, ORIENTATION + jumped * CHANGE["orientation_change"], atol=1e-15)
    assert at_rest(motion)


@given(vectors, vectors, st.floats(0, 3), durations)
def test_point_to_point_is_at_rest_before_and_after(
    by: FloatArray, turned: FloatArray, at: float, duration: float
) -> None:
    """Expected: the start pose up to `at`, the end pose from `at + duration` on."""
    reference = PointToPoint(**POSE, position_change=by, orientation_change=turned, at=at, duration=duration)
    before, after = reference(np.array([at - 1.0, at])), reference(at + duration + np.array([1e-12, 1.0]))
    assert np.allclose(before.position, POSITION, rtol=0, atol=1e-15)
    assert np.allclose(before.orientation, ORIENTATION, rtol=0, atol=1e-15)
    assert np.allclose(after.position, POSITION + by, rtol=0, atol=1e-14)
    assert np.allclose(after.orientation, ORIENTATION + turned, rtol=0, atol=1e-14)
    assert at_rest(before)
    assert at_rest(after)


def test_point_to_point_has_the_known_middle_and_peaks() -> None:
    """Expected of 10 s³ − 15 s⁴ + 6 s⁵: ½ and 15/8 at s = ½, ±10/√3 at s = ½ ∓ √3/6; over 2 s from 1 s on."""
    change: dict[str, Any] = {"position_change": [1, 0, 0], "orientation_change": [0, 0, 0]}
    reference = PointToPoint(**STILL, **change, at=1.0, duration=2.0)
    s = np.array([0.5, 0.5 - np.sqrt(3) / 6, 0.5 + np.sqrt(3) / 6])
    motion = reference(1 + 2 * s)
    assert motion.position[0, 0] == pytest.approx(0.5)
    assert motion.velocity[0, 0] == pytest.approx(15 / 8 / 2)
    assert np.allclose(motion.acceleration[:, 0], np.array([0, 1, -1]) * 10 / np.sqrt(3) / 4, atol=1e-14)


def test_sine_is_a_sine() -> None:
    """Expected: a sin(2π f t + φ) and its derivatives."""
    motion = Sine(**STILL, **HEAVE, frequency=0.5, phase=0.3)(TIMES)
    angle = np.pi * TIMES + 0.3
    assert np.allclose(motion.position[:, 2], np.sin(angle), atol=1e-14)
    assert np.allclose(motion.velocity[:, 2], np.pi * np.cos(angle), atol=1e-13)
    assert np.allclose(motion.acceleration[:, 2], -(np.pi**2) * np.sin(angle), atol=1e-13)
    assert not np.any(motion.position[:, :2])


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_one_axis_has_the_angle_rates_as_angular_velocity(axis: int) -> None:
    """Expected: from level, ω = rate · axis and ω̇ = acceleration · axis."""
    amplitude = 0.3 * np.eye(3)[axis]
    motion = Sine(**STILL, position_amplitude=np.zeros(3), orientation_amplitude=amplitude, frequency=0.5)(TIMES)
    rate, acceleration = np.pi * np.cos(np.pi * TIMES), -(np.pi**2) * np.sin(np.pi * TIMES)
    assert np.allclose(motion.angular_velocity, np.outer(rate, amplitude), atol=1e-14)
    assert np.allclose(motion.angular_acceleration, np.outer(acceleration, amplitude), atol=1e-13)


@pytest.mark.parametrize("kind", ["sine", "circle", "chirp"])
def test_after_fading_in_the_motion_is_the_plain_one(kind: str) -> None:
    """Expected: the same motion without fade-in."""
    make: dict[str, Callable[[float], Reference]] = {
        "sine": lambda fade: Sine(**POSE, **AMPLITUDE, frequency=0.7, fade_in=fade),
        "circle": lambda fade: Circle(**POSE, radius=0.2, frequency=0.7, fade_in=fade),
        "chirp": lambda fade: Chirp(
            **POSE, **AMPLITUDE, from_frequency=0.2, to_frequency=2, duration=2.5, fade_in=fade
        ),
    }
    after = TIMES[TIMES >= 1.0]
    for faded, plain in zip(make[kind](1.0)(after), make[kind](0.0)(after), strict=True):
        assert np.allclose(faded, plain, rtol=0, atol=1e-13)


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_circle_has_its_radius_speed_and_centripetal_acceleration(plane: Any) -> None:
    """Expected: |r| = radius, v ⊥ r with |v| = 2π f r, a = −(2π f)² r; the third axis rests."""
    motion = Circle(**POSE, radius=0.2, frequency=0.5, plane=plane)(TIMES)
    arm = motion.position - POSITION
    first, second = ("xyz".index(axis) for axis in plane)
    assert np.allclose(arm[:, first], 0.2 * np.cos(np.pi * TIMES), atol=1e-14)
    assert np.allclose(arm[:, second], 0.2 * np.sin(np.pi * TIMES), atol=1e-14)
    assert not np.any(np.delete(arm, [first, second], axis=1))
    assert np.allclose((arm * motion.velocity).sum(axis=1), 0, atol=1e-14)
    assert np.allclose(np.linalg.norm(motion.velocity, axis=1), 0.2 * np.pi, rtol=1e-13)
    assert np.allclose(motion.acceleration, -(np.pi**2) * arm, atol=1e-13)
    assert np.array_equal(motion.orientation, np.tile(ORIENTATION, (500, 1)))


def test_chirp_sweeps_and_goes_on_with_continuous_phase() -> None:
    """Expected: sin 2π(f0 t + (f1 − f0) t²/(2 T)); after T the phase goes on from the mean frequency's at f1."""
    f0, f1, T = 0.5, 2.0, 1.5
    motion = Chirp(**STILL, **HEAVE, from_frequency=f0, to_frequency=f1, duration=T)(TIMES)
    sweeping = np.sin(2 * np.pi * (f0 * TIMES + (f1 - f0) * TIMES**2 / (2 * T)))
    after = np.sin(2 * np.pi * (0.5 * (f0 + f1) * T + f1 * (TIMES - T)))
    assert np.allclose(motion.position[:, 2], np.where(TIMES < T, sweeping, after), atol=1e-13)
    # at T itself the frequency has come to rest
    at_end = Chirp(**STILL, **HEAVE, from_frequency=f0, to_frequency=f1, duration=T)(np.array([T]))
    assert at_end.acceleration[0, 2] == pytest.approx(-((2 * np.pi * f1) ** 2) * np.sin(np.pi * (f0 + f1) * T))


def test_a_chirp_of_one_frequency_is_a_sine() -> None:
    chirp = Chirp(**POSE, **AMPLITUDE, from_frequency=0.7, to_frequency=0.7, duration=1.0)
    sine = Sine(**POSE, **AMPLITUDE, frequency=0.7)
    for a, b in zip(chirp(TIMES), sine(TIMES), strict=True):
        assert np.allclose(a, b, rtol=0, atol=1e-12)


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.lists(st.floats(0.05, 0.3), min_size=5, max_size=20))
def test_a_table_of_a_polynomial_of_fifth_degree_is_exact(coefficients: list[float], steps: list[float]) -> None:
    """Expected: the polynomial and its derivatives, however the times are spaced."""
    polynomial = np.polynomial.Polynomial(coefficients)
    samples = np.concatenate([[0.0], np.cumsum(steps)])
    zero = np.zeros_like(samples)
    position = np.stack([polynomial(samples), zero, 2 * polynomial(samples)], axis=1)
    table = FromTable(samples, position, np.zeros((len(samples), 3)))
    time = np.linspace(0, samples[-1], 50)
    for k, found in enumerate(table(time)[::2]):
        expected = polynomial.deriv(k)(time) if k else polynomial(time)
        size = 1e-9 * (1 + np.abs(expected).max())
        assert np.allclose(found[:, 0], expected, rtol=0, atol=size)
        assert np.allclose(found[:, 2], 2 * expected, rtol=0, atol=2 * size)


def test_the_pieces_of_a_table_of_polynomials_are_those_moved_to_where_each_begins() -> None:
    """Expected: Taylor's coefficients of six polynomials of fifth degree, at rows of uneven times."""
    rng = np.random.default_rng(8)
    time, coefficients = np.cumsum(rng.uniform(0.1, 0.4, 12)), rng.normal(size=(6, 6))
    polynomials = [np.polynomial.Polynomial(each) for each in coefficients]
    pose = np.stack([polynomial(time) for polynomial in polynomials], axis=1)
    begins, pieces = FromTable(time, pose[:, :3], pose[:, 3:]).pieces
    assert begins[0] == time[0]
    assert set(begins) < set(time[:-1])
    expected = [
        [[p.deriv(k)(t) / math.factorial(k) for k in (5, 4, 3, 2, 1)] + [p(t)] for p in polynomials] for t in begins
    ]
    np.testing.assert_allclose(pieces, expected, rtol=0, atol=1e-7)


@given(
    st.lists(st.floats(-0.5, 0.5), min_size=18, max_size=18),
    st.floats(0.0, 0.2),
)
def test_a_motion_of_constant_second_derivatives_is_extrapolated_exactly(numbers: list[float], ahead: float) -> None:
    """Expected: the quadratic itself, later."""
    pose, rate, acceleration = np.array(numbers).reshape(3, 1, 6)
    later = (pose + ahead * rate + ahead**2 / 2 * acceleration, rate + ahead * acceleration, acceleration)
    found = extrapolated(motion_of(pose, rate, acceleration), ahead)
    np.testing.assert_allclose(np.concatenate(found), np.concatenate(motion_of(*later)), atol=1e-13)


def test_a_table_goes_through_its_rows() -> None:
    rng = np.random.default_rng(3)
    time, pose = np.cumsum(rng.uniform(0.05, 0.15, 30)), rng.normal(size=(30, 6)) / 5
    motion = FromTable(time, pose[:, :3], pose[:, 3:])(time)
    assert np.allclose(np.hstack(motion[:2]), pose, rtol=0, atol=1e-12)


def test_a_table_admits_rounding_at_its_ends_and_no_more() -> None:
    """Expected: up to 1e-9 s beyond the first and the last row, where it stands still; no 2 % more, and no NaN."""
    table = table_of(Sine(**POSE, **AMPLITUDE, frequency=0.7), np.linspace(1.0, 2.0, 50))
    beyond, ends = table(np.array([1 - 1e-9, 2 + 1e-9])), table(np.array([1.0, 2.0]))
    assert all(np.array_equal(a, b) for a, b in zip(beyond, ends, strict=True))
    for time in (1 - 1.02e-9, 2 + 1.02e-9, np.nan):
        with pytest.raises(MotionError, match="outside the table, which covers 1 to 2 s"):
            table(np.array([1.5, time]))


def test_a_table_of_a_sine_reproduces_it_to_sixth_order() -> None:
    """Expected: of quintic splines, errors h⁶ in position, h⁵ in velocity, h⁴ in acceleration."""
    sine = Sine(**STILL, **HEAVE, frequency=0.5)
    exact = sine(TIMES)
    errors = []
    for n in (25, 50, 100):
        table = table_of(sine, np.linspace(0, 3, n + 1))(TIMES)
        errors.append([np.abs(a - b).max() for a, b in zip(table[::2], exact[::2], strict=True)])
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > np.array([5.7, 4.7, 3.7]))
    assert errors[-1][0] < 1e-8


@pytest.mark.parametrize("time", [0.9, 3.1, np.nan, np.inf])
def test_a_time_outside_of_the_table_is_refused(time: float) -> None:
    table = table_of(KINDS["sine"], np.linspace(1, 3, 21))
    with pytest.raises(MotionError, match=rf"time {time:g} s is outside the table, which covers 1 to 3 s"):
        table(np.array([1.5, time, 2.0]))


def test_a_time_outside_by_rounding_is_the_end_of_the_table() -> None:
    table = table_of(KINDS["sine"], np.linspace(1, 3, 21))
    inside, outside = table(np.array([1.0, 3.0])), table(np.array([1.0 - 5e-10, 3.0 + 5e-10]))
    assert all(np.array_equal(a, b) for a, b in zip(inside, outside, strict=True))


GOOD: dict[str, tuple[type, dict[str, Any]]] = {
    "hold": (Hold, POSE),
    "step": (Step, {**POSE, **CHANGE, "at": 0.5}),
    "point_to_point": (PointToPoint, {**POSE, **CHANGE, "at": 0.5, "duration": 1.0}),
    "sine": (Sine, {**POSE, **AMPLITUDE, "frequency": 1.0}),
    "circle": (Circle, {**POSE, "radius": 0.1, "frequency": 1.0}),
    "chirp": (Chirp, {**POSE, **AMPLITUDE, "from_frequency": 1.0, "to_frequency": 2.0, "duration": 1.0}),
}


@pytest.mark.parametrize(
    ("kind", "name", "value", "message"),
    [
        *((kind, "position", [1, 2], r"position: is \[1, 2\]; expected a list of 3 \[m\]; found 2") for kind in GOOD),
        *((kind, "orientation", [0, 0, np.nan], "orientation: is .*nan.*; value 3 of 3: expected") for kind in GOOD),
        ("hold", "position", "home", "position: is 'home'; expected a list of 3"),
        ("hold", "position", ["1 m", "2 deg", "3 m"], "position: .*value 2 of 3: .*found the unit 'deg'"),
        ("step", "position_change", [1j, 0, 0], "position_change: is .*; value 1 of 3: expected a number of m"),
        ("step", "orientation_change", 1.0, r"orientation_change: is 1.0; expected a list of 3 \[rad\]"),
        ("step", "at", -1.0, "at: is -1.0; expected > 0 s"),
        ("step", "type", "hold", "type: is 'hold'; expected 'step'"),
        ("point_to_point", "duration", 0, "duration: is 0; expected > 0 s"),
        ("point_to_point", "at", np.inf, "at: is inf; expected"),
        ("sine", "frequency", -1.0, "frequency: is -1.0; expected > 0 Hz"),
        ("sine", "frequency", "1 rad", "frequency: is '1 rad'; .*found the unit 'rad'"),
        ("sine", "phase", [0.0], r"phase: is \[0.0\]; expected a number of rad"),
        ("sine", "fade_in", -0.1, "fade_in: is -0.1; expected >= 0 s"),
        ("sine", "position_amplitude", [[1, 2, 3]], "position_amplitude: is .*; expected a list of 3"),
        ("sine", "amplitude", 0.1, "amplitude: unknown key .= 0.1.; did you mean 'amplitude_scale'"),
        ("sine", "time_scale", 0.0, "time_scale: is 0.0; expected > 0"),
        ("circle", "time_scale", "2 s", "time_scale: is '2 s'; expected a number"),
        ("hold", "amplitude_scale", np.inf, "amplitude_scale: is inf; expected"),
        ("circle", "radius", 0.0, "radius: is 0.0; expected > 0 m"),
        ("circle", "plane", "yx", "plane: is 'yx'; expected 'xy', 'xz' or 'yz'"),
        ("circle", "plane", ["xy"], r"plane: is \['xy'\]; expected"),
        ("chirp", "from_frequency", 0.0, "from_frequency: is 0.0; expected > 0 Hz"),
        ("chirp", "to_frequency", True, "to_frequency: is True; expected a number of Hz"),
        ("chirp", "duration", -1, "duration: is -1; expected > 0 s"),
    ],
)
def test_an_impossible_number_is_refused_by_name(kind: str, name: str, value: object, message: str) -> None:
    made, values = GOOD[kind]
    with pytest.raises(MotionError, match=rf"^{message}") as caught:
        made(**{**values, name: value})
    assert isinstance(caught.value, GoughStewartError)
    assert isinstance(caught.value, ValueError)


def test_a_missing_number_is_refused_by_name() -> None:
    with pytest.raises(MotionError, match=r"^frequency: is missing; add it$"):
        Sine(**POSE, **AMPLITUDE)


def test_numbers_are_copied_and_stay() -> None:
    mine = POSITION.copy()
    hold = Hold(position=mine, orientation=ORIENTATION)
    mine[:] = 7.0
    assert hold(TIMES).position[3].tolist() == POSITION.tolist()
    with pytest.raises(ValueError, match="frozen"):
        hold.position = mine
    table = table_of(hold, np.arange(6.0))
    with pytest.raises(ValueError, match="read-only"):
        table.time[0] = 1.0


def test_references_compare_by_their_numbers() -> None:
    """Expected: equal where all keys are, however they were written; usable in sets."""
    one, same, other = Hold(**POSE), Hold(position=POSITION.tolist(), orientation=ORIENTATION), Hold(**STILL)
    assert one == same != other
    assert len({one, other, same}) == 2


def test_quantities_may_have_units() -> None:
    """Expected: 42 rpm = 0.7 Hz, 100 mm = 0.1 m, 180° = π."""
    written = Sine(
        **POSE,
        position_amplitude=["100 mm", "20 cm", "-300 mm"],
        orientation_amplitude=AMPLITUDE["orientation_amplitude"],
        frequency="42 rpm",  # type: ignore[arg-type]
        phase="180 deg",  # type: ignore[arg-type]
    )
    plain = Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=np.pi)
    assert all(np.allclose(a, b, rtol=0, atol=1e-13) for a, b in zip(written(TIMES), plain(TIMES), strict=True))


def test_a_motion_without_a_pose_is_about_the_home_pose() -> None:
    """Expected: home in the part that is not named; the named part stays; without a platform a clear refusal."""
    home: dict[str, Any] = {"home_position": [0.02, -0.03, 1.1], "home_orientation": [0.01, 0.04, -0.05]}
    platform = replace(load_preset("motion_base"), **home)
    sine = Sine(**AMPLITUDE, frequency=0.7)
    turned = Sine(**AMPLITUDE, frequency=0.7, orientation=ORIENTATION)
    for reference, orientation in ((sine, platform.home_orientation), (turned, ORIENTATION)):
        with pytest.raises(MotionError, match=r"^position is None; expected a position, or .*about\(platform\)"):
            reference(TIMES)
        expected = Sine(**AMPLITUDE, frequency=0.7, position=platform.home_position, orientation=orientation)(TIMES)
        found = reference.about(platform)(TIMES)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    with pytest.raises(MotionError, match=r"^orientation is None"):
        Hold(position=POSITION)(TIMES)


@pytest.mark.parametrize(
    ("kind", "highest"),
    [
        *((kind, 0) for kind in ("hold", "step", "point_to_point")),
        *((kind, 0.7) for kind in ("sine", "faded circle")),
        *((kind, 1.5) for kind in ("chirp", "faded falling chirp")),
    ],
)
def test_a_motion_knows_its_highest_frequency(kind: str, highest: float) -> None:
    """Expected: the frequencies that it was made with; of a chirp the higher, rising or falling."""
    reference = KINDS[kind]
    assert isinstance(reference, ReferenceChoice)
    assert reference.highest_frequency == highest


def test_a_further_motion_takes_one_class() -> None:
    """Expected: files may name it by its type, its keys are checked, its formula is what moves."""

    class Ramp(ReferenceChoice):
        type: Literal["ramp"] = "ramp"
        velocity: Velocity

        def about(self, platform: Platform, folder: Path = Path()) -> Reference:  # noqa: ARG002
            return lambda time: Hold(position=platform.home_position, orientation=[0, 0, 0])(time)._replace(
                velocity=np.tile(np.asarray(self.velocity), (len(time), 1))
            )

    class Trial(Section):
        reference: Annotated[ReferenceChoice, ByType()]

    trial = Trial.model_validate({"reference": {"type": "ramp", "velocity": ["1 mm/s", 0, 2]}})
    motion = trial.reference.about(load_preset("motion_base"))(TIMES)
    assert motion.velocity.tolist() == [[0.001, 0, 2]] * len(TIMES)
    with pytest.raises(ExperimentError, match=r"^reference.velocty: unknown key .= 3.; did you mean 'velocity'"):
        Trial(reference={"type": "ramp", "velocity": [0, 0, 1], "velocty": 3})  # type: ignore[arg-type]
    with pytest.raises(ExperimentError, match=r"^reference: type is 'rampe'; expected one of .*'circle'.*'ramp'"):
        Trial(reference={"type": "rampe"})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("n", "change", "message"),
    [
        (5, {}, "a table of 5 rows; expected at least 6"),
        (7, {"time": [0, 1, 2, 2, 3, 4, 5]}, "time goes from 2 to 2 s in row 4; expected increasing times"),
        (7, {"time": [0, 1, 2, 3, 4, 5, 4.5]}, "time goes from 5 to 4.5 s in row 7"),
        (7, {"time": [0, 1, 2, 3, 4, 5, np.inf]}, "time is .*expected finite"),
        (7, {"position": np.zeros((6, 3))}, r"position has shape \(6, 3\); expected numbers of shape \(7, 3\)"),
        (7, {"orientation": np.full((7, 3), np.nan)}, "orientation is .*expected finite"),
    ],
)
def test_an_impossible_table_is_refused(n: int, change: dict[str, Any], message: str) -> None:
    values: dict[str, Any] = {"time": np.arange(n), "position": np.zeros((n, 3)), "orientation": np.zeros((n, 3))}
    with pytest.raises(MotionError, match=f"^{message}"):
        FromTable(**{**values, **change})


COLUMNS = ["time", "position[1]", "position[2]", "position[3]", "orientation[1]", "orientation[2]", "orientation[3]"]
ROWS = [[str(0.1 * k), str(0.01 * k**2), "0", "3.0", "0", "1e-3", str(-0.02 * k)] for k in range(8)]


def csv(columns: Sequence[str] = COLUMNS, rows: Sequence[Sequence[str]] = ROWS) -> str:
    return "".join(",".join(row) + "\n" for row in itertools.chain([columns], rows))


def with_cell(row: int, column: int, text: str) -> list[list[str]]:
    """The good rows with one cell changed; both 1-based."""
    rows = [list(r) for r in ROWS]
    rows[row - 1][column - 1] = text
    return rows


# a name with brackets is a name, and no pattern
@pytest.mark.parametrize("name", ["reference.csv", "run[1].csv", "run*.csv"])
def test_a_file_is_read_as_it_was_written(name: str, tmp_path: Path) -> None:
    """Expected: the numbers of the file in whatever order of columns, others ignored."""
    order = [6, 2, 0, 1, 5, 3, 4]
    rows = [[*(row[k] for k in order), "note"] for row in ROWS]
    (tmp_path / name).write_text(csv([*(COLUMNS[k] for k in order), "remark"], rows))
    read = read_recording(tmp_path / name).table
    values = np.array(ROWS, dtype=float)
    assert np.array_equal(read.time, values[:, 0])
    assert np.array_equal(read.position, values[:, 1:4])
    assert np.array_equal(read.orientation, values[:, 4:])
    # a polynomial of second degree: 0.01 k² at 0.1 k s is t²
    assert np.allclose(read(np.array([0.25])).position[0], [0.0625, 0, 3], atol=1e-14)


def test_a_file_without_rounding_keeps_all_digits(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    pose = rng.uniform(-1.5, 1.5, size=(20, 6))  # more than half a turn between two rows would be a wrap
    rows = [[repr(float(k)), *map(repr, map(float, row))] for k, row in enumerate(pose)]
    (tmp_path / "a.csv").write_text(csv(rows=rows))
    read = read_recording(tmp_path / "a.csv").table
    assert np.array_equal(np.hstack([read.position, read.orientation]), pose)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            csv(COLUMNS[:5], [row[:5] for row in ROWS]),
            r"has no column orientation\[2\], orientation\[3\]; expected time, position\[1\], ",
        ),
        (csv(rows=with_cell(3, 2, "x")), r"position\[1\] in row 3 is 'x'; expected a finite number"),
        (csv(rows=with_cell(4, 6, "")), r"orientation\[2\] in row 4 is None; expected a finite number"),
        (csv(rows=with_cell(8, 7, "nan")), r"orientation\[3\] in row 8 is 'nan'"),
        (csv(rows=with_cell(1, 1, "-inf")), "time in row 1 is '-inf'"),
        (csv(rows=with_cell(2, 4, "true")), r"position\[3\] in row 2 is 'true'"),
        (csv(rows=with_cell(5, 1, "0.3")), "time goes from 0.3 to 0.3 s in row 5; expected increasing times"),
        (csv(rows=ROWS[:5]), "a table of 5 rows; expected at least 6"),
        (csv(rows=[*ROWS, [*ROWS[0], "8"]]), "is not CSV: .*more fields"),
        ("", "has no rows; expected a header and rows of numbers"),
    ],
)
def test_a_file_that_is_no_reference_is_refused_by_file_column_and_row(
    content: str, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.csv"
    file.write_text(content)
    with pytest.raises(MotionError, match=rf"a\.csv: .*{message}"):
        read_recording(file)


def test_a_file_of_other_bytes_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(csv().encode() + b"\xe9\xff,1,1,1,1,1,1\n")
    with pytest.raises(MotionError, match=r"a\.csv: time in row 9 is .éÿ.; expected a finite number"):
        read_recording(tmp_path / "a.csv")


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MotionError, match=r"a\.csv: cannot read this reference: No such file"):
        read_recording(tmp_path / "a.csv")
    with pytest.raises(MotionError, match=rf"{tmp_path.name}: (cannot read|is not CSV)"):
        read_recording(tmp_path)


def log_of(start: float, step: float = 0.01, n: int = 800) -> FromTable:
    """A slow sine in every coordinate, each with its own phase, from a time that is not 0."""
    time: FloatArray = start + step * np.arange(float(n))
    pose = 0.1 * np.sin(2 * np.pi * 0.4 * (time - start)[:, None] + np.arange(6))
    return FromTable(time, pose[:, :3], pose[:, 3:])


def written_log(log: FromTable, path: Path) -> None:
    names = [f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3)]
    table = np.column_stack([log.time, log.position, log.orientation])
    polars.DataFrame(table, schema=["time", *names]).write_csv(path)


def test_a_log_may_begin_at_any_time(tmp_path: Path) -> None:
    """Expected: a run begins at the first row, or at the file's time that is named."""
    log = log_of(12.3)
    written_log(log, tmp_path / "log.csv")
    platform, times = load_preset("liu2000"), np.array([0.0, 0.5, 2.0])
    begin = FromFile(file="log.csv").about(platform, tmp_path)(times)
    later = FromFile(file="log.csv", start_time=14.3).about(platform, tmp_path)(times)
    assert begin.position == pytest.approx(0.1 * np.sin(2 * np.pi * 0.4 * times[:, None] + np.arange(3)), abs=1e-8)
    assert later.position == pytest.approx(log(times + 14.3).position, abs=1e-12)
    with pytest.raises(MotionError, match=r"time 8 s is outside the table, which covers 0 to 7\.99 s"):
        FromFile(file="log.csv").about(platform, tmp_path)(np.array([8.0]))


@pytest.mark.parametrize("frequency", [0.4, 2.0, 3.0, 6.0, 15.0])
def test_smoothing_has_its_stated_gain_and_no_phase(frequency: float) -> None:
    """Expected: 1/(1 + (√2 − 1)(f/fc)⁶), with the frequencies of the bilinear rule; far from the ends."""
    rate, cutoff = 200.0, 3.0
    time = np.arange(4000) / rate + 5.0
    wave = np.sin(2 * np.pi * frequency * time[:, None] + np.arange(3))
    smooth = smoothed(FromTable(time, wave, -2 * wave), cutoff)
    warped = [math.tan(math.pi * f / rate) for f in (frequency, cutoff * (math.sqrt(2) - 1) ** (-1 / 6))]
    gain = 1 / (1 + (warped[0] / warped[1]) ** 6)
    middle = slice(800, 3200)
    assert smooth.position[middle] == pytest.approx(gain * wave[middle], abs=1e-5)
    assert smooth.orientation[middle] == pytest.approx(-2 * gain * wave[middle], abs=2e-5)


def test_smoothing_takes_the_noise_out_of_accelerations() -> None:
    """Expected: less than the motion's own 0.1 (0.8 π)² = 0.63 m/s², where 1 mm of noise alone makes tens of m/s²."""
    log = log_of(0.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(log.time), 3))
    noisy = FromTable(log.time, log.position + noise, log.orientation)
    times = np.linspace(1.0, 7.0, 2000)
    rough, smooth = (
        np.abs(each(times).acceleration - log(times).acceleration).max() for each in (noisy, smoothed(noisy, 1.5))
    )
    assert rough > 20
    assert smooth < 0.3


@pytest.mark.parametrize(("cutoff", "match"), [(60.0, "expected below 43.1 Hz, for rows at 100 Hz"), (0.05, "above")])
def test_a_cutoff_that_the_rows_cannot_have_is_refused(cutoff: float, match: str) -> None:
    with pytest.raises(MotionError, match=match):
        smoothed(log_of(0.0), cutoff)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (csv(rows=with_cell(2, 3, '"0,5"')), r"position\[2\] in row 2 is '0,5'; .* with a point, not a comma"),
        (csv([*COLUMNS, "time"], [[*row, "1"] for row in ROWS]), "has the column time twice"),
    ],
)
def test_a_table_that_could_mean_two_things_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    with pytest.raises(MotionError, match=rf"a\.csv: .*{message}"):
        read_recording(tmp_path / "a.csv")


def test_a_byte_order_mark_and_other_ends_of_lines_are_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(("\ufeff" + csv().replace("\n", "\r\n")).encode())
    assert np.array_equal(read_recording(tmp_path / "a.csv").table.time, np.array(ROWS, dtype=float)[:, 0])


@pytest.mark.parametrize("name", GOOD)
def test_times_may_be_a_list(name: str, paper: Platform) -> None:
    """Expected: what the same times give as an array."""
    kind, values = GOOD[name]
    motion = kind(**values).about(paper)
    for listed, same in zip(motion([0.1, 0.7, 1.3]), motion(np.array([0.1, 0.7, 1.3])), strict=True):
        assert np.array_equal(listed, same)

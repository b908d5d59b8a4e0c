"""Reference motions against closed forms, central differences and what no motion may be."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart import Chirp, Circle, GoughStewartError, Hold, Platform, PointToPoint, Sine, Step, load_preset
from gough_stewart.harness.motion.motion import Motion, Reference, extrapolated, motion_of
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.quantities import Velocity
from gough_stewart.harness.section import ByType, TableSection
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.arrays import FloatArray
from tests.support.reference_motions import (
    AMPLITUDE,
    CHANGE,
    HEAVE,
    KINDS,
    ORIENTATION,
    POSE,
    POSITION,
    SCALED,
    SIZE,
    SLOW,
    STILL,
    TIMES,
    table_of,
)

SCALED["table"] = KINDS["table"].scaled(SLOW, SIZE)  # type: ignore[attr-defined]
UNSCALED = dict(KINDS)
KINDS |= {f"scaled {name}": kind for name, kind in SCALED.items()}

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
    with pytest.raises(GoughStewartError, match=rf"^{message}") as caught:
        made(**{**values, name: value})
    assert isinstance(caught.value, GoughStewartError)
    assert isinstance(caught.value, ValueError)


def test_a_missing_number_is_refused_by_name() -> None:
    with pytest.raises(GoughStewartError, match=r"^frequency: is missing; add it$"):
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
        with pytest.raises(GoughStewartError, match=r"^position is None; expected a position, or .*about\(platform\)"):
            reference(TIMES)
        expected = Sine(**AMPLITUDE, frequency=0.7, position=platform.home_position, orientation=orientation)(TIMES)
        found = reference.about(platform)(TIMES)
        assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))
    with pytest.raises(GoughStewartError, match=r"^orientation is None"):
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

    class Trial(TableSection):
        reference: Annotated[ReferenceChoice, ByType()]

    trial = Trial.model_validate({"reference": {"type": "ramp", "velocity": ["1 mm/s", 0, 2]}})
    motion = trial.reference.about(load_preset("motion_base"))(TIMES)
    assert motion.velocity.tolist() == [[0.001, 0, 2]] * len(TIMES)
    with pytest.raises(GoughStewartError, match=r"^reference.velocty: unknown key .= 3.; did you mean 'velocity'"):
        Trial(reference={"type": "ramp", "velocity": [0, 0, 1], "velocty": 3})  # type: ignore[arg-type]
    with pytest.raises(GoughStewartError, match=r"^reference: type is 'rampe'; expected one of .*'circle'.*'ramp'"):
        Trial(reference={"type": "rampe"})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", GOOD)
def test_times_may_be_a_list(name: str, paper: Platform) -> None:
    """Expected: what the same times give as an array."""
    kind, values = GOOD[name]
    motion = kind(**values).about(paper)
    for listed, same in zip(motion([0.1, 0.7, 1.3]), motion(np.array([0.1, 0.7, 1.3])), strict=True):
        assert np.array_equal(listed, same)

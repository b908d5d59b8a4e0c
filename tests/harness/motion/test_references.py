"""The reference motions: each is its formula, with exact derivatives, in its own time and size, about its pose."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.motions import by_differences, experiment
from tests.support.uneven import UNEVEN

POSITION, ORIENTATION = np.array([0.1, -0.2, 3.0]), np.array([0.2, -0.3, 0.4])
POSE: dict[str, Any] = {"position": POSITION, "orientation": ORIENTATION}
ALONG = np.array([0.1, 0.2, -0.3, 0.3, -0.2, 0.5])
CHANGE: dict[str, Any] = {"position_change": ALONG[:3], "orientation_change": ALONG[3:]}
AMPLITUDE: dict[str, Any] = {"position_amplitude": ALONG[:3], "orientation_amplitude": ALONG[3:]}
PHASES: dict[str, Any] = {"phase": 0.3, "position_phase": [0.5, 0, -1.0], "orientation_phase": [0, 0.5, 0.2]}
SINES = np.array([[0.02, -0.03, 0.01, 0.03, -0.02, 0.05], [0.004, 0.007, -0.006, 0.006, 0.004, -0.007]])
COSINES = np.array([[0.011, 0.013, -0.017, -0.021, 0.023, 0.029], [-0.003, 0.002, 0.005, 0.003, -0.009, 0.008]])
SERIES: dict[str, Any] = {
    **{"frequency": 0.4, "duration": 2.9, "fade": 0.6},
    **{"position_sine": SINES[:, :3].tolist(), "position_cosine": COSINES[:, :3].tolist()},
    **{"orientation_sine": SINES[:, 3:].tolist(), "orientation_cosine": COSINES[:, 3:].tolist()},
}
# Jumps of position or acceleration are between these times.
TIMES = np.linspace(0.003, 2.997, 400)
X, Y, Z = np.eye(6)[:3]


def rise(share: FloatArray) -> FloatArray:
    """The quintic from 0 to 1."""
    s = np.clip(share, 0, 1)
    return np.asarray(10 * s**3 - 15 * s**4 + 6 * s**5)


def turns(cycles: FloatArray) -> FloatArray:
    return np.asarray(np.sin(2 * np.pi * cycles))


def sweep(t: FloatArray, f0: float, f1: float, T: float = 2.0) -> FloatArray:
    """Of the phase of a chirp, in cycles."""
    return np.where(t < T, f0 * t + (f1 - f0) * t**2 / (2 * T), (f0 + f1) / 2 * T + f1 * (t - T))


def series(t: FloatArray) -> FloatArray:
    terms = [(k + 1, sine, cosine) for k, (sine, cosine) in enumerate(zip(SINES, COSINES, strict=True))]
    window = rise(t / 0.6) * (1 - rise((t - 2.3) / 0.6))
    waves = [np.outer(turns(0.4 * k * t), a) + np.outer(turns(0.4 * k * t + 0.25), b) for k, a, b in terms]
    return np.asarray(window[:, None] * np.sum(waves, axis=0))


# Class, keys, and by the formula in its docstring what it adds to the pose (n, 6).
MOTIONS: dict[str, tuple[Any, dict[str, Any], Callable[[FloatArray], FloatArray]]] = {
    "hold": (gs.Hold, {}, lambda t: np.outer(0 * t, ALONG)),
    "step": (gs.Step, {**CHANGE, "at": 0.5}, lambda t: np.outer(t >= 0.5, ALONG)),
    "point to point": (
        gs.PointToPoint,
        {**CHANGE, "at": 0.5, "duration": 1.5},
        lambda t: np.outer(rise((t - 0.5) / 1.5), ALONG),
    ),
    "sine": (gs.Sine, {**AMPLITUDE, "frequency": 0.7}, lambda t: np.outer(turns(0.7 * t), ALONG)),
    "faded sine with phases": (
        gs.Sine,
        {**AMPLITUDE, **PHASES, "frequency": 0.7, "fade_in": 1.1},
        lambda t: (
            rise(t / 1.1)[:, None]
            * ALONG
            * np.sin(2 * np.pi * 0.7 * t[:, None] + 0.3 + np.array([0.5, 0, -1.0, 0, 0.5, 0.2]))
        ),
    ),
    "circle xy": (
        gs.Circle,
        {"radius": 0.2, "frequency": 0.7},
        lambda t: 0.2 * (np.outer(turns(0.7 * t + 0.25), X) + np.outer(turns(0.7 * t), Y)),
    ),
    "circle xz": (
        gs.Circle,
        {"radius": 0.2, "frequency": 0.7, "plane": "xz"},
        lambda t: 0.2 * (np.outer(turns(0.7 * t + 0.25), X) + np.outer(turns(0.7 * t), Z)),
    ),
    "faded circle yz": (
        gs.Circle,
        {"radius": 0.2, "frequency": 0.7, "plane": "yz", "fade_in": 1.1},
        lambda t: 0.2 * rise(t / 1.1)[:, None] * (np.outer(turns(0.7 * t + 0.25), Y) + np.outer(turns(0.7 * t), Z)),
    ),
    "chirp": (
        gs.Chirp,
        {**AMPLITUDE, "from_frequency": 0.2, "to_frequency": 1.5, "duration": 2.0},
        lambda t: np.outer(turns(sweep(t, 0.2, 1.5)), ALONG),
    ),
    "faded falling chirp": (
        gs.Chirp,
        {**AMPLITUDE, "from_frequency": 1.5, "to_frequency": 0.2, "duration": 2.0, "fade_in": 1.1},
        lambda t: np.outer(rise(t / 1.1) * turns(sweep(t, 1.5, 0.2)), ALONG),
    ),
    "excitation": (gs.Excitation, SERIES, series),
}
# The frequency that a motion has [Hz], the higher one of a chirp, the last one of a series.
HIGHEST = {**dict.fromkeys(("hold", "step", "point to point"), 0.0), "chirp": 1.5, "faded falling chirp": 1.5}
HIGHEST |= {"excitation": 0.8}


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize(("slow", "size"), [(1.0, 1.0), (1.3, -0.7)])
def test_a_motion_is_its_formula_with_its_derivatives(name: str, slow: float, size: float) -> None:
    """Expected: pose₀ + a f(t/s); central differences of it and of rotations; the highest frequency."""
    kind, keys, formula = MOTIONS[name]
    reference = kind(**POSE, **keys, time_scale=slow, amplitude_scale=size)
    time = slow * TIMES
    motion = reference(time)
    expected = np.concatenate([POSITION, ORIENTATION]) + size * formula(TIMES)
    np.testing.assert_allclose(np.hstack(motion[:2]), expected, rtol=0, atol=1e-13)
    for found, differences in zip(motion[2:], by_differences(reference, time), strict=True):
        np.testing.assert_allclose(found, differences, rtol=0, atol=2e-6)
    assert reference.highest_frequency == pytest.approx(HIGHEST.get(name, 0.7) / slow)


@pytest.mark.parametrize("name", MOTIONS)
def test_times_are_taken_as_users_have_them_and_motions_travel(name: str) -> None:
    """Expected: a list, whole numbers, no times at all; a copy in another process is the same motion."""
    kind, keys, _ = MOTIONS[name]
    reference = kind(**POSE, **keys)
    expected = reference(np.array([0.0, 1.0, 2.0]))
    copy = pickle.loads(pickle.dumps(reference))
    for same in (reference([0, 1, 2]), reference(np.array([0, 1, 2])), copy([0, 1, 2])):
        assert all(np.array_equal(a, b) for a, b in zip(same, expected, strict=True))
    assert [part.shape for part in reference(TIMES[:0])] == [(0, 3)] * 6


@pytest.mark.parametrize("name", [name for name in MOTIONS if "faded" in name or name in ("excitation", "step")])
def test_what_starts_softly_starts_in_its_pose_and_at_rest(name: str) -> None:
    """Expected: exactly."""
    kind, keys, _ = MOTIONS[name]
    start = kind(**POSE, **keys)(np.zeros(1))
    assert np.hstack(start).tolist() == [[*POSITION, *ORIENTATION, *np.zeros(12)]]


def test_jumps_are_on_the_later_side() -> None:
    """Expected: a step has jumped 1e-9 s before its time, not 2e-9 s; a chirp's frequency rests at its end itself."""
    at = gs.Step(**POSE, **CHANGE, at=0.2)(np.array([0.2 - 2e-9, 0.2 - 5e-10, 0.2]))
    assert (np.abs(at.position - POSITION).max(axis=1) > 0.1).tolist() == [False, True, True]
    chirp = gs.Chirp(**POSE, position_amplitude=[0, 0, 1], from_frequency=0.5, to_frequency=2.0, duration=1.5)
    end = -((2 * np.pi * 2.0) ** 2) * np.sin(np.pi * 2.5 * 1.5)
    assert chirp(np.array([1.5])).acceleration[0, 2] == pytest.approx(end)


def test_a_motion_without_a_pose_is_about_the_home_pose() -> None:
    """Expected: home in the part that is not named; the named part stays; without a platform a clear refusal."""
    home = {"home_position": [0.02, -0.03, 3.1], "home_orientation": [0.01, 0.04, -0.05]}
    platform = UNEVEN.with_parameters(home)
    cases: list[dict[str, Any]] = [{}, {"orientation": ORIENTATION}]
    for keys in cases:
        sine = gs.Sine(**AMPLITUDE, frequency=0.7, **keys)
        with pytest.raises(
            gs.GoughStewartError, match=r"^position is None; expected a position, or .*about\(platform\)"
        ):
            sine(TIMES)
        pose = {"position": platform.home_position, "orientation": platform.home_orientation, **keys}
        whole = gs.Sine(**AMPLITUDE, frequency=0.7, **pose)
        assert all(np.array_equal(a, b) for a, b in zip(sine.about(platform)(TIMES), whole(TIMES), strict=True))


def test_numbers_are_copied_stay_and_may_have_units() -> None:
    """Expected: 42 rpm = 0.7 Hz, 100 mm = 0.1 m, 180° = π; equal where all keys are, however they were written."""
    mine = POSITION.copy()
    hold = gs.Hold(position=mine, orientation=ORIENTATION)
    mine[:] = 7.0
    assert hold(TIMES).position[3].tolist() == POSITION.tolist()
    with pytest.raises(ValueError, match="frozen"):
        hold.position = mine
    assert hold == gs.Hold(position=POSITION.tolist(), orientation=ORIENTATION) != gs.Hold(**{**POSE, "position": mine})
    assert len({hold, gs.Hold(**POSE)}) == 1
    texts: Any = {"frequency": "42 rpm", "phase": "180 deg", "position_amplitude": ["100 mm", "20 cm", -0.3]}
    written = gs.Sine(**POSE, **{**AMPLITUDE, **texts})
    plain = gs.Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=np.pi)
    assert all(np.allclose(a, b, rtol=0, atol=1e-13) for a, b in zip(written(TIMES), plain(TIMES), strict=True))


@pytest.mark.parametrize(
    ("name", "key", "value", "message"),
    [
        ("hold", "position", [1, 2], r"position: is \[1, 2\]; expected a list of 3 \[m\]; found 2"),
        ("circle xy", "orientation", [0, 0, np.nan], "orientation: is .*nan.*; value 3 of 3: expected"),
        ("hold", "position", ["1 m", "2 deg", "3 m"], "position: .*value 2 of 3: .*found the unit 'deg'"),
        ("step", "position_change", [1j, 0, 0], "position_change: is .*; value 1 of 3: expected a number of m"),
        ("step", "orientation_change", 1.0, r"orientation_change: is 1.0; expected a list of 3 \[rad\]"),
        ("step", "at", 0.0, "at: is 0.0; expected > 0 s"),
        ("step", "type", "hold", "type: is 'hold'; expected 'step'"),
        ("point to point", "duration", 0, "duration: is 0; expected > 0 s"),
        ("sine", "frequency", "1 rad", "frequency: is '1 rad'; .*found the unit 'rad'"),
        ("sine", "phase", [0.0], r"phase: is \[0.0\]; expected a number of rad"),
        ("sine", "fade_in", -0.1, "fade_in: is -0.1; expected >= 0 s"),
        ("sine", "amplitude", 0.1, "amplitude: unknown key .= 0.1.; did you mean 'amplitude_scale'"),
        ("sine", "time_scale", 0.0, "time_scale: is 0.0; expected > 0"),
        ("circle xy", "time_scale", "2 s", "time_scale: is '2 s'; expected a number"),
        ("circle xy", "radius", 0.0, "radius: is 0.0; expected > 0 m"),
        ("circle xy", "plane", "yx", "plane: is 'yx'; expected 'xy', 'xz' or 'yz'"),
        ("chirp", "from_frequency", 0.0, "from_frequency: is 0.0; expected > 0 Hz"),
        ("excitation", "fade", 1.46, "fade is 1.46 s at either end of a duration of 2.9 s"),
        ("excitation", "orientation_cosine", [[0, 0, 0]],
         "position_sine 2, .*orientation_sine 2, orientation_cosine 1"),
    ],
)  # fmt: skip
def test_an_impossible_number_is_refused_by_name(name: str, key: str, value: object, message: str) -> None:
    kind, keys, _ = MOTIONS[name]
    with pytest.raises(gs.GoughStewartError, match=message) as caught:
        kind(**{**POSE, **keys, key: value})
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"type": "sine"}, r"^reference\.frequency: is missing; add it$"),
        ({"type": "sinus"}, r"^reference: type is 'sinus'; expected one of .*'sine'.*'circle'"),
        ({"frequency": 1}, r"^reference: the key type is missing; "),
        ({"type": "circle", "radius": 1, "frequency": 1, "plan": 3}, r"reference\.plan: unknown key .*mean 'plane'"),
    ],
)
def test_a_table_of_a_file_says_where_it_is_wrong(table: dict[str, Any], message: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=message):
        experiment(UNEVEN, table)

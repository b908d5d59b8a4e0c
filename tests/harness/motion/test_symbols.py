"""Motions of symbols, from which controllers are exported: the same numbers as motions of floats; excitation."""

from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.motion.limits.fitting import factor_near
from gough_stewart.harness.motion.limits.shares import Limited
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.motion.recorded.plausible_speed import check_speed
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.uneven import UNEVEN

SWING = gs.Excitation(
    frequency=0.4,
    duration=5.0,
    fade=1.2,
    position=(0.1, -0.2, 3.0),
    orientation=(0.05, -0.1, 0.2),
    position_sine=[[0.02, -0.03, 0.01], [0.004, 0.007, -0.006]],
    position_cosine=[[0.011, 0.013, -0.017], [-0.003, 0.002, 0.005]],
    orientation_sine=[[0.03, -0.02, 0.05], [0.006, 0.004, -0.007]],
    orientation_cosine=[[-0.021, 0.023, 0.029], [0.003, -0.009, 0.008]],
)


def _closed_form(time: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Pose by the sum of the class's docstring, term by term."""

    def rise(t: float) -> float:
        s = min(max(t / 1.2, 0), 1)
        return 10 * s**3 - 15 * s**4 + 6 * s**5

    series: Any = SWING
    rows = []
    for t in time:
        pose = np.array([0.1, -0.2, 3.0, 0.05, -0.1, 0.2])
        window = rise(t) * (1 - rise(t - 3.8))
        for k in range(2):
            angle = 2 * np.pi * (k + 1) * 0.4 * t
            a = np.array([*series.position_sine[k], *series.orientation_sine[k]])
            b = np.array([*series.position_cosine[k], *series.orientation_cosine[k]])
            pose = pose + window * (a * np.sin(angle) + b * np.cos(angle))
        rows.append(pose)
    return np.array(rows)


def test_an_excitation_is_its_series_with_exact_derivatives_from_rest_to_rest() -> None:
    """Expected: the series term by term; central differences of it; rest at both ends; the last harmonic."""
    reference: Reference = SWING
    time = np.linspace(0.013, 4.987, 90)
    motion, h = reference(time), 1e-4
    found = np.hstack([motion.position, motion.orientation])
    np.testing.assert_allclose(found, _closed_form(time), rtol=0, atol=1e-14)
    before, after = _closed_form(time - h), _closed_form(time + h)
    np.testing.assert_allclose(motion.velocity, (after - before)[:, :3] / (2 * h), rtol=0, atol=1e-6)
    second = (after - 2 * _closed_form(time) + before) / h**2
    np.testing.assert_allclose(motion.acceleration, second[:, :3], rtol=0, atol=1e-5)
    R = matrix_from_orientation(motion.orientation)
    rate = (matrix_from_orientation(after[:, 3:]) - matrix_from_orientation(before[:, 3:])) / (2 * h)
    spin = rate @ np.swapaxes(R, 1, 2)
    omega = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    np.testing.assert_allclose(motion.angular_velocity, omega, rtol=0, atol=1e-6)
    ends = reference(np.array([0.0, 5.0]))
    assert all(np.abs(part).max() < 1e-12 for part in ends[2:])
    assert SWING.highest_frequency == pytest.approx(0.8)
    slow = SWING.model_copy(update={"time_scale": 2.0})
    assert slow.highest_frequency == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fade": 2.6}, "fade is 2.6 s at either end of a duration of 5 s"),
        (
            {"orientation_cosine": [[0, 0, 0]]},
            "position_sine 2, position_cosine 2, orientation_sine 2, orientation_cosine 1",
        ),
    ],
)
def test_an_excitation_that_cannot_be_is_refused(change: dict[str, Any], message: str) -> None:
    values = {name: getattr(SWING, name) for name in type(SWING).model_fields if name in SWING.model_fields_set}
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.Excitation(**{**values, **change})
    assert gs.Excitation(**{**values, "fade": 2.5}).fade == 2.5


def test_the_first_value_beyond_names_row_leg_and_bounds() -> None:
    """Expected: by hand: the first row, then the first leg, on either side; one number without a leg."""
    values = np.full((4, 6), 0.5)
    values[2, 4], values[2, 5], values[3, 0] = 2.5, -9.0, 7.0
    many = Limited("stroke", "the length", "m", values, -1.25, 2.0)
    assert many.first_beyond == (2, 5, 2.5, "the length of leg 5 is 2.5 m; expected -1.25 to 2 m")
    assert many.within.sum() == 21
    below = Limited("stroke", "the length", "m", -values, -1.25, 2.0)
    assert below.first_beyond[:3] == (2, 5, -2.5)
    one = Limited("condition_number", "the number", "", np.array([1.0, 1.0, 3.0, 4.0]), 1.0, 2.0)
    assert one.first_beyond == (2, None, 3.0, "the number is 3; expected 1 to 2")
    same = Limited("side", "the side", "", np.array([1.0, -1.0]), 1.0, 1.0)
    assert same.first_beyond == (1, None, -1.0, "the side is -1; expected 1")
    np.testing.assert_array_equal(same.share, [0, np.inf])
    middle = Limited("stroke", "x", "m", np.array([1.0, 2.0, 3.0, 4.0, np.nan]), 1.0, 4.0, 2.5)
    np.testing.assert_allclose(middle.share, [1, 1 / 3, 1 / 3, 1, np.inf])
    lower = Limited("stroke", "x", "m", np.array([1.0, 2.0, 4.0]), 2.0, np.inf)
    np.testing.assert_allclose(lower.share, [2, 1, 0.5])


def _swing(duration: float, rate: float, amplitude: float, frequency: float) -> FromTable:
    time = np.arange(0, duration + 0.5 / rate, 1 / rate)
    heave = amplitude * np.sin(2 * np.pi * frequency * time)
    position = np.stack([0 * time, 0 * time, heave], axis=1)
    return FromTable(time, position, np.zeros_like(position))


@pytest.mark.parametrize(
    ("table", "unit", "guess"),
    [
        # r = √(9.81 · 0.2)/0.1 ω: 2230 at 1e-3 Hz; as milliseconds 2.2, with steps of 1 ms
        (_swing(2000.0, 1.0, 0.1, 1e-3), 1.0, "milliseconds"),
        # r = 11,000, and steps of 1200 s would be 1.2 s: too long; of 1000 s, 1.0 s
        (_swing(24000.0, 1 / 1200, 0.1, 1 / 5000), 1.0, None),
        (_swing(24000.0, 1 / 1000, 0.1, 1 / 5000), 1.0, "milliseconds"),
        # steps of 0.05 s would be 5e-5 s
        (_swing(2000.0, 20.0, 0.1, 1e-3), 1.0, None),
        # 90 s would be 0.09 s, too short; 110 s are enough: r is 7000 to 8000
        (_swing(90.0, 1.0, 0.05, 1 / 2250), 1.0, None),
        (_swing(110.0, 1.0, 0.05, 1 / 2250), 1.0, "milliseconds"),
        # read as milliseconds, though they were seconds: too fast
        (_swing(2.0, 500.0, 0.01, 2.0), 1e-3, "seconds"),
    ],
)
def test_a_unit_is_guessed_within_what_platforms_do_on_both_sides(
    table: FromTable, unit: float, guess: str | None
) -> None:
    """Expected: r, steps and duration in the other unit, calculated in the comments."""
    if unit == 1e-3:
        table = FromTable(1e-3 * table.time, table.position, table.orientation)
    if guess is None:
        check_speed(table, unit, 1.0)
        return
    with pytest.raises(gs.GoughStewartError, match=f"times look like {guess}"):
        check_speed(table, unit, 1.0)


@pytest.mark.parametrize("guess", [3 * (1 - 1e-6), 3 * (1 + 1e-6), 2.9, 3.1, 1.7, 4.4])
@pytest.mark.parametrize("power", [0.6, 2.0])
def test_a_factor_is_found_near_a_guess_without_looking_far(guess: float, power: float) -> None:
    """Expected: (3/x)^p = 1 at x = 3; nothing is evaluated farther from it than a few times the guess is."""
    asked: list[float] = []

    def share(x: float) -> float:
        asked.append(x)
        return float((3 / x) ** power)

    found = factor_near(share, guess)
    assert found == pytest.approx(3, rel=2e-7)
    assert share(found) <= 1
    far = 6 * abs(guess - 3) + 1e-4
    assert 3 - far <= min(asked)
    assert max(asked) <= 3 + far


def test_poses_of_a_path_may_be_lists_or_arrays_of_numbers_or_quantities() -> None:
    """Expected: the same rows; a margin or a ramp alone needs the fastest timing."""
    rows = [[0.1, 0.2, 3.0, 0.0, 0.1, -0.2], [0.0, -0.3, 2.9, 0.2, 0.0, 0.3]]
    given: list[Any] = [
        rows,
        np.array(rows),
        [np.array(row) for row in rows],
        [tuple(row) for row in rows],
        [["100 mm", "20 cm", 3.0, 0.0, "100 mrad", -0.2], rows[1]],
    ]
    for poses in given:
        path = gs.ViaPath(poses=poses, timing=1.5)
        assert path.poses == [pytest.approx(tuple(row)) for row in rows]
    options: list[dict[str, Any]] = [{"margin": 0.1}, {"ramp": 0.1}]
    for alone in options:
        with pytest.raises(gs.GoughStewartError, match="margin and ramp need timing = 'fastest'"):
            gs.ViaPath(poses=rows, timing=1.5, **alone)
        assert gs.ViaPath(poses=rows, timing="fastest", **alone).timing == "fastest"


@pytest.mark.parametrize(("slow", "size"), [(2.0, 2.0), (2.0, 1.0), (1.0, 2.0), (0.5, -0.3)])
def test_a_table_is_scaled_in_time_and_size_alike_or_not(slow: float, size: float) -> None:
    """Expected: rows by hand, about the pose at time 0; unchanged only if both scales are 1."""
    time = np.linspace(-0.4, 1.1, 16)
    pose = np.stack([np.sin((k + 1) * time) / (k + 2) for k in range(6)], axis=1)
    table = FromTable(time, pose[:, :3] + 0.1, pose[:, 3:] - 0.2)
    found = table.scaled(slow, size)
    centre = table(np.zeros(1))
    np.testing.assert_allclose(found.time, slow * time)
    np.testing.assert_allclose(found.position, centre.position + size * (table.position - centre.position), atol=1e-15)
    turned = centre.orientation + size * (table.orientation - centre.orientation)
    np.testing.assert_allclose(found.orientation, turned, atol=1e-15)
    assert table.scaled(1.0, 1.0) is table
    assert table.from_time(0.0) is table
    np.testing.assert_allclose(table.from_time(0.3).time, time - 0.3)
    np.testing.assert_array_equal(table.from_time(0.3).position, table.position)


@pytest.mark.parametrize("order", [[1, 2], [2, 1]])
def test_the_first_pose_that_is_out_of_reach_is_named_whatever_its_fault(order: list[int]) -> None:
    """Expected: pose 2, whether it is the one too far away or the one turned too far."""
    home = [*UNEVEN.home_position.tolist(), *UNEVEN.home_orientation.tolist()]
    far, turned = [*home[:2], 4.3, *home[3:]], [*home[:5], 1.4]
    poses = [home, *([far, turned][k - 1] for k in order)]
    fault = {1: "the length of leg", 2: "the (angle|condition|length)"}[order[0]]
    with pytest.raises(gs.GoughStewartError, match=f"pose 2 of the path cannot be reached: {fault}"):
        gs.ViaPath(poses=poses, timing=2.0).about(UNEVEN)

"""The filter of references by hand: its linear answer, its limits, and its rest."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.arrays import FloatArray
from tests.support.motions import motion_of, write_table
from tests.support.uneven import UNEVEN

NAMES = ("time", "x", "y", "z", "roll", "pitch", "yaw", "jumps")
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
BEGIN = 0.5  # when the hand takes over [s]
OMEGA = 2 * np.pi * 1.5


def moved(folder: Path, by: FloatArray, time: Any, period: float, *jumps: tuple[float, FloatArray]) -> Any:
    """A hold whose pose a hand moves, at times after the hand has taken over; targets that jump come later."""
    rows = [(BEGIN, *(HOME + by), 0.0), *((BEGIN + at, *(HOME + target), 1.0) for at, target in jumps)]
    write_table(folder / "targets.csv", dict(zip(NAMES, map(list, zip(*rows, strict=True)), strict=True)))
    keys: dict[str, Any] = {"file": "targets.csv", "motion": {"type": "hold"}, "sample_time": period}
    return motion_of(UNEVEN, folder, type="by_hand", **keys)(BEGIN + time)


def test_a_small_target_is_followed_by_three_equal_poles(tmp_path: Path) -> None:
    """Expected: 1 − e^(−ωt)(1 + ωt + (ωt)²/2), the answer of 1/(s/ω + 1)³, but for the period's hold."""
    time, by = 1e-3 * np.arange(900), np.array([1e-3, -2e-3, 3e-3, 2e-3, -1e-3, 4e-3])
    motion, t = moved(tmp_path, by, time, 1e-4), OMEGA * time
    expected = HOME + np.outer(1 - np.exp(-t) * (1 + t + t**2 / 2), by)
    assert np.abs(np.hstack(motion[:2]) - expected).max() < 2e-3 * 4e-3
    assert motion.velocity == pytest.approx(np.outer(OMEGA * np.exp(-t) * t**2 / 2, by[:3]), abs=2e-4)


@pytest.mark.parametrize("size", [0.05, -0.2, 0.5])
def test_limits_hold_rates_are_integrals_and_it_comes_to_rest(size: float, tmp_path: Path) -> None:
    """Expected: 2 m/s², a tenth beyond 0.3 m/s or 0.5 rad/s at most; integrals, also between samples; rest at last."""
    h = 0.01
    motion = moved(tmp_path, size * np.eye(6)[2], h * np.arange(1200), h)
    value, rate, acceleration = motion.position[:, 2], motion.velocity[:, 2], motion.acceleration[:, 2]
    assert np.abs(acceleration).max() <= 2.0 * (1 + 1e-12)
    assert np.abs(rate).max() <= 1.1 * 0.3
    assert (np.abs(rate).max() > 0.29) == (abs(size) > 0.1)
    assert np.diff(rate) == pytest.approx(h * (acceleration[1:] + acceleration[:-1]) / 2, abs=1e-12)
    steps = h * rate[:-1] + h**2 * (acceleration[:-1] / 3 + acceleration[1:] / 6)
    assert np.diff(value) == pytest.approx(steps, abs=1e-12)
    assert [value[-1], rate[-1], acceleration[-1]] == pytest.approx([HOME[2] + size, 0, 0], abs=1e-6)
    assert np.abs(value - HOME[2]).max() <= abs(size) * 1.1
    later, dt = moved(tmp_path, size * np.eye(6)[2], h * np.arange(1200) + 0.006, h), 0.006
    assert later.position[:, 2] == pytest.approx(value + dt * rate + dt**2 / 2 * acceleration, abs=1e-12)
    fastest = np.abs(np.diff(moved(tmp_path, size * np.eye(6)[4], h * np.arange(99), h).orientation[:, 1])).max() / h
    assert fastest <= 1.1 * 0.5
    assert (fastest > 0.9 * 0.5) == (abs(size) > 0.1)


def test_a_target_that_jumps_takes_the_filter_with_it(tmp_path: Path) -> None:
    """Expected: from its sample on the motion without the jump, moved as far; two jumps add up."""
    time, by = 0.01 * np.arange(60), np.array([0.02, -0.01, 0.03, 0.02, -0.01, 0.04])
    first, second = 3 * by[::-1], np.array([-0.1, 0.2, 0.0, 0.1, 0.0, -0.2])
    still = moved(tmp_path, by, time, 0.01)
    motion = moved(tmp_path, by, time, 0.01, (0.2, by + first), (0.35, by + first + second))
    shift = np.outer(time > 0.195, first) + np.outer(time > 0.345, second)
    assert np.hstack(motion[:2]) == pytest.approx(np.hstack(still[:2]) + shift, abs=1e-12)
    assert motion.velocity == pytest.approx(still.velocity, abs=1e-12)

"""Readings signal by signal: independent noise of its own size, rounded afterwards."""

import numpy as np
import pytest

from gough_stewart.harness.loop.sensors import Readings, Sensors
from gough_stewart.harness.plants import signals

N = 4000
SIGMAS = {v.name: 1e-3 * (k + 1) for k, v in enumerate(signals.VARIABLES)}
TRUE = np.linspace(-1.3, 2.9, signals.SIZE)


def readings(sensors: Sensors) -> np.ndarray:
    """(N, 24) of a signal that stands still."""
    read = Readings(sensors, N)
    return np.array([read(k, TRUE) for k in range(N)])


def test_every_element_has_a_noise_of_its_own() -> None:
    """Expected: independent columns: no correlation beyond five standard errors, 1/√n, and σ within five of σ/√(2n)."""
    noise = readings(Sensors(SIGMAS)) - TRUE
    between = np.corrcoef(noise.T) - np.eye(signals.SIZE)
    assert np.abs(between).max() < 5 / np.sqrt(N)
    sigma = np.concatenate([np.full(v.size, SIGMAS[v.name]) for v in signals.VARIABLES])
    assert np.abs(noise.std(axis=0) / sigma - 1).max() < 5 / np.sqrt(2 * N)


@pytest.mark.parametrize("name", SIGMAS)
def test_noise_on_one_signal_leaves_the_others_alone(name: str) -> None:
    """Expected: by definition; each signal's noise is the same with and without noise on the others."""
    every, alone = readings(Sensors(SIGMAS, seed=3)), readings(Sensors({name: SIGMAS[name]}, seed=3))
    has_noise = (alone != TRUE).all(axis=0)
    assert has_noise.sum() == next(v.size for v in signals.VARIABLES if v.name == name)
    assert np.array_equal(alone[:, has_noise], every[:, has_noise])
    assert (alone[:, ~has_noise] == TRUE[~has_noise]).all()


def test_what_is_read_is_rounded_with_its_noise() -> None:
    """Expected: whole steps, though the noise is none; on average the true value, as noise above a step dithers it."""
    step = {name: 0.8 * sigma for name, sigma in SIGMAS.items()}
    read = readings(Sensors(SIGMAS, step))
    steps = np.concatenate([np.full(v.size, step[v.name]) for v in signals.VARIABLES])
    assert np.abs(read / steps - np.round(read / steps)).max() < 1e-9
    assert len(np.unique(np.round(read[:, 0] / steps[0]))) > 5
    deviation = np.sqrt(1.25**2 + 1 / 12) * steps
    assert (np.abs(read.mean(axis=0) - TRUE) < 5 * deviation / np.sqrt(N)).all()

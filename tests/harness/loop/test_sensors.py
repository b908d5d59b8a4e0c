"""Noise and quantisation of a run's readings."""

import numpy as np
import pytest

from gough_stewart.harness.loop.loop import Sensors
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray
from tests.support.loops import constant, loop_of, run_with

COLUMNS = {name: signals.positions([name]) for name in signals.NAMES}


def read(sensors: Sensors, samples: int = 400) -> tuple[FloatArray, FloatArray]:
    """What is measured at the samples (n, 24) of a motion, and the truth."""
    run = run_with(constant(), loop_of(samples * 2e-3, 2e-3, 2e-3, sensors=sensors))
    return run.measured, run.results[:-1, : signals.SIZE]


def test_without_noise_and_steps_the_truth_is_measured() -> None:
    for sensors in (Sensors(), Sensors({"position": 0.0}, {"leg_length": 0.0})):
        measured, true = read(sensors)
        np.testing.assert_array_equal(measured, true)


@pytest.mark.parametrize(("name", "step"), [("leg_length", 1e-3), ("orientation", 0.3), ("leg_velocity", 2e-2)])
def test_quantised_signals_are_the_nearest_multiples(name: str, step: float) -> None:
    """Expected: the definition of rounding to a step; other signals are exact."""
    measured, true = read(Sensors(quantisation={name: step}))
    at = COLUMNS[name]
    steps, error = measured[:, at] / step, np.abs(measured[:, at] - true[:, at])
    assert np.abs(steps - np.round(steps)).max() < 1e-9
    assert 0.45 * step < error.max() <= 0.5 * step * (1 + 1e-9)
    np.testing.assert_array_equal(np.delete(measured, at, axis=1), np.delete(true, at, axis=1))


def test_noise_comes_before_quantisation() -> None:
    """Expected: an encoder has only its steps, and noise of two of them moves it by some."""
    step = {"leg_length": 1e-3, "position": 2e-3}
    noise = {"leg_length": 2e-3, "position": 4e-3}
    (both, true), (noisy, _) = read(Sensors(noise, step, seed=4)), read(Sensors(noise, seed=4))
    for name, q in step.items():
        at = COLUMNS[name]
        assert both[:, at] == pytest.approx(q * np.rint(noisy[:, at] / q), abs=1e-15)
        assert (np.abs(both[:, at] - true[:, at]) > q).any()

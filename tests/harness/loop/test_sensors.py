"""Noise and quantisation: their definition, streams that know nothing of each other, the same seed the same bytes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gough_stewart.harness.loop.sensors import Readings, Sensors
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray

TRUE = np.random.default_rng(1).uniform(-2, 2, (400, signals.SIZE))
DEVIATIONS = {
    "position": 1e-3,
    "orientation": 2e-3,
    "velocity": 5e-3,
    "angular_velocity": 3e-3,
    "leg_length": 4e-4,
    "leg_velocity": 7e-3,
}
COLUMNS = {name: signals.positions([name]) for name in signals.NAMES}


def measured(sensors: Sensors, true: FloatArray = TRUE) -> FloatArray:
    readings = Readings(sensors)
    return np.array([readings(k, row[None])[0].copy() for k, row in enumerate(true)])


def test_without_noise_and_steps_the_truth_is_measured() -> None:
    assert (measured(Sensors()) == TRUE).all()
    assert (measured(Sensors({"position": 0.0}, {"leg_length": 0.0})) == TRUE).all()


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32))
def test_the_same_seed_gives_the_same_bytes_and_another_one_other_numbers(seed: int) -> None:
    one = measured(Sensors(DEVIATIONS, seed=seed))
    assert measured(Sensors(DEVIATIONS, seed=seed)).tobytes() == one.tobytes()
    assert (measured(Sensors(DEVIATIONS, seed=seed + 1)) != one).all()


def test_noise_has_its_standard_deviation_in_every_element() -> None:
    """Expected: within five standard errors, σ/√(2n) of a deviation and σ/√n of a mean; 24 different elements."""
    n = 4000
    noise = measured(Sensors(DEVIATIONS), np.zeros((n, signals.SIZE)))
    sigma = np.concatenate([np.full(len(COLUMNS[name]), DEVIATIONS[name]) for name in signals.NAMES])
    assert (np.abs(noise.std(axis=0) - sigma) < 5 * sigma / np.sqrt(2 * n)).all()
    assert (np.abs(noise.mean(axis=0)) < 5 * sigma / np.sqrt(n)).all()


def test_no_element_and_no_row_has_the_noise_of_another() -> None:
    """Expected: correlations of independent numbers, at most five standard errors 1/√n; rows one later, too."""
    n = 4000
    noise = measured(Sensors(DEVIATIONS), np.zeros((n, signals.SIZE)))
    both = np.concatenate([noise[:-1], noise[1:]], axis=1)
    assert np.abs(np.corrcoef(both.T) - np.eye(48)).max() < 5 / np.sqrt(n)


@pytest.mark.parametrize("name", signals.NAMES)
def test_noise_on_a_signal_leaves_the_others_as_they_are(name: str) -> None:
    """Expected: with this one alone its noise is the same as with all, and all others are exact."""
    together, alone = (measured(Sensors(each, seed=7)) for each in (DEVIATIONS, {name: DEVIATIONS[name]}))
    assert alone[:, COLUMNS[name]].tobytes() == together[:, COLUMNS[name]].tobytes()
    others = np.setdiff1d(np.arange(signals.SIZE), COLUMNS[name])
    assert (alone[:, others] == TRUE[:, others]).all()
    assert (alone[:, COLUMNS[name]] != TRUE[:, COLUMNS[name]]).all()


@pytest.mark.parametrize(("name", "step"), [("leg_length", 1e-3), ("orientation", 0.3), ("leg_velocity", 2e-2)])
def test_quantised_signals_are_the_nearest_multiples(name: str, step: float) -> None:
    """Expected: the definition of rounding to a step; other signals are exact."""
    found = measured(Sensors(quantisation={name: step}))
    at = COLUMNS[name]
    assert np.abs(found[:, at] / step - np.round(found[:, at] / step)).max() < 1e-9
    assert np.abs(found[:, at] - TRUE[:, at]).max() <= 0.5 * step * (1 + 1e-9)
    assert np.abs(found[:, at] - TRUE[:, at]).max() > 0.45 * step
    others = np.setdiff1d(np.arange(signals.SIZE), at)
    assert (found[:, others] == TRUE[:, others]).all()


def test_noise_comes_before_quantisation() -> None:
    """Expected: an encoder has only its steps, and noise of two of them moves it by some."""
    step = {"leg_length": 1e-3, "position": 2e-3}
    noise = {"leg_length": 2e-3, "position": 4e-3}
    both, noisy = measured(Sensors(noise, step, seed=4)), measured(Sensors(noise, seed=4))
    for name, q in step.items():
        at = COLUMNS[name]
        assert both[:, at] == pytest.approx(q * np.rint(noisy[:, at] / q), abs=1e-15)
        assert (np.abs(both[:, at] - TRUE[:, at]) > q).any()


def test_readings_keep_the_truth() -> None:
    """Expected: what is handed in stays as it was."""
    true = TRUE[:1].copy()
    Readings(Sensors(DEVIATIONS, {"leg_length": 0.1}))(0, true)
    assert (true == TRUE[:1]).all()

"""The filter of references by hand: its linear answer, its limits, and its rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

from gough_stewart.harness.control.smoothing import Smoothing
from tests.support.arrays import FloatArray


def path(target: FloatArray, steps: int, period: float, **values: float) -> FloatArray:
    """Value, rate and acceleration (steps + 1, 3, n), from rest at zero."""
    c = Smoothing.prepare(values, period)
    states = Smoothing.start(c, (0 * target,))
    found = [states]
    for _ in range(steps):
        states, _outputs = Smoothing.step(c, states, (target,))
        found.append(states)
    return np.array(found)


def test_a_small_step_is_followed_by_three_equal_poles() -> None:
    """Expected: 1 − e^(−ωt)(1 + ωt + (ωt)²/2), the answer of 1/(s/ω + 1)³, but for the period's hold."""
    period, omega = 1e-4, 2 * np.pi * 1.3
    found = path(np.array([0.01, -0.02]), 8000, period, bandwidth=1.3, largest_rate=50.0, largest_acceleration=500.0)
    t = omega * period * np.arange(8001)
    expected = 1 - np.exp(-t) * (1 + t + t**2 / 2)
    assert np.abs(found[:, 0] / [0.01, -0.02] - expected[:, None]).max() < 2e-3


def test_value_and_rate_are_integrals_of_the_acceleration() -> None:
    """Expected: the antiderivatives of a spline of degree 1 through the accelerations."""
    period = 0.01
    found = path(np.array([0.4]), 120, period, bandwidth=0.9, largest_rate=0.2, largest_acceleration=0.8)[..., 0]
    times = period * np.arange(121)

    rate = make_interp_spline(times, found[:, 2], k=1).antiderivative()
    assert found[:, 1] == pytest.approx(rate(times), abs=1e-12)
    assert found[:, 0] == pytest.approx(rate.antiderivative()(times), abs=1e-12)
    assert found[-1, 1] > 0.1


@settings(max_examples=12)
@given(st.floats(-3, 3), st.floats(0.2, 4), st.floats(0.5, 2), st.floats(1, 20), st.sampled_from([4e-3, 1e-2]))
def test_limits_hold_and_it_comes_to_rest(
    target: float, bandwidth: float, rate: float, strength: float, period: float
) -> None:
    """Expected: no acceleration beyond its limit; rates a tenth beyond theirs at most; rest in the target."""
    most = strength * rate * 2 * np.pi * bandwidth / 3  # so that it can brake in time
    duration = abs(target) / rate + 30 / bandwidth
    found = path(
        np.array([target]), round(duration / period), period,
        bandwidth=bandwidth, largest_rate=rate, largest_acceleration=most,
    )[..., 0]  # fmt: skip
    assert np.abs(found[:, 2]).max() <= most * (1 + 1e-12)
    assert np.abs(found[:, 1]).max() <= 1.1 * rate
    assert found[-1] == pytest.approx([target, 0, 0], abs=1e-6)
    assert np.abs(found[:, 0]).max() <= abs(target) * 1.1 + 1e-9

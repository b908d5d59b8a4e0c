"""Time laws against differences, their ends, and numerical averages."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

from gough_stewart.harness.motion.paths.time_law import Averaged, Quintic, Stepwise, Stretched, TimeLaw

GRID = np.array([0.0, 0.03, 0.2, 0.34, 0.61, 0.93, 1.0])
STEPWISE = Stepwise(GRID, np.array([0.0, 0.4, 0.9, 0.5, 0.8, 0.3, 0.0]))
LAWS = [Quintic(2.3), STEPWISE, Averaged(STEPWISE, 0.17), Stretched(Averaged(STEPWISE, 0.17), 1.3)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_goes_from_rest_to_rest(law: TimeLaw) -> None:
    at = law(np.array([-1.0, 0.0, law.duration + 1e-9, law.duration + 5]))
    assert_allclose(at.value, [0, 0, 1, 1], atol=1e-12)
    assert_allclose(at.rate[[0, 1, 3]], 0, atol=1e-12)
    assert_allclose(at.acceleration[[0, 2, 3]], 0, atol=1e-6)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_rates_are_those_of_the_values_between_knots(law: TimeLaw) -> None:
    h, knots = 1e-6, law.knots
    time = (knots[:-1] + np.diff(knots) * 0.37)[np.diff(knots) > 1e-4]
    before, at, after = law(time - h), law(time), law(time + h)
    assert_allclose((after.value - before.value) / (2 * h), at.rate, atol=1e-8)
    assert_allclose((after.rate - before.rate) / (2 * h), at.acceleration, atol=1e-7)


def test_on_a_grid_squared_rates_are_met() -> None:
    at = STEPWISE(STEPWISE.knots)
    assert_allclose(at.value, GRID, atol=1e-12)
    assert_allclose(at.rate**2, STEPWISE.squared_rate, atol=1e-12)


def test_an_average_is_the_mean_over_its_window() -> None:
    average = Averaged(STEPWISE, 0.17)
    for time in (0.05, 0.4, 1.1, average.duration - 0.02):
        window = np.linspace(time - 0.17, time, 20001)
        assert average(np.array([time])).value[0] == pytest.approx(trapezoid(STEPWISE(window).value, window) / 0.17)
    assert average.duration == pytest.approx(STEPWISE.duration + 0.17)


def test_an_average_does_not_jump() -> None:
    average, h = Averaged(STEPWISE, 0.17), 1e-7
    jumps = np.abs(np.diff(STEPWISE(STEPWISE.knots).acceleration)).max()
    for knot in average.knots:
        both = average(np.array([knot - h, knot + h])).acceleration
        assert abs(both[1] - both[0]) < 2 * h / 0.17 * 10 * jumps

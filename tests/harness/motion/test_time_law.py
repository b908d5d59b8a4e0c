"""Time laws against differences, their ends, and numerical averages; the largest share of a limit at any time."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

from gough_stewart.harness.motion.limits.shares import shares_along
from gough_stewart.harness.motion.paths.fastest import DynamicLimits, largest_share
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.time_law import (
    Averaged,
    Quintic,
    Stepwise,
    Stretched,
    TimedPath,
    TimeLaw,
    polynomials_of,
)
from tests.harness.motion.forces import actuator_forces, pose_along
from tests.support.lagrangian import legs_along
from tests.support.uneven import UNEVEN

GRID = np.array([0.0, 0.03, 0.2, 0.34, 0.61, 0.93, 1.0])
STEPWISE = Stepwise(GRID, np.array([0.0, 0.4, 0.9, 0.5, 0.8, 0.3, 0.0]))
LAWS = [Quintic(2.3), STEPWISE, Averaged(STEPWISE, 0.17), Stretched(Averaged(STEPWISE, 0.17), 1.3)]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_goes_from_rest_to_rest_with_its_derivatives(law: TimeLaw) -> None:
    """Expected: 0 before and 1 after; central differences between the knots."""
    at = law(np.array([-1.0, 0.0, law.duration + 1e-9, law.duration + 5]))
    assert_allclose(at.value, [0, 0, 1, 1], atol=1e-12)
    assert_allclose(at.rate[[0, 1, 3]], 0, atol=1e-12)
    assert_allclose(at.acceleration[[0, 2, 3]], 0, atol=1e-6)
    h, knots = 1e-6, law.knots
    time = (knots[:-1] + np.diff(knots) * 0.37)[np.diff(knots) > 1e-4]
    before, at, after = law(time - h), law(time), law(time + h)
    assert_allclose((after.value - before.value) / (2 * h), at.rate, atol=1e-8)
    assert_allclose((after.rate - before.rate) / (2 * h), at.acceleration, atol=1e-7)


def test_on_a_grid_squared_rates_are_met_and_an_average_is_the_mean_over_its_window() -> None:
    """Expected: the grid itself; the trapezoidal rule over the window; accelerations without jumps."""
    at = STEPWISE(STEPWISE.knots)
    assert_allclose(at.value, GRID, atol=1e-12)
    assert_allclose(at.rate**2, STEPWISE.squared_rate, atol=1e-12)
    average, h = Averaged(STEPWISE, 0.17), 1e-7
    for time in (0.05, 0.4, 1.1, average.duration - 0.02):
        window = np.linspace(time - 0.17, time, 20001)
        assert average(np.array([time])).value[0] == pytest.approx(trapezoid(STEPWISE(window).value, window) / 0.17)
    assert average.duration == pytest.approx(STEPWISE.duration + 0.17)
    jumps = np.abs(np.diff(at.acceleration)).max()
    for knot in average.knots:
        both = average(np.array([knot - h, knot + h])).acceleration
        assert abs(both[1] - both[0]) < 2 * h / 0.17 * 10 * jumps


NONE = DynamicLimits(*np.full((4, 6), np.inf))
POSITION = np.array([[0.1, -0.1, 2.9], [0.15, 0.1, 2.95], [-0.1, 0.0, 2.8]])
ORIENTATION = np.array([[0.05, -0.02, 0.1], [-0.05, 0.1, -0.1], [0.1, 0.0, 0.2]])
# coarse pieces, so that much happens between their ends
SHARP = Stepwise(np.linspace(0, 1, 8), np.array([0.0, 0.05, 0.08, 0.06, 0.09, 0.07, 0.05, 0.0]))
LIMITS: dict[str, Any] = {"velocity": 0.3, "acceleration": 2.0, "force": 150.0, "power": 40.0}
NAMES = dict(
    zip(LIMITS, ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max"), strict=True)
)


@pytest.mark.parametrize("law", [Quintic(1.7), SHARP, Averaged(SHARP, 0.2)], ids=lambda law: type(law).__name__)
def test_the_largest_share_is_that_of_dense_rows(law: TimeLaw) -> None:
    """Expected: the largest share of some thousand rows, the ends and knots densest."""
    motion = polynomials_of(TimedPath(GeometricPath(POSITION, ORIENTATION, 0.7), law))
    platform = replace(UNEVEN, **{NAMES[name]: most for name, most in LIMITS.items()})
    knots = np.append(motion.begins, motion.end)
    near = np.concatenate([knots + side * 10.0**-power for side in (-1, 1) for power in (4, 6, 9)])
    time = np.clip(np.concatenate([np.linspace(0, motion.end, 6001), near]), 0, motion.end)
    shares = shares_along(platform, time, motion(time)).of
    for name, most in LIMITS.items():
        dense = shares[NAMES[name]].max()
        largest = largest_share(platform, motion, NONE._replace(**{name: np.full(6, most)}))
        assert dense - 1e-9 <= largest <= dense + 2e-4


def test_coulomb_friction_within_one_piece_is_seen() -> None:
    """Expected: a Lagrangian's force in the last instant of a lowering; friction helps braking until then."""
    platform = replace(UNEVEN, leg_coulomb_friction=40.0, leg_friction_velocity=1e-3)
    path = GeometricPath(np.array([[0, 0, 2.9], [0, 0, 2.7]]), np.zeros((2, 3)), 1.0)
    motion = polynomials_of(TimedPath(path, Stepwise(np.array([0.0, 0.5, 1.0]), np.array([0.0, 3.0, 0.0]))))
    pose = pose_along(motion, motion.end - np.array([1e-3, 1e-12]))
    earlier, last = np.abs(actuator_forces(platform, pose, legs_along(platform, pose)[1])).max(axis=1)
    assert last > earlier + 10
    assert largest_share(platform, motion, NONE._replace(force=np.ones(6))) == pytest.approx(last, rel=1e-9)

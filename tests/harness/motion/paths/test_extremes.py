"""The largest share at any time against closed forms, dense rows, and a leg that turns between two rows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from gough_stewart.harness.motion.limits.shares import shares_along
from gough_stewart.harness.motion.paths.fastest import largest_share
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.polynomials import Polynomials, polynomials_of
from gough_stewart.harness.motion.paths.time_law import Averaged, Quintic, Stepwise, TimedPath, TimeLaw
from gough_stewart.harness.motion.paths.time_optimal import DynamicLimits
from tests.support.forces import forces_by_newton_euler
from tests.support.uneven import UNEVEN

NONE = DynamicLimits(*np.full((4, 6), np.inf))
POSITION = np.array([[0.1, -0.1, 2.9], [0.15, 0.1, 2.95], [-0.1, 0.0, 2.8]])
ORIENTATION = np.array([[0.05, -0.02, 0.1], [-0.05, 0.1, -0.1], [0.1, 0.0, 0.2]])
PATH = GeometricPath(POSITION, ORIENTATION, 0.7)
# coarse pieces, so that much happens between their ends
SHARP = Stepwise(np.linspace(0, 1, 8), np.array([0.0, 0.05, 0.08, 0.06, 0.09, 0.07, 0.05, 0.0]))
LAWS: dict[str, TimeLaw] = {"quintic": Quintic(1.7), "sharp": SHARP, "averaged": Averaged(SHARP, 0.2)}
LIMITED = replace(
    UNEVEN, leg_velocity_max=0.3, leg_acceleration_max=2.0, actuator_force_max=150.0, actuator_power_max=40.0
)


def lift(duration: float) -> Polynomials:
    """A lift of the platform by the quintic time law."""
    path = GeometricPath(np.array([[0, 0, 2.6], [0, 0, 3.1]]), np.zeros((2, 3)), 1.0)
    return polynomials_of(TimedPath(path, Quintic(duration)))


def test_the_largest_leg_velocity_of_a_lift_is_that_of_its_closed_form() -> None:
    # leg i of a lift: L = √(d² + (z + e)²), L̇ = (z + e) ż/L, z by the quintic
    offset = UNEVEN.platform_points - UNEVEN.base_points
    T, start, by = 1.3, 2.6, 0.5

    def speed(tau: float, leg: int) -> float:
        z = start + by * (10 * tau**3 - 15 * tau**4 + 6 * tau**5) + offset[leg, 2]
        rate = by * 30 * tau**2 * (1 - tau) ** 2 / T
        return float(z * rate / np.sqrt(offset[leg, 0] ** 2 + offset[leg, 1] ** 2 + z**2))

    peaks = [
        -minimize_scalar(lambda tau, leg=leg: -speed(tau, leg), (0.3, 0.5, 0.7), tol=1e-14).fun for leg in range(6)
    ]
    largest = largest_share(UNEVEN, lift(T), NONE._replace(velocity=np.full(6, 0.2)))
    assert largest == pytest.approx(max(peaks) / 0.2, abs=2e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("limit", DynamicLimits._fields)
def test_the_largest_share_is_that_of_dense_rows(law: str, limit: str) -> None:
    """Expected: the largest share of 40,000 rows by `shares_along`, the ends and knots densest."""
    motion = polynomials_of(TimedPath(PATH, LAWS[law]))
    name = ("leg_" if limit in ("velocity", "acceleration") else "actuator_") + f"{limit}_max"
    most = getattr(LIMITED, name)
    knots = np.append(motion.begins, motion.last)
    near = np.concatenate([knots + side * 10.0**-power for side in (-1, 1) for power in range(4, 10)])
    time = np.clip(np.concatenate([np.linspace(0, motion.end, 20_001), near]), 0, motion.end)
    dense = shares_along(LIMITED, time, motion(time)).of[name].max()
    largest = largest_share(LIMITED, motion, NONE._replace(**{limit: most}))
    assert dense - 1e-9 <= largest <= dense + 2e-5


def test_coulomb_friction_within_one_piece_is_seen() -> None:
    """Expected: the force by Newton–Euler in the last instant of a lowering; friction helps braking until then."""
    platform = replace(UNEVEN, leg_coulomb_friction=40.0, leg_friction_velocity=1e-3)
    path = GeometricPath(np.array([[0, 0, 2.9], [0, 0, 2.7]]), np.zeros((2, 3)), 1.0)
    motion = polynomials_of(TimedPath(path, Stepwise(np.array([0.0, 0.5, 1.0]), np.array([0.0, 3.0, 0.0]))))
    largest = largest_share(platform, motion, NONE._replace(force=np.ones(6)))
    earlier, last = np.abs(forces_by_newton_euler(platform, motion, motion.end - np.array([1e-3, 0.0]))).max(axis=1)
    assert last > earlier + 10
    assert largest == pytest.approx(last, rel=1e-9)

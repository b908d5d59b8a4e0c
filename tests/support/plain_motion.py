"""Motions of a platform by the tests' Lagrangian under SciPy's DOP853: neither equations nor integration are ours."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from gough_stewart import Platform
from tests.support.documented_loop import accelerations, twist_of_rates
from tests.support.lagrangian import FloatArray


def trajectory(
    platform: Platform,
    start: FloatArray,
    inputs: Callable[[float], FloatArray],
    times: FloatArray,
    tolerance: float = 1e-11,
) -> FloatArray:
    """Pose and twist (n, 12) at times, from the first of them on; inputs are forces and wrench (12,)."""
    q = start[:6]
    x = np.concatenate([q, np.linalg.solve(twist_of_rates(q), start[6:])])

    def slope(t: float, x: FloatArray) -> FloatArray:
        u = inputs(t)
        return np.concatenate([x[6:], accelerations(platform, x[:6], x[6:], u[:6], u[6:])])

    found = solve_ivp(slope, (times[0], times[-1]), x, "DOP853", times, rtol=tolerance, atol=tolerance)
    assert found.success
    return np.array([np.concatenate([x[:6], twist_of_rates(x[:6]) @ x[6:]]) for x in found.y.T])

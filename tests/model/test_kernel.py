"""The traced kernel: exact Jacobians by run-time parameters, and no allocation."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart import Platform
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.state import Inputs
from tests.support.random_platforms import random_inputs, random_platform, random_state

KERNEL = Kernel()


def derivative_by_numpy(platform: Platform, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """ẋ by the NumPy functions, also for complex arguments."""
    return plant_equations(IDEAL, platform, x, Inputs.from_vector(u))[0]


@given(st.integers(0, 2**32 - 1))
def test_state_jacobians_are_exact(seed: int) -> None:
    """Expected: complex-step derivatives of the NumPy functions, which have no rounding of differences."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    x, u = random_state(platform, rng).to_vector(), random_inputs(platform, rng).to_vector()
    J = KERNEL.jacobians(x, u, parameter_vector(platform))
    steps = 1j * 1e-30 * np.eye(12)
    A = np.stack([derivative_by_numpy(platform, x + step, u).imag * 1e30 for step in steps], axis=1)
    B = np.stack([derivative_by_numpy(platform, x + 0j, u + step).imag * 1e30 for step in steps], axis=1)
    assert np.abs(J.A - A).max() <= 1e-10 * np.abs(A).max()
    assert np.abs(J.B - B).max() <= 1e-10 * np.abs(B).max()

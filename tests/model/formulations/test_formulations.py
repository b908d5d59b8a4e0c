"""Kane and Newton–Euler, which judge the task-space form: accelerations and joint forces; Baumgarte's terms."""

import numpy as np
import pytest
from scipy.linalg import expm

from gough_stewart.model.formulations import kane
from gough_stewart.model.interface import Inputs
from tests.support.formulations import largest_difference
from tests.support.random_platforms import random_platform
from tests.support.shared_joints import SHARED
from tests.support.uneven import INPUT_VALUES, STATE, UNEVEN

INPUTS = Inputs(**INPUT_VALUES)


@pytest.mark.parametrize("axial_inertia", [0.0, 0.7])
def test_accelerations_and_joint_forces_are_those_of_both_formulations(axial_inertia: float) -> None:
    """Expected: the multipliers λ of eq. (30) are Newton and Euler's forces in the platform joints; no leg spins."""
    rng = np.random.default_rng(2000)
    for platform in (*SHARED, *(random_platform(rng) for _ in range(100))):
        assert largest_difference(platform, rng, axial_inertia) <= 1e-10


def test_both_terms_of_baumgarte_have_their_own_number() -> None:
    """Expected: Φ¨ + 2αΦ˙ + β²Φ = 0 with α ≠ β from six gaps and from slips, by the exponential of its matrix."""
    alpha, beta, times = 9.0, 3.5, np.array([0.0, 0.05, 0.2])
    configuration, y = kane.consistent_start(UNEVEN, STATE)
    stretched = configuration._replace(slide=configuration.slide + 1e-5 * np.arange(1, 7))
    faster = y + 1e-5 * np.append(np.tile([0.0, 0.0, 0.0, 3.0], 6), np.zeros(6))
    run = kane.integrate(UNEVEN, stretched, faster, INPUTS, times, (alpha, beta))
    constraints = kane.constraints(UNEVEN, run.configuration, run.speeds)
    gap, slip = constraints.residual[:, :18], np.einsum("nab,nb->na", constraints.jacobian, run.speeds)
    assert np.abs(gap[0]).max() > 3e-5
    assert np.abs(slip[0, :18]).max() > 1e-5
    for k, t in enumerate(times):
        decay = expm(np.array([[0.0, 1.0], [-(beta**2), -2 * alpha]]) * t)
        assert gap[k] == pytest.approx(decay[0, 0] * gap[0] + decay[0, 1] * slip[0, :18], abs=1e-9)
        # the gaps turn with the legs: their rate is the slip up to the product of two small numbers
        assert slip[k, :18] == pytest.approx(decay[1, 0] * gap[0] + decay[1, 1] * slip[0, :18], abs=1e-8)
    assert run.position_violation == pytest.approx(np.abs(gap).max(axis=1), rel=1e-9)
    assert run.velocity_violation == pytest.approx(np.abs(slip).max(axis=1), rel=1e-9)

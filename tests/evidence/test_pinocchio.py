"""Pinocchio, an engine with other authors and another formulation, gives the same accelerations."""

import numpy as np
import pytest

from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.interface import IDEAL, Inputs
from tests.support.pinocchio_platform import PinocchioPlatform
from tests.support.random_platforms import random_inputs, random_platform, random_state


@pytest.mark.evidence
def test_pinocchio_gives_the_same_accelerations() -> None:
    """Expected: `constraintDynamics` with CONTACT_3D closures, ≤ 1e-10 relative, on all of 1,000 random platforms."""
    rng, worst = np.random.default_rng(2000), 0.0
    for _ in range(1000):
        platform = random_platform(rng)
        state, inputs = random_state(platform, rng), Inputs.from_vector(random_inputs(platform, rng))
        theirs = PinocchioPlatform(platform, state, inputs).acceleration()
        rates, _ = plant_equations(IDEAL, platform, state.to_vector(), inputs)
        worst = max(worst, float(np.linalg.norm(rates[6:] - theirs) / np.linalg.norm(theirs)))
    print(f"\nlargest relative difference to Pinocchio: {worst:.2e}")
    assert worst <= 1e-10

"""Pinocchio, an engine with other authors and another formulation, gives the same accelerations.

`leg_armature` is its `armature` of the sliding joints.
"""

import numpy as np
import pytest

from gough_stewart import State
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.state import Inputs
from tests.support.pinocchio_platform import PinocchioPlatform
from tests.support.random_platforms import random_sample, relative_difference


@pytest.mark.evidence
def test_pinocchio_gives_the_same_accelerations() -> None:
    """Expected: `constraintDynamics` with CONTACT_3D closures, ≤ 1e-10 relative, on all of the random platforms."""
    sample = random_sample(1000, seed=2000)
    inputs = Inputs.from_vector(sample.inputs)
    rates, _ = plant_equations(IDEAL, sample.parameters, sample.state.to_vector(), inputs)
    theirs = np.array(
        [
            PinocchioPlatform(
                platform, State(*(x[k] for x in sample.state)), Inputs(*(u[k] for u in inputs))
            ).acceleration()
            for k, platform in enumerate(sample.platforms)
        ]
    )
    difference = relative_difference(rates[:, 6:], theirs)
    print(f"\nlargest relative difference to Pinocchio over {len(theirs)} platforms: {difference:.2e}")
    assert difference <= 1e-10

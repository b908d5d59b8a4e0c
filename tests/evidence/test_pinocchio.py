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
from tests.support.random_platforms import Sample, relative_difference


@pytest.mark.evidence
def test_pinocchio_gives_the_same_accelerations(thousand: Sample) -> None:
    """Expected: `constraintDynamics` with CONTACT_3D closures, ≤ 1e-10 relative, on all of the random platforms."""
    rates, _ = plant_equations(IDEAL, thousand.parameters, thousand.state.to_vector(), thousand.inputs)
    theirs = np.array(
        [
            PinocchioPlatform(
                platform, State(*(x[k] for x in thousand.state)), Inputs(*(u[k] for u in thousand.inputs))
            ).acceleration()
            for k, platform in enumerate(thousand.platforms)
        ]
    )
    difference = relative_difference(rates[:, 6:], theirs)
    print(f"\nlargest relative difference to Pinocchio over {len(theirs)} platforms: {difference:.2e}")
    assert difference <= 1e-10

"""Slow evidence: machines with stiction and elastic legs, by laws as printed, against other integration."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough_stewart import Platform, SteppingModel
from tests.support.lagrangian import FloatArray, Pose, forces_along, legs_along
from tests.support.real_platforms import printed_law, real_platform
from tests.support.uneven import UNEVEN

pytestmark = pytest.mark.evidence


def motion_by_radau(
    platform: Platform, start: FloatArray, force: FloatArray, end: float, tolerance: float
) -> FloatArray:
    """State at a time [s]: pose, its rates, bristles, and motors' motion of elastic legs, from (n,) at 0."""
    # The tolerance is relative; of bristles it is absolute in units of 10 µm, of others in SI units.
    springs = len(start) == 30
    bare = UNEVEN.with_parameters({"leg_armature": 0.0 if springs else platform.leg_armature})
    no_and_each = np.vstack([np.zeros(6), np.eye(6)])

    def rates(_t: float, x: FloatArray) -> FloatArray:
        q, dq, z = x[:6], x[6:12], x[12:18]
        length, speed = (each[0] for each in legs_along(bare, Pose(q[None], dq[None], dq[None])))
        sliding = x[24:] if springs else speed
        friction, bent = np.transpose([printed_law(platform, sliding[k], z[k], k) for k in range(6)])
        of_leg, motors = force - friction, np.zeros(0)
        if springs:
            of_leg = platform.leg_stiffness * (x[18:24] - length) + platform.leg_damping * (sliding - speed)
            motors = np.concatenate([sliding, (force - friction - of_leg) / platform.leg_armature])
        # forces are linear in the accelerations
        needed = forces_along(bare, Pose(np.tile(q, (7, 1)), np.tile(dq, (7, 1)), no_and_each))
        accelerations = np.linalg.solve((needed[1:] - needed[0]).T, of_leg - needed[0])
        return np.concatenate([dq, accelerations, bent, motors])

    atol: Any = np.full(len(start), tolerance)
    atol[12:18] *= 1e-5
    found = solve_ivp(rates, (0, end), start, "Radau", rtol=tolerance, atol=atol)
    assert found.success
    return np.asarray(found.y[:, -1])


@pytest.mark.parametrize("friction", ["elasto_plastic", "lugre"])
@pytest.mark.parametrize("springs", [False, True])
def test_a_platform_moves_as_a_lagrangian_with_printed_laws_under_radau(friction: str, springs: bool) -> None:
    """Legs slide, four of them reverse. Expected: equations and integration that share nothing with the model's."""
    tolerance = 1e-8
    platform = real_platform(friction, springs)
    model = SteppingModel(platform, tolerance=1e-11)
    model.set("velocity", [0.03, -0.02, 0.05])
    force = platform.home_actuator_force + np.array([-90, 15, -70, -110, 12, -60])
    model.set("actuator_force", force)
    start = model.state
    expected = motion_by_radau(platform, start, force, 8e-3, tolerance)
    model.do_step(0.0, 8e-3)
    # Radau's accuracy: of velocities the tolerance, poses and bristles are better
    bounds = np.full(len(start), 2 * tolerance)
    bounds[:6], bounds[12:18] = 0.01 * tolerance, 1e-4 * tolerance
    # the rates of roll, pitch and yaw are not the angular velocity
    gap = np.delete(np.abs(model.state - expected) / bounds, slice(9, 12))
    assert gap.max() < 1
    assert np.ptp(np.sign(model.state[12:18])) == 2

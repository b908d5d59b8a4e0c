"""A machine that sticks and gives by a Lagrangian, the laws that papers print, and SciPy's Radau.

It shares nothing with the physics and the schemes of the model: velocities and forces of the platform follow from
places and energies by automatic differentiation (`lagrangian`), friction from cases, and Radau is an implicit method.
"""

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from gough_stewart import Platform
from tests.support.lagrangian import FloatArray, Pose, forces_along, legs_along
from tests.support.real_platforms import printed_law
from tests.support.uneven import UNEVEN


def motion_by_radau(
    platform: Platform, start: FloatArray, force: FloatArray, end: float, tolerance: float
) -> FloatArray:
    """State at a time [s]: pose, its rates, bristles, and of elastic legs positions and velocities of motors.

    Parameters
    ----------
    platform
        UNEVEN with stiction; elastic legs have a stiffness and a damping.
    start
        The same at time 0.
    force
        Of the actuators (6,) [N], constant.
    tolerance
        Relative; of bristles it is absolute in units of 10 µm, of others in SI units.
    """
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

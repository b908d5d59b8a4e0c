"""Forces computed in advance from the reference: none, static, or by computed torque."""

from typing import Literal

import numpy as np

from gough_stewart.harness.motion.motion import Motion, once_at_rest
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics, static_leg_forces
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

Feedforward = Literal["none", "gravity", "computed_torque"]


def feedforward(kind: Feedforward, platform: Platform, motion: Motion) -> FloatArray:
    """Actuator forces (n, 6) [N] along a reference motion.

    gravity: Jᵀ F = n(pose, 0), at rest in each pose. computed_torque: Jᵀ F = M [v̇; ω̇] + n, inverse dynamics.

    Raises
    ------
    SingularPoseError
        The legs cannot hold a pose of the motion.
    """
    if kind == "none":
        return np.zeros((len(motion.position), 6))

    def held(rows: Motion) -> list[FloatArray]:
        if kind == "gravity":
            return [static_leg_forces(platform, rows.position, rows.orientation)]
        return [inverse_dynamics(platform, State(*rows[:4]), Acceleration(*rows[4:]))]

    (forces,) = once_at_rest(held, motion)
    return forces

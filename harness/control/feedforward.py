"""Forces computed in advance from the reference: none, static, or by computed torque."""

from typing import Literal

import numpy as np

from gough_stewart.harness.motion.motion import Motion
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
    if kind == "gravity":
        return np.asarray(static_leg_forces(platform, motion.position, motion.orientation))
    if kind == "computed_torque":
        state = State(motion.position, motion.orientation, motion.velocity, motion.angular_velocity)
        acceleration = Acceleration(motion.acceleration, motion.angular_acceleration)
        return np.asarray(inverse_dynamics(platform, state, acceleration))
    return np.zeros((len(motion.position), 6))

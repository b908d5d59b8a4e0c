"""Actuator forces of a motion by Newton–Euler, independent of the inverse dynamics that plans and checks use."""

import numpy as np

from gough_stewart import Platform
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.arrays import FloatArray


def forces_by_newton_euler(platform: Platform, motion: Reference, time: FloatArray) -> FloatArray:
    """Actuator forces (n, 6) with which Newton–Euler has the accelerations of a motion: they are affine in them."""
    at = motion(time)
    n, rotation = len(time), matrix_from_orientation(at.orientation)

    def accelerations(force: FloatArray) -> FloatArray:
        rest = np.zeros((n, 3))
        state = (at.position, rotation, at.velocity, at.angular_velocity)
        found = newton_euler.solve(platform, *state, np.broadcast_to(force, (n, 6)), rest, rest)
        return np.concatenate([found.linear, found.angular], axis=1)

    free = accelerations(np.zeros(6))
    gain = np.stack([accelerations(row) - free for row in np.eye(6)], axis=2)
    wanted = np.concatenate([at.acceleration, at.angular_acceleration], axis=1)
    return np.asarray(np.linalg.solve(gain, (wanted - free)[:, :, None])[:, :, 0])

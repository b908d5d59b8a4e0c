"""Legs and actuator forces along a motion of polynomials, by a Lagrangian and friction's formula."""

from typing import Any

import numpy as np

from gough_stewart import Platform
from tests.support.arrays import FloatArray
from tests.support.documented_loop import friction_of
from tests.support.lagrangian import Pose, forces_along


def pose_along(motion: Any, time: FloatArray) -> Pose:
    """x, y, z, roll, pitch, yaw and their derivatives at times (n,), each (n, 6), of the motion's polynomials."""
    begins, pieces = motion.pieces
    piece = np.searchsorted(begins, time, side="right") - 1
    since = (time - begins[piece])[:, None]
    values = []
    coefficients = pieces[piece]
    for _ in range(3):
        powers = np.arange(coefficients.shape[2] - 1, -1, -1)
        values.append((coefficients * since[..., None] ** powers).sum(axis=2))
        coefficients = coefficients[:, :, :-1] * powers[:-1]
    return Pose(*values)


def actuator_forces(platform: Platform, pose: Pose, velocity: FloatArray) -> FloatArray:
    """What the actuators have to give (n, 6) [N], with these leg velocities."""
    return forces_along(platform, pose) + friction_of(platform, velocity)

"""The platform's motion from leg lengths: poses by forward kinematics, and rates from the same smoothed lengths."""

import numpy as np

from gough_stewart.harness.errors import LogError, MotionError
from gough_stewart.harness.motion.recorded.recording import poses_of_lengths
from gough_stewart.model.dynamics import Acceleration
from gough_stewart.model.kinematics import jacobian_of_legs, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import Array, FloatArray, cross, dot


def poses_of(platform: Platform, leg_length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions and orientations (n, 3) with these leg lengths (n, 6) [m], continuous from the home pose.

    Raises
    ------
    LogError
        Lengths that are impossible for this platform; names the row.
    """
    try:
        found = poses_of_lengths(platform, leg_length)
    except MotionError as error:
        raise LogError(str(error)) from error
    return found.position, found.orientation


def motion_of_lengths(
    platform: Platform, leg_length: FloatArray, leg_velocity: FloatArray, leg_acceleration: FloatArray
) -> tuple[State, Acceleration]:
    """State and acceleration of the platform from lengths, velocities and accelerations of its legs; each (n, 6).

    [v; ω] = J⁻¹ L̇ and [v̇; ω̇] = J⁻¹ (L̈ − L |u̇|² − u·(ω×(ω×c))), since L̈ = u·P̈ + L |u̇|².
    """
    position, orientation = poses_of(platform, leg_length)
    legs = leg_geometry(platform, position, orientation)
    J = jacobian_of_legs(legs)
    twist = _solved(J, leg_velocity)
    state = State(position, orientation, twist[:, :3], twist[:, 3:])
    rates = rates_of_legs(legs, state)
    omega = state.angular_velocity[:, None, :]
    centripetal = dot(legs.direction, cross(omega, cross(omega, legs.arm)))
    known = legs.length * dot(rates.direction_rate, rates.direction_rate) + centripetal
    a = _solved(J, leg_acceleration - known)
    return state, Acceleration(a[:, :3], a[:, 3:])


def _solved(matrix: Array, vector: Array) -> Array:
    return np.linalg.solve(matrix, vector[..., None])[..., 0]

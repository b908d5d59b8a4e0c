"""The platform's motion from leg lengths: poses by forward kinematics, and rates from the same smoothed lengths."""

import numpy as np

from gough_stewart.harness.errors import LogError
from gough_stewart.model.dynamics import Acceleration
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.forward_kinematics import forward_kinematics
from gough_stewart.model.kinematics import handedness_of_legs, jacobian_of_legs, leg_geometry, rates_of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import State
from gough_stewart.model.vectors import Array, FloatArray, cross, dot

_ITERATIONS = 12
_TOLERANCE = 1e-11


def poses_of(platform: Platform, leg_length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions and orientations (n, 3) with these leg lengths (n, 6) [m], in the assembly mode of home.

    Newton's method from the home pose for all rows at once; rows that do not converge start from a neighbour's pose.

    Raises
    ------
    LogError
        Lengths that are impossible for this platform; names the row.
    """
    n = len(leg_length)
    pose = np.tile(np.concatenate([platform.home_position, platform.home_orientation]), (n, 1))
    side = handedness_of_legs(leg_geometry(platform, platform.home_position, platform.home_orientation))
    close, largest = _TOLERANCE * float(leg_length.max()), 0.25 * platform.characteristic_length
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            legs = leg_geometry(platform, pose[:, :3], pose[:, 3:])
            error = leg_length - legs.length
            if np.abs(error).max() < close:
                break
            step = _solved(jacobian_of_legs(legs), error)
            size = np.maximum(np.linalg.norm(step[:, :3], axis=1), np.linalg.norm(step[:, 3:], axis=1) / 2)
            step *= np.minimum(1.0, largest / np.maximum(size, 1e-300))[:, None]
            pose[:, :3] += step[:, :3]
            pose[:, 3:] += orientation_rate_from_angular_velocity(pose[:, 3:], step[:, 3:])
            # diverged rows restart from home, and later from their neighbour
            lost = ~(np.isfinite(pose).all(axis=1) & (np.abs(pose[:, 4]) < LARGEST_PITCH))
            pose[lost] = np.concatenate([platform.home_position, platform.home_orientation])
        legs = leg_geometry(platform, pose[:, :3], pose[:, 3:])
        error = np.abs(leg_length - legs.length).max(axis=1)
    bad = np.flatnonzero(~((error < 10 * close) & (handedness_of_legs(legs) == side)))
    for k in bad:
        guess = pose[k - 1] if k else np.concatenate([platform.home_position, platform.home_orientation])
        try:
            found = forward_kinematics(platform, leg_length[k], guess[:3], guess[3:])
        except GoughStewartError as cause:
            raise LogError(
                f"no pose of this platform has the leg lengths {np.round(leg_length[k], 5).tolist()} m of row {k + 1} "
                f"({cause}); check the platform's joints, the order of the legs, and the unit of the lengths"
            ) from cause
        pose[k] = np.concatenate([found.position, found.orientation])
    return pose[:, :3], pose[:, 3:]


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

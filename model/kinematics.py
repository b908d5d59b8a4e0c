"""Kinematics of the six legs: vectors, lengths, directions, rates, the leg Jacobian, and the limits of poses.

Closure of leg i (paper, fig. 1): l_i = t + R p_i − B_i, with t the position of Op, R from platform to world.
All functions broadcast over leading axes and are traceable, except those on conditioning, handedness, joint angles and
limits, which are NumPy only.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.interface import State
from gough_stewart.model.parameters import Parameters, PlatformFields
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.vectors import Array, FloatArray, centripetal, cross, dot, without_warnings

# 0.06° below the singular pitch of 90° [rad].
LARGEST_PITCH = np.pi / 2 - 1e-3
# A shorter leg has collapsed; as a fraction of the platform's characteristic length.
SHORTEST_LEG = 1e-3
# Of the leg Jacobian with angles scaled to lengths; above this, the pose is practically singular.
SINGULAR_CONDITION_NUMBER = 1e8
PITCHED, COLLAPSED = "the pitch has reached ±90°", "the leg has collapsed"


class LegGeometry(NamedTuple):
    """The legs at one pose."""

    arm: Array  # c_i = R p_i, from Op to P_i in world components (..., 6, 3) [m]
    vector: Array  # l_i = P_i − B_i (..., 6, 3) [m]
    length: Array  # L_i = |l_i| (..., 6) [m]
    direction: Array  # u_i = l_i / L_i, from base to platform (..., 6, 3)


class LegRates(NamedTuple):
    """First derivatives of the leg geometry."""

    length_rate: Array  # L̇_i (..., 6) [m/s]; the paper's sliding velocity
    direction_rate: Array  # u̇_i (..., 6, 3) [1/s]


class Conditioning(NamedTuple):
    """Closeness to a singular pose, from the leg Jacobian with angles scaled to lengths."""

    condition_number: Array  # σ_max / σ_min (...); infinite at a singular pose
    smallest_singular_value: Array  # σ_min (...), 0 at a singular pose; at most √2


@without_warnings
def leg_geometry(parameters: Parameters, position: Array, orientation: Array) -> LegGeometry:
    """Vectors, lengths and directions of the legs at a pose.

    l_i = t + R p_i − B_i, L_i = |l_i|, u_i = l_i / L_i (Liu, Li & Li 2000, fig. 1).

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    position, orientation
        Pose (..., 3) [m], (..., 3) [rad]; leading axes broadcast.

    Returns
    -------
    LegGeometry
        In world components: `arm` c_i = R p_i, from Op to P_i, and `vector` l_i (..., 6, 3) [m]; `length` L_i (..., 6)
        [m]; `direction` u_i, from base to platform (..., 6, 3) [1].

    Raises
    ------
    ArgumentError
        An argument of another type, shape or unit.

    See Also
    --------
    leg_jacobian, forward_kinematics

    Examples
    --------
    >>> platform = gs.load_preset("liu2000")
    >>> gs.leg_geometry(platform, platform.home_position, platform.home_orientation).length
    """
    # (..., 1, 3, 3) rotations on (..., 6, 3) points: R_ab p_ib summed over b
    R = matrix_from_orientation(orientation)[..., None, :, :]
    c = np.asarray((R * parameters.platform_points[..., None, :]).sum(axis=-1))
    l = np.asarray(position)[..., None, :] + c - parameters.base_points
    L = np.sqrt(dot(l, l))
    # one reciprocal, since divisions are expensive in the compiled kernel
    return LegGeometry(c, l, L, l * (1 / L)[..., None])


@without_warnings
def rates_of_legs(legs: LegGeometry, state: State) -> LegRates:
    """Rates of legs: Ṗ = v + ω×c, eqs. (21), (22) of the paper, L̇ = u·Ṗ, u̇ = (Ṗ − L̇ u)/L."""
    velocity = state.velocity[..., None, :] + cross(state.angular_velocity[..., None, :], legs.arm)
    length_rate = dot(legs.direction, velocity)
    direction_rate = (velocity - length_rate[..., None] * legs.direction) * (1 / legs.length)[..., None]
    return LegRates(length_rate, direction_rate)


def joint_accelerations(legs: LegGeometry, angular_velocity: Array, linear: Array, angular: Array) -> Array:
    """Accelerations of the platform joints (..., 6, 3) [m/s²]: P̈ = v̇ + ω̇×c + ω×(ω×c); all (..., 3), world."""
    spin = angular_velocity[..., None, :]
    return np.asarray(linear[..., None, :] + cross(angular[..., None, :], legs.arm) + centripetal(spin, legs.arm))


@without_warnings
def leg_accelerations(legs: LegGeometry, state: State, linear: Array, angular: Array) -> Array:
    """L̈ = u·P̈ + L |u̇|² (..., 6) [m/s²], for v̇ [m/s²] and ω̇ [rad/s²] (..., 3) in world components."""
    rates = rates_of_legs(legs, state)
    along = dot(legs.direction, joint_accelerations(legs, state.angular_velocity, linear, angular))
    return np.asarray(along + legs.length * dot(rates.direction_rate, rates.direction_rate))


def leg_jacobian(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Leg Jacobian J (..., 6, 6) with L̇ = J [v; ω], and wrench [force; torque about Op] = Jᵀ F.

    Row i is [u_iᵀ, (c_i × u_i)ᵀ], from u_i · Ṗ_i with Ṗ_i of eq. (21) of Liu, Li & Li (2000).

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    position, orientation
        Pose (..., 3) [m], (..., 3) [rad]; leading axes broadcast.

    Returns
    -------
    ndarray
        J (..., 6, 6): a row for each leg, columns for v [1] and ω [m].

    Raises
    ------
    ArgumentError
        An argument of another type, shape or unit.

    See Also
    --------
    leg_geometry, mass_matrix, compliance

    Examples
    --------
    >>> platform = gs.load_preset("liu2000")
    >>> J = gs.leg_jacobian(platform, platform.home_position, platform.home_orientation)
    >>> J @ [0, 0, 1, 0, 0, 0]  # leg velocities of a heave of 1 m/s
    """
    return jacobian_of_legs(leg_geometry(parameters, position, orientation))


def jacobian_of_legs(legs: LegGeometry, *, scaled: bool = False) -> Array:
    """Leg Jacobian J (..., 6, 6) of legs whose geometry is known: rows [u_iᵀ, (c_i × u_i)ᵀ].

    If `scaled`, with angles scaled to lengths: J diag(1, 1/ρ) [1], with ρ the root-mean-square distance of the platform
    joints from Op.
    """
    moments = cross(legs.arm, legs.direction)
    if scaled:
        moments = moments / np.sqrt(dot(legs.arm, legs.arm).sum(axis=-1) / 6)[..., None, None]
    return np.concatenate([legs.direction, moments], axis=-1)


def conditioning_of_legs(legs: LegGeometry) -> Conditioning:
    """Condition number and smallest singular value of the leg Jacobian, dimensionless.

    J mixes 1 and m, so it is scaled: L̇ = (J diag(1, 1/ρ)) [v; ρ ω]. Infinite and 0 where a leg of length 0 has no
    direction.
    """
    scaled = jacobian_of_legs(legs, scaled=True)
    has_directions = np.asarray(np.isfinite(scaled).all(axis=(-1, -2)))
    sigma = np.linalg.svd(np.where(has_directions[..., None, None], scaled, 0.0), compute_uv=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        number = np.where(has_directions, sigma[..., 0] / sigma[..., -1], np.inf)
    return Conditioning(np.asarray(number), np.asarray(sigma[..., -1]))


def conditioning(parameters: Parameters, position: Array, orientation: Array) -> Conditioning:
    """`conditioning_of_legs` at poses: position [m], orientation [rad] (..., 3)."""
    return conditioning_of_legs(leg_geometry(parameters, position, orientation))


def condition_number_bound(matrix: Array) -> Array:
    """‖A‖ ‖A⁻¹‖ (...) in Frobenius norms, 1 to n times the condition number; infinite if one is singular."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full(np.shape(matrix)[:-2], np.inf)
    return np.asarray(np.linalg.norm(matrix, axis=(-2, -1)) * np.linalg.norm(inverse, axis=(-2, -1)))


def joint_angles(
    parameters: Parameters, position: Array, orientation: Array, home_position: Array, home_orientation: Array
) -> tuple[Array, Array]:
    """Angles of base and platform joints (..., 6) [rad] from their home directions, in world and in platform axes."""
    (u, R), (u_home, R_home) = (
        (leg_geometry(parameters, p, o).direction, matrix_from_orientation(o)[..., None, :, :])
        for p, o in ((position, orientation), (home_position, home_orientation))
    )
    # Rᵀ u: R_ab u_ia summed over a
    in_platform, in_platform_home = (R * u[..., :, None]).sum(axis=-2), (R_home * u_home[..., :, None]).sum(axis=-2)
    angles = []
    for a, b in ((u, u_home), (in_platform, in_platform_home)):
        # between unit vectors, accurate near 0: 2 atan2(|a − b|, |a + b|)
        minus, plus = a - b, a + b
        angles.append(np.asarray(2 * np.arctan2(np.sqrt(dot(minus, minus)), np.sqrt(dot(plus, plus)))))
    return angles[0], angles[1]


def check_pose(platform: PlatformFields, x: Array, time: float, handedness: float | None = None) -> float:
    """Raise `StepError` if the pose of a state x (12,), or longer, is beyond a limit; returns the sign of det J.

    It changes at singular poses; `handedness` is the one at an earlier state of the same motion.
    """
    position, orientation = x[:3], x[3:6]
    if not abs(orientation[1]) < LARGEST_PITCH:
        raise StepError("orientation[2]", float(orientation[1]), time, PITCHED)
    legs = leg_geometry(platform, position, orientation)
    leg = int(legs.length.argmin())
    if not legs.length[leg] > SHORTEST_LEG * platform.characteristic_length:
        raise StepError(f"leg_length[{leg + 1}]", float(legs.length[leg]), time, COLLAPSED)
    scaled = jacobian_of_legs(legs, scaled=True)
    sign = float(np.sign(np.linalg.det(scaled)))
    passed = handedness is not None and sign != handedness
    # the condition number itself would take longer than everything else here
    if passed or not condition_number_bound(scaled) < SINGULAR_CONDITION_NUMBER:
        number = float(conditioning_of_legs(legs).condition_number)
        if passed or not number < SINGULAR_CONDITION_NUMBER:
            raise singular_pose(number, time, passed=passed)
    return sign


def singular_pose(condition_number: float, time: float, *, passed: bool) -> StepError:
    """The error for a singular pose, or for one that was `passed` since the last integration step."""
    since = " (passed since the last internal step)" if passed else ""
    return StepError(
        "condition number of the leg Jacobian",
        condition_number,
        time,
        f"the platform has reached a singular pose{since}; the legs cannot hold it there",
    )


@without_warnings
def side_of_singular_poses(platform: PlatformFields, legs: LegGeometry) -> FloatArray:
    """Sign of det J relative to that at home (...): 1 for the same sign, −1 for the opposite.

    The sign is constant within an assembly mode, and changes at singular poses: 0 there, NaN if a leg has no direction.
    The same sign is necessary, not sufficient, for a path from home without a singular pose.
    """
    home = leg_geometry(platform, platform.home_position, platform.home_orientation)
    side, side_at_home = (np.sign(np.linalg.det(jacobian_of_legs(at))) for at in (legs, home))
    return np.asarray(side * side_at_home)

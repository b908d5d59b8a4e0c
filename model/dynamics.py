"""Task-space dynamics of the platform: M(pose) [v̇; ω̇] + n(state) = Jᵀ F + [f_ext; τ_ext].

The one source of physics at run time. Pure functions over leading axes, without data-dependent branches, so that
CasADi traces them (see `gough_stewart.model.kernel`). Twists are [v; ω], wrenches [force; torque about Op], all
in world components. The 6×6 solve is an argument: NumPy's by default, an LDLᵀ of symbols when traced.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import SingularPoseError
from gough_stewart.model.kinematics import (
    LegGeometry,
    jacobian_of_legs,
    leg_geometry,
    rates_of_legs,
    wrench_from_leg_forces,
)
from gough_stewart.model.leg_dynamics import bias_force, inertia_force, transverse_mass
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, apply, cross, dot, outer, per_leg, skew, transpose

Solve = Callable[[Array, Array], Array]

# Leg forces at a pose with a worse Jacobian than this would carry no correct digit.
LARGEST_CONDITION_NUMBER = 1e12


class Acceleration(NamedTuple):
    """Acceleration of the platform frame; each (..., 3)."""

    linear: Array  # v̇ of Op [m/s2]
    angular: Array  # ω̇ [rad/s2]


def solve_mass_matrix(matrix: Array, vector: Array) -> Array:
    """Solution of (..., 6, 6) systems for (..., 6) right-hand sides."""
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


def solve_leg_forces(matrix: Array, vector: Array) -> Array:
    """As `solve_mass_matrix`, for the transposed leg Jacobian, refusing a singular one.

    Raises
    ------
    SingularPoseError
        The condition number of the matrix exceeds `LARGEST_CONDITION_NUMBER`.
    """
    worst = float(np.max(np.linalg.cond(matrix)))
    if not worst < LARGEST_CONDITION_NUMBER:
        raise SingularPoseError(
            f"leg Jacobian has condition number {worst:.3g}, expected below {LARGEST_CONDITION_NUMBER:g}: the leg "
            "forces cannot hold this pose; choose a pose away from the singularity",
            worst,
        )
    return solve_mass_matrix(matrix, vector)


def mass_matrix(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Mass matrix M (..., 6, 6) for the twist [v; ω]; symmetric, positive definite.

    M = [[m 1, −m r̃], [m r̃, J − m r̃ r̃]] + Σ_i G_iᵀ E_i G_i, with Ṗ_i = G_i [v; ω], G_i = [1, −c̃_i], E_i the
    apparent mass of leg i at P_i (see `leg_dynamics`), r = R r_G, J = R J_p Rᵀ.
    """
    return _mass_matrix(parameters, orientation, leg_geometry(parameters, position, orientation))


def bias_wrench(parameters: Parameters, state: State) -> Array:
    """Wrench n (..., 6) that holds [v̇; ω̇] = 0 without actuators: inertia of the motion, weight, friction."""
    return _bias_wrench(parameters, state, leg_geometry(parameters, state.position, state.orientation))


def forward_dynamics(
    parameters: Parameters, state: State, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> Acceleration:
    """Acceleration of the platform under given forces.

    [v̇; ω̇] = M⁻¹ (Jᵀ F + [f_ext; τ_ext] − n), in m/s² and rad/s²; shapes (..., 3).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    M = _mass_matrix(parameters, state.orientation, legs)
    external = np.concatenate([inputs.external_force, inputs.external_torque], axis=-1)
    applied = wrench_from_leg_forces(legs, inputs.actuator_force) + external
    a = solve(M, applied - _bias_wrench(parameters, state, legs))
    return Acceleration(a[..., :3], a[..., 3:])


def inverse_dynamics(
    parameters: Parameters,
    state: State,
    acceleration: Acceleration,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] that give the wanted acceleration: Jᵀ F = M [v̇; ω̇] + n − [f_ext; τ_ext].

    Parameters
    ----------
    external_wrench
        [f_ext; τ_ext] (..., 6) at Op in world components [N, N m].

    Raises
    ------
    SingularPoseError
        The leg forces cannot produce the wrench at this pose.
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    M = _mass_matrix(parameters, state.orientation, legs)
    wanted = apply(M, np.concatenate(acceleration, axis=-1)) + _bias_wrench(parameters, state, legs)
    return solve(transpose(jacobian_of_legs(legs)), wanted - external_wrench)


def static_leg_forces(
    parameters: Parameters,
    position: Array,
    orientation: Array,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] that hold a pose at rest against gravity and an external wrench.

    Raises
    ------
    SingularPoseError
        The leg forces cannot hold this pose.
    """
    rest = 0 * position
    state = State(position, orientation, rest, rest)
    return inverse_dynamics(parameters, state, Acceleration(rest, rest), external_wrench, solve)


def joint_forces(parameters: Parameters, state: State, actuator_force: Array, acceleration: Acceleration) -> Array:
    """Force of each leg on the platform at P_i (..., 6, 3) [N], world components.

    −f_i = F_i u_i − E_i P̈_i − b_i with P̈_i = v̇ + ω̇×c_i + ω×(ω×c_i); the multipliers λ_i of eq. (30).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    b = bias_force(parameters, legs, rates_of_legs(legs, state))
    ddP = acceleration.linear[..., None, :] + cross(acceleration.angular[..., None, :], legs.arm)
    ddP = ddP + _centripetal(state.angular_velocity[..., None, :], legs.arm)
    F = actuator_force[..., None] * legs.direction
    return np.asarray(F - inertia_force(parameters, legs, ddP) - b)


def _mass_matrix(parameters: Parameters, orientation: Array, legs: LegGeometry) -> Array:
    # The platform and, at each P_i, a point mass t_i: one rigid body about Op. What the legs oppose along u_i
    # beyond t_i comes in by the leg Jacobian, since G_iᵀ u_i is its row i.
    m, r, J = _platform_body(parameters, orientation)
    t = transverse_mass(parameters, legs.length)
    first = m[..., None] * r + (t[..., None] * legs.arm).sum(axis=-2)
    second = J + m[..., None, None] * _point_inertia(r)
    second = second + (t[..., None, None] * _point_inertia(legs.arm)).sum(axis=-3)
    vv = (m + t.sum(axis=-1))[..., None, None] * np.eye(3)
    wv = skew(first)
    body = np.concatenate([np.concatenate([vv, -wv], axis=-1), np.concatenate([wv, second], axis=-1)], axis=-2)
    rows = jacobian_of_legs(legs)
    axial = per_leg(parameters.leg_upper_mass) - t
    return np.asarray(body + transpose(rows) @ (axial[..., None] * rows))


def _bias_wrench(parameters: Parameters, state: State, legs: LegGeometry) -> Array:
    omega = state.angular_velocity
    # of the legs: what they need at P_i for the centripetal part of P̈_i, and their bias
    of_legs = bias_force(parameters, legs, rates_of_legs(legs, state))
    of_legs = of_legs + inertia_force(parameters, legs, _centripetal(omega[..., None, :], legs.arm))
    # of the platform body about Op
    m, r, J = _platform_body(parameters, state.orientation)
    of_body = m[..., None] * (_centripetal(omega, r) - parameters.gravity)
    force = of_body + of_legs.sum(axis=-2)
    torque = cross(omega, apply(J, omega)) + cross(r, of_body) + cross(legs.arm, of_legs).sum(axis=-2)
    return np.concatenate([force, torque], axis=-1)


def _platform_body(parameters: Parameters, orientation: Array) -> tuple[Array, Array, Array]:
    """Mass m (...), r = R r_G (..., 3) and J = R J_p Rᵀ (..., 3, 3) about G, world components."""
    R = matrix_from_orientation(orientation)
    J = R @ parameters.platform_inertia @ transpose(R)
    return np.asarray(parameters.platform_mass), apply(R, parameters.platform_com), J


def _point_inertia(arm: Array) -> Array:
    """Inertia (..., 3, 3) about Op of a unit mass at `arm`: |r|² 1 − r rᵀ."""
    return np.asarray(dot(arm, arm)[..., None, None] * np.eye(3) - outer(arm, arm))


def _centripetal(omega: Array, arm: Array) -> Array:
    """ω×(ω×r) = ω (ω·r) − r |ω|²."""
    return np.asarray(omega * dot(omega, arm)[..., None] - arm * dot(omega, omega)[..., None])

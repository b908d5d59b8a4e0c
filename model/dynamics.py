"""Task-space dynamics of the platform: M(pose) [v̇; ω̇] + n(state) = Jᵀ F + [f_ext; τ_ext].

The only implementation of the physics at run time. Pure functions over leading axes, without data-dependent branches,
so CasADi can trace them (see `gough_stewart.model.traced`). Twists are [v; ω], wrenches [force; torque about Op], all
in world components. The 6×6 solver is an argument: NumPy's by default, a symbolic LDLᵀ when traced.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import SingularPoseError
from gough_stewart.model.kinematics import (
    LegGeometry,
    centripetal,
    condition_number_bound,
    jacobian_of_legs,
    joint_accelerations,
    leg_geometry,
    rates_of_legs,
    wrench_from_leg_forces,
)
from gough_stewart.model.leg_dynamics import axial_mass, bias_force, inertia_force, transverse_mass
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, apply, concatenate, cross, dot, skew, transpose, without_warnings

Solve = Callable[[Array, Array], Array]

# Above this condition number of the Jacobian, leg forces would have no correct digits.
LARGEST_CONDITION_NUMBER = 1e12


class Acceleration(NamedTuple):
    """Acceleration of the platform frame; each (..., 3)."""

    linear: Array  # v̇ of Op [m/s2]
    angular: Array  # ω̇ [rad/s2]


def solve_mass_matrix(matrix: Array, vector: Array) -> Array:
    """Solution of (..., 6, 6) systems for (..., 6) right-hand sides."""
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


def solve_leg_forces(matrix: Array, vector: Array) -> Array:
    """`solve_mass_matrix` for the transposed leg Jacobian, with a check for singularity.

    Raises
    ------
    SingularPoseError
        The condition number of the matrix exceeds `LARGEST_CONDITION_NUMBER`.
    """
    # the condition number itself would take longer than everything else here
    if not np.max(condition_number_bound(matrix)) < LARGEST_CONDITION_NUMBER / 2:
        _check_condition(matrix)
    return solve_mass_matrix(matrix, vector)


def _check_condition(matrix: Array) -> None:
    worst = float(np.max(np.linalg.cond(matrix))) if np.isfinite(matrix).all() else np.inf
    if not worst < LARGEST_CONDITION_NUMBER:
        raise SingularPoseError(
            f"leg Jacobian has condition number {worst:.3g}, expected below {LARGEST_CONDITION_NUMBER:g}: the leg "
            "forces cannot hold this pose; choose a pose away from the singularity",
            worst,
        )


@without_warnings
def mass_matrix(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Mass matrix M (..., 6, 6) for the twist [v; ω]; symmetric, positive definite.

    M = [[m 1, −m r̃], [m r̃, J − m r̃ r̃]] + Σ_i G_iᵀ E_i G_i, with Ṗ_i = G_i [v; ω], G_i = [1, −c̃_i], E_i the
    apparent mass of leg i at P_i (see `leg_dynamics`), r = R r_G, J = R J_p Rᵀ. In kg, kg m and kg m²; position [m],
    orientation [rad] (..., 3).

    Returns
    -------
    ndarray
        M (..., 6, 6): blocks [kg], [kg m] and [kg m²] for v and ω.
    """
    legs = leg_geometry(parameters, position, orientation)
    return _mass_matrix(parameters, legs, _lumped_body(parameters, orientation, legs))


@without_warnings
def bias_wrench(parameters: Parameters, state: State) -> Array:
    """Wrench n (..., 6) for [v̇; ω̇] = 0 without actuator forces: velocity-dependent inertia forces, weight, friction."""
    legs = leg_geometry(parameters, state.position, state.orientation)
    return _bias_wrench(parameters, state, legs, _lumped_body(parameters, state.orientation, legs))


@without_warnings
def forward_dynamics(
    parameters: Parameters, state: State, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> Acceleration:
    """Acceleration of the platform for given forces.

    [v̇; ω̇] = M⁻¹ (Jᵀ F + [f_ext; τ_ext] − n), in m/s² and rad/s²; shapes (..., 3).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    body = _lumped_body(parameters, state.orientation, legs)
    M = _mass_matrix(parameters, legs, body)
    external = concatenate([inputs.external_force, inputs.external_torque])
    applied = wrench_from_leg_forces(legs, inputs.actuator_force) + external
    a = solve(M, applied - _bias_wrench(parameters, state, legs, body))
    return Acceleration(a[..., :3], a[..., 3:])


@without_warnings
def inverse_dynamics(
    parameters: Parameters,
    state: State,
    acceleration: Acceleration,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] for a given acceleration: Jᵀ F = M [v̇; ω̇] + n − [f_ext; τ_ext].

    Parameters
    ----------
    external_wrench
        [f_ext; τ_ext] (..., 6) at Op in world components [N, N m].

    Returns
    -------
    ndarray
        Actuator forces (..., 6) [N]; positive extends the leg.

    Raises
    ------
    SingularPoseError
        The leg forces cannot produce the wrench at this pose.

    Examples
    --------
    >>> platform, rest = gs.load_preset("motion_base"), np.zeros(3)
    >>> state = gs.State(platform.home_position, platform.home_orientation, rest, rest)
    >>> gs.inverse_dynamics(platform, state, gs.Acceleration(np.array([0, 0, 2.0]), rest))
    """
    state, external_wrench = State(*map(np.asarray, state)), np.asarray(external_wrench)
    legs = leg_geometry(parameters, state.position, state.orientation)
    body = _lumped_body(parameters, state.orientation, legs)
    M = _mass_matrix(parameters, legs, body)
    needed = apply(M, concatenate(acceleration)) + _bias_wrench(parameters, state, legs, body)
    return solve(transpose(jacobian_of_legs(legs)), needed - external_wrench)


def static_leg_forces(
    parameters: Parameters,
    position: Array,
    orientation: Array,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] that hold a pose at rest against gravity and an external wrench.

    Position [m], orientation [rad] (..., 3); the wrench (..., 6) [N, N m] at Op, in world components.

    Returns
    -------
    ndarray
        Actuator forces (..., 6) [N]; positive pushes platform and base apart.

    Raises
    ------
    SingularPoseError
        The leg forces cannot hold this pose.

    Examples
    --------
    >>> platform = gs.load_preset("liu2000")
    >>> gs.static_leg_forces(platform, platform.home_position, platform.home_orientation)
    """
    rest = 0 * np.asarray(position)
    state = State(position, orientation, rest, rest)
    return inverse_dynamics(parameters, state, Acceleration(rest, rest), external_wrench, solve)


@without_warnings
def joint_forces(parameters: Parameters, state: State, actuator_force: Array, acceleration: Acceleration) -> Array:
    """Force of each leg on the platform at P_i (..., 6, 3) [N], world components.

    −f_i = F_i u_i − E_i P̈_i − b_i with P̈_i = v̇ + ω̇×c_i + ω×(ω×c_i); the multipliers λ_i of eq. (30).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    b = bias_force(parameters, legs, rates_of_legs(legs, state))
    ddP = joint_accelerations(legs, state.angular_velocity, *acceleration)
    F = actuator_force[..., None] * legs.direction
    return np.asarray(F - inertia_force(parameters, legs, ddP) - b)


class _LumpedBody(NamedTuple):
    """The platform with a point mass t_i at each P_i, t_i the leg's transverse mass: one rigid body about Op."""

    mass: Array  # (...) [kg]
    first: Array  # first moment (..., 3) [kg m]
    second: Array  # inertia (..., 3, 3) [kg m2]
    arm: Array  # from Op to the platform's own centre of mass, R r_G (..., 3) [m]


def _lumped_body(parameters: Parameters, orientation: Array, legs: LegGeometry) -> _LumpedBody:
    R = matrix_from_orientation(orientation)
    m, r = np.asarray(parameters.platform_mass)[..., None], apply(R, parameters.platform_com)
    J = R @ parameters.platform_inertia @ transpose(R)
    t = transverse_mass(parameters, legs.length)[..., None]
    tc, mr = t * legs.arm, m * r
    return _LumpedBody(
        mass=(m + t.sum(axis=-2))[..., 0],
        first=mr + tc.sum(axis=-2),
        second=J + _points_inertia(mr[..., None, :], r[..., None, :]) + _points_inertia(tc, legs.arm),
        arm=r,
    )


def _points_inertia(moments: Array, arms: Array) -> Array:
    """Inertia about Op (..., 3, 3) of point masses at `arms` r (..., n, 3) with first moments m r.

    tr(S) 1 − S with S = Σ m r rᵀ, of which only the six different elements are computed.
    """
    xx, yy, zz, xy, xz, yz = (
        (moments[..., a] * arms[..., b]).sum(axis=-1) for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    )
    return np.stack(
        [
            np.stack([yy + zz, -xy, -xz], axis=-1),
            np.stack([-xy, xx + zz, -yz], axis=-1),
            np.stack([-xz, -yz, xx + yy], axis=-1),
        ],
        axis=-2,
    )


def _beyond_lumped(parameters: Parameters, legs: LegGeometry) -> Array:
    """Apparent mass of each leg along its axis in addition to its point mass: m2 + m_a − t (..., 6) [kg]."""
    return np.asarray(axial_mass(parameters) - transverse_mass(parameters, legs.length))


def _mass_matrix(parameters: Parameters, legs: LegGeometry, body: _LumpedBody) -> Array:
    # G_iᵀ E_i G_i = t_i G_iᵀ G_i + (m_i − t_i) (G_iᵀ u_i)(G_iᵀ u_i)ᵀ: a point mass, and row i of the leg Jacobian
    vv = body.mass[..., None, None] * np.eye(3)
    wv = skew(body.first)
    top, bottom = concatenate([vv, -wv]), concatenate([wv, body.second])
    rigid = transpose(concatenate([transpose(top), transpose(bottom)]))
    rows = jacobian_of_legs(legs)
    return np.asarray(rigid + transpose(rows) @ (_beyond_lumped(parameters, legs)[..., None] * rows))


def _bias_wrench(parameters: Parameters, state: State, legs: LegGeometry, body: _LumpedBody) -> Array:
    # as in the mass matrix: the motion of the lumped body, then the additional forces of the legs
    omega = state.angular_velocity
    along = _beyond_lumped(parameters, legs) * dot(legs.direction, centripetal(omega[..., None, :], legs.arm))
    needed = bias_force(parameters, legs, rates_of_legs(legs, state)) + along[..., None] * legs.direction
    weight = np.asarray(parameters.platform_mass)[..., None] * parameters.gravity
    force = centripetal(omega, body.first) + needed.sum(axis=-2) - weight
    torque = cross(omega, apply(body.second, omega)) + cross(legs.arm, needed).sum(axis=-2) - cross(body.arm, weight)
    return concatenate([force, torque])

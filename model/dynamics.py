"""Task-space dynamics of the platform: M(pose) [v̇; ω̇] + n(state) = Jᵀ F + [f_ext; τ_ext], and its energy.

The only implementation of the physics at run time. Pure functions over leading axes, without data-dependent branches,
so CasADi can trace them (see `gough_stewart.model.traced`). Twists are [v; ω], wrenches [force; torque about Op], all
in world components. The 6×6 solver is an argument: NumPy's by default, a symbolic LDLᵀ when traced.

A leg is reduced to the force that it needs at its platform joint P. It is two slender parts that rotate together about
B and slide on each other along u, without spin about u (paper, eq. (25)). Its inertia about B is
I = m1 r1² + J1 + J2 + m2 (L − d)², its first moment h = m1 r1 + m2 (L − d), with r1 = `leg_lower_com`,
d = `leg_upper_com`. The rotor and screw of an electric actuator rotate in proportion to L̇ and oppose L̈ with m_a L̈,
m_a = `leg_armature`, an inertia along u without weight.

Transverse, from the angular momentum I u×u̇ about B:   I ü⊥ + İ u̇ − h g⊥ = L f⊥,  İ = 2 m2 (L − d) L̇
Axial, upper part alone:   m2 (u·P̈ + d |u̇|² − u·g) = f∥ + F − friction − m_a L̈,  L̈ = u·P̈ + L |u̇|²
with u̇ = Ṗ⊥/L and ü⊥ = (P̈⊥ − 2 L̇ u̇)/L. So f = E P̈ + b − F u, with E = t 1 + (m2 + m_a − t) u uᵀ: at P the leg is
a point mass t = I/L² with an additional mass along its axis.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gough_stewart.model.errors import SingularPoseError
from gough_stewart.model.friction import friction_force
from gough_stewart.model.kinematics import (
    LegGeometry,
    LegRates,
    condition_number_bound,
    jacobian_of_legs,
    joint_accelerations,
    leg_geometry,
    leg_rates,
    rates_of_legs,
)
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import (
    Array,
    apply,
    centripetal,
    concatenate,
    cross,
    dot,
    per_leg,
    skew,
    transpose,
    without_warnings,
)

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
    """Leg forces (..., 6) for wrenches (..., 6), with the transposed leg Jacobian (..., 6, 6); refuses singular poses.

    Raises
    ------
    SingularPoseError
        The condition number of the matrix exceeds `LARGEST_CONDITION_NUMBER`.
    """
    # the condition number itself would take longer than everything else here
    if not np.max(condition_number_bound(matrix)) < LARGEST_CONDITION_NUMBER / 2:
        worst = float(np.max(np.linalg.cond(matrix))) if np.isfinite(matrix).all() else np.inf
        if not worst < LARGEST_CONDITION_NUMBER:
            raise SingularPoseError(
                f"leg Jacobian has condition number {worst:.3g}, expected below {LARGEST_CONDITION_NUMBER:g}: the leg "
                "forces cannot hold this pose; choose a pose away from the singularity",
                worst,
            )
    return solve_mass_matrix(matrix, vector)


@without_warnings
def mass_matrix(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Mass matrix M (..., 6, 6) for the twist [v; ω]; symmetric, positive definite.

    M = [[m 1, −m r̃], [m r̃, J − m r̃ r̃]] + Σ_i G_iᵀ E_i G_i, with Ṗ_i = G_i [v; ω], G_i = [1, −c̃_i], E_i the
    apparent mass of leg i at P_i, r = R r_G, J = R J_p Rᵀ. In kg, kg m and kg m²; position [m],
    orientation [rad] (..., 3).

    Returns
    -------
    ndarray
        M (..., 6, 6): blocks [kg], [kg m] and [kg m²] for v and ω.
    """
    rest = 0 * np.asarray(position)
    M, _ = _equations_of_motion(parameters, State(position, orientation, rest, rest))
    return M


@without_warnings
def forward_dynamics(
    parameters: Parameters, state: State, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> Acceleration:
    """Acceleration of the platform for given forces.

    [v̇; ω̇] = M⁻¹ (Jᵀ F + [f_ext; τ_ext] − n), in m/s² and rad/s²; shapes (..., 3).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    M, n = _equations_of_motion(parameters, state, legs)
    external = concatenate([inputs.external_force, inputs.external_torque])
    a = solve(M, apply(transpose(jacobian_of_legs(legs)), inputs.actuator_force) + external - n)
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
    state = State(*map(np.asarray, state))
    legs = leg_geometry(parameters, state.position, state.orientation)
    M, n = _equations_of_motion(parameters, state, legs)
    needed = apply(M, concatenate(acceleration)) + n
    return solve(transpose(jacobian_of_legs(legs)), needed - np.asarray(external_wrench))


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
    b = _bias_force(parameters, legs, rates_of_legs(legs, state))
    ddP = joint_accelerations(legs, state.angular_velocity, *acceleration)
    u, t = legs.direction, _transverse_mass(parameters, legs.length)
    along = (axial_mass(parameters) - t) * dot(u, ddP)
    inertia = t[..., None] * ddP + along[..., None] * u
    return np.asarray(actuator_force[..., None] * u - inertia - b)


@without_warnings
def kinetic_energy(parameters: Parameters, state: State) -> Array:
    """Kinetic energy (...) [J] of the platform and the six legs.

    T = ½ m |v_G|² + ½ ωᵀ R J_p Rᵀ ω + Σ_i ½ I_i |u̇_i|² + ½ (m2 + m_a) L̇_i², with v_G = v + ω×(R r_G).
    """
    legs = leg_geometry(parameters, state.position, state.orientation)
    rates = rates_of_legs(legs, state)
    R = matrix_from_orientation(state.orientation)
    v_G = state.velocity + cross(state.angular_velocity, apply(R, parameters.platform_com))
    w = apply(transpose(R), state.angular_velocity)
    _, I = _leg_moments(parameters, legs.length)
    du, dL = rates.direction_rate, rates.length_rate
    of_legs = I * dot(du, du) + axial_mass(parameters) * dL * dL
    of_platform = parameters.platform_mass * dot(v_G, v_G) + dot(w, apply(parameters.platform_inertia, w))
    return np.asarray(0.5 * (of_platform + of_legs.sum(axis=-1)))


@without_warnings
def potential_energy(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Potential energy of gravity (...) [J], zero with all masses at the world origin.

    V = −g·(m (t + R r_G) + Σ_i (m1 + m2) B_i + h_i u_i), h_i the first moment of leg i about B_i.
    """
    legs = leg_geometry(parameters, position, orientation)
    G = position + apply(matrix_from_orientation(orientation), parameters.platform_com)
    h, _ = _leg_moments(parameters, legs.length)
    leg_mass = per_leg(parameters.leg_lower_mass) + per_leg(parameters.leg_upper_mass)
    moment = np.asarray(parameters.platform_mass)[..., None] * G
    moment = moment + (leg_mass[..., None] * parameters.base_points + h[..., None] * legs.direction).sum(axis=-2)
    return np.asarray(-dot(parameters.gravity, moment))


def friction_power(parameters: Parameters, state: State) -> Array:
    """Power (...) [W] dissipated by leg friction, never negative: Σ friction(L̇_i) L̇_i."""
    dL = leg_rates(parameters, state).length_rate
    return dot(friction_force(parameters, dL), dL)


def axial_mass(parameters: Parameters) -> Array:
    """Apparent mass (..., 1) [kg] of a leg for acceleration of its platform joint along u: m2 + m_a."""
    return np.asarray(per_leg(parameters.leg_upper_mass) + per_leg(parameters.leg_armature))


def _leg_moments(parameters: Parameters, length: Array) -> tuple[Array, Array]:
    """First moment h [kg m] and transverse second moment I [kg m²] of the legs about B at lengths (..., 6) [m]."""
    m1, r1 = per_leg(parameters.leg_lower_mass), per_leg(parameters.leg_lower_com)
    m2, s2 = per_leg(parameters.leg_upper_mass), length - per_leg(parameters.leg_upper_com)
    J = per_leg(parameters.leg_lower_inertia) + per_leg(parameters.leg_upper_inertia)
    return m1 * r1 + m2 * s2, m1 * r1 * r1 + J + m2 * s2 * s2


def _transverse_mass(parameters: Parameters, length: Array) -> Array:
    """Apparent mass (..., 6) [kg] of a leg for acceleration of its platform joint across u: t = I/L²."""
    _, I = _leg_moments(parameters, length)
    return np.asarray(I * (1 / length) * (1 / length))


def _bias_force(parameters: Parameters, legs: LegGeometry, rates: LegRates) -> Array:
    """Force (..., 6, 3) [N] that the legs need at their platform joints when P̈ = 0 and F = 0.

    b = ((m2 d + m_a L) |u̇|² − m2 u·g + friction) u − (2 I L̇/L² − 2 m2 (L − d) L̇/L) u̇ − (h/L) g⊥.
    """
    u, L, m2 = legs.direction, legs.length, per_leg(parameters.leg_upper_mass)
    du, dL, g = rates.direction_rate, rates.length_rate, parameters.gravity[..., None, :]
    d, m_a = per_leg(parameters.leg_upper_com), per_leg(parameters.leg_armature)
    h, I = _leg_moments(parameters, L)
    per_g = h * (1 / L)
    along_u = (m2 * d + m_a * L) * dot(du, du) + (per_g - m2) * dot(u, g) + friction_force(parameters, dL)
    along_du = 2 * dL * (1 / L) * (m2 * (L - d) - I * (1 / L))
    return np.asarray(along_u[..., None] * u + along_du[..., None] * du - per_g[..., None] * g)


def _equations_of_motion(parameters: Parameters, state: State, legs: LegGeometry | None = None) -> tuple[Array, Array]:
    """M (..., 6, 6) and the wrench n (..., 6) that [v̇; ω̇] = 0 needs without actuators: inertia, weight, friction.

    G_iᵀ E_i G_i = t_i G_iᵀ G_i + (m_i − t_i) (G_iᵀ u_i)(G_iᵀ u_i)ᵀ, with m_i the mass along the axis of leg i: the
    platform with a point mass t_i at each P_i, one rigid body, and for each leg a dyad of its row of the leg Jacobian.
    """
    legs = leg_geometry(parameters, state.position, state.orientation) if legs is None else legs
    R, omega, arm, u = matrix_from_orientation(state.orientation), state.angular_velocity, legs.arm, legs.direction
    m, r = np.asarray(parameters.platform_mass)[..., None], apply(R, parameters.platform_com)
    t = _transverse_mass(parameters, legs.length)
    beyond = np.asarray(axial_mass(parameters) - t)

    # mass, first moment and inertia of that body about Op
    tc, mr = t[..., None] * arm, m * r
    mass, first = m + t[..., None].sum(axis=-2), mr + tc.sum(axis=-2)
    inertia = R @ parameters.platform_inertia @ transpose(R)
    inertia = inertia + _points_inertia(mr[..., None, :], r[..., None, :]) + _points_inertia(tc, arm)

    wv, rows = skew(first), jacobian_of_legs(legs)
    top, bottom = concatenate([mass[..., None] * np.eye(3), -wv]), concatenate([wv, inertia])
    rigid = transpose(concatenate([transpose(top), transpose(bottom)]))
    M = np.asarray(rigid + transpose(rows) @ (beyond[..., None] * rows))

    along = beyond * dot(u, centripetal(omega[..., None, :], arm))
    needed = _bias_force(parameters, legs, rates_of_legs(legs, state)) + along[..., None] * u
    weight = m * parameters.gravity
    force = centripetal(omega, first) + needed.sum(axis=-2) - weight
    torque = cross(omega, apply(inertia, omega)) + cross(arm, needed).sum(axis=-2) - cross(r, weight)
    return M, concatenate([force, torque])


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

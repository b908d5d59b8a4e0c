"""Dynamics of the platform in task space, M(pose) [v̇; ω̇] + n(state) = Jᵀ F + [f_ext; τ_ext], and of its legs' parts.

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

Stiction: the bristles' friction f replaces the smooth one. It acts along the leg, against the actuator force F, so the
ideal dynamics see F − f and no friction of their own.

Compliant legs: between motor and platform's side of leg i is a spring with a damper. The motor's side has the position
s, the length that the leg would have without stretch, the friction f(ṡ) and the armature:

    F_leg = k (s − L) + c (ṡ − L̇),    m_a s̈ = F − f(ṡ) − F_leg

The platform's side is the ideal dynamics under F_leg, without friction and armature. k is `leg_stiffness`, c
`leg_damping`, m_a `leg_armature`. As k grows, s → L and the two sides become the rigid leg.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.errors import SingularPoseError
from gough_stewart.model.friction import StickTerms, bristle_decay, bristle_friction, friction_force, law_of_bristles
from gough_stewart.model.interface import Inputs, State, Variant
from gough_stewart.model.kinematics import (
    LegGeometry,
    condition_number_bound,
    jacobian_of_legs,
    joint_accelerations,
    leg_geometry,
    rates_of_legs,
)
from gough_stewart.model.parameters import PHYSICAL, Parameters, of_legs
from gough_stewart.model.rotations import matrix_from_orientation, orientation_rate_from_angular_velocity
from gough_stewart.model.vectors import (
    Array,
    apply,
    centripetal,
    concatenate,
    cross,
    dot,
    greater,
    per_leg,
    skew,
    where,
    without_warnings,
)

Solve = Callable[[Array, Array], Array]

# Above this condition number of the Jacobian, leg forces would have no correct digits.
LARGEST_CONDITION_NUMBER = 1e12
# Of critical, for a leg's spring between the motor and a sixth of the platform: screws and joints have 1 to 5 %.
LEG_DAMPING_RATIO = 0.02


class EquationsOfMotion(NamedTuple):
    """M [v̇; ω̇] + n = Jᵀ F + [f_ext; τ_ext], and what its legs add to it at their platform joints."""

    mass_matrix: Array  # M (..., 6, 6)
    needed: Array  # wrench n (..., 6) that inertia, weight and friction need at [v̇; ω̇] = 0
    first_moment: Array  # h of the legs about B (..., 6) [kg m]
    mass: Array  # at P, in all directions: t = I/L² (..., 6) [kg]
    mass_along: Array  # at P, in addition along u: m2 + m_a − t (..., 6) [kg]
    bias_force: Array  # b that the legs need at P when P̈ = 0 and F = 0 (..., 6, 3) [N]


class Acceleration(NamedTuple):
    """Acceleration of the platform frame."""

    linear: Array
    """v̇ of Op (..., 3) [m/s²]."""
    angular: Array
    """ω̇ (..., 3) [rad/s²]."""


def solve_mass_matrix(matrix: Array, vector: Array) -> Array:
    """Solution of (..., 6, 6) systems for (..., 6) right-hand sides."""
    return np.linalg.solve(matrix, vector[..., None])[..., 0]


def solve_leg_forces(matrix: Array, vector: Array) -> Array:
    """Leg forces (..., 6) of wrenches (..., 6), by the transposed leg Jacobian; refuses singular poses."""
    # the condition number itself would take longer than everything else here
    if not np.max(condition_number_bound(matrix)) < LARGEST_CONDITION_NUMBER / 2:
        worst = float(np.max(np.linalg.cond(matrix))) if np.isfinite(matrix).all() else np.inf
        if not worst < LARGEST_CONDITION_NUMBER:
            raise SingularPoseError(
                f"leg Jacobian has condition number {worst:.3g}, expected below {LARGEST_CONDITION_NUMBER:g}: the leg "
                "forces cannot hold this pose; choose a pose away from the singularity",
                worst,
            )
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])


@without_warnings
def mass_matrix(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Mass matrix M (..., 6, 6) for the twist [v; ω]; symmetric, positive definite.

    M = [[m 1, −m r̃], [m r̃, J − m r̃ r̃]] + Σ_i G_iᵀ E_i G_i, with Ṗ_i = G_i [v; ω], G_i = [1, −c̃_i], E_i the
    apparent mass of leg i at P_i, r = R r_G, J = R J_p Rᵀ. The task-space form
    of eq. (30) of Liu, Li & Li (2000); docs/equations.md derives it.

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    position, orientation
        Pose (..., 3) [m], (..., 3) [rad]; leading axes broadcast.

    Returns
    -------
    ndarray
        M (..., 6, 6): blocks [kg], [kg m] and [kg m²] for v and ω.

    Raises
    ------
    ArgumentError
        An argument of another type, shape or unit.

    See Also
    --------
    inverse_dynamics, leg_jacobian, stack

    Examples
    --------
    >>> platform = gs.load_preset("liu2000")
    >>> gs.mass_matrix(platform, platform.home_position, platform.home_orientation).shape
    (6, 6)
    """
    rest = 0 * np.asarray(position)
    state, legs = State(position, orientation, rest, rest), leg_geometry(parameters, position, orientation)
    return equations_of_motion(parameters, state, legs).mass_matrix


@without_warnings
def inverse_dynamics(
    parameters: Parameters,
    state: State,
    acceleration: Acceleration,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] for a given acceleration: Jᵀ F = M [v̇; ω̇] + n − [f_ext; τ_ext].

    The task-space form of eq. (30) of Liu, Li & Li (2000), without its multipliers; docs/equations.md derives it.

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    state
        Pose and twist, each of shape (..., 3): position [m], orientation [rad], velocity [m/s], angular velocity
        [rad/s].
    acceleration
        Linear [m/s²] and angular [rad/s²], each of shape (..., 3).
    external_wrench
        [f_ext; τ_ext] (..., 6) at Op in world components [N, N m].
    solve
        Solves Jᵀ F = w for F (..., 6) [N], from Jᵀ (..., 6, 6) [1], [m] and w (..., 6) [N, N m]; by LU, with a
        check of the pose, by default.

    Returns
    -------
    ndarray
        Actuator forces (..., 6) [N]; positive extends the leg.

    Raises
    ------
    SingularPoseError
        The leg forces cannot produce the wrench at this pose.

    See Also
    --------
    static_leg_forces, mass_matrix, check

    Examples
    --------
    >>> platform, rest = gs.load_preset("motion_base"), np.zeros(3)
    >>> state = gs.State(platform.home_position, platform.home_orientation, rest, rest)
    >>> gs.inverse_dynamics(platform, state, gs.Acceleration(np.array([0, 0, 2.0]), rest))
    """
    state = State(*map(np.asarray, state))
    legs = leg_geometry(parameters, state.position, state.orientation)
    M, n, *_ = equations_of_motion(parameters, state, legs)
    needed = apply(M, concatenate(acceleration)) + n
    return solve(jacobian_of_legs(legs).mT, needed - np.asarray(external_wrench))


def static_leg_forces(
    parameters: Parameters,
    position: Array,
    orientation: Array,
    external_wrench: Array | float = 0.0,
    solve: Solve = solve_leg_forces,
) -> Array:
    """Actuator forces (..., 6) [N] that hold a pose at rest against gravity and an external wrench.

    `inverse_dynamics` at rest: Jᵀ F = n(pose, 0) − [f_ext; τ_ext].

    Parameters
    ----------
    parameters
        A platform, or a batch of them from `stack`.
    position, orientation
        Pose (..., 3) [m], (..., 3) [rad]; leading axes broadcast.
    external_wrench
        [f_ext; τ_ext] (..., 6) at Op in world components [N, N m].
    solve
        As in `inverse_dynamics`.

    Returns
    -------
    ndarray
        Actuator forces (..., 6) [N]; positive extends the leg.

    Raises
    ------
    SingularPoseError
        The leg forces cannot hold this pose.

    See Also
    --------
    inverse_dynamics, trim, evaluate_poses

    Examples
    --------
    >>> platform = gs.load_preset("liu2000")
    >>> gs.static_leg_forces(platform, platform.home_position, platform.home_orientation)
    """
    rest = 0 * np.asarray(position)
    state = State(position, orientation, rest, rest)
    return inverse_dynamics(parameters, state, Acceleration(rest, rest), external_wrench, solve)


def equations_of_motion(parameters: Parameters, state: State, legs: LegGeometry) -> EquationsOfMotion:
    """The mass matrix, the wrench that is needed without acceleration, and the terms of the legs in them.

    b = ((m2 d + m_a L) |u̇|² − m2 u·g + friction) u − (2 I L̇/L² − 2 m2 (L − d) L̇/L) u̇ − (h/L) g⊥.

    G_iᵀ E_i G_i = t_i G_iᵀ G_i + (m_i − t_i) (G_iᵀ u_i)(G_iᵀ u_i)ᵀ, with m_i the mass along the axis of leg i: the
    platform with a point mass t_i at each P_i, one rigid body, and for each leg a dyad of its row of the leg Jacobian.
    """
    arm, u, L, rates = legs.arm, legs.direction, legs.length, rates_of_legs(legs, state)
    R, omega, g = matrix_from_orientation(state.orientation), state.angular_velocity, parameters.gravity

    # legs: first moment and transverse second moment about B, masses at P
    m1, r1 = of_legs(parameters, "leg_lower_mass"), of_legs(parameters, "leg_lower_com")
    m2, d = of_legs(parameters, "leg_upper_mass"), of_legs(parameters, "leg_upper_com")
    m_a, s2 = of_legs(parameters, "leg_armature"), L - d
    J = of_legs(parameters, "leg_lower_inertia") + of_legs(parameters, "leg_upper_inertia")
    h, I = m1 * r1 + m2 * s2, m1 * r1 * r1 + J + m2 * s2 * s2
    t = np.asarray(I * (1 / L) * (1 / L))
    beyond = np.asarray(m2 + m_a - t)

    # legs: bias force
    du, dL, per_g, weight_axis = rates.direction_rate, rates.length_rate, h * (1 / L), g[..., None, :]
    along_u = (m2 * d + m_a * L) * dot(du, du) + (per_g - m2) * dot(u, weight_axis) + friction_force(parameters, dL)
    along_du = 2 * dL * (1 / L) * (m2 * s2 - I * (1 / L))
    b = np.asarray(along_u[..., None] * u + along_du[..., None] * du - per_g[..., None] * weight_axis)

    # rigid body: mass, first moment and inertia about Op, tr(S) 1 − S with S = Σ m r rᵀ of point masses at r
    m, r = np.asarray(parameters.platform_mass)[..., None], apply(R, parameters.platform_com)
    tc, mr = t[..., None] * arm, m * r
    mass, first = m + t[..., None].sum(axis=-2), mr + tc.sum(axis=-2)
    inertia = R @ parameters.platform_inertia @ R.mT
    for moments, points in ((mr[..., None, :], r[..., None, :]), (tc, arm)):
        xx, yy, zz, xy, xz, yz = (
            (moments[..., i] * points[..., k]).sum(axis=-1) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        )
        S = ((yy + zz, -xy, -xz), (-xy, xx + zz, -yz), (-xz, -yz, xx + yy))
        inertia = inertia + np.stack([np.stack(row, axis=-1) for row in S], axis=-2)

    # the body's mass matrix, and a dyad for each leg
    wv, rows = skew(first), jacobian_of_legs(legs)
    top, bottom = concatenate([mass[..., None] * np.eye(3), -wv]), concatenate([wv, inertia])
    rigid = concatenate([top.mT, bottom.mT]).mT
    M = np.asarray(rigid + rows.mT @ (beyond[..., None] * rows))

    # what velocities, weight and friction need
    along = beyond * dot(u, centripetal(omega[..., None, :], arm))
    needed, weight = b + along[..., None] * u, m * g
    force = centripetal(omega, first) + needed.sum(axis=-2) - weight
    torque = cross(omega, apply(inertia, omega)) + cross(arm, needed).sum(axis=-2) - cross(r, weight)
    return EquationsOfMotion(M, concatenate([force, torque]), h, t, beyond, b)


@without_warnings
def plant_equations(
    variant: Variant, parameters: Parameters, x: Array, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> tuple[Array, dict[str, Array]]:
    """ẋ (..., n) in the order of the variant's states, and its outputs and locals by name.

    `leg_force` is that on the platform's side of each leg; `joint_force`, of the leg on the platform at P_i, is
    −f_i = F_i u_i − E_i P̈_i − b_i, the multipliers λ_i of eq. (30). Energies are T = ½ [v; ω]ᵀ M [v; ω] and
    V = −g·(m (t + R r_G) + Σ_i (m1 + m2) B_i + h_i u_i), zero with all masses at the world origin, and those of motors
    and springs, not of bristles.
    """
    platform, parts = State.from_vector(x[..., :12]), interface.unpack(variant.states[4:], x[..., 12:])
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    rates = rates_of_legs(legs, platform)

    # friction at the sliding velocity, then the spring between the motor and the platform's side
    part_rates, leg_force = list[Array](), inputs.actuator_force
    sliding = parts["motor_velocity"] if variant.springs else rates.length_rate
    if variant.bristles:
        friction, bristle_rate = bristle_friction(law_of_bristles(variant, parameters), sliding, parts["leg_bristle"])
        part_rates.append(bristle_rate)
        leg_force = leg_force - friction
    elif variant.springs:
        leg_force = leg_force - friction_force(parameters, sliding)
    if variant.springs:
        k, m_a, motor_force = of_legs(parameters, "leg_stiffness"), of_legs(parameters, "leg_armature"), leg_force
        # positive extends the leg
        stretch, stretch_rate = parts["motor_position"] - legs.length, sliding - rates.length_rate
        leg_force = k * stretch + leg_damping(parameters) * stretch_rate
        part_rates += [sliding, (motor_force - leg_force) / m_a]

    M, n, h, t, beyond, bias_force = equations_of_motion(platform_side(variant, parameters), platform, legs)
    external = concatenate([inputs.external_force, inputs.external_torque])
    acceleration = solve(M, apply(jacobian_of_legs(legs).mT, leg_force) + external - n)
    linear, angular = acceleration[..., :3], acceleration[..., 3:]
    turning = orientation_rate_from_angular_velocity(platform.orientation, platform.angular_velocity)

    u, ddP = legs.direction, joint_accelerations(legs, platform.angular_velocity, linear, angular)
    inertia = t[..., None] * ddP + (beyond * dot(u, ddP))[..., None] * u
    twist = concatenate([platform.velocity, platform.angular_velocity])
    kinetic = 0.5 * dot(twist, apply(M, twist))
    G = platform.position + apply(matrix_from_orientation(platform.orientation), parameters.platform_com)
    leg_mass = of_legs(parameters, "leg_lower_mass") + of_legs(parameters, "leg_upper_mass")
    moment = (leg_mass[..., None] * parameters.base_points + h[..., None] * u).sum(axis=-2)
    potential = -dot(parameters.gravity, np.asarray(parameters.platform_mass)[..., None] * G + moment)
    if variant.springs:
        kinetic = kinetic + 0.5 * (m_a * sliding * sliding).sum(axis=-1)
        potential = potential + 0.5 * (k * stretch * stretch).sum(axis=-1)
    return concatenate([platform.velocity, turning, linear, angular, *part_rates]), {
        **platform._asdict(),
        **parts,
        "leg_length": legs.length,
        "leg_velocity": rates.length_rate,
        "acceleration": linear,
        "angular_acceleration": angular,
        "joint_force": leg_force[..., None] * u - inertia - bias_force,
        "leg_force": leg_force,
        "kinetic_energy": kinetic,
        "potential_energy": potential,
    }


def platform_side(variant: Variant, parameters: Parameters) -> Parameters:
    """The parameters for the ideal dynamics under the force on the platform's side of the legs."""
    if not variant.parts:
        return parameters
    without = {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0}
    if variant.springs:
        without["leg_armature"] = 0.0
    values: dict[str, Any] = {row.name: getattr(parameters, row.name) for row in PHYSICAL}
    return Parameters(**(values | {name: 0.0 * values[name] for name in without}))


def grip_of_legs(variant: Variant, parameters: Parameters, x: Array, solve: Solve = solve_mass_matrix) -> StickTerms:
    """What the bristles do within a step.

    The part σ1 ż of friction accelerates the platform by −Γ ż with Γ = M⁻¹ Jᵀ diag(σ1), motors that have springs with
    Γ = diag(σ1)/m_a.
    """
    platform, parts = State.from_vector(x[..., :12]), interface.unpack(variant.states[4:], x[..., 12:])
    law, legs = law_of_bristles(variant, parameters), leg_geometry(parameters, platform.position, platform.orientation)
    if variant.springs:
        sliding = parts["motor_velocity"]
        gain = np.eye(6) * (law.damping / of_legs(parameters, "leg_armature"))[..., None]
    else:
        sliding = rates_of_legs(legs, platform).length_rate
        M, wrenches = mass_matrix(parameters, platform.position, platform.orientation), jacobian_of_legs(legs)
        rows = [solve(M, law.damping[..., i : i + 1] * wrenches[..., i, :]) for i in range(6)]
        gain = np.stack(rows, axis=-1)
    decay = bristle_decay(law, sliding, parts["leg_bristle"])
    return StickTerms(decay, gain, law.stiffness / law.damping, law.coulomb / law.stiffness, sliding)


def leg_damping(parameters: Parameters) -> Array:
    """C (..., 6) [N s/m]: `leg_damping`, or where that is 0 `LEG_DAMPING_RATIO` of critical."""
    motor = of_legs(parameters, "leg_armature")
    load = of_legs(parameters, "leg_upper_mass") + np.asarray(per_leg(parameters.platform_mass) / 6)
    critical = 2 * np.sqrt(of_legs(parameters, "leg_stiffness") * motor * load / (motor + load))
    damping = of_legs(parameters, "leg_damping")
    return where(greater(damping, 0.0), damping, LEG_DAMPING_RATIO * critical)


def holding_motor_position(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Motor positions (..., 6) [m] that hold a pose at rest: leg length plus stretch, s = L + F/k; L of rigid legs."""
    length = leg_geometry(parameters, position, orientation).length
    if not np.all(parameters.leg_stiffness > 0):
        return length
    forces = static_leg_forces(parameters, position, orientation)
    return np.asarray(length + forces / of_legs(parameters, "leg_stiffness"))


def motors_at(parameters: Parameters, state: State) -> dict[str, Array]:
    """`motor_position` and `motor_velocity` (..., 6) that hold a pose and move with its twist."""
    legs = leg_geometry(parameters, state.position, state.orientation)
    return {
        "motor_position": holding_motor_position(parameters, state.position, state.orientation),
        "motor_velocity": rates_of_legs(legs, state).length_rate,
    }


def states_at(platform: Parameters, state: State) -> dict[str, Array]:
    """The states at a pose and its twist, by name: compliant legs hold it; bristles, which start at 0, are left out."""
    return state._asdict() | (motors_at(platform, state) if Variant.of(platform).springs else {})

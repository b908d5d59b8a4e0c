"""The plant of any variant: what stiction and compliant legs add to `dynamics`.

Rigid legs with stiction: the bristles' friction f replaces the smooth one. It acts along the leg, against the actuator
force F, so the ideal dynamics see F − f and no friction of their own.

Compliant legs: between motor and platform's side of leg i is a spring with a damper. The motor's side has the position
s, the length that the leg would have without stretch, the friction f(ṡ) and the armature:

    F_leg = k (s − L) + c (ṡ − L̇),    m_a s̈ = F − f(ṡ) − F_leg

The platform's side is the ideal dynamics under F_leg, without friction and armature. k is `leg_stiffness`, c
`leg_damping`, m_a `leg_armature`. As k grows, s → L and the two sides become the rigid leg.
"""

from typing import Any

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.dynamics import (
    Solve,
    forward_dynamics,
    joint_forces,
    kinetic_energy,
    mass_matrix,
    potential_energy,
    solve_mass_matrix,
    static_leg_forces,
)
from gough_stewart.model.friction import Grip, bristle_decay, bristle_friction, friction_force, law_of_bristles
from gough_stewart.model.kinematics import jacobian_of_legs, leg_geometry, leg_rates, rates_of_legs
from gough_stewart.model.operations import greater, where
from gough_stewart.model.parameters import PHYSICAL, Parameters
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import Array, concatenate, per_leg

# Of critical, for a leg's spring between the motor and a sixth of the platform: screws and joints have 1 to 5 %.
LEG_DAMPING_RATIO = 0.02


def machine_equations(
    variant: Variant, parameters: Parameters, x: Array, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> tuple[Array, dict[str, Array]]:
    """ẋ (..., n) in the order of the variant's states, and its outputs and locals by name.

    `leg_force` is that on the platform's side of each leg. Energies are with those of motors and springs, not of
    bristles.
    """
    platform, parts = State.from_vector(x[..., :12]), interface.unpack(variant.states[4:], x[..., 12:])
    rigid_side = platform_side(variant, parameters)
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    rates = rates_of_legs(legs, platform)

    # friction at the sliding velocity, then the spring between the motor and the platform's side
    part_rates, leg_force = list[Array](), inputs.actuator_force
    sliding = parts["motor_velocity"] if variant.springs else rates.length_rate
    if variant.bristles:
        law = law_of_bristles(variant, parameters)
        friction, bristle_rate = bristle_friction(law, sliding, parts["leg_bristle"])
        part_rates.append(bristle_rate)
        leg_force = leg_force - friction
    elif variant.springs:
        leg_force = leg_force - friction_force(parameters, sliding)
    if variant.springs:
        k, motor_force = per_leg(parameters.leg_stiffness), leg_force
        # positive extends the leg
        stretch, stretch_rate = parts["motor_position"] - legs.length, sliding - rates.length_rate
        leg_force = k * stretch + leg_damping(parameters) * stretch_rate
        part_rates += [sliding, (motor_force - leg_force) / per_leg(parameters.leg_armature)]
    acceleration = forward_dynamics(rigid_side, platform, inputs._replace(actuator_force=leg_force), solve)
    turning = orientation_rate_from_angular_velocity(platform.orientation, platform.angular_velocity)

    kinetic = kinetic_energy(rigid_side, platform)
    potential = potential_energy(parameters, platform.position, platform.orientation)
    if variant.springs:
        kinetic = kinetic + 0.5 * (per_leg(parameters.leg_armature) * sliding * sliding).sum(axis=-1)
        potential = potential + 0.5 * (k * stretch * stretch).sum(axis=-1)
    return concatenate([platform.velocity, turning, *acceleration, *part_rates]), {
        **platform._asdict(),
        **parts,
        "leg_length": legs.length,
        "leg_velocity": rates.length_rate,
        "acceleration": acceleration.linear,
        "angular_acceleration": acceleration.angular,
        "joint_force": joint_forces(rigid_side, platform, leg_force, acceleration),
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


def grip_of_legs(variant: Variant, parameters: Parameters, x: Array, solve: Solve = solve_mass_matrix) -> Grip:
    """What the bristles do within a step.

    The part σ1 ż of friction accelerates the platform by −Γ ż with Γ = M⁻¹ Jᵀ diag(σ1), motors that have springs with
    Γ = diag(σ1)/m_a.
    """
    platform, parts = State.from_vector(x[..., :12]), interface.unpack(variant.states[4:], x[..., 12:])
    law, legs = law_of_bristles(variant, parameters), leg_geometry(parameters, platform.position, platform.orientation)
    if variant.springs:
        sliding = parts["motor_velocity"]
        gain = np.eye(6) * (law.damping / per_leg(parameters.leg_armature))[..., None]
    else:
        sliding = rates_of_legs(legs, platform).length_rate
        M, wrenches = mass_matrix(parameters, platform.position, platform.orientation), jacobian_of_legs(legs)
        rows = [solve(M, law.damping[..., i : i + 1] * wrenches[..., i, :]) for i in range(6)]
        gain = np.stack(rows, axis=-1)
    decay = bristle_decay(law, sliding, parts["leg_bristle"])
    return Grip(decay, gain, law.stiffness / law.damping, law.coulomb / law.stiffness, sliding)


def leg_damping(parameters: Parameters) -> Array:
    """C (..., 1) [N s/m]: `leg_damping`, or where that is 0 `LEG_DAMPING_RATIO` of critical."""
    motor = per_leg(parameters.leg_armature)
    load = per_leg(parameters.leg_upper_mass) + np.asarray(per_leg(parameters.platform_mass) / 6)
    critical = 2 * np.sqrt(per_leg(parameters.leg_stiffness) * motor * load / (motor + load))
    damping = per_leg(parameters.leg_damping)
    return where(greater(damping, 0.0), damping, LEG_DAMPING_RATIO * critical)


def holding_motor_position(parameters: Parameters, position: Array, orientation: Array) -> Array:
    """Motor positions (..., 6) [m] that hold a pose at rest: leg length plus stretch, s = L + F/k; L of rigid legs.

    Raises
    ------
    SingularPoseError
        The leg forces cannot hold this pose.
    """
    length = leg_geometry(parameters, position, orientation).length
    if not np.all(parameters.leg_stiffness > 0):
        return length
    forces = static_leg_forces(parameters, position, orientation)
    return np.asarray(length + forces / per_leg(parameters.leg_stiffness))


def motors_at(parameters: Parameters, state: State) -> dict[str, Array]:
    """`motor_position` and `motor_velocity` (..., 6) that hold a pose and move with its twist."""
    return {
        "motor_position": holding_motor_position(parameters, state.position, state.orientation),
        "motor_velocity": leg_rates(parameters, state).length_rate,
    }


def states_at(platform: Parameters, state: State) -> dict[str, Array]:
    """The states at a pose and its twist, by name: compliant legs hold it; bristles, which start at 0, are left out."""
    return state._asdict() | (motors_at(platform, state) if Variant.of(platform).springs else {})

"""The plant of any variant: what stiction and compliant legs add to `dynamics`.

Rigid legs with stiction: the bristles' friction f replaces the smooth one. It acts along the leg, against the actuator
force F, so the ideal dynamics see F − f and no friction of their own.

Compliant legs: between motor and platform's side of leg i is a spring with a damper. The motor's side has the position
s, the length that the leg would have without stretch, the friction f(ṡ) and the armature:

    F_leg = k (s − L) + c (ṡ − L̇),    m_a s̈ = F − f(ṡ) − F_leg

The platform's side is the ideal dynamics under F_leg, without friction and armature. k is `leg_stiffness`, c
`leg_damping`, m_a `leg_armature`. As k grows, s → L and the two sides become the rigid leg.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from gough_stewart.model.dynamics import (
    Acceleration,
    Solve,
    axial_mass,
    forward_dynamics,
    joint_forces,
    kinetic_energy,
    mass_matrix,
    potential_energy,
    solve_mass_matrix,
    static_leg_forces,
)
from gough_stewart.model.friction import (
    Bristles,
    Grip,
    bristle_decay,
    bristle_force,
    bristle_rate,
    bristles_of,
    friction_force,
)
from gough_stewart.model.interface import Variant
from gough_stewart.model.kinematics import jacobian_of_legs, leg_geometry, leg_rates, rates_of_legs
from gough_stewart.model.operations import greater, where
from gough_stewart.model.parameters import PHYSICAL, Parameters
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, concatenate, per_leg

# Of critical, for a leg's spring between the motor and a sixth of the platform: screws and joints have 1 to 5 %.
LEG_DAMPING_RATIO = 0.02


class MachineState(NamedTuple):
    """The states of a variant: those of the platform, and of the parts that it has."""

    platform: State
    # None for a part that it does not have
    leg_bristle: Any  # z (..., 6) [m]
    motor_position: Any  # s (..., 6) [m]
    motor_velocity: Any  # ṡ (..., 6) [m/s]

    @classmethod
    def from_vector(cls, variant: Variant, x: Array) -> Self:
        """Split a (..., n) vector of the variant's states."""
        parts, at = dict.fromkeys(cls._fields[1:]), 12
        for v in variant.states[4:]:
            parts[v.name], at = x[..., at : at + 6], at + 6
        return cls(State.from_vector(x[..., :12]), **parts)


class MachineRates(NamedTuple):
    """What a variant's equations give; entries of parts that it does not have are None."""

    acceleration: Acceleration
    bristle_rate: Array | None  # ż (..., 6) [m/s]
    motor_acceleration: Array | None  # s̈ (..., 6) [m/s2]
    leg_force: Array  # on the platform's side of each leg (..., 6) [N]: F of the ideal plant, F − f of rigid legs


def machine_rates(
    variant: Variant, parameters: Parameters, state: MachineState, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> MachineRates:
    """Accelerations, rates of the bristles, and forces of the legs, for given forces of actuators and surroundings."""
    F, platform = inputs.actuator_force, state.platform
    if not variant.parts:
        return MachineRates(forward_dynamics(parameters, platform, inputs, solve), None, None, F)
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    rates = rates_of_legs(legs, platform)
    sliding = state.motor_velocity if variant.springs else rates.length_rate
    bristle_rates = None
    if variant.bristles:
        law = law_of_bristles(variant, parameters)
        friction = bristle_force(law, sliding, state.leg_bristle)
        bristle_rates = bristle_rate(law, sliding, state.leg_bristle)
    else:
        friction = friction_force(parameters, sliding)
    leg_force, motor_acceleration = F - friction, None
    if variant.springs:
        # F_leg = k (s − L) + c (ṡ − L̇), positive extends the leg
        stretch, stretch_rate = state.motor_position - legs.length, state.motor_velocity - rates.length_rate
        leg_force = per_leg(parameters.leg_stiffness) * stretch + leg_damping(parameters) * stretch_rate
        motor_acceleration = (F - friction - leg_force) / per_leg(parameters.leg_armature)
    inputs = inputs._replace(actuator_force=leg_force)
    acceleration = forward_dynamics(platform_side(variant, parameters), platform, inputs, solve)
    return MachineRates(acceleration, bristle_rates, motor_acceleration, leg_force)


def machine_derivatives(state: MachineState, rates: MachineRates) -> Array:
    """ẋ (..., n), in the order of the variant's states."""
    platform = state.platform
    turning = orientation_rate_from_angular_velocity(platform.orientation, platform.angular_velocity)
    parts = [platform.velocity, turning, *rates.acceleration]
    if rates.bristle_rate is not None:
        parts.append(rates.bristle_rate)
    if rates.motor_acceleration is not None:
        parts += [state.motor_velocity, rates.motor_acceleration]
    return concatenate(parts)


def platform_side(variant: Variant, parameters: Parameters) -> Parameters:
    """The parameters for the ideal dynamics under the force on the platform's side of the legs."""
    if not variant.parts:
        return parameters
    without = {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0}
    if variant.springs:
        without["leg_armature"] = 0.0
    values: dict[str, Any] = {row.name: getattr(parameters, row.name) for row in PHYSICAL}
    return Parameters(**(values | {name: 0.0 * values[name] for name in without}))


def law_of_bristles(variant: Variant, parameters: Parameters) -> Bristles:
    """The friction law with its defaults for this variant: a rigid leg moves a sixth of the platform with it."""
    if variant.springs:
        return bristles_of(parameters, per_leg(parameters.leg_armature))
    return bristles_of(parameters, axial_mass(parameters) + np.asarray(per_leg(parameters.platform_mass) / 6))


def grip_of_legs(
    variant: Variant, parameters: Parameters, state: MachineState, solve: Solve = solve_mass_matrix
) -> Grip:
    """What the bristles do within a step.

    The part σ1 ż of friction accelerates the platform by −Γ ż with Γ = M⁻¹ Jᵀ diag(σ1), motors that have springs with
    Γ = diag(σ1)/m_a.
    """
    law = law_of_bristles(variant, parameters)
    if variant.springs:
        gain = np.eye(6) * (law.damping / per_leg(parameters.leg_armature))[..., None]
    else:
        pose = state.platform.position, state.platform.orientation
        M, wrenches = mass_matrix(parameters, *pose), jacobian_of_legs(leg_geometry(parameters, *pose))
        rows = [solve(M, law.damping[..., i : i + 1] * wrenches[..., i, :]) for i in range(6)]
        gain = np.stack(rows, axis=-1)
    sliding = np.asarray(state.motor_velocity if variant.springs else leg_rates(parameters, state.platform).length_rate)
    decay = bristle_decay(law, sliding, state.leg_bristle)
    return Grip(decay, gain, law.stiffness / law.damping, law.coulomb / law.stiffness, sliding)


def leg_damping(parameters: Parameters) -> Array:
    """C (..., 1) [N s/m]: `leg_damping`, or where that is 0 `LEG_DAMPING_RATIO` of critical."""
    motor = per_leg(parameters.leg_armature)
    load = per_leg(parameters.leg_upper_mass) + np.asarray(per_leg(parameters.platform_mass) / 6)
    critical = 2 * np.sqrt(per_leg(parameters.leg_stiffness) * motor * load / (motor + load))
    damping = per_leg(parameters.leg_damping)
    return where(greater(damping, 0.0), damping, LEG_DAMPING_RATIO * critical)


def machine_results(
    variant: Variant, parameters: Parameters, state: MachineState, rates: MachineRates
) -> dict[str, Array]:
    """All outputs and locals of the variant by name; energies with those of motors and springs, not of bristles."""
    platform, rigid_side = state.platform, platform_side(variant, parameters)
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    kinetic = kinetic_energy(rigid_side, platform)
    potential = potential_energy(parameters, platform.position, platform.orientation)
    results = {
        **platform._asdict(),
        "leg_length": legs.length,
        "leg_velocity": rates_of_legs(legs, platform).length_rate,
        "acceleration": rates.acceleration.linear,
        "angular_acceleration": rates.acceleration.angular,
        "joint_force": joint_forces(rigid_side, platform, rates.leg_force, rates.acceleration),
    }
    if variant.bristles:
        results["leg_bristle"] = state.leg_bristle
    if variant.springs:
        s, ds = state.motor_position, state.motor_velocity
        kinetic = kinetic + 0.5 * (per_leg(parameters.leg_armature) * ds * ds).sum(axis=-1)
        stretch = s - legs.length
        potential = potential + 0.5 * (per_leg(parameters.leg_stiffness) * stretch * stretch).sum(axis=-1)
        results |= {"motor_position": s, "motor_velocity": ds, "leg_force": rates.leg_force}
    return results | {"kinetic_energy": kinetic, "potential_energy": potential}


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

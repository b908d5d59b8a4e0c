"""The plant of any variant: what friction that sticks and legs that give add to `dynamics`.

Rigid legs that stick: the bristles' friction f replaces the smooth one. It acts along the leg, against the actuator
force F, so the ideal dynamics see F − f and no friction of their own.

Legs that give: between motor and platform's side of leg i is a spring with a damper. The motor's side has the position
s, the length that the leg would have without stretch, the friction f(ṡ) and the armature:

    F_leg = k (s − L) + c (ṡ − L̇),    m_a s̈ = F − f(ṡ) − F_leg

The platform's side is the ideal dynamics under F_leg, without friction and armature. k is `leg_stiffness`, c
`leg_damping`, m_a `leg_armature`. As k grows, s → L and the two sides become the rigid leg.
"""

from typing import Any, NamedTuple, Self

import numpy as np

from gough_stewart.model import energy
from gough_stewart.model.dynamics import (
    Acceleration,
    Solve,
    forward_dynamics,
    joint_forces,
    mass_matrix,
    solve_mass_matrix,
    static_leg_forces,
)
from gough_stewart.model.friction import Bristles, Grip, bristle_decay, bristle_force, bristle_rate, bristles_of
from gough_stewart.model.kinematics import (
    LegGeometry,
    LegRates,
    jacobian_of_legs,
    leg_geometry,
    leg_rates,
    rates_of_legs,
)
from gough_stewart.model.leg_dynamics import axial_mass, friction_force
from gough_stewart.model.operations import greater, where
from gough_stewart.model.parameters import PHYSICAL, Parameters
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.variant import LUGRE, Variant
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


class Rates(NamedTuple):
    """What a variant's equations give; entries of parts that it does not have are None."""

    acceleration: Acceleration
    bristle_rate: Array | None  # ż (..., 6) [m/s]
    motor_acceleration: Array | None  # s̈ (..., 6) [m/s2]
    leg_force: Array  # on the platform's side of each leg (..., 6) [N]: F − f of rigid legs


def machine_rates(
    variant: Variant, parameters: Parameters, state: MachineState, inputs: Inputs, solve: Solve = solve_mass_matrix
) -> Rates:
    """Accelerations, rates of the bristles, and forces of the legs, for given forces of actuators and surroundings."""
    F, platform = inputs.actuator_force, state.platform
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    rates = rates_of_legs(legs, platform)
    sliding = state.motor_velocity if variant.springs else rates.length_rate
    friction, bent = _friction(variant, parameters, sliding, state.leg_bristle)
    if variant.springs:
        leg_force = spring_force(parameters, legs, rates, state.motor_position, state.motor_velocity)
        motor = (F - friction - leg_force) / per_leg(parameters.leg_armature)
    else:
        leg_force, motor = F - friction, None
    own = platform_side(variant, parameters)
    return Rates(
        forward_dynamics(own, platform, inputs._replace(actuator_force=leg_force), solve), bent, motor, leg_force
    )


def machine_derivatives(state: MachineState, rates: Rates) -> Array:
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
    without = {"leg_viscous_friction": 0.0, "leg_coulomb_friction": 0.0}
    if variant.springs:
        without["leg_armature"] = 0.0
    values: dict[str, Any] = {row.name: getattr(parameters, row.name) for row in PHYSICAL}
    return Parameters(**(values | {name: 0.0 * values[name] for name in without}))


def law_of_bristles(variant: Variant, parameters: Parameters) -> Bristles:
    """The friction law with its defaults for this variant: a rigid leg moves a sixth of the platform with it."""
    mass = per_leg(parameters.leg_armature) if variant.springs else axial_mass(parameters) + _share(parameters)
    return bristles_of(parameters, mass)


def decay_of_bristles(variant: Variant, parameters: Parameters, state: MachineState) -> Array:
    """Rates d (..., 6) [1/s] at which the bristles forget: ż = v − d z."""
    return bristle_decay(
        law_of_bristles(variant, parameters), sliding_velocity(variant, parameters, state), state.leg_bristle
    )


def sliding_velocity(variant: Variant, parameters: Parameters, state: MachineState) -> Array:
    """Velocities v (..., 6) [m/s] at which friction acts: of the motors if legs give, else of the legs."""
    return np.asarray(state.motor_velocity if variant.springs else leg_rates(parameters, state.platform).length_rate)


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
    sliding = sliding_velocity(variant, parameters, state)
    decay = bristle_decay(law, sliding, state.leg_bristle)
    return Grip(decay, gain, law.stiffness / law.damping, law.coulomb / law.stiffness, sliding)


def leg_damping(parameters: Parameters) -> Array:
    """C (..., 1) [N s/m]: `leg_damping`, or where that is 0 `LEG_DAMPING_RATIO` of critical."""
    motor, own = per_leg(parameters.leg_armature), per_leg(parameters.leg_upper_mass) + _share(parameters)
    critical = 2 * np.sqrt(per_leg(parameters.leg_stiffness) * motor * own / (motor + own))
    given = per_leg(parameters.leg_damping)
    return where(greater(given, 0.0), given, LEG_DAMPING_RATIO * critical)


def spring_force(
    parameters: Parameters, legs: LegGeometry, rates: LegRates, motor_position: Array, motor_velocity: Array
) -> Array:
    """F_leg = k (s − L) + c (ṡ − L̇) (..., 6) [N], positive extends the leg."""
    stretch, rate = motor_position - legs.length, motor_velocity - rates.length_rate
    return np.asarray(per_leg(parameters.leg_stiffness) * stretch + leg_damping(parameters) * rate)


def machine_results(variant: Variant, parameters: Parameters, state: MachineState, rates: Rates) -> dict[str, Array]:
    """All outputs and locals of the variant by name; energies with those of motors and springs, not of bristles."""
    platform, own = state.platform, platform_side(variant, parameters)
    legs = leg_geometry(parameters, platform.position, platform.orientation)
    kinetic = energy.kinetic_energy(own, platform)
    potential = energy.potential_energy(parameters, platform.position, platform.orientation)
    results = {
        **platform._asdict(),
        "leg_length": legs.length,
        "leg_velocity": rates_of_legs(legs, platform).length_rate,
        "acceleration": rates.acceleration.linear,
        "angular_acceleration": rates.acceleration.angular,
        "joint_force": joint_forces(own, platform, rates.leg_force, rates.acceleration),
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
    """The states at a pose and its twist, by name: legs that give hold it; bristles, which start at 0, are left out."""
    return state._asdict() | (motors_at(platform, state) if Variant.of(platform).springs else {})


def friction_hints(platform: Parameters) -> tuple[str, ...]:
    """One line if LuGre friction is not passive: σ1 < σ2 F_c/(F_s − F_c) of the leg where that is most exceeded.

    The condition of N. Barahanov, R. Ortega, "Necessary and sufficient conditions for passivity of the LuGre friction
    model", IEEE Trans. Automatic Control 45(4), 2000.
    """
    variant = Variant.of(platform)
    if platform.leg_friction_model != LUGRE:
        return ()
    law = law_of_bristles(variant, platform)
    excess = law.static - law.coulomb
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(excess > 0, law.viscous * law.coulomb / excess, np.inf)
    if (law.damping < bound).all():
        return ()
    k = int(np.argmax(law.damping - bound))
    return (
        f"LuGre friction is not passive: its bristles' damping is {law.damping[k]:.3g} N s/m, and passive is below "
        f"sigma2 F_c/(F_s - F_c) = {bound[k]:.3g} N s/m, so that it may drive a leg for a moment; lower "
        "leg_bristle_damping or leg_static_friction, or use leg_friction_model = 'elasto_plastic'",
    )


def _friction(
    variant: Variant, parameters: Parameters, sliding: Array, bristle: Array | None
) -> tuple[Array, Array | None]:
    """Friction (..., 6) [N] at a sliding velocity, and the rate of the bristles [m/s]."""
    if bristle is None:
        return friction_force(parameters, sliding), None
    law = law_of_bristles(variant, parameters)
    return bristle_force(law, sliding, bristle), bristle_rate(law, sliding, bristle)


def _share(parameters: Parameters) -> Array:
    """A sixth of the platform's mass (..., 1) [kg]."""
    return np.asarray(per_leg(parameters.platform_mass) / 6)

"""Kinetic and potential energy of platform and legs, and the power of actuators and friction."""

import numpy as np

from gough_stewart.model.kinematics import leg_geometry, leg_rates, rates_of_legs
from gough_stewart.model.leg_dynamics import axial_mass, friction_force, leg_moments
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import State
from gough_stewart.model.vectors import Array, apply, cross, dot, per_leg, transpose, without_warnings


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
    I = leg_moments(parameters, legs.length).second
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
    h = leg_moments(parameters, legs.length).first
    leg_mass = per_leg(parameters.leg_lower_mass) + per_leg(parameters.leg_upper_mass)
    moment = np.asarray(parameters.platform_mass)[..., None] * G
    moment = moment + (leg_mass[..., None] * parameters.base_points + h[..., None] * legs.direction).sum(axis=-2)
    return np.asarray(-dot(parameters.gravity, moment))


def friction_power(parameters: Parameters, state: State) -> Array:
    """Power (...) [W] dissipated by leg friction, never negative: Σ friction(L̇_i) L̇_i."""
    dL = leg_rates(parameters, state).length_rate
    return dot(friction_force(parameters, dL), dL)

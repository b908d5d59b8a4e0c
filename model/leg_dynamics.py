"""Dynamics of one leg, reduced to its platform joint: the force that the leg needs there.

A leg is two slender parts that rotate together about B and slide on each other along u, without spin about u
(paper, eq. (25)). Its inertia about B is I = m1 r1² + J1 + J2 + m2 (L − d)², its first moment
h = m1 r1 + m2 (L − d), with r1 = `leg_lower_com`, d = `leg_upper_com`. The rotor and screw of an electric actuator
rotate in proportion to L̇ and oppose L̈ with m_a L̈, m_a = `leg_armature`, an inertia along u without weight.

Transverse, from the angular momentum I u×u̇ about B:   I ü⊥ + İ u̇ − h g⊥ = L f⊥,  İ = 2 m2 (L − d) L̇
Axial, upper part alone:   m2 (u·P̈ + d |u̇|² − u·g) = f∥ + F − friction − m_a L̈,  L̈ = u·P̈ + L |u̇|²
with u̇ = Ṗ⊥/L and ü⊥ = (P̈⊥ − 2 L̇ u̇)/L. So f = E P̈ + b − F u is the force that the leg needs at P.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.kinematics import LegGeometry, LegRates
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.vectors import Array, dot, per_leg


class LegMoments(NamedTuple):
    """Mass moments of the whole leg about its base joint; each (..., 6)."""

    first: Array  # h [kg m]
    second: Array  # I, transverse [kg m2]


def leg_moments(parameters: Parameters, length: Array) -> LegMoments:
    """First and second mass moment of the legs about B at leg lengths (..., 6) [m]."""
    m1, r1 = per_leg(parameters.leg_lower_mass), per_leg(parameters.leg_lower_com)
    m2, s2 = per_leg(parameters.leg_upper_mass), length - per_leg(parameters.leg_upper_com)
    J = per_leg(parameters.leg_lower_inertia) + per_leg(parameters.leg_upper_inertia)
    return LegMoments(m1 * r1 + m2 * s2, m1 * r1 * r1 + J + m2 * s2 * s2)


def friction_force(parameters: Parameters, length_rate: Array) -> Array:
    """Friction (..., 6) [N] against the sliding velocity (..., 6) [m/s]: c_i L̇_i + C_i tanh(L̇_i/v_s).

    c_i is `leg_viscous_friction` times the leg's `leg_viscous_friction_factor`, C_i likewise `leg_coulomb_friction`
    times its factor; `leg_friction_velocity` v_s smooths the sign of the Coulomb part.
    """
    c = per_leg(parameters.leg_viscous_friction) * parameters.leg_viscous_friction_factor
    C = per_leg(parameters.leg_coulomb_friction) * parameters.leg_coulomb_friction_factor
    return np.asarray(c * length_rate + C * np.tanh(length_rate / per_leg(parameters.leg_friction_velocity)))


def transverse_mass(parameters: Parameters, length: Array) -> Array:
    """Apparent mass (..., 6) [kg] of a leg for acceleration of its platform joint across u: t = I/L²."""
    return np.asarray(leg_moments(parameters, length).second * (1 / length) * (1 / length))


def axial_mass(parameters: Parameters) -> Array:
    """Apparent mass (..., 1) [kg] of a leg for acceleration of its platform joint along u: m2 + m_a."""
    return np.asarray(per_leg(parameters.leg_upper_mass) + per_leg(parameters.leg_armature))


def inertia_force(parameters: Parameters, legs: LegGeometry, joint_acceleration: Array) -> Array:
    """Force (..., 6, 3) [N] for an acceleration P̈ (..., 6, 3) [m/s²] of the legs' platform joints.

    E P̈ with E = t 1 + (m2 + m_a − t) u uᵀ: transverse mass across u, axial mass along u.
    """
    u, t = legs.direction, transverse_mass(parameters, legs.length)
    along = (axial_mass(parameters) - t) * dot(u, joint_acceleration)
    return np.asarray(t[..., None] * joint_acceleration + along[..., None] * u)


def bias_force(parameters: Parameters, legs: LegGeometry, rates: LegRates) -> Array:
    """Force (..., 6, 3) [N] that the legs need at their platform joints when P̈ = 0 and F = 0.

    b = ((m2 d + m_a L) |u̇|² − m2 u·g + friction) u − (2 I L̇/L² − 2 m2 (L − d) L̇/L) u̇ − (h/L) g⊥.
    """
    u, L, du, dL = legs.direction, legs.length, rates.direction_rate, rates.length_rate
    m2, d = per_leg(parameters.leg_upper_mass), per_leg(parameters.leg_upper_com)
    m_a = per_leg(parameters.leg_armature)
    g = parameters.gravity[..., None, :]
    h, I = leg_moments(parameters, L)
    ug = dot(u, g)
    per_g = h * (1 / L)
    along_u = (m2 * d + m_a * L) * dot(du, du) + (per_g - m2) * ug + friction_force(parameters, dL)
    along_du = 2 * dL * (1 / L) * (m2 * (L - d) - I * (1 / L))
    return np.asarray(along_u[..., None] * u + along_du[..., None] * du - per_g[..., None] * g)

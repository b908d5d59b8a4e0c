"""Friction in a leg: a function of its sliding velocity, or a bristle that models stiction.

The bristle, one per leg, bends under the sliding velocity v and carries the friction force:

    f = σ0 z + σ1 ż + σ2 v,    ż = v (1 − α(z, v) σ0 z sgn(v) / g(v)),    g(v) = F_c + (F_s − F_c) exp(−(v/v_s)²)

z is `leg_bristle`, σ0 `leg_bristle_stiffness`, σ1 `leg_bristle_damping`, σ2 `leg_viscous_friction`, F_c
`leg_coulomb_friction`, F_s `leg_static_friction`, v_s `leg_stribeck_velocity`. In steady sliding z = g sgn(v)/σ0, so
that f = g sgn(v) + σ2 v.

LuGre, α = 1: C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, "A New Model for Control of Systems with
Friction", IEEE Trans. Automatic Control 40(3), 1995. Under forces that vary below F_s it creeps.

Elasto-plastic: P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, "Single State Elastoplastic Friction Models", IEEE
Trans. Automatic Control 47(5), 2002. The bristle is elastic, α = 0, up to z_ba = `leg_breakaway_share` F_c/σ0, and
while it unbends; it slides, α = 1, from z_ss = g/σ0. Between these, their sine:
α = ½ + ½ sin(π (|z| − (z_ss + z_ba)/2) / (z_ss − z_ba)). Below z_ba it returns to where it was: no creep.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.model.interface import LUGRE, Variant
from gough_stewart.model.parameters import Parameters, of_legs
from gough_stewart.model.vectors import Array, Scalars, clip, greater, maximum, per_leg, reached, sign, where

# Presliding distance F_s/σ0 of ball screws and linear guides, a few to some ten micrometres.
PRESLIDING = 1e-5
# Of critical damping, so that a leg in stiction does not ring on.
DAMPING_RATIO = 0.5
BREAKAWAY_SHARE = 0.8


class Bristles(NamedTuple):
    """The parameters of the law, derived where they are 0; each broadcasts against (..., 6)."""

    coulomb: Array  # F_c [N]
    static: Array  # F_s [N]
    stribeck_velocity: Array  # v_s [m/s]
    stiffness: Array  # σ0 [N/m]
    damping: Array  # σ1 [N s/m]
    viscous: Array  # σ2 [N s/m]
    breakaway: Array  # z_ba [m]
    is_lugre: Array  # 1 for LuGre, else 0


class StickTerms(NamedTuple):
    """The bristles within a step: decay rates, their gain on velocities, and their deflection in fast sliding."""

    decay: Array  # d (..., 6) [1/s]: ż = v − d z
    gain: Array  # Γ (..., 6, 6) [1/s]: Γ ż is taken from accelerations, of compliant legs' motors, else of the platform
    ratio: Array  # σ0/σ1 (..., 6) [1/s]: so is Γ (σ0/σ1) z
    reach: Array  # F_c/σ0 (..., 6) [m]: z in fast sliding
    sliding: Array  # v (..., 6) [m/s]


def friction_force(parameters: Parameters, length_rate: Array) -> Array:
    """Smooth friction (..., 6) [N] against the sliding velocity (..., 6) [m/s]: c_i L̇_i + C_i tanh(L̇_i/v_s).

    c_i is `leg_viscous_friction` and C_i `leg_coulomb_friction`, times the leg's factors; v_s `leg_friction_velocity`.
    """
    c, C = of_legs(parameters, "leg_viscous_friction"), of_legs(parameters, "leg_coulomb_friction")
    return np.asarray(c * length_rate + C * np.tanh(length_rate / per_leg(parameters.leg_friction_velocity)))


def law_of_bristles(variant: Variant, parameters: Parameters) -> Bristles:
    """The law's parameters; those that are 0 follow from the others.

    F_s = F_c, σ0 = F_s / `PRESLIDING`, σ1 = 2 ζ √(σ0 m) with ζ = `DAMPING_RATIO`, and a breakaway share of
    `BREAKAWAY_SHARE`. m is the mass behind a leg's friction: the armature of a leg with a spring, of a rigid one also
    its upper part and a sixth of the platform.
    """
    mass = of_legs(parameters, "leg_armature")
    if not variant.springs:
        mass = of_legs(parameters, "leg_upper_mass") + mass + np.asarray(per_leg(parameters.platform_mass) / 6)
    coulomb = of_legs(parameters, "leg_coulomb_friction")
    static = _or(static_friction(parameters), coulomb)
    stiffness = _or(of_legs(parameters, "leg_bristle_stiffness"), static / PRESLIDING)
    critical = 2 * np.sqrt(stiffness * mass)
    return Bristles(
        coulomb,
        static,
        of_legs(parameters, "leg_stribeck_velocity"),
        stiffness,
        _or(of_legs(parameters, "leg_bristle_damping"), DAMPING_RATIO * critical),
        of_legs(parameters, "leg_viscous_friction"),
        _or(of_legs(parameters, "leg_breakaway_share"), BREAKAWAY_SHARE) * coulomb / stiffness,
        reached(per_leg(parameters.leg_friction_model), LUGRE),
    )


def static_friction(parameters: Parameters) -> Array:
    """F_s as it is stated (..., 6) [N]: where `leg_static_friction_factor` is 0, the factor is that of F_c."""
    factor = _or(np.asarray(parameters.leg_static_friction_factor), parameters.leg_coulomb_friction_factor)
    return np.asarray(per_leg(parameters.leg_static_friction) * factor)


def bristle_friction(law: Bristles, velocity: Array, bristle: Array) -> tuple[Array, Array]:
    """Friction f [N] against the sliding velocity v [m/s], and ż [m/s], at deflections z [m]; each (..., 6)."""
    rate = np.asarray(velocity - bristle_decay(law, velocity, bristle) * bristle)
    return np.asarray(law.stiffness * bristle + law.damping * rate + law.viscous * velocity), rate


def bristle_decay(law: Bristles, velocity: Array, bristle: Array) -> Array:
    """The rate α σ0 |v| / g (..., 6) [1/s] at which a bristle forgets: ż = v − decay · z."""
    slip = np.exp(-((velocity / law.stribeck_velocity) ** 2))
    level = law.coulomb + (law.static - law.coulomb) * slip
    sliding = level / law.stiffness
    # along the velocity: an unbending bristle is below the elastic range
    along = sign(velocity) * bristle
    share = clip((along - law.breakaway) / (sliding - law.breakaway), 0.0, 1.0)
    plastic = maximum(0.5 - 0.5 * np.cos(np.pi * share), law.is_lugre)
    return np.asarray(plastic * np.abs(velocity) / sliding)


def _or(value: Array, derived: Scalars) -> Array:
    """The value, or where it is 0 the derived one."""
    return where(greater(value, 0.0), value, derived)

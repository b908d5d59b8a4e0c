"""Uneven platforms with stiction and elastic legs, and their laws of friction as papers print them."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from gough_stewart import Platform
from tests.support.lagrangian import FloatArray
from tests.support.uneven import UNEVEN

# About the weight that a leg of UNEVEN carries.
FRICTION: dict[str, Any] = {
    "leg_coulomb_friction": [21.0, 17.0, 24.0, 19.0, 26.0, 15.0],
    "leg_static_friction": 31.0,
    "leg_stribeck_velocity": 2.3e-3,
    "leg_bristle_stiffness": 2.9e6,
    "leg_bristle_damping": 410.0,
    "leg_breakaway_share": 0.62,
}
SPRINGS: dict[str, Any] = {"leg_stiffness": 3.1e6, "leg_damping": 95.0, "leg_armature": 4.7}

# Of each leg, about the same.
SIX: dict[str, Any] = {
    "leg_static_friction": [33.0, 29.0, 36.0, 40.0, 37.0, 28.0],
    "leg_stribeck_velocity": [2.3e-3, 2.9e-3, 1.8e-3, 2.1e-3, 3.3e-3, 2.6e-3],
    "leg_bristle_stiffness": [2.9e6, 3.3e6, 2.4e6, 3.1e6, 2.2e6, 2.7e6],
    "leg_bristle_damping": [410.0, 380.0, 460.0, 350.0, 430.0, 400.0],
    "leg_breakaway_share": [0.62, 0.7, 0.55, 0.8, 0.66, 0.48],
}
SIX_SPRINGS: dict[str, Any] = {
    "leg_stiffness": [3.1e6, 2.7e6, 3.6e6, 4.1e6, 2.9e6, 3.3e6],
    "leg_damping": [95.0, 120.0, 80.0, 105.0, 70.0, 130.0],
    "leg_armature": [4.7, 5.3, 3.9, 4.1, 6.0, 4.4],
}


def of_leg(platform: Platform, name: str) -> FloatArray:
    """A number of the legs of each (6,)."""
    factor = getattr(platform, f"{name}_factor")
    if name == "leg_static_friction" and not factor.any():
        factor = platform.leg_coulomb_friction_factor
    return np.asarray(getattr(platform, name) * factor)


def real_platform(friction: str = "smooth", springs: bool = False, **changed: Any) -> Platform:
    """UNEVEN with this friction, and with springs or rigid."""
    with_springs = SPRINGS if springs else {}
    plain = replace(UNEVEN, leg_coulomb_friction_factor=np.ones(6))
    return plain.with_parameters({**FRICTION, "leg_friction_model": friction, **with_springs, **changed})


VARIANTS = [(f, s) for f, s in product(("smooth", "elasto_plastic", "lugre"), (False, True)) if s or f != "smooth"]


def printed_law(platform: Platform, v: float, z: float, leg: int) -> tuple[float, float]:
    """Friction [N] and rate of the bristle [m/s] of one leg, case by case as papers print them; no number is 0."""
    names = ("coulomb_friction", "static_friction", "bristle_stiffness", "bristle_damping", "viscous_friction")
    Fc, Fs, s0, s1, s2 = (of_leg(platform, f"leg_{name}")[leg] for name in names)
    zss = (Fc + (Fs - Fc) * np.exp(-((v / of_leg(platform, "leg_stribeck_velocity")[leg]) ** 2))) / s0
    zba = of_leg(platform, "leg_breakaway_share")[leg] * Fc / s0
    if platform.leg_friction_model == 2:
        alpha = 1.0
    elif v * z <= 0 or abs(z) <= zba:
        alpha = 0.0
    elif abs(z) >= zss:
        alpha = 1.0
    else:
        alpha = 0.5 + 0.5 * np.sin(np.pi * (abs(z) - (zss + zba) / 2) / (zss - zba))
    rate = v * (1 - alpha * z * np.sign(v) / zss)
    return s0 * z + s1 * rate + s2 * v, rate

"""A mass of 1 kg on one bristle, with the friction of Canudas de Wit et al. (1995), table I."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from gough_stewart.model.exponential import Bristled
from gough_stewart.model.fixed_steps import Gripped
from gough_stewart.model.friction import Grip, bristle_decay, bristle_force, bristle_rate, bristles_of
from gough_stewart.model.vectors import FloatArray

S0, S1, S2, FC, FS, VS, SHARE = 1e5, np.sqrt(1e5), 0.4, 1.0, 1.5, 1e-3, 0.8


def law_of(model: float) -> Any:
    one = np.ones(1)
    parameters: Any = SimpleNamespace(
        leg_coulomb_friction=FC,
        leg_coulomb_friction_factor=one,
        leg_static_friction=FS,
        leg_bristle_stiffness=S0,
        leg_bristle_damping=S1,
        leg_viscous_friction=S2,
        leg_viscous_friction_factor=one,
        leg_stribeck_velocity=VS,
        leg_breakaway_share=SHARE,
        leg_friction_model=model,
    )
    return bristles_of(parameters, one)


def one_mass(model: float, force: Any) -> Bristled:
    """A mass of 1 kg on a bristle: position, velocity, bristle, time."""
    law = law_of(model)

    def derivatives(x: FloatArray) -> FloatArray:
        v, z = x[1:2], x[2:3]
        return np.concatenate([v, force(x) - bristle_force(law, v, z), bristle_rate(law, v, z), [1.0]])

    sizes = np.array([1, 1, 1e-2, 1])
    return Bristled(derivatives, lambda x: bristle_decay(law, x[1:2], x[2:3]), slice(2, 3), sizes)


def gripped_mass(model: float, force: Any) -> Gripped:
    """The same for fixed steps."""
    system = one_mass(model, force)

    def grip(x: FloatArray) -> Grip:
        return Grip(system.decays(x), np.array([[S1]]), np.array([S0 / S1]), np.array([FC / S0]), x[1:2])

    return Gripped(system.derivatives, grip, lambda x: x[1:2], slice(2, 3), slice(1, 2))


def printed_rates(is_lugre: bool, force: Callable[[float], float]) -> Callable[[float, FloatArray], list[float]]:
    """Rates of (position, velocity, bristle) at a time, case by case as the papers print them."""
    z_ba = SHARE * FC / S0

    def rates(t: float, x: FloatArray) -> list[float]:
        _, v, z = x
        z_ss = (FC + (FS - FC) * np.exp(-((v / VS) ** 2))) / S0
        if is_lugre or (v * z > 0 and abs(z) >= z_ss):
            alpha = 1.0
        elif v * z <= 0 or abs(z) <= z_ba:
            alpha = 0.0
        else:
            alpha = 0.5 + 0.5 * np.sin(np.pi * (abs(z) - (z_ss + z_ba) / 2) / (z_ss - z_ba))
        dz = v - alpha * abs(v) * z / z_ss
        return [v, force(t) - S0 * z - S1 * dz - S2 * v, dz]

    return rates

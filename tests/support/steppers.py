"""Uneven platforms of each variant in motion, and stepping models of them by each integrator."""

from typing import Any, Literal

import numpy as np

from gough_stewart import Platform, SteppingModel
from tests.support.lagrangian import FloatArray
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN

Integrator = Literal["compiled", "scipy"]
PLATFORMS: dict[str, Platform] = {
    "ideal": UNEVEN,
    "sticking": real_platform("lugre"),
    "elastic": real_platform("smooth", True),
    "both": real_platform("elasto_plastic", True),
}
INTEGRATORS: tuple[Integrator, ...] = ("compiled", "scipy")
BOTH = [(name, integrator) for name in PLATFORMS for integrator in INTEGRATORS]
# Aside of home and moving, at which legs break loose and reverse.
MOTION = {"velocity": [0.06, -0.04, 0.1], "angular_velocity": [0.05, 0.1, -0.08]}
# Present time, step, and the largest accepted difference: 1e-9 of the time or of 1 s, but no more than a thousandth of
# the step, nor less than a few units of rounding, 2⁻⁴⁵ s at 200 s. The last is to be refused.
CLOCKS = [
    (0.5, 1e-3, 0.97e-9, 1.03e-9),
    (0.5, 1e-7, 0.97e-10, 1.03e-10),
    (200.0, 1e-3, 1.94e-7, 2.06e-7),
    (200.0, 1e-11, 4 * 2.0**-45, 8 * 2.0**-45),
]


def forces(platform: Platform, k: int) -> FloatArray:
    """Inputs (12,) of step k: each leg at its own frequency about what it carries, and a constant wrench."""
    waves = 60.0 * np.sin(60e-3 * k * np.arange(1.0, 7.0) + np.arange(6))
    return np.concatenate([platform.home_actuator_force + waves, [3.0, -2.0, 5.0, 0.3, 0.1, -0.2]])


def moving(name: str, *arguments: Any, **options: Any) -> SteppingModel:
    """A model of a variant before its first step, off its home pose and in motion."""
    platform = PLATFORMS[name]
    model = SteppingModel(platform, *arguments, **options)
    place = {
        "position": platform.home_position + np.array([0.01, -0.02, 0.03]),
        "orientation": platform.home_orientation + np.array([0.03, 0.01, -0.02]),
    }
    model.set_many({**place, **MOTION})
    return model


def stepped(model: SteppingModel, steps: int, step: float = 1e-3) -> FloatArray:
    """Steps from the model's time under changing `forces`; the state at the end."""
    begin = round(model.time / step)
    for k in range(begin, begin + steps):
        model.set_inputs(forces(model.platform, k))
        model.do_step(model.time, step)
    return model.state

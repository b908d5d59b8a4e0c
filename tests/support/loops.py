"""Loops around the plant of six masses: another motion, another force and other gains for each leg."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart import Sample
from gough_stewart.harness.control.laws_of_members import law_of
from gough_stewart.harness.control.linear_controller import Controller, controller_of
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.loop.timing import Timing
from tests.support.arrays import FloatArray
from tests.support.fake_plants import LENGTHS, Masses, signals_of

FORCES = np.array([1.0, -0.7, 1.6, 0.4, -1.3, 2.1])  # [N]
KP = np.array([50.0, 35.0, 70.0, 28.0, 90.0, 60.0])  # [N/m]
KD = np.array([15.0, 9.0, 20.0, 8.0, 25.0, 18.0])  # [N s/m]
_AMPLITUDE = np.array([0.1, -0.05, 0.08, 0.12, -0.07, 0.03])  # [m]
_FREQUENCY = np.array([5.0, 7.0, 4.0, 9.0, 6.0, 11.0])  # [rad/s]


def reference(time: ArrayLike) -> FloatArray:
    """What is wanted (n, 30) at some times: L = L₀ + a (1 − cos ωt), from rest in the plant's start."""
    t = np.asarray(time)[:, None]
    a, w = _AMPLITUDE, _FREQUENCY
    return signals_of(LENGTHS + a * (1 - np.cos(w * t)), a * w * np.sin(w * t), a * w**2 * np.cos(w * t))


def loop_of(
    duration: float = 0.5, sample_time: float = 0.01, plant_step: float = 0.002, *, wants: bool = True, **parts: Any
) -> Loop:
    """A loop that wants `reference`, without feedforward, from forces of zero."""
    timing = parts.pop("timing", Timing(duration, sample_time, plant_step))
    parts = {"feedforward": np.zeros((len(timing.samples), 6)), "start_force": np.zeros(6), **parts}
    return Loop(timing, reference(timing.times) if wants else None, **parts)


def run_with(controller: Any, loop: Loop, plant: Masses | None = None, **options: Any) -> Run:
    """Around the masses, with a controller in leg space."""
    made: Controller = controller_of(controller)
    return simulate(
        plant or Masses(),
        law_of(made, loop.timing.sample_time, np.zeros((0, 6, 6))),
        loop,
        **options,
    )


def constant(force: FloatArray = FORCES) -> Callable[[Sample], FloatArray]:
    """The same forces at every sample."""
    return lambda _sample: force

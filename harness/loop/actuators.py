"""Actuators: limits of force and of its rate, a first-order lag, and a delay before all of them."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray

BoolArray = NDArray[np.bool_]

N_LEGS = 6
_NONE = np.zeros(N_LEGS, dtype=bool)


@dataclass(frozen=True)
class Actuators:
    """What lies between a wanted force and the force that acts.

    The command is cut to ± `force_limit`, held, and comes to the drive `delay` samples late. The drive follows it by
    at most `rate_limit` [N/s], and, with a time constant `lag` τ [s], as τ ḟ = r − f. Without limits by default.
    """

    force_limit: float | None = None  # [N]
    rate_limit: float | None = None  # [N/s]
    lag: float = 0.0  # [s]
    delay: int = 0  # [samples]


class Drives:
    """The six actuators in a run, from forces that they have at its beginning."""

    def __init__(self, actuators: Actuators, start: FloatArray, sample_time: float, plant_step: float) -> None:
        self._force_limit = np.inf if actuators.force_limit is None else actuators.force_limit
        rate = np.inf if actuators.rate_limit is None else actuators.rate_limit
        self._follows_at_once = actuators.rate_limit is None and not actuators.lag > 0
        self._largest_change_of_a_sample = rate * sample_time
        self._largest_change_of_a_step = rate * plant_step
        self._on_its_way = deque([start.copy() for _ in range(actuators.delay)])
        self._target = start.copy()
        self._reached = start.copy()  # behind the rate limit
        self._planned = start.copy()  # the same when the newest command will have acted for a sample
        self._force = start.copy()  # behind the lag
        # over a step h under constant r: f⁺ = r + (f − r) e^(−h/τ), mean of f = r + (f − r) (1 − e^(−h/τ)) τ/h
        ratio = plant_step / actuators.lag if actuators.lag > 0 else np.inf
        self._left = float(np.exp(-ratio))
        self._mean = float(-np.expm1(-ratio) / ratio) if actuators.lag > 0 else 0.0

    def command(self, force: FloatArray) -> tuple[BoolArray, FloatArray]:
        """Take the forces (6,) [N] wanted at a sample.

        Returns which of them the force limit cut (6,), and the excess (6,) [N]: what the limits of force and rate leave
        of the command when it has acted for a sample, minus the command.
        """
        limited = _between(-self._force_limit, force, self._force_limit)
        self._on_its_way.append(limited)
        self._target = self._on_its_way.popleft()
        if self._follows_at_once:
            return limited != force, limited - force
        change = self._largest_change_of_a_sample
        self._planned = _between(self._planned - change, limited, self._planned + change)
        return limited != force, self._planned - force

    def step(self) -> tuple[FloatArray, BoolArray]:
        """Mean forces (6,) [N] over the next plant step, and which of them the rate limit holds back."""
        if self._follows_at_once:
            return self._target, _NONE
        change = self._largest_change_of_a_step
        reached = _between(self._reached - change, self._target, self._reached + change)
        held_back = reached != self._target
        self._reached = reached
        acting = reached + (self._force - reached) * self._mean
        self._force = reached + (self._force - reached) * self._left
        return acting, held_back


def _between(low: FloatArray | float, values: FloatArray, high: FloatArray | float) -> FloatArray:
    """As np.clip, which costs three times as much on six numbers."""
    return np.asarray(np.minimum(np.maximum(values, low), high))

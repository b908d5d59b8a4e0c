"""Actuators: limits of force and of its rate, a first-order lag, and a delay before all of them."""

import math
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
        self._rate = rate
        self._step = plant_step
        self._largest_change_of_a_sample = rate * sample_time
        self._on_its_way = deque([start.copy() for _ in range(actuators.delay)])
        self._target = start.copy()
        self._reached = start.copy()  # behind the rate limit
        self._planned = start.copy()  # the same when the newest command will have acted for a sample
        self._force = start.copy()  # behind the lag
        self._lag = actuators.lag

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
        h = self._step
        # behind the rate limit r goes from r₀ toward the target r₁ at ±rate, is there after a ≤ h, and then waits
        way = self._target - self._reached
        a = np.minimum(np.abs(way) / self._rate, h)
        slope = np.sign(way) * (self._rate if math.isfinite(self._rate) else 0.0)
        end = np.where(a < h, self._target, self._reached + slope * h)
        mean = end - (end - self._reached) * a / (2 * h)
        start, self._reached = self._reached, end
        if self._lag > 0:
            # τ ḟ = r − f: on the ramp f = r − s τ + (f₀ − r₀ + s τ) e^(−t/τ), then f = r₁ + (f − r₁) e^(−t/τ)
            tau = self._lag
            ramp = slope * tau
            on_ramp = start + slope * a - ramp + (self._force - start + ramp) * np.exp(-a / tau)
            on_ramp = np.where(a > 0, on_ramp, self._force)
            force = end + (on_ramp - end) * np.exp(-(h - a) / tau)
            # the mean of ḟ = (r − f)/τ over the step
            mean = mean - (force - self._force) * tau / h
            self._force = force
        return mean, end != self._target


def _between(low: FloatArray | float, values: FloatArray, high: FloatArray | float) -> FloatArray:
    """As np.clip, which costs three times as much on six numbers."""
    return np.asarray(np.minimum(np.maximum(values, low), high))

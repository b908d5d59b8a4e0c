"""Actuators: force limit, rate limit and first-order lag, after a delay."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Actuators:
    """The path from the commanded force to the force that acts.

    The command is clipped to ± `force_limit`, held, and reaches the drive `delay` samples later. The drive follows it
    within `rate_limit` [N/s] and, with a time constant `lag` τ [s], as τ ḟ = r − f. No limits by default. For many
    members each may be an array (N,), with infinite limits for members that have none.
    """

    force_limit: PerMember | None = None  # [N]
    rate_limit: PerMember | None = None  # [N/s]
    lag: PerMember = 0.0  # [s]
    delay: PerMember = 0  # [samples], integer


class Drives:
    """The six actuators of N members in a run, with their start forces (N, 6); internal arrays are (6, N)."""

    def __init__(self, actuators: Actuators, start: FloatArray, sample_time: float, plant_step: float) -> None:
        begin = start.T.copy()
        rate = np.inf if actuators.rate_limit is None else actuators.rate_limit
        lag = np.asarray(actuators.lag)
        # NumPy is twice as fast with an array as with a number
        limit = actuators.force_limit
        self._high = None if limit is None else np.full(begin.shape, limit)
        self._low = None if self._high is None else -self._high
        self._follows_at_once = actuators.rate_limit is None and not (lag > 0).any()
        self._rate, self._slope = rate, np.where(np.isfinite(rate), rate, 0.0)[()]
        self._step = plant_step
        self._largest_change_of_a_sample = rate * sample_time
        self._delay = _Delay(np.asarray(actuators.delay), begin)
        self._target = begin
        self._reached = begin.copy()  # after the rate limit
        self._planned = begin.copy()  # the same, predicted for one sample after the newest command
        self._force = begin.copy()  # after the lag
        self._lags = lag > 0
        self._lag = np.where(lag > 0, lag, 1.0)[()]
        self.none = np.zeros(begin.shape, dtype=bool).T  # no limit active
        self._nothing = np.zeros(begin.shape).T

    def command(self, j: int, force: FloatArray, due: BoolArray | None = None) -> tuple[BoolArray, FloatArray]:
        """Accept the commanded forces (N, 6) [N] of sample j, for the members in `due` (N,), or for all.

        Returns which of them are clipped (N, 6), and the excess (N, 6) [N]: the force that the force and rate limits
        allow after one sample, minus the command.
        """
        command = force.T
        if self._high is None:
            limited, cut = command, self.none
        else:
            limited = _between(self._low, command, self._high)
            cut = (limited != command).T
        self._target = self._delay(j, limited, due)
        if self._follows_at_once:
            return cut, self._nothing if self._high is None else (limited - command).T
        change = self._largest_change_of_a_sample
        planned = _between(self._planned - change, limited, self._planned + change)
        self._planned = planned if due is None else np.where(due, planned, self._planned)
        return cut, (self._planned - command).T

    def step(self) -> tuple[FloatArray, BoolArray]:
        """Mean forces (N, 6) [N] over the next plant step, and which of them the rate limit affects."""
        if self._follows_at_once:
            return self._target.T, self.none
        h = self._step
        # after the rate limit, r goes from r₀ to the target r₁ at ±rate, reaches it after a ≤ h, and stays
        way = self._target - self._reached
        a = np.minimum(np.abs(way) / self._rate, h)
        slope = np.sign(way) * self._slope
        end = np.where(a < h, self._target, self._reached + slope * h)
        mean = end - (end - self._reached) * a / (2 * h)
        start, self._reached = self._reached, end
        if np.any(self._lags):
            # τ ḟ = r − f: on the ramp f = r − s τ + (f₀ − r₀ + s τ) e^(−t/τ), then f = r₁ + (f − r₁) e^(−t/τ)
            tau = self._lag
            ramp = slope * tau
            on_ramp = start + slope * a - ramp + (self._force - start + ramp) * np.exp(-a / tau)
            on_ramp = np.where(a > 0, on_ramp, self._force)
            force = end + (on_ramp - end) * np.exp(-(h - a) / tau)
            # the mean of ḟ = (r − f)/τ over the step
            late = mean - (force - self._force) * tau / h
            mean = late if np.all(self._lags) else np.where(self._lags, late, mean)
            self._force = force
        return mean.T, (end != self._target).T


class _Delay:
    """A delay line for forces (6, N): the output at sample j is the input at j − d; first, the start forces.

    d is one number for all members, or one for each (N,).
    """

    def __init__(self, delays: NDArray[np.int_], start: FloatArray) -> None:
        self._delay = int(delays.max())
        self._slots = [start.copy() for _ in range(self._delay + 1)]
        # if the delays of members differ, which slot each reads
        self._of_slot = [(d, delays == d) for d in np.unique(delays).tolist()] if delays.min() < delays.max() else []
        self._out = start.copy()

    def __call__(self, j: int, forces: FloatArray, due: BoolArray | None) -> FloatArray:
        """Store the forces of sample j, and return the delayed ones of the members that are due."""
        slots, n = self._slots, self._delay + 1
        slots[j % n][...] = forces  # of members that are not due the last ones, replaced at their own row
        if due is None and not self._of_slot:
            return slots[(j - self._delay) % n]
        for delay, whose in self._of_slot or [(self._delay, True)]:
            np.copyto(self._out, slots[(j - delay) % n], where=whose if due is None else due & whose)
        return self._out


def _between(low: PerMember, values: FloatArray, high: PerMember) -> FloatArray:
    """As np.clip, which takes three times as long for six numbers."""
    between: FloatArray = np.minimum(np.maximum(values, low), high)
    return between

"""The six actuators in a run: limits on the command, its delay, and the drives, with clocks of their own."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.drive import Drive, ForceLimits
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

    @property
    def values(self) -> dict[str, PerMember]:
        """Limits and lag by the keys of `[actuators]`; infinite where there is none."""
        limits = {"force_limit": self.force_limit, "rate_limit": self.rate_limit}
        return {key: np.inf if each is None else each for key, each in limits.items()} | {"lag": self.lag}


class Drives:
    """The six actuators of N members in a run, with their start forces (N, 6); internal arrays are (6, N)."""

    def __init__(self, actuators: Actuators, start: FloatArray, sample_time: float, plant_step: float) -> None:
        begin = start.T.copy()
        # NumPy is twice as fast with arrays of full size as with a number beside them
        values = {key: np.full(begin.shape, each) for key, each in actuators.values.items()}
        self._limits = ForceLimits.without_idle(ForceLimits.prepare(values, sample_time))
        self._drive = Drive.without_idle(Drive.prepare(values, plant_step))
        self._is_limited = self._limits.high is not None or self._limits.change is not None
        self._follows_at_once = self._drive.rate is None and self._drive.lag is None
        self._delay = _Delay(np.asarray(actuators.delay), begin)
        self._target = _both(begin)
        self._planned = ForceLimits.start(self._limits, (begin,))
        self._driven = Drive.start(self._drive, (begin,))
        self.none = np.zeros(begin.shape, dtype=bool).T  # no limit active
        self._excess = np.zeros(begin.shape)
        self._nothing = self._excess.T

    def command(self, j: int, force: FloatArray, due: BoolArray | None = None) -> tuple[BoolArray, FloatArray]:
        """Accept the commanded forces (N, 6) [N] of sample j, for the members in `due` (N,), or for all.

        Returns which of them are clipped (N, 6), and the excess (N, 6) [N]: the force that the force and rate limits
        allow after one sample, minus the command.
        """
        command = force.T
        if not self._is_limited:
            self._target = self._delay(j, command, due)
            return self.none, self._nothing
        planned, (allowed, is_cut, excess) = ForceLimits.step(self._limits, self._planned, (command,))
        self._target = self._delay(j, allowed, due)
        if due is not None:
            # for the others the command is still the last one, and so is what the drives make of it
            planned, (excess,) = _where(due, planned, self._planned), _where(due, (excess,), (self._excess,))
        self._planned, self._excess = planned, excess
        return self.none if is_cut is None else is_cut.T, excess.T

    def step(self) -> tuple[FloatArray, BoolArray]:
        """Mean forces (N, 6) [N] over the next plant step, and which of them the rate limit affects."""
        if self._follows_at_once:
            return self._target[1], self.none
        self._driven, (mean, is_behind) = Drive.step(self._drive, self._driven, self._target[:1])
        return mean.T, self.none if is_behind is None else is_behind.T


def _where(due: BoolArray, states: tuple[Any, ...], others: tuple[Any, ...]) -> tuple[Any, ...]:
    """The states of members that are due, and those before of the others."""
    return tuple(np.where(due, after, before) for after, before in zip(states, others, strict=True))


class _Delay:
    """A delay line for forces (6, N): the output at sample j is the input at j − d; first, the start forces.

    d is one number for all members, or one for each (N,).
    """

    def __init__(self, delays: NDArray[np.int_], start: FloatArray) -> None:
        self._delay = int(delays.max())
        # with views in which members are first, made in advance: making one takes Python as long as the arithmetic
        self._slots = [_both(start.copy()) for _ in range(self._delay + 1)]
        # if the delays of members differ, which slot each reads
        self._of_slot = [(d, delays == d) for d in np.unique(delays).tolist()] if delays.min() < delays.max() else []
        self._out = _both(start.copy())

    def __call__(self, j: int, forces: FloatArray, due: BoolArray | None) -> tuple[FloatArray, FloatArray]:
        """Store the forces of sample j; the delayed ones of the members that are due, (6, N) and (N, 6)."""
        slots, n = self._slots, self._delay + 1
        slots[j % n][0][...] = forces  # of members that are not due the last ones, replaced at their own row
        if due is None and not self._of_slot:
            return slots[(j - self._delay) % n]
        for delay, whose in self._of_slot or [(self._delay, True)]:
            np.copyto(self._out[0], slots[(j - delay) % n][0], where=whose if due is None else due & whose)
        return self._out


def _both(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """An array (6, N), and a view (N, 6) of it."""
    return values, values.T

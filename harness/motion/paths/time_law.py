"""Time laws of a path: its parameter s, from 0 to 1, over time with exact derivatives; the motion that results."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.motion.motion import Motion, smaller
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.profiles import quintic
from gough_stewart.model.vectors import FloatArray


class AlongPath(NamedTuple):
    """Path parameter s at n times; each (n,)."""

    value: FloatArray  # s
    rate: FloatArray  # ṡ [1/s]
    acceleration: FloatArray  # s̈ [1/s²]


class TimeLaw(Protocol):
    """From rest at s = 0 to rest at s = 1, where it stays."""

    @property
    def duration(self) -> float:
        """The time from start to end of the motion [s]."""

    @property
    def knots(self) -> FloatArray:
        """Times between which s is smooth (m,) [s], from 0 to the duration."""

    def __call__(self, time: FloatArray) -> AlongPath:
        """S and its derivatives at times (n,) [s]; at a knot, the acceleration after it."""


@dataclass(frozen=True)
class Quintic:
    """s = 10 τ³ − 15 τ⁴ + 6 τ⁵, τ = t/duration."""

    duration: float  # [s]

    @property
    def knots(self) -> FloatArray:
        """Enough knots that the path bends little between them."""
        return np.linspace(0.0, self.duration, 401)

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s]."""
        return AlongPath(*quintic(time, self.duration))


@dataclass(frozen=True, eq=False)
class Stepwise:
    """Constant s̈ between grid points: ṡ² is linear in s.

    With s_k and x_k = ṡ_k²: s̈ = (x_{k+1} − x_k)/(2 Δs), and each piece takes Δt = 2 Δs/(ṡ_k + ṡ_{k+1}).
    """

    grid: FloatArray  # s (m,), from 0 to 1
    squared_rate: FloatArray  # x (m,) [1/s²]

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """For each piece its start time [s], ṡ [1/s] and s̈ [1/s²] there; each (m,), the last piece is at rest."""
        rate = np.sqrt(self.squared_rate)
        steps = np.diff(self.grid)
        times = np.concatenate([[0.0], np.cumsum(2 * steps / (rate[1:] + rate[:-1]))])
        return times, rate, np.append(np.diff(self.squared_rate) / (2 * steps), 0.0)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self._pieces[0][-1])

    @property
    def knots(self) -> FloatArray:
        """The grid's times (m,) [s]."""
        return self._pieces[0]

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s]."""
        times, rates, accelerations = self._pieces
        at = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1)
        moves = time >= 0
        since = np.where(moves, time - times[at], 0.0)
        rate, acceleration = rates[at] * moves, accelerations[at] * moves
        value = self.grid[at] + since * (rate + since * acceleration / 2)
        return AlongPath(value, rate + since * acceleration, acceleration)

    def integral(self, time: FloatArray) -> FloatArray:
        """∫ s dt from 0 to times (n,) [s]."""
        times, rates, accelerations = self._pieces
        steps = np.diff(times)
        areas = steps * (self.grid[:-1] + steps * (rates[:-1] / 2 + steps * accelerations[:-1] / 6))
        whole = np.concatenate([[0.0], np.cumsum(areas)])
        at = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1)
        since = np.where(time >= 0, time - times[at], 0.0)
        return np.asarray(whole[at] + since * (self.grid[at] + since * (rates[at] / 2 + since * accelerations[at] / 6)))


@dataclass(frozen=True, eq=False)
class Averaged:
    """The moving average over a window T of another law: s(t) = 1/T ∫ s₀ over (t − T, t).

    So |d³s/dt³| is at most the change of s̈₀ within T, divided by T: a jump of the force is spread over that time.
    """

    law: Stepwise
    window: float  # T [s]

    @property
    def duration(self) -> float:
        """The other law's duration plus the window [s]."""
        return self.law.duration + self.window

    @property
    def knots(self) -> FloatArray:
        """The other law's knots, and the same delayed by the window."""
        knots = self.law.knots
        return np.unique(np.concatenate([knots, knots + self.window]))

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s]: ṡ and s̈ are differences of s₀ and ṡ₀ over the window."""
        now, before = self.law(time), self.law(time - self.window)
        area = self.law.integral(time) - self.law.integral(time - self.window)
        return AlongPath(
            area / self.window, (now.value - before.value) / self.window, (now.rate - before.rate) / self.window
        )


@dataclass(frozen=True, eq=False)
class Stretched:
    """Another law slowed down by a factor k: ṡ/k, s̈/k²."""

    law: "TimeLaw"
    factor: float  # k

    @property
    def duration(self) -> float:
        """[s]."""
        return self.law.duration * self.factor

    @property
    def knots(self) -> FloatArray:
        """The other law's knots, scaled."""
        return self.law.knots * self.factor

    def __call__(self, time: FloatArray) -> AlongPath:
        """At times (n,) [s]."""
        at = self.law(time / self.factor)
        return AlongPath(at.value, at.rate / self.factor, at.acceleration / self.factor**2)


@dataclass(frozen=True, eq=False)
class TimedPath:
    """The poses of a path at s(t − start): at rest in the first pose before, in the last pose after."""

    path: GeometricPath
    law: TimeLaw
    start: float = 0.0  # [s]
    amplitude: float = 1.0  # of the deviations from the first pose

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        return self.since_start(np.asarray(time, dtype=float) - self.start)

    @property
    def end(self) -> float:
        """The time at which the last pose is reached [s]."""
        return self.start + self.law.duration

    def since_start(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s] of the time law."""
        at = self.law(time)
        motion = self.path(at.value).motion(at.rate, at.acceleration)
        if self.amplitude == 1:
            return motion
        return smaller(motion, self.amplitude, np.concatenate([self.path.position[0], self.path.orientation[0]]))

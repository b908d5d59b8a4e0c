"""Time laws of a path: its parameter s, from 0 to 1, over time with exact derivatives; the motion that results.

It is played and exported as piecewise polynomials, with identical numbers.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.motion.motion import (
    ROUNDING,
    Motion,
    Piecewise,
    Profile,
    coordinates_of,
    motion_of,
    quintic,
    smaller,
)
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.model.vectors import FloatArray

# A quintic in τ from 0 to 1 from value, rate and second derivative at both ends, highest power first.
_HERMITE = np.array(
    [
        [-6, -3, -1 / 2, 6, -3, 1 / 2],
        [15, 8, 3 / 2, -15, 7, -1],
        [-10, -6, -3 / 2, 10, -4, 1 / 2],
        [0, 0, 1 / 2, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [1, 0, 0, 0, 0, 0],
    ]
)
# Pieces shorter than the first [s] do without the pose at their right end, whose rounding the second derivative
# amplifies: 4e-16 m to 1e-5 m/s² in 0.05 ms. Pieces shorter than the second do without the rates, too.
SHORT, SHORTEST = 5e-3, 5e-5
# The longest piece, as a share of the motion.
PIECES = 400


class TimeLaw(ABC):
    """From rest at s = 0 to rest at s = 1, where it stays."""

    @property
    @abstractmethod
    def knots(self) -> FloatArray:
        """Times between which s is smooth (m,) [s], from 0 to the duration."""

    @property
    def duration(self) -> float:
        """The time from start to end of the motion [s]."""
        return float(self.knots[-1])

    @abstractmethod
    def __call__(self, time: FloatArray) -> Profile:
        """S, ṡ [1/s] and s̈ [1/s²] at times (n,) [s]; at a knot, the acceleration after it."""


@dataclass(frozen=True)
class Quintic(TimeLaw):
    """s = 10 τ³ − 15 τ⁴ + 6 τ⁵, τ = t/T."""

    takes: float  # T [s]

    @property
    def knots(self) -> FloatArray:
        """Enough knots that the path bends little between them."""
        return np.linspace(0.0, self.takes, 401)

    def __call__(self, time: FloatArray) -> Profile:
        """At times (n,) [s]."""
        return quintic(time, self.takes)


@dataclass(frozen=True, eq=False)
class Stepwise(TimeLaw):
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
    def knots(self) -> FloatArray:
        """The grid's times (m,) [s]."""
        return self._pieces[0]

    def __call__(self, time: FloatArray) -> Profile:
        """At times (n,) [s]."""
        times, rates, accelerations = self._pieces
        at = np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1)
        moves = time >= 0
        since = np.where(moves, time - times[at], 0.0)
        rate, acceleration = rates[at] * moves, accelerations[at] * moves
        value = self.grid[at] + since * (rate + since * acceleration / 2)
        return Profile(value, rate + since * acceleration, acceleration)

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
class Averaged(TimeLaw):
    """The moving average over a window T of another law: s(t) = 1/T ∫ s₀ over (t − T, t).

    So |d³s/dt³| is at most the change of s̈₀ within T, divided by T: a jump of the force is spread over that time.
    """

    law: Stepwise
    window: float  # T [s]

    @property
    def knots(self) -> FloatArray:
        """The other law's knots, and the same delayed by the window."""
        knots = self.law.knots
        return np.unique(np.concatenate([knots, knots + self.window]))

    def __call__(self, time: FloatArray) -> Profile:
        """At times (n,) [s]: ṡ and s̈ are differences of s₀ and ṡ₀ over the window."""
        now, before = self.law(time), self.law(time - self.window)
        area = self.law.integral(time) - self.law.integral(time - self.window)
        return Profile(
            area / self.window, (now.value - before.value) / self.window, (now.rate - before.rate) / self.window
        )


@dataclass(frozen=True, eq=False)
class Stretched(TimeLaw):
    """Another law slowed down by a factor k: ṡ/k, s̈/k²."""

    law: TimeLaw
    factor: float  # k

    @property
    def knots(self) -> FloatArray:
        """The other law's knots, scaled."""
        return self.law.knots * self.factor

    def __call__(self, time: FloatArray) -> Profile:
        """At times (n,) [s]."""
        at = self.law(time / self.factor)
        return Profile(at.value, at.rate / self.factor, at.acceleration / self.factor**2)


@dataclass(frozen=True, eq=False)
class TimedPath:
    """The poses of a path at s(t − start): at rest in the first pose before, in the last pose after."""

    path: GeometricPath
    law: TimeLaw
    start: float = 0.0  # [s]
    amplitude: float = 1.0  # of the deviations from the first pose

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s] since its start."""
        at = self.law(time)
        motion = self.path(at.value).motion(at.rate, at.acceleration)
        if self.amplitude == 1:
            return motion
        return smaller(motion, self.amplitude, np.concatenate([self.path.position[0], self.path.orientation[0]]))


@dataclass(frozen=True, eq=False)
class Polynomials(Piecewise):
    """Piecewise quintics in x, y, z, roll, pitch, yaw; at rest before the first and after the last piece."""

    begins: FloatArray  # start times of the pieces (n,) [s]
    coefficients: FloatArray  # in the time since then, highest power first (n, 6, 6)
    end: float  # of the last piece [s]
    source: TimedPath | None = None  # what the pieces are of, from which an export computes them again

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        time = np.asarray(time, dtype=float)
        moves = (time >= self.begins[0]) & (time <= self.end + ROUNDING)
        inside = np.clip(time, self.begins[0], self.end)
        at = np.searchsorted(self.begins, inside, side="right") - 1
        since = (inside - self.begins[at])[:, None]
        value = rate = half = np.zeros((len(time), 6))
        for power in range(6):  # Horner's rule with derivatives
            half = half * since + rate
            rate = rate * since + value
            value = value * since + self.coefficients[at, :, power]
        return motion_of(value, moves[:, None] * rate, moves[:, None] * (2 * half))

    @property
    def centre(self) -> FloatArray:
        """The first pose (6,)."""
        return np.asarray(self.coefficients[0, :, -1])

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The pieces as stored."""
        return self.begins, self.coefficients


def polynomials_of(motion: TimedPath) -> Polynomials:
    """The quintics between the knots of a path's time law, with its pose, rates and accelerations at both ends.

    Accelerations may jump at the knots. The error between them is some 1e-12 m.
    """
    law, knots = motion.law, motion.law.knots
    if motion.path.degree == 3:  # its third derivative jumps at the poses, whose times are found by bisection
        values = motion.path.at[1:-1]
        before, after = np.zeros(len(values)), np.full(len(values), law.duration)
        for _ in range(60):
            middle = (before + after) / 2
            is_before = law(middle).value < values
            before, after = np.where(is_before, middle, before), np.where(is_before, after, middle)
        knots = np.unique(np.concatenate([knots, after]))

    # refined where they are far apart and the motion nearly stops and turns; the longest but for rounding is one piece
    steps = np.diff(knots)
    parts = np.ceil((1 - 1e-9) * steps / (knots[-1] / PIECES)).astype(int)
    begins = np.repeat(knots[:-1], parts)
    place = np.arange(len(begins)) - np.repeat(np.cumsum(parts) - parts, parts)
    knots = np.append(begins + np.repeat(steps / parts, parts) * place, knots[-1])

    # accelerations at both ends of a piece, evaluated inside it
    left = coordinates_of(motion(knots[:-1]))
    right = coordinates_of(motion(np.nextafter(knots[1:], 0)))
    h = np.diff(knots)[:, None]
    # (pieces, 6 conditions, 6 coordinates), derivatives with respect to τ = t/h
    ends = np.stack([part * h**k for side in (left, right) for k, part in enumerate(side)], axis=1)
    pieces = np.moveaxis(_HERMITE @ ends, 1, 2) / h[:, :, None] ** np.arange(5, -1, -1)
    pose, rate, acceleration = left
    zero = np.zeros_like(pose)
    # short pieces: the pose at the right end follows, to h⁵; shorter ones: an acceleration linear between the ends
    mean = (right[1] - rate) / h
    fourth, third = (
        (acceleration + right[2] - 2 * mean) / (4 * h**2),
        (3 * mean - 2 * acceleration - right[2]) / (3 * h),
    )
    quartics = np.stack([zero, fourth, third, acceleration / 2, rate, pose], axis=2)
    linear = (right[2] - acceleration) / (6 * h)
    cubics = np.stack([zero, zero, linear, acceleration / 2, rate, pose], axis=2)
    pieces = np.where(h[:, :, None] < SHORT, quartics, pieces)
    pieces = np.where(h[:, :, None] < SHORTEST, cubics, pieces)
    begins = motion.start + knots[:-1]
    if motion.start > 0:
        # at rest before; the first piece may start with an acceleration
        waiting = np.zeros((1, 6, 6))
        waiting[0, :, 5] = pose[0]
        begins, pieces = np.append(0.0, begins), np.concatenate([waiting, pieces])
    return Polynomials(begins, pieces, motion.start + law.duration, motion)

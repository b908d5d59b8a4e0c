"""Motions with piecewise polynomial coordinates, with identical numbers in the harness and in exports."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.motion.motion import ROUNDING, Motion, Piecewise, coordinates_of, motion_of
from gough_stewart.harness.motion.paths.time_law import TimedPath, TimeLaw
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


@dataclass(frozen=True, eq=False)
class Polynomials(Piecewise):
    """Piecewise quintics in x, y, z, roll, pitch, yaw; at rest before the first and after the last piece."""

    begins: FloatArray  # start times of the pieces (n,) [s]
    coefficients: FloatArray  # in the time since then, highest power first (n, 6, 6)
    last: float  # end of the last piece [s]
    source: TimedPath | None = None  # what the pieces are of, from which an export computes them again

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        time = np.asarray(time, dtype=float)
        moves = (time >= self.begins[0]) & (time <= self.last + ROUNDING)
        inside = np.clip(time, self.begins[0], self.last)
        at = np.searchsorted(self.begins, inside, side="right") - 1
        since = (inside - self.begins[at])[:, None]
        value = rate = half = np.zeros((len(time), 6))
        for power in range(6):  # Horner's rule with derivatives
            half = half * since + rate
            rate = rate * since + value
            value = value * since + self.coefficients[at, :, power]
        return motion_of(value, moves[:, None] * rate, moves[:, None] * (2 * half))

    @property
    def end(self) -> float:
        """The end of the last piece [s]."""
        return self.last

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The pieces as stored."""
        return self.begins, self.coefficients


def polynomials_of(motion: TimedPath) -> Polynomials:
    """The quintics between the knots of a path's time law, with its pose, rates and accelerations at both ends.

    Accelerations may jump at the knots. The error between them is some 1e-12 m.
    """
    knots = motion.law.knots
    if motion.path.degree == 3:  # its third derivative jumps at the poses
        knots = np.unique(np.concatenate([knots, _times_at(motion.law, motion.path.at[1:-1])]))
    knots = _refined(knots)
    # accelerations at both ends of a piece, evaluated inside it
    left, right = motion.since_start(knots[:-1]), motion.since_start(np.nextafter(knots[1:], 0))
    h = np.diff(knots)[:, None]
    # (pieces, 6 conditions, 6 coordinates), derivatives with respect to τ = t/h
    sides = coordinates_of(left), coordinates_of(right)
    ends = np.stack([part * h**k for side in sides for k, part in enumerate(side)], axis=1)
    pieces = np.moveaxis(_HERMITE @ ends, 1, 2) / h[:, :, None] ** np.arange(5, -1, -1)
    for longest, of_less in ((SHORT, _quartics), (SHORTEST, _cubics)):
        short = h[:, 0] < longest
        left_short, right_short = ([part[short] for part in side] for side in sides)
        pieces[short] = of_less(left_short, right_short, h[short])
    begins = motion.start + knots[:-1]
    if motion.start > 0:
        # at rest before; the first piece may start with an acceleration
        waiting = np.zeros((1, 6, 6))
        waiting[0, :, 5] = sides[0][0][0]
        begins, pieces = np.append(0.0, begins), np.concatenate([waiting, pieces])
    return Polynomials(begins, pieces, motion.end, motion)


def _times_at(law: TimeLaw, values: FloatArray) -> FloatArray:
    """When a law's path parameter passes values (n,) [s], by bisection to rounding."""
    before, after = np.zeros(len(values)), np.full(len(values), law.duration)
    for _ in range(60):
        middle = (before + after) / 2
        is_before = law(middle).value < values
        before, after = np.where(is_before, middle, before), np.where(is_before, after, middle)
    return after


def _refined(knots: FloatArray) -> FloatArray:
    """Knots refined where they are far apart and the motion nearly stops and turns."""
    steps = np.diff(knots)
    # a step that is the longest but for rounding is one
    parts = np.ceil((1 - 1e-9) * steps / (knots[-1] / PIECES)).astype(int)
    at = np.repeat(knots[:-1], parts)
    first = np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(at + np.repeat(steps / parts, parts) * (np.arange(len(at)) - first), knots[-1])


def _quartics(left: Any, right: Any, h: FloatArray) -> FloatArray:
    """Pose at the left end, and rate and acceleration at both; the pose at the right end follows, to h⁵."""
    pose, rate, acceleration = left
    mean = (right[1] - rate) / h
    third = (3 * mean - 2 * acceleration - right[2]) / (3 * h)
    fourth = (acceleration + right[2] - 2 * mean) / (4 * h**2)
    return np.stack([np.zeros_like(pose), fourth, third, acceleration / 2, rate, pose], axis=2)


def _cubics(left: Any, right: Any, h: FloatArray) -> FloatArray:
    """Pose and rate at the left end, and an acceleration that is linear between the ends."""
    pose, rate, acceleration = left
    zero = np.zeros_like(pose)
    return np.stack([zero, zero, (right[2] - acceleration) / (6 * h), acceleration / 2, rate, pose], axis=2)

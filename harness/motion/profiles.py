"""Functions of time with exact derivatives, the building blocks of motions.

A motion is a base pose plus profiles in time times directions in (x, y, z, roll, pitch, yaw). Angular velocity and
acceleration follow from the rates of roll, pitch and yaw. Arguments are numbers, or CasADi symbols in object arrays, so
no function branches on a value.
"""

from typing import NamedTuple

import numpy as np

from gough_stewart.harness.motion.motion import ROUNDING
from gough_stewart.model.operations import maximum, minimum, reached
from gough_stewart.model.vectors import Array


class Profile(NamedTuple):
    """A function of time with its first two derivatives; each (n,)."""

    value: Array
    rate: Array
    acceleration: Array

    def times(self, other: "Profile") -> "Profile":
        """Product, by the product rule."""
        return Profile(
            self.value * other.value,
            self.rate * other.value + self.value * other.rate,
            self.acceleration * other.value + 2 * self.rate * other.rate + self.value * other.acceleration,
        )

    def faded(self, time: Array, fade_in: float | Array) -> "Profile":
        """Multiplied by a quintic from 0 to 1 over the fade-in [s]; unchanged for 0 s, which no symbol is."""
        return self.times(quintic(time, fade_in)) if isinstance(fade_in, np.ndarray) or fade_in > 0 else self


def step(time: Array) -> Profile:
    """From 0 to 1 at time 0 (1 at time 0 itself); rates are zero on both sides."""
    value = reached(time, -ROUNDING)
    return Profile(value, 0 * value, 0 * value)


def quintic(time: Array, duration: float | Array) -> Profile:
    """From 0 to 1 over the duration, at rest at both ends: 10 s³ − 15 s⁴ + 6 s⁵, s = t/duration."""
    s = minimum(maximum(time / duration, 0.0), 1.0)
    value = s**3 * (10 - 15 * s + 6 * s**2)
    return Profile(value, 30 * s**2 * (1 - s) ** 2 / duration, 60 * s * (1 - s) * (1 - 2 * s) / duration**2)


def sine(phase: Array, rate: Array | float, change: Array | float = 0.0) -> Profile:
    """Sine of a phase whose first and second derivatives are `rate` and `change`."""
    sine, cosine = np.sin(phase), np.cos(phase)
    return Profile(sine, cosine * rate, cosine * change - sine * rate**2)

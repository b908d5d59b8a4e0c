"""A motion of the platform frame: poses with their exact first and second derivatives; slower or smaller motions.

A motion is a base pose plus profiles in time times directions in (x, y, z, roll, pitch, yaw). Angular velocity and
acceleration follow from the rates of roll, pitch and yaw. Arguments are numbers, or CasADi symbols in object arrays, so
no function branches on a value.
"""

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.model.rotations import (
    angular_acceleration_from_orientation_rates,
    angular_velocity_from_orientation_rate,
    orientation_rate_from_angular_velocity,
)
from gough_stewart.model.vectors import Array, FloatArray, maximum, minimum

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

# Times are multiples of a step up to rounding: a jump at 0.2 s takes effect in the row at 0.19999999999 s [s].
ROUNDING = 1e-9


class Motion(NamedTuple):
    """A motion of the platform frame at n times; each (n, 3)."""

    position: FloatArray  # [m]
    orientation: FloatArray  # roll, pitch, yaw [rad]
    velocity: FloatArray  # [m/s]
    angular_velocity: FloatArray  # world components [rad/s]
    acceleration: FloatArray  # [m/s²]
    angular_acceleration: FloatArray  # world components [rad/s²]


def distinct_rows(motion: Motion) -> tuple[Motion, Any]:
    """The motion with consecutive rows that are equal, as at rest, only once; and which of these each row is (n,)."""
    rows = np.concatenate(motion, axis=1)
    is_new = (rows[1:] != rows[:-1]).any(axis=1)
    if is_new.all():
        return motion, slice(None)
    first = np.flatnonzero(np.append(True, is_new))
    return Motion(*(part[first] for part in motion)), np.append(0, np.cumsum(is_new))


class Reference(Protocol):
    """A reference motion."""

    @property
    def centre(self) -> FloatArray:
        """The pose (6,) about which amplitudes are scaled."""

    @property
    def defined_until(self) -> float:
        """The last time at which it is defined [s], of a recording; others go on, paths at rest."""

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""


class Piecewise(Reference, ABC):
    """A motion that is piecewise polynomial, exactly or up to rounding, so that it can be exported as a table."""

    end: float
    """The last time at which anything moves [s]."""
    defined_until: float = math.inf

    @property
    @abstractmethod
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The start of each piece (n,) [s], and its polynomials in the time since then (n, 6, 6).

        Coefficients of x, y, z, roll, pitch, yaw, the highest power first.
        """


def polynomials_of_spline(spline: "BSpline") -> tuple[FloatArray, FloatArray]:
    """The start of each piece of a spline (n,), and its polynomials since then (n, 6, k + 1), highest power first."""
    begins = spline.t[spline.k : -spline.k - 1]
    powers = range(spline.k, -1, -1)
    return begins, np.stack([spline(begins, power) / math.factorial(power) for power in powers], axis=-1)


def motion_of(pose: Any, rate: Any, acceleration: Any) -> Motion:
    """The motion from (n, 6) of x, y, z, roll, pitch, yaw and their first and second derivatives."""
    angles, rates, accelerations = pose[:, 3:], rate[:, 3:], acceleration[:, 3:]
    return Motion(
        pose[:, :3],
        angles,
        rate[:, :3],
        angular_velocity_from_orientation_rate(angles, rates),
        acceleration[:, :3],
        angular_acceleration_from_orientation_rates(angles, rates, accelerations),
    )


def coordinates_of(motion: Motion) -> tuple[Any, Any, Any]:
    """x, y, z, roll, pitch, yaw of a motion and their first and second derivatives; each (n, 6); inverts `motion_of`.

    The angles' second derivatives follow from ω̇ less the part that depends on their rates.
    """
    angles, omega = motion.orientation, motion.angular_velocity
    rates = orientation_rate_from_angular_velocity(angles, omega)
    # ω̇ is linear in the second derivatives of the angles, with the matrix that maps rates to ω
    turning = angular_acceleration_from_orientation_rates(angles, rates, 0 * rates)
    second = orientation_rate_from_angular_velocity(angles, motion.angular_acceleration - turning)
    return (
        np.concatenate([motion.position, angles], axis=1),
        np.concatenate([motion.velocity, rates], axis=1),
        np.concatenate([motion.acceleration, second], axis=1),
    )


def extrapolated(motion: Motion, ahead: Any) -> Motion:
    """The motion some time [s] later, for constant accelerations and second derivatives of the angles.

    x + v h + a h²/2 for the position, likewise for roll, pitch, yaw, with exact derivatives.
    """
    pose, rate, acceleration = coordinates_of(motion)
    return motion_of(
        pose + ahead * rate + (ahead * ahead / 2) * acceleration, rate + ahead * acceleration, acceleration
    )


def slower(motion: Motion, scale: float | Array) -> Motion:
    """The same poses s times later: v/s, ω/s, v̇/s², ω̇/s²."""
    if not isinstance(scale, np.ndarray) and scale == 1:
        return motion
    position, orientation, *rates = motion
    velocity, spin, acceleration, angular = rates
    return Motion(position, orientation, velocity / scale, spin / scale, acceleration / scale**2, angular / scale**2)


def smaller(motion: Motion, scale: float, centre: FloatArray) -> Motion:
    """All deviations from a pose (6,) times a, in position and in roll, pitch, yaw."""
    pose, rate, acceleration = coordinates_of(motion)
    return motion_of(centre + scale * (pose - centre), scale * rate, scale * acceleration)


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


def quintic(time: Array, duration: float | Array) -> Profile:
    """From 0 to 1 over the duration, at rest at both ends: 10 s³ − 15 s⁴ + 6 s⁵, s = t/duration."""
    s = minimum(maximum(time / duration, 0.0), 1.0)
    value = s**3 * (10 - 15 * s + 6 * s**2)
    return Profile(value, 30 * s**2 * (1 - s) ** 2 / duration, 60 * s * (1 - s) * (1 - 2 * s) / duration**2)


def sine(phase: Array, rate: Array | float, change: Array | float = 0.0) -> Profile:
    """Sine of a phase whose first and second derivatives are `rate` and `change`."""
    sine, cosine = np.sin(phase), np.cos(phase)
    return Profile(sine, cosine * rate, cosine * change - sine * rate**2)

"""Reference motions of the pose, with exact velocities and accelerations.

A motion is a base pose plus profiles in time times directions in (x, y, z, roll, pitch, yaw). Angular velocity and
acceleration follow from the rates of roll, pitch and yaw.
"""

import math
from dataclasses import dataclass, fields
from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import Motion, motion_of
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import FloatArray

# Times are multiples of a step up to rounding: a jump at 0.2 s has happened in the row of 0.19999999999 s.
ROUNDING = 1e-9


class _Profile(NamedTuple):
    """A function of time with its first two derivatives; each (n,)."""

    value: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    def times(self, other: "_Profile") -> "_Profile":
        """Product, by the product rule."""
        return _Profile(
            self.value * other.value,
            self.rate * other.value + self.value * other.rate,
            self.acceleration * other.value + 2 * self.rate * other.rate + self.value * other.acceleration,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _About:
    """A motion about a pose; numbers are checked and frozen when it is made."""

    position: FloatArray
    orientation: FloatArray

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "plane":
                continue
            shape = (3,) if field.name in _VECTORS else ()
            try:
                array = real_array(value, shape)
            except ValueError as error:
                raise MotionError(f"{field.name} {error}") from None
            if field.name in _POSITIVE and not array > 0:
                raise MotionError(f"{field.name} is {value!r}; expected a number > 0")
            if field.name in _NOT_NEGATIVE and not array >= 0:
                raise MotionError(f"{field.name} is {value!r}; expected a number >= 0")
            array.setflags(write=False)
            object.__setattr__(self, field.name, array if shape else float(array))

    def _along(self, *parts: tuple[_Profile, FloatArray]) -> Motion:
        """The base pose plus profiles (n,) times directions (6,)."""
        pose, rate, acceleration = (
            sum((profile[k][:, None] * direction for profile, direction in parts), start=np.zeros(6)) for k in range(3)
        )
        return motion_of(pose + np.concatenate([self.position, self.orientation]), rate, acceleration)


_VECTORS = (
    "position",
    "orientation",
    "position_change",
    "orientation_change",
    "position_amplitude",
    "orientation_amplitude",
)
_POSITIVE = ("duration", "frequency", "from_frequency", "to_frequency", "radius")
_NOT_NEGATIVE = ("at", "fade_in")


@dataclass(frozen=True, kw_only=True, eq=False)
class Hold(_About):
    """Stay in a pose."""

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""
        return self._along((_constant(time, 0.0), np.zeros(6)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Step(_About):
    """Jump by a change at a time; velocity and acceleration are zero on both sides."""

    position_change: FloatArray
    orientation_change: FloatArray
    at: float  # [s]

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]; at the jump itself, after it."""
        happened = _constant(time, 0.0)._replace(value=(time >= self.at - ROUNDING).astype(float))
        return self._along((happened, np.concatenate([self.position_change, self.orientation_change])))


@dataclass(frozen=True, kw_only=True, eq=False)
class PointToPoint(_About):
    """Go by a change from rest to rest: s = 10 τ³ − 15 τ⁴ + 6 τ⁵, τ = (t − at)/duration."""

    position_change: FloatArray
    orientation_change: FloatArray
    at: float  # [s]
    duration: float  # [s]

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""
        direction = np.concatenate([self.position_change, self.orientation_change])
        return self._along((_quintic(time - self.at, self.duration), direction))


@dataclass(frozen=True, kw_only=True, eq=False)
class Sine(_About):
    """Swing: amplitude · sin(2π f t + phase), faded in by the quintic."""

    position_amplitude: FloatArray
    orientation_amplitude: FloatArray
    frequency: float  # [Hz]
    phase: float = 0.0  # [rad]
    fade_in: float = 0.0  # [s]

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""
        omega = 2 * math.pi * self.frequency
        swing = _sine(omega * time + self.phase, omega, 0.0)
        direction = np.concatenate([self.position_amplitude, self.orientation_amplitude])
        return self._along((_faded(swing, time, self.fade_in), direction))


@dataclass(frozen=True, kw_only=True, eq=False)
class Circle(_About):
    """Circle about a position, radius (cos 2π f t, sin 2π f t) in a plane; the radius is faded in by the quintic."""

    radius: float  # [m]
    frequency: float  # [Hz]
    plane: Literal["xy", "xz", "yz"] = "xy"
    fade_in: float = 0.0  # [s]

    def __post_init__(self) -> None:
        if self.plane not in ("xy", "xz", "yz"):
            raise MotionError(f"plane is {self.plane!r}; expected 'xy', 'xz' or 'yz'")
        super().__post_init__()

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""
        omega = 2 * math.pi * self.frequency
        across, along = (self.radius * np.eye(6)["xyz".index(axis)] for axis in self.plane)
        cosine, sine = (_sine(omega * time + phase, omega, 0.0) for phase in (math.pi / 2, 0.0))
        return self._along(*((_faded(p, time, self.fade_in), d) for p, d in ((cosine, across), (sine, along))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Chirp(_About):
    """Swing with a frequency that changes linearly over a duration, then stays.

    amplitude · sin 2π (f0 t + (f1 − f0) t²/(2 T)) up to T, with continuous phase afterwards.
    """

    position_amplitude: FloatArray
    orientation_amplitude: FloatArray
    from_frequency: float  # f0 [Hz]
    to_frequency: float  # f1 [Hz]
    duration: float  # T [s]
    fade_in: float = 0.0  # [s]

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""
        f0, f1, T = self.from_frequency, self.to_frequency, self.duration
        sweeping, after = np.minimum(time, T), np.maximum(time - T, 0.0)
        cycles = f0 * sweeping + (f1 - f0) * sweeping**2 / (2 * T) + f1 * after
        frequency = f0 + (f1 - f0) * sweeping / T
        change = np.where(time < T, (f1 - f0) / T, 0.0)
        swing = _sine(*(2 * math.pi * each for each in (cycles, frequency, change)))
        direction = np.concatenate([self.position_amplitude, self.orientation_amplitude])
        return self._along((_faded(swing, time, self.fade_in), direction))


def _constant(time: FloatArray, value: float) -> _Profile:
    return _Profile(np.full_like(time, value), np.zeros_like(time), np.zeros_like(time))


def _quintic(time: FloatArray, duration: float) -> _Profile:
    """From 0 to 1 over the duration, at rest at both ends."""
    s = np.clip(time / duration, 0.0, 1.0)
    value = s**3 * (10 - 15 * s + 6 * s**2)
    return _Profile(value, 30 * s**2 * (1 - s) ** 2 / duration, 60 * s * (1 - s) * (1 - 2 * s) / duration**2)


def _sine(phase: FloatArray, rate: FloatArray | float, change: FloatArray | float) -> _Profile:
    """Sine of a phase whose first and second derivatives are `rate` and `change`."""
    sine, cosine = np.sin(phase), np.cos(phase)
    return _Profile(sine, cosine * rate, cosine * change - sine * rate**2)


def _faded(profile: _Profile, time: FloatArray, fade_in: float) -> _Profile:
    return profile.times(_quintic(time, fade_in)) if fade_in > 0 else profile

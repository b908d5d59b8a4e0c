"""Reference motions of the pose, with exact velocities and accelerations.

A motion is a base pose plus profiles in time times directions in (x, y, z, roll, pitch, yaw). Angular velocity and
acceleration follow from the rates of roll, pitch and yaw.
"""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import polars
from scipy.interpolate import BSpline, make_interp_spline

from gough_stewart.harness.errors import MotionError
from gough_stewart.model.real import real_array
from gough_stewart.model.rotations import (
    angular_acceleration_from_orientation_rates,
    angular_velocity_from_orientation_rate,
)
from gough_stewart.model.vectors import FloatArray

# Times are multiples of a step up to rounding: a jump at 0.2 s has happened in the row of 0.19999999999 s.
_ROUNDING = 1e-9
_SPLINE_DEGREE = 5


class Motion(NamedTuple):
    """A motion of the platform frame at n times; each (n, 3)."""

    position: FloatArray  # [m]
    orientation: FloatArray  # roll, pitch, yaw [rad]
    velocity: FloatArray  # [m/s]
    angular_velocity: FloatArray  # world components [rad/s]
    acceleration: FloatArray  # [m/s²]
    angular_acceleration: FloatArray  # world components [rad/s²]


class Reference(Protocol):
    """A wanted motion."""

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s]."""


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
        return _motion(pose + np.concatenate([self.position, self.orientation]), rate, acceleration)


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
        happened = _constant(time, 0.0)._replace(value=(time >= self.at - _ROUNDING).astype(float))
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


@dataclass(frozen=True, eq=False)
class FromTable:
    """Poses at given times with quintic splines between them, and the splines' own derivatives.

    Raises
    ------
    MotionError
        Fewer than six rows, times that do not increase, or numbers that are not finite.
    """

    time: FloatArray  # (n,) [s]
    position: FloatArray  # (n, 3) [m]
    orientation: FloatArray  # (n, 3) [rad]

    def __post_init__(self) -> None:
        n = np.size(self.time)
        if n <= _SPLINE_DEGREE:
            raise MotionError(f"a table of {n} rows; expected at least {_SPLINE_DEGREE + 1} for quintic splines")
        for name, shape in (("time", (n,)), ("position", (n, 3)), ("orientation", (n, 3))):
            try:
                array = real_array(getattr(self, name), shape)
            except ValueError as error:
                raise MotionError(f"{name} {error}") from None
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        back = np.flatnonzero(np.diff(self.time) <= 0)
        if back.size:
            k = int(back[0])
            raise MotionError(
                f"time goes from {self.time[k]:g} to {self.time[k + 1]:g} s in row {k + 2}; expected increasing times"
            )
        pose = np.hstack([self.position, self.orientation])
        object.__setattr__(self, "_spline", make_interp_spline(self.time, pose, k=_SPLINE_DEGREE))

    def __call__(self, time: FloatArray) -> Motion:
        """The motion at times (n,) [s].

        Raises
        ------
        MotionError
            A time before the first row or after the last.
        """
        first, last = float(self.time[0]), float(self.time[-1])
        outside = time[~((time >= first - _ROUNDING) & (time <= last + _ROUNDING))]  # NaN is outside
        if outside.size:
            raise MotionError(
                f"time {outside[0]:g} s is outside of the table, which goes from {first:g} to {last:g} s; make the run "
                "shorter or the table longer"
            )
        spline: BSpline = getattr(self, "_spline")  # noqa: B009 - set in __post_init__ on a frozen instance
        inside = np.clip(time, first, last)
        return _motion(*(spline(inside, k) for k in range(3)))


def read_reference(path: Path | str) -> FromTable:
    """A motion from a CSV file with the columns time, position[1..3] and orientation[1..3], in SI units.

    Raises
    ------
    MotionError
        The file cannot be read, a column is missing or holds no numbers, or as `FromTable`; names file, column and row.
    """
    names = ["time", *(f"{name}[{k}]" for name in ("position", "orientation") for k in (1, 2, 3))]
    try:
        # as texts, so that true is no number; without patterns, so that * and [1] are parts of a name
        table = polars.read_csv(path, infer_schema=False, glob=False)
    except OSError as error:
        raise MotionError(f"{path}: cannot read this reference: {error.strerror or error}") from error
    except polars.exceptions.PolarsError as error:
        raise MotionError(f"{path}: is not CSV: {error}") from error
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise MotionError(f"{path}: has no column {', '.join(missing)}; expected {', '.join(names)}")
    for name in names:
        column = table[name]
        numbers = column.cast(polars.Float64, strict=False)
        bad = [k for k, value in enumerate(numbers) if value is None or not math.isfinite(value)]
        if bad:
            raise MotionError(f"{path}: {name} in row {bad[0] + 1} is {column[bad[0]]!r}; expected a finite number")
    values = table.select(polars.col(names).cast(polars.Float64)).to_numpy()
    try:
        return FromTable(values[:, 0], values[:, 1:4], values[:, 4:7])
    except MotionError as error:
        raise MotionError(f"{path}: {error}") from error


def _motion(pose: Any, rate: Any, acceleration: Any) -> Motion:
    """From (n, 6) of x, y, z, roll, pitch, yaw and their derivatives."""
    angles, rates, accelerations = pose[:, 3:], rate[:, 3:], acceleration[:, 3:]
    return Motion(
        pose[:, :3],
        angles,
        rate[:, :3],
        angular_velocity_from_orientation_rate(angles, rates),
        acceleration[:, :3],
        angular_acceleration_from_orientation_rates(angles, rates, accelerations),
    )


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

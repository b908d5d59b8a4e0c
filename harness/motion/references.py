"""The reference motions: `[reference]` in an experiment file, and the same in Python.

Each motion is one class: its keys with units, bounds and defaults, and its formula. A new class is all that a new
motion needs; its `type` makes it known to experiment files.
"""

import math
from abc import abstractmethod
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import ROUNDING, Motion, Profile, Reference, motion_of, quintic, sine, slower
from gough_stewart.harness.motion.recorded.from_table import FromTable, check_speed, resampled, smoothed
from gough_stewart.harness.motion.recorded.recording import (
    AtHome,
    LegLengths,
    moved_home,
    read_recording,
    recording_path,
)
from gough_stewart.harness.pose_convention import QUATERNION, PoseConvention, RotationAbout
from gough_stewart.harness.section import (
    ZEROS,
    Angle,
    AnyTime,
    FileName,
    Frequency,
    Kind,
    Number,
    Orientation,
    Position,
    PositiveLength,
    PositiveNumber,
    PositiveTime,
    Time,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray, maximum, minimum, reached


class ReferenceChoice(Kind):
    """The motion of an experiment.

    It takes `time_scale` times as long, counted from time 0, and is `amplitude_scale` times as large, about its own
    pose or the first one of a table: pose₀ + a (pose(t/s) − pose₀), with rates and accelerations scaled to match.

    Raises
    ------
    MotionError
        Impossible values; names the key, its value, and what was expected.
    """

    error: ClassVar[type[MotionError]] = MotionError
    time_scale: PositiveNumber = 1.0
    amplitude_scale: Number = 1.0

    @abstractmethod
    def about(self, platform: Platform, folder: Path = Path()) -> Reference:
        """The motion for a platform; `folder` resolves file names.

        Raises
        ------
        MotionError
            A file that cannot be read, or without a motion.
        """

    frequencies: ClassVar[tuple[str, ...]] = ()  # its keys that are frequencies

    @property
    def highest_frequency(self) -> float:
        """The highest frequency of the motion [Hz]; 0 if it has none."""
        return float(max((getattr(self, key) for key in self.frequencies), default=0.0) / self.time_scale)


class AboutPose(ReferenceChoice):
    """A motion about a pose, by default the platform's home pose."""

    defined_until: ClassVar[float] = math.inf
    position: Position | None = None
    orientation: Orientation | None = None

    def about(self, platform: Platform, folder: Path = Path()) -> Self:  # noqa: ARG002 - there is no file
        """The same motion about the home pose, unless a pose is set."""
        home = {"position": platform.home_position, "orientation": platform.home_orientation}
        return self.model_copy(
            update={name: tuple(value.tolist()) for name, value in home.items() if getattr(self, name) is None}
        )

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s].

        Raises
        ------
        MotionError
            Neither a pose nor a platform is set.
        """
        times = np.asarray(time)
        if times.dtype != object:  # else they are symbols
            times = times.astype(float, copy=False)
        return slower(self._at(times / self.time_scale), self.time_scale)

    @abstractmethod
    def _at(self, time: Array) -> Motion:
        """The motion at an array of times in its own, unscaled time."""

    def _by(self, *parts: tuple[Profile, FloatArray]) -> Motion:
        """The pose plus profiles (n,) times directions (6,), times the amplitude scale."""
        value, rate, acceleration = (
            sum((profile[k][:, None] * (self.amplitude_scale * along) for profile, along in parts), start=np.zeros(6))
            for k in range(3)
        )
        return motion_of(value + self.centre, rate, acceleration)

    @property
    def centre(self) -> FloatArray:
        """The pose (6,) that the motion is about."""
        for name in ("position", "orientation"):
            if getattr(self, name) is None:
                raise MotionError(f"{name} is None; expected a {name}, or the home pose of a platform: about(platform)")
        return np.concatenate([self.position, self.orientation])


class Hold(AboutPose):
    """Stay in a pose.

    `position` [m], `orientation` [rad]; home by default.
    """

    type: Literal["hold"] = "hold"

    def _at(self, time: Array) -> Motion:
        rest = np.zeros((len(time), 6))
        return motion_of(rest + self.centre, rest, rest)


class _Change(AboutPose):
    """A motion from one pose to another."""

    position_change: Position = ZEROS
    orientation_change: Orientation = ZEROS


class Step(_Change):
    """Jump by a change at a time; velocity and acceleration are zero on both sides.

    `position_change` [m], `orientation_change` [rad], `at` > 0 [s]; about `position` [m] and `orientation` [rad],
    home by default.
    """

    type: Literal["step"] = "step"
    at: PositiveTime  # at 0 there would be no step

    def _at(self, time: Array) -> Motion:
        # at the time of the jump, the value after it
        value = reached(time - self.at, -ROUNDING)
        along = np.concatenate([self.position_change, self.orientation_change])
        return self._by((Profile(value, 0 * value, 0 * value), along))


class PointToPoint(_Change):
    """Move by a change of pose from rest to rest: s = 10 τ³ − 15 τ⁴ + 6 τ⁵, τ = (t − at)/duration.

    `position_change` [m], `orientation_change` [rad], `at` [s], `duration` [s]; about `position` [m] and
    `orientation` [rad], home by default.
    """

    type: Literal["point_to_point"] = "point_to_point"
    at: Time = 0.0
    duration: PositiveTime

    def _at(self, time: Array) -> Motion:
        along = np.concatenate([self.position_change, self.orientation_change])
        return self._by((quintic(time - self.at, self.duration), along))


class _Swing(AboutPose):
    """A periodic motion."""

    position_amplitude: Position = ZEROS
    orientation_amplitude: Orientation = ZEROS
    fade_in: Time = 0.0


class Sine(_Swing):
    """Harmonic motion: amplitude · sin(2π f t + phase), faded in by a quintic.

    `position_amplitude` [m], `orientation_amplitude` [rad], `frequency` [Hz], `phase` [rad] of all axes, to which
    `position_phase` and `orientation_phase` [rad] add one of each axis, `fade_in` [s]; about `position` [m] and
    `orientation` [rad], home by default.

    Examples
    --------
    >>> swing = gs.Sine(position_amplitude=(0, 0, 0.02), frequency=1.5, fade_in=1)
    >>> record = gs.run("circle", {"reference": swing, "loop.duration": 0.1})
    >>> swing.about(gs.load_preset("liu2000"))(np.linspace(0, 1, 11)).velocity.shape
    """

    frequencies: ClassVar[tuple[str, ...]] = ("frequency",)
    type: Literal["sine"] = "sine"
    frequency: Frequency
    phase: Angle = 0.0
    position_phase: Orientation = ZEROS
    orientation_phase: Orientation = ZEROS

    def _at(self, time: Array) -> Motion:
        omega = 2 * math.pi * self.frequency
        offsets = np.concatenate([self.position_phase, self.orientation_phase])
        amplitudes = np.concatenate([self.position_amplitude, self.orientation_amplitude])
        # axes of one phase share a sine; symbols, which cannot be compared, have one each
        first, of_axis = np.arange(6), np.arange(6)
        if offsets.dtype != object:
            _, first, of_axis = np.unique(offsets, return_index=True, return_inverse=True)
        return self._by(
            *(
                (
                    sine(omega * time + (self.phase + offsets[axis : axis + 1]), omega).faded(time, self.fade_in),
                    np.where(of_axis == k, amplitudes, 0.0),
                )
                for k, axis in enumerate(first.tolist())
            )
        )


class Chirp(_Swing):
    """Harmonic motion with a frequency that changes linearly over a duration, then stays constant.

    amplitude · sin 2π (f0 t + (f1 − f0) t²/(2 T)) up to T, with continuous phase afterwards.
    `position_amplitude` [m], `orientation_amplitude` [rad], `from_frequency` f0 and `to_frequency` f1 [Hz], `duration`
    T [s], `fade_in` [s]; about `position` [m] and `orientation` [rad], home by default.
    """

    frequencies: ClassVar[tuple[str, ...]] = ("from_frequency", "to_frequency")
    type: Literal["chirp"] = "chirp"
    from_frequency: Frequency  # f0
    to_frequency: Frequency  # f1
    duration: PositiveTime  # T

    def _at(self, time: Array) -> Motion:
        f0, f1, T = self.from_frequency, self.to_frequency, self.duration
        sweeping, after = minimum(time, T), maximum(time - T, 0.0)
        cycles = f0 * sweeping + (f1 - f0) * sweeping**2 / (2 * T) + f1 * after
        frequency = f0 + (f1 - f0) * sweeping / T
        change = (f1 - f0) / T * (1 - reached(time, T))
        swing = sine(*(2 * math.pi * part for part in (cycles, frequency, change)))
        along = np.concatenate([self.position_amplitude, self.orientation_amplitude])
        return self._by((swing.faded(time, self.fade_in), along))


class Circle(AboutPose):
    """Move on a circle in a plane, radius · (cos 2π f t, sin 2π f t) about a position, faded in by a quintic.

    `radius` [m], `frequency` [Hz], `plane` "xy", "xz" or "yz", `fade_in` [s]; about `position` [m] and
    `orientation` [rad], home by default.
    """

    frequencies: ClassVar[tuple[str, ...]] = ("frequency",)
    type: Literal["circle"] = "circle"
    radius: PositiveLength
    frequency: Frequency
    plane: Literal["xy", "xz", "yz"] = "xy"
    fade_in: Time = 0.0

    def _at(self, time: Array) -> Motion:
        omega = 2 * math.pi * self.frequency
        axes = (self.radius * np.eye(6)["xyz".index(axis)] for axis in self.plane)
        profiles = (sine(omega * time + phase, omega).faded(time, self.fade_in) for phase in (math.pi / 2, 0.0))
        return self._by(*zip(profiles, axes, strict=True))


_Positions = Annotated[list[Position], Field(min_length=1, max_length=100)]
_Orientations = Annotated[list[Orientation], Field(min_length=1, max_length=100)]
_COEFFICIENTS = ("position_sine", "position_cosine", "orientation_sine", "orientation_cosine")


class Excitation(AboutPose):
    """Move in all coordinates at multiples of a frequency: w(t) Σ_k (a_k sin 2π k f t + b_k cos 2π k f t).

    `position_sine`, `position_cosine` [m], `orientation_sine`, `orientation_cosine` [rad]: the coefficients, three
    numbers for each k = 1, 2, …; `frequency` f [Hz], `duration` [s], `fade` [s]: the time over which w rises as a
    quintic, and falls at the end, so that pose, velocity and acceleration start and end at rest. About `position` [m]
    and `orientation` [rad], home by default.

    Examples
    --------
    >>> swing = gs.Excitation(frequency=0.5, duration=4, position_sine=[[0.02, 0, 0]], position_cosine=[[0, 0, 0.01]],
    ...                       orientation_sine=[[0, 0.02, 0]], orientation_cosine=[[0, 0, 0]])
    >>> swing.about(gs.load_preset("liu2000"))(np.linspace(0, 4, 5)).velocity.shape
    (5, 3)
    """

    type: Literal["excitation"] = "excitation"
    frequency: Frequency
    duration: PositiveTime
    fade: PositiveTime = 1.0
    position_sine: _Positions
    position_cosine: _Positions
    orientation_sine: _Orientations
    orientation_cosine: _Orientations

    @model_validator(mode="after")
    def _alike(self) -> "Excitation":
        sizes = {name: len(getattr(self, name)) for name in _COEFFICIENTS}
        if len(set(sizes.values())) > 1:
            listed = ", ".join(f"{name} {size}" for name, size in sizes.items())
            raise ValueError(f"expected the same number of coefficients of each kind; found {listed}")
        if 2 * self.fade > self.duration:
            ends = f"fade is {self.fade:g} s at either end of a duration of {self.duration:g} s"
            raise ValueError(f"{ends}; expected at most half of it")
        return self

    def _at(self, time: Array) -> Motion:
        begin, end = quintic(time, self.fade), quintic(time - (self.duration - self.fade), self.fade)
        window = begin.times(Profile(1 - end.value, -end.rate, -end.acceleration))
        parts = []
        sines, cosines = self.coefficients
        for k in range(len(sines)):
            omega = 2 * math.pi * (k + 1) * self.frequency
            for phase, direction in ((0.0, sines[k]), (math.pi / 2, cosines[k])):
                parts.append((sine(omega * time + phase, omega).times(window), direction))
        return self._by(*parts)

    @property
    def coefficients(self) -> tuple[FloatArray, FloatArray]:
        """The coefficients of the sines and of the cosines (N, 6) [m], [rad]."""
        arrays = [np.array(getattr(self, name), dtype=float) for name in _COEFFICIENTS]
        return np.hstack([arrays[0], arrays[2]]), np.hstack([arrays[1], arrays[3]])

    @property
    def highest_frequency(self) -> float:
        """The frequency of the last harmonic [Hz]."""
        return self.frequency * len(self.position_sine) / self.time_scale


class WrittenPoses(ReferenceChoice):
    """A motion through poses that somebody wrote, in a convention of theirs; see `PoseConvention`."""

    rotation_order: str = "XYZ"
    rotation_about: RotationAbout = "fixed"
    frame: str = "z_up"
    pivot: Position = ZEROS

    @property
    def convention(self) -> PoseConvention:
        """How the poses are written."""
        pivot = tuple(np.asarray(self.pivot, dtype=float).tolist())
        return PoseConvention(self.rotation_order, self.rotation_about, self.frame, pivot)

    @model_validator(mode="after")
    def _known_convention(self) -> Self:
        if self.convention.rotation_order == QUATERNION:
            raise ValueError("rotation_order is 'quaternion'; expected an order of angles; quaternions need none")
        return self


class FromFile(WrittenPoses):
    """Follow the rows of a motion log, CSV or Parquet, from its `start_time` on, by default from its first row.

    `columns` names its columns, if the header uses other names; `largest_gap` is the longest time allowed between two
    rows. `resample` lowers the rate of the rows, `smoothing` is the cut-off of a zero-phase low-pass; see `low_pass`.
    `unusual_speed` accepts a motion so slow or fast that its times look as if they were in another unit.
    `at_home` moves the motion so that its first pose or its mean becomes the home pose; see `moved_home`.
    `rotation_order`, `rotation_about`, `frame` and `pivot` say how the file writes poses. Instead of poses it may have
    leg lengths, absolute or changes from those at home: `leg_lengths`.
    """

    type: Literal["file"] = "file"
    file: FileName
    columns: str | dict[str, str] = ""
    largest_gap: PositiveTime | None = None
    start_time: AnyTime | None = None
    resample: Frequency | None = None
    smoothing: Frequency | None = None
    at_home: AtHome | None = None
    unusual_speed: bool = False
    leg_lengths: LegLengths = "absolute"

    def about(self, platform: Platform, folder: Path = Path()) -> FromTable:
        """The file's poses, with quintic splines between them; shipped files are found by name."""
        path = recording_path(folder, self.file)
        table, first, unit = read_recording(
            path, self.columns, self.largest_gap, self.convention, platform, self.leg_lengths
        )
        if not self.unusual_speed:
            try:
                check_speed(table, unit, platform.characteristic_length, self.time_scale)
            except MotionError as error:
                raise MotionError(f"{path}: {error}") from error
        table = table if self.resample is None else resampled(table, self.resample)
        table = table if self.smoothing is None else smoothed(table, self.smoothing)
        start = 0.0 if self.start_time is None else self.start_time - first
        table = table if self.at_home is None else moved_home(table, platform, self.at_home, start)
        return table.scaled(start, self.time_scale, self.amplitude_scale)

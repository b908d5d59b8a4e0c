"""A motion that a hand goes on with: where it wanted the platform, sample by sample, through a filter with limits.

A live page writes what was dragged in it as such a motion; its C has the same filter and the same rules.
"""

import math
from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import model_validator

from gough_stewart.harness.control.component import Signals, Stepped
from gough_stewart.harness.errors import MotionError, TableError
from gough_stewart.harness.motion.motion import ROUNDING, Motion, Reference, coordinates_of, motion_of
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.section import ByType, FileName, Frequency, PositiveNumber, PositiveTime, TableSection
from gough_stewart.harness.table_file import numbers_of, read_table
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray, clip


class SmoothingChoice(TableSection):
    """Of one kind of channels: positions in m, or angles in rad."""

    bandwidth: Frequency = 1.0
    largest_rate: PositiveNumber = 0.5
    largest_acceleration: PositiveNumber = 2.0


class SmoothingCoefficients(NamedTuple):
    """Of `Smoothing`."""

    period: Any  # h [s]
    to_rate: Any  # ω/3 [1/s]
    to_acceleration: Any  # ω [1/s]
    share: Any  # 1 − e^(−3 ω h): of the way to a wanted acceleration in a step
    rate: Any
    acceleration: Any


class Smoothing(Stepped):
    """Follows a target by (s/ω + 1)³ with limits on rate and acceleration, ω = 2π `bandwidth`.

    Between two steps the acceleration a is linear in time, so that rate v and value x are its exact integrals; a tends
    to a* = ω (v* − v), with v* = ω/3 (target − x), within their limits. If ω/3 times the rate limit is at most the
    acceleration's, a target at rest is reached without a large overshoot.
    """

    name: ClassVar[str] = "smoothing"
    table: ClassVar[type[TableSection]] = SmoothingChoice
    keys: ClassVar[tuple[str, ...]] = ("bandwidth", "largest_rate", "largest_acceleration")
    inputs: ClassVar[tuple[str, ...]] = ("target",)
    outputs: ClassVar[tuple[str, ...]] = ()
    states: ClassVar[tuple[str, ...]] = ("value", "rate", "acceleration")
    by_channel: ClassVar[tuple[str, ...]] = SmoothingCoefficients._fields[1:]

    @staticmethod
    def prepare(values: Mapping[str, Any], period: Any) -> SmoothingCoefficients:
        omega = 2 * np.pi * values["bandwidth"]
        rate, acceleration = values["largest_rate"], values["largest_acceleration"]
        return SmoothingCoefficients(period, omega / 3, omega, 1 - np.exp(-3 * omega * period), rate, acceleration)

    @staticmethod
    def start(_coefficients: SmoothingCoefficients, inputs: Signals) -> Signals:
        return inputs[0], 0 * inputs[0], 0 * inputs[0]

    @staticmethod
    def step(coefficients: SmoothingCoefficients, states: Signals, inputs: Signals) -> tuple[Signals, Signals]:
        h, k1, k2, share, most_rate, most = coefficients
        (x, v, a), (target,) = states, inputs
        wanted_rate = clip(k1 * (target - x), -most_rate, most_rate)
        later = a + share * (clip(k2 * (wanted_rate - v), -most, most) - a)
        return (x + h * v + h * h * (a / 3 + later / 6), v + h * (a + later) / 2, later), ()


# How what a hand wants is smoothed, of three positions [m] and three angles [rad].
HAND_FILTERS = {
    "bandwidth": np.full(6, 1.5),
    "largest_rate": np.repeat([0.3, 0.5], 3),
    "largest_acceleration": np.repeat([2.0, 4.0], 3),
}
TARGET_COLUMNS = ("time", "x", "y", "z", "roll", "pitch", "yaw", "jumps")


def lengths_for_hands(platform: Platform) -> tuple[float, float]:
    """The least and largest leg length that a hand may ask for [m]: the stroke; without one, a tenth beyond home's."""
    at_home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    low, high = platform.leg_length_min, platform.leg_length_max
    return (
        float(0.9 * at_home.min() if low is None else np.max(low)),
        float(1.1 * at_home.max() if high is None else np.min(high)),
    )


class ByHand(ReferenceChoice):
    """Follow a `motion` until a hand takes over, then its targets.

    The rows of `file` are targets [m, rad] from a time [s] on, at multiples of `sample_time`; `jumps` is 1 where the
    filter jumps by the difference from the target before, else 0. From the first row on.
    """

    type: Literal["by_hand"] = "by_hand"
    file: FileName
    motion: Annotated[ReferenceChoice, ByType()]
    sample_time: PositiveTime

    @model_validator(mode="after")
    def _unscaled(self) -> "ByHand":
        if self.time_scale != 1 or self.amplitude_scale != 1:
            raise ValueError("a motion by hand has its own times and sizes; expected no time_scale and amplitude_scale")
        return self

    def about(self, platform: Platform, folder: Path = Path()) -> "HandMotion":
        """The motion, then the targets of the file."""
        path = folder / self.file
        try:
            table = read_table(path, "reference")
            missing = [name for name in TARGET_COLUMNS if name not in table.columns]
            if missing:
                raise MotionError(f"has no column {missing[0]}; expected {', '.join(TARGET_COLUMNS)}")  # noqa: TRY301
            time, *targets, jumps = (numbers_of(table, name) for name in TARGET_COLUMNS)
            samples = np.rint(time / self.sample_time).astype(int)
            apart = np.abs(time - samples * self.sample_time)
            if not len(time) or (np.diff(samples) < 0).any() or (samples < 0).any() or apart.max() > ROUNDING:
                rule = f"in order of time, at multiples of sample_time, {self.sample_time:g} s"
                raise MotionError(f"expected rows {rule}")  # noqa: TRY301
        except (MotionError, TableError) as error:
            raise MotionError(f"{path}: {error}") from error
        motion = self.motion.about(platform, folder)
        return HandMotion(motion, self.sample_time, samples.tolist(), np.stack(targets, axis=1), jumps)

    @property
    def highest_frequency(self) -> float:
        """That of the motion at the begin [Hz]."""
        return self.motion.highest_frequency


class HandMotion:
    """A motion, from the first sample of some targets (n, 6) on the filter's.

    Between samples pose, rates and accelerations are extrapolated from the last one.
    """

    defined_until = math.inf

    def __init__(
        self, motion: Reference, sample_time: float, samples: list[int], targets: FloatArray, jumps: FloatArray
    ) -> None:
        self._motion, self._period, self._samples = motion, sample_time, samples
        self._rows = list(zip(samples, targets, jumps > 0, strict=True))
        self._start = samples[0] * sample_time
        self._coefficients = Smoothing.prepare(HAND_FILTERS, sample_time)
        pose, rate, acceleration = (part[0] for part in coordinates_of(motion(np.array([self._start]))))
        self._target, self._filter = pose, (pose, rate, acceleration)
        self._states = [self._filter]  # by sample since the start
        self._take_rows(samples[0])
        self.centre: FloatArray = np.hstack(motion(np.zeros(1))[:2])[0]  # its first pose

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        return self.foreseen(np.asarray(time, dtype=float), 0.0)

    def foreseen(self, samples: FloatArray, ahead: float) -> Motion:
        """What is known at the times of samples (n,) [s] of the motion some time [s] later."""
        times, by_hand = samples + ahead, samples >= self._start - ROUNDING
        before = np.minimum(np.where(by_hand, self._start, times), self._motion.defined_until)
        motion = Motion(*(np.array(part) for part in self._motion(before)))
        if not by_hand.any():
            return motion
        since = np.floor((samples[by_hand] + ROUNDING) / self._period).astype(int) - self._samples[0]
        while len(self._states) <= since.max():
            self._take_rows(self._samples[0] + len(self._states))
            self._filter, _ = Smoothing.step(self._coefficients, self._filter, (self._target,))
            self._states.append(self._filter)
        pose, rate, acceleration = (np.array([self._states[k][part] for k in since.tolist()]) for part in range(3))
        h = (times[by_hand] - (since + self._samples[0]) * self._period)[:, None]
        later = motion_of(pose + h * rate + h * h / 2 * acceleration, rate + h * acceleration, acceleration)
        for whole, part in zip(motion, later, strict=True):
            whole[by_hand] = part
        return motion

    def _take_rows(self, sample: int) -> None:
        """Let the targets of a sample hold; those that jump move the filter as far."""
        first, last = bisect_left(self._samples, sample), bisect_right(self._samples, sample)
        for _, target, jumps in self._rows[first:last]:
            if jumps:
                value, rate, acceleration = self._filter
                self._filter = value + (target - self._target), rate, acceleration
            self._target = target

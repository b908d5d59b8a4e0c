"""A limited filter of poses given by hand: what a loop can follow, with its rates and accelerations."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from gough_stewart.harness.control.component import Signals, Stepped
from gough_stewart.harness.quantities import Frequency, PositiveNumber
from gough_stewart.harness.section import TableSection
from gough_stewart.model.operations import clip


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

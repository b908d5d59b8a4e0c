"""Sensors: what is measured of the signals, with noise and quantisation; the same seed, the same numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True)
class Sensors:
    """Per signal: standard deviation of white noise, and the step of quantisation, in the signal's unit.

    measured = q · round((true + σ N(0, 1)) / q), each reading and element anew. Readings are taken when the controller
    samples; with a `sample_time` [s] of their own, at its multiples, and the controller has the latest one.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    quantisation: Mapping[str, float] = field(default_factory=dict)
    sample_time: float | None = None
    seed: int = 0


class Readings:
    """The sensors in a run of n readings."""

    def __init__(self, sensors: Sensors, n: int) -> None:
        self._noise = np.zeros((n, signals.SIZE))
        for index, (variable, part) in enumerate(zip(signals.VARIABLES, _parts(), strict=True)):
            deviation = sensors.noise.get(variable.name, 0.0)
            if deviation > 0:
                # a stream for each signal: noise on one leaves the noise on the others as it was
                stream = np.random.default_rng([sensors.seed, index])
                self._noise[:, part] = deviation * stream.standard_normal((n, variable.size))
        self._steps = [
            (part, sensors.quantisation[variable.name])
            for variable, part in zip(signals.VARIABLES, _parts(), strict=True)
            if sensors.quantisation.get(variable.name)
        ]

    def __call__(self, k: int, true: FloatArray) -> FloatArray:
        """All signals as measured at reading k (24,)."""
        measured: FloatArray = true + self._noise[k]
        for part, step in self._steps:
            measured[part] = step * np.rint(measured[part] / step)
        return measured


class Encoders:
    """Readings at the controller's samples, or every so many plant steps, of which the controller has the latest.

    Parameters
    ----------
    every
        Plant steps from reading to reading; None for readings at the samples.
    n
        How many readings there will be.
    """

    def __init__(self, sensors: Sensors, every: int | None, n: int) -> None:
        self._every, self._readings = every, Readings(sensors, n)
        self._taken = 0
        self._latest: FloatArray = np.zeros(signals.SIZE)

    def __call__(self, k: int, now: FloatArray, is_sample: bool) -> FloatArray:
        """The latest reading at a row, of the signals (24,) that are there now."""
        if is_sample if self._every is None else k % self._every == 0:
            self._latest = self._readings(self._taken, now)
            self._taken += 1
        return self._latest


def _parts() -> list[slice]:
    ends = np.cumsum([v.size for v in signals.VARIABLES])
    return [slice(int(end) - v.size, int(end)) for v, end in zip(signals.VARIABLES, ends, strict=True)]

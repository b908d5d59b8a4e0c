"""The sensors in a run: what is read, with noise that is reproducible from the seed, and when."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gough_stewart.harness.control.faults import Freeze, NoCoefficients
from gough_stewart.harness.control.sensor import Sensor, SensorCoefficients
from gough_stewart.harness.loop.noise import standard_normal, streams_of
from gough_stewart.harness.loop.seeds import Seeds
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray

# Number of readings per block in which noise is drawn; the numbers do not depend on it.
_BLOCK = 64


@dataclass(frozen=True)
class Sensors:
    """Per signal: standard deviation of white noise, and quantisation step, in the signal's unit.

    measured = q · round((true + σ N(0, 1)) / q), independently for each reading and element. Readings are taken at the
    controller's samples; with a separate `sample_time` [s], at its multiples, and the controller uses the latest one.
    For many members σ and q may be arrays (N,), 0 where a member has none, with one seed for each.
    """

    noise: Mapping[str, PerMember] = field(default_factory=dict)
    quantisation: Mapping[str, PerMember] = field(default_factory=dict)
    sample_time: float | None = None
    seed: Seeds = 0
    side: signals.Side = "leg"  # of legs that give, where lengths and velocities are read


class Readings:
    """The sensors of N members in a run; internal arrays are (24, N)."""

    def __init__(self, sensors: Sensors, members: int = 1) -> None:
        made = {name: _sensor(sensors, name) for name in signals.NAMES}
        self._sensors = {name: sensor for name, sensor in made.items() if sensor is not None}
        self._measured = np.zeros((signals.SIZE, members))
        self._of_members = self._measured.T
        self.only(signals.NAMES)

    def only(self, names: Iterable[str]) -> None:
        """Read only these signals from now on, to save time."""
        read = list(names)
        plain = [name for name in read if name not in self._sensors]
        # views are made in advance: making one takes Python as long as the arithmetic
        self._exact = [(part, self._measured[part]) for part in _joined([_PARTS[name] for name in plain])]
        self._sensed = [
            (_PARTS[name], self._measured[_PARTS[name]], *sensor)
            for name, sensor in self._sensors.items()
            if name in read
        ]

    def __call__(self, k: int, true: FloatArray) -> FloatArray:
        """All signals measured at reading k (N, 24), valid until the next call."""
        columns = true.T
        for part, exact in self._exact:
            exact[...] = columns[part]
        for part, sensed, coefficients, noise in self._sensed:
            inputs = columns[part], None if noise is None else noise(k)
            _, (sensed[...],) = Sensor.step(coefficients, (), inputs)
        return self._of_members


class Encoders:
    """Readings at the controller's samples, or every n-th plant step; the controller uses the latest.

    Parameters
    ----------
    every
        Plant steps between readings; None for readings at the samples.
    frozen
        Flags (N, 24), changed by others, of what stays as the member's last reading was; None if nothing can.
    """

    def __init__(self, sensors: Sensors, every: int | None, members: int = 1, frozen: FloatArray | None = None) -> None:
        self._frozen = frozen
        self._last: FloatArray | None = None
        self._every, self._readings = every, Readings(sensors, members)
        self._latest: FloatArray = np.zeros((members, signals.SIZE))
        self.only = self._readings.only

    def __call__(self, k: int, now: FloatArray, sample: int | None, due: BoolArray | None = None) -> FloatArray:
        """The latest reading at a row, from the present signals (N, 24); None if no member is sampled.

        With own clocks of members, `due` (N,) are those whose sample this is.
        """
        if self._every is None:
            if sample is not None:
                self._latest = self._with_faults(self._readings(sample, now), due)
        elif k % self._every == 0:
            self._latest = self._with_faults(self._readings(k // self._every, now), None)
        return self._latest

    def _with_faults(self, reading: FloatArray, due: BoolArray | None) -> FloatArray:
        """The reading, but of frozen sensors the last one; a sensor that is frozen from the start has its first."""
        if self._frozen is None:
            return reading
        if self._last is None:
            self._last = reading.copy()
        found: FloatArray
        _, (found,) = Freeze.step(NoCoefficients(), (), (reading, self._last, self._frozen))
        np.copyto(self._last, found, where=True if due is None else due[:, None])
        return found


class _Noise:
    """White noise of one signal (size, N), or (size, 1) common to all members."""

    def __init__(self, sensors: Sensors, name: str) -> None:
        self._streams, self._deviation = streams_of(sensors.seed), sensors.noise[name]
        at = signals.positions([name])
        self._elements = range(int(at[0]), int(at[-1]) + 1)
        self._scaled: FloatArray = np.zeros((0, 0, 0))
        self._block = -1

    def __call__(self, k: int) -> FloatArray:
        """Noise of reading k."""
        block, row = divmod(k, _BLOCK)
        if block != self._block:
            readings = range(block * _BLOCK, (block + 1) * _BLOCK)
            self._scaled = standard_normal(self._streams, readings, self._elements) * self._deviation
            self._block = block
        noise: FloatArray = self._scaled[row]
        return noise


def deviations_of(sensors: Sensors, names: Iterable[str]) -> dict[str, PerMember]:
    """The standard deviations of those of some signals that have any noise."""
    return {name: sensors.noise[name] for name in names if _has_noise(sensors, name)}


def _has_noise(sensors: Sensors, name: str) -> bool:
    return bool(np.any(np.asarray(sensors.noise.get(name, 0.0)) > 0))


def _sensor(sensors: Sensors, name: str) -> tuple[SensorCoefficients, "_Noise | None"] | None:
    """The coefficients and the noise of a signal's sensor; None for an ideal one."""
    noise = _Noise(sensors, name) if _has_noise(sensors, name) else None
    step = np.asarray(sensors.quantisation.get(name, 0.0), dtype=float)
    coefficients = Sensor.without_idle(Sensor.prepare({"quantisation": step}))
    return None if noise is None and coefficients.step is None else (coefficients, noise)


def _parts() -> dict[str, slice]:
    ends = np.cumsum([v.size for v in signals.VARIABLES])
    return {v.name: slice(int(end) - v.size, int(end)) for v, end in zip(signals.VARIABLES, ends, strict=True)}


def _joined(parts: list[slice]) -> list[slice]:
    """The same elements in as few slices as possible."""
    found: list[slice] = []
    for part in sorted(parts, key=lambda each: each.start):
        if found and found[-1].stop == part.start:
            part = slice(found.pop().start, part.stop)  # noqa: PLW2901 - grown by the one before
        found.append(part)
    return found


_PARTS = _parts()

"""Sensors: what is measured of the signals, with noise and quantisation; the same seed, the same numbers."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gough_stewart.harness.loop.seeds import Seeds, stream
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.model.vectors import FloatArray

# So many readings of many members have their noise drawn at a time.
_BLOCK = 64


@dataclass(frozen=True)
class Sensors:
    """Per signal: standard deviation of white noise, and the step of quantisation, in the signal's unit.

    measured = q · round((true + σ N(0, 1)) / q), each reading and element anew. Readings are taken when the controller
    samples; with a `sample_time` [s] of their own, at its multiples, and the controller has the latest one. Of many
    members σ and q may be arrays (N,), 0 where there is none, and the seed one of each.
    """

    noise: Mapping[str, PerMember] = field(default_factory=dict)
    quantisation: Mapping[str, PerMember] = field(default_factory=dict)
    sample_time: float | None = None
    seed: Seeds = 0


class Readings:
    """The sensors in a run of n readings; inside, arrays are (24,) or (24, N)."""

    def __init__(self, sensors: Sensors, n: int, shape: tuple[int, ...] = ()) -> None:
        # a stream for each signal: noise on one leaves the noise on the others as it was
        self._noise = {
            name: _Noise(sensors, name, n, shape)
            for name in signals.NAMES
            if np.any(np.asarray(sensors.noise.get(name, 0.0)) > 0)
        }
        self._steps = {name: step for name in signals.NAMES if np.any(step := sensors.quantisation.get(name, 0.0))}
        self._measured = np.zeros((signals.SIZE, *shape))
        self.only(signals.NAMES)

    def only(self, names: Iterable[str]) -> None:
        """Read these signals alone from here on: of many members the others would cost time that nobody uses."""
        many = self._measured.ndim > 1
        read = list(names) if many else list(signals.NAMES)
        self._exact = _joined([_PARTS[name] for name in read if name not in self._steps or name in self._noise])
        self._noisy = [(_PARTS[name], noise) for name, noise in self._noise.items() if name in read]
        self._stepped = [
            (part := _PARTS[name], _Steps(step, None if many else part.stop - part.start), name in self._noise)
            for name, step in self._steps.items()
            if name in read
        ]

    def __call__(self, k: int, true: FloatArray) -> FloatArray:
        """All signals as measured at reading k (*shape, 24); of many members valid until the next call."""
        columns = true.T
        if columns.ndim == 1:
            measured = columns + self._measured  # zeros
        else:
            measured = self._measured
            for part in self._exact:
                np.copyto(measured[part], columns[part])
        for part, noise in self._noisy:
            measured[part] += noise(k)
        for part, steps, is_noisy in self._stepped:
            steps.round((measured if is_noisy else columns)[part], measured[part])
        return measured.T


class _Steps:
    """q · round(x / q), x itself where q is 0."""

    def __init__(self, step: PerMember, size: int | None) -> None:
        self._none = np.asarray(step) == 0
        self._some_have_none = bool(self._none.any())
        self._step = np.where(self._none, 1.0, step) if self._some_have_none else step
        if size is not None:
            self._step = np.full(size, step)  # which NumPy takes in half the time

    def round(self, exact: FloatArray, out: FloatArray) -> None:
        """Into `out`, which may be `exact` itself."""
        kept = exact.copy() if self._some_have_none else None
        np.divide(exact, self._step, out)
        np.rint(out, out)
        np.multiply(out, self._step, out)
        if kept is not None:
            np.copyto(out, kept, where=self._none)


class Encoders:
    """Readings at the controller's samples, or every so many plant steps, of which the controller has the latest.

    Parameters
    ----------
    every
        Plant steps from reading to reading; None for readings at the samples.
    n
        How many readings there will be.
    """

    def __init__(self, sensors: Sensors, every: int | None, n: int, shape: tuple[int, ...] = ()) -> None:
        self._every, self._readings = every, Readings(sensors, n, shape)
        self._latest: FloatArray = np.zeros(signals.SIZE)
        self.only = self._readings.only

    def __call__(self, k: int, now: FloatArray, sample: int | None) -> FloatArray:
        """The latest reading at a row, of the signals (*shape, 24) that are there now; None where nobody samples."""
        if self._every is None:
            if sample is not None:
                self._latest = self._readings(sample, now)
        elif k % self._every == 0:
            self._latest = self._readings(k // self._every, now)
        return self._latest


class _Noise:
    """White noise of one signal, as elements side by side: (size,), or of many members (size, N)."""

    def __init__(self, sensors: Sensors, name: str, n: int, shape: tuple[int, ...]) -> None:
        purpose = signals.NAMES.index(name)
        seeds = sensors.seed if isinstance(sensors.seed, tuple) else (sensors.seed,)
        self._streams = [stream(seed, purpose) for seed in seeds]
        self._deviation = sensors.noise[name]
        self._rows = min(n, _BLOCK) if shape else n
        axis = (len(seeds),) if shape else ()
        self._normal = np.zeros((self._rows, signals.VARIABLES[purpose].size, *axis))
        self._drawn: tuple[int, FloatArray] = (-1, self._normal)

    def __call__(self, k: int) -> FloatArray:
        """Of reading k; readings go on by one, or stay."""
        block, row = divmod(k, self._rows)
        if block != self._drawn[0]:
            rows, size = self._normal.shape[:2]
            for member, each in enumerate(self._streams):
                self._normal.reshape(rows, size, -1)[:, :, member] = each.standard_normal((rows, size))
            self._drawn = block, self._deviation * self._normal
        noise: FloatArray = self._drawn[1][row]
        return noise


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

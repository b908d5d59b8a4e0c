"""Signals of many runs over time, as quantiles, sampled during the runs without keeping records."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.loop.observing import Row
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

# Quantiles are exact, over at most this many members: the first ones.
MOST_MEMBERS = 10_000
MOST_TIMES = 200
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = tuple(f"q{round(100 * level):02d}" for level in LEVELS)
DEFAULT = ("position", "orientation", "error.position.norm", "error.orientation.norm", "actuator_force")
_ERRORS = {"position": slice(0, 3), "orientation": slice(3, 6), "leg_length": slice(12, 18)}
NAMES = (
    *signals.NAMES,
    "actuator_force",
    *(f"error.{name}" for name in _ERRORS),
    "error.position.norm",
    "error.orientation.norm",
)


class BandSamples(NamedTuple):
    """The samples from which the bands of some members are computed."""

    time: FloatArray  # (T,) [s]
    columns: tuple[str, ...]  # C names of scalars
    values: FloatArray  # (T, C, n) of the members counted in quantiles; NaN after a member has ended
    lowest: FloatArray  # (T, C) of all members; NaN after all have ended
    highest: FloatArray  # (T, C)
    running: NDArray[np.intp]  # (T,), number of members still running


class Bands:
    """A loop observer that samples signals of all members at some times.

    Parameters
    ----------
    names
        Names out of `NAMES`: signals, forces, and errors (reference − actual); `.norm` is the Euclidean norm.
    members
        Number of members; 1 for a loop without leading axes.
    first
        Number of the first member; quantiles use only members below `MOST_MEMBERS`.
    times
        Largest number of sample times, from the first row to the last.

    Raises
    ------
    RecordError
        A name is not in `NAMES`.
    """

    def __init__(
        self, names: Sequence[str], timing: Timing, members: int = 1, first: int = 0, times: int = MOST_TIMES
    ) -> None:
        for name in names:
            if name not in NAMES:
                raise RecordError(f"no signal '{name}' for bands{interface.nearest(name, NAMES)}")
        self._names, self._members = tuple(names), members
        rows = np.unique(np.linspace(0, timing.steps, min(times, timing.steps + 1)).round().astype(int))
        self._at = {row: k for k, row in enumerate(rows.tolist())}
        self._time = timing.times[rows]
        self.columns = tuple(column for name in self._names for column in _columns(name))
        size = (len(rows), len(self.columns))
        self._values = np.full((*size, min(members, max(MOST_MEMBERS - first, 0))), np.nan)
        self._lowest, self._highest = np.full(size, np.nan), np.full(size, np.nan)
        self._running = np.zeros(len(rows), dtype=np.intp)

    def row(self, row: Row) -> None:
        """Sample the signals if this row is a sample time."""
        k = self._at.get(row.k)
        if k is None:
            return
        running = np.atleast_1d(row.running)
        values = np.concatenate([_values(name, row) for name in self._names])
        values = np.where(running & np.isfinite(values), values, np.nan)
        self._values[k] = values[:, : self._values.shape[2]]
        self._lowest[k], self._highest[k] = np.fmin.reduce(values, axis=1), np.fmax.reduce(values, axis=1)
        self._running[k] = np.count_nonzero(running)

    def samples(self) -> BandSamples:
        """The samples so far."""
        return BandSamples(self._time, self.columns, self._values, self._lowest, self._highest, self._running)


def together(parts: Iterable[BandSamples]) -> BandSamples:
    """Join the samples of chunks, in order, to those of all members."""
    parts = list(parts)
    first = parts[0]
    return BandSamples(
        first.time,
        first.columns,
        np.concatenate([part.values for part in parts], axis=2)[..., :MOST_MEMBERS],
        np.fmin.reduce([part.lowest for part in parts]),
        np.fmax.reduce([part.highest for part in parts]),
        np.sum([part.running for part in parts], axis=0),
    )


def bands_frame(samples: BandSamples) -> polars.DataFrame:
    """One row per time and signal: `time`, `signal`, `running` members, `lowest`, the quantiles, `highest`.

    Quantiles are over the members still running, interpolated linearly between members (NumPy's default).
    """
    t, c = samples.lowest.shape
    quantiles = _quantiles(samples.values)
    columns = {
        "time": np.repeat(samples.time, c),
        "signal": list(samples.columns) * t,
        "running": np.repeat(samples.running, c),
        "lowest": samples.lowest.ravel(),
        **{name: quantile.ravel() for name, quantile in zip(QUANTILES, quantiles, strict=True)},
        "highest": samples.highest.ravel(),
    }
    return polars.DataFrame(columns, nan_to_null=True)


def _quantiles(values: FloatArray) -> FloatArray:
    """Quantiles (levels, T, C) of values (T, C, n) without NaN; one time after another, to avoid a second copy."""
    found = np.full((len(LEVELS), *values.shape[:2]), np.nan)
    for k, at in enumerate(values):
        # NaN, of members that have ended, sorts last
        order = np.sort(at, axis=1)
        counts = np.count_nonzero(np.isfinite(order), axis=1)
        for column, count in enumerate(counts.tolist()):
            if count:
                found[:, k, column] = np.quantile(order[column, :count], LEVELS)
    return found


def _columns(name: str) -> list[str]:
    if name.endswith(".norm"):
        return [name]
    prefix, _, variable = name.rpartition(".")
    return [f"{prefix}.{column}" if prefix else column for column in interface.BY_NAME[variable].scalar_names]


def _values(name: str, row: Row) -> FloatArray:
    """The signal (size, N) of a name at a row."""
    if name == "actuator_force":
        return np.atleast_2d(row.inputs)[:, :6].T
    now = np.atleast_2d(row.signals).T
    if not name.startswith("error."):
        return now[signals.positions([name])]
    part = _ERRORS[name.removeprefix("error.").removesuffix(".norm")]
    if row.reference is None:
        return np.full((1 if name.endswith(".norm") else part.stop - part.start, now.shape[1]), np.nan)
    error = np.atleast_2d(row.reference).T[part] - now[part]
    return np.sqrt((error * error).sum(axis=0, keepdims=True)) if name.endswith(".norm") else error

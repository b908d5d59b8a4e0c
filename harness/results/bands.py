"""Signals of many runs over time, as quantiles, sampled during the runs without keeping records."""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.loop.folds import ERRORS, Block, Fold, State
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.model.interface import BY_NAME, nearest
from gough_stewart.model.vectors import FloatArray

# Quantiles are exact, over at most this many members: the first ones.
MOST_MEMBERS = 10_000
MOST_TIMES = 200
# Members whose signals are kept, the first ones, and at how many times.
MOST_KEPT, TIMES_KEPT = 1000, 101
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
QUANTILES = tuple(f"q{round(100 * level):02d}" for level in LEVELS)
DEFAULT = ("position", "orientation", "error.position.norm", "error.orientation.norm", "actuator_force")
NAMES = (
    *signals.NAMES,
    "actuator_force",
    *ERRORS,
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


class Bands(Fold):
    """A fold that samples signals of all members at some times.

    Parameters
    ----------
    names
        Names out of `NAMES`: signals, forces, and errors (reference − actual); `.norm` is the Euclidean norm.
    members
        Number of members: the first ones of those that run.
    first
        Number of the first member; quantiles use only members below `MOST_MEMBERS`.
    times
        Largest number of sample times, from the first row to the last.

    Raises
    ------
    RecordError
        A name is not in `NAMES`.
    """

    keeps_ended = False

    def __init__(
        self, names: Sequence[str], timing: Timing, members: int = 1, first: int = 0, times: int = MOST_TIMES
    ) -> None:
        for name in names:
            if name not in NAMES:
                raise RecordError(f"no signal '{name}' for bands{nearest(name, NAMES)}")
        self._names, self._members = tuple(names), members
        self.needs = tuple(dict.fromkeys(name.removesuffix(".norm") for name in names))
        self._rows = np.unique(np.linspace(0, timing.steps, min(times, timing.steps + 1)).round().astype(int))
        self._time = timing.times[self._rows]
        of_names = [_columns(name) for name in self._names]
        self.columns = tuple(column for each in of_names for column in each)
        ends = np.cumsum([0, *map(len, of_names)]).tolist()
        self._at = {name: slice(*each) for name, each in zip(self._names, pairwise(ends), strict=True)}
        size = (len(self._rows), len(self.columns))
        self._values = np.full((*size, min(members, max(MOST_MEMBERS - first, 0))), np.nan)
        self._lowest, self._highest = np.full(size, np.nan), np.full(size, np.nan)
        self._running = np.zeros(len(self._rows), dtype=np.intp)

    def rows(self, _state: State, block: Block) -> None:
        """Sample the signals at the sample times in a block, of members that have not ended."""
        running, n = block.running[: self._members], self._values.shape[2]
        first, last = np.searchsorted(self._rows, (block.first, block.first + block.rows))
        rows = self._rows[first:last] - block.first
        if not len(rows):
            return
        values = np.empty((len(rows), len(self.columns), self._members))
        for name, at in self._at.items():
            values[:, at] = _values(name, block, rows)[..., : self._members]
        values[~np.isfinite(values)] = np.nan
        values[..., ~running] = np.nan
        here = slice(first, last)
        self._values[here] = values[..., :n]
        self._lowest[here], self._highest[here] = np.fmin.reduce(values, axis=2), np.fmax.reduce(values, axis=2)
        self._running[here] = np.count_nonzero(running)

    def samples(self) -> BandSamples:
        """The samples so far."""
        return BandSamples(self._time, self.columns, self._values, self._lowest, self._highest, self._running)


def joined_samples(parts: Iterable[BandSamples]) -> BandSamples:
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


def samples_frame(samples: BandSamples, members: Sequence[int]) -> polars.DataFrame:
    """One row per member and time of the first members: `member`, `time` and the signals, with seven digits.

    `members` are the numbers of those that ran, in the order of the samples.
    """
    t, columns, n = samples.values.shape
    n = min(n, MOST_KEPT)
    rows = np.unique(np.linspace(0, t - 1, min(t, TIMES_KEPT)).round().astype(int))
    values = samples.values[rows][..., :n].transpose(2, 0, 1).reshape(-1, columns).astype(np.float32)
    frame = {
        "member": np.repeat(np.asarray(members[:n], dtype=np.int64), len(rows)),
        "time": np.tile(samples.time[rows], n),
        **{name: values[:, k] for k, name in enumerate(samples.columns)},
    }
    return polars.DataFrame(frame, nan_to_null=True)


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
    return [f"{prefix}.{column}" if prefix else column for column in BY_NAME[variable].scalar_names]


def _values(name: str, block: Block, rows: NDArray[np.intp]) -> FloatArray:
    """The signal (rows, size, N) of a name at some rows of a block."""
    column = name.removesuffix(".norm")
    if column not in block:
        return np.full((1, 1, 1), np.nan)
    values: FloatArray = block.of_rows(rows, column)
    return values if column == name else np.sqrt((values * values).sum(axis=1, keepdims=True))

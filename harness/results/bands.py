"""Signals of many runs over time, as quantiles, sampled during the runs without keeping records."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.loop.folds import ERRORS, ROW, KeptRows, State
from gough_stewart.harness.loop.loop import Timing
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
NAMES = (*signals.NAMES, "actuator_force", *ERRORS, "error.position.norm", "error.orientation.norm")


class BandSamples(NamedTuple):
    """The samples from which the bands of some members are computed."""

    time: FloatArray  # (T,) [s]
    columns: tuple[str, ...]  # C names of scalars
    values: FloatArray  # (T, C, n) of the members counted in quantiles; NaN after a member has ended
    lowest: FloatArray  # (T, C) of all members; NaN after all have ended
    highest: FloatArray  # (T, C)
    running: NDArray[np.intp]  # (T,), number of members still running


class Bands(KeptRows):
    """A fold that samples signals of all members at some times, from the first row to the last.

    Names are out of `NAMES`: signals, forces, and errors (reference − actual); `.norm` is the Euclidean norm. The first
    `members` of those that run are sampled, and numbered from `first` on: quantiles use those below `MOST_MEMBERS`.
    """

    def __init__(
        self, names: Sequence[str], timing: Timing, members: int = 1, first: int = 0, times: int = MOST_TIMES
    ) -> None:
        for name in names:
            if name not in NAMES:
                raise RecordError(f"no signal '{name}' for bands{nearest(name, NAMES)}")
        self._names, self._members = tuple(names), members
        self.needs = tuple(dict.fromkeys(name.removesuffix(".norm") for name in names))
        self.at = np.unique(np.linspace(0, timing.steps, min(times, timing.steps + 1)).round().astype(np.intp))
        self._time = timing.times[self.at]
        columns, ends = list[str](), [0]
        for name in self._names:
            prefix, dot, variable = name.rpartition(".")
            columns += [name] if variable == "norm" else [prefix + dot + s for s in BY_NAME[variable].scalar_names]
            ends.append(len(columns))
        self.columns = tuple(columns)
        self._places = {name: slice(*span) for name, span in zip(self._names, pairwise(ends), strict=True)}
        self._counted = min(members, max(MOST_MEMBERS - first, 0))
        self.start(0)
        self.result({}, np.zeros(0, np.intp))

    def start(self, members: int) -> State:
        """No samples; columns are kept where they belong, and those of norms beside them."""
        self._values: FloatArray = np.zeros((len(self.at), len(self.columns), members))
        columns = {name: self._values[:, at] for name, at in self._places.items() if not name.endswith(".norm")}
        only_in_norms = [name for name in self.needs if name not in columns]
        sizes = {name: ROW[name].stop - ROW[name].start for name in only_in_norms}
        self.kept = columns | {name: np.zeros((len(self.at), size, members)) for name, size in sizes.items()}
        return {}

    def result(self, _state: State, rows: NDArray[np.intp]) -> dict[str, FloatArray]:
        """No metrics; `samples` has what was kept, of members with these numbers of rows."""
        for name in self._names:
            if name.endswith(".norm"):
                vectors = self.kept[name.removesuffix(".norm")]
                self._values[:, self._places[name]] = np.sqrt((vectors * vectors).sum(axis=1, keepdims=True))
        values, runs = self._values[..., : self._members], self.at[:, None] < rows[: self._members]
        # one time after the other: few numbers fit into the processor's cache
        for sampled, is_running in zip(values, runs, strict=True):
            np.copyto(sampled, np.nan, where=~(np.isfinite(sampled) & is_running))
        lowest, highest = (np.full(self._values.shape[:2], np.nan) for _ in range(2))
        if values.size:
            np.fmin.reduce(values, axis=2, out=lowest)
            np.fmax.reduce(values, axis=2, out=highest)
        counted, running = self._values[..., : self._counted], np.count_nonzero(runs, axis=1)
        self.samples = BandSamples(self._time, self.columns, counted, lowest, highest, running)
        return {}


def band_tables(chunks: Sequence[BandSamples], members: Sequence[int]) -> tuple[polars.DataFrame, polars.DataFrame]:
    """The bands of all members from the samples of chunks, in order, and what is kept of the first members' signals.

    - Bands have one row per time and signal: `time`, `signal`, `running` members, `lowest`, the quantiles, `highest`.
      Quantiles are over the members still running, interpolated linearly between members (NumPy's default).
    - Samples have one row per member and time: `member`, `time` and the signals, with seven digits. `members` are the
      numbers of those that ran, in the order of the samples.
    """
    time, signals_sampled = chunks[0].time, chunks[0].columns
    sampled = np.concatenate([chunk.values for chunk in chunks], axis=2)[..., :MOST_MEMBERS]
    t, c, n = sampled.shape

    # one time after another, to avoid a second copy
    quantiles = np.full((len(LEVELS), t, c), np.nan)
    for k, values in enumerate(sampled):
        # NaN, of members that have ended, sorts last
        order = np.sort(values, axis=1)
        counts = np.count_nonzero(np.isfinite(order), axis=1)
        for count in set(counts.tolist()) - {0}:
            signals_of_count = counts == count
            quantiles[:, k, signals_of_count] = np.quantile(order[signals_of_count, :count], LEVELS, axis=1)
    bands = {
        "time": np.repeat(time, c),
        "signal": list(signals_sampled) * t,
        "running": np.repeat(np.sum([chunk.running for chunk in chunks], axis=0), c),
        "lowest": np.fmin.reduce([chunk.lowest for chunk in chunks]).ravel(),
        **{name: quantile.ravel() for name, quantile in zip(QUANTILES, quantiles, strict=True)},
        "highest": np.fmax.reduce([chunk.highest for chunk in chunks]).ravel(),
    }

    # of the first members at few times
    n = min(n, MOST_KEPT)
    rows = np.unique(np.linspace(0, t - 1, min(t, TIMES_KEPT)).round().astype(int))
    kept = sampled[rows][..., :n].transpose(2, 0, 1).reshape(-1, c).astype(np.float32)
    samples = {
        "member": np.repeat(np.asarray(members[:n], dtype=np.int64), len(rows)),
        "time": np.tile(time[rows], n),
        **{name: kept[:, k] for k, name in enumerate(signals_sampled)},
    }
    return polars.DataFrame(bands, nan_to_null=True), polars.DataFrame(samples, nan_to_null=True)

"""Members whose loops oscillate or grow by themselves, judged by their rows as `run` judges a record."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import ceil
from typing import Any

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.ensemble.columns import AMPLITUDE, FREQUENCY, GROWING, OSCILLATING, OSCILLATION
from gough_stewart.harness.experiment.batch import Batch
from gough_stewart.harness.experiment.run import acting_columns
from gough_stewart.harness.loop.folds import KeptRows, State
from gough_stewart.harness.loop.loop import LENGTHS
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.loop.run import samples_of_rows
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.oscillation import (
    LegRows,
    Oscillation,
    least_amplitude,
    may_move,
    rest_begins,
    self_excited,
)
from gough_stewart.model.vectors import FloatArray

# Rows that are kept of each member: 100 kB, 50 MB in a chunk.
MOST_ROWS = 2048
# Members that a thread looks at in one go.
_TOGETHER = 64


class LegErrors(KeptRows):
    """Keeps the errors of the leg lengths (rows, 6, N), of every row or of each so-many-th."""

    needs = ("error.leg_length",)

    def __init__(self, timing: Timing) -> None:
        self.every = ceil((timing.steps + 1) / MOST_ROWS)
        self.at = np.arange(0, timing.steps + 1, self.every)
        self.time = timing.times[:: self.every]

    @property
    def errors(self) -> FloatArray:
        """What is kept (rows, 6, N)."""
        return self.kept[self.needs[0]]

    def start(self, members: int) -> State:
        """None by member: whoever reads the errors knows who has ended."""
        self.kept = {self.needs[0]: np.zeros((len(self.at), 6, members))}
        return {}


def oscillations(
    batch: Batch, outcomes: Sequence[Outcome], kept: LegErrors, threads: int = 1
) -> list[Oscillation | None]:
    """The motion by itself of each member that completed; None for a sound loop.

    Rows that are left out of long runs make fast oscillations look slower, so that `frequency` is then None.
    """
    completed = [k for k, outcome in enumerate(outcomes) if outcome.status == "completed"]
    found: list[Oscillation | None] = [None] * len(batch)
    for k, reference, begins in _candidates(batch, completed, kept, threads):
        prepared, error = batch.member(k), kept.errors[:, :, k].copy()
        sensors, length = prepared.loop.sensors, float(np.mean(reference - error))
        explained = _one(sensors.noise), _one(sensors.quantisation)
        least = least_amplitude(length, prepared.platform.platform_points, *explained)
        found[k] = self_excited(LegRows(kept.time, error, reference, begins, least))
    return found if kept.every == 1 else [each and each._replace(frequency=None) for each in found]


def oscillation_columns(found: Sequence[Oscillation | None]) -> dict[str, polars.Series]:
    """Kind, amplitude [m] and frequency [Hz] (N,); null for a sound loop."""
    kinds = [each and (GROWING if each.is_growing else OSCILLATING) for each in found]
    numbers = {
        AMPLITUDE: [each and each.amplitude for each in found],
        FREQUENCY: [each and each.frequency for each in found],
    }
    return {
        OSCILLATION: polars.Series(kinds, dtype=polars.String),
        **{name: polars.Series(values, dtype=polars.Float64) for name, values in numbers.items()},
    }


def _candidates(
    batch: Batch, members: Sequence[int], kept: LegErrors, threads: int
) -> Iterator[tuple[int, FloatArray, int]]:
    """Members that may oscillate or grow, the reference of their legs, and the kept row from which nothing acts.

    Those that share what acts on the loop are looked at together.
    """
    alike = dict[tuple[int | None, ...], list[int]]()
    for k in members:
        setup = batch.setups[k]
        if setup.planned is not None and setup.controller is not None:
            # changes are each machine's own, and with jitter the rows of an injection each member's
            own = k if setup.injection is not None and setup.timing.jitter else None
            key = id(setup.planned), int(batch.changes.of[k]), id(setup.injection), own
            alike.setdefault(key, []).append(k)
    for group in alike.values():
        prepared = batch.member(group[0])
        reference = prepared.loop.reference
        assert reference is not None
        reference = reference[:: kept.every, LENGTHS]
        acting = acting_columns(prepared, samples_of_rows(prepared.loop.timing))
        # up to the first kept row at or after it
        begins = ceil(rest_begins(values for _, values in acting) / kept.every)

        def may(part: list[int], reference: FloatArray = reference, begins: int = begins) -> NDArray[np.bool_]:
            # those of consecutive members without a copy
            at = slice(part[0], part[-1] + 1) if part[-1] - part[0] == len(part) - 1 else part
            return may_move(np.moveaxis(kept.errors[..., at], 1, 2), kept.time, reference, begins)

        parts = [group[k : k + _TOGETHER] for k in range(0, len(group), _TOGETHER)]
        with ThreadPoolExecutor(threads) as pool:
            for part, found in zip(parts, pool.map(may, parts), strict=True):
                yield from ((k, reference, begins) for k, is_one in zip(part, found.tolist(), strict=True) if is_one)


def _one(values: Any) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}

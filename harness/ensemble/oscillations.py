"""Members whose loops oscillate or grow by themselves, judged by their rows as `run` judges a record."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import ceil

import numpy as np
import polars

from gough_stewart.harness.ensemble.columns import AMPLITUDE, FREQUENCY, GROWING, OSCILLATING, OSCILLATION
from gough_stewart.harness.experiment.preparation import Batch
from gough_stewart.harness.experiment.run import acting_columns
from gough_stewart.harness.loop.folds import KeptRows, State
from gough_stewart.harness.loop.loop import LENGTHS
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.loop.run import samples_of_rows
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.results.oscillation import Oscillation, SelfExcitation, least_amplitude, rest_begins
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
    found: list[Oscillation | None] = [None] * len(batch)

    def judged(members: list[int], reference: FloatArray, judge: SelfExcitation) -> None:
        # those of consecutive members without a copy
        together = slice(members[0], members[-1] + 1) if members[-1] - members[0] == len(members) - 1 else members
        errors = kept.errors[..., together]
        for k in np.flatnonzero(~judge.sound_at_a_glance(errors)).tolist():
            member, error = members[k], np.ascontiguousarray(errors[..., k].T)
            sensors, platform = batch.sensors[member], batch.setups[member].platform
            length = float(np.mean(reference) - np.mean(error))
            least = least_amplitude(length, platform.platform_points, sensors.noise, sensors.quantisation)
            found[member] = judge(error, least)

    with ThreadPoolExecutor(threads) as pool:
        for members, reference, judge in _alike(batch, outcomes, kept):
            parts = [members[k : k + _TOGETHER] for k in range(0, len(members), _TOGETHER)]
            list(pool.map(lambda part, reference=reference, judge=judge: judged(part, reference, judge), parts))
    return found if kept.every == 1 else [motion and motion._replace(frequency=None) for motion in found]


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


def _alike(
    batch: Batch, outcomes: Sequence[Outcome], kept: LegErrors
) -> Iterator[tuple[list[int], FloatArray, SelfExcitation]]:
    """Members that completed and share what acts on them, their legs' reference at the kept rows, and their judge."""
    alike = dict[tuple[int | None, ...], list[int]]()
    for k, outcome in enumerate(outcomes):
        setup = batch.setups[k]
        if outcome.status == "completed" and setup.planned is not None and setup.controller is not None:
            # changes are each machine's own, and with jitter the rows of an injection each member's
            own = k if setup.injection is not None and setup.timing.jitter else None
            key = id(setup.planned), id(batch.changes[k]), id(setup.injection), own
            alike.setdefault(key, []).append(k)
    for members in alike.values():
        prepared = batch.member(members[0])
        assert prepared.loop.reference is not None
        reference = np.ascontiguousarray(prepared.loop.reference[:: kept.every, LENGTHS].T)
        acting = acting_columns(prepared, samples_of_rows(prepared.loop.timing))
        # up to the first kept row at or after it
        begin = ceil(rest_begins(values for _, values in acting) / kept.every)
        yield members, reference, SelfExcitation(kept.time, reference, begin)

"""A chunk of an ensemble: some members, prepared, run in parallel, and reduced."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from io import BytesIO
from math import ceil
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import polars

from gough_stewart.harness.control.laws_of_members import shared_by_members
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.errors import ControllerError, SharedMemoryError, UnstableLoopError
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.preparation import Batch, Prepared, one_or_each
from gough_stewart.harness.experiment.run import acting_columns
from gough_stewart.harness.loop.folds import Fold, KeptRows, State
from gough_stewart.harness.loop.loop import LENGTHS, Timing
from gough_stewart.harness.loop.rows import FoldsOfRows, Outcome
from gough_stewart.harness.loop.run import observe
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.results.bands import DEFAULT, Bands, BandSamples
from gough_stewart.harness.results.metric_folds import metric_folds, metric_kernels, metric_of
from gough_stewart.harness.results.oscillation import Oscillation, least_amplitude, rest_begins, self_excitation
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.parameters import LIMITS
from gough_stewart.model.vectors import FloatArray

# Members per chunk: enough to make Python's overhead small, few enough that two workers share a thousand evenly.
SIZE = 512
# Rows that are kept of each member: 100 kB, 50 MB in a chunk.
MOST_ROWS = 2048
# Members that a thread looks at in one go.
_TOGETHER = 64
_ENDINGS = {
    "outcome": polars.String,
    "ended": polars.Float64,
    "cause": polars.String,
    "oscillation": polars.String,
    "oscillation.amplitude": polars.Float64,
    "oscillation.frequency": polars.Float64,
}


class Chunk(NamedTuple):
    """The results kept of some members, as bytes on their way from a worker to files; the same for the same members."""

    rows: bytes  # Parquet, a row for each member; see `member_table`
    bands: bytes  # npz, also with the features, and a checksum of the rows
    features: str  # processor features of the machine code


class LegErrors(KeptRows):
    """Keeps the errors of the leg lengths (rows, 6, N), of every row or of each so-many-th."""

    needs = ("error.leg_length",)

    def __init__(self, timing: Timing) -> None:
        self.every = ceil((timing.steps + 1) / MOST_ROWS)
        self.at = np.arange(0, timing.steps + 1, self.every)
        self.time = timing.times[:: self.every]

    def start(self, members: int) -> State:
        """Room for all members: whoever reads the errors knows who has ended."""
        self.kept = {self.needs[0]: np.zeros((len(self.at), 6, members))}
        return {}


def chunk(members: Members, first: int, last: int, threads: int = 1) -> Chunk:
    """Run members first to last − 1: a pure function, with the same result on any machine and any number of threads.

    `GoughStewartError` if an error concerns all members, `SharedMemoryError` as of `reduced`.
    """
    draws = members.draws(first, last)
    batch = members.preparation.members(draws.values, range(first, last))
    outcomes, motions, features = list[Outcome](), list[Oscillation | None](), ""
    if not len(batch):
        columns, samples = results_of_nobody(members, first)
    else:
        signals = DEFAULT if members.choice.signals is None else members.choice.signals
        bands, errors = Bands(signals, batch.timing, len(batch), first), LegErrors(batch.timing)
        run = reduced(batch, members.stepping, threads, [bands, errors])
        columns, outcomes, samples, features = run.columns, list(run.outcomes), bands.samples, run.features
        if members.choice.margins:
            judged = margins_of([batch.member(k) for k in range(len(batch))])
            for k, cause in enumerate(judged.pop("cause")):
                outcomes[k] = outcomes[k]._replace(cause=outcomes[k].cause or cause)
            columns |= judged
        motions = oscillations(batch, outcomes, errors, threads)

    # one row per member, in order of their numbers; outcomes, motions and metrics are of those that ran
    n, ran, reasons = last - first, batch.numbers, batch.reasons
    endings: list[tuple[Any, ...]] = [("impossible", None, reasons.get(k), None, None, None) for k in range(n)]
    for k, outcome, motion in zip(ran[: len(outcomes)].tolist(), outcomes, motions, strict=True):
        kind = motion and ("growing" if motion.is_growing else "oscillating")
        size = (motion.amplitude, motion.frequency) if motion is not None else (None, None)
        endings[k] = (outcome.status, outcome.time, outcome.cause, kind, *size)
    table: dict[str, Any] = {"member": polars.Series(range(first, first + n), dtype=polars.Int64)}
    table |= {f"varied.{name}": polars.Series(values) for name, values in draws.columns.items()}
    table |= polars.DataFrame(endings, _ENDINGS, orient="row").to_dict()
    for name, values in columns.items():
        table[name] = np.full(n, np.nan)
        table[name][ran] = values
    rows, arrays = BytesIO(), BytesIO()
    polars.DataFrame(table, nan_to_null=True).write_parquet(rows, statistics=False)
    of_bands: dict[str, Any] = {**samples._asdict(), "columns": np.array(samples.columns, dtype=str)}
    np.savez(arrays, **of_bands, features=np.array(features), checksum=np.array(crc32(rows.getvalue())))
    return Chunk(rows.getvalue(), arrays.getvalue(), features)


class Reduced(NamedTuple):
    """A run of N members, reduced."""

    outcomes: tuple[Outcome, ...]  # N
    columns: dict[str, FloatArray]  # metrics, integration error and internal steps (N,)
    features: str  # processor features of the machine code


def reduced(
    batch: Batch,
    stepping: Stepping,
    threads: int = 1,
    folds: Sequence[Fold] = (),
    names: Sequence[str] | None = None,
    *,
    is_repeated: bool = False,
) -> Reduced:
    """Run members in parallel; `folds` keep more of their rows, `names` are the only metrics, to save time.

    Unless this `is_repeated`, the first member runs again if members may share the memory of its controller: other bits
    are a `SharedMemoryError`. What a function keeps from its first call on, and never changes, is not found.
    """
    n, running = len(batch), batch.in_parallel(stepping)
    times, limits = running.loop.timing.times, limits_of_members(batch, running.size)
    metrics = metric_folds(times, running.loop.reference, limits, wanted=names)
    rows = FoldsOfRows(running.loop, [*metrics, *folds], running.size, metric_kernels())
    with running.plant:
        outcomes = observe(
            running.plant, running.law_from, running.loop, rows, threads=threads, keeps_interrupted=False
        )
        columns = rows.results()
        for path, values in columns.items():
            if values.ndim > 1:  # of legs or axes the largest, or the least
                columns[path] = np.asarray(np.fmin.reduce(values) if metric_of(path).is_least else values.max(axis=0))
        columns = {path: values[:n] for path, values in columns.items()}
        columns["integration_error"] = running.plant.integration_error[:n]
        columns["internal_steps"] = running.plant.internal_steps[:n]
        run = Reduced(outcomes[:n], columns, running.plant.features)
    controller = None if is_repeated else shared_by_members(batch.setups[0].controller)
    if controller is not None:
        again = reduced(batch.take([0]), stepping, threads, names=names, is_repeated=True)
        differ = [
            name
            for name, values in again.columns.items()
            if not np.array_equal(values[:1], columns[name][:1], equal_nan=True)
        ]
        if differ or again.outcomes[0] != outcomes[0]:
            raise SharedMemoryError(
                f"the first member gave other results when it ran again ({', '.join(differ[:3]) or 'outcome'}): "
                f"{name_of(controller)} keeps memory, which all members share; use a factory: a class or function, "
                "called as make(platform, sample_time), that makes a controller for each member"
            )
    return run


def limits_of_members(batch: Batch, size: int) -> dict[str, Any]:
    """Limits of the nominal models, one number if they are all the same; of a size, with copies of the last one."""
    platforms = [batch.setups[min(k, len(batch) - 1)].platform for k in range(size)]
    stated = [row.name for row in LIMITS if getattr(platforms[0], row.name) is not None]
    return {name: one_or_each([getattr(platform, name) for platform in platforms]) for name in stated}


def margins_of(prepared: Sequence[Prepared]) -> dict[str, Any]:
    """For each member's machine with its controller: whether the linear loop is stable, and its disk margin.

    Also the causes (n,) of members whose margins cannot be computed, None of the others.
    """
    from gough_stewart.harness.experiment.margins import disk_of, judged

    stable, disk = np.full(len(prepared), np.nan), np.full(len(prepared), np.nan)
    causes: list[str | None] = [None] * len(prepared)
    for k, member in enumerate(prepared):
        try:
            form = member.linear_form()
        except ControllerError:  # the run says so
            continue
        if form is None:
            continue
        try:
            loop = None if form.doubt else judged(member, member.machine, form.controller, disk_of)
            if loop is None or loop.doubt:  # a number that cannot be determined is none
                causes[k] = f"no margins: {form.doubt if loop is None else loop.doubt}"
            else:
                stable[k], disk[k] = 1.0, loop.margins.alpha
        except UnstableLoopError:
            stable[k] = 0.0
        except (GoughStewartError, np.linalg.LinAlgError) as error:
            causes[k] = f"no margins: {error}"
    return {"margins.stable": stable, "margins.disk": disk, "cause": causes}


def metrics_of(batch: Batch) -> list[str]:
    """The paths of the metrics of runs."""
    loop = batch.member(0).loop
    folds = metric_folds(loop.timing.times, loop.reference, limits_of_members(batch, 1))
    return [*FoldsOfRows(loop, folds).results()]


def results_of_nobody(members: Members, first: int = 0) -> tuple[dict[str, FloatArray], BandSamples]:
    """The columns of metrics (0,) and the bands of an ensemble, of nobody; `RecordError` for an unknown signal."""
    try:
        batch = members.possible()
    except GoughStewartError:
        batch = members.preparation.members([{}], [None])
    of_margins = ["margins.stable", "margins.disk"] if members.choice.margins else []
    names = [*metrics_of(batch), "integration_error", "internal_steps", *of_margins]
    signals = DEFAULT if members.choice.signals is None else members.choice.signals
    return {name: np.zeros(0) for name in names}, Bands(signals, batch.member(0).loop.timing, 0, first).samples


def oscillations(
    batch: Batch, outcomes: Sequence[Outcome], kept: LegErrors, threads: int = 1
) -> list[Oscillation | None]:
    """The self-excited motion of each member that completed; None for a sound loop.

    Rows that are left out of long runs make fast oscillations look slower, so that `frequency` is then None.
    """
    # members that completed, by what acts on them
    alike = dict[tuple[int | None, ...], list[int]]()
    for k, outcome in enumerate(outcomes):
        setup = batch.setups[k]
        if outcome.status == "completed" and setup.signals is not None and setup.controller is not None:
            # changes are each machine's own, and with jitter the rows of an injection each member's
            jittered = k if setup.injection is not None and setup.timing.jitter else None
            key = id(setup.signals), id(batch.changes[k]), id(setup.injection), jittered
            alike.setdefault(key, []).append(k)

    motions: list[Oscillation | None] = [None] * len(batch)

    def least_of(members: list[int], reference: FloatArray, k: int, frequency: float) -> float:
        sensors, platform = batch.sensors[members[k]], batch.setups[members[k]].platform
        length = float(np.mean(reference) - np.mean(kept.kept[LegErrors.needs[0]][..., members[k]]))
        return least_amplitude(frequency, length, platform.platform_points, sensors.noise, sensors.quantisation)

    with ThreadPoolExecutor(threads) as pool:
        for members in alike.values():
            prepared = batch.member(members[0])
            assert prepared.loop.reference is not None
            reference = np.ascontiguousarray(prepared.loop.reference[:: kept.every, LENGTHS].T)
            acting = acting_columns(prepared, prepared.loop.timing.sample_of_row)
            # up to the first kept row at or after it
            begin = ceil(rest_begins(values for _, values in acting) / kept.every)
            parts = [members[k : k + _TOGETHER] for k in range(0, len(members), _TOGETHER)]
            judged = []
            for part in parts:
                # those of consecutive members without a copy
                together = slice(part[0], part[-1] + 1) if part[-1] - part[0] == len(part) - 1 else part
                errors, least = kept.kept[LegErrors.needs[0]][..., together], partial(least_of, part, reference)
                judged.append(pool.submit(self_excitation, kept.time, reference, begin, errors, least))
            for part, judgement in zip(parts, judged, strict=True):
                for member, motion in zip(part, judgement.result(), strict=True):
                    motions[member] = motion if motion is None or kept.every == 1 else motion._replace(frequency=None)
    return motions

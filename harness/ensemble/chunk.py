"""A chunk of an ensemble: some members, prepared, run in parallel, and reduced; its files."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import polars

from gough_stewart.harness.control.laws_of_members import shared_by_members
from gough_stewart.harness.control.makers import name_of
from gough_stewart.harness.ensemble import data
from gough_stewart.harness.errors import (
    ControllerError,
    ExperimentError,
    RecordError,
    SharedMemoryError,
    UnstableLoopError,
)
from gough_stewart.harness.experiment.members import EnsemblePlan, Members
from gough_stewart.harness.experiment.preparation import Batch, Prepared, PreparedMembers, one_or_each
from gough_stewart.harness.experiment.run import acting_columns
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.folds import Fold, KeptRows, State
from gough_stewart.harness.loop.loop import LENGTHS
from gough_stewart.harness.loop.rows import Outcome
from gough_stewart.harness.loop.run import observe, samples_of_rows
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.lanes import Stepping
from gough_stewart.harness.results.bands import DEFAULT, Bands, BandSamples
from gough_stewart.harness.results.metric_folds import columns_of, folds_of_loop, metric_kernels
from gough_stewart.harness.results.oscillation import Oscillation, SelfExcitation, least_amplitude, rest_begins
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import LIMITS
from gough_stewart.model.process.files import write_whole
from gough_stewart.model.vectors import FloatArray

# Members per chunk: enough to make Python's overhead small, few enough that two workers share a thousand evenly.
SIZE = 512
# Rows that are kept of each member: 100 kB, 50 MB in a chunk.
MOST_ROWS = 2048
# Members that a thread looks at in one go.
_TOGETHER = 64
FOLDER = "chunks"


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


class Chunk(NamedTuple):
    """The results kept of some members."""

    rows: polars.DataFrame  # one per member; see `result`
    bands: BandSamples
    features: str  # processor features of the machine code


def chunk(plan: EnsemblePlan, first: int, last: int, threads: int = 1) -> Chunk:
    """Run members first to last − 1: a pure function, with the same result on any machine and any number of threads.

    Raises
    ------
    GoughStewartError
        An error that concerns all members of this experiment.
    SharedMemoryError
        Members share the memory of their controller.
    """
    members = plan.prepared
    draws = members.draws(first, last)
    prepared = members.prepared_with(draws.values, range(first, last))
    batch = prepared.batch
    if not len(batch):
        metrics, nothing = _none(members, first)
        return Chunk(_rows(first, draws.columns, prepared, (), (), metrics), nothing, "")
    bands, errors = _bands(members, batch.timing, len(batch), first), LegErrors(batch.timing)
    run = reduced(batch, members.stepping, threads, [bands, errors])
    check_memory(batch, run, lambda first_one: reduced(first_one, members.stepping, threads))
    columns, ended = run.columns, list(run.outcomes)
    if members.choice.margins:
        judged = margins_of([batch.member(k) for k in range(len(batch))])
        for k, cause in enumerate(judged.pop(data.CAUSE)):
            ended[k] = ended[k]._replace(cause=ended[k].cause or cause)
        columns |= judged
    motions = oscillations(batch, ended, errors, threads)
    return Chunk(_rows(first, draws.columns, prepared, ended, motions, columns), bands.samples(), run.features)


class Reduced(NamedTuple):
    """A run of N members, reduced."""

    outcomes: tuple[Outcome, ...]  # N
    columns: dict[str, FloatArray]  # metrics, integration error and internal steps (N,)
    features: str  # processor features of the machine code


def reduced(
    batch: Batch, stepping: Stepping, threads: int = 1, folds: Sequence[Fold] = (), names: Sequence[str] | None = None
) -> Reduced:
    """Run members in parallel; `folds` keep more of their rows.

    Parameters
    ----------
    names
        Only these metrics, to save time.
    """
    n, running = len(batch), batch.in_parallel(stepping)
    metrics = folds_of_loop(running.loop, limits_of_members(batch, running.size), names)
    rows = FoldsOfRows(running.loop, [*metrics, *folds], running.size, metric_kernels())
    with running.plant:
        outcomes = observe(
            running.plant, running.law_from, running.loop, rows, threads=threads, keeps_interrupted=False
        )
        columns = {name: values[:n] for name, values in columns_of(rows.results()).items()}
        columns[data.INTEGRATION_ERROR] = running.plant.integration_error[:n]
        columns[data.INTERNAL_STEPS] = running.plant.internal_steps[:n]
        return Reduced(outcomes[:n], columns, running.plant.features)


def check_memory(batch: Batch, run: Reduced, again: Callable[[Batch], Reduced]) -> None:
    """Run the first member again if members may share the memory of its controller: it must give the same bits.

    What a function keeps from its first call on, and never changes, is not found.

    Parameters
    ----------
    run
        Of all members.
    again
        Runs others.

    Raises
    ------
    SharedMemoryError
        It gives others.
    """
    controller = shared_by_members(batch.setups[0].controller)
    if controller is None:
        return
    first = again(batch.take([0]))
    differ = [
        name
        for name, values in first.columns.items()
        if not np.array_equal(values[:1], run.columns[name][:1], equal_nan=True)
    ]
    if differ or first.outcomes[0] != run.outcomes[0]:
        raise SharedMemoryError(
            f"the first member gave other results when it ran again ({', '.join(differ[:3]) or data.OUTCOME}): "
            f"{name_of(controller)} keeps memory, which all members share; use a factory: a class or function, called "
            "as make(platform, sample_time), that makes a controller for each member"
        )


def _bands(members: Members, timing: Timing, n: int, first: int) -> Bands:
    names = members.choice.signals
    return Bands(DEFAULT if names is None else names, timing, n, first)


def limits_of_members(batch: Batch, size: int) -> dict[str, Any]:
    """Limits of the nominal models, one number if they are all the same; of a size, with copies of the last one."""
    platforms = [batch.setups[min(k, len(batch) - 1)].platform for k in range(size)]
    stated = [row.name for row in LIMITS if getattr(platforms[0], row.name) is not None]
    return {name: one_or_each([getattr(platform, name) for platform in platforms]) for name in stated}


def margins_of(prepared: Sequence[Prepared]) -> dict[str, Any]:
    """For each member's machine with its controller: whether the linear loop is stable, and its disk margin.

    Also the causes (n,) of members whose margins cannot be computed, None of the others.
    """
    from gough_stewart.harness.experiment.margins import judged

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
            loop = None if form.doubt else judged(member, member.machine, form.controller)
            if loop is None or loop.doubt:  # a number that cannot be told is none
                causes[k] = f"no margins: {form.doubt if loop is None else loop.doubt}"
            else:
                stable[k], disk[k] = 1.0, loop.margins.disk.alpha
        except UnstableLoopError:
            stable[k] = 0.0
        except (GoughStewartError, np.linalg.LinAlgError) as error:
            causes[k] = f"no margins: {error}"
    return {f"{data.MARGINS}stable": stable, f"{data.MARGINS}disk": disk, data.CAUSE: causes}


def check_names(plan: EnsemblePlan) -> None:
    """Refuse unknown bands and metrics before anything runs.

    Raises
    ------
    ExperimentError
        An unknown name in `signals` or `worst_by`; suggests the nearest.
    """
    members = plan.prepared
    where, choice = plan.where, members.choice
    try:
        columns = _none(members, 0)[0]
    except RecordError as error:
        raise ExperimentError(where, "ensemble.signals", str(error)) from None
    if choice.worst_by is not None and data.SHORT.get(choice.worst_by, choice.worst_by) not in columns:
        raise ExperimentError(
            where, "ensemble.worst_by", f"no metric '{choice.worst_by}'{nearest(choice.worst_by, columns)}"
        )


def _none(members: Members, first: int) -> tuple[dict[str, FloatArray], BandSamples]:
    """The results if no member can run."""
    try:
        batch = members.possible()
    except GoughStewartError:
        batch = members.prepared_with([{}], [None]).batch
    loop = batch.member(0).loop
    limits = limits_of_members(batch, 1)
    columns = {**columns_of(FoldsOfRows(loop, folds_of_loop(loop, limits)).results())}
    columns |= {data.INTEGRATION_ERROR: np.zeros(1), data.INTERNAL_STEPS: np.zeros(1)}
    if members.choice.margins:
        columns |= {f"{data.MARGINS}stable": np.zeros(1), f"{data.MARGINS}disk": np.zeros(1)}
    return {name: values[:0] for name, values in columns.items()}, _bands(members, loop.timing, 0, first).samples()


def _rows(
    first: int,
    varied: dict[str, Any],
    prepared: PreparedMembers,
    outcomes: Sequence[Outcome],
    of_completed: Sequence[Oscillation | None],
    metrics: dict[str, FloatArray],
) -> polars.DataFrame:
    """One row per member, in order of their numbers."""
    n, reasons = len(prepared.errors) + len(prepared.numbers), prepared.reasons
    status, cause = [data.IMPOSSIBLE] * n, [reasons.get(k) for k in range(n)]
    ended: list[float | None] = [None] * n
    motions: list[Oscillation | None] = [None] * n
    for k, outcome, motion in zip(prepared.numbers[: len(outcomes)].tolist(), outcomes, of_completed, strict=True):
        status[k], ended[k], cause[k], motions[k] = outcome.status, outcome.time, outcome.cause, motion
    columns: dict[str, Any] = {data.MEMBER: polars.Series(range(first, first + n), dtype=polars.Int64)}
    for name, values in varied.items():
        columns[f"{data.VARIED}{name}"] = polars.Series(values)
    kinds = [motion and (data.GROWING if motion.is_growing else data.OSCILLATING) for motion in motions]
    columns |= {
        data.OUTCOME: status,
        data.ENDED: polars.Series(ended, dtype=polars.Float64),
        data.CAUSE: polars.Series(cause, dtype=polars.String),
        data.OSCILLATION: polars.Series(kinds, dtype=polars.String),
        data.AMPLITUDE: polars.Series([motion and motion.amplitude for motion in motions], dtype=polars.Float64),
        data.FREQUENCY: polars.Series([motion and motion.frequency for motion in motions], dtype=polars.Float64),
    }
    for name, values in metrics.items():
        of_all = np.full(n, np.nan)
        of_all[prepared.numbers] = values
        columns[name] = of_all
    return polars.DataFrame(columns, nan_to_null=True)


def oscillations(
    batch: Batch, outcomes: Sequence[Outcome], kept: LegErrors, threads: int = 1
) -> list[Oscillation | None]:
    """The motion by itself of each member that completed; None for a sound loop.

    Rows that are left out of long runs make fast oscillations look slower, so that `frequency` is then None.
    """
    motions: list[Oscillation | None] = [None] * len(batch)

    def judged(members: list[int], reference: FloatArray, judge: SelfExcitation) -> None:
        # those of consecutive members without a copy
        together = slice(members[0], members[-1] + 1) if members[-1] - members[0] == len(members) - 1 else members
        errors = kept.errors[..., together]

        def least_of(k: int) -> Callable[[float], float]:
            sensors, platform = batch.sensors[members[k]], batch.setups[members[k]].platform
            length = float(np.mean(reference) - np.mean(errors[..., k]))
            return least_amplitude(length, platform.platform_points, sensors.noise, sensors.quantisation)

        for member, motion in zip(members, judge(errors, least_of), strict=True):
            motions[member] = motion

    with ThreadPoolExecutor(threads) as pool:
        for members, reference, judge in _alike(batch, outcomes, kept):
            parts = [members[k : k + _TOGETHER] for k in range(0, len(members), _TOGETHER)]
            list(pool.map(lambda part, reference=reference, judge=judge: judged(part, reference, judge), parts))
    return motions if kept.every == 1 else [motion and motion._replace(frequency=None) for motion in motions]


def _alike(
    batch: Batch, outcomes: Sequence[Outcome], kept: LegErrors
) -> Iterator[tuple[list[int], FloatArray, SelfExcitation]]:
    """Members that completed and share what acts on them, their legs' reference at the kept rows, and their judge."""
    alike = dict[tuple[int | None, ...], list[int]]()
    for k, outcome in enumerate(outcomes):
        setup = batch.setups[k]
        if outcome.status == "completed" and setup.signals is not None and setup.controller is not None:
            # changes are each machine's own, and with jitter the rows of an injection each member's
            jittered = k if setup.injection is not None and setup.timing.jitter else None
            key = id(setup.signals), id(batch.changes[k]), id(setup.injection), jittered
            alike.setdefault(key, []).append(k)
    for members in alike.values():
        prepared = batch.member(members[0])
        assert prepared.loop.reference is not None
        reference = np.ascontiguousarray(prepared.loop.reference[:: kept.every, LENGTHS].T)
        acting = acting_columns(prepared, samples_of_rows(prepared.loop.timing))
        # up to the first kept row at or after it
        begin = ceil(rest_begins(values for _, values in acting) / kept.every)
        yield members, reference, SelfExcitation(kept.time, reference, begin)


@dataclass(frozen=True)
class ChunkBytes:
    """A chunk as bytes, on its way from a worker to its files."""

    rows: bytes  # Parquet
    bands: bytes
    features: str

    @classmethod
    def of(cls, chunk: Chunk) -> "ChunkBytes":
        """The same chunk always gives the same bytes."""
        rows, bands = BytesIO(), BytesIO()
        chunk.rows.write_parquet(rows, statistics=False)
        part = chunk.bands
        arrays: dict[str, Any] = {name: getattr(part, name) for name in part._fields}
        arrays["columns"] = np.array(part.columns, dtype=str)
        np.savez(bands, **arrays)
        return cls(rows.getvalue(), bands.getvalue(), chunk.features)


class ChunkFiles:
    """Chunks in a folder; a chunk that starts at member k has k.parquet, k.npz, and, written last, k.json."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / FOLDER

    def write(self, first: int, chunk: ChunkBytes) -> None:
        """Write a chunk completely or not at all.

        Raises
        ------
        OSError
            It cannot be written; partial files are ignored.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.rows(first), chunk.rows)
        write_whole(self.rows(first).with_suffix(".npz"), chunk.bands)
        says = {"features": chunk.features, "rows": _digest(chunk.rows), "bands": _digest(chunk.bands)}
        write_whole(self.rows(first).with_suffix(".json"), json.dumps(says, indent=1).encode())

    def features(self, first: int) -> str | None:
        """The processor features of the chunk's machine code; None if the chunk is missing or incomplete."""
        try:
            says = json.loads(self.rows(first).with_suffix(".json").read_bytes())
            is_complete = all(
                _digest(path.read_bytes()) == says[name]
                for name, path in (("rows", self.rows(first)), ("bands", self.rows(first).with_suffix(".npz")))
            )
            return str(says["features"]) if is_complete else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def rows(self, first: int) -> Path:
        """The table of its members."""
        return self.folder / f"{first:08d}.parquet"

    def bands(self, first: int) -> BandSamples:
        """Its samples over time."""
        with np.load(self.rows(first).with_suffix(".npz")) as arrays:
            parts: dict[str, Any] = {name: arrays[name] for name in BandSamples._fields}
        return BandSamples(**{**parts, "columns": tuple(parts["columns"].tolist())})

    def count(self) -> int:
        """The number of chunks."""
        return len(list(self.folder.glob("*.json")))

    def remove(self) -> None:
        """Remove all chunks."""
        for path in sorted(self.folder.glob("*")):
            path.unlink()
        if self.folder.is_dir():
            self.folder.rmdir()


def _digest(content: bytes) -> str:
    """A checksum against torn files and failing disks, at a tenth of the time of SHA-256."""
    return f"{crc32(content):08x}"

"""A chunk of an ensemble: some members, prepared, run in parallel, and reduced."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars

from gough_stewart.harness.control.laws import linear_of
from gough_stewart.harness.control.laws_of_members import shared_by_members
from gough_stewart.harness.control.python.makers import name_of
from gough_stewart.harness.ensemble.columns import (
    CAUSE,
    ENDED,
    IMPOSSIBLE,
    INTEGRATION_ERROR,
    INTERNAL_STEPS,
    MARGINS,
    MEMBER,
    OUTCOME,
    SHORT,
    VARIED,
)
from gough_stewart.harness.ensemble.oscillations import LegErrors, oscillation_columns, oscillations
from gough_stewart.harness.errors import (
    ControllerError,
    ExperimentError,
    RecordError,
    SharedMemoryError,
    UnstableLoopError,
)
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.plan import EnsemblePlan
from gough_stewart.harness.experiment.preparation import Batch, Prepared, PreparedMembers, one_or_each
from gough_stewart.harness.loop.folding import FoldsOfRows
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.results.bands import DEFAULT, Bands, BandSamples
from gough_stewart.harness.results.metric_folds import columns_of, folds_of_loop, metric_kernels
from gough_stewart.harness.results.oscillation import Oscillation
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.interface import nearest
from gough_stewart.model.parameters import LIMITS
from gough_stewart.model.vectors import FloatArray

# Members per chunk: enough to make Python's overhead small, few enough that two workers share a thousand evenly.
SIZE = 512


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
        As `check_memory`.
    """
    members = plan.prepared
    draws = members.draws(first, last)
    found = members.prepared_with(draws.values, range(first, last))
    batch = found.batch
    if not len(batch):
        metrics, nothing = _none(members, first)
        return Chunk(_rows(first, draws.columns, found, (), (), metrics), nothing, "")
    run = _run(members, batch, first, threads)
    check_memory(batch, run[:2], lambda one: _run(members, one, first, threads)[:2])
    columns, ended = run.columns, list(run.outcomes)
    if members.choice.margins:
        judged = margins_of([batch.member(k) for k in range(len(batch))])
        for k, cause in enumerate(judged.pop(CAUSE)):
            ended[k] = ended[k]._replace(cause=ended[k].cause or cause)
        columns |= judged
    own = oscillations(batch, ended, run.errors, threads)
    return Chunk(_rows(first, draws.columns, found, ended, own, columns), run.bands.samples(), run.features)


class _Run(NamedTuple):
    """A run of N members, reduced."""

    outcomes: tuple[Outcome, ...]  # N
    columns: dict[str, FloatArray]  # metrics (N,)
    bands: Bands
    errors: LegErrors
    features: str


def _run(members: Members, batch: Batch, first: int, threads: int) -> _Run:
    n, running, timing = len(batch), batch.in_parallel(members.stepping), batch.timing
    bands = Bands(_signals(members), timing, n, first)
    errors = LegErrors(timing)
    folds = [*folds_of_loop(running.loop, limits_of_members(batch, running.size)), bands, errors]
    rows_in_blocks = FoldsOfRows(running.loop, folds, running.size, metric_kernels())
    with running.plant:
        outcomes = observe_all(running.plant, running.law_from, running.loop, rows_in_blocks, threads)
        steps = {
            INTEGRATION_ERROR: running.plant.integration_error[:n],
            INTERNAL_STEPS: running.plant.internal_steps[:n],
        }
        features = running.plant.features
    columns = {name: values[:n] for name, values in columns_of(rows_in_blocks.results()).items()}
    return _Run(outcomes[:n], columns | steps, bands, errors, features)


Results = tuple[Sequence[Outcome], Mapping[str, FloatArray]]


def check_memory(batch: Batch, results: Results, again: Callable[[Batch], Results]) -> None:
    """Run the first member again if members may share the memory of its controller: it must give the same bits.

    What a function keeps from its first call on, and never changes, is not found.

    Parameters
    ----------
    results
        Outcomes and metrics of all members.
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
    outcomes, columns = again(batch.take([0]))
    differ = [k for k, values in columns.items() if not np.array_equal(values[:1], results[1][k][:1], equal_nan=True)]
    if differ or outcomes[0] != results[0][0]:
        raise SharedMemoryError(
            f"the first member gave other results when it ran again ({', '.join(differ[:3]) or OUTCOME}): "
            f"{name_of(controller)} keeps memory, which all members share; use a factory: a class or function, called "
            "as make(platform, sample_time), that makes a controller for each member"
        )


def _signals(members: Members) -> Sequence[str]:
    return DEFAULT if members.choice.signals is None else members.choice.signals


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
    for k, each in enumerate(prepared):
        try:
            controller = linear_of(each.controller)
        except ControllerError:  # the run says so
            continue
        if controller is None:
            continue
        try:
            found = judged(each, each.machine, controller)
            if found.doubt:  # a number that cannot be told is none
                causes[k] = f"no margins: {found.doubt}"
            else:
                stable[k], disk[k] = 1.0, found.margins.disk.alpha
        except UnstableLoopError:
            stable[k] = 0.0
        except (GoughStewartError, np.linalg.LinAlgError) as error:
            causes[k] = f"no margins: {error}"
    return {f"{MARGINS}stable": stable, f"{MARGINS}disk": disk, CAUSE: causes}


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
    if choice.worst_by is not None and SHORT.get(choice.worst_by, choice.worst_by) not in columns:
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
    columns |= {INTEGRATION_ERROR: np.zeros(1), INTERNAL_STEPS: np.zeros(1)}
    if members.choice.margins:
        columns |= {f"{MARGINS}stable": np.zeros(1), f"{MARGINS}disk": np.zeros(1)}
    bands = Bands(_signals(members), loop.timing, 0, first)
    return {name: values[:0] for name, values in columns.items()}, bands.samples()


def _rows(
    first: int,
    varied: dict[str, Any],
    found: PreparedMembers,
    outcomes: Sequence[Outcome],
    own: Sequence[Oscillation | None],
    metrics: dict[str, FloatArray],
) -> polars.DataFrame:
    """One row per member, in order of their numbers."""
    n, reasons = len(found.errors) + len(found.numbers), found.reasons
    status, cause = [IMPOSSIBLE] * n, [reasons.get(k) for k in range(n)]
    ended: list[float | None] = [None] * n
    motions: list[Oscillation | None] = [None] * n
    for k, outcome, motion in zip(found.numbers[: len(outcomes)].tolist(), outcomes, own, strict=True):
        status[k], ended[k], cause[k], motions[k] = outcome.status, outcome.time, outcome.cause, motion
    columns: dict[str, Any] = {MEMBER: polars.Series(range(first, first + n), dtype=polars.Int64)}
    for name, values in varied.items():
        columns[f"{VARIED}{name}"] = polars.Series(values)
    columns |= {
        OUTCOME: status,
        ENDED: polars.Series(ended, dtype=polars.Float64),
        CAUSE: polars.Series(cause, dtype=polars.String),
        **oscillation_columns(motions),
    }
    for name, values in metrics.items():
        whole = np.full(n, np.nan)
        whole[found.numbers] = values
        columns[name] = whole
    return polars.DataFrame(columns, nan_to_null=True)

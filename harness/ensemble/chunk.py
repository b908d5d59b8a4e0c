"""A chunk of an ensemble: some members, prepared, run in parallel, and reduced."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import polars

from gough_stewart.harness.control.laws import linear_of
from gough_stewart.harness.ensemble.columns import (
    CAUSE,
    ENDED,
    IMPOSSIBLE,
    INTEGRATION_ERROR,
    MARGINS,
    MEMBER,
    OUTCOME,
    SHORT,
    VARIED,
)
from gough_stewart.harness.ensemble.oscillations import LegErrors, oscillation_columns, oscillations
from gough_stewart.harness.errors import ControllerError, ExperimentError, RecordError, UnstableLoopError
from gough_stewart.harness.experiment.batch import batch_of, prepared_members
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.pilot import pilots
from gough_stewart.harness.experiment.plan import Plan
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.loop.folds import FoldsOfRows
from gough_stewart.harness.loop.observe import observe_all
from gough_stewart.harness.loop.outcomes import Outcome
from gough_stewart.harness.results.bands import DEFAULT, Bands, BandSamples
from gough_stewart.harness.results.metric_folds import columns_of, folds_of_loop
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


def chunk(plan: Plan, first: int, last: int) -> Chunk:
    """Run members first to last − 1: a pure function, with the same result on any machine.

    Raises
    ------
    GoughStewartError
        An error that concerns all members of this experiment.
    """
    members = plan.prepared
    part = prepared_members(members, first, last)
    numbers = sorted(part.prepared)
    prepared = [part.prepared[k] for k in numbers]
    if not prepared:
        merits, nothing = _none(members, first)
        return Chunk(_rows(first, part.draws.columns, part.impossible, [], (), (), merits), nothing, "")
    batch = batch_of(prepared, plan.substeps)
    timing = prepared[0].loop.timing
    bands = Bands(_signals(members), timing, len(prepared), first)
    errors = LegErrors(timing)
    folds = [*folds_of_loop(batch.loop, limits_of_members(prepared, batch.size)), bands, errors]
    rows_in_blocks = FoldsOfRows(batch.loop, folds, batch.size)
    with batch.plant:
        outcomes = observe_all(batch.plant, batch.law_from, batch.loop, rows_in_blocks)
        integration_error = batch.plant.integration_error[: len(prepared)]
        features = batch.plant.features
    columns = {name: values[: len(prepared)] for name, values in columns_of(rows_in_blocks.results()).items()}
    columns[INTEGRATION_ERROR] = integration_error
    if members.choice.margins:
        columns |= margins_of(prepared)
    ended = outcomes[: len(prepared)]
    own = oscillations(prepared, ended, errors)
    rows = _rows(first, part.draws.columns, part.impossible, numbers, ended, own, columns)
    return Chunk(rows, bands.samples(), features)


def _signals(members: Members) -> Sequence[str]:
    return DEFAULT if members.choice.signals is None else members.choice.signals


def limits_of_members(prepared: Sequence[Prepared], size: int) -> dict[str, Any]:
    """Limits of the nominal models, one number if they are all the same."""
    nominal = [each.platform for each in prepared]
    found = dict[str, Any]()
    for row in LIMITS:
        values = [getattr(platform, row.name) for platform in nominal]
        if values[0] is None:
            continue
        filled = [*values, *[values[-1]] * (size - len(values))]
        found[row.name] = values[0] if all(value == values[0] for value in values) else np.array(filled)
    return found


def margins_of(prepared: Sequence[Prepared]) -> dict[str, FloatArray]:
    """For each member's machine with its controller: whether the linear loop is stable, and its disk margin."""
    # python-control takes a second to import
    from gough_stewart.harness.control.loop_transfer import loop_transfer
    from gough_stewart.harness.control.margins import loop_margins

    stable, disk = np.full(len(prepared), np.nan), np.full(len(prepared), np.nan)
    for k, each in enumerate(prepared):
        try:
            controller = linear_of(each.controller)
        except ControllerError:  # the run says so
            continue
        if controller is None:
            continue
        loop, motion = each.loop, each.motion
        assert motion is not None  # a controller has a reference
        try:
            found = loop_margins(
                loop_transfer(
                    each.machine,
                    controller,
                    loop.timing.sample_time,
                    delay=loop.actuators.delay,
                    lag=loop.actuators.lag,
                    position=motion.position[0],
                    orientation=motion.orientation[0],
                    believed=each.platform,
                )
            )
            stable[k], disk[k] = 1.0, found.disk.alpha
        except UnstableLoopError:
            stable[k] = 0.0
    return {f"{MARGINS}stable": stable, f"{MARGINS}disk": disk}


def check_names(plan: Plan) -> None:
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
        some = pilots(members)[0]
    except GoughStewartError:
        some = members.prepared(members.nominal)
    loop, platform = some.loop, some.platform
    limits = {row.name: value for row in LIMITS if (value := getattr(platform, row.name)) is not None}
    columns = {**columns_of(FoldsOfRows(loop, folds_of_loop(loop, limits)).results()), INTEGRATION_ERROR: np.zeros(1)}
    if members.choice.margins:
        columns |= {f"{MARGINS}stable": np.zeros(1), f"{MARGINS}disk": np.zeros(1)}
    bands = Bands(_signals(members), loop.timing, 0, first)
    return {name: values[:0] for name, values in columns.items()}, bands.samples()


def _rows(
    first: int,
    varied: dict[str, Any],
    impossible: dict[int, str],
    numbers: Sequence[int],
    outcomes: Sequence[Outcome],
    own: Sequence[Oscillation | None],
    metrics: dict[str, FloatArray],
) -> polars.DataFrame:
    """One row per member, in order of their numbers."""
    n = len(impossible) + len(numbers)
    at = np.array(numbers, dtype=np.intp) - first
    status, cause = [IMPOSSIBLE] * n, [impossible.get(first + k) for k in range(n)]
    ended: list[float | None] = [None] * n
    motions: list[Oscillation | None] = [None] * n
    for k, outcome, motion in zip(at.tolist(), outcomes, own, strict=True):
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
        whole[at] = values
        columns[name] = whole
    return polars.DataFrame(columns, nan_to_null=True)

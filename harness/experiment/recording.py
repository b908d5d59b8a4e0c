"""The records of runs: columns by name, and metadata; of single members bit for bit as in their ensemble."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars
from numpy.typing import NDArray

from gough_stewart.harness.control.faults import CUT, FROZEN, N_FAULTS
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import Batch, Prepared
from gough_stewart.harness.experiment.preparation import with_hints
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.experiment.varied import experiment_with
from gough_stewart.harness.loop.folds import ERRORS, error_between
from gough_stewart.harness.loop.loop import LENGTHS
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.loop.seeds import as_numbers
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.plants import signals
from gough_stewart.harness.results.oscillation import FAULTS
from gough_stewart.harness.results.record import Record, columns, plain
from gough_stewart.model import interface
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.plan import Plan

FORMAT = 1
_INPUT_COLUMNS = [name for v in interface.INPUTS for name in v.scalar_names]
_REFERENCE = (
    *((f"reference.{name}", 3) for name in (*signals.NAMES[:4], "acceleration", "angular_acceleration")),
    ("reference.leg_length", 6),
    ("reference.leg_velocity", 6),
)


def record_of(run: Run, prepared: Prepared, circumstances: dict[str, Any]) -> Record:
    """The table of a run, and its metadata: those passed in, and those of the run itself."""
    n, at = len(run.time), run.sample_of_row
    parts: list[tuple[list[str], Any]] = [
        (["time"], run.time[:, None]),
        (list(Variant.of(prepared.machine).columns[: run.results.shape[1]]), run.results),
        (_INPUT_COLUMNS, run.inputs),
    ]
    if prepared.motion is not None and prepared.legs is not None:
        reference = np.concatenate([*prepared.motion, *prepared.legs], axis=1)[:n]
        parts.append(([name for prefix, size in _REFERENCE for name in columns(prefix, size)], reference))
        parts += _errors(run.results, reference)
    if run.used:
        names = [f"measured.{name}" for name in signals.column_names(run.used)]
        parts.append((names, run.measured[at][:, signals.positions(run.used)]))
    parts.append((columns("controller.force", 6), run.command[at]))
    parts.append((columns("controller.feedforward", 6), prepared.loop.feedforward[at]))
    parts.append((columns("controller.state", run.controller_state.shape[1]), run.controller_state[at]))
    known = {name for names, _ in parts for name in names}
    parts += [(names, values) for names, values in acting_columns(prepared, at) if known.isdisjoint(names)]
    parts.append((columns("flag.force_limited", 6), run.force_limited[at]))
    parts.append((columns("flag.rate_limited", 6), run.rate_limited))
    parts.append((columns("flag.stroke_exceeded", 6), run.stroke_exceeded))
    table = polars.DataFrame({name: values[:, k] for names, values in parts for k, name in enumerate(names)})
    return Record(table, _metadata(run, prepared, circumstances))


def _errors(results: FloatArray, reference: FloatArray) -> list[tuple[list[str], FloatArray]]:
    """As `error_between`."""
    actual = interface.unpack(interface.RESULTS, results)
    references, at = {}, 0
    for name, size in _REFERENCE:
        references[name.removeprefix("reference.")] = reference[:, at : at + size]
        at += size
    return [
        (columns(error, actual[name].shape[1]), error_between(name, references[name].T, actual[name].T).T)
        for error in ERRORS
        for name in [error.removeprefix("error.")]
    ]


def acting_columns(prepared: Prepared, sample_of_row: NDArray[np.intp]) -> list[tuple[list[str], NDArray[Any]]]:
    """All that acts on a loop from outside, over the rows of these samples (n,): scalar names and columns (n, k)."""
    loop, n = prepared.loop, len(sample_of_row)

    def over_time(start: object, changed: Iterable[object]) -> FloatArray:
        values = np.tile(np.ravel(np.asarray(start, dtype=float)), (n, 1))
        for change, value in zip(loop.changes, changed, strict=True):
            if value is not None:
                values[loop.timing.row(change.time, "a change") :] = np.ravel(np.asarray(value))
        return values

    parts: list[tuple[list[str], NDArray[Any]]] = []
    if loop.reference is not None:
        parts.append((columns("reference.leg_length", 6), loop.reference[:n, LENGTHS]))
    if loop.injection is not None:
        parts.append((columns("controller.injection", 6), loop.injection[sample_of_row]))
    parts.append((_INPUT_COLUMNS[6:], over_time(np.zeros(6), (change.external_wrench for change in loop.changes))))
    for variable in Variant.of(prepared.machine).tunable:
        changed = [change.parameters.get(variable.name) for change in loop.changes]
        if any(value is not None for value in changed):
            values = over_time(getattr(prepared.machine, variable.name), changed)
            parts.append((list(variable.scalar_names), values))
    faults = over_time(np.zeros(N_FAULTS), (change.faults for change in loop.changes))
    frozen = (FROZEN.start + signals.positions([name]) for name in signals.NAMES)
    for name, at in zip(FAULTS, (np.arange(N_FAULTS)[CUT], *frozen), strict=True):
        if faults[:, at].any():
            parts.append((columns(name, len(at)), faults[:, at] > 0))
    return parts


def _metadata(run: Run, prepared: Prepared, circumstances: dict[str, Any]) -> dict[str, Any]:
    timing, actuators = prepared.loop.timing, prepared.loop.actuators
    return {
        "format": FORMAT,
        **circumstances,
        **({"warnings": list(prepared.warnings)} if prepared.warnings else {}),
        "host": run.host,
        "rows": len(run.time),
        "outcome": run.outcome._asdict(),
        "duration": timing.duration,
        "sample_time": timing.sample_time,
        "plant_step": timing.plant_step,
        "seed": as_numbers(prepared.loop.sensors.seed),
        "force_limit": actuators.force_limit,
        "platform": plain(prepared.platform),
        "machine": plain(prepared.machine),
        "versions": versions(),
    }


def member_of(plan: "Plan", member: int) -> tuple[Experiment, Prepared]:
    """The experiment of a member, and the same prepared.

    Raises
    ------
    ExperimentError
        No member of that number, or one that is impossible.
    """
    (own,), batch = _members_of(plan, [member])
    return own, with_hints(own, batch.member(0))


def _members_of(plan: "Plan", numbers: Sequence[int | None]) -> tuple[list[Experiment], Batch]:
    for member in numbers:
        if member is not None and not 0 <= member < plan.members:
            raise ExperimentError(plan.where, "member", f"is {member}; expected 0 to {plan.members - 1}")
    members = plan.prepared
    values = [{} if member is None else members.draws(member, member + 1).values[0] for member in numbers]
    found = members.prepared_with(values, numbers)
    for k, reason in found.reasons.items():
        raise ExperimentError(plan.where, _name_of(numbers[k]), f"is impossible: {reason}")
    own = [experiment_with(members.nominal, each) for each in values]
    titles = [f"{plan.title}, {_name_of(member)}" for member in numbers]
    return [each.model_copy(update={"title": title}) for each, title in zip(own, titles, strict=True)], found.batch


def _name_of(member: int | None) -> str:
    return "nominal machine" if member is None else f"member {member}"


def records_of(plan: "Plan", members: Sequence[int | None], progress: TimeProgress | None = None) -> list[Record]:
    """The records of members, which run in parallel; None is the nominal machine, with the experiment's own seed.

    Raises
    ------
    ExperimentError
        As `member_of`.
    """
    if not members:
        return []
    experiments, batch = _members_of(plan, members)
    running = batch.in_parallel(plan.prepared.stepping)
    with running.plant:
        run = simulate(running.plant, running.law_from, running.loop, progress)
    return [
        record_of(
            run.of_member(k),
            with_hints(own, batch.member(k)),
            {
                "title": own.title,
                "plant": "lanes",
                **({} if member is None else {"member": member}),
                "experiment": own.model_dump(mode="json"),
                **({"files": plan.files} if plan.files else {}),
                **({"replaced": ["controller"]} if plan.controller else {}),
            },
        )
        for k, (member, own) in enumerate(zip(members, experiments, strict=True))
    ]

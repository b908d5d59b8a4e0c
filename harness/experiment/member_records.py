"""Full records of single members, bit for bit as in their ensemble."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import batch_of, prepared_members
from gough_stewart.harness.experiment.plan import Plan
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.recording import record_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.results.record import Record
from gough_stewart.model.progress import TimeProgress

PLANT = "lanes"


def member_of(plan: Plan, member: int) -> tuple[Experiment, Prepared]:
    """The experiment of a member, and the same prepared.

    Raises
    ------
    ExperimentError
        No member of that number, or one that is impossible.
    """
    if not 0 <= member < plan.members:
        raise ExperimentError(plan.where, "member", f"is {member}; expected 0 to {plan.members - 1}")
    members = plan.prepared
    part = prepared_members(members, member, member + 1)
    if member in part.impossible:
        raise ExperimentError(plan.where, f"member {member}", f"is impossible: {part.impossible[member]}")
    own = members.experiment(part.draws.values[0]).model_copy(update={"title": f"{plan.title}, member {member}"})
    return own, part.prepared[member]


def records_of(plan: Plan, members: Sequence[int], progress: TimeProgress | None = None) -> list[Record]:
    """The records of members, which run in parallel.

    Raises
    ------
    ExperimentError
        As `member_of`.
    """
    each = [member_of(plan, member) for member in members]
    if not each:
        return []
    batch = batch_of([prepared for _, prepared in each], plan.substeps)
    with batch.plant:
        run = simulate(batch.plant, batch.law_from, batch.loop, progress)
    return [
        record_of(
            _alone(run, k, prepared),
            prepared,
            {
                "title": own.title,
                "plant": PLANT,
                "member": member,
                "experiment": own.model_dump(mode="json"),
                **({"files": plan.files} if plan.files else {}),
                **({"replaced": ["controller"]} if plan.controller else {}),
            },
        )
        for k, (member, (own, prepared)) in enumerate(zip(members, each, strict=True))
    ]


def _alone(run: Run, member: int, prepared: Prepared) -> Run:
    """The history of one of many members, up to its end."""
    outcome = run.outcomes[member]
    rows = int(np.searchsorted(run.time, outcome.time + prepared.loop.timing.plant_step / 2))
    by_member = run.sample_of_row if run.sample_of_row.ndim == 1 else run.sample_of_row[:, member]
    return replace(
        run,
        time=run.time[:rows],
        results=np.ascontiguousarray(run.results[:rows, member]),
        inputs=run.inputs[:rows, member],
        rate_limited=run.rate_limited[:rows, member],
        stroke_exceeded=run.stroke_exceeded[:rows, member],
        sample_of_row=by_member[:rows],
        measured=run.measured[:, member],
        command=run.command[:, member],
        controller_state=run.controller_state[:, member],
        force_limited=run.force_limited[:, member],
        outcomes=(outcome,),
    )

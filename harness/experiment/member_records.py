"""Full records of single members, bit for bit as in their ensemble."""

from collections.abc import Sequence

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import batch_of, prepared_members
from gough_stewart.harness.experiment.plan import Plan
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.recording import record_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.run import simulate
from gough_stewart.harness.results.record import Record
from gough_stewart.model.process.progress import TimeProgress

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
            run.of_member(k),
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

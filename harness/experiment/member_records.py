"""Full records of single members, bit for bit as in their ensemble."""

from collections.abc import Sequence

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import Batch, Prepared
from gough_stewart.harness.experiment.plan import Plan
from gough_stewart.harness.experiment.recording import record_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.experiment.varied import experiment_with
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
    (own,), batch = _members_of(plan, [member])
    return own, batch.member(0)


def _members_of(plan: Plan, numbers: Sequence[int]) -> tuple[list[Experiment], Batch]:
    for member in numbers:
        if not 0 <= member < plan.members:
            raise ExperimentError(plan.where, "member", f"is {member}; expected 0 to {plan.members - 1}")
    members = plan.prepared
    values = [members.draws(member, member + 1).values[0] for member in numbers]
    found = members.prepared_with(values, numbers)
    for k, reason in found.reasons.items():
        raise ExperimentError(plan.where, f"member {numbers[k]}", f"is impossible: {reason}")
    own = [experiment_with(members.nominal, each) for each in values]
    titles = [f"{plan.title}, member {member}" for member in numbers]
    return [each.model_copy(update={"title": title}) for each, title in zip(own, titles, strict=True)], found.batch


def records_of(plan: Plan, members: Sequence[int], progress: TimeProgress | None = None) -> list[Record]:
    """The records of members, which run in parallel.

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
            batch.member(k),
            {
                "title": own.title,
                "plant": PLANT,
                "member": member,
                "experiment": own.model_dump(mode="json"),
                **({"files": plan.files} if plan.files else {}),
                **({"replaced": ["controller"]} if plan.controller else {}),
            },
        )
        for k, (member, own) in enumerate(zip(members, experiments, strict=True))
    ]

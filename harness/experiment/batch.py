"""Members that run in parallel: prepared, padded to whole vectors, with one plant and one loop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.control.laws_of_members import LawFrom, laws_of
from gough_stewart.harness.experiment.members import Draws, Members
from gough_stewart.harness.experiment.preparation import Prepared, Stages
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import Loop
from gough_stewart.harness.loop.together import together
from gough_stewart.harness.plants import members as in_memory
from gough_stewart.harness.plants.lanes import LanesPlant, lanes_plant
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import GoughStewartError, SingularPoseError
from gough_stewart.model.parameters import stack
from gough_stewart.model.platform_checks import GEOMETRY, remember_home_poses
from gough_stewart.model.vectors import FloatArray

# Size of the plant's vectors: a member's bits do not depend on the others if all vectors are full.
LANES = 8


@dataclass(frozen=True)
class PreparedMembers:
    """Consecutive members from `first` on: their draws, those that can run, and why others cannot."""

    first: int
    draws: Draws
    prepared: dict[int, Prepared]  # by member
    impossible: dict[int, str]


@dataclass(frozen=True)
class Batch:
    """The members that run, followed by copies of the last one up to a whole number of vectors."""

    plant: LanesPlant
    law_from: LawFrom | None
    loop: Loop
    size: int  # including the copies


def prepared_members(members: Members, first: int, last: int, draws: Draws | None = None) -> PreparedMembers:
    """Members first to last − 1, or with other draws; for an impossible one, the reason is returned, not raised."""
    draws = members.draws(first, last) if draws is None else draws
    preparation = members.preparation
    _remember_home_poses(members, draws)
    started = dict[int, tuple[Experiment, Stages]]()
    impossible = dict[int, str]()
    prepared = dict[int, Prepared]()
    for k, values in enumerate(draws.values, first):
        try:
            each = members.experiment(values)
            started[k] = each, preparation.stages(each, members.controller)
        except GoughStewartError as error:
            impossible[k] = _reason(error, members.nominal.where)
    held = _held({k: stages for k, (_, stages) in started.items()})
    for k, (each, stages) in started.items():
        try:
            prepared[k] = members.prepared(each, seed=members.seed_of(k), held=held.get(k), stages=stages)
        except GoughStewartError as error:
            impossible[k] = _reason(error, members.nominal.where)
    return PreparedMembers(first, draws, prepared, impossible)


def _remember_home_poses(members: Members, draws: Draws) -> None:
    """Evaluate the home poses of all machines at once, if their geometry varies, for the checks of each."""
    paths = [("plant", "parameters", name) for name in GEOMETRY]
    if not draws.values or not any(path in draws.values[0] for path in paths):
        return
    machine = members.machine_of_all
    if machine is None:
        return
    varied = [
        np.array([values[path] for values in draws.values], dtype=float)
        if path in draws.values[0]
        else np.repeat(getattr(machine, path[-1])[None], len(draws.values), axis=0)
        for path in paths
    ]
    remember_home_poses(*varied)


def _reason(error: GoughStewartError, where: str) -> str:
    return str(error).removeprefix(f"{where}: ")


def _held(members: dict[int, Stages]) -> dict[int, FloatArray]:
    """Forces that hold each machine in its start pose; none if one has a singular pose, which reports itself."""
    if not members:
        return {}
    platforms = stack([stages.machine for stages in members.values()])
    starts = [stages.start for stages in members.values()]
    position, orientation = (np.stack([getattr(s, name) for s in starts]) for name in ("position", "orientation"))
    try:
        forces = static_leg_forces(platforms, position, orientation)
    except SingularPoseError:
        return {}
    return dict(zip(members, np.asarray(forces), strict=True))


def batch_of(prepared: Sequence[Prepared], substeps: int, compiler: bool | None = None) -> Batch:
    """Prepared members as one plant and one loop.

    Raises
    ------
    ControllerError
        Members that cannot run in parallel; names the difference.
    """
    filled = [*prepared, *[prepared[-1]] * (-len(prepared) % LANES)]
    loop = together([each.loop for each in filled])
    plant = lanes_plant([p.machine for p in filled], [p.start for p in filled], substeps=substeps, compiler=compiler)
    controllers = [each.controller for each in prepared if each.controller is not None]
    law_from = None
    if controllers:
        law_from = laws_of(
            controllers,
            loop.timing.sample_time,
            _jacobians(filled),
            [each.known for each in prepared],
            len(filled) - len(prepared),
        )
    return Batch(plant, law_from, loop, len(filled))


def _jacobians(prepared: Sequence[Prepared]) -> FloatArray:
    """(n, 6, 6) if all are the same, else (n, N, 6, 6)."""
    first = prepared[0].jacobians
    if all(each.jacobians is first for each in prepared):
        return first
    n = len(first)
    flat: FloatArray = in_memory.stacked([each.jacobians.reshape(n, 36) for each in prepared])
    return flat.reshape(n, len(prepared), 6, 6)

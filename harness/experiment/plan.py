"""The plan of an ensemble: everything that determines its results."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import LANES, batch_of, prepared_members
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.named_files import digests
from gough_stewart.harness.experiment.preparation import Prepared
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import observe_all
from gough_stewart.harness.loop.observing import Observer, Row
from gough_stewart.harness.plants.lanes import substeps_for

# How many members the pilot tries to find some that can run.
_PILOT_AMONG = 64
_TRIES = 6
FORMAT = 1


@dataclass(frozen=True)
class Plan:
    """Everything that determines the results of an ensemble, as plain values that can be sent to workers."""

    experiment: dict[str, Any]
    where: str
    folder: str
    members: int
    seed: int
    substeps: int
    # contents of the files that the experiment names
    files: dict[str, str] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """The title of the experiment."""
        return str(self.experiment["title"])

    @property
    def text(self) -> str:
        """The plan as JSON, for workers and files."""
        return json.dumps({"format": FORMAT, **asdict(self)}, indent=1, sort_keys=True)

    @property
    def decisive(self) -> dict[str, Any]:
        """The part that determines results; without the file's location, and the substeps, which follow from it."""
        return {"experiment": self.experiment, "members": self.members, "seed": self.seed, "files": self.files}

    @property
    def hash(self) -> str:
        """A hash of the part that determines results."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @property
    def prepared(self) -> Members:
        """The members, prepared once per process."""
        return _members_of(self.text)


def plan_from(text: str) -> Plan:
    """The plan of a `Plan.text`.

    Raises
    ------
    ValueError
        Not a plan, or one of another version.
    """
    values = json.loads(text)
    if values.pop("format", None) != FORMAT:
        raise ValueError("a plan of another version")
    return Plan(**values)


def plan_of(experiment: Experiment) -> Plan:
    """The plan of an experiment with an `[ensemble]`; finds the substeps by running the first members.

    Raises
    ------
    ExperimentError
        Nothing varies, or the variation is invalid.
    PlantError, ReachError, ControllerError
        The members cannot be run.
    """
    plan = plan_without_substeps(experiment)
    return replace(plan, substeps=substeps_of(Members(experiment)))


def plan_without_substeps(experiment: Experiment) -> Plan:
    """The same, without running a member.

    Raises
    ------
    ExperimentError
        As `plan_of`.
    """
    values = experiment.model_dump(mode="json", exclude_unset=True)
    members = Members(experiment)
    _check_varies(members)
    folder = str(experiment.folder.absolute())
    return Plan(values, experiment.where, folder, members.count, members.seed, 1, digests(experiment))


@lru_cache(2)
def _members_of(text: str) -> Members:
    plan = plan_from(text)
    experiment = experiment_from(plan.experiment, plan.where).from_file(plan.where, Path(plan.folder))
    if (found := digests(experiment)) != plan.files:
        names = sorted(name for name in {*found, *plan.files} if found.get(name) != plan.files.get(name))
        raise ExperimentError(plan.where, "", f"names {', '.join(names)}, which has changed since the run began")
    return Members(experiment)


def _check_varies(members: Members) -> None:
    experiment = members.nominal
    if not members.inputs and not experiment.sensors.noise and not experiment.loop.jitter:
        raise ExperimentError(
            experiment.where,
            "ensemble",
            "nothing varies; expected a distribution, for instance platform_mass = {normal = [120, 10]}, or noise",
        )


def pilots(members: Members) -> list[Prepared]:
    """The first members that can run, enough for one vector.

    Raises
    ------
    ExperimentError
        None of the members tried can run.
    """
    found: list[Prepared] = []
    reason = ""
    for each in _some(members):
        if isinstance(each, str):
            reason = reason or each
        else:
            found.append(each)
        if len(found) == LANES:
            break
    if not found:
        raise ExperimentError(
            members.nominal.where,
            "ensemble",
            f"none of the first {min(members.count, _PILOT_AMONG)} members is possible; the first: {reason}",
        )
    return found


def _some(members: Members) -> Iterator[Prepared | str]:
    for first in range(0, min(members.count, _PILOT_AMONG), LANES):
        part = prepared_members(members, first, min(first + LANES, members.count))
        for k in range(first, first + len(part.draws.values)):
            yield part.prepared.get(k) or part.impossible[k]


def substeps_of(members: Members) -> int:
    """The number of substeps that the first members need in their run for the experiment's tolerance."""
    plant, prepared = members.nominal.plant, pilots(members)
    if plant.fixed_step_size:
        return max(1, ceil(prepared[0].loop.timing.plant_step / plant.fixed_step_size - 1e-9))
    substeps = 1
    for _ in range(_TRIES):
        batch = batch_of(prepared, substeps)
        with batch.plant:
            observe_all(batch.plant, batch.law_from, batch.loop, _Nothing())
            error = float(np.max(batch.plant.integration_error))
        if not np.isfinite(error):
            substeps *= 4
            continue
        needed = substeps_for(error, substeps, members.choice.tolerance)
        if needed <= substeps:
            break
        substeps = needed
    return substeps


class _Nothing(Observer):
    def row(self, row: Row) -> None:
        pass

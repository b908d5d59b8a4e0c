"""The plan of an ensemble: everything that determines its results."""

import hashlib
import json
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.harness.experiment.fingerprint import fingerprint
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.experiment.named_files import digests
from gough_stewart.harness.experiment.schema import Experiment

FORMAT = 2


@dataclass(frozen=True, eq=False)
class Given:
    """A controller from Python that replaces the experiment's; compared by identity."""

    controller: Any


@dataclass(frozen=True)
class Plan:
    """Everything that determines the results of an ensemble, as plain values that can be sent to workers."""

    experiment: dict[str, Any]
    where: str
    folder: str
    members: int
    seed: int
    # contents of the files that the experiment names
    files: dict[str, str] = field(default_factory=dict)
    # the controller from Python that replaces the experiment's, in words, and itself, which no file keeps
    controller: str = ""
    given: Given | None = field(default=None, compare=False)
    # what was set of the experiment's file, as `Experiment.changed`
    settings: dict[str, Any] = field(default_factory=dict, compare=False)

    @property
    def title(self) -> str:
        """The title of the experiment."""
        return str(self.experiment["title"])

    @property
    def text(self) -> str:
        """The plan as JSON, for workers and files."""
        values = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "given"}
        return json.dumps({"format": FORMAT, **values}, indent=1, sort_keys=True)

    @property
    def decisive(self) -> dict[str, Any]:
        """The part that determines results; without the file's location."""
        names = ("experiment", "members", "seed", "files", *(("controller",) if self.controller else ()))
        return {name: getattr(self, name) for name in names}

    @property
    def hash(self) -> str:
        """A hash of the part that determines results."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @property
    def prepared(self) -> Members:
        """The members, prepared once per process.

        Raises
        ------
        ExperimentError
            The plan's files have changed, or it comes from a file and its controller from Python is not there.
        """
        if self.controller and self.given is None:
            raise ExperimentError(
                self.where,
                "controller",
                f"was {self.controller}, given in Python, which files do not keep; expected the same call in Python "
                "with controller=",
            )
        return _members_of(self.text, self.given)


def plan_from(text: str, given: Given | None = None) -> Plan:
    """The plan of a `Plan.text`; a controller from Python is not part of the text.

    Raises
    ------
    ValueError
        Not a plan, or one of another version.
    """
    values = json.loads(text)
    if values.pop("format", None) != FORMAT:
        raise ValueError("a plan of another version")
    return Plan(**values, given=given)


def plan_of(experiment: Experiment, controller: Any = None) -> Plan:
    """The plan of an experiment with an `[ensemble]`.

    Parameters
    ----------
    controller
        Replaces the experiment's, as in `prepare`.

    Raises
    ------
    ExperimentError
        Nothing varies, or the variation is invalid.
    """
    values = experiment.model_dump(mode="json", exclude_unset=True)
    members = Members(experiment, controller)
    _check_varies(members)
    folder = str(experiment.folder.absolute())
    said = "" if controller is None else fingerprint(controller)
    given = None if controller is None else Given(controller)
    count, seed, files = members.count, members.seed, digests(experiment)
    return Plan(values, experiment.where, folder, count, seed, files, said, given, experiment.changed)


@lru_cache(2)
def _members_of(text: str, given: Given | None) -> Members:
    plan = plan_from(text)
    experiment = experiment_from(plan.experiment, plan.where, Path(plan.folder))
    if (found := digests(experiment)) != plan.files:
        names = sorted(name for name in {*found, *plan.files} if found.get(name) != plan.files.get(name))
        raise ExperimentError(plan.where, "", f"names {', '.join(names)}, which has changed since the run began")
    return Members(experiment, None if given is None else given.controller)


def _check_varies(members: Members) -> None:
    experiment = members.nominal
    if not members.inputs and not experiment.sensors.noise and not experiment.loop.jitter:
        raise ExperimentError(
            experiment.where,
            "ensemble",
            "nothing varies; expected a distribution, for instance platform_mass = {normal = [120, 10]}, or noise",
        )

"""Prepares members of an experiment for the loop, straight down its stages; everything is checked.

A stage is evaluated once for each distinct combination of what it is made from. A member whose stage has an error
drops out there. A single run is one member.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.drive import ActuatorChoice
from gough_stewart.harness.control.laws import Controller
from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.batch import Batch, Prepared
from gough_stewart.harness.experiment.distinct import Distinct, T, identity
from gough_stewart.harness.experiment.hints import hints_of, unread
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.experiment.stages import Injection, Stages, force_limit_of, platforms_of
from gough_stewart.harness.experiment.varied import VariedTable
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.loop import Change
from gough_stewart.harness.loop.seeds import Seed
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import GoughStewartError, SingularPoseError
from gough_stewart.model.platform import Platform, Platforms, platforms_with
from gough_stewart.model.state import State
from gough_stewart.model.variant import CHOOSING, SMOOTH, Variant
from gough_stewart.model.vectors import FloatArray

# Values of a member by their path through the tables of the experiment.
Values = Mapping[tuple[str, ...], Any]
# More results of a stage are not repeated but always different.
_REPEATED = 16


def prepare(experiment: Experiment, controller: Any = None, injection: Injection | None = None) -> Prepared:
    """Check everything in an experiment that can be checked without running it.

    Parameters
    ----------
    controller
        Replaces the controller of the experiment, with the feedforward unchanged: as `controller_of`; or an FMU, which
        contains its feedforward.
    injection
        Replaces that of the experiment: a function from the time of a sample [s] to six forces [N] that are added to
        the command.

    Raises
    ------
    ExperimentError
        An invalid part; names it.
    ReachError
        A reference that the platform cannot follow.
    """
    found = Preparation(experiment, controller).members([{}], injection=injection)
    for error in found.errors.values():
        raise error
    return with_hints(experiment, found.batch.member(0))


def with_hints(experiment: Experiment, prepared: Prepared) -> Prepared:
    """With warnings of what is possible in its experiment but hardly meant."""
    hints = (*hints_of(experiment, prepared.platform), *unread(experiment, prepared.controller))
    return replace(prepared, warnings=(*prepared.warnings, *hints))


@dataclass(frozen=True, eq=False)
class PreparedMembers:
    """Those of N members that can run, and why others cannot."""

    numbers: NDArray[np.intp]  # of the members of the batch, from 0 to N - 1
    batch: Batch
    errors: dict[int, GoughStewartError]
    where: str  # file or name of the experiment

    @property
    def reasons(self) -> dict[int, str]:
        """Why members cannot run."""
        return {k: str(self.errors[k]).removeprefix(f"{self.where}: ") for k in sorted(self.errors)}


class Preparation:
    """Prepares members of an experiment that differ in their values; those before often had the same ones.

    Parameters
    ----------
    controller
        Replaces the experiment's, as in `prepare`.
    """

    def __init__(self, experiment: Experiment, controller: Any = None) -> None:
        self.experiment, self.controller = experiment, controller
        self._results = dict[str, _Results]()

    def members(
        self, values: Sequence[Values], seeds: Sequence[Seed] | None = None, injection: Injection | None = None
    ) -> PreparedMembers:
        """Members with these values.

        Parameters
        ----------
        seeds
            Of each member's noise and jitter, instead of the sensors' own.
        injection
            As in `prepare`.
        """
        n, stages, stage = len(values), Stages(self.experiment), _Evaluation(len(values), self._results)
        tables, of, is_given = self._tables(stage, values), attrgetter, self.controller is not None
        loop, drives, limits, choice = (tables[name] for name in ("loop", "actuators", "limits", "controller"))
        given: Distinct[Any] = Distinct.common(self.controller, n)
        delay, jitter = loop.map(of("delay")), loop.map(of("jitter"))
        is_closed = choice.map(lambda each: is_given or each.is_closed)
        without = choice.map(lambda each: is_given or each.is_closed or each.feedforward != "none")
        platform = stage(stages.platform, tables["platform"])
        machine = self._machine(stage, stages, platform, values)
        if self._may_differ(values) and self._variant is not None:
            _of_variant(stage, machine, self._variant, self.experiment.where)
        stage(stages.timing, jitter, delay)
        timing = stage(stages.timing, Distinct.common(0.0, n), Distinct.common(0, n))
        force_limit = stage(force_limit_of, drives.map(of("force_limit")), platform)
        limited = stage(stages.limited, platform, force_limit)
        requested = stage(stages.reference, tables["reference"], limited, timing, without)
        reach = (limits.map(of("condition_number")), limits.map(of("reference")))
        warnings = stage(stages.warnings, limited, requested, *reach)
        planned = stage(stages.planned, platform, requested)
        start = stage(stages.start, tables["start"], platform, planned)
        forces = stage(stages.feedforward, choice.map(of("feedforward")), delay, platform, planned, timing)
        controller = stage(stages.controller, choice, platform, timing, given)
        forces = stage(stages.forces, choice, controller, delay, forces, given)
        start_force = _start_forces(stage, machine, start, controller, forces, force_limit)
        actuators = stage(_actuators, drives, force_limit, delay)
        ends = stage(stages.limits, limits.map(of("position_error")), platform, is_closed)
        changes: Distinct[tuple[Change, ...]] = Distinct.common((), n)
        if self.experiment.change or self.experiment.disturbance or self.experiment.fault:
            changing = (tables[name] for name in ("change", "disturbance", "fault"))
            changes = stage(stages.changes, *changing, machine, timing)
        added = stage(stages.injection, tables["injection"], platform, planned, timing, Distinct.common(injection, n))
        self._results = {name: found for name, found in stage.results.items() if len(found) <= _REPEATED}
        every = Batch(
            timing=timing,
            platform=platform,
            machine=machine,
            start=start,
            planned=planned,
            warnings=warnings,
            controller=controller,
            feedforward=forces,
            injection=added,
            start_force=start_force,
            sensors=tables["sensors"].map(lambda each: Sensors(**dict(each))),
            actuators=actuators,
            limits=ends,
            changes=changes,
            jitter=jitter,
            seeds=Distinct.among(seeds or [self.experiment.sensors.seed] * n),
        )
        going = np.flatnonzero(stage.going)
        return PreparedMembers(going, every.take(going), stage.errors, self.experiment.where)

    @staticmethod
    def _may_differ(values: Sequence[Values]) -> bool:
        """Whether a member may have other parts than the experiment's machine."""
        return any(path[-1] in CHOOSING for each in values for path in each)

    @cached_property
    def _variant(self) -> Variant | None:
        """Of the experiment's machine; None if that is impossible."""
        try:
            return Variant.of(platforms_of(self.experiment)[1])
        except GoughStewartError:
            return None

    def _tables(self, stage: "_Evaluation", values: Sequence[Values]) -> dict[str, Distinct[Any]]:
        """The tables of the experiment, with each member's values, but without those of the machine."""
        n = len(values)
        tables: dict[str, Distinct[Any]] = {name: Distinct.common(table, n) for name, table in self.experiment}
        for name in dict.fromkeys(path[0] for each in values for path in each if path[0] != "plant"):
            own = [{path[1:]: value for path, value in each.items() if path[0] == name} for each in values]
            texts = ["; ".join(f"{'.'.join(path)} = {value!r}" for path, value in each.items()) for each in own]
            of_text, table = dict(zip(texts, own, strict=True)), VariedTable(self.experiment, name)
            tables[name] = stage(
                lambda text, table=table, of=of_text: table.having(of[text]), Distinct.among(texts), name=f"[{name}]"
            )
        return tables

    def _machine(
        self, stage: "_Evaluation", stages: Stages, nominal: Distinct[Platform], values: Sequence[Values]
    ) -> Distinct[Platform]:
        """The simulated platforms."""
        base, common = stage(stages.base_of_machine, nominal), self.experiment.plant.parameters
        own = [{path[-1]: value for path, value in each.items() if path[0] == "plant"} for each in values]
        if not any(own) or not stage.going.any():
            return stage(stages.machine, base, Distinct.common(common, len(values)))
        going = np.flatnonzero(stage.going)
        of = np.zeros(len(values), dtype=np.intp)
        of[going] = np.arange(len(going))
        bases = base.take(going)
        platforms, errors = platforms_with(bases.values, bases.of, [{**common, **own[k]} for k in going.tolist()])
        for k, error in errors.items():
            stage.fail([going[k]], ExperimentError(self.experiment.where, "plant", str(error)))
        return Distinct(platforms, of)


# Results of a stage, and what they were made from, by its identity.
_Results = dict[tuple[object, ...], tuple[Sequence[object], Any]]


class _Evaluation:
    """Evaluates the stages of N members that have not failed yet.

    Parameters
    ----------
    known
        Results for other members, by stage.
    """

    def __init__(self, n: int, known: Mapping[str, _Results]) -> None:
        self.going, self.errors = np.ones(n, dtype=bool), dict[int, GoughStewartError]()
        self._known, self.results = known, dict[str, _Results]()

    def __call__(self, make: Callable[..., T], *parts: Distinct[Any], name: str = "") -> Distinct[T]:
        """The results of a stage, of which each is made once from the same parts; errors end its members."""
        going = np.flatnonzero(self.going)
        key = np.zeros(len(going), dtype=np.intp)
        for part in parts:
            if len(part.values) > 1:
                key = np.unique(key * len(part.values) + part.of[going], return_inverse=True)[1]
        _, first, of_going = np.unique(key, return_index=True, return_inverse=True)
        name = name or make.__qualname__
        known, results = self._known.get(name, {}), self.results.setdefault(name, {})
        made, of_combination = list[T](), np.zeros(len(first), dtype=np.intp)
        for k, member in enumerate(going[first].tolist()):
            values = [part[member] for part in parts]
            same = tuple(map(identity, values))
            try:
                results[same] = known.get(same) or (values, make(*values))
            except GoughStewartError as error:
                self.fail(going[of_going == k], error)
                continue
            of_combination[k] = len(made)
            made.append(results[same][1])
        found = Distinct[T].among(made)
        of = np.zeros(len(self.going), dtype=np.intp)
        if made:
            of[going] = found.of[of_combination[of_going]]
        return Distinct(found.values, of)

    def fail(self, members: Iterable[int], error: GoughStewartError) -> None:
        """These members cannot run."""
        for member in members:
            self.errors[int(member)], self.going[member] = error, False


def _actuators(choice: ActuatorChoice, force_limit: float | None, delay: int) -> Actuators:
    return Actuators(force_limit, choice.rate_limit, choice.lag, delay)


def _of_variant(stage: _Evaluation, machine: Distinct[Platform], variant: Variant, where: str) -> None:
    """Fail members whose machine has other states than that of the experiment: one vector steps several members."""
    if not len(machine.values):
        return
    platforms = Platforms.of(machine.values)
    sticks, gives = platforms.field("leg_friction_model") != SMOOTH, platforms.field("leg_stiffness") > 0
    for name, other, own in (
        ("leg_friction_model", replace(variant, bristles=not variant.bristles), sticks != variant.bristles),
        ("leg_stiffness", replace(variant, springs=not variant.springs), gives != variant.springs),
    ):
        members = np.flatnonzero(own[machine.of] & stage.going)
        if len(members):
            text = (
                f"{name}: gives a member {other.words.removeprefix('with ')}, and the experiment's machine has "
                f"{variant.words.removeprefix('with ')}; expected one kind in all members: run the others as an "
                "experiment of their own"
            )
            stage.fail(members, ExperimentError(where, "plant", text))


def _start_forces(
    stage: _Evaluation,
    machine: Distinct[Platform],
    start: Distinct[State],
    controller: Distinct[Controller | None],
    forces: Distinct[FloatArray],
    force_limit: Distinct[float | None],
) -> FloatArray:
    """Forces (N, 6) before the first command: of an open loop its own, else those that hold the machine at rest."""
    found, going = np.zeros((len(machine), 6)), np.flatnonzero(stage.going).tolist()
    closed = [k for k in going if controller[k] is not None]
    for k in going:
        if controller[k] is None:
            found[k] = forces[k][0]
    if closed:
        machines, starts = machine.take(closed), start.take(closed)
        platforms = Platforms.of(machines.values)[machines.of].parameters
        position, orientation = (np.stack([each[k] for each in starts.values])[starts.of] for k in range(2))
        try:
            found[closed] = static_leg_forces(platforms, position, orientation)
        except SingularPoseError:
            for k in closed:
                try:
                    found[k] = static_leg_forces(machine[k], start[k].position, start[k].orientation)
                except SingularPoseError as error:
                    stage.fail([k], error)
    limit = np.array([np.inf if force_limit[k] is None else force_limit[k] for k in going])[:, None]
    found[going] = np.clip(found[going], -limit, limit)
    return found

"""From an experiment's tables to what runs: everything is checked, for one run or for many members that differ.

Members that have the same values, but for their machine and their sensors, share one `Setup`. What several setups
have in common, such as the planned motion, is computed once. A single run is one member.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough_stewart.harness.control.controllers import ControllerChoice, Feedforward, feedforward
from gough_stewart.harness.control.faults import N_FAULTS, FaultChoice
from gough_stewart.harness.control.frequency_response import InjectionChoice
from gough_stewart.harness.control.laws import Controller, controller_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.batch import Batch, Distinct, Planned, Prepared, Setup, identity
from gough_stewart.harness.experiment.overrides import Values, table_with
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import Actuators, Change, Limits, Sensors, stroke_of
from gough_stewart.harness.loop.timing import Seed, Timing
from gough_stewart.harness.motion.limits.reach import WhenBeyond, check_reach, jacobians_of, legs_of
from gough_stewart.harness.motion.motion import Motion, Reference, centre_of, end_of
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.plants.signals import VARIABLES
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import GoughStewartError, PlatformError, SingularPoseError
from gough_stewart.model.interface import CHOOSING, SMOOTH, Variant, nearest
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform, Platforms, joints_of_keys, load_platform, load_preset, platforms_with
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray, real_array

T = TypeVar("T")
Injection = Callable[[float], ArrayLike]

# More results of a stage are not kept for the next members, since they were always different.
_REPEATED = 16
# The largest plausible noise or quantisation: this share of a leg [m] or of a radian, within this time for rates [s].
_SHARE = 0.05
_TIME = 0.1


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
    prepared = Preparation(experiment, controller).members([{}], injection=injection)
    for error in prepared.errors.values():
        raise error
    return with_hints(experiment, prepared.batch.member(0))


def with_hints(experiment: Experiment, prepared: Prepared) -> Prepared:
    """With warnings of what is possible but hardly meant.

    Legs that nearly touch, joints in a bad order, a motion after the end, coarse sensors, faults that change nothing.
    """
    platform = prepared.platform
    length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    scales = {"m": length, "rad": 1.0, "m/s": length / _TIME, "rad/s": 1.0 / _TIME}
    coarse = [
        f"sensors.{kind}.{variable.name} is {value:g} {variable.unit}, {value / scales[variable.unit]:.3g} of the "
        f"platform's scale of {scales[variable.unit]:.3g} {variable.unit}; check its unit"
        for kind in ("noise", "quantisation")
        for variable in VARIABLES
        if (value := getattr(experiment.sensors, kind).get(variable.name) or 0.0) > _SHARE * scales[variable.unit]
    ]
    read = () if prepared.controller is None else getattr(prepared.controller, "signals", None)
    unread = [
        f"fault.{k}.freeze.{name}: nobody reads {name}, so this changes nothing; the controller reads "
        f"{' and '.join(read) or 'no sensor'}"
        for k, fault in enumerate(experiment.fault, 1)
        for name in fault.freeze
        if read is not None and name not in read
    ]
    hints = (*platform.hints, *too_late(experiment), *coarse, *unread)
    return replace(prepared, warnings=(*prepared.warnings, *hints))


def too_late(experiment: Experiment) -> tuple[str, ...]:
    """A reference that begins after the run has ended: whatever is measured is that of rest."""
    at, duration = float(getattr(experiment.reference, "at", 0.0)), experiment.loop.duration
    if at < duration:
        return ()
    return (f"reference.at is {at:g} s in a run of {duration:g} s, so nothing moves; set it earlier, or run longer",)


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
        self._where, self._folder, self._own_tables = experiment.where, experiment.folder, dict[str, Any](experiment)
        # results of stages, and what they were made from, by its identity
        self._known = dict[str, dict[tuple[object, ...], tuple[Sequence[object], Any]]]()

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
        experiment, n, errors = self.experiment, len(values), dict[int, GoughStewartError]()
        paths = list(dict.fromkeys(path for member in values for path in member))
        of_sensors = [path for path in paths if path[0] == "sensors"]
        of_setup = [path for path in paths if path[0] not in ("sensors", "plant")]

        # tables: members with equal values share them; those of the sensors and of the machine play no part in a setup
        groups, of_group = _grouped(values, of_setup)
        readings, of_reading = _grouped(values, of_sensors)
        tables, nominal = [dict[str, Any]()] * len(groups), list[Platform | None]([None] * len(groups))
        sensors, setups = [Sensors()] * len(readings), list[Setup | None]([None] * len(groups))
        for g, members in enumerate(groups):
            with _failing(errors, members):
                tables[g] = self._tables(values[members[0]], of_setup)
                nominal[g] = self._once(self.nominal, tables[g]["platform"])
        for r, members in enumerate(readings):
            with _failing(errors, members):
                sensors[r] = Sensors(**dict(self._tables(values[members[0]], of_sensors)["sensors"]))

        # the machines, and for each group of members everything else
        machine = self._machines(nominal, groups, values, errors)
        for g, members in enumerate(groups):
            with _failing(errors, members):
                platform = nominal[g]
                if platform is not None and not errors.keys() >= set(members):
                    setups[g] = self._setup(tables[g], platform, injection)
        made = [setup for setup in setups if setup is not None]
        index = np.cumsum([setup is not None for setup in setups]) - 1
        each_setup = Distinct(made, np.maximum(index[of_group], 0))

        # forces at the start, and changes, of each machine
        start_force = _start_forces(machine, each_setup, errors)
        changes = [tuple[Change, ...]()] * n
        if experiment.change or experiment.disturbance or experiment.fault:
            for k in [k for k in range(n) if k not in errors]:
                changing = [tables[of_group[k]][name] for name in ("change", "disturbance", "fault")]
                with _failing(errors, [k]):
                    changes[k] = self._once(self._changes, *changing, machine[k] if changing[0] else None)

        self._known = {name: results for name, results in self._known.items() if len(results) <= _REPEATED}
        every = Batch(
            setups=each_setup,
            machine=machine,
            sensors=Distinct(sensors, of_reading),
            changes=Distinct.among(changes),
            seeds=Distinct.among(seeds or [experiment.sensors.seed] * n),
            start_force=start_force,
        )
        numbers = np.array([k for k in range(n) if k not in errors], dtype=np.intp)
        return PreparedMembers(numbers, every.take(numbers), errors, experiment.where)

    def _setup(self, tables: Mapping[str, Any], platform: Platform, injection: Injection | None) -> Setup:
        """Everything of a member but its machine and its sensors."""
        experiment, once = self.experiment, self._once
        loop, drives, limits, choice = (tables[name] for name in ("loop", "actuators", "limits", "controller"))
        is_closed = self.controller is not None or choice.is_closed

        # clocks, and the motion in rows of clocks that all members have
        timing = once(timing_of, experiment, loop)
        force_limit = force_limit_of(drives.force_limit, platform)
        is_needed = is_closed or choice.feedforward != "none"
        reach = limits.condition_number, limits.reference
        planned = once(self._planned, tables["reference"], platform, force_limit, *reach, is_needed)
        start = once(self._start, tables["start"], platform, planned)

        # the controller, and what is known of its forces in advance; an FMU that is given contains its feedforward
        forces = once(self._feedforward, choice.feedforward, loop.delay, platform, planned)
        controller = once(self._controller, choice, platform)
        if isinstance(controller, UnitController) and not loop.delay:
            raise ExperimentError(
                experiment.where,
                "controller",
                f"{controller.path} outputs the forces of a sample after a step over it; expected a loop.delay "
                "of at least 1, for instance by --set loop.delay=1",
            )
        if self.controller is None:
            forces = choice.planned(forces)
        elif isinstance(controller, UnitController):
            forces = np.zeros_like(forces)

        # what ends a run: an open loop only leaves its stroke; at a distance of a leg length, control is lost
        bound = limits.position_error
        if bound is None:
            bound = once(_mean_leg_length, platform) if is_closed else math.inf
        stroke = stroke_of(platform.leg_length_min, platform.leg_length_max)
        return Setup(
            timing=timing,
            platform=platform,
            start=start,
            planned=planned,
            controller=controller,
            feedforward=forces,
            injection=once(self._injection, tables["injection"], platform, planned, injection),
            actuators=Actuators(force_limit, drives.rate_limit, drives.lag, loop.delay),
            limits=Limits(stroke, experiment.limits.stroke, bound),
        )

    def _once(self, make: Callable[..., T], *parts: Any, stage: str = "") -> T:
        """The result of a stage for these parts, or its error, of which each is made once."""
        known = self._known.setdefault(stage or make.__name__, {})
        key = tuple(map(identity, parts))
        if key not in known:
            try:
                known[key] = parts, make(*parts)
            except GoughStewartError as error:
                known[key] = parts, error
        result: T = known[key][1]
        if isinstance(result, GoughStewartError):
            raise result
        return result

    def _tables(self, values: Values, paths: Sequence[tuple[str, ...]]) -> dict[str, Any]:
        """The tables of the experiment by name, with a member's values at these paths."""
        by_table = dict[str, dict[tuple[str, ...], Any]]()
        for path in paths:
            if path in values:
                by_table.setdefault(path[0], {})[path[1:]] = values[path]

        def table(name: str, _text: str) -> Any:
            return table_with(self.experiment, name, by_table[name])

        made = {name: self._once(table, name, repr(own), stage=f"[{name}]") for name, own in by_table.items()}
        return self._own_tables | made

    @cached_property
    def _timing(self) -> Timing:
        """The clocks of all members, without jitter."""
        return timing_of(self.experiment, self.experiment.loop.model_copy(update={"jitter": 0.0, "delay": 0}))

    # Stages: each is made once for the same parts.

    def nominal(self, choice: schema.PlatformChoice) -> Platform:
        """The platform that the designer believes in."""
        with part_of(self._where, "platform"):
            file = None if choice.file is None else self._folder / choice.file
            platform = load_preset(choice.preset_name) if file is None else load_platform(file)
            parameters = joints_of_keys(choice.circles) | choice.parameters
            return platform.with_parameters(parameters) if parameters else platform

    def _machine_base(self, nominal: Platform) -> Platform:
        """The platform whose parameters those of the machine replace: of a file, or the nominal model."""
        choice = self.experiment.plant
        if choice.file is None:
            return nominal
        with part_of(self._where, "plant"):
            return load_platform(self._folder / choice.file)

    def machine(self, nominal: Platform) -> Platform:
        base, parameters = self._once(self._machine_base, nominal), self.experiment.plant.parameters
        with part_of(self._where, "plant"):
            return base.with_parameters(parameters) if parameters else base

    def _planned(
        self,
        choice: ReferenceChoice | None,
        platform: Platform,
        force_limit: float | None,
        condition_number: float,
        when_beyond: WhenBeyond,
        is_needed: bool,
    ) -> Planned | None:
        """The reference motion, which the platform can follow, and what the loop reads at rows and samples."""
        where, timing = self._where, self._timing
        limited = limited_by(force_limit, platform)
        if choice is None and is_needed:
            raise ExperimentError(where, "reference", "is missing; a controller needs one, for instance type = 'hold'")
        if choice is None:
            return None
        reference, motion = reference_motion(self.experiment, choice, limited, timing)
        with part_of(where, "reference"):
            centre = centre_of(reference)
            exceeded = check_reach(limited, timing.times, motion, condition_number, centre=centre, dynamic=when_beyond)
            legs = legs_of(platform, motion)
            signals = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
            at = slice(0, timing.steps, timing.steps_a_sample)
            jacobians = jacobians_of(platform, Motion(*(part[at] for part in motion)))
            return Planned(reference, motion, legs, signals, jacobians, tuple(exceeded))

    def _start(self, choice: schema.Start, platform: Platform, planned: Planned | None) -> State:
        """The state at time 0, with angles in the turns of the reference."""
        rest = np.zeros(3)
        state = State(platform.home_position, platform.home_orientation, rest, rest)
        if planned is not None:
            state = State(*(values[0] for values in planned.motion[:4]))
        stated = {name: np.array(value) for name, value in choice.model_dump().items() if value is not None}
        if planned is not None and "orientation" in stated:
            stated["orientation"] = nearest_angle(stated["orientation"], state.orientation)
        return state._replace(**stated)

    def _feedforward(self, kind: Feedforward, delay: int, platform: Platform, planned: Planned | None) -> FloatArray:
        """Forces at every sample (m, 6) [N]."""
        samples = self._timing.samples
        if planned is None:
            return np.zeros((len(samples), 6))
        # forces are held, so evaluate them in the middle of that interval
        ahead = samples + (delay + 0.5) * self._timing.sample_time
        return feedforward(kind, platform, planned.reference(np.minimum(ahead, end_of(planned.reference))))

    def _controller(self, choice: ControllerChoice, platform: Platform) -> Controller | None:
        """The controller that replaces the experiment's, or the experiment's."""
        sample_time = self._timing.sample_time
        with part_of(self._where, "controller"):
            if self.controller is None:
                return choice.controller(platform, sample_time, self._folder)
            return controller_of(self.controller, choice.design(platform, sample_time))

    def _injection(
        self, choice: InjectionChoice | None, platform: Platform, planned: Planned | None, injection: Injection | None
    ) -> FloatArray | None:
        """Forces that are added to the command at every sample (m, 6) [N]."""
        samples = self._timing.samples
        if injection is not None:
            forces = np.zeros((len(samples), 6))
            for k, time in enumerate(samples.tolist()):
                try:
                    forces[k] = real_array(injection(time), (6,))
                except ValueError as error:
                    raise ControllerError(f"the injection at time {time:g} s {error}") from None
            return forces
        if choice is None:
            return None
        J = leg_jacobian(platform, platform.home_position, platform.home_orientation)
        with part_of(self._where, "injection"):
            J = J if planned is None else planned.jacobians[0]
            return choice.forces(len(samples), self._timing.sample_time, J)

    def _changes(
        self,
        parameters: Sequence[schema.ChangeChoice],
        wrenches: Sequence[schema.DisturbanceChoice],
        faults: Sequence[FaultChoice],
        machine: Platform | None,
    ) -> tuple[Change, ...]:
        """Of the machine's parameters, then of the load, then faults; each list in order of time."""
        where, timing = self._where, self._timing
        changes: list[Change] = []
        if machine is not None:
            with part_of(where, "change"):
                changes = _parameter_changes(parameters, machine)
                for change in changes:
                    timing.row(change.time, "a change")
        with part_of(where, "disturbance"):
            spans = [(w.at, w.at + w.duration, np.concatenate([w.force, w.torque])) for w in wrenches]
            for time, active in _active(spans, timing, "disturbance"):
                changes.append(Change(time, external_wrench=sum(active, start=np.zeros(6))))
        with part_of(where, "fault"):
            spans = [(f.at, math.inf if f.duration is None else f.at + f.duration, f.flags) for f in faults]
            for time, active in _active(spans, timing, "fault"):
                changes.append(Change(time, faults=np.max([np.zeros(N_FAULTS), *active], axis=0)))
        return tuple(changes)

    # What differs from member to member, for all at once.

    def _machines(
        self,
        nominal: Sequence[Platform | None],
        groups: Sequence[Sequence[int]],
        values: Sequence[Values],
        errors: dict[int, GoughStewartError],
    ) -> Distinct[Platform]:
        """The simulated platforms; of impossible ones the first, and the error."""
        where, n = self._where, len(values)
        own = [{path[-1]: value for path, value in member.items() if path[0] == "plant"} for member in values]
        stage = self._machine_base if any(own) else self.machine
        bases = list[Platform | None]([None] * n)
        for believed, group in zip(nominal, groups, strict=True):
            if believed is not None:
                with _failing(errors, group):
                    base = self._once(stage, believed)
                    for k in group:
                        bases[k] = base
        members = [k for k in range(n) if k not in errors]
        machine = Distinct.among([platform for k in members if (platform := bases[k]) is not None])
        if any(own) and members:
            common = self.experiment.plant.parameters
            made, impossible = platforms_with(machine.values, machine.of, [{**common, **own[k]} for k in members])
            for at, error in impossible.items():
                errors[members[at]] = ExperimentError(where, "plant", str(error))
            machine = Distinct(made, np.arange(len(members)))
        of = np.zeros(n, dtype=np.intp)
        of[members] = machine.of
        machine = Distinct(machine.values, of)
        if members and any(path[-1] in CHOOSING for member in values for path in member):
            self._refuse_other_variants(machine, errors)
        return machine

    def _refuse_other_variants(self, machine: Distinct[Platform], errors: dict[int, GoughStewartError]) -> None:
        """Fail members whose machine has other states than the experiment's: one vector steps several members."""
        try:
            variant = Variant.of(platforms_of(self.experiment)[1])
        except GoughStewartError:
            return
        platforms = Platforms.of(machine.values)
        sticks, gives = platforms.field("leg_friction_model") != SMOOTH, platforms.field("leg_stiffness") > 0
        for name, other, differs in (
            ("leg_friction_model", replace(variant, bristles=not variant.bristles), sticks != variant.bristles),
            ("leg_stiffness", replace(variant, springs=not variant.springs), gives != variant.springs),
        ):
            for k in np.flatnonzero(differs[machine.of]).tolist():
                text = (
                    f"{name}: gives a member {other.words.removeprefix('with ')}, and the experiment's machine has "
                    f"{variant.words.removeprefix('with ')}; expected one kind in all members: run the others as an "
                    "experiment of their own"
                )
                errors.setdefault(k, ExperimentError(self._where, "plant", text))


def _start_forces(
    machine: Distinct[Platform], setups: Distinct[Setup], errors: dict[int, GoughStewartError]
) -> FloatArray:
    """Forces (N, 6) before the first command: of an open loop its own, else those that hold the machine at rest."""
    forces, going = np.zeros((len(machine), 6)), [k for k in range(len(machine)) if k not in errors]
    closed = [k for k in going if setups[k].controller is not None]
    for k in going:
        if setups[k].controller is None:
            forces[k] = setups[k].feedforward[0]
    if closed:
        machines, starts = machine.take(closed), setups.map(lambda setup: setup.start).take(closed)
        platforms = Platforms.of(machines.values)[machines.of].parameters
        position = np.stack([start.position for start in starts.values])[starts.of]
        orientation = np.stack([start.orientation for start in starts.values])[starts.of]
        try:
            forces[closed] = static_leg_forces(platforms, position, orientation)
        except SingularPoseError:
            for k in closed:
                with _failing(errors, [k]):
                    start = setups[k].start
                    forces[k] = static_leg_forces(machine[k], start.position, start.orientation)
    limits = [setups[k].actuators.force_limit for k in going]
    limit = np.array([np.inf if number is None else number for number in limits])[:, None]
    forces[going] = np.clip(forces[going], -limit, limit)
    return forces


def platforms_of(experiment: Experiment) -> tuple[Platform, Platform]:
    """The nominal model, and the machine.

    Raises
    ------
    ExperimentError
        An invalid one.
    """
    preparation = Preparation(experiment)
    nominal = preparation.nominal(experiment.platform)
    return nominal, preparation.machine(nominal)


def force_limit_of(choice: float | str, platform: Platform) -> float | None:
    """The limit of the actuators [N], None without."""
    if choice == "platform":
        return platform.actuator_force_max
    return None if choice == "none" else float(choice)


def limited_by(force_limit: float | None, platform: Platform) -> Platform:
    """A nominal model with the force limit of an experiment's actuators [N]: no motion may use more force."""
    return platform.with_parameters({"actuator_force_max": force_limit})


def timing_of(experiment: Experiment, loop: schema.LoopChoice) -> Timing:
    """The clocks of a run, with their jitter.

    Raises
    ------
    ExperimentError
        Clocks that do not fit each other, or a delay as long as the run.
    """
    with part_of(experiment.where, "loop"):
        step = loop.plant_step or loop.sample_time
        timing = Timing(loop.duration, loop.sample_time, step, loop.jitter, experiment.sensors.seed)
        if not loop.delay * timing.sample_time < timing.duration:
            raise ControllerError(
                f"delay of {loop.delay} samples in a run of {timing.duration:g} s: no command would act; "
                "expected fewer samples, or a longer run"
            )
        return timing


def reference_motion(
    experiment: Experiment, choice: ReferenceChoice, limited: Platform, timing: Timing
) -> tuple[Reference, Motion]:
    """The reference, and its motion at every row, whether or not the platform can follow it.

    Raises
    ------
    ExperimentError
        An invalid one, or one that is faster than the samples can tell.
    """
    with part_of(experiment.where, "reference"):
        reference = choice.about(limited, experiment.folder)
        if not choice.highest_frequency < 0.5 / timing.sample_time:
            raise ControllerError(
                f"frequency of {choice.highest_frequency:g} Hz at a sample_time of {timing.sample_time:g} s; "
                f"expected less than half the sample rate, {0.5 / timing.sample_time:g} Hz"
            )
        return reference, reference(timing.times)


@contextmanager
def part_of(where: str, name: str) -> Iterator[None]:
    """Turn errors inside into those of a part of the experiment; a reference out of reach keeps its data."""
    try:
        yield
    except (ExperimentError, ReachError):
        raise
    except GoughStewartError as error:
        raise ExperimentError(where, name, str(error)) from error


@contextmanager
def _failing(errors: dict[int, GoughStewartError], members: Iterable[int]) -> Iterator[None]:
    """Errors inside are those of members, unless they have one already."""
    try:
        yield
    except GoughStewartError as error:
        for k in members:
            errors.setdefault(k, error)


def _grouped(values: Sequence[Values], paths: Sequence[tuple[str, ...]]) -> tuple[list[list[int]], NDArray[np.intp]]:
    """Members with equal values at some paths, and of each member the number of its group."""
    groups = dict[str, list[int]]()
    for k, member in enumerate(values):
        groups.setdefault(repr([member.get(path, ...) for path in paths]), []).append(k)
    of_group = np.empty(len(values), dtype=np.intp)
    for g, members in enumerate(groups.values()):
        of_group[members] = g
    return list(groups.values()), of_group


def _mean_leg_length(platform: Platform) -> float:
    return float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())


def _parameter_changes(choices: Sequence[schema.ChangeChoice], platform: Platform) -> list[Change]:
    """Changes in order of time; factors multiply the values just before."""
    changes = []
    for choice in sorted(choices, key=lambda choice: choice.at):
        values = dict(choice.parameters)
        for name, factor in choice.factors.items():
            if name in values:
                raise PlatformError(name, "is in parameters and in factors; expected it in one of them")
            values[name] = np.asarray(getattr(platform, name, np.nan)) * factor
        values = by_leg(values)
        tunable = [v.name for v in Variant.of(platform).tunable]
        for name in values:
            if name not in tunable:
                raise PlatformError(name, f"cannot change during a run{nearest(name, tunable)}")
        platform = platform.with_parameters(values)
        changes.append(Change(choice.at, {name: getattr(platform, name) for name in values}))
    return changes


def _active(
    spans: Sequence[tuple[float, float, FloatArray]], timing: Timing, kind: str
) -> list[tuple[float, list[FloatArray]]]:
    """Every time at which a span (begin, end, value) begins or ends, with the values of those that are active then."""
    rows = set[int]()
    for begin, end, _ in spans:
        rows.add(timing.row(begin, f"a {kind}"))
        if end - begin < 0.5 * timing.plant_step:
            raise ControllerError(
                f"a {kind} of {end - begin:g} s at {begin:g} s; expected at least the plant_step of "
                f"{timing.plant_step:g} s"
            )
        if end < timing.duration:
            rows.add(timing.row(end, f"the end of a {kind}"))
    # half a plant step later, so that rounding does not confuse begin and end
    aside = timing.plant_step / 2
    return [
        (time, [value for begin, end, value in spans if begin < time + aside < end])
        for time in timing.times[sorted(rows)].tolist()
    ]

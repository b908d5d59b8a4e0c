"""From an experiment's tables to what runs: everything is checked, for one run or for many members that differ.

What members have in common, such as a planned motion, is computed once and shared: a stage is made once for the same
parts. A single run is one member.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough_stewart.harness.control.by_hand import HandMotion
from gough_stewart.harness.control.controllers import ControllerChoice, Feedforward, feedforward
from gough_stewart.harness.control.faults import N_FAULTS, FaultChoice
from gough_stewart.harness.control.frequency_response import InjectionChoice
from gough_stewart.harness.control.laws import Controller, LinearController, controller_of, linear_of
from gough_stewart.harness.control.laws_of_members import KnownAhead, Law, LawFrom, SeparateLaws, law_of, laws_of
from gough_stewart.harness.control.own_law import LinearForm, linearised
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.overrides import Values, by_table, table_with
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.libraries import are_traced, loop_kernel
from gough_stewart.harness.loop.loop import (
    Actuators,
    Change,
    Limits,
    Loop,
    LoopSettings,
    Sensors,
    changes_of_members,
    stroke_of,
)
from gough_stewart.harness.loop.timing import Seed, Seeds, Timing, as_numbers
from gough_stewart.harness.motion.limits.reach import LegMotion, WhenBeyond, check_reach, jacobians_of, legs_of
from gough_stewart.harness.motion.motion import Motion, Reference, centre_of, end_of
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.plants.lanes import CompiledLanes, LanesPlant, Stepping
from gough_stewart.harness.plants.members import PerMember, of_legs, stacked
from gough_stewart.harness.plants.signals import VARIABLES
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import GoughStewartError, PlatformError, SingularPoseError
from gough_stewart.model.interface import CHOOSING, SMOOTH, Variant, nearest
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import (
    Platform,
    Platforms,
    load_platform,
    load_preset,
    platforms_with,
)
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.platform_joints import CIRCLE_KEYS, joints_of_keys
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray, real_array

T = TypeVar("T")
Injection = Callable[[float], ArrayLike]

# Size of the plant's vectors: a member's bits do not depend on the others if all vectors are full.
LANES = 8
# More results of a stage are not kept for the next members, since they were always different.
_REPEATED = 16
# The largest plausible noise or quantisation: this share of a leg [m] or of a radian, within this time for rates [s].
_SHARE = 0.05
_TIME = 0.1
_NO_JACOBIANS = np.zeros((0, 6, 6))
_PLAIN = frozenset((str, int, float, bool, type(None)))


class Planned(NamedTuple):
    """What is planned from a reference."""

    reference: Reference  # the motion at any time
    motion: Motion  # at every row
    legs: LegMotion  # leg lengths and velocities at every row
    signals: FloatArray  # and accelerations, at every row (n, 30)
    jacobians: FloatArray  # leg Jacobians at every sample (m, 6, 6)
    home_leg_length: float  # mean of the legs in the home pose [m]
    warnings: tuple[str, ...]  # limits exceeded with permission


@dataclass(frozen=True, eq=False)
class Setup:
    """What members share that differ only in their machine and in their sensors."""

    timing: Timing  # with their jitter
    platform: Platform  # the nominal model
    start: State
    planned: Planned | None
    controller: Controller | None
    feedforward: FloatArray  # at every sample (m, 6) [N]
    injection: FloatArray | None
    actuators: Actuators
    limits: Limits
    gains: Mapping[str, Any]  # that a controller in Python is told
    turned: tuple[Change, ...] = ()  # of the loop's settings

    @property
    def known(self) -> KnownAhead:
        """What a loop tells a controller in Python."""
        planned = self.feedforward if self.injection is None else self.feedforward + self.injection
        drives = self.actuators
        # the least of legs that differ
        force_limit, rate_limit = (
            np.inf if most is None else float(np.min(most)) for most in (drives.force_limit, drives.rate_limit)
        )
        before = self.platform, self.timing.sample_time, self.feedforward, planned
        return KnownAhead(*before, force_limit, rate_limit, self.gains)


@dataclass(frozen=True)
class Prepared:
    """An experiment that is ready to run."""

    platform: Platform  # the nominal model: for gains, references, Jacobians, feedforward, limits
    machine: Platform  # the simulated platform
    start: State
    loop: Loop
    motion: Motion | None  # the reference at every row
    legs: LegMotion | None  # its leg lengths and velocities
    controller: Controller | None  # the maker of one for each run, if it has memory; None for feedforward alone
    known: KnownAhead  # what the loop tells a controller in Python
    jacobians: FloatArray  # leg Jacobians of the reference at every sample (m, 6, 6)
    warnings: tuple[str, ...] = ()  # limits exceeded with permission, hints at the platform
    reference: Reference | None = None  # the motion at any time

    @property
    def kernel(self) -> CompiledLanes | None:
        """What runs its loop in machine code, if it can: with a linear or traced controller, or feedforward alone."""
        return loop_kernel(Variant.of(self.machine)) if _runs_in_c([self.controller]) else None

    def law(self, reference: FloatArray, measured: FloatArray) -> Law:
        """The control law for a run of one member that begins with these references (30,) and signals (1, 24)."""
        if self.controller is None:
            raise ControllerError("an open loop has no control law")
        make = law_of(self.controller, self.loop.timing.sample_time, self.jacobians, self.known)
        return make(reference, measured)

    def linear_form(self) -> LinearForm | None:
        """The linear controller, or the small signals of another at rest in the first pose; None of loops without.

        Raises
        ------
        ControllerError
            It fails there, or does not answer to the measurements.
        """
        linear = linear_of(self.controller)
        if linear is not None:
            return LinearForm(linear)
        if self.controller is None or isinstance(self.controller, UnitController) or self.loop.reference is None:
            return None
        return linearised(self.controller, self.known, self.loop.reference[0])

    @contextmanager
    def law_in_a_run(self) -> Iterator[LawFrom | None]:
        """The factory of the control law; resources are closed at the end."""
        if isinstance(self.controller, UnitController):
            with self.controller.open(self.loop.timing.sample_time) as law:
                yield lambda _reference, _measured: SeparateLaws([law])
        else:
            yield None if self.controller is None else self.law


class InParallel(NamedTuple):
    """One plant and one loop for members, followed by copies of the last one up to a whole number of vectors."""

    plant: LanesPlant
    law_from: LawFrom | None
    loop: Loop
    size: int  # including the copies


@dataclass(frozen=True, eq=False)
class Batch:
    """N members of an experiment that are ready to run; what is equal is the same object."""

    setups: Sequence[Setup]
    machines: Platforms
    sensors: Sequence[Sensors]
    changes: Sequence[tuple[Change, ...]]
    seeds: Sequence[Seed]  # of noise and jitter
    start_force: FloatArray  # (N, 6)

    def __len__(self) -> int:
        """N."""
        return len(self.setups)

    def take(self, members: Sequence[int] | NDArray[np.intp]) -> "Batch":
        """Some of them, in the order of their indices."""
        at = np.asarray(members, dtype=np.intp)
        setups, sensors, changes, seeds = (
            [values[k] for k in at.tolist()] for values in (self.setups, self.sensors, self.changes, self.seeds)
        )
        return Batch(setups, self.machines[at], sensors, changes, seeds, self.start_force[at])

    def member(self, k: int) -> Prepared:
        """One of them alone."""
        setup, planned = self.setups[k], self.setups[k].planned
        return Prepared(
            platform=setup.platform,
            machine=self.machines[k],
            start=setup.start,
            loop=self.take([k]).loop,
            motion=planned and planned.motion,
            legs=planned and planned.legs,
            controller=setup.controller,
            known=setup.known,
            jacobians=planned.jacobians if planned else _NO_JACOBIANS,
            warnings=planned.warnings if planned else (),
            reference=planned and planned.reference,
        )

    @property
    def timing(self) -> Timing:
        """The clocks, which are the same but for the members' jitter."""
        return replace(self.setups[0].timing, jitter=0.0)

    @property
    def loop(self) -> Loop:
        """The loop of all; of one member alone without a member axis."""
        setups, sensors = self.setups, self.sensors
        timing, actuators = setups[0].timing, [setup.actuators for setup in setups]
        limits, planned = [setup.limits for setup in setups], [setup.planned for setup in setups]

        def seeds(are_random: Sequence[bool], common: Seeds) -> Seeds:
            """Of each member, the common one of those without random numbers; one if all are the same."""
            of_members = [seed if draws else common for seed, draws in zip(self.seeds, are_random, strict=True)]
            first = as_numbers(of_members[0])
            is_one = not any(are_random) or all(as_numbers(seed) == first for seed in of_members)
            return of_members[0] if is_one else tuple(of_members)  # type: ignore[arg-type]

        def by_signal(sizes: Sequence[Mapping[str, PerMember]]) -> dict[str, PerMember]:
            names = dict.fromkeys(name for size in sizes for name in size)
            return {name: one_or_each([size.get(name, 0.0) for size in sizes]) for name in names}

        return Loop(
            timing=replace(
                timing,
                jitter=one_or_each([setup.timing.jitter for setup in setups]),
                seed=seeds([bool(setup.timing.jitter) for setup in setups], timing.seed),
            ),
            reference=one_or_stacked([plan and plan.signals for plan in planned]),
            feedforward=one_or_stacked([setup.feedforward for setup in setups]),
            start_force=self.start_force[0] if len(setups) == 1 else self.start_force,
            sensors=Sensors(
                by_signal([sensor.noise for sensor in sensors]),
                by_signal([sensor.quantisation for sensor in sensors]),
                sensors[0].sample_time,
                seeds([any(sensor.noise.values()) for sensor in sensors], sensors[0].seed),
                sensors[0].side,
            ),
            actuators=Actuators(
                one_or_each([drive.force_limit for drive in actuators], np.inf),
                one_or_each([drive.rate_limit for drive in actuators], np.inf),
                one_or_each([drive.lag for drive in actuators]),
                one_or_each([drive.delay for drive in actuators]),
            ),
            limits=Limits(
                (one_or_each([ends.stroke[0] for ends in limits]), one_or_each([ends.stroke[1] for ends in limits])),
                limits[0].on_stroke,
                one_or_each([ends.largest_position_error for ends in limits]),
            ),
            changes=changes_of_members(self.changes, timing),
            injection=one_or_stacked([setup.injection for setup in setups]),
            shape=() if len(setups) == 1 else (len(setups),),
        )

    def in_parallel(self, stepping: Stepping) -> InParallel:
        """All of them as one plant and one loop.

        Raises
        ------
        ControllerError
            Members that cannot run in parallel; names the difference.
        BuildError, OSError
            There is no machine code of the loop, see `loop_kernel`.
        """
        n, controllers = len(self.setups), [setup.controller for setup in self.setups]
        copies = (
            0 if _runs_in_c(list({id(controller): controller for controller in controllers}.values())) else -n % LANES
        )
        filled = self.take([*range(n), *[n - 1] * copies])
        starts, kernel = [setup.start for setup in filled.setups], loop_kernel(Variant.of(self.machines[0]))
        plant, law_from = LanesPlant(filled.machines, starts, **stepping._asdict(), kernel=kernel), None
        closed = [controller for controller in controllers if controller is not None]
        if closed:
            plans = [setup.planned for setup in filled.setups]
            # one view of each array, by which members that share it are known
            views = {id(plan): (plan.jacobians if plan else _NO_JACOBIANS).reshape(-1, 36) for plan in plans}
            flat = one_or_stacked([views[id(plan)] for plan in plans])
            jacobians = flat.reshape(*flat.shape[:-1], 6, 6)
            known = [setup.known for setup in self.setups]
            law_from = laws_of(closed, self.setups[0].timing.sample_time, jacobians, known, copies)
        return InParallel(plant, law_from, filled.loop, len(filled))


def _structure(controller: Any) -> tuple[Any, ...]:
    """What stays of a linear controller while its gains change."""
    if controller is None:
        return ()
    return controller.space, controller.signals, controller.kinds, controller.system.nstates


def _runs_in_c(controllers: Sequence[Controller | None]) -> bool:
    is_linear = all(controller is None or isinstance(controller, LinearController) for controller in controllers)
    return is_linear or are_traced(controllers)


def one_or_each(numbers: Sequence[Any], none: float = np.nan) -> PerMember:
    """The number that all members have, or that of each in an array (N,), with `none` instead of None.

    Of legs that differ (1, 6) or (N, 6).
    """
    if any(isinstance(number, np.ndarray) for number in numbers):
        rows = np.array([np.broadcast_to(none if number is None else number, 6) for number in numbers], dtype=float)
        return rows[:1] if (rows == rows[0]).all() else rows
    if all(number == numbers[0] for number in numbers):
        return numbers[0]
    return np.array([none if number is None else number for number in numbers])


def one_or_stacked(arrays: Sequence[FloatArray | None]) -> Any:
    """The array (..., size) that all members have, or None; or that of each (..., N, size)."""
    distinct = {id(array): array for array in arrays}
    if all(np.array_equal(array, arrays[0]) for array in distinct.values()):  # type: ignore[arg-type]
        return arrays[0]
    if 4 * len(distinct) > len(arrays):
        return stacked(arrays)
    places = {key: k for k, key in enumerate(distinct)}
    kinds, place = np.stack(list(distinct.values()), axis=-1), [places[id(array)] for array in arrays]  # type: ignore[arg-type]
    return np.moveaxis(np.take(kinds, place, axis=-1), -1, -2)


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


class _Believed(NamedTuple):
    """What an experiment's tables say, for members with the same ones but for sensors and machine."""

    tables: dict[str, Any]  # by name
    platform: Platform  # the nominal model
    machine_base: Platform  # whose parameters those of the machine replace


class Preparation:
    """Prepares members of an experiment that differ in their values; those before often had the same ones.

    Parameters
    ----------
    controller
        Replaces the experiment's, as in `prepare`.
    """

    def __init__(self, experiment: Experiment, controller: Any = None) -> None:
        self.experiment, self.controller, self._where = experiment, controller, experiment.where
        # results of stages, and the parts that they were made from, by the identity of these
        self._known = dict[str, dict[tuple[object, ...], tuple[Sequence[object], Any]]]()

    def _once(self, stage: Callable[..., T], *parts: Any) -> T:
        """The result of a stage for these parts, or its error, of which each is made once."""
        results = self._known.setdefault(stage.__name__, {})
        # numbers and texts themselves, of settings their values, of other objects which one it is
        key = tuple(
            (type(part), part) if type(part) in _PLAIN else repr(part) if isinstance(part, dict) else id(part)
            for part in parts
        )
        if key not in results:
            try:
                results[key] = parts, stage(*parts)
            except GoughStewartError as error:
                results[key] = parts, error
        result: T = results[key][1]
        if isinstance(result, GoughStewartError):
            raise result
        return result

    def members(  # noqa: PLR0915 - one road, in sections
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
        experiment, where, errors = self.experiment, self._where, dict[int, GoughStewartError]()
        if seeds is not None and any(change.has_settings for change in experiment.change):
            text = (
                "settings of the loop change during the run, which members of an ensemble cannot; expected parameters"
            )
            raise ExperimentError(where, "change", text)
        candidates, believed = list[int](), list[_Believed]()
        of_machines, sensors = list[dict[str, Any]](), list[Sensors]()

        # tables, the believed platform, and the one whose parameters those of the machine replace
        for k, member in enumerate(values):
            changed = by_table(member)
            of_machine, of_sensors = changed.pop("plant", {}), changed.pop("sensors", {})
            try:
                belief = self._once(self._believed, changed)
                readings = self._once(self._sensors, of_sensors)
            except GoughStewartError as error:
                errors[k] = error
                continue
            candidates.append(k)
            believed.append(belief)
            sensors.append(readings)
            parameters = {path[-1]: value for path, value in of_machine.items()}
            of_machines.append({**experiment.plant.parameters, **parameters})

        # machines, for all at once
        distinct = {id(belief.machine_base): belief.machine_base for belief in believed}
        places = {key: place for place, key in enumerate(distinct)}
        base_of = np.array([places[id(belief.machine_base)] for belief in believed], dtype=np.intp)
        machines = Platforms(list(distinct.values()), base_of)
        if any(of_machines):
            machines, impossible = platforms_with(list(distinct.values()), base_of, of_machines)
            errors |= {candidates[at]: ExperimentError(where, "plant", str(error)) for at, error in impossible.items()}
        if candidates and any(path[-1] in CHOOSING for member in values for path in member):
            self._refuse_other_variants(machines, candidates, errors)

        # everything else
        ready, setups, changes = list[int](), list[Setup](), list[tuple[Change, ...]]()
        has_changes = experiment.change or experiment.disturbance or experiment.fault
        for at, k in enumerate(candidates):
            if k in errors:
                continue
            try:
                setup = self._once(self._setup, believed[at], injection)
                changing = [believed[at].tables[name] for name in ("change", "disturbance", "fault")]
                machine = machines[at] if changing[0] else None
                of_machine_and_load = self._once(self._changes, *changing, machine) if has_changes else ()
                changes.append(of_machine_and_load + setup.turned)
            except GoughStewartError as error:
                errors[k] = error
                continue
            setups.append(setup)
            ready.append(at)

        # forces before the first command: of an open loop its own, else those that hold the machine at rest
        of_ready = np.array(ready, dtype=np.intp)
        numbers, machines, n = np.array(candidates, dtype=np.intp)[of_ready], machines[of_ready], len(ready)
        forces = np.array([setup.feedforward[0] for setup in setups]).reshape(n, 6)
        if closed := [at for at in range(n) if setups[at].controller is not None]:
            position = np.stack([setups[at].start.position for at in closed])
            orientation = np.stack([setups[at].start.orientation for at in closed])
            try:
                forces[closed] = static_leg_forces(machines[np.array(closed)].parameters, position, orientation)
            except SingularPoseError:
                for at in closed:
                    start = setups[at].start
                    try:
                        forces[at] = static_leg_forces(machines[at], start.position, start.orientation)
                    except SingularPoseError as error:
                        errors[int(numbers[at])] = error
        limits = [np.inf if (most := setup.actuators.force_limit) is None else most for setup in setups]
        limit = of_legs(one_or_each(limits)).T if limits else np.inf

        self._known = {name: results for name, results in self._known.items() if len(results) <= _REPEATED}
        common = experiment.sensors.seed
        batch = Batch(
            setups=setups,
            machines=machines,
            sensors=[sensors[at] for at in ready],
            changes=changes,
            seeds=[seeds[k] if seeds else common for k in numbers.tolist()],
            start_force=np.clip(forces, -limit, limit),
        )
        possible = np.array([at for at in range(n) if int(numbers[at]) not in errors], dtype=np.intp)
        return PreparedMembers(numbers[possible], batch.take(possible), errors, where)

    def _believed(self, changed: Mapping[str, Values]) -> _Believed:
        experiment = self.experiment
        tables = {name: self._once(table_with, experiment, name, values) for name, values in changed.items()}
        tables = dict(experiment) | tables
        nominal = self._once(nominal_platform, experiment, tables["platform"])
        if experiment.plant.file is None:
            return _Believed(tables, nominal, nominal)
        with part_of(experiment.where, "plant"):
            return _Believed(tables, nominal, self._once(load_platform, str(experiment.folder / experiment.plant.file)))

    def _sensors(self, changed: Values) -> Sensors:
        return Sensors(**dict(table_with(self.experiment, "sensors", changed) if changed else self.experiment.sensors))

    def _setup(self, believed: _Believed, injection: Injection | None) -> Setup:
        """Everything of a member but its machine and its sensors."""
        where, once = self._where, self._once
        tables, platform, _ = believed
        loop, drives, limits, choice = (tables[name] for name in ("loop", "actuators", "limits", "controller"))
        reference = tables["reference"]
        is_closed = self.controller is not None or choice.is_closed

        # clocks, and the motion in rows of clocks that all members have, within the force limit of the actuators
        timing = once(timing_of, self.experiment, loop)
        limited = once(limited_platform, platform, drives.force_limit)
        is_needed = is_closed or choice.feedforward != "none"
        if reference is None and is_needed:
            raise ExperimentError(where, "reference", "is missing; a controller needs one, for instance type = 'hold'")
        within = limits.condition_number, limits.reference
        planned = None if reference is None else once(self._planned, reference, limited, *within)

        # the controller, and what is known of its forces in advance; an FMU that replaces it contains its feedforward
        forces = once(self._feedforward, choice.feedforward, loop.delay, platform, planned)
        controller = once(self._controller, choice, platform)
        if isinstance(controller, UnitController) and not loop.delay:
            raise ExperimentError(
                where,
                "controller",
                f"{controller.path} outputs the forces of a sample after a step over it; expected a loop.delay "
                "of at least 1, for instance by --set loop.delay=1",
            )
        if self.controller is None:
            forces = choice.planned(forces)
        elif isinstance(controller, UnitController):
            forces = np.zeros_like(forces)

        # changes of the loop's settings at their samples, and the feedforward with them
        turned = list[Change]()
        choices = sorted((change for change in tables["change"] if change.has_settings), key=lambda change: change.at)
        with part_of(where, "change"):
            if choices and (self.controller is not None or not isinstance(controller, LinearController | None)):
                raise ControllerError("settings of the loop change, which only those of linear controllers can")
            forces = forces.copy() if choices else forces
            law_choice, sensors, delay, force_limit = choice, tables["sensors"], loop.delay, drives.force_limit
            for change in choices:
                sample = -(-timing.row(change.at, "a change") // timing.steps_a_sample)
                new = {name: getattr(change, name) for name in ("noise", "quantisation")}
                sensors = sensors.model_copy(update={name: size for name, size in new.items() if size is not None})
                law_choice, force_limit = change.controller or law_choice, change.force_limit or force_limit
                delay = delay if change.delay is None else change.delay
                law = self._controller(law_choice, platform)
                if _structure(law) != _structure(controller):
                    raise ControllerError(
                        f"controller at {change.at:g} s has the structure {_structure(law)}; expected that of the "
                        f"experiment's, {_structure(controller)}"
                    )
                most = one_or_each([limited_platform(platform, force_limit).actuator_force_max])
                actuators = Actuators(most, drives.rate_limit, drives.lag, delay)
                settings = LoopSettings(getattr(law, "system", None), Sensors(**dict(sensors)), actuators)
                turned.append(Change(sample * timing.sample_time, settings=settings))
                ahead = self._feedforward(law_choice.feedforward, delay, platform, planned)
                forces[sample:] = law_choice.planned(ahead)[sample:]

        # what ends a run: an open loop only leaves its stroke; at a distance of a leg length, control is lost
        bound = limits.position_error
        if bound is None:
            bound = planned.home_leg_length if planned is not None and is_closed else math.inf
        stroke = stroke_of(platform.leg_length_min, platform.leg_length_max)
        return Setup(
            timing=timing,
            platform=platform,
            start=once(self._start, tables["start"], platform, planned),
            planned=planned,
            controller=controller,
            feedforward=forces,
            injection=once(self._injection, tables["injection"], platform, planned, injection),
            actuators=Actuators(limited.actuator_force_max, drives.rate_limit, drives.lag, loop.delay),
            limits=Limits(stroke, self.experiment.limits.stroke, bound),
            turned=tuple(change for change in turned if change.time < timing.duration),
            gains=MappingProxyType(choice.design(platform, timing.sample_time).parameters),
        )

    @cached_property
    def _timing(self) -> Timing:
        """The clocks of all members, without jitter."""
        return timing_of(self.experiment, self.experiment.loop.model_copy(update={"jitter": 0.0, "delay": 0}))

    # Stages: each is made once for the same parts.

    def _planned(
        self, choice: ReferenceChoice, limited: Platform, condition_number: float, when_beyond: WhenBeyond
    ) -> Planned:
        """The reference motion, which the platform can follow, and what the loop reads at rows and samples."""
        timing = self._timing
        reference, motion = reference_motion(self.experiment, choice, limited, timing)
        with part_of(self._where, "reference"):
            centre = centre_of(reference)
            is_by_hand = isinstance(reference, HandMotion)  # nobody has planned it
            beyond: dict[str, WhenBeyond] = {"dynamic": "warn" if is_by_hand else when_beyond}
            beyond["geometric"] = "warn" if is_by_hand else "refuse"
            exceeded = check_reach(limited, timing.times, motion, condition_number, centre=centre, **beyond)
            legs = legs_of(limited, motion)
            signals = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
            at = slice(0, timing.steps, timing.steps_a_sample)
            jacobians = jacobians_of(limited, Motion(*(part[at] for part in motion)))
            home = leg_geometry(limited, limited.home_position, limited.home_orientation)
            return Planned(reference, motion, legs, signals, jacobians, float(home.length.mean()), tuple(exceeded))

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
        ahead, reference = (delay + 0.5) * self._timing.sample_time, planned.reference
        if isinstance(reference, HandMotion):
            motion = reference.foreseen(samples, ahead)
        else:
            motion = reference(np.minimum(samples + ahead, end_of(reference)))
        return feedforward(kind, platform, motion)

    def _controller(self, choice: ControllerChoice, platform: Platform) -> Controller | None:
        """The controller that replaces the experiment's, or the experiment's."""
        sample_time = self._timing.sample_time
        with part_of(self._where, "controller"):
            if self.controller is None:
                return choice.controller(platform, sample_time, self.experiment.folder)
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

    def _refuse_other_variants(
        self, machines: Platforms, numbers: Sequence[int], errors: dict[int, GoughStewartError]
    ) -> None:
        """Fail members whose machine has other states than the experiment's: one vector steps several members."""
        try:
            variant = Variant.of(platforms_of(self.experiment)[1])
        except GoughStewartError:
            return
        sticks, gives = machines.field("leg_friction_model") != SMOOTH, machines.field("leg_stiffness") > 0
        for name, differing, differs in (
            ("leg_friction_model", replace(variant, bristles=not variant.bristles), sticks != variant.bristles),
            ("leg_stiffness", replace(variant, springs=not variant.springs), gives != variant.springs),
        ):
            for at in np.flatnonzero(differs).tolist():
                text = (
                    f"{name}: gives a member {differing.words.removeprefix('with ')}, and the experiment's machine has "
                    f"{variant.words.removeprefix('with ')}; expected one kind in all members: run the others as an "
                    "experiment of their own"
                )
                errors.setdefault(numbers[at], ExperimentError(self._where, "plant", text))


def nominal_platform(experiment: Experiment, choice: schema.PlatformChoice) -> Platform:
    """The platform that the designer believes in."""
    with part_of(experiment.where, "platform"):
        file = choice.file
        platform = load_preset(choice.preset_name) if file is None else load_platform(experiment.folder / file)
        circles = {key: value for key in CIRCLE_KEYS if (value := getattr(choice, key)) is not None}
        parameters = joints_of_keys(circles) | choice.parameters
        return platform.with_parameters(parameters) if parameters else platform


def platforms_of(experiment: Experiment) -> tuple[Platform, Platform]:
    """The nominal model, and the machine.

    Raises
    ------
    ExperimentError
        An invalid one.
    """
    _, nominal, base = Preparation(experiment)._believed({})
    parameters = experiment.plant.parameters
    with part_of(experiment.where, "plant"):
        return nominal, base.with_parameters(parameters) if parameters else base


def limited_platform(platform: Platform, force_limit: float | str) -> Platform:
    """The nominal model with the force limit of the actuators [N], its own for "platform": no motion may use more."""
    if force_limit == "platform":
        return platform
    return platform.with_parameters({"actuator_force_max": None if force_limit == "none" else float(force_limit)})


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

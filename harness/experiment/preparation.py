"""From an experiment's tables to what runs, for N members that differ in some values; a single run is one member.

What members have in common, such as a planned motion, is made once for the same parts, and shared.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import ArrayLike, NDArray

from gough_stewart.harness.control.by_hand import HandMotion
from gough_stewart.harness.control.component import N_FAULTS, FaultChoice
from gough_stewart.harness.control.controllers import ControllerChoice, Feedforward
from gough_stewart.harness.control.frequency_response import InjectionChoice
from gough_stewart.harness.control.laws_of_members import KnownAhead, LawFrom, SeparateLaws, laws_of
from gough_stewart.harness.control.linear_controller import Controller, LinearController, controller_of, linear_of
from gough_stewart.harness.control.own_law import LinearForm, linearised
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.overrides import Values, by_table, table_with
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.libraries import are_compiled, loop_kernel
from gough_stewart.harness.loop.loop import (
    Actuators,
    Change,
    Limits,
    Loop,
    LoopSettings,
    Seeds,
    Sensors,
    Timing,
    changes_of_members,
)
from gough_stewart.harness.motion.limits.reach import LegMotion, WhenBeyond, check_reach, legs_of
from gough_stewart.harness.motion.motion import Motion, Reference, distinct_rows
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.harness.plants.lanes import BatchPlant, Stepping
from gough_stewart.harness.plants.signals import VARIABLES, PerMember, of_legs, stacked
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics, static_leg_forces
from gough_stewart.model.errors import GoughStewartError, PlatformError, SingularPoseError
from gough_stewart.model.formulations.cases import PAPER_PRESET
from gough_stewart.model.interface import CHOOSING, SMOOTH, State, Variant, nearest
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import (
    CIRCLE_KEYS,
    Platform,
    Platforms,
    joints_of_keys,
    load_platform,
    load_preset,
    platforms_with,
)
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.rotations import nearest_angle
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
_PLAIN = frozenset((str, int, float, bool, type(None)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Planned:
    """What is planned from a reference, if there is one."""

    reference: Reference | None = None  # the motion at any time
    motion: Motion | None = None  # at every row
    # position and orientation in the first row, where loops are linearised
    pose: tuple[FloatArray, FloatArray] = (np.zeros(3), np.zeros(3))
    legs: LegMotion | None = None  # leg lengths and velocities at every row
    mean_length: float = 0.0  # of the legs at home [m]
    signals: FloatArray | None = None  # and accelerations, at every row (n, 30)
    jacobians: FloatArray = field(default_factory=lambda: np.zeros((0, 6, 6)))  # of the legs at every sample (m, 6, 6)
    # limits exceeded with permission; of an experiment that is prepared alone also hints at it
    warnings: tuple[str, ...] = ()


_UNPLANNED = Planned()


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup(Planned):
    """What members share that differ only in their machine and in their sensors."""

    timing: Timing  # with their jitter
    platform: Platform  # the nominal model: for gains, references, Jacobians, feedforward, limits
    start: State
    controller: Controller | None  # the maker of one for each run, if it has memory; None for feedforward alone
    known: KnownAhead  # what the loop tells a controller in Python, with the feedforward
    injection: FloatArray | None  # at every sample (m, 6) [N]
    actuators: Actuators
    limits: Limits
    turned: tuple[Change, ...]  # of the loop's settings


@dataclass(frozen=True, eq=False, kw_only=True)
class Prepared(Setup):
    """An experiment that is ready to run."""

    machine: Platform  # the simulated platform
    loop: Loop

    @contextmanager
    def law_in_a_run(self) -> Iterator[LawFrom | None]:
        """The factory of the control law, None of an open loop; resources are closed at the end."""
        sample_time = self.loop.timing.sample_time
        if isinstance(self.controller, UnitController):
            with closing(self.controller.open(sample_time)) as law:
                yield lambda _reference, _measured: SeparateLaws([law])
        elif self.controller is None:
            yield None
        else:
            yield laws_of([self.controller], sample_time, self.jacobians, [self.known])

    def linear_form(self) -> LinearForm | None:
        """The linear controller, or the small signals of another at rest in the first pose; None of loops without."""
        linear = linear_of(self.controller)
        if linear is not None:
            return LinearForm(linear)
        if self.controller is None or isinstance(self.controller, UnitController) or self.loop.reference is None:
            return None
        return linearised(self.controller, self.known, self.loop.reference[0])


class InParallel(NamedTuple):
    """One plant and one loop for members, followed by copies of the last one up to a whole number of vectors."""

    plant: BatchPlant
    law_from: LawFrom | None
    loop: Loop
    size: int  # including the copies


@dataclass(frozen=True, eq=False)
class Batch:
    """The members of an experiment that are ready to run, and why others are not; what is equal is the same object."""

    where: str  # file or name of the experiment
    numbers: NDArray[np.intp]  # of those that are ready (N,), among all
    errors: dict[int, GoughStewartError]  # of the others
    setups: Sequence[Setup]
    machines: Platforms
    sensors: Sequence[Sensors]
    changes: Sequence[tuple[Change, ...]]
    seed: int  # of the members' own noise and jitter
    streams: Sequence[int | None]  # of it, by the members' numbers; None for noise and jitter of the sensors' seed
    start_force: FloatArray  # (N, 6)

    def __len__(self) -> int:
        """N."""
        return len(self.setups)

    @property
    def reasons(self) -> dict[int, str]:
        """Why others are not ready."""
        return {k: str(self.errors[k]).removeprefix(f"{self.where}: ") for k in sorted(self.errors)}

    def take(self, members: Sequence[int] | NDArray[np.intp]) -> "Batch":
        """Some of them, in the order of their indices."""
        at = np.asarray(members, dtype=np.intp)
        parts = dict[str, Any](numbers=self.numbers[at], machines=self.machines[at], start_force=self.start_force[at])
        for name in ("setups", "sensors", "changes", "streams"):
            parts[name] = [getattr(self, name)[k] for k in at.tolist()]
        return replace(self, **parts)

    def member(self, k: int, hints_at: Experiment | None = None) -> Prepared:
        """One of them alone; its warnings are also of what is possible in an experiment but hardly meant.

        Legs that nearly touch, joints in a bad order, a motion after the end, coarse sensors, faults that change
        nothing.
        """
        setup, alone = self.setups[k], self if len(self.setups) == 1 else self.take([k])
        prepared = Prepared(**vars(setup), machine=self.machines[k], loop=alone.loop)
        if hints_at is None:
            return prepared
        platform, hints = setup.platform, list[str]()
        length = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
        scales = {"m": length, "rad": 1.0, "m/s": length / _TIME, "rad/s": 1.0 / _TIME}
        for kind in ("noise", "quantisation"):
            for variable in VARIABLES:
                value, scale = getattr(hints_at.sensors, kind).get(variable.name) or 0.0, scales[variable.unit]
                if value > _SHARE * scale:
                    hints.append(
                        f"sensors.{kind}.{variable.name} is {value:g} {variable.unit}, {value / scale:.3g} of the "
                        f"platform's scale of {scale:.3g} {variable.unit}; check its unit"
                    )
        read: Any = () if setup.controller is None else getattr(setup.controller, "signals", None)
        for number, fault in enumerate(hints_at.fault if read is not None else (), 1):
            hints += [
                f"fault.{number}.freeze.{name}: nobody reads {name}, so this changes nothing; the controller reads "
                f"{' and '.join(read) or 'no sensor'}"
                for name in fault.freeze
                if name not in read
            ]
        return replace(prepared, warnings=(*setup.warnings, *platform.hints, *too_late(hints_at), *hints))

    @property
    def timing(self) -> Timing:
        """The clocks, which are the same but for the members' jitter."""
        return replace(self.setups[0].timing, jitter=0.0)

    @property
    def loop(self) -> Loop:
        """The loop of all; of one member alone without a member axis."""
        setups, sensors, timing = self.setups, self.sensors, self.setups[0].timing
        limits, jitter = [setup.limits for setup in setups], [setup.timing.jitter for setup in setups]
        # noise and quantisation by signal
        sizes = dict[str, dict[str, PerMember]]()
        for kind in ("noise", "quantisation"):
            of_sensors = [getattr(sensor, kind) for sensor in sensors]
            names = dict.fromkeys(name for by_signal in of_sensors for name in by_signal)
            sizes[kind] = {name: one_or_each([by_signal.get(name, 0.0) for by_signal in of_sensors]) for name in names}
        # seeds of jitter and noise: the common one of members without random numbers, and only one if all are the same
        seeds = list[Seeds]()
        for are_random in ([bool(late) for late in jitter], [any(sensor.noise.values()) for sensor in sensors]):
            streams = [stream if draws else None for stream, draws in zip(self.streams, are_random, strict=True)]
            of_members: list[Any] = [
                sensors[0].seed if stream is None else SeedSequence(self.seed, spawn_key=(stream,))
                for stream in (streams if len(set(streams)) > 1 else streams[:1])
            ]
            seeds.append(tuple(of_members) if len(of_members) > 1 else of_members[0])
        return Loop(
            timing=replace(timing, jitter=one_or_each(jitter), seed=seeds[0]),
            reference=one_or_stacked([setup.signals for setup in setups]),
            feedforward=one_or_stacked([setup.known.feedforward for setup in setups]),
            start_force=self.start_force[0] if len(setups) == 1 else self.start_force,
            sensors=Sensors(**sizes, sample_time=sensors[0].sample_time, seed=seeds[1], side=sensors[0].side),
            actuators=Actuators(
                *(
                    one_or_each([getattr(setup.actuators, name) for setup in setups], np.inf)
                    for name in ("force_limit", "rate_limit", "lag", "delay")
                )
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
        """All of them as one plant and one loop; refuses controllers of different structure."""
        n, controllers = len(self.setups), [setup.controller for setup in self.setups]
        in_c = are_compiled(list({id(controller): controller for controller in controllers}.values()))
        copies = 0 if in_c else -n % LANES
        filled = self.take([*range(n), *[n - 1] * copies])
        starts, kernel = [setup.start for setup in filled.setups], loop_kernel(Variant.of(self.machines[0]))
        plant, law_from = BatchPlant(filled.machines, starts, **stepping._asdict(), kernel=kernel), None
        if closed := [controller for controller in controllers if controller is not None]:
            # one view of each array, by which members that share it are known
            views = {id(setup.jacobians): setup.jacobians.reshape(-1, 36) for setup in filled.setups}
            flat = one_or_stacked([views[id(setup.jacobians)] for setup in filled.setups])
            known, jacobians = [setup.known for setup in self.setups], flat.reshape(*flat.shape[:-1], 6, 6)
            law_from = laws_of(closed, self.setups[0].timing.sample_time, jacobians, known, copies)
        return InParallel(plant, law_from, filled.loop, len(starts))


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
    distinct: dict[int, Any] = {id(array): array for array in arrays}
    if all(np.array_equal(array, arrays[0]) for array in distinct.values()):  # type: ignore[arg-type]
        return arrays[0]
    if 4 * len(distinct) > len(arrays):
        return stacked(arrays)
    numbers = {key: k for k, key in enumerate(distinct)}
    kinds = np.stack([*distinct.values()], axis=-1)
    return np.moveaxis(np.take(kinds, [numbers[id(array)] for array in arrays], axis=-1), -1, -2)


def prepare(experiment: Experiment, controller: Any = None, injection: Injection | None = None) -> Prepared:
    """Check everything in an experiment that can be checked without running it.

    A controller replaces the experiment's, with the feedforward unchanged, as `controller_of`; or is an FMU, which
    contains its feedforward. An injection, from the time of a sample [s] to six forces [N] that are added to the
    command, replaces the experiment's. An invalid part is an `ExperimentError`, a reference that the platform cannot
    follow a `ReachError`.
    """
    batch = Preparation(experiment, controller).members([{}], injection=injection)
    for error in batch.errors.values():
        raise error
    return batch.member(0, hints_at=experiment)


def too_late(experiment: Experiment) -> tuple[str, ...]:
    """A reference that begins after the run has ended: whatever is measured is that of rest."""
    at, duration = float(getattr(experiment.reference, "at", 0.0)), experiment.loop.duration
    if at < duration:
        return ()
    return (f"reference.at is {at:g} s in a run of {duration:g} s, so nothing moves; set it earlier, or run longer",)


# What an experiment's tables say, for members with the same ones but for sensors and machine: the tables by name, the
# nominal model, and the platform whose parameters those of the machine replace.
_Believed = tuple[dict[str, Any], Platform, Platform]


class Preparation:
    """Prepares members of an experiment that differ in their values; those before often had the same ones."""

    def __init__(self, experiment: Experiment, controller: Any = None, seed: int = 0) -> None:
        self.experiment, self.controller, self._where = experiment, controller, experiment.where
        self.seed = seed  # of the members' noise and jitter
        self._tables = dict(experiment)
        self._punctual = experiment.loop.model_copy(update={"jitter": 0.0, "delay": 0})  # what members have in common
        # results of stages, and the parts that they were made from, by the identity of these
        self._known = dict[str, dict[tuple[object, ...], tuple[Sequence[object], Any]]]()

    def _once(self, stage: Callable[..., T], *parts: Any) -> T:
        """The result of a stage for these parts, or its error, of which each is made once."""
        results = self._known.setdefault(stage.__name__, {})
        # numbers and texts themselves, of settings their values, of other objects which one it is
        key = tuple(
            [
                repr(part) if isinstance(part, dict) else (type(part), part) if type(part) in _PLAIN else id(part)
                for part in parts
            ]
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

    def members(  # noqa: PLR0912, PLR0915 - one road, in sections
        self, values: Sequence[Values], streams: Sequence[int | None] = (), injection: Injection | None = None
    ) -> Batch:
        """Members with these values, and with noise and jitter from streams of the seed with these numbers."""
        experiment, where, once, errors = self.experiment, self._where, self._once, dict[int, GoughStewartError]()
        if streams and any(change.has_settings for change in experiment.change):
            text = (
                "settings of the loop change during the run, which members of an ensemble cannot; expected parameters"
            )
            raise ExperimentError(where, "change", text)
        candidates, believed = list[int](), list[_Believed]()
        of_machines, sensors = list[dict[str, Any]](), list[Sensors]()

        # tables, the believed platform, and the one whose parameters those of the machine replace
        usual = Sensors(**dict(experiment.sensors))
        for k, member in enumerate(values):
            changed = by_table(member) if member else {}  # a single run has the experiment's own
            varied = {path[-1]: value for path, value in changed.pop("plant", {}).items()}
            of_sensors = changed.pop("sensors", None)
            try:
                belief = once(self._believed, changed)
                readings = usual
                if of_sensors:
                    readings = Sensors(**dict(once(table_with, experiment, "sensors", of_sensors)))
            except GoughStewartError as error:
                errors[k] = error
                continue
            candidates.append(k)
            believed.append(belief)
            sensors.append(readings)
            of_machines.append({**experiment.plant.parameters, **varied})

        # machines, for all at once; one vector steps several, so that all have the same states
        distinct = {id(base): base for _, _, base in believed}
        places = {key: place for place, key in enumerate(distinct)}
        base_of = np.array([places[id(base)] for _, _, base in believed], dtype=np.intp)
        machines = Platforms(list(distinct.values()), base_of)
        if any(of_machines):
            machines, impossible = platforms_with(list(distinct.values()), base_of, of_machines)
            errors |= {candidates[at]: ExperimentError(where, "plant", str(error)) for at, error in impossible.items()}
        if candidates and any(path[-1] in CHOOSING for member in values for path in member):
            with suppress(GoughStewartError):  # an impossible machine of the experiment has no kind
                variant = Variant.of(platforms_of(experiment)[1])
                sticks, gives = machines.field("leg_friction_model") != SMOOTH, machines.field("leg_stiffness") > 0
                of_parts = (("leg_friction_model", sticks, "bristles"), ("leg_stiffness", gives, "springs"))
                for name, of_members, part in of_parts:
                    other: dict[str, Any] = {part: not getattr(variant, part)}
                    words = [kind.words.removeprefix("with ") for kind in (replace(variant, **other), variant)]
                    text = (
                        f"{name}: gives a member {words[0]}, and the experiment's machine has {words[1]}; expected one "
                        "kind in all members: run the others as an experiment of their own"
                    )
                    for at in np.flatnonzero(of_members != getattr(variant, part)).tolist():
                        errors.setdefault(candidates[at], ExperimentError(where, "plant", text))

        # everything else
        ready, setups, changes = list[int](), list[Setup](), list[tuple[Change, ...]]()
        has_changes, made = experiment.change or experiment.disturbance or experiment.fault, dict[int, Setup]()
        for at, k in enumerate(candidates):
            if k in errors:
                continue
            belief = believed[at]
            try:
                setup = made.get(id(belief)) or once(self._setup, belief, injection)
                of_member = setup.turned
                if has_changes:
                    changing = [belief[0][name] for name in ("change", "disturbance", "fault")]
                    machine = machines[at] if changing[0] else None
                    clocks = once(timing_of, experiment, self._punctual)
                    of_member = once(self._changes, *changing, machine, clocks) + of_member
            except GoughStewartError as error:
                errors[k] = error
                continue
            made[id(belief)] = setup
            setups.append(setup)
            changes.append(of_member)
            ready.append(at)

        # forces before the first command: of an open loop its own, else those that hold the machine at rest
        of_ready = np.array(ready, dtype=np.intp)
        numbers, machines, n = np.array(candidates, dtype=np.intp)[of_ready], machines[of_ready], len(ready)
        forces = np.array([setup.known.feedforward[0] for setup in setups]).reshape(n, 6)
        if closed := [at for at in range(n) if setups[at].controller is not None]:
            position = np.stack([setups[at].start.position for at in closed])
            orientation = np.stack([setups[at].start.orientation for at in closed])
            try:
                forces[closed] = static_leg_forces(machines[np.array(closed)].parameters, position, orientation)
            except SingularPoseError:
                for k, at in enumerate(closed):
                    try:
                        forces[at] = static_leg_forces(machines[at], position[k], orientation[k])
                    except SingularPoseError as error:
                        errors[int(numbers[at])] = error
        limits = [np.inf if (most := setup.actuators.force_limit) is None else most for setup in setups]
        limit = of_legs(one_or_each(limits)).T if limits else np.inf

        self._known = {name: results for name, results in self._known.items() if len(results) <= _REPEATED}
        batch = Batch(
            where=where,
            numbers=numbers,
            errors=errors,
            setups=setups,
            machines=machines,
            sensors=[sensors[at] for at in ready],
            changes=changes,
            seed=self.seed,
            streams=[streams[k] if streams else None for k in numbers.tolist()],
            start_force=np.clip(forces, -limit, limit),
        )
        possible = np.array([at for at in range(n) if int(numbers[at]) not in errors], dtype=np.intp)
        return batch if len(possible) == n else batch.take(possible)

    # Stages: each is made once for the same parts.

    def _believed(self, changed: Mapping[str, Values]) -> _Believed:
        experiment, once = self.experiment, self._once
        tables = self._tables | {name: once(table_with, experiment, name, values) for name, values in changed.items()}
        nominal = once(nominal_platform, experiment, tables["platform"])
        if experiment.plant.file is None:
            return tables, nominal, nominal
        with part_of(experiment.where, "plant"):
            return tables, nominal, once(load_platform, str(experiment.folder / experiment.plant.file))

    def _setup(self, believed: _Believed, injection: Injection | None) -> Setup:  # noqa: PLR0912, PLR0915 - likewise
        """Everything of a member but its machine and its sensors."""
        where, once = self._where, self._once
        tables, platform, _ = believed
        loop, drives, limits, choice = (tables[name] for name in ("loop", "actuators", "limits", "controller"))
        reference = tables["reference"]
        is_closed = self.controller is not None or choice.is_closed

        # clocks, and the motion in rows of clocks that all members have, within the force limit of the actuators
        timing, clocks = once(timing_of, self.experiment, loop), once(timing_of, self.experiment, self._punctual)
        limited = once(limited_platform, platform, drives.force_limit)
        if reference is None and (is_closed or choice.feedforward != "none"):
            raise ExperimentError(where, "reference", "is missing; a controller needs one, for instance type = 'hold'")
        within = limits.condition_number, limits.reference
        planned = _UNPLANNED if reference is None else once(self._planned, reference, limited, *within, clocks)

        # the start, with angles in the turns of the reference
        stated = {name: np.array(value) for name, value in tables["start"] if value is not None}
        start = State(platform.home_position, platform.home_orientation, np.zeros(3), np.zeros(3))
        if planned.motion is not None:
            start = State(*(values[0] for values in planned.motion[:4]))
            if "orientation" in stated:
                stated["orientation"] = nearest_angle(stated["orientation"], start.orientation)

        # the controller, and what is known of its forces in advance; an FMU that replaces it contains its feedforward
        forces = once(self._feedforward, choice.feedforward, loop.delay, platform, planned, clocks)
        controller = once(self._controller, choice, platform, clocks)
        if isinstance(controller, UnitController):
            if not loop.delay:
                text = (
                    f"{controller.path} outputs the forces of a sample after a step over it; expected a loop.delay "
                    "of at least 1, for instance by --set loop.delay=1"
                )
                raise ExperimentError(where, "controller", text)
            if any(change.manual is not None for change in tables["change"]):
                text = (
                    f"enabled switches a controller off, and {controller.path} is an FMU, whose memory would go on; "
                    "expected a controller of another type"
                )
                raise ExperimentError(where, "change", text)
        if self.controller is None:
            forces = choice.planned(forces)
        elif isinstance(controller, UnitController):
            forces = np.zeros_like(forces)
        injected = None
        if injection is not None or tables["injection"] is not None:
            injected = once(self._injection, tables["injection"], platform, planned, clocks, injection)

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
                law = self._controller(law_choice, platform, clocks)
                before, after = (
                    () if linear is None else (linear.space, linear.signals, linear.kinds, len(linear.system.A))
                    for linear in (controller, law)
                )
                if after != before:
                    raise ControllerError(
                        f"controller at {change.at:g} s has the structure {after}; expected that of the "
                        f"experiment's, {before}"
                    )
                most = one_or_each([limited_platform(platform, force_limit).actuator_force_max])
                actuators = Actuators(most, drives.rate_limit, drives.lag, delay)
                settings = LoopSettings(getattr(law, "system", None), Sensors(**dict(sensors)), actuators)
                turned.append(Change(sample * timing.sample_time, settings=settings))
                ahead = self._feedforward(law_choice.feedforward, delay, platform, planned, clocks)
                forces[sample:] = law_choice.planned(ahead)[sample:]

        # what ends a run: an open loop only leaves its stroke; at a distance of a leg length, control is lost
        bound = limits.position_error
        if bound is None and planned.reference is not None and is_closed:
            bound = planned.mean_length
        force_limit, rate_limit = limited.actuator_force_max, drives.rate_limit
        low, high = platform.leg_length_min, platform.leg_length_max
        return Setup(
            timing=timing,
            platform=platform,
            start=start._replace(**stated),
            **vars(planned),
            controller=controller,
            injection=injected,
            actuators=Actuators(force_limit, rate_limit, drives.lag, loop.delay),
            limits=Limits(
                (0.0 if low is None else low, np.inf if high is None else high),
                self.experiment.limits.stroke,
                math.inf if bound is None else bound,
            ),
            known=KnownAhead(
                platform,
                timing.sample_time,
                feedforward=forces,
                planned=forces if injected is None else forces + injected,
                force_limit=np.inf if force_limit is None else float(np.min(force_limit)),  # the least of the legs
                rate_limit=np.inf if rate_limit is None else rate_limit,
                gains=MappingProxyType(choice.design(platform, timing.sample_time).parameters),
            ),
            turned=tuple(change for change in turned if change.time < timing.duration),
        )

    def _planned(
        self,
        choice: ReferenceChoice,
        limited: Platform,
        condition_number: float,
        when_beyond: WhenBeyond,
        timing: Timing,
    ) -> Planned:
        """The reference motion, which the platform can follow, and what the loop reads at rows and samples."""
        reference, motion = reference_motion(self.experiment, choice, limited, timing)
        with part_of(self._where, "reference"):
            is_by_hand = isinstance(reference, HandMotion)  # nobody has planned it
            beyond: dict[str, WhenBeyond] = {"dynamic": "warn" if is_by_hand else when_beyond}
            beyond["geometric"] = "warn" if is_by_hand else "refuse"
            exceeded = check_reach(limited, timing.times, motion, condition_number, centre=reference.centre, **beyond)
            legs, home = legs_of(limited, motion), (limited.home_position, limited.home_orientation)
            signals = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
            at = slice(0, timing.steps, timing.steps_a_sample)
            rows, of_row = distinct_rows(Motion(*(part[at] for part in motion)))
            jacobians = np.asarray(leg_jacobian(limited, rows.position, rows.orientation)[of_row])
            return Planned(
                reference=reference,
                motion=motion,
                pose=(motion.position[0], motion.orientation[0]),
                legs=legs,
                mean_length=float(leg_geometry(limited, *home).length.mean()),
                signals=signals,
                jacobians=jacobians,
                warnings=tuple(exceeded),
            )

    def _feedforward(
        self, kind: Feedforward, delay: int, platform: Platform, planned: Planned, timing: Timing
    ) -> FloatArray:
        """Actuator forces at every sample (m, 6) [N], along the motion.

        gravity: Jᵀ F = n(pose, 0), at rest in each pose. computed_torque: Jᵀ F = M [v̇; ω̇] + n, inverse dynamics.
        """
        samples, reference = timing.samples, planned.reference
        if reference is None or kind == "none":
            return np.zeros((len(samples), 6))
        # forces are held, so evaluate them in the middle of that interval
        ahead = (delay + 0.5) * timing.sample_time
        if isinstance(reference, HandMotion):
            motion = reference.foreseen(samples, ahead)
        else:
            motion = reference(np.minimum(samples + ahead, reference.defined_until))
        rows, of_row = distinct_rows(motion)
        if kind == "gravity":
            return np.asarray(static_leg_forces(platform, rows.position, rows.orientation)[of_row])
        return np.asarray(inverse_dynamics(platform, State(*rows[:4]), Acceleration(*rows[4:]))[of_row])

    def _controller(self, choice: ControllerChoice, platform: Platform, timing: Timing) -> Any:
        """The controller that replaces the experiment's, or the experiment's; None for feedforward alone."""
        sample_time = timing.sample_time
        with part_of(self._where, "controller"):
            if self.controller is None:
                return choice.controller(platform, sample_time, self.experiment.folder)
            return controller_of(self.controller, choice.design(platform, sample_time))

    def _injection(
        self,
        choice: InjectionChoice,
        platform: Platform,
        planned: Planned,
        timing: Timing,
        injection: Injection | None,
    ) -> FloatArray:
        """Forces that are added to the command at every sample (m, 6) [N]."""
        samples = timing.samples
        if injection is not None:
            forces = np.zeros((len(samples), 6))
            for k, time in enumerate(samples.tolist()):
                try:
                    forces[k] = real_array(injection(time), (6,))
                except ValueError as error:
                    raise ControllerError(f"the injection at time {time:g} s {error}") from None
            return forces
        at_home = leg_jacobian(platform, platform.home_position, platform.home_orientation)
        with part_of(self._where, "injection"):
            J = at_home if planned.reference is None else planned.jacobians[0]
            return choice.forces(len(samples), timing.sample_time, J)

    def _changes(
        self,
        of_parameters: Sequence[schema.ChangeChoice],
        wrenches: Sequence[schema.DisturbanceChoice],
        faults: Sequence[FaultChoice],
        machine: Platform | None,
        timing: Timing,
    ) -> tuple[Change, ...]:
        """Of the machine's parameters and the switch, then of the load, then faults; each list in order of time."""
        where, changes = self._where, list[Change]()
        with part_of(where, "change"):
            for choice in [] if machine is None else sorted(of_parameters, key=lambda choice: choice.at):
                values = dict(choice.parameters)
                for name, factor in choice.factors.items():  # on the values just before
                    if name in values:
                        raise PlatformError(name, "is in parameters and in factors; expected it in one of them")
                    values[name] = np.asarray(getattr(machine, name, np.nan)) * factor
                values = by_leg(values)
                tunable = [variable.name for variable in Variant.of(machine).tunable]
                for name in values:
                    if name not in tunable:
                        raise PlatformError(name, f"cannot change during a run{nearest(name, tunable)}")
                machine = machine.with_parameters(values)  # type: ignore[union-attr]
                changed = {name: getattr(machine, name) for name in values}
                changes.append(Change(choice.at, changed, manual=choice.manual))
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


def nominal_platform(experiment: Experiment, choice: schema.PlatformChoice) -> Platform:
    """The platform that the designer believes in."""
    with part_of(experiment.where, "platform"):
        file = choice.file
        platform = (
            load_preset(choice.preset or PAPER_PRESET) if file is None else load_platform(experiment.folder / file)
        )
        circles = {key: value for key in CIRCLE_KEYS if (value := getattr(choice, key)) is not None}
        parameters = joints_of_keys(circles) | choice.parameters
        return platform.with_parameters(parameters) if parameters else platform


def platforms_of(experiment: Experiment) -> tuple[Platform, Platform]:
    """The nominal model, and the machine."""
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
    """The clocks of a run, with their jitter; refuses a delay as long as the run."""
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
    """The reference, and its motion at every row, whether or not the platform can follow it."""
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

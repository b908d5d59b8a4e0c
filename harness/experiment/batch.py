"""Members that are ready to run, in parallel or one by one: what they share is kept once."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from operator import methodcaller
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws import Controller, LinearController
from gough_stewart.harness.control.laws_of_members import KnownAhead, Law, LawFrom, SeparateLaws, law_of, laws_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.libraries import are_traced, loop_kernel
from gough_stewart.harness.loop.loop import Actuators, Change, Limits, Loop, Sensors, changes_of_members
from gough_stewart.harness.loop.timing import Seed, Seeds, Timing, as_numbers
from gough_stewart.harness.motion.limits.reach import LegMotion
from gough_stewart.harness.motion.motion import Motion, Reference
from gough_stewart.harness.plants.lanes import CompiledLanes, LanesPlant, Stepping
from gough_stewart.harness.plants.members import PerMember, stacked
from gough_stewart.model.interface import Variant
from gough_stewart.model.platform import Platform, Platforms
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

T = TypeVar("T")
S = TypeVar("S")

# Size of the plant's vectors: a member's bits do not depend on the others if all vectors are full.
LANES = 8
_NO_JACOBIANS = np.zeros((0, 6, 6))
_PLAIN = frozenset((str, int, float, bool, type(None)))


def identity(value: object) -> object:
    """What tells values apart: numbers and texts themselves, of other objects which one it is."""
    kind = type(value)
    return (kind, value) if kind in _PLAIN else id(value)


@dataclass(frozen=True, eq=False)
class Distinct(Generic[T]):
    """One value for each of N members, of which equal ones are kept once."""

    values: Sequence[T]  # the distinct ones
    of: NDArray[np.intp]  # which of them each member has (N,)

    @classmethod
    def among(cls, values: Sequence[T]) -> "Distinct[T]":
        """Of the values of all members."""
        distinct = dict[object, tuple[int, T]]()
        of = [distinct.setdefault(identity(value), (len(distinct), value))[0] for value in values]
        return cls([value for _, value in distinct.values()], np.array(of, dtype=np.intp))

    def __len__(self) -> int:
        """N."""
        return len(self.of)

    def __getitem__(self, member: int) -> T:
        """The value of a member."""
        value: T = self.values[self.of[member]]
        return value

    def __iter__(self) -> Iterator[T]:
        """The value of one member after the other."""
        return (self.values[k] for k in self.of.tolist())

    def take(self, members: NDArray[np.intp] | list[int]) -> "Distinct[T]":
        """Those of some members (M,)."""
        used, of = np.unique(self.of[members], return_inverse=True)
        values = self.values
        return Distinct(values[used] if isinstance(values, Platforms) else [values[k] for k in used.tolist()], of)

    def map(self, function: Callable[[T], S]) -> "Distinct[S]":
        """A function of the values."""
        made = Distinct.among([function(value) for value in self.values])
        return Distinct(made.values, made.of[self.of] if len(made) else self.of)

    def numbers(self, number: Callable[[T], Any], none: float = np.nan) -> PerMember:
        """A number of each value: one if all members have the same, or an array (N,), with `none` instead of None."""
        numbers = [number(value) for value in self.values]
        if all(value == numbers[0] for value in numbers):
            return numbers[0]
        return np.array([none if value is None else value for value in numbers])[self.of]

    def arrays(self, array: Callable[[T], Any]) -> Any:
        """An array (..., size) of each value, or None: one if all members have the same, or all (..., N, size)."""
        made = self.map(array)
        if all(np.array_equal(value, made.values[0]) for value in made.values[1:]):
            return made.values[0]
        if 4 * len(made.values) < len(self):
            return np.moveaxis(np.take(np.stack(made.values, axis=-1), made.of, axis=-1), -1, -2)
        return stacked(list(made))


class Planned(NamedTuple):
    """What is planned from a reference."""

    reference: Reference  # the motion at any time
    motion: Motion  # at every row
    legs: LegMotion  # leg lengths and velocities at every row
    signals: FloatArray  # and accelerations, at every row (n, 30)
    jacobians: FloatArray  # leg Jacobians at every sample (m, 6, 6)
    warnings: tuple[str, ...]  # limits exceeded with permission


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
    jacobians: FloatArray  # leg Jacobians of the reference at every sample (m, 6, 6)
    warnings: tuple[str, ...] = ()  # limits exceeded with permission, hints at the platform
    reference: Reference | None = None  # the motion at any time

    @property
    def kernel(self) -> CompiledLanes | None:
        """What runs its loop in machine code, if it can: with a linear or traced controller, or feedforward alone."""
        runs_in_c = _is_linear(self.controller) or are_traced([self.controller])
        return loop_kernel(Variant.of(self.machine)) if runs_in_c else None

    def law(self, reference: FloatArray, measured: FloatArray) -> Law:
        """The control law for a run of one member that begins with these references (30,) and signals (1, 24)."""
        if self.controller is None:
            raise ControllerError("an open loop has no control law")
        known = known_of(self.platform, self.loop.timing, self.loop.feedforward, self.loop.injection)
        return law_of(self.controller, self.loop.timing.sample_time, self.jacobians, known)(reference, measured)

    @contextmanager
    def law_in_a_run(self) -> Iterator[LawFrom | None]:
        """The factory of the control law; resources are closed at the end."""
        if self.controller is None:
            yield None
        elif isinstance(self.controller, UnitController):
            with self.controller.open(self.loop.timing.sample_time) as law:
                yield lambda _reference, _measured: SeparateLaws([law])
        else:
            yield self.law


def known_of(platform: Platform, timing: Timing, feedforward: FloatArray, injection: FloatArray | None) -> KnownAhead:
    """What a loop tells a controller in Python."""
    planned = feedforward if injection is None else feedforward + injection
    return KnownAhead(platform, timing.sample_time, feedforward, planned)


class InParallel(NamedTuple):
    """One plant and one loop for members, followed by copies of the last one up to a whole number of vectors."""

    plant: LanesPlant
    law_from: LawFrom | None
    loop: Loop
    size: int  # including the copies


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


@dataclass(frozen=True, eq=False)
class Batch:
    """N members of an experiment that are ready to run."""

    setups: Distinct[Setup]
    machine: Distinct[Platform]
    sensors: Distinct[Sensors]
    changes: Distinct[tuple[Change, ...]]
    seeds: Distinct[Seed]  # of noise and jitter
    start_force: FloatArray  # (N, 6)

    def __len__(self) -> int:
        """N."""
        return len(self.setups)

    def take(self, members: Sequence[int] | NDArray[np.intp]) -> "Batch":
        """Some of them, in the order of their indices."""
        at = np.asarray(members, dtype=np.intp)
        return Batch(
            setups=self.setups.take(at),
            machine=self.machine.take(at),
            sensors=self.sensors.take(at),
            changes=self.changes.take(at),
            seeds=self.seeds.take(at),
            start_force=self.start_force[at],
        )

    def member(self, k: int) -> Prepared:
        """One of them alone."""
        setup, planned = self.setups[k], self.setups[k].planned
        return Prepared(
            platform=setup.platform,
            machine=self.machine[k],
            start=setup.start,
            loop=self.take([k]).loop,
            motion=planned and planned.motion,
            legs=planned and planned.legs,
            controller=setup.controller,
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
        n, setups, sensors = len(self), self.setups, self.sensors
        timing, common = setups[0].timing, sensors[0].seed
        limits, actuators = setups.map(lambda setup: setup.limits), setups.map(lambda setup: setup.actuators)
        return Loop(
            timing=replace(
                timing,
                jitter=setups.numbers(lambda setup: setup.timing.jitter),
                seed=self._seeds(setups.map(lambda setup: bool(setup.timing.jitter)), timing.seed),
            ),
            reference=setups.map(lambda setup: setup.planned).arrays(lambda planned: planned and planned.signals),
            feedforward=setups.arrays(lambda setup: setup.feedforward),
            start_force=self.start_force[0] if n == 1 else self.start_force,
            sensors=Sensors(
                _by_signal(sensors.map(lambda s: s.noise)),
                _by_signal(sensors.map(lambda s: s.quantisation)),
                sensors[0].sample_time,
                self._seeds(sensors.map(lambda s: any(s.noise.values())), common),
                sensors[0].side,
            ),
            actuators=Actuators(
                actuators.numbers(lambda a: a.force_limit, np.inf),
                actuators.numbers(lambda a: a.rate_limit, np.inf),
                actuators.numbers(lambda a: a.lag),
                actuators.numbers(lambda a: a.delay),
            ),
            limits=Limits(
                (limits.numbers(lambda ends: ends.stroke[0]), limits.numbers(lambda ends: ends.stroke[1])),
                limits[0].on_stroke,
                limits.numbers(lambda ends: ends.largest_position_error),
            ),
            changes=changes_of_members(list(self.changes), timing),
            injection=setups.arrays(lambda setup: setup.injection),
            shape=() if n == 1 else (n,),
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
        n, setups = len(self), self.setups
        controllers = setups.map(lambda setup: setup.controller)
        runs_in_c = _is_linear(*controllers.values) or are_traced(controllers.values)
        copies = 0 if runs_in_c else -n % LANES
        filled = self.take([*range(n), *[n - 1] * copies])
        machines = Platforms.of(filled.machine.values)[filled.machine.of]
        starts = [setup.start for setup in filled.setups]
        kernel = loop_kernel(Variant.of(self.machine[0]))
        plant, law_from = LanesPlant(machines, starts, **stepping._asdict(), kernel=kernel), None
        closed = [controller for controller in controllers if controller is not None]
        if closed:
            planned = filled.setups.map(lambda setup: setup.planned)
            flat = planned.arrays(lambda plan: (plan.jacobians if plan else _NO_JACOBIANS).reshape(-1, 36))
            sample_time = setups[0].timing.sample_time
            known = [known_of(setup.platform, setup.timing, setup.feedforward, setup.injection) for setup in setups]
            law_from = laws_of(closed, sample_time, flat.reshape(*flat.shape[:-1], 6, 6), known, copies)
        return InParallel(plant, law_from, filled.loop, len(filled))

    def _seeds(self, is_random: Distinct[bool], common: Seeds) -> Seeds:
        """Of each member, the common one of those without random numbers; one if all are the same."""
        if not any(is_random.values):
            return common
        seeds = [seed if draws else common for seed, draws in zip(self.seeds, is_random, strict=True)]
        first = as_numbers(seeds[0])
        return seeds[0] if all(as_numbers(seed) == first for seed in seeds) else tuple(seeds)  # type: ignore[arg-type]


def _by_signal(sizes: Distinct[Mapping[str, PerMember]]) -> dict[str, PerMember]:
    names = dict.fromkeys(name for of_signal in sizes.values for name in of_signal)
    return {name: sizes.numbers(methodcaller("get", name, 0.0)) for name in names}


def _is_linear(*controllers: Controller | None) -> bool:
    return all(controller is None or isinstance(controller, LinearController) for controller in controllers)

"""Members that are ready to run, in parallel or one by one."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from operator import methodcaller
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws import Controller, Known, LinearController
from gough_stewart.harness.control.laws_of_members import Law, LawFrom, SeparateLaws, law_of, laws_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.distinct import Distinct
from gough_stewart.harness.experiment.stages import Planned
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.law_library import are_traced
from gough_stewart.harness.loop.loop import Change, Limits, Loop, changes_of_members
from gough_stewart.harness.loop.loop_library import loop_kernel
from gough_stewart.harness.loop.seeds import Seed, Seeds, as_numbers
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import LegMotion
from gough_stewart.harness.motion.motion import Motion, Reference
from gough_stewart.harness.plants.lanes import CompiledLanes, LanesPlant, Stepping
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.model.platform import Platform, Platforms
from gough_stewart.model.state import State
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray

# Size of the plant's vectors: a member's bits do not depend on the others if all vectors are full.
LANES = 8
_NO_JACOBIANS = np.zeros((0, 6, 6))


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
        is_linear = self.controller is None or isinstance(self.controller, LinearController)
        return loop_kernel(Variant.of(self.machine)) if is_linear or are_traced([self.controller]) else None

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


def known_of(platform: Platform, timing: Timing, feedforward: FloatArray, injection: FloatArray | None) -> Known:
    """What a loop tells a controller in Python."""
    planned = feedforward if injection is None else feedforward + injection
    return Known(platform, timing.sample_time, feedforward, planned)


class InParallel(NamedTuple):
    """One plant and one loop for members, followed by copies of the last one up to a whole number of vectors."""

    plant: LanesPlant
    law_from: LawFrom | None
    loop: Loop
    size: int  # including the copies


@dataclass(frozen=True, eq=False)
class Batch:
    """N members of an experiment that are ready to run."""

    timing: Distinct[Timing]  # the same, without jitter
    platform: Distinct[Platform]  # the nominal models
    machine: Distinct[Platform]
    start: Distinct[State]
    planned: Distinct[Planned | None]
    warnings: Distinct[tuple[str, ...]]
    controller: Distinct[Controller | None]
    feedforward: Distinct[FloatArray]
    injection: Distinct[FloatArray | None]
    start_force: FloatArray  # (N, 6)
    sensors: Distinct[Sensors]
    actuators: Distinct[Actuators]
    limits: Distinct[Limits]
    changes: Distinct[tuple[Change, ...]]
    jitter: Distinct[float]
    seeds: Distinct[Seed]  # of noise and jitter

    def __len__(self) -> int:
        """N."""
        return len(self.platform)

    def take(self, members: Sequence[int] | NDArray[np.intp]) -> "Batch":
        """Some of them, in the order of their indices."""
        at = np.asarray(members, dtype=np.intp)
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        taken = {name: each.take(at) for name, each in values.items() if isinstance(each, Distinct)}
        return replace(self, start_force=self.start_force[at], **taken)

    def member(self, k: int) -> Prepared:
        """One of them alone."""
        own = self.take([k])
        planned = own.planned[0]
        reference, motion, legs, _, jacobians = planned or (None, None, None, None, _NO_JACOBIANS)
        return Prepared(
            own.platform[0],
            own.machine[0],
            own.start[0],
            own.loop,
            motion,
            legs,
            own.controller[0],
            jacobians,
            own.warnings[0],
            reference,
        )

    @property
    def loop(self) -> Loop:
        """The loop of all; of one member alone without a member axis."""
        timing, n, sensors, actuators = self.timing[0], len(self), self.sensors, self.actuators
        has_noise = sensors.map(lambda each: any(each.noise.values()))
        return Loop(
            timing=replace(
                timing, jitter=self.jitter.numbers(float), seed=self._seeds(self.jitter.map(bool), timing.seed)
            ),
            reference=self.planned.arrays(lambda each: each and each.signals),
            feedforward=self.feedforward.arrays(np.asarray),
            start_force=self.start_force[0] if n == 1 else self.start_force,
            sensors=Sensors(
                _by_signal(sensors.map(lambda each: each.noise)),
                _by_signal(sensors.map(lambda each: each.quantisation)),
                sensors[0].sample_time,
                self._seeds(has_noise, sensors[0].seed),
                sensors[0].side,
            ),
            actuators=Actuators(
                actuators.numbers(lambda each: each.force_limit, np.inf),
                actuators.numbers(lambda each: each.rate_limit, np.inf),
                actuators.numbers(lambda each: each.lag),
                actuators.numbers(lambda each: each.delay),
            ),
            limits=Limits(
                (
                    self.limits.numbers(lambda each: each.stroke[0]),
                    self.limits.numbers(lambda each: each.stroke[1]),
                ),
                self.limits[0].on_stroke,
                self.limits.numbers(lambda each: each.largest_position_error),
            ),
            changes=changes_of_members(list(self.changes), timing),
            injection=self.injection.arrays(lambda each: each),
            shape=() if n == 1 else (n,),
        )

    def in_parallel(self, stepping: Stepping) -> InParallel:
        """All of them as one plant and one loop.

        Raises
        ------
        ControllerError
            Members that cannot run in parallel; names the difference.
        BuildError, OSError
            There is no machine code of the loop, as `loop_library`.
        """
        n, timing = len(self), self.timing[0]
        values = self.controller.values
        is_linear = all(each is None or isinstance(each, LinearController) for each in values)
        runs_in_c = is_linear or are_traced(values)
        copies = 0 if runs_in_c else -n % LANES
        filled = self.take([*range(n), *[n - 1] * copies])
        machines = Platforms.of(filled.machine.values)[filled.machine.of]
        kernel = loop_kernel(Variant.of(self.machine[0]))
        plant = LanesPlant(machines, list(filled.start), **stepping._asdict(), kernel=kernel)
        law_from, controllers = None, [each for each in self.controller if each is not None]
        if controllers:
            flat = filled.planned.arrays(
                lambda each: (_NO_JACOBIANS if each is None else each.jacobians).reshape(-1, 36)
            )
            known = zip(self.platform, self.feedforward, self.injection, strict=True)
            law_from = laws_of(
                controllers,
                timing.sample_time,
                flat.reshape(*flat.shape[:-1], 6, 6),
                [known_of(platform, timing, forces, injection) for platform, forces, injection in known],
                copies,
            )
        return InParallel(plant, law_from, filled.loop, len(filled))

    def _seeds(self, own: Distinct[bool], common: Seeds) -> Seeds:
        """Of each member, the common one of those without random numbers; one if all are the same."""
        if not any(own.values):
            return common
        found = [seed if is_own else common for seed, is_own in zip(self.seeds, own, strict=True)]
        first = as_numbers(found[0])
        return found[0] if all(as_numbers(seed) == first for seed in found) else tuple(found)  # type: ignore[arg-type]


def _by_signal(sizes: Distinct[Mapping[str, PerMember]]) -> dict[str, PerMember]:
    names = dict.fromkeys(name for each in sizes.values for name in each)
    return {name: sizes.numbers(methodcaller("get", name, 0.0)) for name in names}

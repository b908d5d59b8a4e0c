"""Prepares an experiment for the loop: platform, reference, controller, limits, changes; everything is checked."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.control.feedforward import feedforward
from gough_stewart.harness.control.laws import Controller, Known, controller_of
from gough_stewart.harness.control.laws_of_members import Law, LawFrom, SeparateLaws, law_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError
from gough_stewart.harness.experiment.hints import hints_of
from gough_stewart.harness.experiment.parts import (
    Injection,
    changed,
    disturbances_of,
    force_limit_of,
    injected,
    limits_of,
    parameter_changes,
    start_of,
)
from gough_stewart.harness.experiment.planning import Planning, part_of
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.loop import Change, Loop
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import LegMotion, legs_of
from gough_stewart.harness.motion.motion import Motion, Reference, end_of
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

Seed = int | np.random.SeedSequence
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

    def law(self, reference: FloatArray, measured: FloatArray) -> Law:
        """The control law for a run of one member that begins with these references (30,) and signals (1, 24)."""
        if self.controller is None:
            raise ControllerError("an open loop has no control law")
        return law_of(self.controller, self.loop.timing.sample_time, self.jacobians, self.known)(reference, measured)

    @property
    def known(self) -> Known:
        """What the loop tells a controller in Python."""
        loop = self.loop
        planned = loop.feedforward if loop.injection is None else loop.feedforward + loop.injection
        return Known(self.platform, loop.timing.sample_time, loop.feedforward, planned)

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
    prepared = Preparation().prepare(experiment, controller, injection)
    return replace(prepared, warnings=(*prepared.warnings, *hints_of(experiment, prepared.platform)))


class _Planned(NamedTuple):
    """What is planned from a reference."""

    reference: Reference
    motion: Motion
    legs: LegMotion
    signals: FloatArray  # and accelerations, at every row (n, 30)
    jacobians: FloatArray


class Stages(NamedTuple):
    """The stages of an experiment up to its start, each from tables and earlier ones."""

    platform: Platform  # the nominal model
    machine: Platform
    timing: Timing
    planned: _Planned | None
    warnings: Sequence[str]  # limits that the motion exceeds with permission
    start: State


class Preparation(Planning):
    """`prepare` for many similar experiments: stages are shared where what they are made from is the same.

    Tables are the same if they are identical objects, as `model_copy` keeps them.
    """

    def machine(self, experiment: Experiment) -> Platform:
        """The simulated platform."""
        nominal, choice = self.nominal(experiment), experiment.plant
        if choice.file is None and not choice.parameters:
            return nominal
        with part_of(experiment.where, "plant"):
            base = nominal
            if choice.file is not None:
                file = experiment.folder / choice.file
                base = self.once("machine's file", (str(file),), lambda: load_platform(file))
            return self.once("machine", (choice, base), lambda: changed(base, choice.parameters))

    def stages(self, experiment: Experiment, controller: Any = None, machine: Platform | None = None) -> Stages:
        """Platform, machine (if not known), clocks, motion and start, in this order.

        Raises
        ------
        ExperimentError, ReachError
            As of `prepare`.
        """
        platform = self.nominal(experiment)
        machine = machine or self.machine(experiment)
        timing = self.timing(experiment)
        planned, warnings = self._planned(experiment, platform, timing, controller)
        start = self.once(
            "start",
            (experiment.start, platform, planned),
            lambda: start_of(experiment.start, platform, None if planned is None else planned.motion),
        )
        return Stages(platform, machine, timing, planned, warnings, start)

    def prepare(
        self,
        experiment: Experiment,
        controller: Any = None,
        injection: Injection | None = None,
        *,
        seed: Seed | None = None,
        held: FloatArray | None = None,
        stages: Stages | None = None,
    ) -> Prepared:
        """See the function.

        Parameters
        ----------
        seed
            Seed of noise and jitter, instead of the sensors' own.
        held
            Actuator forces (6,) [N] that hold the machine in its start pose, if known.
        stages
            If known.
        """
        once, section = self.once, partial(part_of, experiment.where)
        chosen, clocks = experiment.controller, experiment.loop
        stages = stages or self.stages(experiment, controller)
        platform, machine, timing, planned, warnings, start = stages
        forces = self._feedforward(experiment, stages)
        with section("controller"):
            made = self._controller(experiment, stages, controller)
        if controller is None:
            forces = once("forces", (chosen, forces), lambda: chosen.planned(forces))
        elif isinstance(made, UnitController):
            forces = np.zeros_like(forces)  # the FMU contains its feedforward
        force_limit = force_limit_of(experiment.actuators, platform)
        is_closed = controller is not None or chosen.is_closed
        if made is None:
            # an open loop starts with its own forces; a closed one starts with the machine held at rest
            held = forces[0]
        elif held is None:
            held = static_leg_forces(machine, start.position, start.orientation)
        sensors = once("sensors", (experiment.sensors,), lambda: Sensors(**experiment.sensors.model_dump()))
        own: dict[str, Any] = {"seed": seed}
        loop = Loop(
            timing=timing if seed is None or not timing.jitter else replace(timing, **own),
            reference=None if planned is None else planned.signals,
            feedforward=forces,
            start_force=held if force_limit is None else np.clip(held, -force_limit, force_limit),
            sensors=sensors if seed is None or not any(sensors.noise.values()) else replace(sensors, **own),
            actuators=once(
                "actuators",
                (experiment.actuators, clocks.delay, force_limit),
                lambda: Actuators(force_limit, experiment.actuators.rate_limit, experiment.actuators.lag, clocks.delay),
            ),
            limits=once(
                "limits", (experiment.limits, platform, is_closed), lambda: limits_of(experiment, platform, is_closed)
            ),
            changes=self._changes(experiment, machine, timing),
            injection=self._injection(experiment, injection, stages),
        )
        if planned is None:
            return Prepared(platform, machine, start, loop, None, None, made, _NO_JACOBIANS)
        reference, motion, legs, _, jacobians = planned
        return Prepared(platform, machine, start, loop, motion, legs, made, jacobians, tuple(warnings), reference)

    def _controller(self, experiment: Experiment, stages: Stages, controller: Any) -> Controller | None:
        """The experiment's controller, or a given one."""
        chosen, platform, sample_time = experiment.controller, stages.platform, stages.timing.sample_time
        made: Controller | None
        if controller is None:
            made = self.once(
                "controller",
                (chosen, platform, sample_time, str(experiment.folder)),
                lambda: chosen.controller(platform, sample_time, experiment.folder),
            )
        else:
            made = self.once(
                "given controller",
                (controller, chosen, platform, sample_time),
                lambda: controller_of(controller, chosen.design(platform, sample_time)),
            )
        if isinstance(made, UnitController) and not experiment.loop.delay:
            raise ControllerError(
                f"{made.path} outputs the forces of a sample after a step over it; expected a loop.delay "
                "of at least 1, for instance by --set loop.delay=1"
            )
        return made

    def _changes(self, experiment: Experiment, machine: Platform, timing: Timing) -> tuple[Change, ...]:
        """Of the machine's parameters, then of the load; each list in order of time."""
        if not experiment.change and not experiment.disturbance:
            return ()
        with part_of(experiment.where, "change"):
            changes = parameter_changes(experiment, machine)
            for change in changes:
                timing.row(change.time, "a change")
        with part_of(experiment.where, "disturbance"):
            disturbances = self.once(
                "disturbances", (experiment.disturbance, timing), lambda: disturbances_of(experiment, timing)
            )
        return (*changes, *disturbances)

    def _injection(self, experiment: Experiment, injection: Injection | None, stages: Stages) -> FloatArray | None:
        platform, _, timing, planned, _, _ = stages
        choice = experiment.injection
        if injection is not None:
            return injected(injection, timing.samples)
        if choice is None:
            return None

        def make() -> FloatArray:
            J = leg_jacobian(platform, platform.home_position, platform.home_orientation)
            J = J if planned is None else planned.jacobians[0]
            return choice.forces(len(timing.samples), timing.sample_time, J)

        with part_of(experiment.where, "injection"):
            return self.once("injection", (choice, platform, timing, planned), make)

    def _planned(
        self, experiment: Experiment, platform: Platform, timing: Timing, controller: Any
    ) -> tuple[_Planned | None, Sequence[str]]:
        """What is planned from the reference, and the limits that it exceeds with permission."""
        chosen, where = experiment.controller, experiment.where
        if experiment.reference is None:
            if controller is not None or chosen.is_closed or chosen.feedforward != "none":
                raise ExperimentError(
                    where, "reference", "is missing; a controller needs one, for instance type = 'hold'"
                )
            return None, ()
        limited = self.limited(platform, force_limit_of(experiment.actuators, platform))
        requested = self.reference_motion(experiment, limited, timing)
        warnings = self.warnings(experiment, limited, requested)

        def make() -> _Planned:
            reference, timing, motion = requested
            legs = legs_of(platform, motion)
            rows = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
            at = slice(0, timing.steps, timing.steps_a_sample)
            jacobians = leg_jacobian(platform, motion.position[at], motion.orientation[at])
            return _Planned(reference, motion, legs, rows, jacobians)

        with part_of(where, "reference"):
            return self.once("planned", (platform, requested), make), warnings

    def _feedforward(self, experiment: Experiment, stages: Stages) -> FloatArray:
        platform, _, timing, planned, _, _ = stages
        kind, delay = experiment.controller.feedforward, experiment.loop.delay

        def make() -> FloatArray:
            if planned is None:
                return np.zeros((len(timing.samples), 6))
            # forces are held, so evaluate them in the middle of that interval
            ahead = timing.samples + (delay + 0.5) * timing.sample_time
            reference = planned.reference
            return feedforward(kind, platform, reference(np.minimum(ahead, end_of(reference))))

        return self.once("feedforward", (planned, platform, timing, kind, delay), make)

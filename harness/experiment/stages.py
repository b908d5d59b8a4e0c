"""The stages of an experiment from its tables to a run, each a function of tables and earlier stages.

Platform, machine, clocks, reference motion, legs, start, feedforward, controller, limits, changes, injection.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.controllers import ControllerChoice
from gough_stewart.harness.control.faults import N_FAULTS, FaultChoice
from gough_stewart.harness.control.feedforward import Feedforward, feedforward
from gough_stewart.harness.control.injections import InjectionChoice
from gough_stewart.harness.control.laws import Controller, controller_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import Change, Limits, stroke_of
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.limits.reach import LegMotion, WhenBeyond, check_reach, jacobians_of, legs_of
from gough_stewart.harness.motion.motion import Motion, Reference, centre_of, end_of
from gough_stewart.harness.motion.references import ReferenceChoice
from gough_stewart.model.errors import GoughStewartError, PlatformError
from gough_stewart.model.interface import nearest
from gough_stewart.model.joint_circles import joints_of_keys
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.platform_toml import load_platform, load_preset
from gough_stewart.model.real import real_array
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.state import State
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import FloatArray

Injection = Callable[[float], ArrayLike]


class ReferenceMotion(NamedTuple):
    """The reference motion of an experiment, whether or not the platform can follow it."""

    reference: Reference
    timing: Timing
    motion: Motion  # at every row


class Planned(NamedTuple):
    """What is planned from a reference."""

    reference: Reference
    motion: Motion
    legs: LegMotion
    signals: FloatArray  # and accelerations, at every row (n, 30)
    jacobians: FloatArray  # leg Jacobians at every sample (m, 6, 6)


@contextmanager
def part_of(where: str, name: str) -> Iterator[None]:
    """Turn errors inside into those of a part of the experiment; a reference out of reach keeps its data."""
    try:
        yield
    except (ExperimentError, ReachError):
        raise
    except GoughStewartError as error:
        raise ExperimentError(where, name, str(error)) from error


@dataclass(frozen=True)
class Stages:
    """The stages of an experiment, and of others that differ in the tables and numbers that are passed.

    Raises
    ------
    ExperimentError
        Each of them: an invalid part; names it.
    """

    experiment: Experiment

    def platform(self, choice: schema.PlatformChoice) -> Platform:
        """The nominal model."""
        with part_of(self.experiment.where, "platform"):
            file = None if choice.file is None else self.experiment.folder / choice.file
            platform = load_preset(choice.preset_name) if file is None else load_platform(file)
            own = joints_of_keys(choice.circles) | choice.parameters
            return platform.with_parameters(own) if own else platform

    def base_of_machine(self, nominal: Platform) -> Platform:
        """The platform whose parameters those of the machine replace: of a file, or the nominal model."""
        choice = self.experiment.plant
        if choice.file is None:
            return nominal
        with part_of(self.experiment.where, "plant"):
            return load_platform(self.experiment.folder / choice.file)

    def machine(self, base: Platform, parameters: Mapping[str, Any]) -> Platform:
        """The simulated platform."""
        with part_of(self.experiment.where, "plant"):
            return base.with_parameters(parameters) if parameters else base

    def timing(self, jitter: float, delay: int) -> Timing:
        """The clocks."""
        clocks, seed = self.experiment.loop, self.experiment.sensors.seed
        with part_of(self.experiment.where, "loop"):
            step = clocks.plant_step or clocks.sample_time
            timing = Timing(clocks.duration, clocks.sample_time, step, jitter, seed)
            if not delay * timing.sample_time < timing.duration:
                raise ControllerError(
                    f"delay of {delay} samples in a run of {timing.duration:g} s: no command would act; "
                    "expected fewer samples, or a longer run"
                )
            return timing

    def limited(self, platform: Platform, limit: float | None) -> Platform:
        """A nominal model with the force limit of the experiment's actuators [N]: no motion may use more force."""
        return platform.with_parameters({"actuator_force_max": limit})

    def reference(
        self, choice: ReferenceChoice | None, limited: Platform, timing: Timing, is_needed: bool
    ) -> ReferenceMotion | None:
        """The reference motion, if there is one."""
        where, folder = self.experiment.where, self.experiment.folder
        if choice is None:
            if is_needed:
                raise ExperimentError(
                    where, "reference", "is missing; a controller needs one, for instance type = 'hold'"
                )
            return None
        with part_of(where, "reference"):
            reference = choice.about(limited, folder)
            if not choice.highest_frequency < 0.5 / timing.sample_time:
                raise ControllerError(
                    f"frequency of {choice.highest_frequency:g} Hz at a sample_time of {timing.sample_time:g} s; "
                    f"expected less than half the sample rate, {0.5 / timing.sample_time:g} Hz"
                )
            return ReferenceMotion(reference, timing, reference(timing.times))

    def warnings(
        self, limited: Platform, requested: ReferenceMotion | None, condition_number: float, when: WhenBeyond
    ) -> tuple[str, ...]:
        """Limits that the motion exceeds with permission; refuses a motion that the platform cannot follow."""
        if requested is None:
            return ()
        centre, times = centre_of(requested.reference), requested.timing.times
        with part_of(self.experiment.where, "reference"):
            return tuple(check_reach(limited, times, requested.motion, condition_number, centre=centre, dynamic=when))

    def planned(self, platform: Platform, requested: ReferenceMotion | None) -> Planned | None:
        """The legs' motion, and what the loop reads at rows and samples."""
        if requested is None:
            return None
        reference, timing, motion = requested
        with part_of(self.experiment.where, "reference"):
            legs = legs_of(platform, motion)
            signals = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
            at = slice(0, timing.steps, timing.steps_a_sample)
            jacobians = jacobians_of(platform, Motion(*(part[at] for part in motion)))
            return Planned(reference, motion, legs, signals, jacobians)

    def start(self, choice: schema.Start, platform: Platform, planned: Planned | None) -> State:
        """The state at time 0, with angles in the turns of the reference."""
        rest = np.zeros(3)
        state = State(platform.home_position, platform.home_orientation, rest, rest)
        if planned is not None:
            state = State(*(values[0] for values in planned.motion[:4]))
        given = {name: np.array(value) for name, value in choice.model_dump().items() if value is not None}
        if planned is not None and "orientation" in given:
            given["orientation"] = nearest_angle(given["orientation"], state.orientation)
        return state._replace(**given)

    def feedforward(
        self, kind: Feedforward, delay: int, platform: Platform, planned: Planned | None, timing: Timing
    ) -> FloatArray:
        """Forces at every sample (m, 6) [N]."""
        if planned is None:
            return np.zeros((len(timing.samples), 6))
        # forces are held, so evaluate them in the middle of that interval
        ahead = timing.samples + (delay + 0.5) * timing.sample_time
        reference = planned.reference
        return feedforward(kind, platform, reference(np.minimum(ahead, end_of(reference))))

    def controller(self, choice: ControllerChoice, platform: Platform, timing: Timing, given: Any) -> Controller | None:
        """The experiment's controller, or a given one."""
        with part_of(self.experiment.where, "controller"):
            if given is None:
                return choice.controller(platform, timing.sample_time, self.experiment.folder)
            return controller_of(given, choice.design(platform, timing.sample_time))

    def forces(
        self, choice: ControllerChoice, controller: Controller | None, delay: int, feedforward: FloatArray, given: Any
    ) -> FloatArray:
        """All that is known in advance at every sample (m, 6) [N]; an FMU that is given contains its feedforward."""
        if isinstance(controller, UnitController) and not delay:
            raise ExperimentError(
                self.experiment.where,
                "controller",
                f"{controller.path} outputs the forces of a sample after a step over it; expected a loop.delay "
                "of at least 1, for instance by --set loop.delay=1",
            )
        if given is None:
            return choice.planned(feedforward)
        return np.zeros_like(feedforward) if isinstance(controller, UnitController) else feedforward

    def limits(self, position_error: float | None, platform: Platform, is_closed: bool) -> Limits:
        """Conditions that end a run."""
        stroke = stroke_of(platform.leg_length_min, platform.leg_length_max)
        bound = position_error
        if bound is None and is_closed:
            # at a distance of a leg length, control is lost
            bound = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
        return Limits(stroke, self.experiment.limits.stroke, math.inf if bound is None else bound)

    def changes(
        self,
        parameters: Sequence[schema.ChangeChoice],
        wrenches: Sequence[schema.DisturbanceChoice],
        faults: Sequence[FaultChoice],
        machine: Platform,
        timing: Timing,
    ) -> tuple[Change, ...]:
        """Of the machine's parameters, then of the load, then faults; each list in order of time."""
        with part_of(self.experiment.where, "change"):
            changes = _parameter_changes(parameters, machine)
            for change in changes:
                timing.row(change.time, "a change")
        with part_of(self.experiment.where, "disturbance"):
            loads = _disturbances(wrenches, timing)
        with part_of(self.experiment.where, "fault"):
            return (*changes, *loads, *_faults(faults, timing))

    def injection(
        self,
        choice: InjectionChoice | None,
        platform: Platform,
        planned: Planned | None,
        timing: Timing,
        given: Injection | None,
    ) -> FloatArray | None:
        """Forces that are added to the command at every sample (m, 6) [N]."""
        if given is not None:
            forces = np.zeros((len(timing.samples), 6))
            for k, time in enumerate(timing.samples.tolist()):
                try:
                    forces[k] = real_array(given(time), (6,))
                except ValueError as error:
                    raise ControllerError(f"the injection at time {time:g} s {error}") from None
            return forces
        if choice is None:
            return None
        J = leg_jacobian(platform, platform.home_position, platform.home_orientation)
        with part_of(self.experiment.where, "injection"):
            J = J if planned is None else planned.jacobians[0]
            return choice.forces(len(timing.samples), timing.sample_time, J)


def platforms_of(experiment: Experiment) -> tuple[Platform, Platform]:
    """The nominal model, and the machine.

    Raises
    ------
    ExperimentError
        An invalid one.
    """
    stages = Stages(experiment)
    nominal = stages.platform(experiment.platform)
    return nominal, stages.machine(stages.base_of_machine(nominal), experiment.plant.parameters)


def force_limit_of(choice: float | str, platform: Platform) -> float | None:
    """The limit of the actuators [N], None without."""
    if choice == "platform":
        return platform.actuator_force_max
    return None if choice == "none" else float(choice)


def _parameter_changes(choices: Sequence[schema.ChangeChoice], platform: Platform) -> list[Change]:
    """Changes in order of time; factors multiply the values just before."""
    changes = []
    for choice in sorted(choices, key=lambda each: each.at):
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


def _disturbances(choices: Sequence[schema.DisturbanceChoice], timing: Timing) -> list[Change]:
    """The external wrench from every time at which a disturbance begins or ends: the sum of the active ones."""
    spans = [(each.at, each.at + each.duration, np.concatenate([each.force, each.torque])) for each in choices]
    return [
        Change(time, external_wrench=sum(active, start=np.zeros(6)))
        for time, active in _active(spans, timing, "disturbance")
    ]


def _faults(choices: Sequence[FaultChoice], timing: Timing) -> list[Change]:
    """What fails from every time at which a fault begins or ends."""
    spans = [(each.at, math.inf if each.duration is None else each.at + each.duration, each.flags) for each in choices]
    return [
        Change(time, faults=np.max([np.zeros(N_FAULTS), *active], axis=0))
        for time, active in _active(spans, timing, "fault")
    ]


def _active(
    spans: Sequence[tuple[float, float, FloatArray]], timing: Timing, what: str
) -> list[tuple[float, list[FloatArray]]]:
    """Every time at which a span (begin, end, value) begins or ends, with the values of those that are active then."""
    rows = set[int]()
    for begin, end, _ in spans:
        rows.add(timing.row(begin, f"a {what}"))
        if end - begin < 0.5 * timing.plant_step:
            raise ControllerError(
                f"a {what} of {end - begin:g} s at {begin:g} s; expected at least the plant_step of "
                f"{timing.plant_step:g} s"
            )
        if end < timing.duration:
            rows.add(timing.row(end, f"the end of a {what}"))
    # half a plant step later, so that rounding does not confuse begin and end
    aside = timing.plant_step / 2
    return [
        (time, [value for begin, end, value in spans if begin < time + aside < end])
        for time in timing.times[sorted(rows)].tolist()
    ]

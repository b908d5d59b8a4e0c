"""From an experiment to what the loop takes: platform, reference, controller, limits, changes; everything checked."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.feedforward import feedforward
from gough_stewart.harness.control.laws import Controller, Law, controller_of, law_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError, ExperimentError, ReachError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.loop import Change, LawFrom, Limits, Loop
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.motion import Motion, end_of
from gough_stewart.harness.motion.reach import LegMotion, check_reach, legs_of
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.errors import GoughStewartError, PlatformError
from gough_stewart.model.interface import TUNABLE, nearest
from gough_stewart.model.kinematics import leg_geometry, leg_jacobian
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_platform, load_preset
from gough_stewart.model.real import real_array
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

Injection = Callable[[float], ArrayLike]
_TUNABLE = tuple(v.name for v in TUNABLE)


@dataclass(frozen=True)
class Prepared:
    """An experiment that can be run."""

    platform: Platform  # what the designer believes: the source of gains, references, Jacobians, feedforward, limits
    machine: Platform  # what is simulated
    start: State
    loop: Loop
    motion: Motion | None  # the reference at every row
    legs: LegMotion | None  # its leg lengths and velocities
    controller: Controller | None  # None for feedforward alone
    jacobians: FloatArray  # leg Jacobians of the reference at every sample (m, 6, 6)

    def law(self, wanted: FloatArray, measured: FloatArray) -> Law:
        """The controller made ready for a run that begins with these references and signals (24,)."""
        if self.controller is None:
            raise ControllerError("an open loop has no control law")
        return law_of(self.controller, self.loop.timing.sample_time, self.jacobians, wanted, measured)

    @contextmanager
    def law_in_a_run(self) -> Iterator[LawFrom | None]:
        """What makes the controller from its first sample; what it has open is closed in the end."""
        if self.controller is None:
            yield None
        elif isinstance(self.controller, UnitController):
            with self.controller.open(self.loop.timing.sample_time) as law:
                yield lambda _wanted, _measured: law
        else:
            yield self.law


def prepare(experiment: Experiment, controller: Any = None, injection: Injection | None = None) -> Prepared:
    """Check everything of an experiment that can be checked without running it.

    Parameters
    ----------
    controller
        Takes the place of the one that the experiment names: a discrete python-control system, a `LinearController`,
        or a function of a `Sample`, beside which feedforward stays as it is; or an FMU, whose feedforward is inside.
    injection
        Six forces [N] for the time of a sample [s], added to what the controller commands.

    Raises
    ------
    ExperimentError
        A part that cannot be; says which.
    ReachError
        A reference that the platform cannot follow.
    """
    section, folder = partial(_section, experiment.where), experiment.folder
    with section("platform"):
        platform = _platform(experiment.platform, folder)
    with section("plant"):
        machine = _machine(experiment.plant, platform, folder)
    chosen, clocks = experiment.controller, experiment.loop
    with section("loop"):
        timing = Timing(
            clocks.duration,
            clocks.sample_time,
            clocks.plant_step or clocks.sample_time,
            clocks.jitter,
            experiment.sensors.seed,
        )
        if not clocks.delay * timing.sample_time < timing.duration:
            raise ControllerError(
                f"delay of {clocks.delay} samples in a run of {timing.duration:g} s: no command would act; expected "
                "fewer samples, or a longer run"
            )
    is_closed = controller is not None or chosen.is_closed
    if experiment.reference is None and (is_closed or chosen.feedforward != "none"):
        raise ExperimentError(
            experiment.where, "reference", "is missing; a controller needs one, for instance type = 'hold'"
        )
    motion = legs = wanted = None
    jacobians = np.zeros((0, 6, 6))
    planned = np.zeros((len(timing.samples), 6))
    if experiment.reference is not None:
        with section("reference"):
            reference = experiment.reference.about(platform, folder)
            _check_frequency(experiment.reference.highest_frequency, timing)
            motion = reference(timing.times)
            check_reach(platform, timing.times, motion, experiment.limits.condition_number)
            legs = legs_of(platform, motion)
            wanted = np.concatenate([*motion[:4], *legs, *motion[4:]], axis=-1)
        at = slice(0, timing.steps, timing.steps_a_sample)
        jacobians = leg_jacobian(platform, motion.position[at], motion.orientation[at])
        # forces are held: those of the middle of the time in which they will act
        ahead = timing.samples + (clocks.delay + 0.5) * timing.sample_time
        planned = feedforward(chosen.feedforward, platform, reference(np.minimum(ahead, end_of(reference))))
    start = _start(experiment.start, platform, motion)
    with section("controller"):
        made = (
            chosen.controller(platform, timing.sample_time, folder) if controller is None else controller_of(controller)
        )
        if isinstance(made, UnitController) and not clocks.delay:
            raise ControllerError(
                f"{made.path} gives the forces of a sample when it has been stepped over it; expected a loop.delay of "
                "at least 1, for instance by --set loop.delay=1"
            )
    if controller is None:
        planned = chosen.planned(planned)
    elif isinstance(made, UnitController):
        planned = np.zeros_like(planned)  # its feedforward is inside
    force_limit = _force_limit(experiment.actuators, platform)
    # an open loop has its forces from the beginning; a closed one begins with the machine held still
    first = planned[0] if made is None else static_leg_forces(machine, start.position, start.orientation)
    with section("change"):
        changes = _parameter_changes(experiment, machine)
        for change in changes:
            timing.row(change.time, "a change")
    with section("disturbance"):
        changes += _disturbances(experiment, timing)
    loop = Loop(
        timing=timing,
        wanted=wanted,
        feedforward=planned,
        start_force=np.clip(first, -(force_limit or np.inf), force_limit or np.inf),
        sensors=Sensors(**experiment.sensors.model_dump()),
        actuators=Actuators(force_limit, experiment.actuators.rate_limit, experiment.actuators.lag, clocks.delay),
        limits=_limits(experiment, platform, is_closed),
        changes=tuple(changes),
        injection=None if injection is None else _injected(injection, timing.samples),
    )
    return Prepared(platform, machine, start, loop, motion, legs, made, jacobians)


def _platform(choice: schema.PlatformChoice, folder: Path) -> Platform:
    platform = load_preset(choice.preset_name) if choice.file is None else load_platform(folder / choice.file)
    return _changed(platform, choice.parameters)


def _machine(choice: schema.PlantChoice, believed: Platform, folder: Path) -> Platform:
    return _changed(believed if choice.file is None else load_platform(folder / choice.file), choice.parameters)


def _changed(platform: Platform, parameters: Mapping[str, Any]) -> Platform:
    for name in parameters:
        if name not in TABLE:
            raise PlatformError(name, f"no such parameter{nearest(name, TABLE)}")
    return replace(platform, **parameters) if parameters else platform


def _check_frequency(highest: float, timing: Timing) -> None:
    """Refuse a motion that samples would take for a slower one."""
    if not highest < 0.5 / timing.sample_time:
        raise ControllerError(
            f"frequency of {highest:g} Hz at a sample_time of {timing.sample_time:g} s; expected less than half the "
            f"sample rate, {0.5 / timing.sample_time:g} Hz"
        )


def _start(choice: schema.Start, platform: Platform, motion: Motion | None) -> State:
    rest = np.zeros(3)
    state = State(platform.home_position, platform.home_orientation, rest, rest)
    if motion is not None:
        state = State(*(values[0] for values in motion[:4]))
    given = {name: np.array(value) for name, value in choice.model_dump().items() if value is not None}
    return state._replace(**given)


def _injected(injection: Injection, times: FloatArray) -> FloatArray:
    """What is injected at every sample (m, 6) [N]."""
    forces = np.zeros((len(times), 6))
    for k, time in enumerate(times.tolist()):
        try:
            forces[k] = real_array(injection(time), (6,))
        except ValueError as error:
            raise ControllerError(f"the injection at time {time:g} s {error}") from None
    return forces


def _force_limit(choice: schema.ActuatorChoice, platform: Platform) -> float | None:
    if choice.force_limit == "platform":
        return platform.actuator_force_max
    return None if choice.force_limit == "none" else float(choice.force_limit)


def _limits(experiment: Experiment, platform: Platform, is_closed: bool) -> Limits:
    low = 0.0 if platform.leg_length_min is None else platform.leg_length_min
    high = math.inf if platform.leg_length_max is None else platform.leg_length_max
    bound = experiment.limits.position_error
    if bound is None and is_closed:
        # a platform that is a leg's length away has left its controller
        bound = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    return Limits((low, high), experiment.limits.stroke, math.inf if bound is None else bound)


def _parameter_changes(experiment: Experiment, platform: Platform) -> list[Change]:
    """In the order of time; factors are of the values just before."""
    changes = []
    for choice in sorted(experiment.change, key=lambda each: each.at):
        values = dict(choice.parameters)
        for name, factor in choice.factors.items():
            if name in values:
                raise PlatformError(name, "is in parameters and in factors; expected one of both")
            values[name] = np.asarray(getattr(platform, name, np.nan)) * factor
        for name in values:
            if name not in _TUNABLE:
                raise PlatformError(name, f"cannot change during a run{nearest(name, _TUNABLE)}")
        platform = replace(platform, **values)
        changes.append(Change(choice.at, {name: getattr(platform, name) for name in values}))
    return changes


def _disturbances(experiment: Experiment, timing: Timing) -> list[Change]:
    """The external wrench at every time at which one begins or ends: the sum of those that act from there on."""
    ends = [
        (each.at, each.at + each.duration, np.concatenate([each.force, each.torque])) for each in experiment.disturbance
    ]
    rows = set[int]()
    for begin, end, _ in ends:
        rows.add(timing.row(begin, "a disturbance"))
        if end - begin < 0.5 * timing.plant_step:
            raise ControllerError(
                f"a disturbance of {end - begin:g} s at {begin:g} s; expected at least the plant_step of "
                f"{timing.plant_step:g} s"
            )
        if end < timing.duration:
            rows.add(timing.row(end, "the end of a disturbance"))
    # half a plant step aside, where rounding cannot tell begin from end
    aside = timing.plant_step / 2
    return [
        Change(time, external_wrench=sum((w for a, b, w in ends if a < time + aside < b), start=np.zeros(6)))
        for time in timing.times[sorted(rows)].tolist()
    ]


@contextmanager
def _section(where: str, name: str) -> Iterator[None]:
    """Errors inside are those of a part of the experiment; a reference out of reach keeps its data."""
    try:
        yield
    except (ExperimentError, ReachError):
        raise
    except GoughStewartError as error:
        raise ExperimentError(where, name, str(error)) from error

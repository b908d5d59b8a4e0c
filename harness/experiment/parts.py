"""Builds parts of an experiment from their tables: platform, start, limits, changes."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.drive import ActuatorChoice
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment import schema
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.loop.loop import Change, Limits, stroke_of
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.interface import TUNABLE, nearest
from gough_stewart.model.joint_circles import joints_of_keys
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_checks import by_leg
from gough_stewart.model.platform_toml import load_platform, load_preset
from gough_stewart.model.real import real_array
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

Injection = Callable[[float], ArrayLike]
_TUNABLE = tuple(v.name for v in TUNABLE)


def platform_of(choice: schema.PlatformChoice, folder: Path) -> Platform:
    platform = load_preset(choice.preset_name) if choice.file is None else load_platform(folder / choice.file)
    return changed(platform, joints_of_keys(choice.circles) | choice.parameters)


def changed(platform: Platform, parameters: Mapping[str, Any]) -> Platform:
    return platform.with_parameters(parameters) if parameters else platform


def check_frequency(highest: float, timing: Timing) -> None:
    """Refuse a motion that sampling would alias to a slower one."""
    if not highest < 0.5 / timing.sample_time:
        raise ControllerError(
            f"frequency of {highest:g} Hz at a sample_time of {timing.sample_time:g} s; expected less than half the "
            f"sample rate, {0.5 / timing.sample_time:g} Hz"
        )


def start_of(choice: schema.Start, platform: Platform, motion: Motion | None) -> State:
    rest = np.zeros(3)
    state = State(platform.home_position, platform.home_orientation, rest, rest)
    if motion is not None:
        state = State(*(values[0] for values in motion[:4]))
    given = {name: np.array(value) for name, value in choice.model_dump().items() if value is not None}
    return state._replace(**given)


def injected(injection: Injection, times: FloatArray) -> FloatArray:
    """The injected force at every sample (m, 6) [N]."""
    forces = np.zeros((len(times), 6))
    for k, time in enumerate(times.tolist()):
        try:
            forces[k] = real_array(injection(time), (6,))
        except ValueError as error:
            raise ControllerError(f"the injection at time {time:g} s {error}") from None
    return forces


def force_limit_of(choice: ActuatorChoice, platform: Platform) -> float | None:
    if choice.force_limit == "platform":
        return platform.actuator_force_max
    return None if choice.force_limit == "none" else float(choice.force_limit)


def limits_of(experiment: Experiment, platform: Platform, is_closed: bool) -> Limits:
    stroke = stroke_of(platform.leg_length_min, platform.leg_length_max)
    bound = experiment.limits.position_error
    if bound is None and is_closed:
        # at a distance of a leg length, control is lost
        bound = float(leg_geometry(platform, platform.home_position, platform.home_orientation).length.mean())
    return Limits(stroke, experiment.limits.stroke, math.inf if bound is None else bound)


def parameter_changes(experiment: Experiment, platform: Platform) -> list[Change]:
    """Changes in order of time; factors multiply the values just before."""
    changes = []
    for choice in sorted(experiment.change, key=lambda each: each.at):
        values = dict(choice.parameters)
        for name, factor in choice.factors.items():
            if name in values:
                raise PlatformError(name, "is in parameters and in factors; expected it in one of them")
            values[name] = np.asarray(getattr(platform, name, np.nan)) * factor
        values = by_leg(values)
        for name in values:
            if name not in _TUNABLE:
                raise PlatformError(name, f"cannot change during a run{nearest(name, _TUNABLE)}")
        platform = replace(platform, **values)
        changes.append(Change(choice.at, {name: getattr(platform, name) for name in values}))
    return changes


def disturbances_of(experiment: Experiment, timing: Timing) -> list[Change]:
    """The external wrench from every time at which a disturbance begins or ends: the sum of the active ones."""
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
    # half a plant step later, so that rounding does not confuse begin and end
    aside = timing.plant_step / 2
    return [
        Change(time, external_wrench=sum((w for a, b, w in ends if a < time + aside < b), start=np.zeros(6)))
        for time in timing.times[sorted(rows)].tolist()
    ]

"""The controller that an experiment names, as a python-control system or a function."""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from gough_stewart.harness.control.choice import PD, PID
from gough_stewart.harness.control.gains import DAMPING_RATIO, gains_from_bandwidth
from gough_stewart.harness.control.laws import Controller, LinearController, controller_of
from gough_stewart.harness.control.pid import Gains, pid_matrices
from gough_stewart.harness.control.state_space import discretised
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.platform import Platform


def system_of(choice: PD, platform: Platform, sample_time: float) -> LinearController:
    """PD or PID at a sample time [s].

    Raises
    ------
    ControllerError
        Gains that no controller can have, or a filter too fast for the samples.
    """
    gains = gains_of(choice, platform)
    tracking = float(gains.tracking_time[np.asarray(gains.integral) > 0].min(initial=np.inf))
    if tracking < sample_time:
        raise ControllerError(
            f"anti_windup_time is {tracking:g} s; expected at least the sample_time of {sample_time:g} s, since a "
            "controller hears of the limits one sample late"
        )
    continuous = pid_matrices(gains, choice.derivative_on)
    return LinearController(discretised(continuous, sample_time, choice.discretisation), space=choice.space)


def gains_of(choice: PD, platform: Platform) -> Gains:
    """The gains as given, or from bandwidth and damping ratio.

    Raises
    ------
    ControllerError
        Gains that no controller can have.
    """
    integral_time = anti_windup_time = integral_gain = None
    if isinstance(choice, PID):
        integral_time, anti_windup_time = choice.integral_time, choice.anti_windup_time
        integral_gain = choice.integral_gain
        if integral_gain is None and integral_time is None:
            raise ControllerError("a PID needs an integral_time or an integral_gain; or choose type = 'pd'")
    if choice.bandwidth is not None:
        if integral_gain is not None:
            raise ControllerError("integral_gain goes with gains; with a bandwidth give integral_time")
        return gains_from_bandwidth(
            platform,
            choice.bandwidth,
            DAMPING_RATIO if choice.damping_ratio is None else choice.damping_ratio,
            choice.space,
            integral_time,
            choice.derivative_filter,
            anti_windup_time,
        )
    kp, kd = np.array(choice.proportional_gain), np.array(choice.derivative_gain)
    ki: Any = 0.0
    if integral_time is not None:
        ki = kp / integral_time
    elif integral_gain is not None:
        ki = np.array(integral_gain)
    return Gains(kp, kd, ki, choice.derivative_filter, anti_windup_time)


def controller_from_file(file: Path, name: str) -> Controller:
    """The object of a name in a Python file, which is executed.

    Raises
    ------
    ControllerError
        No such file or name, the file fails, or the object is no controller.
    """
    if not file.is_file():
        raise ControllerError(f"{file}: no such file; expected a Python file that defines '{name}'")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise ControllerError(f"{file}: is no Python file; expected a name that ends in .py")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # the user's code may fail in any way
        raise ControllerError(f"{file}: fails with {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        raise ControllerError(f"{file}: defines no '{name}'; expected the controller under that name")
    return controller_of(getattr(module, name))

"""Control laws in a run: from references and measurements at a sample to six forces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.linear_law import N_LEGS, LegLaw, TaskLaw
from gough_stewart.harness.control.state_space import is_control_system, state_space_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

Space = Literal["leg", "task"]


class Sample(NamedTuple):
    """The argument of a controller that is a function; signals by name, in SI units.

    Names are position, orientation, velocity, angular_velocity, leg_length, leg_velocity.

    Examples
    --------
    >>> def law(sample: gs.Sample):
    ...     error = sample.reference["leg_length"] - sample.measured["leg_length"]
    ...     return 8e4 * error - 9e3 * sample.measured["leg_velocity"]
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=law)
    """

    time: float
    """[s]"""
    reference: Mapping[str, FloatArray]
    """The reference signals, with acceleration and angular_acceleration."""
    measured: Mapping[str, FloatArray]
    """The measurements of the sensors."""


_ACCELERATIONS = (interface.BY_NAME["acceleration"], interface.BY_NAME["angular_acceleration"])
ControlFunction = Callable[[Sample], Any]


@dataclass(frozen=True)
class LinearController:
    """A discrete python-control system as controller.

    With n the total size of its signals, the inputs of a controller in leg space are the errors reference − measured
    (n), or references and measurements (2 n), or these and the excess of the limits at the last sample (2 n + 6; force
    after the limits minus force before them, for anti-windup). Its outputs are the six actuator forces.

    In task space measurements are displacements computed from the legs, y = Σ J⁻¹ ΔL over the samples since the start,
    [m] and [rad] about the world's axes, whose rate is the twist J⁻¹ L̇; references are y + J⁻¹ (L_reference − L), so
    that errors are J⁻¹ (L_reference − L). The outputs are a wrench w [N, N m], and F = J⁻ᵀ w. J is the leg Jacobian in
    the reference pose at each sample.

    Raises
    ------
    ControllerError
        Not a linear python-control system, wrong sizes, or not discrete.
    """

    system: Any
    signals: tuple[str, ...] = ("leg_length",)
    space: Space = "leg"

    def __post_init__(self) -> None:
        object.__setattr__(self, "system", state_space_of(self.system))
        object.__setattr__(self, "signals", tuple([self.signals] if isinstance(self.signals, str) else self.signals))
        if self.space not in ("leg", "task"):
            raise ControllerError(f"space is {self.space!r}; expected 'leg' or 'task'")
        if self.space == "task" and self.signals != ("leg_length",):
            raise ControllerError("a controller in task space needs the signal leg_length to compute the pose")
        n = len(signals.positions(self.signals))
        sizes = (n, 2 * n, 2 * n + N_LEGS)
        if self.system.ninputs not in sizes or self.system.noutputs != N_LEGS:
            raise ControllerError(
                f"controller has {self.system.ninputs} inputs and {self.system.noutputs} outputs; expected for the "
                f"signals {', '.join(self.signals)} {sizes[0]} inputs (errors), {sizes[1]} (references, measurements) "
                f"or {sizes[2]} (also what the limits cut off), and {N_LEGS} outputs (forces)"
            )
        for name in "ABCD":
            if not np.isfinite(getattr(self.system, name)).all():
                raise ControllerError(f"the controller's matrix {name} has elements that are not finite")
        if self.system.nstates and not self.system.dt:
            raise ControllerError(
                "controller is in continuous time; expected discrete time: sample it, for instance by "
                "control.sample_system(controller, 1e-3, method='tustin')"
            )

    @property
    def sample_time(self) -> float | None:
        """Of the system [s]; None if it has none (a static gain)."""
        return None if self.system.dt in (None, True, 0) else float(self.system.dt)

    def check_sample_time(self, sample_time: float) -> None:
        """Refuse a loop whose sample time [s] differs from the controller's.

        Raises
        ------
        ControllerError
            Names both.
        """
        own = self.sample_time
        if own is not None and abs(own - sample_time) > 1e-9 * sample_time:
            raise ControllerError(
                f"the controller's sample time is {own:g} s, the loop's {sample_time:g} s; resample the controller, "
                "or set the loop's sample_time"
            )


Controller = LinearController | UnitController | ControlFunction


class Law(Protocol):
    """A controller with its memory during a run."""

    @property
    def used(self) -> tuple[str, ...]:
        """The signals that it uses."""

    @property
    def state(self) -> FloatArray:
        """Its memory (n_states,)."""

    @property
    def limited(self) -> "NDArray[np.bool_] | None":
        """Which forces (6,) it has limited itself; None if the actuators limit them."""

    def force(self, k: int, time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,) [N] at sample k, from references (30,), measurements (24,) and the last excess (6,) [N].

        References are all signals, then the accelerations [m/s², rad/s²]; the excess is what the limits cut off.
        """


def controller_of(controller: Any) -> Controller:
    """A controller from a user's object: a controller, a function, the path of an FMU, or a python-control system.

    Such a system acts on leg lengths.

    Raises
    ------
    ControllerError
        As `LinearController`.
    """
    if isinstance(controller, LinearController | UnitController):
        return controller
    if isinstance(controller, Path | str):
        return UnitController(Path(controller))
    # python-control's systems are callable too, with a frequency
    if callable(controller) and not is_control_system(controller):
        return controller  # type: ignore[no-any-return]
    return LinearController(controller)


def signals_of(controller: Controller) -> tuple[str, ...]:
    """The signals that a controller uses; a function may use all."""
    return controller.signals if isinstance(controller, LinearController) else signals.NAMES


def law_of(
    controller: Controller, sample_time: float, jacobians: FloatArray, reference: FloatArray, measured: FloatArray
) -> Law:
    """The law of a controller, ready for a run; a controller that is an FMU is opened instead.

    Parameters
    ----------
    sample_time
        Of the run [s].
    jacobians
        Leg Jacobians (n, 6, 6) in the reference poses of all samples.
    reference, measured
        References and measurements at the first sample (24,): the controller's memory starts in steady state for these
        constant inputs, its integrators at zero, so that a start off the reference gives no derivative kick.

    Raises
    ------
    ControllerError
        The controller has another sample time.
    """
    if isinstance(controller, UnitController):
        raise ControllerError("a controller that is an FMU has to be opened, and closed after the run")
    if not isinstance(controller, LinearController):
        return FunctionLaw(controller)
    controller.check_sample_time(sample_time)
    return (TaskLaw if controller.space == "task" else LegLaw)(controller, jacobians, reference, measured)


class FunctionLaw:
    """A control function during a run; exceptions and invalid results become errors of the controller."""

    limited = None

    def __init__(self, function: ControlFunction) -> None:
        self._function = function
        self.used = signals_of(function)

    @property
    def state(self) -> FloatArray:
        """Empty: the memory of a function is not visible."""
        return np.zeros(0)

    def force(
        self, _k: int, time: float, reference: FloatArray, measured: FloatArray, _excess: FloatArray
    ) -> FloatArray:
        """As `Law`."""
        by_name = interface.unpack((*signals.VARIABLES, *_ACCELERATIONS), reference.copy())
        try:
            result = self._function(Sample(time, by_name, interface.unpack(signals.VARIABLES, measured.copy())))
        except (Exception, SystemExit) as error:  # user code may raise anything
            raise ControllerError(
                f"the control function failed at time {time:g} s with {type(error).__name__}: {error}"
            ) from error
        try:
            force = np.array(result)
        except ValueError:  # ragged
            force = np.zeros(0)
        if force.dtype.kind not in "iuf" or force.shape != (N_LEGS,):
            raise ControllerError(
                f"the control function returned {result!r} at time {time:g} s; expected {N_LEGS} forces"
            )
        return force.astype(float)

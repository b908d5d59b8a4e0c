"""Control laws in a run: from references and measurements at a sample to six forces."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any, Literal, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.python.casadi_function import CasadiFunction, is_casadi_function
from gough_stewart.harness.control.python.makers import Constructed, Copied, Design, Maker, is_maker, name_of
from gough_stewart.harness.control.python.sample import NO_FORCE, Sample
from gough_stewart.harness.control.state_space import is_control_system, state_space_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

Space = Literal["leg", "task"]


class Known(NamedTuple):
    """What a loop knows in advance and tells its controllers."""

    platform: Platform  # the nominal model
    sample_time: float  # [s]
    feedforward: FloatArray  # at every sample (m, 6) [N]
    planned: FloatArray  # the same with the injection (m, 6) [N]


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
        sizes = self._sizes
        if self.system.ninputs not in sizes or self.system.noutputs != N_LEGS:
            raise ControllerError(
                f"controller has {self.system.ninputs} inputs and {self.system.noutputs} outputs; expected for the "
                f"signals {', '.join(self.signals)} {sizes[0]} inputs (errors), {sizes[1]} (references, measurements) "
                f"or {sizes[2]} (also what the limits cut off), and {N_LEGS} outputs (forces); of one channel for "
                f"{N_LEGS} legs: control.append(*[control.ss(controller)] * {N_LEGS})"
            )
        for name in "ABCD":
            if not np.isfinite(getattr(self.system, name)).all():
                raise ControllerError(f"the controller's matrix {name} has elements that are not finite")
        if self.system.nstates and not self.system.dt:
            raise ControllerError(
                "controller is in continuous time; expected discrete time: sample it, for instance by "
                "control.sample_system(controller, 1e-3, method='tustin')"
            )

    @cached_property
    def kinds(self) -> int:
        """How many kinds of inputs it has: 1 (errors), 2 (references, measurements) or 3 (also the excess)."""
        return 1 + self._sizes.index(self.system.ninputs)

    @property
    def _sizes(self) -> tuple[int, int, int]:
        n = len(signals.positions(self.signals))
        return n, 2 * n, 2 * n + N_LEGS

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


# A maker and a function without memory give all members their controllers; a function is called by all of them.
Controller = LinearController | UnitController | ControlFunction | Maker


class MemberLaw(Protocol):
    """The controller of one member, with its memory, during a run."""

    @property
    def used(self) -> tuple[str, ...]:
        """The signals that it uses."""

    @property
    def limited(self) -> "NDArray[np.bool_] | None":
        """Which forces (6,) it has limited itself; None if the actuators limit them."""

    def force(self, k: int, time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,) [N] at sample k, from references (30,), measurements (24,) and the last excess (6,) [N].

        References are all signals, then the accelerations [m/s², rad/s²]; the excess is what the limits cut off.
        """


def controller_of(controller: Any, design: Design | None = None) -> Controller:
    """A controller from a user's object; one in Python with memory becomes the maker of fresh ones.

    - A `LinearController`, or a python-control system, which acts on leg lengths.
    - The path of an FMU.
    - A class or factory: called as `make(platform, sample_time, **parameters)`.
    - A function of a `Sample`.
    - Another object that can be called with a `Sample`, or a method: copied.

    Raises
    ------
    ControllerError
        None of them, as `LinearController`, a class or factory that cannot be called so, or an object that cannot be
        copied.
    """
    if isinstance(controller, LinearController | UnitController | Maker):
        return controller
    if isinstance(controller, Path | str):
        return UnitController(Path(controller))
    # python-control's systems are callable too, with a frequency
    if not callable(controller) or (is_control_system(controller) and not inspect.isclass(controller)):
        return LinearController(controller)
    if is_maker(controller):
        if design is None:
            raise ControllerError(f"{name_of(controller)} is a class or factory; expected a controller here")
        return Constructed(controller, design)
    return controller if isinstance(controller, FunctionType | BuiltinFunctionType) else Copied(controller)


def fresh_controller(controller: Controller) -> LinearController | UnitController | ControlFunction:
    """A controller for one run of one member: a fresh one of a maker, any other as it is.

    Raises
    ------
    ControllerError
        The maker fails, or makes something that is not a controller.
    """
    return _made(controller.make()) if isinstance(controller, Maker) else controller


def _made(made: Any) -> LinearController | ControlFunction:
    if isinstance(made, LinearController):
        return made
    if inspect.isclass(made):
        raise ControllerError(f"a factory gave the {name_of(made)}; expected an object of it, made for each call")
    if not callable(made) or is_control_system(made):
        return LinearController(made)
    return cast("ControlFunction", made)


def linear_of(controller: Controller | None) -> LinearController | None:
    """The linear controller that it is or makes; None if it is none, which the next run then gets."""
    found = _made(controller.peek()) if isinstance(controller, Maker) else controller
    return found if isinstance(found, LinearController) else None


class FunctionLaw:
    """A control function during a run; exceptions and invalid results become errors of the controller."""

    limited = None
    used = signals.NAMES

    def __init__(self, function: ControlFunction, known: Known | None = None) -> None:
        self._function = CasadiFunction(function) if is_casadi_function(function) else function
        self._known = known
        self._command = NO_FORCE

    @property
    def traced(self) -> Any:
        """The CasADi function that it calls, which is all that there is to it; None for others."""
        return self._function.function if isinstance(self._function, CasadiFunction) else None

    def force(self, k: int, time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """As `MemberLaw`."""
        by_name = interface.unpack((*signals.VARIABLES, *_ACCELERATIONS), reference.copy())
        sample = Sample(time, by_name, interface.unpack(signals.VARIABLES, measured.copy()), k)
        if self._known is not None:
            platform, sample_time, feedforward, _ = self._known
            told = (self._command.copy(), excess.copy(), feedforward[k].copy(), platform)
            sample = Sample(*sample[:4], sample_time, *told)
        try:
            result = self._function(sample)
        except (Exception, SystemExit) as error:  # user code may raise anything
            raise ControllerError(
                f"the control function failed at time {time:g} s with {type(error).__name__}: {error}"
            ) from error
        force = _forces(result, time)
        if self._known is not None:
            self._command = self._known.planned[k] + force  # in this order, as the loop adds them
        return force


def _forces(result: Any, time: float) -> FloatArray:
    """The result of a control function as six forces."""
    try:
        force = np.array(result)
    except ValueError:  # ragged
        force = np.zeros(0)
    if force.dtype.kind not in "iuf" or force.shape != (N_LEGS,):
        raise ControllerError(f"the control function returned {result!r} at time {time:g} s; expected {N_LEGS} forces")
    return force.astype(float)

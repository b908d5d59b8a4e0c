"""Controllers of a run: linear ones, FMUs, functions, and makers of controllers with memory."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import BuiltinFunctionType, FunctionType
from typing import Any, Literal, cast

import numpy as np

from gough_stewart.harness.control.makers import Design, Maker, Sample, constructed, copied, is_maker, name_of
from gough_stewart.harness.control.state_space import is_control_system, state_space_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.signals import N_LEGS

Space = Literal["leg", "task"]
ControlFunction = Callable[[Sample], Any]


@dataclass(frozen=True)
class LinearController:
    """A discrete python-control system used as a controller.

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
    kinds: int = field(init=False, repr=False, compare=False)
    """How many kinds of inputs it has: 1 (errors), 2 (references, measurements) or 3 (also the excess)."""
    sample_time: float | None = field(init=False, repr=False, compare=False)
    """Sample time of the system [s]; None for a static gain, or if it is unspecified."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "system", state_space_of(self.system))
        object.__setattr__(self, "signals", tuple([self.signals] if isinstance(self.signals, str) else self.signals))
        if self.space not in ("leg", "task"):
            raise ControllerError(f"space is {self.space!r}; expected 'leg' or 'task'")
        if self.space == "task" and self.signals != ("leg_length",):
            raise ControllerError("a controller in task space needs the signal leg_length to compute the pose")
        n = len(signals.positions(self.signals))
        sizes, (n_outputs, n_inputs), dt = [n, 2 * n, 2 * n + N_LEGS], self.system.D.shape, self.system.dt
        if n_inputs not in sizes or n_outputs != N_LEGS:
            raise ControllerError(
                f"controller has {n_inputs} inputs and {n_outputs} outputs; expected for the "
                f"signals {', '.join(self.signals)} {sizes[0]} inputs (errors), {sizes[1]} (references, measurements) "
                f"or {sizes[2]} (also what the limits cut off), and {N_LEGS} outputs (forces); of one channel for "
                f"{N_LEGS} legs: control.append(*[control.ss(controller)] * {N_LEGS})"
            )
        object.__setattr__(self, "kinds", 1 + sizes.index(n_inputs))
        object.__setattr__(self, "sample_time", None if not dt or dt is True else float(dt))
        for name in "ABCD":
            if not np.isfinite(getattr(self.system, name)).all():
                raise ControllerError(f"the controller's matrix {name} has elements that are not finite")
        if len(self.system.A) and not dt:
            raise ControllerError(
                "controller is in continuous time; expected discrete time: sample it, for instance by "
                "control.sample_system(controller, 1e-3, method='tustin')"
            )

    def check_sample_time(self, sample_time: float) -> None:
        """Refuse a loop whose sample time [s] differs from the controller's."""
        designed = self.sample_time
        if designed is not None and abs(designed - sample_time) > 1e-9 * sample_time:
            raise ControllerError(
                f"the controller's sample time is {designed:g} s, the loop's {sample_time:g} s; resample the "
                "controller, or set the loop's sample_time"
            )


# A maker and a function without memory give all members their controllers; a function is called by all of them.
Controller = LinearController | UnitController | ControlFunction | Maker


def controller_of(controller: Any, design: Design | None = None) -> Controller:
    """A controller from a user's object; one in Python with memory becomes the maker of fresh ones.

    - A `LinearController`, or a python-control system, which acts on leg lengths.
    - The path of an FMU.
    - A class or factory: called as `make(platform, sample_time, **parameters)`.
    - A function of a `Sample`.
    - Another object that can be called with a `Sample`, or a method: copied.
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
            raise ControllerError(
                f"{name_of(controller)} has to be called with platform and sample time; expected factory = "
                f"'{getattr(controller, '__name__', 'NAME')}' instead of name"
            )
        return constructed(controller, design)
    return controller if isinstance(controller, FunctionType | BuiltinFunctionType) else copied(controller)


def fresh_controller(
    controller: Controller, *, peeks: bool = False
) -> LinearController | UnitController | ControlFunction:
    """A controller for one run of one member: a fresh one of a maker, any other as it is.

    One that only `peeks` leaves it to the next run.
    """
    if not isinstance(controller, Maker):
        return controller
    product = controller.peek() if peeks else controller.make()
    if isinstance(product, LinearController):
        return product
    if inspect.isclass(product):
        raise ControllerError(f"a factory gave the {name_of(product)}; expected an object of it, made for each call")
    if not callable(product) or is_control_system(product):
        return LinearController(product)
    return cast("ControlFunction", product)


def linear_of(controller: Controller | None) -> LinearController | None:
    """The linear controller that it is or makes, which the next run then gets; None if it is none."""
    linear = None if controller is None else fresh_controller(controller, peeks=True)
    return linear if isinstance(linear, LinearController) else None

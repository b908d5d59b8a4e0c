"""The stepping model: the platform as a plant with FMI-style inputs, steps and outputs, in Python.

It has the same variable names, semantics and failure behaviour as the FMU.
"""

import math
import subprocess
import sys
from collections.abc import Mapping
from ctypes import PyDLL, c_double, c_size_t, c_void_p
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import count
from typing import Any, Literal, get_args

import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.dynamics import motors_at
from gough_stewart.model.errors import InterfaceError, NotInstalledError, StepError
from gough_stewart.model.interface import (
    CHOOSING,
    DEFAULT_TOLERANCE,
    IDEAL,
    MOST_INTERNAL_STEPS,
    N_INPUTS,
    TOLERANCES,
    State,
    Variant,
    end_of_step,
)
from gough_stewart.model.kernel import Kernel, Linearisation, kernel_library, parameter_vector
from gough_stewart.model.kinematics import LARGEST_PITCH, SHORTEST_LEG, check_pose, leg_geometry
from gough_stewart.model.parameters import Variable
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_checks import LARGEST_STRETCH, check_leg_com_offsets
from gough_stewart.model.vectors import FloatArray, real_array

Integrator = Literal["compiled", "scipy"]
_MOTOR = {"motor_position", "motor_velocity"}
_ABSENT = {"bristles": "leg_friction_model is 'smooth'", "springs": "leg_stiffness is 0, which is rigid"}
_COMPILER = "gough_stewart.fmu_build.libraries"
# Below this tolerance, LSODA's multistep formulas do not reach it where bristles are stiff; Radau's do.
_TIGHT = 1e-12


@dataclass(frozen=True)
class Snapshot:
    """The complete state of a stepping model, from `save_state`."""

    time: float
    x: tuple[float, ...]
    u: tuple[float, ...]
    platform: Platform
    internal_step: float | None
    started: bool
    largest_step: float = 0.0  # of fixed steps, see `CompiledStepper.largest_step`


class SteppingModel:
    """The platform as a plant, stepped by FMI-style calls.

    The contract:

    1. A model starts at time 0 in the home pose of its platform, at rest, with the actuator forces that hold it there
       (`Platform.home_actuator_force`) and no external wrench: with these defaults it stands still.
    2. Variables have the names of the interface table, whole (`actuator_force`) or by element with the FMI 2.0 name
       (`actuator_force[3]`, 1-based).
    3. `set` takes inputs and tunable parameters (payload, friction, gravity) at any time; states (`position`,
       `orientation`, `velocity`, `angular_velocity`) and the other parameters only before the first step.
       Values are checked when they are set: shape, finite and, for parameters, a valid platform. A rejected value
       changes nothing.
    4. `get` returns any variable of the table as a copy: outputs and locals at the current time with the current
       inputs. It changes nothing.
    5. `do_step(time, step)` integrates from `time`, which must be the model's time, to `time + step`, with inputs and
       parameters held constant. The step can vary from call to call.
    6. There are two integrators of the same equations. `compiled` is the unit's own stepper in this process, with the
       bits of the FMU: Kutta's 3/8 rule, Dormand–Prince 5(4) with elastic legs, exponential steps with stiction.
       `scipy` integrates the same equations as an independent check: DOP853, with stiction LSODA, and Radau below a
       tolerance of 1e-12. Both control the error with `tolerance`, relative, and absolute in SI units; the internal
       step size carries over between calls, so short communication steps cost little. With a `fixed_step_size`, which
       only `compiled` takes, a step is divided into the smallest number of equal steps not above it, of classical RK4,
       or with stiction an exponential scheme.
    7. A step fails with `StepError` if at an internal step a leg has collapsed, |pitch| reaches 90° or the leg
       Jacobian is singular (or was singular since the last one), if the tolerance cannot be met, if more than 20,000
       internal steps would be needed (1,000,000 of a fixed size), or if fixed steps cannot resolve the bristles or
       springs of its legs. The error has quantity, value and time. Wrong arguments (step ≤ 0, another time, not
       finite) are also errors, and so is a start pose with a leg too short to contain the centre of mass of a part,
       or with elastic legs stretched by more than 1 %.
       Poses are checked at internal steps: with a loose tolerance a motion can reach a singular pose and return
       between two of them undetected.
    8. A failed call leaves the model unchanged.
    9. `save_state` and `restore_state` save and restore the complete state; a restored model repeats its results bit
       by bit. `reset` returns to rule 1, with the platform from the constructor.
    10. The limits of a platform (stroke, force, joint angle) are not enforced; that is up to the caller.
    11. A platform with stiction or elastic legs has further states (`Variant`): `leg_bristle`,
       `motor_position`, `motor_velocity`, and the output `leg_force`. Bristles start at 0, motors where they hold the
       pose at rest and move with it: setting a state of the platform moves them too, unless they are set in the same
       call. The friction model, and whether legs are elastic, is fixed.

    Parameters
    ----------
    platform
        Parameters and home pose of the plant.
    tolerance
        Integration tolerance, from 1e-13 to 1e-2.
    fixed_step_size
        0 for error control, or the largest step [s] of equal steps without.
    integrator
        "compiled" or "scipy" (rule 6).

    Raises
    ------
    InterfaceError
        An argument that the model cannot take.
    NotInstalledError
        The platform's stepper did not come with the package and cannot be compiled here; or for "scipy", CasADi.

    Examples
    --------
    >>> plant = gs.SteppingModel(gs.load_preset("liu2000"))
    >>> plant.set("actuator_force", [30.0] * 6)
    >>> plant.do_step(0.0, 0.01)
    >>> plant.get("position"), plant.get("leg_length[3]")
    """

    def __init__(
        self,
        platform: Platform,
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,
        integrator: Integrator = "compiled",
    ) -> None:
        if not isinstance(platform, Platform):
            raise InterfaceError("platform", f"is {platform!r}; expected a Platform, such as load_preset('liu2000')")
        tolerance, fixed = _number("tolerance", tolerance), _number("fixed_step_size", fixed_step_size)
        low, high = TOLERANCES
        if not low <= tolerance <= high:
            expected = f"expected {low:g} to {high:g}, for example {DEFAULT_TOLERANCE:g}"
            raise InterfaceError("tolerance", f"is {tolerance!r}; {expected}")
        if fixed < 0:
            raise InterfaceError("fixed_step_size", f"is {fixed_step_size!r} s; expected 0 for error control, or > 0")
        if integrator not in get_args(Integrator):
            raise InterfaceError("integrator", f"is {integrator!r}; expected 'compiled' or 'scipy'")
        if fixed and integrator == "scipy":
            raise InterfaceError(
                "fixed_step_size",
                f"is {fixed_step_size!r} s, but the integrator 'scipy' controls its error; expected 0, or integrator "
                "'compiled', which is that of the plant 'model'",
            )
        self._arguments, self._variant = (platform, tolerance, fixed, integrator), Variant.of(platform)
        self._time, self._started, self._platform = 0.0, False, platform
        self._stepper: CompiledStepper | ScipyStepper = (
            CompiledStepper(self._variant, tolerance, fixed)
            if integrator == "compiled"
            else ScipyStepper(self._variant, tolerance)
        )
        # views, read and written in place
        self._x, self._u = self._stepper.x, self._stepper.u
        self._inputs = interface.unpack(interface.INPUTS, self._u)
        self._current = {**self._inputs, **interface.unpack(self._variant.states, self._x)}
        self.reset()

    def __repr__(self) -> str:
        """Platform, time and pose, on one line."""
        x, y, z, *angles = (f"{value:.6g}" for value in self._x[:6])
        return (
            f"<SteppingModel of {self._platform.name} at {self._time:.6g} s: position ({x}, {y}, {z}) m, orientation "
            f"({', '.join(angles)}) rad>"
        )

    def reset(self) -> None:
        """Return to time 0 and the home pose at rest, with the parameters from the constructor (rules 1, 9)."""
        platform, *_ = self._arguments
        starts = interface.start_values((*self._variant.states, *interface.INPUTS), platform)
        x, u = (interface.pack(variables, starts) for variables in (self._variant.states, interface.INPUTS))
        self.restore_state(Snapshot(0.0, tuple(x.tolist()), tuple(u.tolist()), platform, None, started=False))

    @property
    def variant(self) -> Variant:
        """Whether the platform has stiction and elastic legs."""
        return self._variant

    @property
    def time(self) -> float:
        """Current time [s]."""
        return self._time

    @property
    def platform(self) -> Platform:
        """The platform with its current parameters."""
        return self._platform

    @property
    def state(self) -> FloatArray:
        """State x (n,) in SI units: position, orientation, velocity, angular velocity, those of rule 11; a copy."""
        return self._x.copy()

    # --- variables ---------------------------------------------------------------------------------------------

    def set(self, name: str, value: object) -> None:
        """Set an input, a parameter or, before the first step, a state (rules 2, 3).

        Raises
        ------
        InterfaceError
            Unknown name, a variable that cannot be set (now), a wrong shape, or a value that is not finite.
        PlatformError
            An invalid parameter.
        """
        target = self._inputs.get(name) if isinstance(name, str) else None
        if target is not None and type(value) in (list, np.ndarray):  # the usual case, a shortcut
            try:
                numbers = np.array(value)
                is_plain = numbers.dtype.char == "d" and numbers.shape == target.shape
            except ValueError:  # ragged
                is_plain = False
            if is_plain and all(map(math.isfinite, numbers.tolist())):
                target[:] = numbers
                return
        self.set_many({name: value})

    def set_many(self, values: Mapping[str, object]) -> None:
        """Set several variables at once; after an error, none of them is changed.

        Parameters are checked together, so that elements of an inertia can be changed one by one.
        """
        x, u, parameters, moved = self._x.copy(), self._u.copy(), dict[str, Any](), set[str]()
        targets = {**interface.unpack(interface.INPUTS, u), **interface.unpack(self._variant.states, x)}
        for name, value in values.items():
            variable, element = interface.find(name)
            self._refuse(variable, to_set=True)
            if variable.causality == "parameter" and variable.name not in parameters:
                parameters[variable.name] = np.array(getattr(self._platform, variable.name))
            target = parameters[variable.name] if variable.causality == "parameter" else targets[variable.name]
            moved |= {variable.name} if variable.is_state else set()
            if element is None:
                target[...] = interface.checked_value(variable, value)
            else:
                target.reshape(-1)[element] = interface.checked_value(variable.element(element), value)
        if not abs(x[4]) < LARGEST_PITCH:
            raise InterfaceError("orientation[2]", f"is {x[4]:g} rad; expected a pitch within ±{LARGEST_PITCH:g} rad")
        platform = replace(self._platform, **parameters) if parameters else self._platform
        if Variant.of(platform) != self._variant:
            name = next(name for name in CHOOSING if name in parameters)
            raise InterfaceError(name, "would give the model other states; make a SteppingModel of that platform")
        if self._variant.springs and not self._started and (moved or parameters) and not moved & _MOTOR:
            for name, motors in motors_at(platform, State.from_vector(x[:12])).items():
                targets[name][:] = motors
        self._u[:] = u
        if moved or parameters:
            self._x[:], self._platform = x, platform
            self._stepper.begin(platform, self._time, self._stepper.internal_step)

    def set_inputs(self, inputs: FloatArray) -> None:
        """`set` all inputs as one vector (12,), in the order of `interface.INPUTS`.

        Raises
        ------
        InterfaceError
            Another shape, or a value that is not finite.
        """
        inputs = np.asarray(inputs)
        if inputs.shape != (N_INPUTS,):
            raise InterfaceError("inputs", f"have the shape {inputs.shape}; expected ({N_INPUTS},)")
        if inputs.dtype.kind not in "iuf" or not np.isfinite(inputs).all():
            self.set_many(interface.unpack(interface.INPUTS, inputs))  # names the value
        self._u[:] = inputs

    def get(self, name: str) -> FloatArray | float:
        """Value of a variable: an array of its shape, or a float for a scalar or an element (rules 2, 4).

        Returns
        -------
        ndarray or float
            A copy in SI units: an array of the variable's shape, or a float for a scalar or an element.

        Raises
        ------
        InterfaceError
            Unknown name.
        """
        if isinstance(name, str) and (current := self._current.get(name)) is not None:
            return current.copy()
        variable, element = interface.find(name)
        if variable.name in self._current:
            values = self._current[variable.name]
        elif variable in self._variant.results:
            self._stepper.find_results()
            values = self._stepper.results[variable.name]
        elif variable.causality == "parameter" and hasattr(self._platform, variable.name):
            values = np.array(getattr(self._platform, variable.name))
        else:
            self._refuse(variable, to_set=False)
        if element is not None:
            return float(values.reshape(-1)[element])
        return values.copy() if variable.shape else float(values)

    def results(self) -> dict[str, FloatArray]:
        """All outputs and locals at the current time, by name, in one evaluation."""
        return interface.unpack(self._variant.results, self.result_vector())

    def result_vector(self) -> FloatArray:
        """`results` as one vector, in the order of `Variant.columns`, first `interface.RESULT_COLUMNS`."""
        self._stepper.find_results()
        return np.asarray(self._stepper.y[self._stepper.order])

    def linearise(self) -> Linearisation:
        """Exact Jacobians of state derivatives and results with respect to states and inputs, at the current state."""
        blocks = Kernel(self._variant).jacobians(self._x, self._u, self._stepper.p)
        return Linearisation(*(block.copy() for block in blocks))

    # --- time --------------------------------------------------------------------------------------------------

    def do_step(self, time: float, step: float) -> None:
        """Integrate from `time` to `time + step` with inputs held constant (rules 5 to 8); both in s.

        Raises
        ------
        StepError, InterfaceError, PlatformError
            Rule 7; the model is unchanged.
        """
        if not (type(time) is float and type(step) is float and math.isfinite(time + step)):
            time, step = _number("time", time), _number("step", step)
        end = time + step
        if time != self._time or not end > time:
            end = end_of_step(time, step, self._time)
        lengths = None if self._started else leg_geometry(self._platform, self._x[:3], self._x[3:6]).length
        # at the start the parts of each leg fit into it, and motors are near their legs: others are of another pose; a
        # leg that has collapsed fails the step
        if lengths is not None and lengths.min() > SHORTEST_LEG * self._platform.characteristic_length:
            check_leg_com_offsets(self._platform, lengths, "start")
            motors = self._current.get("motor_position", lengths)
            leg = int(np.argmax(np.abs(motors - lengths) / lengths))
            if not abs(motors[leg] - lengths[leg]) <= LARGEST_STRETCH * lengths[leg]:
                raise InterfaceError(
                    f"motor_position[{leg + 1}]",
                    f"is {motors[leg]:g} m, but leg_length[{leg + 1}] {lengths[leg]:g} m at the start; expected a "
                    f"stretch of at most {100 * LARGEST_STRETCH:g} %: set motor_position with the pose, to leg length "
                    "+ force/stiffness",
                )
        self._stepper.step(time, step)
        self._time, self._started = end, True

    def save_state(self) -> Snapshot:
        """Save the complete state (rule 9)."""
        x, u, stepper = tuple(self._x.tolist()), tuple(self._u.tolist()), self._stepper
        return Snapshot(self._time, x, u, self._platform, stepper.internal_step, self._started, stepper.largest_step)

    def restore_state(self, snapshot: Snapshot) -> None:
        """Restore a snapshot of this model, or of another model with the same settings (rule 9)."""
        if not isinstance(snapshot, Snapshot):
            raise InterfaceError("snapshot", f"is {snapshot!r}; expected a snapshot from save_state()")
        variant = Variant.of(snapshot.platform)
        if variant != self._variant:
            expected = f"expected one {self._variant.words}, as this model's"
            raise InterfaceError("snapshot", f"is of a platform {variant.words}; {expected}")
        self._time, self._started = snapshot.time, snapshot.started
        self._x[:], self._u[:], self._platform = snapshot.x, snapshot.u, snapshot.platform
        self._stepper.begin(self._platform, self._time, snapshot.internal_step, snapshot.largest_step)

    def __reduce__(self) -> tuple[Any, ...]:
        """The arguments and the state, for copies and pickles: models do not share memory."""
        return type(self), self._arguments, self.save_state()

    __setstate__ = restore_state

    def _refuse(self, variable: Variable, *, to_set: bool) -> None:
        """Refuse a variable that is not to be had, or cannot be set now."""
        name, part, kind = variable.name, variable.part, "state" if variable.is_state else "fixed parameter"
        if to_set and name == "fixed_step_size":
            raise InterfaceError(name, "is a parameter of the FMU; of the stepping model it is an argument")
        # those that choose the parts of a platform are there
        if part is not None and part not in self._variant.parts and name not in CHOOSING:
            raise InterfaceError(name, f"is nothing that this platform has: {_ABSENT[part]}")
        if not to_set:
            raise InterfaceError(name, f"{variable.description}; the stepping model has none")
        if variable in self._variant.results and not variable.is_state:
            raise InterfaceError(name, f"is computed ({variable.causality}); set inputs, parameters or states instead")
        if self._started and (variable.is_state or variable.variability == "fixed"):
            raise InterfaceError(name, f"is a {kind}, which can only be set before the first step; call reset() first")


class CompiledStepper:
    """A plant's state in the memory of a unit's component, and its steps; its vectors are views of that memory.

    x and u are written in place; `begin` is called after that of x.
    """

    def __init__(self, variant: Variant, tolerance: float, fixed_step_size: float) -> None:
        library, self._variant = stepper_library(variant), variant
        layout = (c_size_t * 13)()
        library.stepper_layout(layout)
        self._memory = memory = np.zeros(-(-layout[0] // 8))
        n, q, m = variant.n_states, variant.n_parameters, variant.n_results
        # in the order of c/stepper/stepper.c: time, internal step, handedness, largest step; u, x, p, y; failure
        sizes = (1, 1, 1, 1, N_INPUTS, n, q, m, 1, 1)
        views = [memory[place // 8 : place // 8 + size] for place, size in zip(layout[1:11], sizes, strict=True)]
        self._clock, (self.u, self.x, self.p, self.y, *self._failure) = views[:4], views[4:]
        self._texts = layout[11], layout[12]
        address, self._times = memory.ctypes.data_as(c_void_p), (c_double(), c_double())
        library.stepper_reset(address, c_double(tolerance), c_double(fixed_step_size))
        self._step = partial(library.stepper_step, address, *self._times)
        # writes the `results` of the present state and inputs
        self.find_results = partial(library.stepper_results, address)
        self._forget = partial(library.stepper_forget, address)
        self.results = interface.unpack(variant.unit_results, self.y)
        places = interface.places(variant.unit_results)
        # of the variant's results in y
        self.order = np.concatenate([places[v.name].ravel() for v in variant.results])

    @property
    def internal_step(self) -> float | None:
        """Size of the next internal step [s]; None before the first."""
        return float(self._clock[1][0]) or None

    @property
    def largest_step(self) -> float:
        """The largest fixed step that is stable, found in the first one under the present parameters [s]; 0 before."""
        return float(self._clock[3][0])

    def begin(self, platform: Platform, time: float, internal_step: float | None, largest_step: float = 0.0) -> None:
        """Go on with a platform from the state in x."""
        self.p[:] = parameter_vector(platform, self._variant)
        for k, value in ((0, time), (1, internal_step or 0.0), (3, largest_step)):
            self._clock[k][0] = value
        self._forget()

    def step(self, time: float, step: float) -> None:
        """Integrate from the component's time to `time + step`; a `StepError` leaves the plant as it was."""
        self._times[0].value, self._times[1].value = time, step
        if not self._step():
            memory, (failed_at, value) = self._memory.view(np.uint8), self._failure
            quantity, reason = (memory[at:].tobytes().partition(b"\0")[0].decode() for at in self._texts)
            raise StepError(quantity, float(value[0]), float(failed_at[0]), reason)


@cache
def stepper_library(variant: Variant) -> PyDLL:
    """The library of a variant: what came with the package, else compiled here; `NotInstalledError` if it cannot be."""
    library = kernel_library() if variant == IDEAL else None
    if library is not None:
        return library
    # in a process of its own: the model does not know what builds it
    command = [sys.executable, "-m", _COMPILER, *variant.parts]
    compilation = subprocess.run(command, capture_output=True, text=True, check=False)
    if compilation.returncode != 0:
        reason = compilation.stderr.strip()
        raise NotInstalledError(
            f"no machine code steps a platform {variant.words} on this machine, and it cannot be compiled: {reason}; "
            'or choose integrator="scipy"'
        )
    return PyDLL(compilation.stdout.strip())


class ScipyStepper:
    """The judge of compiled integration: the kernel's derivatives, integrated by SciPy under error control.

    By DOP853, or LSODA for bristles, which are stiff, and Radau if the tolerance is tight. The vectors x and u are read
    and written in place; `begin` is called after x has been written. Inputs are u at the begin of a step and change at
    `input_rates` within it, 0 unless they are written.
    """

    largest_step = 0.0

    def __init__(self, variant: Variant, tolerance: float) -> None:
        self.x, self.u, self.p = np.zeros(variant.n_states), np.zeros(N_INPUTS), np.zeros(variant.n_parameters)
        self.input_rates = np.zeros(N_INPUTS)
        self.internal_step: float | None = None
        self._variant, self._tolerance, self._kernel = variant, tolerance, Kernel(variant)
        # writes the results of the present state and inputs to y
        self.find_results = partial(self._kernel.outputs, self.x, self.u, self.p)
        self.y = self.find_results()
        self.order, self.results = np.arange(len(self.y)), interface.unpack(variant.results, self.y)

    def begin(self, platform: Platform, time: float, internal_step: float | None, _largest_step: float = 0.0) -> None:
        """Go on with a platform from the state in x."""
        self.p[:] = parameter_vector(platform, self._variant)
        self._platform, self._time, self.internal_step = platform, time, internal_step
        self._handedness: float | None = None

    def step(self, time: float, step: float) -> None:
        """Integrate from the present time to `time + step`; `StepError` beyond a pose's limit or the tolerance."""
        from scipy.integrate import DOP853, LSODA, Radau  # a third of a second of imports

        start, end, tolerance = self._time, time + step, self._tolerance
        side = self._handedness or check_pose(self._platform, self.x, start)

        def derivatives(time: float, x: FloatArray) -> FloatArray:
            return self._kernel.derivatives(x, self.u + self.input_rates * (time - start), self.p).copy()

        rule: Any = DOP853
        options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance * np.array(self._variant.scales)}
        if self._variant.bristles:
            rule = LSODA if tolerance >= _TIGHT else Radau
        elif self.internal_step is not None:
            options["first_step"] = min(self.internal_step, end - start)
        # a trial step can reach a pole: infinities there mean a rejected step and need no warning
        with np.errstate(all="ignore"):
            solver = rule(derivatives, start, self.x.copy(), end, **options)
            for steps in count(1):
                at = float(solver.t)
                if at >= end:
                    break
                if steps > MOST_INTERNAL_STEPS:
                    cause = (
                        f"too many internal steps for one step to time {end:g} s at tolerance {tolerance:g}; forces "
                        "too large, leg_friction_velocity too small, or step too long"
                    )
                    raise StepError("internal steps", steps, at, cause)
                # LSODA only tells the last one
                proposed = float(getattr(solver, "h_abs", solver.step_size or end - at))
                # if ẋ overflows, SciPy finds no first step size and would reduce it for ever
                if not proposed > 0 or solver.step() is not None or not np.isfinite(solver.y).all():
                    cause = f"the tolerance {tolerance:g} cannot be met; forces too large, or pose nearly singular"
                    raise StepError("internal step size", proposed, float(solver.t), cause)
                check_pose(self._platform, solver.y, float(solver.t), side)
        self.x[:], self._time, self._handedness = solver.y, end, side
        if not self._variant.bristles:
            # the last step was shortened to end on time; its original size carries over
            self.internal_step = max(proposed, float(solver.h_abs))


def _number(name: str, value: object) -> float:
    try:
        return float(real_array(value, ()))
    except ValueError as error:
        raise InterfaceError(name, str(error)) from None

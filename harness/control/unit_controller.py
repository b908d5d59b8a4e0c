"""A controller that is an FMU: exported by this project, or a third-party FMU with the same or other names."""

import math
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.isolated import Isolated
from gough_stewart.model.interface import BY_NAME, nearest
from gough_stewart.model.parameters import Variable
from gough_stewart.model.vectors import FloatArray

REFERENCE = "reference_"
# What its inputs may be: measurements and references, with their positions in the loop's two vectors.
INPUTS: tuple[tuple[str, Variable], ...] = (
    *((v.name, v) for v in signals.VARIABLES),
    *((REFERENCE + v.name, v) for v in signals.REFERENCES),
)
_FORCE, _LIMITED = "actuator_force", "force_limited"


@dataclass(frozen=True)
class UnitController:
    """An FMU for Co-Simulation, FMI 2.0 or 3.0, as controller; its own reference and feedforward, if any, are inside.

    At each sample it receives those of its inputs that have names of measured signals (`leg_length`, `leg_velocity`,
    `position`, …) or of references (`reference_leg_length`, `reference_position`, …, `reference_acceleration`), takes
    a step of one sample time, and then outputs `actuator_force`, so the loop has a delay of at least one sample. Other
    inputs keep their start values. It may have other names, as {"leg_length": "L", "actuator_force": "u_{}"}: an array,
    or scalars "L[1]" to "L[6]"; {} stands for a number from 1 on.
    """

    path: Path
    names: Mapping[str, str] = field(default_factory=dict)  # its own, where they differ
    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)  # start values, also of inputs, by its names
    is_foreign: bool = True  # whether it runs in its own process

    def __post_init__(self) -> None:
        possible = [*(name for name, _ in INPUTS), _FORCE, _LIMITED]
        for name in self.names:
            if name not in possible:
                raise ControllerError(f"names: no signal '{name}'{nearest(name, possible)}")

    def open(self, sample_time: float) -> "UnitLaw":
        """The FMU, ready for a run; close it afterwards."""
        arguments = (self.path, dict(self.names), dict(self.parameters), sample_time)
        if self.is_foreign:
            process = Isolated(self.path, f"{__name__}:ControllerUnit", arguments, ControllerError)
            return UnitLaw(partial(process.call, "step"), process.close, sample_time)
        unit = ControllerUnit(*arguments)
        return UnitLaw(unit.step, unit.close, sample_time)


@dataclass(eq=False)
class UnitLaw:
    """The FMU as control law of one member."""

    used = signals.NAMES
    step: Callable[..., FloatArray]
    close: Callable[[], None]
    sample_time: float
    limited: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(6, dtype=bool), init=False)

    def force(
        self, k: int, _time: float, reference: FloatArray, measured: FloatArray, _excess: FloatArray
    ) -> FloatArray:
        """The forces that the FMU outputs at the end of the sample."""
        outputs = self.step(k * self.sample_time, self.sample_time, np.concatenate([measured, reference]))
        self.limited = outputs[6:] > 0.5
        return outputs[:6]


class ControllerUnit:
    """The FMU, run by FMPy."""

    def __init__(self, path: Path, names: Mapping[str, str], parameters: Mapping[str, Any], sample_time: float) -> None:
        from fmpy.fmi1 import FMICallException

        from gough_stewart.harness.plants.unit import FmuFile, FmuInstance, Values

        class ControllerFile(FmuFile):
            error = ControllerError
            remedy = "`gough-stewart export` makes controller FMUs"

        self._names = names
        with ExitStack() as stack:
            self._file = file = stack.enter_context(ControllerFile(path))
            self._variables = {v.name: v for v in file.description.modelVariables}
            starts = {
                name: float(v.start)
                for name in ("sample_time", "output_delay")
                if (v := self._variables.get(name)) is not None and v.start is not None
            }
            designed = starts.get("sample_time", sample_time)
            if abs(designed - sample_time) > 1e-9 * sample_time:
                raise ControllerError(
                    f"{path}: its sample_time is {designed:g} s, the loop's {sample_time:g} s; export the "
                    "controller again, or set the loop's sample_time"
                )
            self._unit = stack.enter_context(FmuInstance(file, name="controller"))

            # its inputs, with their sources in measurements and references, and its outputs
            sources, references, first = list[int](), list[int](), 0
            for name, variable in INPUTS:
                of_input = self._references(name, variable, "input")
                if of_input is not None:
                    sources += range(first, first + variable.size)
                    references += of_input
                first += variable.size
            if not any(source < signals.SIZE for source in sources):
                raise file.refusal(
                    f"has no input of a measured signal ({', '.join(signals.NAMES)}); if its names differ, list them "
                    "in [controller.names]"
                )
            self._sources, self._inputs = sources, Values(self._unit, references, len(sources))
            force = self._references(_FORCE, BY_NAME[_FORCE], "output")
            if force is None:
                raise file.refusal(f"has no output {names.get(_FORCE, _FORCE)} with six elements")
            limited = self._references(_LIMITED, None, "output")
            self._force = Values(self._unit, force, 6)
            self._limited = None if limited is None else Values(self._unit, limited, 6)
            for name, value in parameters.items():
                numbers = np.ravel(np.asarray(value, dtype=float))
                size = len(numbers)
                needed, variables = self._elements(name, name + "[{}]", size)
                if len(variables) != len(needed) or (needed != [name] and f"{name}[{size + 1}]" in self._variables):
                    raise ControllerError(
                        f"{path}: no parameter {name} with {size} elements{nearest(name, list(self._variables))}"
                    )
                buffer = Values(self._unit, [v.valueReference for v in variables], size)
                buffer.array[:] = numbers
                try:
                    buffer.write()
                except FMICallException as error:
                    reason = self._unit.take_messages() or str(error)
                    raise ControllerError(f"{path}: {name} = {value} refused: {reason}") from error

            # of a unit of this project the loop has itself: a longer delay, drives and sensors
            delay = float(np.ravel(parameters.get("output_delay", starts.get("output_delay", 1.0)))[0])
            if delay != 1:
                raise ControllerError(
                    f"{path}: its output_delay is {delay:g} samples, which would be added to the loop's delay; "
                    "expected 1: set parameters = { output_delay = 1 } of [controller], and the loop's delay"
                )
            step = getattr(file.description.defaultExperiment, "stepSize", None)
            has_steps = step is not None and float(step) < 0.999 * sample_time
            has_drives = any(name.partition("[")[0] == "rate_limited" for name in self._variables)
            if "output_delay" in self._variables and (has_steps or has_drives):
                raise ControllerError(
                    f"{path}: it carries drives or sensors of its machine, which the loop has as well; expected "
                    "a controller that was exported without parts"
                )
            self._is_initialised = False
            self.close = stack.pop_all().close  # frees the FMU

    def step(self, time: float, step: float, values: FloatArray) -> FloatArray:
        """Forces (6,) [N], and which of them are limited (6,), after a step with these measurements and references."""
        from fmpy.fmi1 import FMICallException

        try:
            self._inputs.array[:] = values[self._sources]
            self._inputs.write()
            if not self._is_initialised:
                self._unit.initialise(time=time)
                self._is_initialised = True
            self._unit.do_step(time, step)
            self._force.read()
            if self._limited is None:
                return np.append(self._force.array, np.zeros(6))
            self._limited.read()
            return np.append(self._force.array, self._limited.array)
        except FMICallException as error:
            reason = self._unit.take_messages() or str(error)
            raise ControllerError(f"{self._file.path}: at time {time:.9g} s: {reason}") from error

    def _elements(self, name: str, pattern: str, size: int) -> tuple[list[str], list[Any]]:
        """Names that a signal of this size has, as an array or as scalars, and those of its variables that exist."""
        array = self._variables.get(name)
        if array is not None and math.prod(int(dimension.start or 0) for dimension in array.dimensions or ()) == size:
            return [name], [array]
        scalars = [pattern.replace("{}", str(k + 1)) for k in range(size)]
        return scalars, [self._variables[scalar] for scalar in scalars if scalar in self._variables]

    def _references(self, name: str, variable: Variable | None, causality: str) -> list[int] | None:
        """Value references of a signal, None if the FMU has no variable of that name."""
        theirs, size = self._names.get(name, name), 6 if variable is None else variable.size
        needed, variables = self._elements(theirs, theirs if "{}" in theirs else theirs + "[{}]", size)
        if not variables and name not in self._names:
            return None
        if len(variables) != len(needed):
            missing = next(scalar for scalar in needed if scalar not in self._variables)
            raise self._file.refusal(f"has no variable {missing} for {name}")
        for v in variables:
            if v.causality != causality:
                raise self._file.refusal(f"{v.name} is of causality {v.causality}; expected {causality} for {name}")
            if v.type not in ("Real", "Float64"):
                raise self._file.refusal(f"{v.name} is of type {v.type}; expected floating-point numbers")
            unit = v.unit or getattr(v.declaredType, "unit", None)
            if variable is not None and unit not in (None, "", variable.unit):
                raise self._file.refusal(f"{v.name} is in {unit}; expected {variable.unit} for {name}")
        return [v.valueReference for v in variables]

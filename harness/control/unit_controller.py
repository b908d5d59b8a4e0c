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
from gough_stewart.model import interface
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
                raise ControllerError(f"names: no signal '{name}'{interface.nearest(name, possible)}")

    def open(self, sample_time: float) -> "UnitLaw":
        """The FMU, ready for a run; close it afterwards.

        Raises
        ------
        ControllerError
            No such FMU, variables that do not fit, or another sample time.
        """
        arguments = (self.path, dict(self.names), dict(self.parameters), sample_time)
        if self.is_foreign:
            process = Isolated(self.path, f"{__name__}:ControllerUnit", arguments, ControllerError)
            return UnitLaw(partial(process.call, "step"), process.close, sample_time)
        unit = ControllerUnit(*arguments)
        return UnitLaw(unit.step, unit.close, sample_time)


class UnitLaw:
    """The FMU as control law of one member."""

    used = signals.NAMES

    def __init__(self, step: Callable[..., FloatArray], close: Callable[[], None], sample_time: float) -> None:
        self._step, self.close, self._sample_time = step, close, sample_time
        self.limited: NDArray[np.bool_] = np.zeros(6, dtype=bool)

    def force(
        self, k: int, _time: float, reference: FloatArray, measured: FloatArray, _excess: FloatArray
    ) -> FloatArray:
        """The forces that the FMU outputs at the end of the sample."""
        outputs = self._step(k * self._sample_time, self._sample_time, np.concatenate([measured, reference]))
        self.limited = outputs[6:] > 0.5
        return outputs[:6]

    def __enter__(self) -> "UnitLaw":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ControllerUnit:
    """The FMU, run by FMPy."""

    def __init__(self, path: Path, names: Mapping[str, str], parameters: Mapping[str, Any], sample_time: float) -> None:
        from gough_stewart.harness.plants.unit import FmuFile, FmuInstance, Values

        class ControllerFile(FmuFile):
            error = ControllerError
            remedy = "`gough-stewart export` makes controller FMUs"

        with ExitStack() as stack:
            self._file = file = stack.enter_context(ControllerFile(path))
            self._variables = {v.name: v for v in file.description.modelVariables}
            designed = self._start_of("sample_time")
            if designed is not None and abs(designed - sample_time) > 1e-9 * sample_time:
                raise ControllerError(
                    f"{path}: its sample_time is {designed:g} s, the loop's {sample_time:g} s; export the "
                    "controller again, or set the loop's sample_time"
                )
            self._unit = stack.enter_context(FmuInstance(file, name="controller"))
            self._source, references = self._inputs(names)
            self._inputs_of_unit = Values(self._unit, references, len(self._source))
            force = self._references(_FORCE, names, interface.BY_NAME[_FORCE], "output")
            if force is None:
                raise file.refusal(f"has no output {names.get(_FORCE, _FORCE)} with six elements")
            self._force = Values(self._unit, force, 6)
            limited = self._references(_LIMITED, names, None, "output")
            self._limited = None if limited is None else Values(self._unit, limited, 6)
            for name, value in parameters.items():
                self._set(name, value)
            self._check_loop(parameters, sample_time)
            self._is_initialised = False
            self._open = stack.pop_all()

    def step(self, time: float, step: float, values: FloatArray) -> FloatArray:
        """Forces (6,) [N], and which of them are limited (6,), after a step with these measurements and references."""
        from fmpy.fmi1 import FMICallException

        try:
            self._inputs_of_unit.array[:] = values[self._source]
            self._inputs_of_unit.write()
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

    def close(self) -> None:
        """Free the FMU."""
        self._open.close()

    def _start_of(self, name: str) -> float | None:
        start = getattr(self._variables.get(name), "start", None)
        return None if start is None else float(start)

    def _check_loop(self, parameters: Mapping[str, Any], sample_time: float) -> None:
        """Refuse of a unit of this project what the loop has itself: a longer delay, drives and sensors."""
        start = self._start_of("output_delay")
        delay = float(np.ravel(parameters.get("output_delay", 1.0 if start is None else start))[0])
        if delay != 1:
            raise ControllerError(
                f"{self._file.path}: its output_delay is {delay:g} samples, which would be added to the loop's delay; "
                "expected 1: set parameters = { output_delay = 1 } of [controller], and the loop's delay"
            )
        step = getattr(self._file.description.defaultExperiment, "stepSize", None)
        has_steps = step is not None and float(step) < 0.999 * sample_time
        has_drives = any(name.partition("[")[0] == "rate_limited" for name in self._variables)
        if "output_delay" in self._variables and (has_steps or has_drives):
            raise ControllerError(
                f"{self._file.path}: it carries drives or sensors of its machine, which the loop has as well; expected "
                "a controller that was exported without parts"
            )

    def _inputs(self, names: Mapping[str, str]) -> tuple[NDArray[np.intp], list[int]]:
        """The sources of its inputs in measurements and references, and their value references."""
        source: list[NDArray[np.intp]] = []
        references: list[int] = []
        first, is_fed_back = 0, False
        for name, variable in INPUTS:
            of_input = self._references(name, names, variable, "input")
            if of_input is not None:
                source.append(np.arange(first, first + variable.size))
                references += of_input
                is_fed_back |= not name.startswith(REFERENCE)
            first += variable.size
        if not is_fed_back:
            raise self._file.refusal(
                f"has no input of a measured signal ({', '.join(signals.NAMES)}); if its names differ, list them "
                "in [controller.names]"
            )
        return np.concatenate(source), references

    def _elements(self, name: str, pattern: str, size: int) -> tuple[list[str], list[Any]]:
        """Names that a signal of this size has, as an array or as scalars, and those of its variables that exist."""
        array = self._variables.get(name)
        if array is not None and math.prod(int(dimension.start or 0) for dimension in array.dimensions or ()) == size:
            return [name], [array]
        scalars = [pattern.replace("{}", str(k + 1)) for k in range(size)]
        return scalars, [self._variables[scalar] for scalar in scalars if scalar in self._variables]

    def _references(
        self, name: str, names: Mapping[str, str], variable: Variable | None, causality: str
    ) -> list[int] | None:
        """Value references of a signal, None if the FMU has no variable of that name."""
        theirs, size = names.get(name, name), 6 if variable is None else variable.size
        needed, variables = self._elements(theirs, theirs if "{}" in theirs else theirs + "[{}]", size)
        if not variables and name not in names:
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

    def _set(self, name: str, value: Any) -> None:
        """Set a parameter."""
        from fmpy.fmi1 import FMICallException

        from gough_stewart.harness.plants.unit import Values

        numbers = np.ravel(np.asarray(value, dtype=float))
        size = len(numbers)
        needed, variables = self._elements(name, name + "[{}]", size)
        if len(variables) != len(needed) or (needed != [name] and f"{name}[{size + 1}]" in self._variables):
            raise ControllerError(
                f"{self._file.path}: no parameter {name} with {size} "
                f"elements{interface.nearest(name, list(self._variables))}"
            )
        buffer = Values(self._unit, [v.valueReference for v in variables], size)
        buffer.array[:] = numbers
        try:
            buffer.write()
        except FMICallException as error:
            reason = self._unit.take_messages() or str(error)
            raise ControllerError(f"{self._file.path}: {name} = {value} refused: {reason}") from error

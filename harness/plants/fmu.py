"""The FMU as a plant: FMI 2.0 or 3.0, Co-Simulation, through FMPy."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import Plant, tunable
from gough_stewart.harness.plants.unit import FmuInstance, UnitFile
from gough_stewart.model import interface
from gough_stewart.model.dynamics import states_at
from gough_stewart.model.errors import StepError
from gough_stewart.model.interface import DEFAULT_TOLERANCE, Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

_DISCARD = 2


class FmuPlant(Plant):
    """An FMU of this project as a `Plant`; `close` removes its unpacked files.

    The platform for which the FMU was built does not matter: all parameters are set. `PlantError` for no such file, no
    FMU, one of another model, or one that does not run on this machine.
    """

    def __init__(
        self,
        path: Path | str | UnitFile,  # a `UnitFile` stays open
        platform: Platform,
        start: State | None = None,  # at time 0; the home pose at rest by default
        tolerance: float = DEFAULT_TOLERANCE,
        fixed_step_size: float = 0.0,  # 0 for error-controlled steps, or the step of RK4 [s]
    ) -> None:
        self._platform, self._variant = platform, Variant.of(platform)
        self.columns = self._variant.columns
        with ExitStack() as stack:
            file = path if isinstance(path, UnitFile) else stack.enter_context(UnitFile(path))
            self.path = file.path
            self.fmi_version = file.version
            if file.variant != self._variant:
                raise file.refusal(f"is built for a platform {file.variant.words}, not for one {self._variant.words}")
            self._unit = unit = stack.enter_context(FmuInstance(file))
            values: dict[str, ArrayLike] = {v.name: getattr(platform, v.name) for v in self._variant.parameters}
            values["fixed_step_size"] = fixed_step_size
            values |= interface.start_values(interface.INPUTS, platform)
            rest = np.zeros(3)
            begin = start or State(platform.home_position, platform.home_orientation, rest, rest)
            values |= states_at(platform, begin)
            self._checked("start values", unit.write_by_name, values)
            self._checked("initialisation", unit.initialise, tolerance)
            self._results = unit.values_of([v.name for v in self._variant.results])
            self._signals = unit.values_of(signals.NAMES)
            self._inputs = unit.values_of([v.name for v in interface.INPUTS])
            self._open = stack.pop_all()

    def set_inputs(self, inputs: FloatArray) -> None:
        self._inputs.array[:] = inputs
        self._checked("inputs", self._inputs.write)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        checked: dict[str, Any] = {
            name: interface.checked_value(tunable(self._variant, name), value) for name, value in values.items()
        }
        if not checked:
            return
        # the FMU checks elements one by one, and an inertia as a whole at the next step
        changed = replace(self._platform, **checked)
        self._checked("parameters", self._unit.write_by_name, checked)
        self._platform = changed

    def results(self) -> FloatArray:
        self._checked("results", self._results.read)
        return self._results.array.copy()

    def signals(self) -> FloatArray:
        self._checked("results", self._signals.read)
        return self._signals.array

    def do_step(self, time: float, step: float) -> None:
        try:
            self._unit.do_step(time, step)
        except FMICallException as error:
            reason = self._unit.take_messages() or str(error)
            if error.status == _DISCARD:
                raise StepError(f"FMU, FMI {self.fmi_version}: step", step, time, reason) from error
            raise PlantError(f"{self.path}: {reason}") from error
        self._check_alarm()

    def remarks(self) -> str:
        text = self._unit.take_messages()
        return f"{self.path}: {text}" if text else ""

    def close(self) -> None:
        self._open.close()

    def _checked(self, action: str, call: Callable[..., None], *arguments: Any) -> None:
        try:
            call(*arguments)
        except FMICallException as error:
            raise PlantError(f"{self.path}: {action} refused: {self._unit.take_messages() or error}") from error
        self._check_alarm()

    def _check_alarm(self) -> None:
        """Refuse a unit that reports a problem although its call succeeded."""
        if self._unit.is_alarmed:
            raise PlantError(f"{self.path}: {self._unit.take_messages()}")

"""The FMU as a plant: FMI 2.0 or 3.0, Co-Simulation, through FMPy."""

import tempfile
from collections.abc import Iterator, Mapping
from ctypes import POINTER, Array, byref, c_bool, c_double, c_uint
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, calloc, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, fmi2True, free
from fmpy.fmi3 import FMU3Slave

from gough_stewart.fmu_build.layout import BY_NAME
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.plant import TOLERANCE, Plant
from gough_stewart.model import interface
from gough_stewart.model.errors import InterfaceError, StepError
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

_DISCARD = 2
_REMEDY = "make one by `gough-stewart build`"


class FmuPlant(Plant):
    """An FMU of this project as a `Plant`; the file is unpacked once, and cleaned up by `close`.

    Any build will do: all parameters of the platform are set, whatever platform it was built for.

    Parameters
    ----------
    path
        The archive.
    platform, start
        Parameters, and the state at time 0; the home pose at rest by default.
    tolerance
        Of the integration.
    fixed_step_size
        0 for error-controlled steps, or the step of RK4 [s].

    Raises
    ------
    PlantError
        No such file, not an FMU, an FMU of another model, or one that does not run on this machine.
    """

    def __init__(
        self,
        path: Path | str,
        platform: Platform,
        start: State | None = None,
        tolerance: float = TOLERANCE,
        fixed_step_size: float = 0.0,
    ) -> None:
        self.path = Path(path)
        description = _description_of(self.path)
        self.fmi_version = str(description.fmiVersion)
        self._is_fmi2 = self.fmi_version == "2.0"
        self._said: list[str] = []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._unit: Any = None
        self._step_arguments: tuple[Any, ...] = ()
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True)
            fmpy.extract(str(self.path), unzipdir=self._folder.name)
            self._unit = self._instance(description)
            # everything that is called in each step has its buffers from here on
            self._results = _Values([v.name for v in interface.RESULTS], self._is_fmi2)
            self._inputs = _Values([v.name for v in interface.INPUTS], self._is_fmi2)
            self._initialise(platform, start, tolerance, fixed_step_size)
        except BaseException:
            self.close()
            raise

    def set_inputs(self, inputs: FloatArray) -> None:
        """Rule 2 of `Plant`."""
        self._inputs.array[:] = inputs
        self._checked("inputs", self._set_function, self._unit.component, *self._inputs.arguments)

    def set_parameters(self, values: Mapping[str, object]) -> None:
        """Rule 3 of `Plant`."""
        known = {}
        for name, value in values.items():
            variable, element = interface.find(name)
            if variable.variability != "tunable" or element is not None:
                tunable = ", ".join(v.name for v in interface.VARIABLES if v.variability == "tunable")
                raise InterfaceError(name, f"cannot be set during a run; expected one of {tunable}")
            known[name] = interface.checked_value(variable, value)
        buffer = _Values(list(known), self._is_fmi2)
        buffer.array[:] = np.concatenate([value.ravel() for value in known.values()])
        self._checked("parameters", self._set_function, self._unit.component, *buffer.arguments)

    def results(self) -> FloatArray:
        """Rule 4 of `Plant`."""
        self._checked("results", self._get_function, self._unit.component, *self._results.arguments)
        return self._results.array.copy()

    def do_step(self, time: float, step: float) -> None:
        """Rules 5 and 6 of `Plant`."""
        try:
            self._step_function(self._unit.component, time, step, *self._step_arguments)
        except FMICallException as error:
            if error.status == _DISCARD:
                raise StepError(f"FMU, FMI {self.fmi_version}: step", step, time, self._what_it_said(error)) from error
            raise PlantError(f"{self.path}: {self._what_it_said(error)}") from error
        self._refuse_messages()

    def close(self) -> None:
        """Rule 8 of `Plant`."""
        unit, self._unit = self._unit, None
        if unit is not None:
            unit.freeInstance()
        folder, self._folder = self._folder, None
        if folder is not None:
            folder.cleanup()

    # --- inside ------------------------------------------------------------------------------------------------

    def _instance(self, description: Any) -> Any:
        assert self._folder is not None
        arguments = {
            "guid": description.guid or description.instantiationToken,
            "unzipDirectory": self._folder.name,
            "modelIdentifier": description.coSimulation.modelIdentifier,
            "instanceName": "plant",
        }
        try:
            if self._is_fmi2:
                unit = FMU2Slave(**arguments)
                # kept on the unit, which calls them for as long as it lives
                unit.our_callbacks = fmi2CallbackFunctions()
                unit.our_callbacks.logger = fmi2CallbackLoggerTYPE(self._hear)
                unit.our_callbacks.allocateMemory = type(unit.our_callbacks.allocateMemory)(calloc)
                unit.our_callbacks.freeMemory = type(unit.our_callbacks.freeMemory)(free)
                unit.instantiate(callbacks=unit.our_callbacks, loggingOn=True)
                self._get_function, self._set_function = unit.fmi2GetReal, unit.fmi2SetReal
                self._step_function, self._step_arguments = unit.fmi2DoStep, (fmi2True,)
            else:
                unit = FMU3Slave(**arguments)
                unit.instantiate(loggingOn=True, logMessage=self._hear)
                self._get_function, self._set_function = unit.fmi3GetFloat64, unit.fmi3SetFloat64
                # of what the unit says about a step only the status matters here: it has no events, and returns early
                # only when asked to
                said = (c_bool(), c_bool(), c_bool(), c_double())
                self._step_function, self._step_arguments = unit.fmi3DoStep, (True, *(byref(each) for each in said))
        except Exception as error:  # FMPy raises it bare
            raise PlantError(
                f"{self.path}: does not run on this machine ({self._what_it_said(error)}); build it here by "
                "`gough-stewart build`"
            ) from error
        return unit

    def _initialise(self, platform: Platform, start: State | None, tolerance: float, fixed_step_size: float) -> None:
        values: dict[str, Any] = {v.name: getattr(platform, v.name) for v in interface.PLATFORM_PARAMETERS}
        values["fixed_step_size"] = fixed_step_size
        rest = np.zeros(3)
        values |= (start or State(platform.home_position, platform.home_orientation, rest, rest))._asdict()
        buffer = _Values(list(values), self._is_fmi2)
        buffer.array[:] = np.concatenate([np.ravel(value) for value in values.values()])
        self._checked("start values", self._set_function, self._unit.component, *buffer.arguments)
        if self._is_fmi2:
            self._checked("setup", self._unit.setupExperiment, tolerance)
            self._checked("initialisation", self._unit.enterInitializationMode)
        else:
            self._checked("initialisation", self._unit.enterInitializationMode, tolerance)
        self._checked("initialisation", self._unit.exitInitializationMode)

    def _checked(self, what: str, call: Any, *arguments: Any) -> None:
        try:
            call(*arguments)
        except FMICallException as error:
            raise PlantError(f"{self.path}: {what} refused: {self._what_it_said(error)}") from error
        self._refuse_messages()

    def _hear(self, *arguments: Any) -> None:
        # environment, in FMI 2.0 the instance's name, status, category, message
        self._said.append(arguments[-1].decode(errors="replace"))

    def _refuse_messages(self) -> None:
        if self._said:  # the unit has nothing to say as long as all is well
            raise PlantError(f"{self.path}: {self._what_it_said(None)}")

    def _what_it_said(self, error: Exception | None) -> str:
        said, self._said = self._said, []
        return "; ".join(said) or str(error)


class _Values:
    """Variables of the FMU with buffers for their values: what the getting and setting functions take."""

    def __init__(self, names: list[str], is_fmi2: bool) -> None:
        rows = [BY_NAME[name] for name in names]
        size = interface.size_of(row.variable for row in rows)
        if is_fmi2:
            references = [row.first + k for row in rows for k in range(row.variable.size)]
        else:
            references = [row.reference for row in rows]
        self.array = np.zeros(size)
        self._references: Array[c_uint] = (c_uint * len(references))(*references)
        values = self.array.ctypes.data_as(POINTER(c_double))
        self.arguments = (self._references, len(references), values) + (() if is_fmi2 else (size,))


def _description_of(path: Path) -> Any:
    if not path.is_file():
        raise PlantError(f"{path}: no such file; expected an FMU; {_REMEDY}")
    try:
        description = fmpy.read_model_description(str(path))
    except Exception as error:  # FMPy, zipfile and lxml each have their own
        raise PlantError(f"{path}: is not an FMU ({error}); {_REMEDY}") from error
    if description.coSimulation is None or description.fmiVersion not in ("2.0", "3.0"):
        kind = f"FMI {description.fmiVersion}"
        raise PlantError(
            f"{path}: {kind}, {description.modelName}; expected Co-Simulation of FMI 2.0 or 3.0; {_REMEDY}"
        )
    found = {v.name: v.valueReference for v in description.modelVariables}
    for name, reference in _references(is_fmi2=description.fmiVersion == "2.0"):
        if found.get(name) != reference:
            raise PlantError(
                f"{path}: is the FMU of another model or version, {description.modelName} (variable {name} not found "
                f"where it belongs); {_REMEDY}"
            )
    return description


def _references(is_fmi2: bool) -> Iterator[tuple[str, int]]:
    """Names of the interface with the value references that units of this project give them."""
    for variable in interface.VARIABLES:
        row = BY_NAME[variable.name]
        if is_fmi2:
            yield from ((name, row.first + k) for k, name in enumerate(variable.scalar_names))
        else:
            yield variable.name, row.reference

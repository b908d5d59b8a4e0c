"""FMUs in FMPy behind one face for both versions: names instead of value references, messages kept."""

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Model,
    FMU2Slave,
    calloc,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    free,
)
from fmpy.fmi3 import FMU3Model, FMU3Slave, fmi3Float64, fmi3Int32, fmi3ValueReference
from numpy.typing import ArrayLike, NDArray

from gough_stewart.fmu_build import layout
from gough_stewart.fmu_build.layout import ROWS
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform

OK, WARNING, DISCARD, ERROR = range(4)
N = interface.size_of(interface.STATES)


class Fmu:
    """An FMU unpacked."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = Path(fmpy.extract(str(path), unzipdir=tempfile.mkdtemp(dir=path.parent)))
        self.description = fmpy.read_model_description(str(path))

    @property
    def version(self) -> str:
        """2.0 or 3.0."""
        return str(self.description.fmiVersion)

    @property
    def token(self) -> str:
        """Guid or instantiation token."""
        return str(self.description.guid or self.description.instantiationToken)


@dataclass(frozen=True)
class Message:
    """What an instance told its importer."""

    status: int
    category: str
    text: str


class Plant:
    """An instance."""

    def __init__(self, fmu: Fmu, co_simulation: bool = True, logging: bool = True, **options: Any) -> None:
        self.is_fmi2 = fmu.version == "2.0"
        self.messages: list[Message] = []
        identifier = "gough_stewart"
        arguments = {
            "guid": options.pop("token", fmu.token),
            "unzipDirectory": str(fmu.folder),
            "modelIdentifier": identifier,
            "instanceName": options.pop("name", "plant"),
        }
        self.fmu: Any
        if self.is_fmi2:
            self.fmu = (FMU2Slave if co_simulation else FMU2Model)(**arguments)
            self._callbacks = fmi2CallbackFunctions()
            self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log2)
            self._callbacks.allocateMemory = type(self._callbacks.allocateMemory)(calloc)
            self._callbacks.freeMemory = type(self._callbacks.freeMemory)(free)
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=logging)
        else:
            self.fmu = (FMU3Slave if co_simulation else FMU3Model)(**arguments)
            self.fmu.instantiate(loggingOn=logging, logMessage=self._log3, **options)

    def _log2(self, _environment: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        assert name.decode() == self.fmu.instanceName
        self.messages.append(Message(status, category.decode(), message.decode()))

    def _log3(self, _environment: Any, status: int, category: bytes, message: bytes) -> None:
        self.messages.append(Message(status, category.decode(), message.decode()))

    # --- values ------------------------------------------------------------------------------------------------

    def references(self, name: str) -> list[int]:
        """Value references of a whole variable."""
        row = layout.BY_NAME[name]
        return list(range(row.first, row.first + row.variable.size)) if self.is_fmi2 else [row.reference]

    def set(self, name: str, value: ArrayLike) -> None:
        """Set a whole variable."""
        flat = np.ravel(np.asarray(value, dtype=float)).tolist()
        (self.fmu.setReal if self.is_fmi2 else self.fmu.setFloat64)(self.references(name), flat)

    def get(self, name: str) -> NDArray[np.float64]:
        """Value of a whole variable."""
        variable = layout.BY_NAME[name].variable
        if self.is_fmi2:
            flat = self.fmu.getReal(self.references(name))
        else:
            flat = self.fmu.getFloat64(self.references(name), nValues=variable.size)
        return np.array(flat).reshape(variable.shape)

    def everything(self) -> dict[str, NDArray[np.float64]]:
        """Every variable."""
        return {row.variable.name: self.get(row.variable.name) for row in ROWS}

    def set_platform(self, platform: Platform) -> None:
        """All parameters of a platform."""
        for v in interface.PLATFORM_PARAMETERS:
            self.set(v.name, getattr(platform, v.name))

    # --- life --------------------------------------------------------------------------------------------------

    def start(
        self,
        values: Mapping[str, ArrayLike] | None = None,
        tolerance: float | None = 1e-8,
        time: float = 0.0,
        stop: float | None = None,
        platform: Platform | None = None,
    ) -> "Plant":
        """Set values and go through initialisation; of Model Exchange on to continuous time."""
        if platform is not None:
            self.set_platform(platform)
        for name, value in (values or {}).items():
            self.set(name, value)
        if self.is_fmi2:
            self.fmu.setupExperiment(tolerance=tolerance, startTime=time, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(tolerance=tolerance, startTime=time, stopTime=stop)
        self.fmu.exitInitializationMode()
        if isinstance(self.fmu, FMU2Model):
            self.fmu.newDiscreteStates()
            self.fmu.enterContinuousTimeMode()
        elif isinstance(self.fmu, FMU3Model):
            self.fmu.updateDiscreteStates()
            self.fmu.enterContinuousTimeMode()
        return self

    def step(self, time: float, step: float) -> Any:
        """One communication step."""
        return self.fmu.doStep(time, step)

    @property
    def pose(self) -> NDArray[np.float64]:
        """Position and orientation."""
        return np.concatenate([self.get("position"), self.get("orientation")])

    # --- saved states ------------------------------------------------------------------------------------------

    def serialized(self) -> bytes:
        """The present state as bytes."""
        state = self.fmu.getFMUState()
        blob: bytes = self.fmu.serializeFMUState(state)
        self.fmu.freeFMUState(state)
        return blob

    def restore(self, blob: bytes) -> None:
        """Back to a state from bytes."""
        state = self.fmu.deserializeFMUState(blob)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)

    # --- sensitivities and rates -------------------------------------------------------------------------------

    def directional(self, unknown: str, known: str, seed: ArrayLike) -> NDArray[np.float64]:
        """Change of a whole unknown along a change of a whole known."""
        flat = np.ravel(np.asarray(seed, dtype=float)).tolist()
        size = layout.BY_NAME[unknown].variable.size
        arguments = (self.references(unknown), self.references(known), flat)
        if self.is_fmi2:
            return np.array(self.fmu.getDirectionalDerivative(*arguments))
        return np.array(self.fmu.getDirectionalDerivative(*arguments, nSensitivity=size))

    def output_rates(self, name: str) -> NDArray[np.float64]:
        """First time derivatives of an output."""
        references, size = self.references(name), layout.BY_NAME[name].variable.size
        if self.is_fmi2:
            return np.array(self.fmu.getRealOutputDerivatives(references, [1] * size))
        values = (fmi3Float64 * size)()
        self.fmu.fmi3GetOutputDerivatives(
            self.fmu.component, (fmi3ValueReference * 1)(*references), 1, (fmi3Int32 * 1)(1), values, size
        )
        return np.array(values)

    def free(self) -> None:
        """The end."""
        self.fmu.freeInstance()


@contextmanager
def plant(fmu: Fmu, co_simulation: bool = True, **options: Any) -> Iterator[Plant]:
    """An instance that is freed."""
    made = Plant(fmu, co_simulation, **options)
    try:
        yield made
    finally:
        made.free()


def refused(call: Any, *arguments: Any) -> int:
    """Status of a call that fails."""
    try:
        call(*arguments)
    except FMICallException as error:
        return int(error.status)
    return OK

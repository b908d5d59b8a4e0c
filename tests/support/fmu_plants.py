"""FMUs in FMPy behind one face for both versions: names instead of value references, messages kept."""

import atexit
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import fmi3Float64, fmi3Int32, fmi3ValueReference
from numpy.typing import ArrayLike, NDArray

from gough_stewart.fmu_build.layout import Layout
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.harness.plants.unit import FmuFile, FmuInstance, UnitFile
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform

OK, WARNING, DISCARD, ERROR = range(4)
N = interface.size_of(interface.STATES)


class Fmu(UnitFile):
    """An FMU of the plant, unpacked until the tests end."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        atexit.register(self.close)


class Plant(FmuInstance):
    """An instance with more of what FMPy can do; of the plant, unless it has another layout."""

    def __init__(self, fmu: FmuFile, co_simulation: bool = True, layout: Layout = PLANT, **options: Any) -> None:
        super().__init__(fmu, "CoSimulation" if co_simulation else "ModelExchange", **options)
        self.of, self.layout = fmu, layout

    # --- values ------------------------------------------------------------------------------------------------

    def references(self, name: str) -> list[int]:
        """Value references of a whole variable."""
        row = self.layout.by_name[name]
        return list(row.slots) if self.is_fmi2 else [row.reference]

    def set(self, name: str, value: ArrayLike) -> None:
        """Set a whole variable."""
        flat = np.ravel(np.asarray(value, dtype=float)).tolist()
        (self.fmu.setReal if self.is_fmi2 else self.fmu.setFloat64)(self.references(name), flat)

    def get(self, name: str) -> NDArray[np.float64]:
        """Value of a whole variable."""
        variable = self.layout.by_name[name].variable
        if self.is_fmi2:
            flat = self.fmu.getReal(self.references(name))
        else:
            flat = self.fmu.getFloat64(self.references(name), nValues=variable.size)
        return np.array(flat).reshape(variable.shape)

    def everything(self) -> dict[str, NDArray[np.float64]]:
        """Every variable."""
        return {row.variable.name: self.get(row.variable.name) for row in self.layout.rows}

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
        self.initialise(tolerance, time, stop)
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

    def set_input_rates(self, name: str, rates: ArrayLike) -> None:
        """First time derivatives of an input, FMI 2.0."""
        found, flat = self.references(name), np.ravel(np.asarray(rates, dtype=float)).tolist()
        self.fmu.setRealInputDerivatives(found, [1] * len(found), flat)

    # --- sensitivities and rates -------------------------------------------------------------------------------

    def directional(self, unknown: str, known: str, seed: ArrayLike) -> NDArray[np.float64]:
        """Change of a whole unknown along a change of a whole known."""
        flat = np.ravel(np.asarray(seed, dtype=float)).tolist()
        size = self.layout.by_name[unknown].variable.size
        arguments = (self.references(unknown), self.references(known), flat)
        if self.is_fmi2:
            return np.array(self.fmu.getDirectionalDerivative(*arguments))
        return np.array(self.fmu.getDirectionalDerivative(*arguments, nSensitivity=size))

    def output_rates(self, name: str) -> NDArray[np.float64]:
        """First time derivatives of an output."""
        found, size = self.references(name), self.layout.by_name[name].variable.size
        if self.is_fmi2:
            return np.array(self.fmu.getRealOutputDerivatives(found, [1] * size))
        values = (fmi3Float64 * size)()
        self.fmu.fmi3GetOutputDerivatives(
            self.fmu.component, (fmi3ValueReference * 1)(*found), 1, (fmi3Int32 * 1)(1), values, size
        )
        return np.array(values)


@contextmanager
def plant(fmu: FmuFile, co_simulation: bool = True, **options: Any) -> Iterator[Plant]:
    """An instance that is freed."""
    with Plant(fmu, co_simulation, **options) as made:
        yield made


def refused(call: Any, *arguments: Any) -> int:
    """Status of a call that fails."""
    try:
        call(*arguments)
    except FMICallException as error:
        return int(error.status)
    return OK

"""FMUs in FMPy behind one face for both versions, by names alone: nothing of the project is used."""

import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from ctypes import POINTER, c_double
from pathlib import Path
from typing import Any, NamedTuple, Self

import fmpy
import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, calloc, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, free
from fmpy.fmi3 import FMU3Model, FMU3Slave, fmi3Float64, fmi3Int32, fmi3ValueReference
from numpy.typing import ArrayLike, NDArray

OK, WARNING, DISCARD, ERROR = range(4)
POSE = ("position", "orientation")
STATES = (*POSE, "velocity", "angular_velocity")
_SCALAR = re.compile(r"(der\()?(\w+)(?:\[([\d,]+)\])?(\)?)")


class Whole(NamedTuple):
    """A variable with all its elements."""

    name: str
    shape: tuple[int, ...]
    references: list[int]  # of each element in FMI 2.0, of the array in FMI 3.0
    declared: list[Any]  # what FMPy reads of each of these


class Message(NamedTuple):
    """What an instance logs; FMI 3.0 has no name in it."""

    status: int
    category: str
    text: str
    instance: str | None


class NotInstantiatedError(Exception):
    """There is no instance; the message is what was logged."""


class Fmu:
    """An FMU unpacked beside itself."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.folder = Path(fmpy.extract(str(path), tempfile.mkdtemp(dir=path.parent)))
        self.description = fmpy.read_model_description(str(self.folder))
        self.version = str(self.description.fmiVersion)
        self.is_fmi2 = self.version == "2.0"
        self.token = str(self.description.guid or self.description.instantiationToken)
        self.variables = variables_of(self.description)


def variables_of(description: Any) -> dict[str, Whole]:
    """Whole variables by name, from the names and dimensions of the description."""
    found: dict[str, Whole] = {}
    for declared in description.modelVariables:
        match = _SCALAR.fullmatch(declared.name)
        assert match, declared.name
        name = f"{match[1] or ''}{match[2]}{match[4]}"
        indices = [int(k) for k in (match[3] or "").split(",") if k]
        shape = tuple(indices or [int(d.start) for d in declared.dimensions or []])
        before = found.get(name, Whole(name, (), [], []))
        references = [*before.references, int(declared.valueReference)]
        found[name] = Whole(name, shape, references, [*before.declared, declared])  # the last element has the shape
    return found


class Plant:
    """An instance of any unit, by its description."""

    def __init__(
        self,
        fmu: Any,
        co_simulation: bool = True,
        *,
        name: str = "plant",
        token: str | None = None,
        logging: bool = True,
        **options: Any,
    ) -> None:
        self.file, self.is_fmi2, self.co_simulation = fmu, fmu.is_fmi2, co_simulation
        self.variables = variables_of(fmu.description)
        self.messages: list[Message] = []
        kinds: Any = (FMU2Slave, FMU2Model) if self.is_fmi2 else (FMU3Slave, FMU3Model)
        self.fmu: Any = kinds[not co_simulation](
            guid=fmu.description.guid or fmu.description.instantiationToken if token is None else token,
            unzipDirectory=str(fmu.folder),
            modelIdentifier=fmu.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        try:
            if self.is_fmi2:
                self.callbacks = fmi2CallbackFunctions()  # used as long as the instance lives
                self.callbacks.logger = fmi2CallbackLoggerTYPE(self._on_log)
                self.callbacks.allocateMemory = type(self.callbacks.allocateMemory)(calloc)
                self.callbacks.freeMemory = type(self.callbacks.freeMemory)(free)
                self.fmu.instantiate(callbacks=self.callbacks, loggingOn=logging)
            else:
                self.fmu.instantiate(loggingOn=logging, logMessage=self._on_log, **options)
        except Exception as error:  # FMPy raises the base class
            self.fmu.freeLibrary()
            raise NotInstantiatedError(self.take_messages()) from error

    def _on_log(self, *arguments: Any) -> None:
        status, category, text = arguments[-3:]
        instance = arguments[1].decode() if self.is_fmi2 else None
        self.messages.append(Message(status, category.decode(), text.decode(), instance))

    def take_messages(self) -> str:
        """What was logged since the last call."""
        text = "; ".join(message.text for message in self.messages)
        self.messages.clear()
        return text

    def refuses(self, words: str, status: int, call: Any, *arguments: Any) -> None:
        """A call has this status, and says so with these words."""
        assert refused(call, *arguments) == status
        assert words in self.messages[-1].text

    def references(self, name: str) -> list[int]:
        return self.variables[name].references

    def size(self, *names: str) -> int:
        return sum(int(np.prod(self.variables[name].shape, dtype=int)) for name in names)

    def set(self, name: str, value: ArrayLike) -> None:
        """Set a whole variable; one number stands for an array of equal ones."""
        flat = np.broadcast_to(np.asarray(value, dtype=float), self.variables[name].shape).ravel().tolist()
        (self.fmu.setReal if self.is_fmi2 else self.fmu.setFloat64)(self.references(name), flat)

    def get(self, name: str) -> NDArray[np.float64]:
        if self.is_fmi2:
            flat = self.fmu.getReal(self.references(name))
        else:
            flat = self.fmu.getFloat64(self.references(name), nValues=self.size(name))
        return np.array(flat).reshape(self.variables[name].shape)

    def get_all(self, names: tuple[str, ...] | list[str]) -> NDArray[np.float64]:
        """Elements of several variables, one after the other."""
        return np.concatenate([np.ravel(self.get(name)) for name in names])

    def everything(self) -> dict[str, NDArray[np.float64]]:
        return {name: self.get(name) for name in self.variables}

    @property
    def pose(self) -> NDArray[np.float64]:
        return self.get_all(POSE)

    @property
    def time(self) -> float:
        """The present time; in FMI 2.0 only of Co-Simulation, after the start."""
        return float(self.fmu.getRealStatus(2) if self.is_fmi2 else self.get("time"))  # 2: fmi2LastSuccessfulTime

    def start(
        self,
        values: Mapping[str, ArrayLike] | None = None,
        tolerance: float | None = 1e-8,
        time: float = 0.0,
        stop: float | None = None,
        platform: Any = None,
    ) -> Self:
        """Set parameters and values, and initialise."""
        for name, whole in self.variables.items() if platform is not None else ():
            if whole.declared[0].causality == "parameter" and hasattr(platform, name):
                self.set(name, getattr(platform, name))
        for name, value in (values or {}).items():
            self.set(name, value)
        self.initialise(tolerance, time, stop)
        return self

    def initialise(self, tolerance: float | None = None, time: float = 0.0, stop: float | None = None) -> None:
        """Go through initialisation; of Model Exchange on to continuous time."""
        times = {"tolerance": tolerance, "startTime": time, "stopTime": stop}
        if self.is_fmi2:
            self.fmu.setupExperiment(**times)
        self.fmu.enterInitializationMode(**({} if self.is_fmi2 else times))
        self.fmu.exitInitializationMode()
        if not self.co_simulation:
            self.leave_event_mode()

    def leave_event_mode(self) -> None:
        news = self.fmu.newDiscreteStates() if self.is_fmi2 else self.fmu.updateDiscreteStates()
        assert not any(news[:5])  # there are no events
        self.fmu.enterContinuousTimeMode()

    def do_step(self, time: float, step: float) -> Any:
        return self.fmu.doStep(time, step)

    def free(self) -> None:
        """Free the instance; may be called again."""
        fmu, self.fmu = self.fmu, None
        if fmu is not None:
            fmu.freeInstance()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.free()

    def serialized(self) -> bytes:
        state = self.fmu.getFMUState()
        blob: bytes = self.fmu.serializeFMUState(state)
        self.fmu.freeFMUState(state)
        return blob

    def restore(self, blob: bytes) -> None:
        state = self.fmu.deserializeFMUState(blob)
        self.fmu.setFMUState(state)
        self.fmu.freeFMUState(state)

    def directional(self, unknown: str, known: str, seed: ArrayLike) -> NDArray[np.float64]:
        """Change of a whole unknown along a change of a whole known."""
        arguments = (self.references(unknown), self.references(known), np.ravel(seed).astype(float).tolist())
        options = {} if self.is_fmi2 else {"nSensitivity": self.size(unknown)}
        return np.array(self.fmu.getDirectionalDerivative(*arguments, **options))

    def set_input_rates(self, name: str, rates: ArrayLike) -> None:
        """First time derivatives of an input, FMI 2.0."""
        references = self.references(name)
        self.fmu.setRealInputDerivatives(references, [1] * len(references), np.ravel(rates).astype(float).tolist())

    def output_rates(self, name: str) -> NDArray[np.float64]:
        references, size = self.references(name), self.size(name)
        if self.is_fmi2:
            return np.array(self.fmu.getRealOutputDerivatives(references, [1] * size))
        values = (fmi3Float64 * size)()
        self.fmu.fmi3GetOutputDerivatives(
            self.fmu.component, (fmi3ValueReference * 1)(*references), 1, (fmi3Int32 * 1)(1), values, size
        )
        return np.array(values)

    def get_states(self, n: int = 12) -> NDArray[np.float64]:
        return self._filled(self.fmu.getContinuousStates, n)

    def set_states(self, x: ArrayLike) -> None:
        flat = np.ravel(x).astype(float)
        self.fmu.setContinuousStates(flat.ctypes.data_as(POINTER(c_double)), len(flat))

    def state_rates(self, n: int = 12) -> NDArray[np.float64]:
        return self._filled(self.fmu.getDerivatives if self.is_fmi2 else self.fmu.getContinuousStateDerivatives, n)

    def nominals(self, n: int = 12) -> NDArray[np.float64]:
        return self._filled(self.fmu.getNominalsOfContinuousStates, n)

    def _filled(self, call: Any, n: int) -> NDArray[np.float64]:
        values = (c_double * n)()
        call(values, n)
        return np.array(values)


def by_element(fmu: Fmu, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values as FMPy's simulation takes them: scalars in FMI 2.0, lists in FMI 3.0."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        flat, whole = np.ravel(value).astype(float).tolist(), fmu.variables[name]
        names = [declared.name for declared in whole.declared]
        found |= dict(zip(names, flat, strict=True)) if fmu.is_fmi2 else {name: flat if whole.shape else flat[0]}
    return found


@contextmanager
def plant(fmu: Any, co_simulation: bool = True, **options: Any) -> Iterator[Plant]:
    with Plant(fmu, co_simulation, **options) as instance:
        yield instance


def refused(call: Any, *arguments: Any, **options: Any) -> int:
    """Status of a call; `OK` if it succeeds."""
    try:
        call(*arguments, **options)
    except FMICallException as error:
        return int(error.status)
    return OK

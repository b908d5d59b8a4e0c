"""A client of clocked controllers that knows nothing but their file: FMPy's low-level calls, in both kinds."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3ScheduledExecution, FMU3Slave, fmi3Float64, fmi3IntervalQualifier, fmi3ValueReference

from gough_stewart.model.vectors import FloatArray
from tests.support.sampled_unit import Outputs

Kind = Literal["CoSimulation", "ScheduledExecution"]
OUTPUTS = ("actuator_force", "force_limited", "input_status", "input_bad_time")
Values = Mapping[str, FloatArray]


class Clocked:
    """An instance; `fmu` is FMPy's."""

    def __init__(self, path: Path, kind: Kind = "CoSimulation") -> None:
        self.folder = path.with_suffix("")
        if not self.folder.exists():
            fmpy.extract(str(path), str(self.folder))
        self.description: Any = fmpy.read_model_description(str(self.folder))
        self.kind, self.messages = kind, list[str]()
        variables = {v.name: v for v in self.description.modelVariables}
        self.references = {name: v.valueReference for name, v in variables.items()}
        self.sizes = {n: int(np.prod([d.start for d in v.dimensions or []], dtype=int)) for n, v in variables.items()}
        (self.clock,) = [v for v in variables.values() if v.type == "Clock"]
        # FMPy 0.3.32 reads the clock, and not its interval
        (described,) = ElementTree.parse(self.folder / "modelDescription.xml").iter("Clock")
        self.interval = float(described.get("intervalDecimal", "nan"))
        kinds = {"CoSimulation": FMU3Slave, "ScheduledExecution": FMU3ScheduledExecution}
        self.fmu: Any = kinds[kind](
            guid=self.description.instantiationToken,
            unzipDirectory=str(self.folder),
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="controller",
        )

    def hear(self, *arguments: Any) -> None:
        """Keep a message."""
        self.messages.append(arguments[-1].decode())

    def instantiate(self, **options: Any) -> "Clocked":
        """In the state after instantiation; event mode is used unless it is said otherwise."""
        if self.kind == "CoSimulation":
            self.fmu.instantiate(logMessage=self.hear, loggingOn=True, **({"eventModeUsed": True} | options))
        else:
            self.fmu.instantiate(logMessage=self.hear, loggingOn=True, **options)
        return self

    def get(self, name: str) -> FloatArray:
        """A variable (n,)."""
        return np.array(self.fmu.getFloat64([self.references[name]], nValues=self.sizes[name]))

    def set(self, values: Values) -> None:
        """Variables by name."""
        for name, value in values.items():
            self.fmu.setFloat64([self.references[name]], np.ravel(np.asarray(value, dtype=float)).tolist())

    def initialise(self, start: float = 0.0, stop: float | None = None, values: Values | None = None) -> "Clocked":
        """To the first event, or to clock activation mode; with values of initialization mode."""
        self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self.set(values or {})
        self.fmu.exitInitializationMode()
        return self

    def activate(self, *, active: bool = True) -> None:
        """Set the clock."""
        self.fmu.setClock([self.clock.valueReference], [active])

    def read_interval(self) -> float:
        """What the unit says."""
        values, qualifiers = (fmi3Float64 * 1)(), (fmi3IntervalQualifier * 1)()
        self.fmu.getIntervalDecimal((fmi3ValueReference * 1)(self.clock.valueReference), values, qualifiers)
        return float(values[0])

    def write_interval(self, interval: float) -> None:
        """As an importer that has another."""
        self.fmu.setIntervalDecimal((fmi3ValueReference * 1)(self.clock.valueReference), (fmi3Float64 * 1)(interval))

    def activate_partition(self, time: float) -> None:
        """Scheduled Execution."""
        self.fmu.activateModelPartition(self.clock.valueReference, time)

    def tick(self, time: float, inputs: Values) -> list[FloatArray]:
        """The outputs of a tick at the current time."""
        if self.kind == "ScheduledExecution":
            self.set(inputs)
            self.activate_partition(time)
            return [self.get(name) for name in OUTPUTS]
        self.activate()
        self.set(inputs)
        found = [self.get(name) for name in OUTPUTS]
        self.fmu.updateDiscreteStates()
        for before, name in zip(found, OUTPUTS, strict=True):
            np.testing.assert_array_equal(self.get(name), before)
        return found

    def pass_time(self, time: float, step: float) -> None:
        """From event mode over a communication step to event mode."""
        self.fmu.enterStepMode()
        self.fmu.doStep(time, step)
        self.fmu.enterEventMode()


@contextmanager
def clocked(path: Path, kind: Kind = "CoSimulation", **options: Any) -> Iterator[Clocked]:
    """An instance that is freed."""
    unit = Clocked(path, kind).instantiate(**options)
    try:
        yield unit
    finally:
        unit.fmu.freeInstance()


def run_clocked(
    path: Path, inputs: Sequence[Values], start: float, kind: Kind = "CoSimulation", values: Values | None = None
) -> Outputs:
    """The outputs of all ticks from the start time on; time passes in two communication steps between them."""
    found = []
    with clocked(path, kind) as unit:
        unit.initialise(start, values=values)
        for k, row in enumerate(inputs):
            time = start + k * unit.interval
            found.append(unit.tick(time, row))
            if kind == "CoSimulation":
                unit.pass_time(time, unit.interval / 2)
                unit.pass_time(time + unit.interval / 2, start + (k + 1) * unit.interval - time - unit.interval / 2)
        unit.fmu.terminate()
    force, limited, status, bad = (np.array(each) for each in zip(*found, strict=True))
    return Outputs(force, limited, status[:, 0], bad[:, 0])

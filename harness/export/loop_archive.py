"""The whole loop as SSP: plant and controller as connected FMUs in one archive."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

from gough_stewart.fmu_build.build import to_zip, unit_archives
from gough_stewart.fmu_build.component import Role, UnitComponent
from gough_stewart.fmu_build.documents import rendered
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.export.system_structure import (
    Component,
    Connection,
    Connector,
    System,
    parameter_values,
    system_structure,
)
from gough_stewart.harness.plants.signals import AT_MOTORS, Side
from gough_stewart.model.process.progress import StepProgress

PLANT, CONTROLLER = "plant", "controller"
STRUCTURE = "SystemStructure.ssd"
PAGE = "documentation/index.html"


def loop_archive(
    name: str,
    plant: UnitComponent,
    controller: UnitComponent,
    duration: float,
    step: float,
    targets: Iterable[Target],
    notes: Iterable[str] = (),
    *,
    fmi_version: str = "2.0",
    side: Side = "leg",
    progress: StepProgress | None = None,
) -> bytes:
    """The archive: SystemStructure.ssd, both FMUs, their parameters again as an SSV file, and a page.

    Parameters
    ----------
    duration
        Of the experiment [s].
    step
        Of the master, the controller's clock [s].
    notes
        Paragraphs about the loop, for the page and the description of the system.
    fmi_version
        Of both units. All importers of SSP 1.0 support "2.0"; with "3.0" the units describe scalars, too, since
        connectors of SSP 1.0 have no dimensions.
    side
        Of legs that give, where encoders read.
    """
    targets, notes = tuple(targets), tuple(notes)
    plant, controller = (replace(each, has_scalars_only=True) for each in (plant, controller))
    units = {
        unit: next(iter(unit_archives(component, (fmi_version,), targets, progress).values()))
        for unit, component in ((PLANT, plant), (CONTROLLER, controller))
    }
    system = replace(loop_system(name, plant, controller, duration, step, side), description=" ".join(notes))
    return to_zip(
        {
            STRUCTURE: system_structure(system),
            PAGE: rendered("loop.html", title=f"{name}: plant and controller", notes=notes),
            f"resources/{name}.ssv": parameter_values(system),
            **{_source(unit): content for unit, content in units.items()},
        }
    )


def loop_system(
    name: str, plant: UnitComponent, controller: UnitComponent, duration: float, step: float, side: Side = "leg"
) -> System:
    """Plant and controller, with each output of one connected to the input of the same name, element by element.

    Encoders at the motors' side of legs that give read that.
    """
    forth, back = _shared(plant, controller), _shared(controller, plant)
    at_motors = side == "motor" and AT_MOTORS["leg_length"] in plant.layout.by_name
    read = tuple(AT_MOTORS.get(each, each) for each in forth) if at_motors else forth
    pairs = zip(_scalars(plant, read), _scalars(controller, forth), strict=True)
    return System(
        name,
        (_component(PLANT, plant, back, read), _component(CONTROLLER, controller, forth, back)),
        (
            *(Connection((PLANT, output), (CONTROLLER, scalar)) for output, scalar in pairs),
            *(Connection((CONTROLLER, scalar), (PLANT, scalar)) for scalar in _scalars(plant, back)),
        ),
        duration,
        step,
    )


def _shared(source: UnitComponent, sink: UnitComponent) -> tuple[str, ...]:
    """Names of the outputs of one that are inputs of the other."""
    outputs = {row.variable.name for row in source.layout.outputs()}
    return tuple(row.variable.name for row in sink.layout.of_role(Role.INPUT) if row.variable.name in outputs)


def _scalars(component: UnitComponent, names: Iterable[str]) -> list[str]:
    return [scalar for name in names for scalar in component.layout.by_name[name].variable.scalar_names]


def _component(name: str, unit: UnitComponent, inputs: Iterable[str], outputs: Iterable[str]) -> Component:
    rows = unit.layout.by_name
    ends: tuple[tuple[Literal["input", "output"], Iterable[str]], ...] = (("input", inputs), ("output", outputs))
    connectors = tuple(
        Connector(scalar, kind, rows[variable].variable.unit)
        for kind, names in ends
        for variable in names
        for scalar in rows[variable].variable.scalar_names
    )
    parameters = {
        scalar: (float(value), row.variable.unit)
        for row in unit.layout.of_role(Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
        for scalar, value in zip(row.variable.scalar_names, unit.starts[row.variable.name].flat, strict=True)
    }
    return Component(name, _source(name), connectors, parameters)


def _source(unit: str) -> str:
    return f"resources/{unit}.fmu"

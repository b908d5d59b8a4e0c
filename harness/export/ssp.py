"""A loop as SSP: plant and controller as connected FMUs in one archive, with SystemStructure.ssd and parameter sets.

Limited to what the tested importers read: one flat system without its own connectors, scalars with `ssc:Real` in every
connector, connected connectors only, the standard's prefixes, SI units.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from lxml import etree

from gough_stewart.fmu_build.build import to_zip, unit_archives
from gough_stewart.fmu_build.component import Role, UnitComponent
from gough_stewart.fmu_build.documents import BY_NAME, installed_package, rendered, xml_text
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.plants.signals import AT_MOTORS, Side
from gough_stewart.model.process.progress import StepProgress

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
# libcosim reads the step from its own annotation; it mistakes a prefix declared there for an algorithm
_OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
# OMSimulator reads the step of its master from the annotations of the system
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_PREFIXES = {"ssd": _SSD, "ssc": _SSC, "ssv": _SSV, "osp": _OSP, "oms": _OMS}
_FMU = "application/x-fmu-sharedlibrary"


@dataclass(frozen=True)
class Connector:
    """A scalar input or output of an FMU."""

    name: str
    kind: Literal["input", "output"]
    unit: str


@dataclass(frozen=True)
class Component:
    """An FMU in a system."""

    name: str
    source: str  # path in the archive
    connectors: tuple[Connector, ...]
    parameters: Mapping[str, tuple[float, str]]  # value and unit, by scalar name


@dataclass(frozen=True)
class Connection:
    """From an output to an input, each as (component, connector)."""

    start: tuple[str, str]
    end: tuple[str, str]


@dataclass(frozen=True)
class System:
    """FMUs and their connections.

    Raises
    ------
    ExportError
        A component whose name begins with another's, since FMPy would confuse them, or a connection to a missing
        connector.
    """

    name: str
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    duration: float  # [s]
    step: float  # of the master [s]
    description: str = ""
    version: str = "1.0"  # of SSP

    def __post_init__(self) -> None:
        names = [component.name for component in self.components]
        for k, name in enumerate(names):
            for other in names[:k] + names[k + 1 :]:
                if other.startswith(name):
                    raise ExportError(
                        f"components are named '{name}' and '{other}'; expected names of which none begins with "
                        "another, since FMPy finds parameters by the beginning of their names"
                    )
        ends = {(c.name, connector.name): connector.kind for c in self.components for connector in c.connectors}
        for connection in self.connections:
            for end, kind in ((connection.start, "output"), (connection.end, "input")):
                if ends.get(end) != kind:
                    raise ExportError(f"no {kind} '{end[1]}' of '{end[0]}' to connect")


def system_structure(system: System) -> bytes:
    """SystemStructure.ssd of a system, including its parameter values."""
    package = installed_package()[0]
    root = etree.Element(_ssd("SystemStructureDescription"), nsmap=_PREFIXES, version=system.version, name=system.name)
    root.set("generationTool", f"gough-stewart {package['Version']}")
    if system.description:
        root.set("description", xml_text(system.description))
    whole = etree.SubElement(root, _ssd("System"), name=system.name)
    elements = etree.SubElement(whole, _ssd("Elements"))
    for component in system.components:
        _add_component(elements, component, system.version)
    connections = etree.SubElement(whole, _ssd("Connections"))
    for connection in system.connections:
        ends = {"startElement": connection.start[0], "startConnector": connection.start[1]}
        ends |= {"endElement": connection.end[0], "endConnector": connection.end[1]}
        etree.SubElement(connections, _ssd("Connection"), ends)
    information = _annotation(whole, "org.openmodelica", f"{{{_OMS}}}Annotations", f"{{{_OMS}}}SimulationInformation")
    master = {"description": "oms-ma", "absoluteTolerance": "1e-4", "relativeTolerance": "1e-4"}
    etree.SubElement(information, f"{{{_OMS}}}FixedStepMaster", master, stepSize=repr(system.step))
    units = {connector.unit for component in system.components for connector in component.connectors}
    _add_units(root, _ssd("Units"), units)
    experiment = etree.SubElement(root, _ssd("DefaultExperiment"), startTime="0", stopTime=repr(system.duration))
    algorithm = _annotation(experiment, "com.opensimulationplatform", f"{{{_OSP}}}Algorithm")
    etree.SubElement(algorithm, f"{{{_OSP}}}FixedStepAlgorithm", baseStepSize=repr(system.step))
    return _to_bytes(root)


def _annotation(parent: etree._Element, kind: str, *tags: str) -> etree._Element:
    """The innermost element of an annotation, of those with these names."""
    element = etree.SubElement(etree.SubElement(parent, _ssd("Annotations")), f"{{{_SSC}}}Annotation", type=kind)
    for tag in tags:
        element = etree.SubElement(element, tag)
    return element


def parameter_values(system: System) -> bytes:
    """The parameters of all components as one SSV file, named `component.parameter` as its importers expect."""
    root = etree.Element(f"{{{_SSV}}}ParameterSet", nsmap={"ssv": _SSV, "ssc": _SSC}, name=system.name)
    root.set("version", system.version)
    _add_parameters(
        root, ((f"{c.name}.{name}", value) for c in system.components for name, value in c.parameters.items())
    )
    _add_units(root, f"{{{_SSV}}}Units", {unit for c in system.components for _, unit in c.parameters.values()})
    return _to_bytes(root)


def _add_component(elements: etree._Element, component: Component, version: str) -> None:
    element = etree.SubElement(
        elements,
        _ssd("Component"),
        name=component.name,
        type=_FMU,
        source=component.source,
        implementation="CoSimulation",
    )
    connectors = etree.SubElement(element, _ssd("Connectors"))
    for connector in component.connectors:
        place = etree.SubElement(connectors, _ssd("Connector"), name=connector.name, kind=connector.kind)
        etree.SubElement(place, f"{{{_SSC}}}Real", unit=connector.unit)
    bindings = etree.SubElement(element, _ssd("ParameterBindings"))
    binding = etree.SubElement(bindings, _ssd("ParameterBinding"), type="application/x-ssp-parameter-set")
    values = etree.SubElement(binding, _ssd("ParameterValues"))
    parameters = etree.SubElement(values, f"{{{_SSV}}}ParameterSet", version=version, name=component.name)
    _add_parameters(parameters, component.parameters.items())
    _add_units(parameters, f"{{{_SSV}}}Units", {unit for _, unit in component.parameters.values()})


def _add_parameters(parent: etree._Element, parameters: Iterable[tuple[str, tuple[float, str]]]) -> None:
    whole = etree.SubElement(parent, f"{{{_SSV}}}Parameters")
    for name, (value, unit) in parameters:
        parameter = etree.SubElement(whole, f"{{{_SSV}}}Parameter", name=name)
        real = etree.SubElement(parameter, f"{{{_SSV}}}Real", value=repr(float(value)))
        if unit:
            real.set("unit", unit)


def _add_units(parent: etree._Element, tag: str, names: set[str]) -> None:
    units = etree.SubElement(parent, tag)
    for name in sorted(names - {""}):
        unit = etree.SubElement(units, f"{{{_SSC}}}Unit", name=name)
        exponents = {base: str(power) for base, power in BY_NAME[name].exponents.items()}
        etree.SubElement(unit, f"{{{_SSC}}}BaseUnit", exponents)


def _ssd(name: str) -> str:
    return f"{{{_SSD}}}{name}"


def _to_bytes(root: etree._Element) -> bytes:
    return bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True))


# --- the loop of an experiment --------------------------------------------------------------------------

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
    ssp_version: str = "1.0",
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
    ssp_version
        "2.0" says what "1.0" does, for importers that expect it.
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
    system = replace(system, version=ssp_version)
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

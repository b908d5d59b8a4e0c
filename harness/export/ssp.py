"""A loop as SSP: plant and controller as connected FMUs in one archive, with SystemStructure.ssd and a parameter set.

Limited to what the tested importers read: one flat system without its own connectors, scalars with `ssc:Real` in every
connector, connected connectors only, the standard's prefixes, SI units, and components of which no name begins with
another's, since FMPy finds parameters by the beginning of their names.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from lxml import etree

from gough_stewart.fmu_build.build import to_zip, unit_archives
from gough_stewart.fmu_build.component import Role, UnitComponent
from gough_stewart.fmu_build.documents import BY_NAME, installed_package, rendered, xml_text
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.plants.signals import AT_MOTORS, Side
from gough_stewart.model.process.progress import StepProgress

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"
_SSV = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"
# libcosim reads the step from its own annotation, and mistakes a prefix declared there for an algorithm; OMSimulator
# reads it from one of the system
_OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_PREFIXES = {"ssd": _SSD, "ssc": _SSC, "ssv": _SSV, "osp": _OSP, "oms": _OMS}
PLANT, CONTROLLER = "plant", "controller"
# Value and unit, by scalar name.
Values = Mapping[str, tuple[float, str]]


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
    components = {PLANT: replace(plant, has_scalars_only=True), CONTROLLER: replace(controller, has_scalars_only=True)}
    units = {
        f"resources/{key}.fmu": next(iter(unit_archives(unit, (fmi_version,), targets, progress).values()))
        for key, unit in components.items()
    }
    structure = system_structure(name, components, duration, step, " ".join(notes), version=ssp_version, side=side)
    return to_zip(
        {
            "SystemStructure.ssd": structure,
            "documentation/index.html": rendered("loop.html", title=f"{name}: plant and controller", notes=notes),
            f"resources/{name}.ssv": parameter_values(name, components, ssp_version),
            **units,
        }
    )


def system_structure(
    name: str,
    components: Mapping[str, UnitComponent],
    duration: float,
    step: float,
    description: str = "",
    *,
    version: str = "1.0",
    side: Side = "leg",
) -> bytes:
    """SystemStructure.ssd of a plant and a controller, each output connected to the input of the same name.

    Encoders at the motors' side of legs that give read that.
    """
    root = etree.Element(_ssd("SystemStructureDescription"), nsmap=_PREFIXES, version=version, name=name)
    root.set("generationTool", f"gough-stewart {installed_package()[0]['Version']}")
    if description:
        root.set("description", xml_text(description))
    system = etree.SubElement(root, _ssd("System"), name=name)
    elements, connections = etree.SubElement(system, _ssd("Elements")), etree.Element(_ssd("Connections"))
    at_motors = side == "motor" and AT_MOTORS["leg_length"] in components[PLANT].layout.by_name
    # component, direction, scalar, and unit
    ends: list[tuple[str, str, str, str]] = []
    for source, sink in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
        rows, wanted = components[source].layout, components[sink].layout
        outputs = {row.variable.name for row in rows.outputs()}
        for row in wanted.of_role(Role.INPUT):
            variable = row.variable
            if variable.name not in outputs:
                continue
            read = AT_MOTORS.get(variable.name, variable.name) if at_motors and source == PLANT else variable.name
            for out, into in zip(rows.by_name[read].variable.scalar_names, variable.scalar_names, strict=True):
                ends += [(source, "output", out, variable.unit), (sink, "input", into, variable.unit)]
                connection = {"startElement": source, "startConnector": out, "endElement": sink, "endConnector": into}
                etree.SubElement(connections, _ssd("Connection"), connection)
    for key, unit in components.items():
        attributes = {"name": key, "type": "application/x-fmu-sharedlibrary", "source": f"resources/{key}.fmu"}
        component = etree.SubElement(elements, _ssd("Component"), attributes, implementation="CoSimulation")
        connectors = etree.SubElement(component, _ssd("Connectors"))
        for _, direction, scalar, of_unit in sorted((e for e in ends if e[0] == key), key=lambda end: end[1]):
            place = etree.SubElement(connectors, _ssd("Connector"), name=scalar, kind=direction)
            etree.SubElement(place, f"{{{_SSC}}}Real", unit=of_unit)
        bindings = etree.SubElement(component, _ssd("ParameterBindings"))
        binding = etree.SubElement(bindings, _ssd("ParameterBinding"), type="application/x-ssp-parameter-set")
        values = etree.SubElement(binding, _ssd("ParameterValues"))
        _fill(etree.SubElement(values, f"{{{_SSV}}}ParameterSet", version=version, name=key), _parameters(unit))
    system.append(connections)
    information = _annotation(system, "org.openmodelica", f"{{{_OMS}}}Annotations", f"{{{_OMS}}}SimulationInformation")
    master = {"description": "oms-ma", "absoluteTolerance": "1e-4", "relativeTolerance": "1e-4"}
    etree.SubElement(information, f"{{{_OMS}}}FixedStepMaster", master, stepSize=repr(step))
    _add_units(root, _ssd("Units"), (of_unit for *_, of_unit in ends))
    experiment = etree.SubElement(root, _ssd("DefaultExperiment"), startTime="0", stopTime=repr(duration))
    algorithm = _annotation(experiment, "com.opensimulationplatform", f"{{{_OSP}}}Algorithm")
    etree.SubElement(algorithm, f"{{{_OSP}}}FixedStepAlgorithm", baseStepSize=repr(step))
    return _to_bytes(root)


def parameter_values(name: str, components: Mapping[str, UnitComponent], version: str = "1.0") -> bytes:
    """The parameters of all components as one SSV file, named `component.parameter` as its importers expect."""
    root = etree.Element(f"{{{_SSV}}}ParameterSet", nsmap={"ssv": _SSV, "ssc": _SSC}, name=name)
    root.set("version", version)
    _fill(root, {f"{key}.{scalar}": v for key, unit in components.items() for scalar, v in _parameters(unit).items()})
    return _to_bytes(root)


def _parameters(unit: UnitComponent) -> Values:
    return {
        scalar: (float(value), row.variable.unit)
        for row in unit.layout.of_role(Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
        for scalar, value in zip(row.variable.scalar_names, unit.starts[row.variable.name].flat, strict=True)
    }


def _fill(parameter_set: etree._Element, values: Values) -> None:
    parameters = etree.SubElement(parameter_set, f"{{{_SSV}}}Parameters")
    for name, (value, unit) in values.items():
        parameter = etree.SubElement(parameters, f"{{{_SSV}}}Parameter", name=name)
        real = etree.SubElement(parameter, f"{{{_SSV}}}Real", value=repr(value))
        if unit:
            real.set("unit", unit)
    _add_units(parameter_set, f"{{{_SSV}}}Units", (unit for _, unit in values.values()))


def _add_units(parent: etree._Element, tag: str, names: Iterable[str]) -> None:
    units = etree.SubElement(parent, tag)
    for name in sorted({*names} - {""}):
        unit = etree.SubElement(units, f"{{{_SSC}}}Unit", name=name)
        exponents = {base: str(power) for base, power in BY_NAME[name].exponents.items()}
        etree.SubElement(unit, f"{{{_SSC}}}BaseUnit", exponents)


def _annotation(parent: etree._Element, kind: str, *tags: str) -> etree._Element:
    """The innermost element of an annotation, of those with these names."""
    element = etree.SubElement(etree.SubElement(parent, _ssd("Annotations")), f"{{{_SSC}}}Annotation", type=kind)
    for tag in tags:
        element = etree.SubElement(element, tag)
    return element


def _ssd(name: str) -> str:
    return f"{{{_SSD}}}{name}"


def _to_bytes(root: etree._Element) -> bytes:
    return bytes(etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True))

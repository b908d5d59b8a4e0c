"""modelDescription.xml of FMI 2.0: one scalar variable per slot."""

from lxml import etree

from gough_stewart.fmu_build import model_description
from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.component import Component
from gough_stewart.fmu_build.layout import PARAMETER_ROLES, Role, Row
from gough_stewart.fmu_build.model_description import Identity

_CAPABILITIES = {
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
}
_OF_STATES = {"providesDirectionalDerivative": "true"}
_CO_SIMULATION = {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"}
_CO_SIMULATION_OF_STATES = {"maxOutputDerivativeOrder": "1"}


def fmi2_description(component: Component, identity: Identity) -> bytes:
    """The document, with the component's start values."""
    root = shared.root(component, "2.0", guid=identity.token, numberOfEventIndicators="0")
    capabilities = {"modelIdentifier": component.identifier} | _CAPABILITIES
    simulation = _CO_SIMULATION
    if component.has_states:
        capabilities |= _OF_STATES
        simulation = simulation | _CO_SIMULATION_OF_STATES
        _add_kind(root, "ModelExchange", capabilities, identity)
    _add_kind(root, "CoSimulation", capabilities | simulation, identity)
    shared.add_head(root, component)
    variables = etree.SubElement(root, "ModelVariables")
    for row in component.layout.described("2.0"):
        _add_scalars(variables, row, component)
    _add_structure(root, component)
    return shared.to_bytes(root)


def _add_kind(root: etree._Element, name: str, attributes: dict[str, str], identity: Identity) -> None:
    files = etree.SubElement(etree.SubElement(root, name, attributes), "SourceFiles")
    for file in identity.source_files:
        etree.SubElement(files, "File", name=file)


def _add_scalars(variables: etree._Element, row: Row, component: Component) -> None:
    starts = component.starts.get(row.variable.name)
    for k, (slot, name) in enumerate(zip(row.slots, row.scalar_names, strict=True)):
        scalar = etree.SubElement(variables, "ScalarVariable", name=name, valueReference=str(slot))
        scalar.set("description", row.variable.description)
        scalar.set("causality", row.variable.causality)
        scalar.set("variability", row.variable.variability)
        if row.role is Role.STATE:
            scalar.set("initial", "exact")
        real = etree.SubElement(scalar, "Real", shared.unit_attributes(row) | shared.bound_attributes(row))
        if starts is not None:
            real.set("start", shared.number(starts.flat[k]))
        if row.role is Role.STATE:
            real.set("nominal", shared.number(row.variable.nominal))
        if row.derivative_of is not None:
            real.set("derivative", str(_index(component, component.layout.by_name[row.derivative_of].first + k)))


def _index(component: Component, slot: int) -> int:
    """Position among the scalar variables, which are in slot order but without time, from 1."""
    return slot + 1 if slot < component.layout.time.first else slot


def _add_structure(root: etree._Element, component: Component) -> None:
    structure = etree.SubElement(root, "ModelStructure")
    outputs, derivatives = component.layout.outputs(), component.layout.of_role(Role.DERIVATIVE)
    computed = [row for row in outputs if row.role is Role.RESULT]
    running = (Role.INPUT, Role.STATE)
    for name, rows, knowns in (
        ("Outputs", outputs, running),
        ("Derivatives", derivatives, running),
        ("InitialUnknowns", [*computed, *derivatives], (*running, *PARAMETER_ROLES)),
    ):
        slots = [slot for row in rows for slot in row.slots]
        if slots:
            element = etree.SubElement(structure, name)
            for slot in slots:
                kinds = model_description.dependencies_of_slot(component, slot, knowns)
                unknown = etree.SubElement(element, "Unknown", index=str(_index(component, slot)))
                unknown.set("dependencies", " ".join(str(_index(component, known)) for known in kinds))
                unknown.set("dependenciesKind", " ".join(kinds.values()))

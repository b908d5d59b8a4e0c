"""modelDescription.xml of FMI 2.0: scalar variables, one for every slot."""

from lxml import etree

from gough_stewart.fmu_build import dependencies, layout
from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.dependencies import Kind
from gough_stewart.fmu_build.layout import Role, Row
from gough_stewart.fmu_build.model_description import Identity
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform

_CAPABILITIES = {
    "modelIdentifier": shared.MODEL_IDENTIFIER,
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "providesDirectionalDerivative": "true",
}
_CO_SIMULATION = {
    "canHandleVariableCommunicationStepSize": "true",
    "canInterpolateInputs": "true",
    "maxOutputDerivativeOrder": "1",
}


def fmi2_description(platform: Platform, identity: Identity) -> bytes:
    """The document, with the start values of a platform."""
    root = shared.root("2.0", guid=identity.token, numberOfEventIndicators="0")
    for name, own in (("ModelExchange", {}), ("CoSimulation", _CO_SIMULATION)):
        interface = etree.SubElement(root, name, _CAPABILITIES | own)
        files = etree.SubElement(interface, "SourceFiles")
        for file in identity.source_files:
            etree.SubElement(files, "File", name=file)
    shared.add_units(root)
    shared.add_log_categories(root)
    shared.add_experiment(root)
    variables = etree.SubElement(root, "ModelVariables")
    for row in layout.described("2.0"):
        _add_scalars(variables, row, platform)
    _add_structure(root)
    return shared.to_bytes(root)


def _add_scalars(variables: etree._Element, row: Row, platform: Platform) -> None:
    names, starts = layout.scalar_names(row), interface.start_value(row.variable, platform)
    for k, name in enumerate(names):
        slot = row.first + k
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
            real.set("nominal", shared.number(layout.NOMINAL))
        if row.derivative_of is not None:
            real.set("derivative", str(_index(layout.BY_NAME[row.derivative_of].first + k)))


def _index(slot: int) -> int:
    """Place among the scalar variables, which stand in slot order, from 1."""
    return slot + 1


def _add_structure(root: etree._Element) -> None:
    structure = etree.SubElement(root, "ModelStructure")
    outputs = [r for r in layout.of_role(Role.STATE, Role.RESULT) if r.variable.causality == "output"]
    derivatives = layout.of_role(Role.DERIVATIVE)
    start = (Role.INPUT, Role.STATE, Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
    computed = [row for row in outputs if row.role is Role.RESULT]
    for name, rows, knowns in (
        ("Outputs", outputs, (Role.INPUT, Role.STATE)),
        ("Derivatives", derivatives, (Role.INPUT, Role.STATE)),
        ("InitialUnknowns", [*computed, *derivatives], start),
    ):
        element = etree.SubElement(structure, name)
        for row in rows:
            for slot in range(row.first, row.first + row.variable.size):
                _add_unknown(element, slot, dependencies.of_slot(slot, knowns))


def _add_unknown(parent: etree._Element, slot: int, knowns: dict[int, Kind]) -> None:
    unknown = etree.SubElement(parent, "Unknown", index=str(_index(slot)))
    unknown.set("dependencies", " ".join(str(_index(known)) for known in knowns))
    unknown.set("dependenciesKind", " ".join(knowns.values()))

"""modelDescription.xml of FMI 3.0: array variables."""

from collections.abc import Iterable

from lxml import etree

from gough_stewart.fmu_build import dependencies, layout
from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.layout import ROWS, Role, Row
from gough_stewart.fmu_build.model_description import Identity
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform

_CAPABILITIES = {
    "modelIdentifier": shared.MODEL_IDENTIFIER,
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "providesDirectionalDerivatives": "true",
    "providesAdjointDerivatives": "true",
}
_MODEL_EXCHANGE = {"needsCompletedIntegratorStep": "true", "providesEvaluateDiscreteStates": "true"}
_CO_SIMULATION = {
    "canHandleVariableCommunicationStepSize": "true",
    "maxOutputDerivativeOrder": "1",
    "providesIntermediateUpdate": "true",
    "canReturnEarlyAfterIntermediateUpdate": "true",
}


def fmi3_description(platform: Platform, identity: Identity) -> bytes:
    """The document, with the start values of a platform."""
    root = shared.root("3.0", instantiationToken=identity.token)
    etree.SubElement(root, "ModelExchange", _CAPABILITIES | _MODEL_EXCHANGE)
    etree.SubElement(root, "CoSimulation", _CAPABILITIES | _CO_SIMULATION)
    shared.add_units(root)
    shared.add_log_categories(root)
    shared.add_experiment(root)
    variables = etree.SubElement(root, "ModelVariables")
    for row in ROWS:
        _add_array(variables, row, platform)
    _add_structure(root)
    return shared.to_bytes(root)


def _add_array(variables: etree._Element, row: Row, platform: Platform) -> None:
    v = row.variable
    array = etree.SubElement(variables, "Float64", name=v.name, valueReference=str(row.reference))
    array.set("description", v.description)
    array.set("causality", "independent" if row.role is Role.INDEPENDENT else v.causality)
    array.set("variability", v.variability)
    if row.role is Role.STATE:
        array.set("initial", "exact")
        array.set("nominal", shared.number(layout.NOMINAL))
    if v.causality in ("input", "output"):
        array.set("intermediateUpdate", "true")
    for name, value in (shared.unit_attributes(row) | shared.bound_attributes(row)).items():
        array.set(name, value)
    starts = interface.start_value(row.variable, platform)
    if starts is not None:
        array.set("start", " ".join(map(shared.number, starts.flat)))
    if row.derivative_of is not None:
        array.set("derivative", str(layout.BY_NAME[row.derivative_of].reference))
    for length in v.shape:
        etree.SubElement(array, "Dimension", start=str(length))


def _add_structure(root: etree._Element) -> None:
    structure = etree.SubElement(root, "ModelStructure")
    outputs = [r for r in layout.of_role(Role.STATE, Role.RESULT) if r.variable.causality == "output"]
    derivatives = layout.of_role(Role.DERIVATIVE)
    start = (Role.INPUT, Role.STATE, Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
    _add_unknowns(structure, "Output", outputs, (Role.INPUT, Role.STATE))
    _add_unknowns(structure, "ContinuousStateDerivative", derivatives, (Role.INPUT, Role.STATE))
    computed = [row for row in outputs if row.role is Role.RESULT]
    _add_unknowns(structure, "InitialUnknown", [*computed, *derivatives], start)


def _add_unknowns(structure: etree._Element, name: str, rows: Iterable[Row], roles: Iterable[Role]) -> None:
    roles = tuple(roles)
    for row in rows:
        knowns = dependencies.of_row(row, roles)
        unknown = etree.SubElement(structure, name, valueReference=str(row.reference))
        unknown.set("dependencies", " ".join(map(str, knowns)))
        unknown.set("dependenciesKind", " ".join(knowns.values()))

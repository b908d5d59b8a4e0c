"""modelDescription.xml of FMI 3.0: array variables, or a scalar for each slot."""

from collections.abc import Iterable, Iterator

from lxml import etree

from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.component import SCALAR_REFERENCE, Component, Kind
from gough_stewart.fmu_build.layout import PARAMETER_ROLES, Role, Row
from gough_stewart.fmu_build.model_description import Identity

_CAPABILITIES = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
_OF_STATES = {"providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}
_MODEL_EXCHANGE = {"needsCompletedIntegratorStep": "true", "providesEvaluateDiscreteStates": "true"}
_CO_SIMULATION = {"canHandleVariableCommunicationStepSize": "true"}
_CO_SIMULATION_OF_STATES = {"maxOutputDerivativeOrder": "1"}
_INTERMEDIATE_UPDATE = {"providesIntermediateUpdate": "true", "canReturnEarlyAfterIntermediateUpdate": "true"}


def fmi3_description(component: Component, identity: Identity) -> bytes:
    """The document, with the component's start values."""
    root = shared.root(component, "3.0", instantiationToken=identity.token)
    capabilities = {"modelIdentifier": component.identifier} | _CAPABILITIES
    simulation = _CO_SIMULATION
    if component.has_states:
        capabilities |= _OF_STATES
        simulation = simulation | _CO_SIMULATION_OF_STATES
        etree.SubElement(root, "ModelExchange", capabilities | _MODEL_EXCHANGE)
    etree.SubElement(root, "CoSimulation", capabilities | simulation | _INTERMEDIATE_UPDATE)
    shared.add_head(root, component)
    variables = etree.SubElement(root, "ModelVariables")
    for row in component.layout.rows:
        for name, slots, reference in _described_as(row, component):
            _add_variable(variables, row, component, name, slots, reference)
    _add_structure(root, component)
    return shared.to_bytes(root)


def _described_as(row: Row, component: Component) -> Iterator[tuple[str, range, int]]:
    """Name, slots and value reference of each variable for a row: one, or one for each slot."""
    if not component.has_scalars_only:
        yield row.variable.name, row.slots, row.reference
        return
    for name, slot in zip(row.scalar_names, row.slots, strict=True):
        yield name, range(slot, slot + 1), SCALAR_REFERENCE + slot


def _add_variable(
    variables: etree._Element, row: Row, component: Component, name: str, slots: range, reference: int
) -> None:
    v = row.variable
    element = etree.SubElement(variables, "Float64", name=name, valueReference=str(reference))
    element.set("description", v.description)
    element.set("causality", "independent" if row.role is Role.INDEPENDENT else v.causality)
    element.set("variability", v.variability)
    if row.role is Role.STATE:
        element.set("initial", "exact")
        element.set("nominal", shared.number(row.variable.nominal))
    if v.causality in ("input", "output"):
        element.set("intermediateUpdate", "true")
    for key, value in (shared.unit_attributes(row) | shared.bound_attributes(row)).items():
        element.set(key, value)
    starts = component.starts.get(v.name)
    if starts is not None:
        values = starts.flat[slots.start - row.first : slots.stop - row.first]
        element.set("start", " ".join(map(shared.number, values)))
    if row.derivative_of is not None:
        state = component.layout.by_name[row.derivative_of]
        at = [each for _, _, each in _described_as(state, component)]
        element.set("derivative", str(at[slots.start - row.first if component.has_scalars_only else 0]))
    if not component.has_scalars_only:
        for length in v.shape:
            etree.SubElement(element, "Dimension", start=str(length))


def _add_structure(root: etree._Element, component: Component) -> None:
    structure = etree.SubElement(root, "ModelStructure")
    outputs, derivatives = component.layout.outputs(), component.layout.of_role(Role.DERIVATIVE)
    computed = [row for row in outputs if row.role is Role.RESULT]
    running = (Role.INPUT, Role.STATE)

    def add(name: str, rows: Iterable[Row], roles: tuple[Role, ...]) -> None:
        for row in rows:
            for reference, knowns in _dependencies(component, row, roles):
                unknown = etree.SubElement(structure, name, valueReference=str(reference))
                unknown.set("dependencies", " ".join(map(str, knowns)))
                unknown.set("dependenciesKind", " ".join(knowns.values()))

    add("Output", outputs, running)
    add("ContinuousStateDerivative", derivatives, running)
    add("InitialUnknown", [*computed, *derivatives], (*running, *PARAMETER_ROLES))


def _dependencies(component: Component, row: Row, roles: tuple[Role, ...]) -> Iterator[tuple[int, dict[int, Kind]]]:
    """Dependencies of each variable for a row, all by value reference."""
    if not component.has_scalars_only:
        yield row.reference, shared.dependencies_of_row(component, row, roles)
        return
    for slot in row.slots:
        found = shared.dependencies_of_slot(component, slot, roles)
        yield SCALAR_REFERENCE + slot, {SCALAR_REFERENCE + known: kind for known, kind in found.items()}

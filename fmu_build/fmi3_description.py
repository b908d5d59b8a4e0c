"""modelDescription.xml of FMI 3.0: array variables."""

from collections.abc import Iterable

from lxml import etree

from gough_stewart.fmu_build import model_description
from gough_stewart.fmu_build import model_description as shared
from gough_stewart.fmu_build.component import CLOCK_REFERENCE, Clock, Component
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
    if component.clock is not None:
        etree.SubElement(root, "CoSimulation", capabilities | simulation | {"hasEventMode": "true"})
        etree.SubElement(root, "ScheduledExecution", capabilities)
        return _described(root, component)
    if component.has_states:
        capabilities |= _OF_STATES
        simulation = simulation | _CO_SIMULATION_OF_STATES
        etree.SubElement(root, "ModelExchange", capabilities | _MODEL_EXCHANGE)
    etree.SubElement(root, "CoSimulation", capabilities | simulation | _INTERMEDIATE_UPDATE)
    return _described(root, component)


def _described(root: etree._Element, component: Component) -> bytes:
    shared.add_head(root, component)
    variables = etree.SubElement(root, "ModelVariables")
    for row in component.layout.rows:
        _add_array(variables, row, component)
    if component.clock is not None:
        _add_clock(variables, component.clock)
    _add_structure(root, component)
    return shared.to_bytes(root)


def _add_array(variables: etree._Element, row: Row, component: Component) -> None:
    v = row.variable
    array = etree.SubElement(variables, "Float64", name=v.name, valueReference=str(row.reference))
    array.set("description", v.description)
    array.set("causality", "independent" if row.role is Role.INDEPENDENT else v.causality)
    array.set("variability", v.variability)
    if row.role is Role.STATE:
        array.set("initial", "exact")
        array.set("nominal", shared.number(component.nominal))
    if v.causality in ("input", "output"):
        if component.clock is None:
            array.set("intermediateUpdate", "true")
        else:
            array.set("clocks", str(CLOCK_REFERENCE))
    for name, value in (shared.unit_attributes(row) | shared.bound_attributes(row)).items():
        array.set(name, value)
    starts = component.starts.get(v.name)
    if starts is not None:
        array.set("start", " ".join(map(shared.number, starts.flat)))
    if row.derivative_of is not None:
        array.set("derivative", str(component.layout.by_name[row.derivative_of].reference))
    for length in v.shape:
        etree.SubElement(array, "Dimension", start=str(length))


def _add_clock(variables: etree._Element, clock: Clock) -> None:
    """The clock; its priority is for Scheduled Execution."""
    etree.SubElement(
        variables,
        "Clock",
        name=clock.name,
        valueReference=str(CLOCK_REFERENCE),
        description=clock.description,
        causality="input",
        variability="discrete",
        intervalVariability="fixed",
        intervalDecimal=shared.number(clock.interval),
        priority="0",
    )


def _add_structure(root: etree._Element, component: Component) -> None:
    structure = etree.SubElement(root, "ModelStructure")
    outputs, derivatives = component.layout.outputs(), component.layout.of_role(Role.DERIVATIVE)
    computed = [row for row in outputs if row.role is Role.RESULT]
    running = (Role.INPUT, Role.STATE)

    def add(name: str, rows: Iterable[Row], roles: tuple[Role, ...]) -> None:
        for row in rows:
            knowns = model_description.dependencies_of_row(component, row, roles)
            unknown = etree.SubElement(structure, name, valueReference=str(row.reference))
            unknown.set("dependencies", " ".join(map(str, knowns)))
            unknown.set("dependenciesKind", " ".join(knowns.values()))

    add("Output", outputs, running)
    add("ContinuousStateDerivative", derivatives, running)
    # variables of a clock get their values at its first tick
    add("InitialUnknown", [*computed, *derivatives] if component.clock is None else (), (*running, *PARAMETER_ROLES))

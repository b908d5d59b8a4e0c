"""XML documents of an FMU: what the model descriptions of both versions share, build description, terminals."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from lxml import etree

from gough_stewart.fmu_build.component import Component, Kind
from gough_stewart.fmu_build.layout import Role, Row
from gough_stewart.fmu_build.package import package_metadata

# What XML 1.0 does not allow, and the rest of the control characters.
_REFUSED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


@dataclass(frozen=True)
class Unit:
    """A unit as FMI describes it: exponents of base units; the factor is always 1."""

    name: str
    exponents: dict[str, int]
    # displayed value = factor · value
    display: tuple[str, float] | None = None


_DEGREES = float(np.rad2deg(1.0))
UNITS = (
    Unit("N", {"kg": 1, "m": 1, "s": -2}),
    Unit("N.m", {"kg": 1, "m": 2, "s": -2}),
    Unit("m", {"m": 1}, ("mm", 1e3)),
    Unit("rad", {"rad": 1}, ("deg", _DEGREES)),
    Unit("m/s", {"m": 1, "s": -1}, ("mm/s", 1e3)),
    Unit("rad/s", {"s": -1, "rad": 1}, ("deg/s", _DEGREES)),
    Unit("m/s2", {"m": 1, "s": -2}),
    Unit("rad/s2", {"s": -2, "rad": 1}, ("deg/s2", _DEGREES)),
    Unit("J", {"kg": 1, "m": 2, "s": -2}),
    Unit("kg", {"kg": 1}),
    Unit("kg.m2", {"kg": 1, "m": 2}),
    Unit("N.s/m", {"kg": 1, "s": -1}),
    Unit("s", {"s": 1}),
    Unit("N/m", {"kg": 1, "s": -2}),
    Unit("N/(m.s)", {"kg": 1, "s": -3}),
    Unit("1", {}),
    Unit("N/s", {"kg": 1, "m": 1, "s": -3}),
    Unit("Hz", {"s": -1}),
)
BY_NAME = {unit.name: unit for unit in UNITS}


LOG_CATEGORIES = {
    "logStatusWarning": "minor problems; the reason for terminating Model Exchange",
    "logStatusDiscard": "rejected values and steps not completed, with quantity, value and time",
    "logStatusError": "invalid calls, with what was expected; always logged",
    "logAll": "all messages",
}


@dataclass(frozen=True)
class Identity:
    """The token and source files that identify a unit."""

    token: str  # guid or instantiationToken
    source_files: tuple[str, ...]


def root(component: Component, fmi_version: str, **attributes: str) -> etree._Element:
    """The `fmiModelDescription` element."""
    package = package_metadata()
    own = {
        "fmiVersion": fmi_version,
        "modelName": xml_text(component.name),
        "description": xml_text(component.description),
        "version": package["Version"],
        "copyright": "the gough-stewart authors",
        "license": package["License-Expression"],
        "generationTool": f"gough-stewart {package['Version']}",
        "variableNamingConvention": "structured",
    }
    return etree.Element("fmiModelDescription", own | attributes)


def add_head(parent: etree._Element, component: Component) -> None:
    """The elements before the variables: `UnitDefinitions` (units in use), `LogCategories`, `DefaultExperiment`."""
    used = {row.variable.unit for row in component.layout.rows}
    definitions = etree.SubElement(parent, "UnitDefinitions")
    for unit in UNITS:
        if unit.name in used:
            element = etree.SubElement(definitions, "Unit", name=unit.name)
            etree.SubElement(element, "BaseUnit", {base: str(power) for base, power in unit.exponents.items()})
            if unit.display is not None:
                name, factor = unit.display
                etree.SubElement(element, "DisplayUnit", name=name, factor=repr(factor))
    categories = etree.SubElement(parent, "LogCategories")
    for name, description in LOG_CATEGORIES.items():
        etree.SubElement(categories, "Category", name=name, description=description)
    etree.SubElement(parent, "DefaultExperiment", dict(component.experiment))


def unit_attributes(row: Row) -> dict[str, str]:
    """`unit` if there is one, and `displayUnit` if another unit is usual."""
    unit = row.variable.unit
    if not unit:
        return {}
    display = BY_NAME[unit].display
    return {"unit": unit} | ({} if display is None else {"displayUnit": display[0]})


def bound_attributes(row: Row) -> dict[str, str]:
    """`min` if the variable has a lower bound."""
    return {} if row.variable.lower_bound is None else {"min": "0"}


def number(value: float) -> str:
    """The shortest text that parses to the same double."""
    return repr(float(value))


def to_bytes(element: etree._Element) -> bytes:
    """The document."""
    return bytes(etree.tostring(element, encoding="UTF-8", xml_declaration=True, pretty_print=True))


def xml_text(text: str) -> str:
    """A text with a visible mark for each character that XML cannot have."""
    return _REFUSED.sub("\N{REPLACEMENT CHARACTER}", text)


def dependencies_of_slot(component: Component, slot: int, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of one unknown on knowns of some roles, by slot."""
    knowns = {known for row in component.layout.of_role(*roles) for known in row.slots}
    return {known: kind for known, kind in component.dependencies.get(slot, {}).items() if known in knowns}


def dependencies_of_row(component: Component, row: Row, roles: Iterable[Role]) -> dict[int, Kind]:
    """Dependencies of a whole variable on whole variables, by value reference of FMI 3.0.

    Constant only if it is constant for every element.
    """
    references = {slot: known.reference for known in component.layout.rows for slot in known.slots}
    found: dict[int, Kind] = {}
    for slot in row.slots:
        for known, kind in dependencies_of_slot(component, slot, roles).items():
            if found.get(references[known]) != "dependent":
                found[references[known]] = kind
    return dict(sorted(found.items()))


# The version of the schema, which FMI 2.0 importers also read.
_FMI3 = "3.0"


def build_description(component: Component, source_files: tuple[str, ...]) -> bytes:
    """sources/buildDescription.xml: everything an importer needs to compile the unit."""
    root = etree.Element("fmiBuildDescription", fmiVersion=_FMI3)
    configuration = etree.SubElement(root, "BuildConfiguration", modelIdentifier=component.identifier)
    file_set = etree.SubElement(configuration, "SourceFileSet", language="C11")
    for name in source_files:
        etree.SubElement(file_set, "SourceFile", name=name)
    etree.SubElement(configuration, "Library", name="m", external="true", description="C mathematical library")
    return to_bytes(root)


def terminals_and_icons(component: Component, fmi_version: str) -> bytes:
    """terminalsAndIcons/terminalsAndIcons.xml: the component's terminals, and the icon."""
    root = etree.Element("fmiTerminalsAndIcons", fmiVersion=_FMI3)
    graphics = etree.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    etree.SubElement(graphics, "CoordinateSystem", box | {"suggestedScalingFactorTo_mm": "0.1"})
    etree.SubElement(graphics, "Icon", box)
    terminals = etree.SubElement(root, "Terminals")
    # terminals of scalars are those of FMI 2.0
    for each in component.terminals("2.0" if component.has_scalars_only else fmi_version):
        attributes = {"name": each.name, "matchingRule": "plug", "description": each.description}
        terminal = etree.SubElement(terminals, "Terminal", attributes)
        for member, variable in each.members.items():
            etree.SubElement(
                terminal, "TerminalMemberVariable", variableName=variable, memberName=member, variableKind="signal"
            )
    return to_bytes(root)

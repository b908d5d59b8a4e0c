"""Shared parts of the model descriptions of both FMI versions: identity, units, log categories, experiment."""

from dataclasses import dataclass

from lxml import etree

from gough_stewart.fmu_build.component import Component
from gough_stewart.fmu_build.layout import Row
from gough_stewart.fmu_build.package import package_metadata
from gough_stewart.fmu_build.units import BY_NAME, UNITS
from gough_stewart.fmu_build.xml_text import xml_text

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

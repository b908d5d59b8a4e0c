"""What the model descriptions of both FMI versions share: identity, units, log categories, experiment."""

from dataclasses import dataclass

from lxml import etree

from gough_stewart.fmu_build.component import Component
from gough_stewart.fmu_build.layout import Row
from gough_stewart.fmu_build.package import package_metadata
from gough_stewart.fmu_build.units import BY_NAME, UNITS

LOG_CATEGORIES = {
    "logStatusWarning": "what is not quite right; why Model Exchange has to end",
    "logStatusDiscard": "values refused and steps not completed, with quantity, value and time",
    "logStatusError": "calls that make no sense, with what was expected; always logged",
    "logAll": "all messages",
}


@dataclass(frozen=True)
class Identity:
    """What distinguishes one unit from another."""

    token: str  # guid or instantiationToken
    source_files: tuple[str, ...]


def root(component: Component, fmi_version: str, **attributes: str) -> etree._Element:
    """The `fmiModelDescription` element."""
    package = package_metadata()
    own = {
        "fmiVersion": fmi_version,
        "modelName": component.name,
        "description": component.description,
        "version": package["Version"],
        "copyright": "the gough-stewart authors",
        "license": package["License-Expression"],
        "generationTool": f"gough-stewart {package['Version']}",
        "variableNamingConvention": "structured",
    }
    return etree.Element("fmiModelDescription", own | attributes)


def add_head(parent: etree._Element, component: Component) -> None:
    """What stands before the variables: `UnitDefinitions` of the units in use, `LogCategories`, `DefaultExperiment`."""
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
    """`unit` if there is one, and `displayUnit` where people read another."""
    unit = row.variable.unit
    if not unit:
        return {}
    display = BY_NAME[unit].display
    return {"unit": unit} | ({} if display is None else {"displayUnit": display[0]})


def bound_attributes(row: Row) -> dict[str, str]:
    """`min` where there is one."""
    return {} if row.variable.lower_bound is None else {"min": "0"}


def number(value: float) -> str:
    """The shortest text that reads back as the same double."""
    return repr(float(value))


def to_bytes(element: etree._Element) -> bytes:
    """The document."""
    return bytes(etree.tostring(element, encoding="UTF-8", xml_declaration=True, pretty_print=True))

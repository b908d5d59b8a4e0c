"""The smaller XML documents of an FMU: build description, terminals and icon."""

from lxml import etree

from gough_stewart.fmu_build.component import Component
from gough_stewart.fmu_build.model_description import to_bytes

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
    for each in component.terminals(fmi_version):
        attributes = {"name": each.name, "matchingRule": "plug", "description": each.description}
        terminal = etree.SubElement(terminals, "Terminal", attributes)
        for member, variable in each.members.items():
            etree.SubElement(
                terminal, "TerminalMemberVariable", variableName=variable, memberName=member, variableKind="signal"
            )
    return to_bytes(root)

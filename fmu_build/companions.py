"""The smaller XML documents of an FMU: build description, terminals and icon."""

from lxml import etree

from gough_stewart.fmu_build import layout
from gough_stewart.fmu_build.model_description import MODEL_IDENTIFIER, to_bytes

# Of the schema, which FMI 2.0 importers read as well.
_FMI3 = "3.0"
_Group = tuple[str, ...]
_ACTUATOR: _Group = ("actuator_force", "leg_length", "leg_velocity")
_POSE: _Group = ("position", "orientation", "velocity", "angular_velocity")
_WRENCH: _Group = ("external_force", "external_torque")


def build_description(source_files: tuple[str, ...]) -> bytes:
    """sources/buildDescription.xml: enough for an importer to compile the unit by itself."""
    root = etree.Element("fmiBuildDescription", fmiVersion=_FMI3)
    configuration = etree.SubElement(root, "BuildConfiguration", modelIdentifier=MODEL_IDENTIFIER)
    file_set = etree.SubElement(configuration, "SourceFileSet", language="C11")
    for name in source_files:
        etree.SubElement(file_set, "SourceFile", name=name)
    etree.SubElement(configuration, "Library", name="m", external="true", description="C mathematical library")
    return to_bytes(root)


def terminals_and_icons(fmi_version: str) -> bytes:
    """terminalsAndIcons/terminalsAndIcons.xml: six actuators, the pose, the external wrench, and the icon.

    FMI 2.0 has a terminal for every actuator, with scalars; in FMI 3.0 a terminal cannot name an element of an
    array, so that one terminal holds the six of them.
    """
    root = etree.Element("fmiTerminalsAndIcons", fmiVersion=_FMI3)
    graphics = etree.SubElement(root, "GraphicalRepresentation")
    box = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    etree.SubElement(graphics, "CoordinateSystem", box | {"suggestedScalingFactorTo_mm": "0.1"})
    etree.SubElement(graphics, "Icon", box)
    terminals = etree.SubElement(root, "Terminals")
    groups: list[tuple[str, _Group, str]] = [
        ("pose", _POSE, "pose and its rates"),
        ("external_wrench", _WRENCH, "load at Op"),
    ]
    if fmi_version == "2.0":
        for leg in range(6):
            members = {name: layout.BY_NAME[name].variable.scalar_names[leg] for name in _ACTUATOR}
            _add_terminal(terminals, f"actuator_{leg + 1}", members, f"actuator of leg {leg + 1}")
        for name, group, what in groups:
            scalars = [s for v in group for s in layout.BY_NAME[v].variable.scalar_names]
            _add_terminal(terminals, name, {s: s for s in scalars}, what)
    else:
        for name, group, what in [("actuators", _ACTUATOR, "the six actuators"), *groups]:
            _add_terminal(terminals, name, {v: v for v in group}, what)
    return to_bytes(root)


def _add_terminal(parent: etree._Element, name: str, members: dict[str, str], description: str) -> None:
    terminal = etree.SubElement(parent, "Terminal", name=name, matchingRule="plug", description=description)
    for member, variable in members.items():
        etree.SubElement(
            terminal, "TerminalMemberVariable", variableName=variable, memberName=member, variableKind="signal"
        )

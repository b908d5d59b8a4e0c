"""SystemStructure.ssd and SSV: valid by the standard's schemas, and with what each importer was found to need."""

from pathlib import Path
from typing import Any

import fmpy.ssp
import pytest
from lxml import etree

from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.ssp import (
    Component,
    Connection,
    Connector,
    System,
    parameter_values,
    system_structure,
)

PLANT = Component(
    "plant",
    "resources/plant.fmu",
    (Connector("actuator_force[2]", "input", "N"), Connector("leg_length[2]", "output", "m")),
    {"platform_mass": (12.5, "kg"), "base_points[1,2]": (-0.3, "m")},
)
CONTROLLER = Component(
    "controller",
    "resources/controller.fmu",
    (Connector("leg_length[2]", "input", "m"), Connector("actuator_force[2]", "output", "N")),
    {"sample_time": (0.002, "s"), "delay": (1.0, "")},
)
FORTH = Connection(("plant", "leg_length[2]"), ("controller", "leg_length[2]"))
BACK = Connection(("controller", "actuator_force[2]"), ("plant", "actuator_force[2]"))
LOOP = System("loop", (PLANT, CONTROLLER), (FORTH, BACK), 0.7, 0.002)
NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


@pytest.mark.parametrize(
    ("document", "schema"),
    [
        (system_structure(LOOP), "SystemStructureDescription.xsd"),
        (parameter_values(LOOP), "SystemStructureParameterValues.xsd"),
    ],
)
def test_documents_are_valid(document: bytes, schema: str) -> None:
    """The schemas are the standard's own, as FMPy carries them."""
    folder = Path(fmpy.ssp.__file__).parent / "schema"
    etree.XMLSchema(file=str(folder / schema)).assertValid(etree.fromstring(document))


def test_connectors_connections_and_parameters_are_those_of_the_system() -> None:
    """Expected: the literal values above; each real, with its unit, none of the system's own."""
    root: Any = etree.fromstring(system_structure(LOOP))
    connectors = {
        (c.getparent().getparent().get("name"), c.get("name"), c.get("kind"), c.find("ssc:Real", NS).get("unit"))
        for c in root.iterfind(".//ssd:Connector", NS)
    }
    assert connectors == {
        ("plant", "actuator_force[2]", "input", "N"),
        ("plant", "leg_length[2]", "output", "m"),
        ("controller", "leg_length[2]", "input", "m"),
        ("controller", "actuator_force[2]", "output", "N"),
    }
    assert root.find("ssd:System", NS).find("ssd:Connectors", NS) is None
    connections = [dict(c.attrib) for c in root.iterfind(".//ssd:Connection", NS)]
    assert connections == [
        {
            "startElement": "plant",
            "startConnector": "leg_length[2]",
            "endElement": "controller",
            "endConnector": "leg_length[2]",
        },
        {
            "startElement": "controller",
            "startConnector": "actuator_force[2]",
            "endElement": "plant",
            "endConnector": "actuator_force[2]",
        },
    ]
    values = {
        (p.getparent().getparent().get("name"), p.get("name")): p.find("ssv:Real", NS).get("value")
        for p in root.iterfind(".//ssv:Parameter", NS)
    }
    assert values == {
        ("plant", "platform_mass"): "12.5",
        ("plant", "base_points[1,2]"): "-0.3",
        ("controller", "sample_time"): "0.002",
        ("controller", "delay"): "1.0",
    }
    assert root.find("ssd:DefaultExperiment", NS).get("stopTime") == "0.7"
    assert {unit.get("name") for unit in root.iterfind("ssd:Units/ssc:Unit", NS)} == {"N", "m"}


def test_the_parameter_file_names_components() -> None:
    root: Any = etree.fromstring(parameter_values(LOOP))
    names = [p.get("name") for p in root.iterfind(".//ssv:Parameter", NS)]
    assert names == ["plant.platform_mass", "plant.base_points[1,2]", "controller.sample_time", "controller.delay"]


def test_prefixes_are_the_standards_since_libcosim_reads_no_others() -> None:
    text = system_structure(LOOP).decode()
    assert all(f"<{tag}" in text for tag in ("ssd:Component ", "ssc:Real ", "ssv:ParameterSet ", "ssd:Connection "))


def test_names_that_begin_alike_and_connections_to_nothing_are_refused() -> None:
    with pytest.raises(ExportError, match="'plant' and 'plant2'; expected names of which none begins with another"):
        System("loop", (PLANT, Component("plant2", "resources/plant2.fmu", (), {})), (), 1.0, 0.1)
    with pytest.raises(ExportError, match=r"no output 'actuator_force\[2\]' of 'plant'"):
        System("loop", (PLANT, CONTROLLER), (Connection(BACK.end, BACK.start),), 1.0, 0.1)

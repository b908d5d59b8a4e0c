"""SystemStructure.ssd and SSV: valid by the standard's schemas, and with what each importer was found to need."""

import re
from dataclasses import replace
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


def test_names_that_begin_alike_and_connections_to_nothing_are_refused() -> None:
    with pytest.raises(ExportError, match="'plant' and 'plant2'; expected names of which none begins with another"):
        System("loop", (PLANT, Component("plant2", "resources/plant2.fmu", (), {})), (), 1.0, 0.1)
    with pytest.raises(ExportError, match=r"no output 'actuator_force\[2\]' of 'plant'"):
        System("loop", (PLANT, CONTROLLER), (Connection(BACK.end, BACK.start),), 1.0, 0.1)


def test_version_2_says_what_version_1_does() -> None:
    """Expected: the documents of SSP 1.0 but for that number, with which they are valid by the schemas of 2.0 too."""
    for document in (system_structure, parameter_values):
        first, second = (document(replace(LOOP, version=version)).decode() for version in ("1.0", "2.0"))
        assert first != second
        assert first.partition("?>")[2].replace('version="1.0"', 'version="2.0"') == second.partition("?>")[2]


def _tree(element: Any) -> Any:
    """Local names, attributes, children."""
    return (etree.QName(element).localname, dict(element.attrib), [_tree(child) for child in element])


def _parameters(*rows: tuple[str, str, str]) -> Any:
    found: Any = [
        ("Parameter", {"name": n}, [("Real", {"value": v, **({"unit": u} if u else {})}, [])]) for n, v, u in rows
    ]
    return ("Parameters", {}, found)


def _units(**units: dict[str, str]) -> Any:
    return ("Units", {}, [("Unit", {"name": name}, [("BaseUnit", base, [])]) for name, base in units.items()])


def test_the_whole_structure_is_that_of_the_standard() -> None:
    """Expected: SSP 1.0 by hand; libcosim's annotation with the master's step."""
    kg, m, s = ({unit: "1"} for unit in ("kg", "m", "s"))
    newton = {"kg": "1", "m": "1", "s": "-2"}
    plant = [("platform_mass", "12.5", "kg"), ("base_points[1,2]", "-0.3", "m")]
    controller = [("sample_time", "0.002", "s"), ("delay", "1.0", "")]

    def component(name: str, connectors: Any, rows: Any, units: Any) -> Any:
        values = ("ParameterSet", {"version": "1.0", "name": name}, [_parameters(*rows), units])
        binding: Any = (
            "ParameterBinding",
            {"type": "application/x-ssp-parameter-set"},
            [("ParameterValues", {}, [values])],
        )
        return (
            "Component",
            {
                "name": name,
                "type": "application/x-fmu-sharedlibrary",
                "source": f"resources/{name}.fmu",
                "implementation": "CoSimulation",
            },
            [
                (
                    "Connectors",
                    {},
                    [
                        ("Connector", {"name": n, "kind": kind}, [("Real", {"unit": u}, [])])
                        for n, kind, u in connectors
                    ],
                ),
                ("ParameterBindings", {}, [binding]),
            ],
        )

    force, length = "actuator_force[2]", "leg_length[2]"
    elements = [
        component("plant", [(force, "input", "N"), (length, "output", "m")], plant, _units(kg=kg, m=m)),
        component("controller", [(length, "input", "m"), (force, "output", "N")], controller, _units(s=s)),
    ]
    ends = [("plant", "controller", length), ("controller", "plant", force)]
    keys = ("startElement", "startConnector", "endElement", "endConnector")
    connections: Any = [("Connection", dict(zip(keys, (a, name, b, name), strict=True)), []) for a, b, name in ends]
    step: Any = ("Algorithm", {}, [("FixedStepAlgorithm", {"baseStepSize": "0.002"}, [])])
    master = {"description": "oms-ma", "absoluteTolerance": "1e-4", "relativeTolerance": "1e-4", "stepSize": "0.002"}
    information: Any = ("SimulationInformation", {}, [("FixedStepMaster", master, [])])
    oms: Any = ("Annotation", {"type": "org.openmodelica"}, [("Annotations", {}, [information])])
    annotation: Any = ("Annotations", {}, [("Annotation", {"type": "com.opensimulationplatform"}, [step])])
    root = etree.fromstring(system_structure(LOOP))
    tag, attributes, children = _tree(root)
    assert tag == "SystemStructureDescription"
    assert re.fullmatch(r"gough-stewart \d+\.\d+.*", attributes.pop("generationTool"))
    assert attributes == {"version": "1.0", "name": "loop"}
    assert children == [
        (
            "System",
            {"name": "loop"},
            [("Elements", {}, elements), ("Connections", {}, connections), ("Annotations", {}, [oms])],
        ),
        _units(N=newton, m=m),
        ("DefaultExperiment", {"startTime": "0", "stopTime": "0.7"}, [annotation]),
    ]
    spaces = "http://ssp-standard.org/SSP1/SystemStructure"
    assert root.nsmap == {
        "ssd": f"{spaces}Description",
        "ssc": f"{spaces}Common",
        "ssv": f"{spaces}ParameterValues",
        "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
        "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    }
    named = [(f"{c}.{n}", v, u) for c, rows in (("plant", plant), ("controller", controller)) for n, v, u in rows]
    assert _tree(etree.fromstring(parameter_values(LOOP))) == (
        "ParameterSet",
        {"version": "1.0", "name": "loop"},
        [_parameters(*named), _units(kg=kg, m=m, s=s)],
    )

"""SystemStructure.ssd and SSV: valid by the standard's schemas, and with what each importer was found to need."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fmpy.ssp
import numpy as np
import pytest
from lxml import etree

from gough_stewart.fmu_build.component import laid_out
from gough_stewart.harness.export.ssp import parameter_values, system_structure
from gough_stewart.model.parameters import Variable


def _unit(*rows: tuple[str, str, str, Any]) -> Any:
    """A unit with scalars: name, unit, causality, and the start value of a parameter."""
    kinds = {"parameter": "tunable"}
    variables = [Variable(n, (), u, c, kinds.get(c, "continuous"), n) for n, u, c, _ in rows]  # type: ignore[arg-type]
    starts = {name: np.array(value) for name, _, _, value in rows if value is not None}
    return SimpleNamespace(layout=laid_out(variables, {}), starts=starts)


UNITS = {
    "plant": _unit(
        *(("actuator_force", "N", "input", None), ("external_force", "N", "input", None)),
        *(("leg_length", "m", "output", None), ("kinetic_energy", "J", "output", None)),
        *(("platform_mass", "kg", "parameter", 12.5), ("leg_lower_com", "m", "parameter", -0.3)),
    ),
    "controller": _unit(
        *(("leg_length", "m", "input", None), ("actuator_force", "N", "output", None)),
        *(("sample_time", "s", "parameter", 0.002), ("delay", "", "parameter", 1.0)),
    ),
}


def documents(version: str = "1.0") -> tuple[bytes, bytes]:
    """Of a loop of 0.7 s in steps of 2 ms."""
    return system_structure("loop", UNITS, 0.7, 0.002, version=version), parameter_values("loop", UNITS, version)


@pytest.mark.parametrize("k", [0, 1])
def test_documents_are_valid(k: int) -> None:
    """The schemas are the standard's own, as FMPy carries them."""
    schema = Path(fmpy.ssp.__file__).parent / f"schema/SystemStructure{('Description', 'ParameterValues')[k]}.xsd"
    etree.XMLSchema(file=str(schema)).assertValid(etree.fromstring(documents()[k]))


def test_version_2_says_what_version_1_does() -> None:
    """Expected: the documents of SSP 1.0 but for that number, with which they are valid by the schemas of 2.0 too."""
    for first, second in zip(documents(), documents("2.0"), strict=True):
        texts = [document.decode().partition("?>")[2] for document in (first, second)]
        assert texts[0].replace('version="1.0"', 'version="2.0"') == texts[1] != texts[0]


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
    plant = [("platform_mass", "12.5", "kg"), ("leg_lower_com", "-0.3", "m")]
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

    force, length = "actuator_force", "leg_length"
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
    root = etree.fromstring(documents()[0])
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
    assert _tree(etree.fromstring(documents()[1])) == (
        "ParameterSet",
        {"version": "1.0", "name": "loop"},
        [_parameters(*named), _units(kg=kg, m=m, s=s)],
    )

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
    """Names, attributes, children."""
    return (element.tag, dict(element.attrib), [_tree(child) for child in element])


SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SPACES = {
    **{"ssd": f"{SPACE}Description", "ssc": f"{SPACE}Common", "ssv": f"{SPACE}ParameterValues"},
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
UNIT = {
    "N": '<ssc:Unit name="N"><ssc:BaseUnit kg="1" m="1" s="-2"/></ssc:Unit>',
    **{name: f'<ssc:Unit name="{name}"><ssc:BaseUnit {name}="1"/></ssc:Unit>' for name in ("kg", "m", "s")},
}
ROWS = {
    "plant": [("platform_mass", "12.5", ' unit="kg"'), ("leg_lower_com", "-0.3", ' unit="m"')],
    "controller": [("sample_time", "0.002", ' unit="s"'), ("delay", "1.0", "")],
}


def _parameters(rows: list[tuple[str, str, str]], *units: str) -> str:
    values = (f'<ssv:Parameter name="{n}"><ssv:Real value="{v}"{u}/></ssv:Parameter>' for n, v, u in rows)
    return f"<ssv:Parameters>{''.join(values)}</ssv:Parameters><ssv:Units>{''.join(map(UNIT.get, units))}</ssv:Units>"  # type: ignore[arg-type]


def _component(name: str, connectors: list[tuple[str, str, str]], *units: str) -> str:
    places = (f'<ssd:Connector name="{n}" kind="{k}"><ssc:Real unit="{u}"/></ssd:Connector>' for n, k, u in connectors)
    return f"""<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/{name}.fmu"
      implementation="CoSimulation"><ssd:Connectors>{"".join(places)}</ssd:Connectors>
      <ssd:ParameterBindings><ssd:ParameterBinding type="application/x-ssp-parameter-set"><ssd:ParameterValues>
      <ssv:ParameterSet version="1.0" name="{name}">{_parameters(ROWS[name], *units)}</ssv:ParameterSet>
      </ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>"""


def test_the_whole_structure_is_that_of_the_standard() -> None:
    """Expected: SSP 1.0 by hand; the annotations of libcosim and OMSimulator with the master's step."""
    force, length = "actuator_force", "leg_length"
    connections = "".join(
        f'<ssd:Connection startElement="{a}" startConnector="{name}" endElement="{b}" endConnector="{name}"/>'
        for a, b, name in (("plant", "controller", length), ("controller", "plant", force))
    )
    plant = _component("plant", [(force, "input", "N"), (length, "output", "m")], "kg", "m")
    controller = _component("controller", [(length, "input", "m"), (force, "output", "N")], "s")
    declared = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in SPACES.items())
    expected = f"""<ssd:SystemStructureDescription {declared} version="1.0" name="loop"><ssd:System name="loop">
      <ssd:Elements>{plant}{controller}</ssd:Elements><ssd:Connections>{connections}</ssd:Connections>
      <ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations><oms:SimulationInformation>
      <oms:FixedStepMaster description="oms-ma" absoluteTolerance="1e-4" relativeTolerance="1e-4" stepSize="0.002"/>
      </oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations></ssd:System>
      <ssd:Units>{UNIT["N"]}{UNIT["m"]}</ssd:Units><ssd:DefaultExperiment startTime="0" stopTime="0.7">
      <ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm>
      <osp:FixedStepAlgorithm baseStepSize="0.002"/></osp:Algorithm></ssc:Annotation></ssd:Annotations>
      </ssd:DefaultExperiment></ssd:SystemStructureDescription>"""
    structure, values = (etree.fromstring(document) for document in documents())
    assert re.fullmatch(r"gough-stewart \d+\.\d+.*", str(structure.attrib.pop("generationTool")))
    assert _tree(structure) == _tree(etree.fromstring(expected))
    assert structure.nsmap == SPACES
    named = [(f"{c}.{n}", v, u) for c, rows in ROWS.items() for n, v, u in rows]
    spaces = " ".join(f'xmlns:{prefix}="{SPACES[prefix]}"' for prefix in ("ssv", "ssc"))
    of_values = f'<ssv:ParameterSet {spaces} version="1.0" name="loop">{_parameters(named, "kg", "m", "s")}'
    assert _tree(values) == _tree(etree.fromstring(f"{of_values}</ssv:ParameterSet>"))

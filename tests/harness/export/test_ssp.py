"""The loop as SSP: its documents by the standard, and what it cannot have; importers besides FMPy are evidence."""

import re
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import fmpy.ssp
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.validation import validate_fmu
from lxml import etree

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.exported_loop import EXPORTED, exported_loop
from tests.support.fmu_plants import Fmu
from tests.support.schemas import complaints_of_schemas

SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SPACES = {
    **{"ssd": f"{SPACE}Description", "ssc": f"{SPACE}Common", "ssv": f"{SPACE}ParameterValues"},
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}


@pytest.fixture(scope="module")
def ssp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported_loop(tmp_path_factory.mktemp("ssp"))


def documents(ssp: Path) -> list[Any]:
    """The structure and the parameter set."""
    with zipfile.ZipFile(ssp) as archive:
        return [etree.fromstring(archive.read(n)) for n in ("SystemStructure.ssd", "resources/heave_step.ssv")]


def units_of(ssp: Path, folder: Path) -> dict[str, Fmu]:
    """Plant and controller."""
    with zipfile.ZipFile(ssp) as archive:
        return {name: Fmu(Path(archive.extract(f"resources/{name}.fmu", folder))) for name in ("plant", "controller")}


def test_documents_are_valid_and_the_same_every_time(ssp: Path, tmp_path: Path) -> None:
    """Expected: the standard's own schemas, as FMPy carries them; SSP 2.0 says the same but for that number."""
    (second,) = gs.export("heave_step", EXPORTED, forms="ssp", ssp="2.0", out=tmp_path)
    with zipfile.ZipFile(ssp) as archive, zipfile.ZipFile(second) as other:
        units_and_page = ["documentation/index.html", "resources/controller.fmu", "resources/plant.fmu"]
        in_versions = ["SystemStructure.ssd", "resources/heave_step.ssv"]
        assert sorted(archive.namelist()) == sorted([*units_and_page, *in_versions])
        assert all(archive.read(name) == other.read(name) for name in units_and_page)
    for kind, one, other in zip(("Description", "ParameterValues"), documents(ssp), documents(second), strict=True):
        schema = Path(fmpy.ssp.__file__).parent / f"schema/SystemStructure{kind}.xsd"
        etree.XMLSchema(file=str(schema)).assertValid(one)
        texts = [etree.tostring(document).decode() for document in (one, other)]
        assert texts[0].replace('version="1.0"', 'version="2.0"') == texts[1] != texts[0]


def test_the_structure_connects_what_has_the_same_name(ssp: Path, tmp_path: Path) -> None:
    """Expected: lengths to the controller, forces to the plant, in both; SI units; start values once with each unit."""
    structure, values = documents(ssp)
    assert structure.nsmap == SPACES
    assert re.fullmatch(r"gough-stewart \d+\.\d+.*", str(structure.get("generationTool")))

    def all_of(root: Any, path: str) -> list[dict[str, str]]:
        return [dict(element.attrib) for element in root.iterfind(path, SPACES)]

    legs = range(1, 7)
    pairs = [("plant", f"leg_length[{k}]", "controller") for k in legs]
    pairs += [("controller", f"actuator_force[{k}]", "plant") for k in legs]
    names = ("startElement", "startConnector", "endElement", "endConnector")
    expected = [dict(zip(names, (a, name, b, name), strict=True)) for a, name, b in pairs]
    assert all_of(structure, ".//ssd:Connection") == expected
    units = units_of(ssp, tmp_path)
    in_set = {row.get("name"): row[0] for row in values.iterfind(".//ssv:Parameter", SPACES)}
    for component in structure.iterfind(".//ssd:Component", SPACES):
        name = component.get("name")
        assert component.get("source") == f"resources/{name}.fmu"
        kinds = {"leg_length": "m", "actuator_force": "N"}
        connectors = {
            (row.get("name"), row.get("kind"), row[0].get("unit"))
            for row in component.iterfind("ssd:Connectors/ssd:Connector", SPACES)
        }
        own = "leg_length" if name == "plant" else "actuator_force"
        assert connectors == {
            (f"{key}[{k}]", "output" if key == own else "input", unit) for key, unit in kinds.items() for k in legs
        }
        rows = {row.get("name"): row[0] for row in component.iterfind(".//ssv:Parameter", SPACES)}
        declared = {v.name: v for v in units[name].description.modelVariables if v.causality == "parameter"}
        assert rows.keys() == declared.keys()
        for key, v in declared.items():
            for row in (rows[key], in_set[f"{name}.{key}"]):
                assert (float(row.get("value")), row.get("unit")) == (float(v.start), v.unit)
    assert len(in_set) == sum(v.causality == "parameter" for u in units.values() for v in u.description.modelVariables)
    declared_units = {row["name"] for row in all_of(structure, "ssd:Units/ssc:Unit")}
    assert declared_units == {"N", "m"}
    (newton,) = all_of(structure, "ssd:Units/ssc:Unit[@name='N']/ssc:BaseUnit")
    assert newton == {"kg": "1", "m": "1", "s": "-2"}
    assert all_of(structure, "ssd:DefaultExperiment") == [{"startTime": "0", "stopTime": "0.3"}]
    assert all_of(structure, ".//osp:FixedStepAlgorithm") == [{"baseStepSize": "0.002"}]
    master = {"description": "oms-ma", "absoluteTolerance": "1e-4", "relativeTolerance": "1e-4", "stepSize": "0.002"}
    assert all_of(structure, ".//oms:FixedStepMaster") == [master]


@pytest.mark.evidence
def test_encoders_at_the_motors_are_connected_with_the_motors(tmp_path: Path) -> None:
    """Expected: the harness with encoders there; those at the legs are ten times as far away."""
    soft = {"platform.parameters.leg_stiffness": 1e8, "controller.bandwidth": 2}
    settings = {**EXPORTED, **soft, "sensors.side": "motor", "sensors.quantisation.leg_length": 0.0}
    found = simulate_ssp(str(exported_loop(tmp_path, settings)), stop_time=0.299, step_size=0.002)
    motors = np.transpose([found[f"plant.motor_position[{k}]"] for k in range(1, 7)])
    assert np.abs(motors - gs.run("heave_step", settings)["motor_position"][1:]).max() <= 3e-7
    other = gs.run("heave_step", {**settings, "sensors.side": "leg"})
    assert np.abs(motors - other["motor_position"][1:]).max() > 3e-6


def test_with_fmi_3_the_units_describe_the_scalars_of_the_connectors(ssp: Path, tmp_path: Path) -> None:
    """Expected: names, kinds and dependencies by name as in FMI 2.0; FMPy and the schemas have nothing to say."""
    done = invoke("export", "heave_step", "--as", "ssp", "--ssp-fmi", "3.0", "--out", str(tmp_path))
    assert done.exit_code == 0, done.stderr
    both = [units_of(archive, tmp_path / str(k)) for k, archive in enumerate((ssp, tmp_path / "heave_step.ssp"))]
    for name in ("plant", "controller"):
        files = [units[name] for units in both]
        assert validate_fmu(str(files[1].path)) == []
        assert complaints_of_schemas(files[1]) == {}
        assert [file.version for file in files] == ["2.0", "3.0"]
        found = [{v.name: v for v in file.description.modelVariables} for file in files]
        assert all(v.type == "Float64" and not v.dimensions for v in found[1].values())
        assert found[1].keys() == found[0].keys() | {"time"}
        for key, v in found[0].items():
            w = found[1][key]
            assert (v.causality, v.variability, v.unit, v.min) == (w.causality, w.variability, w.unit, w.min)
            assert (v.start is None) == (w.start is None)
            assert (v.derivative and v.derivative.name) == (w.derivative and w.derivative.name)
        for part in ("outputs", "initialUnknowns"):
            sets = [
                {u.variable.name: {d.name for d in u.dependencies} for u in getattr(file.description, part)}
                for file in files
            ]
            assert sets[0] == sets[1]


def test_what_an_ssp_cannot_have_is_refused(tmp_path: Path) -> None:
    """Expected: another version of the units or of SSP, a reference from outside."""
    for options, message in (
        ({"forms": "ssp", "ssp_fmi": "2.1"}, r"no FMI version '2.1'; expected '2.0' or '3.0'"),
        ({"forms": "ssp", "ssp": "1.1"}, r"ssp is '1.1'; expected '1.0' or '2.0'"),
        ({"forms": ["c", "ssp"], "reference": "inputs"}, "leaves an SSP without a reference; expected 'inside'"),
    ):
        with pytest.raises(gs.GoughStewartError, match=message):
            gs.export("heave_step", out=tmp_path, **options)
    assert list(tmp_path.iterdir()) == []

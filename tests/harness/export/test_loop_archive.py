"""The loop as SSP beside the harness at a delay of one sample: FMPy here, libcosim and Ecos as evidence."""

import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.simulation import instantiate_fmu
from fmpy.ssp.simulation import simulate_ssp
from fmpy.validation import validate_fmu

import gough_stewart as gs
from gough_stewart.harness.plants.unit import FmuFile
from tests.support.commands import invoke
from tests.support.exported_loop import EXPORTED, MISTAKEN, exported_loop
from tests.support.schemas import complaints_of_schemas

N_STEPS = round(EXPORTED["loop.duration"] / EXPORTED["loop.sample_time"])


@pytest.fixture(scope="module")
def ssp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported_loop(tmp_path_factory.mktemp("ssp"))


def test_the_archive_holds_the_structure_the_parameters_and_two_units(ssp: Path) -> None:
    with zipfile.ZipFile(ssp) as archive:
        names = archive.namelist()
    assert sorted(names) == [
        "SystemStructure.ssd",
        "documentation/index.html",
        "resources/controller.fmu",
        "resources/heave_step.ssv",
        "resources/plant.fmu",
    ]


def test_fmpy_runs_it_as_the_harness_does(ssp: Path) -> None:
    """Expected: the harness on its own model of the plant; FMPy hands on no start values, and units know that."""
    step = EXPORTED["loop.sample_time"]
    found = simulate_ssp(str(ssp), stop_time=EXPORTED["loop.duration"] - step / 2, step_size=step)
    expected = gs.run("heave_step", EXPORTED)
    lengths = np.transpose([found[f"plant.leg_length[{k}]"] for k in range(1, 7)])
    assert np.abs(np.diff(expected["leg_length"], axis=0)).max() > 1e-5  # the step is in it
    # FMPy's rows are of the ends of steps
    assert lengths.shape == (N_STEPS, 6)
    assert np.abs(lengths - expected["leg_length"][1:]).max() <= 1e-9


def test_fmpy_runs_it_with_the_delay_of_the_experiment(tmp_path: Path) -> None:
    """Expected: the harness with that delay; the loop with another is a tenth of a millimetre away."""
    delay = 3
    settings = EXPORTED | {"loop.delay": delay}
    step = settings["loop.sample_time"]
    found = simulate_ssp(
        str(exported_loop(tmp_path, settings)), stop_time=settings["loop.duration"] - step / 2, step_size=step
    )
    lengths = np.transpose([found[f"plant.leg_length[{k}]"] for k in range(1, 7)])
    assert np.abs(lengths - gs.run("heave_step", settings)["leg_length"][1:]).max() <= 1e-9
    assert np.abs(lengths - gs.run("heave_step", EXPORTED)["leg_length"][1:]).max() > 1e-4
    # the unit by itself would add its delay to that of the harness
    with zipfile.ZipFile(tmp_path / "heave_step.ssp") as archive:
        unit = archive.extract("resources/controller.fmu", tmp_path)
    with pytest.raises(
        gs.GoughStewartError, match=rf"output_delay is {delay} samples, .* expected 1: set parameters = "
    ):
        gs.run("heave_step", settings, controller=unit)
    one = {"type": "fmu", "file": unit, "parameters": {"output_delay": 1}}
    with_unit = gs.run("heave_step", {**settings, "controller": one})
    assert np.abs(with_unit["leg_length"] - gs.run("heave_step", settings)["leg_length"]).max() <= 1e-9


@pytest.mark.evidence
def test_encoders_at_the_motors_are_connected_with_the_motors(tmp_path: Path) -> None:
    """Expected: the harness with encoders there; those at the legs are ten times as far away.

    FMPy hands on no start values, so the first sample of the controller's unit has the lengths without stretch.
    """
    soft = {"platform.parameters.leg_stiffness": 1e8, "controller.bandwidth": 2}
    settings = {**EXPORTED, **soft, "sensors.side": "motor", "sensors.quantisation.leg_length": 0.0}
    step = settings["loop.sample_time"]
    archive = exported_loop(tmp_path, settings)
    found = simulate_ssp(str(archive), stop_time=settings["loop.duration"] - step / 2, step_size=step)
    motors = np.transpose([found[f"plant.motor_position[{k}]"] for k in range(1, 7)])
    assert np.abs(motors - gs.run("heave_step", settings)["motor_position"][1:]).max() <= 3e-7
    other = gs.run("heave_step", {**settings, "sensors.side": "leg"})
    assert np.abs(motors - other["motor_position"][1:]).max() > 3e-6


def test_with_fmi_3_the_units_describe_the_scalars_of_the_connectors(ssp: Path, tmp_path: Path) -> None:
    """Expected: names, starts and dependencies by name as in FMI 2.0; FMPy and the schemas have nothing to say."""
    (other,) = gs.export("heave_step", EXPORTED, forms="ssp", ssp_fmi="3.0", out=tmp_path)
    for name in ("plant", "controller"):
        files = []
        for k, archive in enumerate((ssp, other)):
            with zipfile.ZipFile(archive) as opened:
                files.append(FmuFile(opened.extract(f"resources/{name}.fmu", tmp_path / str(k))))
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
            assert v.start is None or float(v.start) == float(w.start)
            assert (v.derivative and v.derivative.name) == (w.derivative and w.derivative.name)
        for part in ("outputs", "initialUnknowns"):
            sets = [
                {u.variable.name: {d.name for d in u.dependencies} for u in getattr(file.description, part)}
                for file in files
            ]
            assert sets[0] == sets[1]
        for file in files:
            file.close()
    with zipfile.ZipFile(ssp) as a, zipfile.ZipFile(other) as b:
        assert a.read("SystemStructure.ssd") == b.read("SystemStructure.ssd")


def test_with_fmi_3_a_master_gets_what_the_harness_does(tmp_path: Path) -> None:
    """Expected: the harness; a plain master, which hands the connected scalars on before each step.

    On another machine than is believed, with a delay of two samples, and forces that differ by leg.
    """
    settings = MISTAKEN | {"loop.delay": 2, "loop.duration": 0.1}
    (ssp,) = gs.export("heave_step", settings, forms="ssp", ssp_fmi="3.0", out=tmp_path)
    with zipfile.ZipFile(ssp) as opened:
        opened.extractall(tmp_path)
    structure = ElementTree.parse(tmp_path / "SystemStructure.ssd").getroot()
    space = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
    step, units, references = settings["loop.sample_time"], {}, {}
    for component in structure.iter(f"{space}Component"):
        name, path = component.get("name", ""), tmp_path / component.get("source", "")
        description: Any = fmpy.read_model_description(str(path))
        references[name] = {v.name: v.valueReference for v in description.modelVariables}
        unit: Any = instantiate_fmu(fmpy.extract(str(path), str(tmp_path / name)), description, "CoSimulation")
        unit.enterInitializationMode(startTime=0.0)
        unit.exitInitializationMode()
        units[name] = unit
    connections = [dict(each.attrib) for each in structure.iter(f"{space}Connection")]
    expected, rows = gs.run("heave_step", settings)["leg_length"], []
    for k in range(len(expected)):
        for c in connections:
            source, sink = c["startElement"], c["endElement"]
            value = units[source].getFloat64([references[source][c["startConnector"]]])
            units[sink].setFloat64([references[sink][c["endConnector"]]], value)
        rows.append(units["plant"].getFloat64([references["plant"][f"leg_length[{leg}]"] for leg in range(1, 7)]))
        for unit in units.values():
            unit.doStep(k * step, step)
    for unit in units.values():
        unit.freeInstance()
    assert np.abs(np.diff(expected, axis=0)).max() > 1e-5
    assert np.abs(np.array(rows) - expected).max() <= 1e-9


def test_the_same_archive_comes_out_twice(ssp: Path, tmp_path: Path) -> None:
    assert exported_loop(tmp_path).read_bytes() == ssp.read_bytes()


def test_what_an_ssp_cannot_have_is_refused(tmp_path: Path) -> None:
    """Expected: another version of the units, a reference from outside; the command knows the same options."""
    with pytest.raises(gs.GoughStewartError, match=r"no FMI version '2.1'; expected 2.0 or 3.0"):
        gs.export("heave_step", forms="ssp", ssp_fmi="2.1", out=tmp_path)
    with pytest.raises(gs.GoughStewartError, match="leaves an SSP without a reference; expected 'inside'"):
        gs.export("heave_step", forms=["c", "ssp"], reference="inputs", out=tmp_path)
    assert list(tmp_path.iterdir()) == []
    done = invoke("export", "heave_step", "--as", "ssp", "--ssp-fmi", "3.0", "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    with zipfile.ZipFile(tmp_path / "out/heave_step.ssp") as opened:
        path = opened.extract("resources/controller.fmu", tmp_path)
    assert str(fmpy.read_model_description(path).fmiVersion) == "3.0"

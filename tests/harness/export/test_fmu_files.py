"""What is in a controller's FMU: documents, sources that any C11 compiler takes, the same bytes every time."""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import control
import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from gough_stewart import LinearController
from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.component import UnitComponent
from gough_stewart.fmu_build.sources import sources, standard_headers
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.plants.unit import FmuFile
from tests.support.c_hosts import FUZZ, INSTANCES, NEVER_OK, OF_STATES, ZIG, compile_host, fuzz, run_instances
from tests.support.c_hosts import functions_of_the_standards as functions
from tests.support.controllers import SAMPLE_TIME, uneven_experiment
from tests.support.fmu_plants import Plant
from tests.support.schemas import complaints_of_schemas


class Exported(NamedTuple):
    """A controller with the reference as inputs, and its units."""

    designed: Designed
    component: UnitComponent
    files: tuple[FmuFile, ...]


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Exported]:
    folder = tmp_path_factory.mktemp("controller")
    chosen = designed(uneven_experiment(folder), reference="inputs")
    files = tuple(map(FmuFile, build_units(component_of(chosen, "uneven", 0.25), folder)))
    yield Exported(chosen, component_of(chosen, "uneven", 0.25), files)
    for file in files:
        file.close()


def test_fmpy_and_the_schemas_find_no_problem(exported: Exported) -> None:
    for file in exported.files:
        assert validate_fmu(str(file.path)) == []
        assert complaints_of_schemas(file) == {}


def test_the_files_are_named_after_the_experiment_and_the_same_every_time(exported: Exported, tmp_path: Path) -> None:
    again = build_units(component_of(exported.designed, "uneven", 0.25), tmp_path)
    assert [path.name for path in again] == ["uneven_fmi2.fmu", "uneven_fmi3.fmu"]
    for path, file in zip(again, exported.files, strict=True):
        assert path.read_bytes() == file.path.read_bytes()


def test_outputs_depend_on_no_input(exported: Exported) -> None:
    """Expected: no direct feedthrough; at the start the forces are the start forces, one by one."""
    for file in exported.files:
        description = file.description
        outputs = {"actuator_force", "force_limited", "input_status", "input_bad_time"}
        assert {u.variable.name.split("[")[0] for u in description.outputs} == outputs
        assert all(u.dependencies == [] for u in description.outputs)
        for unknown in description.initialUnknowns:
            name = unknown.variable.name
            expected = [name.replace("actuator_force", "start_force")] if name.startswith("actuator") else []
            assert [v.name for v in unknown.dependencies] == expected


def test_variables_are_those_of_the_controller(exported: Exported) -> None:
    """Expected: names of the contract; limits as designed; units of gains; the experiment's times."""
    file = exported.files[1]
    found = {v.name: v for v in file.description.modelVariables}
    inputs = [name for name, v in found.items() if v.causality == "input"]
    poses = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    assert inputs == ["leg_length", *(f"reference_{name}" for name in poses)]
    assert found["force_limit"].start == "75.0"
    assert found["proportional_gain"].unit == "N/m"
    assert found["integral_gain"].variability == "tunable"
    assert found["sample_time"].variability == "fixed"
    experiment = file.description.defaultExperiment
    assert (float(experiment.stopTime), float(experiment.stepSize)) == (0.25, SAMPLE_TIME)
    units = {u.name for u in file.description.unitDefinitions}
    assert units == {v.unit for v in found.values() if v.unit}


def test_the_page_says_when_samples_are_and_lists_the_variables(exported: Exported) -> None:
    """Expected: well-formed, with the title escaped and a line for every variable."""
    for file in exported.files:
        page = (file.folder / "documentation/index.html").read_text()
        rows = ET.fromstring(page).findall(".//{http://www.w3.org/1999/xhtml}tbody/*")
        assert len(rows) == len(exported.component.layout.described(file.version))
        assert "uneven &lt;loop&gt;" in page
        assert "<code>start_force</code>" in page


def test_a_controller_that_is_told_nothing_gives_its_start_forces(exported: Exported) -> None:
    """Expected: as with importers that do not hand on start values."""
    for file in exported.files:
        names = [v.name for v in file.description.modelVariables if v.name.startswith("actuator_force")]
        result = simulate_fmu(str(file.path), output=names)
        forces = np.concatenate([np.asarray(result[name]).reshape(len(result), -1) for name in names], axis=1)
        assert result["time"][-1] == 0.25
        np.testing.assert_array_equal(forces, np.tile(exported.designed.start_force, (len(result), 1)))


def test_the_sources_compile_without_a_warning(exported: Exported, tmp_path: Path) -> None:
    """Expected: C11 to the letter, by gcc if it is there and by clang; the standard's own headers are its business."""
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-isystem", "standard", "-c"]
    standard = standard_headers("2.0") | standard_headers("3.0")
    units, headers = sources(exported.component)
    (tmp_path / "standard").mkdir()
    for name, text in {**units, **headers}.items():
        (tmp_path / ("standard" if name in standard else "") / name).write_text(text)
    for compiler in [ZIG] + ([("gcc",)] if shutil.which("gcc") else []):
        command = [*compiler, *flags, *sorted(units)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_no_sequence_of_calls_breaks_the_contract(exported: Exported, tmp_path: Path) -> None:
    """Expected: as for the plant; what only units with continuous states have never succeeds."""
    compiler = (*ZIG, "-O1", "-fsanitize=undefined", "-fsanitize-trap=undefined")
    calls = fuzz(compile_host(FUZZ, tmp_path / "fuzz", compiler, exported.component), 1500)
    assert set(calls) == functions()
    assert {function for function, n in calls.items() if n["ok"] == 0} == NEVER_OK | OF_STATES


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured by glibc's mallinfo2")
def test_instances_in_threads_have_the_same_bits_and_take_4_kilobytes(exported: Exported, tmp_path: Path) -> None:
    """Expected: the same unit, stepped in another order."""
    result = run_instances(compile_host(INSTANCES, tmp_path / "instances", (*ZIG, "-O1"), exported.component), 100, 8)
    print(result)
    assert result["bytes_per_instance"] <= 4 * 1024


def test_matrices_keep_their_sample_time(tmp_path: Path) -> None:
    """Expected: another sample_time is refused before the start, with the one it was designed for."""
    proportional = LinearController(control.ss([], [], [], np.hstack([np.eye(6), -np.eye(6)]), SAMPLE_TIME))
    chosen = designed(uneven_experiment(tmp_path), proportional)
    (path,) = build_units(component_of(chosen), tmp_path, fmi=["2.0"])
    with FmuFile(path) as file, Plant(file) as unit:
        unit.set("sample_time", 0.005)
        with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
            unit.initialise()
        assert "sample_time = 0.005 s rejected; expected 0.004 s, since the controller was designed for it" in (
            unit.take_messages()
        )


def test_states_of_another_controller_with_the_same_variables_are_refused(tmp_path: Path) -> None:
    """Expected: the layout's number is another one, since the C is."""
    one, other = (
        component_of(designed(uneven_experiment(tmp_path, derivative_on=what))) for what in ("error", "measurement")
    )
    assert one.layout == other.layout
    numbers = [re.findall(r"LAYOUT = (.*);", sources(each).units["model.c"]) for each in (one, other)]
    assert numbers[0] != numbers[1]

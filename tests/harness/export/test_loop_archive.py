"""The loop as SSP beside the harness at a delay of one sample: FMPy here, libcosim and Ecos as evidence."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp

import gough_stewart as gs
from gough_stewart.harness.errors import ControllerError, ExportError
from tests.support.exported_loop import EXPORTED, exported_loop

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


@pytest.mark.parametrize("delay", [2, 3])
def test_fmpy_runs_it_with_the_delay_of_the_experiment(delay: int, tmp_path: Path) -> None:
    """Expected: the harness with that delay; the loop with another is a tenth of a millimetre away."""
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
    with pytest.raises(ControllerError, match=rf"output_delay is {delay} samples, .* expected 1: set parameters = "):
        gs.run("heave_step", settings, controller=unit)
    one = {"type": "fmu", "file": unit, "parameters": {"output_delay": 1}}
    with_unit = gs.run("heave_step", {**settings, "controller": one})
    assert np.abs(with_unit["leg_length"] - gs.run("heave_step", settings)["leg_length"]).max() <= 1e-9


def test_the_same_archive_comes_out_twice(ssp: Path, tmp_path: Path) -> None:
    assert exported_loop(tmp_path).read_bytes() == ssp.read_bytes()


def test_a_reference_from_outside_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="leaves an SSP without a reference; expected 'inside'"):
        gs.export("heave_step", forms=["c", "ssp"], reference="inputs", out=tmp_path)
    assert list(tmp_path.iterdir()) == []

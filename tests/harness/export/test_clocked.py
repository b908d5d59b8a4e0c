"""The controller as FMU with a clock: beside the unit without one, its C, and the controller in Python.

What the loop in Python measured goes in at the ticks.
"""

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.validation import validate_fmu

import gough_stewart as gs
from gough_stewart.fmu_build.builder import unit_of
from gough_stewart.fmu_build.sources import standard_headers
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.designed import designed
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.unit import FmuFile
from gough_stewart.model.vectors import FloatArray
from tests.support.c_hosts import ZIG
from tests.support.clocked_unit import run_clocked
from tests.support.commands import invoke
from tests.support.controllers import SAMPLE_TIME, forces_of, run_of, uneven_experiment
from tests.support.exported import GCC
from tests.support.sampled_unit import run_source, run_unit

LENGTHS = signals.positions(("leg_length",))
LENGTH = "leg_length"


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return uneven_experiment(tmp_path_factory.mktemp("experiment"))


@pytest.fixture(scope="module")
def exported(experiment: Experiment, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The unit with a clock, that without, and C."""
    folder = tmp_path_factory.mktemp("exported")
    # with the slow gains of this controller the loop is unstable, which is not what is asked here
    files = gs.export(experiment, forms=["clocked", "fmu", "c"], fmi="3.0", out=folder, anyway=True)
    return {path.name: path for path in files}


def measured(experiment: Experiment) -> tuple[FloatArray, FloatArray]:
    """Leg lengths at every sample of the loop in Python, and the forces that it gave for them."""
    found = run_of(experiment)
    return found.measured[:, LENGTHS], forces_of(found)[: len(found.measured)]


def test_the_forces_are_those_of_the_plain_unit_bit_for_bit_and_of_python(
    experiment: Experiment, exported: dict[str, Path]
) -> None:
    """Expected: the plain unit one sample later; the C at once; the loop in Python to 1e-9 of the largest force.

    Python computes with NumPy what C computes in another order.
    """
    lengths, forces = measured(experiment)
    rows = [{LENGTH: row} for row in lengths]
    found = run_clocked(exported["uneven_loop_controller_clocked_fmi3.fmu"], rows, 0.0)
    plain, _ = run_unit(exported["uneven_loop_controller_fmi3.fmu"], rows, SAMPLE_TIME, 0.0)
    for each, other in zip(found, plain, strict=True):
        np.testing.assert_array_equal(each, other)
    source = run_source(exported["uneven_loop_controller.c"], lengths, None)
    np.testing.assert_allclose(found.force, source.force, rtol=1e-12)
    assert 0 < found.limited.mean() < 1
    assert np.ptp(found.force, axis=0).min() > 1
    scale = np.abs(forces).max()
    assert np.abs(found.force - forces).max() <= 1e-9 * scale


def test_ticked_by_a_scheduler_it_is_the_same(experiment: Experiment, exported: dict[str, Path]) -> None:
    lengths, _ = measured(experiment)
    rows = [{LENGTH: row} for row in lengths]
    path = exported["uneven_loop_controller_clocked_fmi3.fmu"]
    for each, other in zip(
        run_clocked(path, rows, 0.0), run_clocked(path, rows, 0.0, "ScheduledExecution"), strict=True
    ):
        np.testing.assert_array_equal(each, other)


def test_with_drives_and_sensors_it_ticks_at_their_step(experiment: Experiment, tmp_path: Path) -> None:
    """Expected: the plain unit with both, whose forces are the experiment's delay later, bit for bit."""
    changed: dict[str, Any] = {
        **{"actuators.lag": 0.003, "loop.delay": 2, "sensors.sample_time": 2 * SAMPLE_TIME},
        "sensors.quantisation": {LENGTH: 1e-5},
    }
    clocked, plain = gs.export(
        experiment,
        changed,
        forms=["fmu", "clocked"],
        fmi="3.0",
        parts=["drives", "sensors"],
        anyway=True,
        out=tmp_path,
    )[::-1]
    step = SAMPLE_TIME / 4
    lengths = np.repeat(measured(experiment)[0][:30], 4, axis=0) + 1e-4 * np.sin(np.arange(120))[:, None]
    rows = [{LENGTH: row} for row in lengths]
    found = run_clocked(clocked, rows, 0.0)
    other, _ = run_unit(plain, rows, step, 0.0)
    # the plain unit's outputs at the end of step k are those of step k + 1 - 8
    np.testing.assert_array_equal(found.force[:113], other.force[7:])
    np.testing.assert_array_equal(found.limited[:113], other.limited[7:])
    assert np.ptp(found.force, axis=0).min() > 1
    with FmuFile(clocked) as file:
        text = (file.folder / "modelDescription.xml").read_text(encoding="utf-8")
    assert f'intervalDecimal="{step!r}"' in text


def test_an_experiment_without_delay_has_none(tmp_path: Path) -> None:
    """Expected: no warning of a delay, which the plain unit has; judged as the loop that it is."""
    said: dict[str, list[str]] = {}
    verdicts: dict[str, list[str]] = {}
    for form in ("clocked", "fmu"):
        gs.export(
            "heave_step",
            {"loop.delay": 0},
            forms=[form],
            fmi="3.0",
            out=tmp_path / form,
            warn=said.setdefault(form, []).append,
            verdict=verdicts.setdefault(form, []).append,
        )
    assert not [text for text in said["clocked"] if "one sample late" in text]
    assert [text for text in said["fmu"] if "one sample late" in text]
    assert verdicts["clocked"][0].startswith("stable with the clocked FMU with no delay: |z| = ")
    assert verdicts["fmu"][0].startswith("stable with the FMU with a delay of 1 sample: |z| = ")
    (path,) = (tmp_path / "clocked").iterdir()
    with FmuFile(path) as file:
        page = (file.folder / "documentation/index.html").read_text(encoding="utf-8")
    words = " ".join(page.split())
    assert "Delay: the forces of a tick are its outputs (output_delay = 0); the experiment has no delay" in words
    assert "Co-Simulation with event mode, and Scheduled Execution" in words
    assert "the start time + k · 0.001 s" in words


def test_the_command_writes_one_file_that_validates_and_compiles_without_a_warning(
    experiment: Experiment, tmp_path: Path
) -> None:
    """Expected: C11 to the letter, the standard's own headers apart; one file, of FMI 3.0 whatever --fmi."""
    done = invoke("export", "heave_step", "--as", "clocked", "--fmi", "2.0", "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    (path,) = (path for path in (tmp_path / "out").iterdir() if path.name != "report.json")
    assert path.name == "heave_step_controller_clocked_fmi3.fmu"
    assert validate_fmu(str(path)) == []
    assert "Written as clocked FMU" in done.stdout
    component = component_of(designed(experiment), "clocked", output_delay=0, is_clocked=True)
    sources, standard = unit_of(component, "3.0").sources, standard_headers("3.0")
    (tmp_path / "standard").mkdir()
    for name, text in {**sources.units, **sources.headers}.items():
        (tmp_path / ("standard" if name in standard else "") / name).write_text(text)
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-isystem", "standard", "-c"]
    for compiler in [ZIG] + ([(GCC,)] if GCC else []):
        made = subprocess.run(
            [*compiler, *flags, *sources.unit_names], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert made.returncode == 0, made.stderr

"""The command `export`, and `run` with what it exports, as a user meets them."""

from pathlib import Path

import numpy as np

from gough_stewart.harness.results.record import read_record
from tests.support.commands import invoke

# a reference that moves from the beginning, and clocks that differ
SETTINGS = ["loop.duration=0.06", "loop.delay=1", "loop.plant_step=0.0005", "reference.at=0.01"]
SET = [word for setting in SETTINGS for word in ("--set", setting)]


def test_forms_are_written_together(tmp_path: Path) -> None:
    done = invoke("export", "heave_step", "--as", "c, fmu,ssp", "--fmi", "2.0", "--out", str(tmp_path / "new"))
    assert done.exit_code == 0, done.output
    assert sorted(file.name for file in (tmp_path / "new").iterdir()) == [
        "example_main.c",
        "heave_step.ssp",
        "heave_step_controller.c",
        "heave_step_controller.h",
        "heave_step_controller_fmi2.fmu",
        "report.json",
    ]
    for form in ("FMU", "C", "SSP"):
        assert f"the {form} is without sensors.quantisation: it " in done.output
    for where in ("in C", "with the FMU", "in the SSP"):
        row = next(line for line in done.output.splitlines() if line.startswith(f"│ {where} "))
        cells = [cell.strip() for cell in row.strip("│").split("│")]
        assert cells == [where, "stable", "1", "0.99098", "the nominal machine in its first pose", "1.161"]


def test_the_exported_unit_runs_in_the_place_of_the_controller(tmp_path: Path) -> None:
    """Expected: the run with the controller in Python; its plant is stepped by other code, to a tolerance of 1e-8."""
    for name, options in (("python", []), ("unit", ["--controller", "fmu3"])):
        done = invoke("run", "heave_step", *SET, *options, "--out", str(tmp_path / name))
        assert done.exit_code == 0, done.output
    found, expected = (read_record(tmp_path / name / "record.parquet") for name in ("unit", "python"))
    assert np.ptp(expected["controller.force"]) > 100
    assert np.allclose(found["controller.force"], expected["controller.force"], rtol=1e-9, atol=0)
    assert np.abs(found["position"] - expected["position"]).max() <= 1e-10


def test_an_unstable_loop_is_refused_and_with_anyway_exported(tmp_path: Path) -> None:
    """Expected: nothing is written, though the C alone would be; anyway, with a warning."""
    arguments = ("export", "circle", "--as", "c,ssp", "--out", str(tmp_path / "out"))
    done = invoke(*arguments)
    assert done.exit_code == 1
    assert "in the SSP the closed loop is unstable with a delay of 1 sample: |z| = 1.0505" in done.output
    assert not (tmp_path / "out").exists()
    done = invoke(*arguments, "--anyway")
    assert done.exit_code == 0, done.output
    assert "warning: exported anyway: in the SSP the closed loop is unstable" in done.output
    assert "UNSTABLE in the SSP with a delay of 1 sample: |z| = 1.0505" in done.output
    assert (tmp_path / "out" / "circle.ssp").exists()


def test_a_run_with_the_exported_unit_is_refused_where_its_loop_is_unstable(tmp_path: Path) -> None:
    short = ("--set", "loop.duration=0.02", "--set", "loop.delay=1", "--out", str(tmp_path / "out"))
    done = invoke("run", "circle", "--controller", "fmu3", *short)
    assert done.exit_code == 1
    assert "with the unit in the run the closed loop is unstable with a delay of 1 sample: |z| = 1.0505" in done.output
    assert "--anyway runs it" in done.output
    assert not (tmp_path / "out").exists()
    done = invoke("run", "circle", "--controller", "fmu3", "--anyway", *short)
    assert done.exit_code == 0, done.output
    assert "warning: run anyway: with the unit in the run" in done.output


def test_switch_and_safe_forces_are_chosen_at_the_command(tmp_path: Path) -> None:
    """Expected: the header states the safe force, what counts as frozen, the switch; and what float costs."""
    options = ("--with", "manual", "--safe-force", "zero", "--frozen", "50, 1 mm", "--set", "loop.duration=0.05")
    done = invoke("export", "saturation", "--as", "c", *options, "--out", str(tmp_path))
    assert done.exit_code == 0, done.output
    header = " ".join((tmp_path / "saturation_controller.h").read_text().split())
    assert (
        "REAL=float, forces deviate from those in double precision, in 0.05 s of the designed loop, by at most"
        in header
    )
    assert "While `input_status` is not good, all six forces are 0," in header
    assert "the same for 50 samples while its reference moves by more than 0.001 m" in header
    assert "saturation_controller_real enabled;" in header

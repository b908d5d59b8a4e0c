"""What is exported under which name, and a control function by itself."""

from pathlib import Path

import casadi
import pytest

import gough_stewart as gs
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.export.choices import chosen_forms, name_of

EXPERIMENT = 'title = "a loop"\n[loop]\nduration = 1\n[controller]\ntype = "open_loop"\n'


def test_a_casadi_function_leaves_by_itself(tmp_path: Path) -> None:
    """Expected: files by its name, at the sample time of the settings."""
    length = casadi.SX.sym("leg_length", 6)
    law = casadi.Function("Soft", [length], [-1e3 * length], ["leg_length"], ["actuator_force"])
    files = gs.export(law, {"loop.sample_time": 0.0025}, forms="c", out=tmp_path, allow_unstable=True)
    assert [file.name for file in files] == ["soft_controller.c", "soft_controller.h", "example_main.c"]
    assert "R(0.0025), /* sample_time */" in files[0].read_text()


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("My Loop-2.toml", "my_loop_2"),
        ("3rd try.toml", "loop_3rd_try"),
        ("ährenfeld.toml", "hrenfeld"),
        ("a_name_that_is_much_longer_than_c_likes.toml", "a_name_that_is_much_long"),
    ],
)
def test_names_of_files_become_identifiers(file: str, name: str, tmp_path: Path) -> None:
    (tmp_path / file).write_text(EXPERIMENT)
    assert name_of(gs.load_experiment(tmp_path / file)) == name


def test_a_shipped_experiment_is_called_as_it_is_and_one_of_python_by_its_title() -> None:
    assert name_of(gs.load_experiment("heave_step")) == "heave_step"
    made = gs.Experiment.model_validate(
        {"title": "Some Loop", "loop": {"duration": 1.0}, "controller": {"type": "open_loop"}}
    )
    assert name_of(made) == "some_loop"


def test_forms_come_once_and_in_order() -> None:
    assert chosen_forms(["ssp", "fmu", "ssp"]) == ("fmu", "ssp")
    with pytest.raises(gs.GoughStewartError, match="no form; expected one or more of fmu, c, ssp, page"):
        chosen_forms([])
    with pytest.raises(
        ExportError, match="'clocked'; expected one of fmu, c, ssp, page; the unit without a clock serves"
    ):
        chosen_forms("clocked")
    with pytest.raises(gs.GoughStewartError, match="forms is 3; expected one or more of fmu, c, ssp"):
        chosen_forms(3)  # type: ignore[arg-type]

"""What a command imports before it says something, and what it never imports; instead of timings, which vary."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.fmu_plants import Fmu

# Each takes a tenth of a second or more; all together take two.
SLOW = ("casadi", "control", "fmpy", "lxml", "bokeh", "matplotlib", "polars", "scipy")
ALL = (*SLOW, "numpy", "pydantic")


def loaded_after(code: str, *arguments: str) -> set[str]:
    """Those of `ALL` that a new interpreter has after some code, which may exit."""
    report = "sys.stderr.write('loaded: ' + ' '.join(sys.modules))"
    whole = f"import sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\n{report}"
    done = subprocess.run([sys.executable, "-c", whole, *arguments], capture_output=True, text=True, check=True)
    modules = done.stderr.rpartition("loaded: ")[2].split()
    return set(ALL) & set(modules)


MAIN = "from gough_stewart.harness.cli.entry import main; main()"
# Ends the command where it would show its progress.
MAIN_UNTIL_PROGRESS = f"import rich.progress; rich.progress.Progress.start = sys.exit; {MAIN}"


def test_importing_the_package_imports_nothing_slow() -> None:
    assert loaded_after("import gough_stewart") == set()


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["run", "--help"], ["rnu"], ["run", "--plnat", "fmu3"]]
)
def test_help_and_mistyped_commands_do_without_numbers(arguments: list[str]) -> None:
    assert loaded_after(MAIN, *arguments) <= {"pydantic"}


@pytest.mark.parametrize(
    "arguments",
    [["presets"], ["experiments"], ["run", "heave_stop"], ["run", "heave_step", "--set", "loop.dely=1"]],
    ids=" ".join,
)
def test_lists_and_wrong_experiments_do_without_simulation_and_pictures(arguments: list[str]) -> None:
    assert loaded_after(MAIN, *arguments) <= {"numpy", "pydantic"}


@pytest.mark.parametrize(
    "arguments",
    [["run", "heave_step"], ["margins", "heave_step"], ["view", "."], ["workspace"], ["build"], ["reproduce"]],
    ids=" ".join,
)
def test_progress_shows_before_slow_imports(arguments: list[str], tmp_path: Path) -> None:
    options = [] if arguments[0] == "view" else ["--out", str(tmp_path)]
    assert loaded_after(MAIN_UNTIL_PROGRESS, *arguments, *options) <= {"numpy", "pydantic"}


def test_a_run_through_the_fmu_does_without_python_control_casadi_and_scipy(
    fmus: dict[str, Fmu], tmp_path: Path
) -> None:
    fmu = str(fmus["3.0"].path)
    arguments = ["run", "heave_step", "--plant", "fmu3", "--fmu", fmu, "--set", "loop.duration=0.5"]
    loaded = loaded_after(MAIN, *arguments, "--out", str(tmp_path))
    assert (tmp_path / "metrics.json").is_file()
    assert not loaded & {"casadi", "control", "matplotlib", "scipy"}


def test_a_run_of_the_model_in_machine_code_does_without_casadi_and_scipy(tmp_path: Path) -> None:
    """Expected: the second run, when all that has to be compiled is there."""
    arguments = ["run", "heave_step", "--set", "loop.duration=0.01", "--out", str(tmp_path)]
    loaded_after(MAIN, *arguments)
    assert not loaded_after(MAIN, *arguments) & {"casadi", "control", "matplotlib", "scipy"}


def test_building_a_unit_does_without_casadi_and_scipy_if_its_code_is_there(tmp_path: Path) -> None:
    """Expected: with the traced tables given, as a wheel carries them, nothing else asks for CasADi or SciPy."""
    given = """from gough_stewart.fmu_build.plant import plant_component as c
    sources, dependencies = c.Sources({}, {}), {}
    c._code, c.slot_dependencies = (lambda _: sources), (lambda _: dependencies)
    import gough_stewart.fmu_build.build, gough_stewart.model.kernel
    from gough_stewart.model.platform import load_preset
    c.plant_component(load_preset('liu2000'))"""
    assert not loaded_after(given, str(tmp_path)) & {"casadi", "control", "matplotlib", "scipy"}

"""Every command and snippet of the README runs; every file that the pages name is there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gough_stewart.harness import controller_choice, experiment, reference_choice
from gough_stewart.harness.section import Section

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS = [
    line.split("#")[0].strip() for block in re.findall(r"```sh\n(.*?)```", README, re.S) for line in block.splitlines()
]
FMU_SNIPPETS, CONTROL_SNIPPETS = (
    re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.S) for page in ("docs/fmu.md", "docs/control.md")
)
SNIPPETS = re.findall(r"```python\n(.*?)```", README, re.S)
STEPPING, LQR = (
    next(s for s in SNIPPETS if word in s) for word in ('plant.get("leg_velocity")', "solve_continuous_are")
)
PAGES = ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]


def run(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """In a shell whose PATH begins with the environment of these tests."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        command,
        shell=True,
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": path, "MPLBACKEND": "agg"},
    )


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which `gough-stewart build` was called, as the pages tell their readers to."""
    folder = tmp_path_factory.mktemp("built")
    done = run("gough-stewart build", folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_two_commands_come_first() -> None:
    assert COMMANDS[:2] == ["make demo", "make test"]


@pytest.mark.skipif(not (ROOT / ".venv" / "run").exists(), reason="not set up by make")
def test_make_demo_runs(tmp_path: Path) -> None:
    done = run(f"make -C {ROOT} demo OUT={tmp_path / 'paper'} HEAVE={tmp_path / 'heave'}", ROOT)
    assert done.returncode == 0, done.stderr
    assert "Agreement of the formulations" in done.stdout
    assert (tmp_path / "paper" / "report.md").exists()
    assert "Step response" in done.stdout
    assert (tmp_path / "heave" / "pose.png").exists()


def test_make_test_is_a_target() -> None:
    """`make test` is what runs this file, so it is not run again from here."""
    assert run("make -n test", ROOT).returncode == 0


def test_the_commands_run_in_order(tmp_path: Path) -> None:
    for command in COMMANDS[2:]:
        done = run(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "results" / "mine" / "figure-4.png").exists()


def number_and_title(snippet: str) -> str:
    return next((line for line in snippet.splitlines() if "=" in line), snippet.splitlines()[0])


@pytest.mark.parametrize("snippet", [*SNIPPETS, *FMU_SNIPPETS, *CONTROL_SNIPPETS], ids=number_and_title)
def test_the_snippets_run(snippet: str, built: Path) -> None:
    (built / "snippet.py").write_text(snippet)
    done = run(f"{sys.executable} snippet.py", built)
    assert done.returncode == 0, done.stderr


def test_the_commands_of_the_control_page_run_in_order(tmp_path: Path) -> None:
    (block,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/control.md").read_text(), re.S)
    for command in block.splitlines():
        done = run(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "results" / "mine" / "pose.png").exists()


def test_the_control_page_names_every_key_of_an_experiment() -> None:
    """Expected: the schema's own fields, each in backticks on the page."""
    page = (ROOT / "docs/control.md").read_text()
    modules = (experiment, controller_choice, reference_choice)
    sections = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    models = [each for each in sections if issubclass(each, Section) and each is not Section]
    keys = {key for model in models for key in model.model_fields} - {"platform", "reference", "controller", "start"}
    assert [key for key in sorted(keys) if not re.search(rf"[`\[.]{key}[`\].]", page)] == []


def test_the_commands_of_the_fmu_page_are_options_of_the_command() -> None:
    """The build for all targets takes minutes on a cold cache; its options are checked, not run."""
    commands = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/fmu.md").read_text(), re.S)
    options = {word for command in commands for word in command.split() if word.startswith("--")}
    assert options
    assert [o for o in options if o not in run("gough-stewart build --help", ROOT).stdout] == []


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_the_examples_run(example: Path, built: Path) -> None:
    done = run(f"{sys.executable} {example}", built)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_the_example_holds_its_legs_under_the_new_payload(built: Path) -> None:
    """Expected: 0.1 m more leg lifts by 0.1 · 3.246/3 = 0.108 m; 5 kg are 5 · 9.81/6 · 3.353/3.109 N a leg more."""
    lines = run(f"{sys.executable} {ROOT / 'examples/fmu_in_fmpy.py'}", built).stdout.splitlines()
    height, force = (np.array([float(re.findall(p, line)[0]) for line in lines]) for p in (r"z = (\S+)", r"F = (\S+)"))
    assert abs(height[-1] - 3.108) < 2e-3
    assert force[-1] - force[2] == pytest.approx(5 * 9.81 / 6 * 3.353 / 3.109, rel=0.03)


def test_an_example_without_its_fmu_says_how_to_make_it(tmp_path: Path) -> None:
    done = run(f"{sys.executable} {ROOT / 'examples/fmu_in_fmpy.py'}", tmp_path)
    assert done.returncode != 0
    assert "gough-stewart build" in done.stderr


def test_the_stepping_snippet_does_what_its_comment_says(tmp_path: Path) -> None:
    """Expected: δz = δL · L/z for equal legs, 0.05 · 3.2459/3 = 0.0541 m."""
    (tmp_path / "snippet.py").write_text(STEPPING + "\nassert abs(plant.get('position[3]') - 3.0541) < 2e-3\n")
    assert run(f"{sys.executable} snippet.py", tmp_path).returncode == 0


def test_the_lqr_snippet_stabilises_an_unstable_platform(tmp_path: Path) -> None:
    done_line = "\nassert np.abs(plant.state - start).max() < 1e-3\nassert np.linalg.eigvals(A).real.max() > 0\n"
    (tmp_path / "snippet.py").write_text(LQR + done_line)
    done = run(f"{sys.executable} snippet.py", tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout


@pytest.mark.parametrize("page", PAGES)
def test_links_of_a_page_lead_somewhere(page: str) -> None:
    file = ROOT / page
    for target in re.findall(r"\]\(([^)#]+)\)", file.read_text()):
        if "://" not in target:
            assert (file.parent / target).exists(), target


def test_the_pages_mention_every_equation_of_the_paper() -> None:
    """Expected: (1) to (31), each in the first column of the table of docs/equations.md, with code that exists."""
    rows = re.findall(r"^\| (\(\d.*?) \| .*? \| (.*?) \|$", (ROOT / "docs/equations.md").read_text(), re.M)
    cited = {int(n) for numbers, _ in rows for n in re.findall(r"\((\d+)[ab]?\)", numbers)}
    assert cited == set(range(1, 32))
    code = "".join((ROOT / f"model/{name}.py").read_text() for name in ("kane", "vectors", "rotations"))
    names = {name.split(".")[-1] for _, where in rows for name in re.findall(r"`([\w.]+)`", where)}
    assert [name for name in names if f"def {name}(" not in code] == []


@pytest.mark.parametrize("name", ["platform", "loop", "heave"])
def test_a_picture_is_what_its_script_draws(name: str, tmp_path: Path) -> None:
    """Expected: the committed bytes' shapes; matplotlib versions may differ in digits, so elements are counted."""
    script = "draw.py" if name == "platform" else f"draw_{name}.py"
    (tmp_path / "draw.py").write_text((ROOT / "docs/figures" / script).read_text())
    assert run(f"{sys.executable} draw.py", tmp_path).returncode == 0
    drawn, kept = ((p / f"{name}.svg").read_text().count("<path") for p in (tmp_path, ROOT / "docs/figures"))
    assert drawn == pytest.approx(kept, rel=0.2)

"""README: the examples run, pictures are as drawn, links lead somewhere; tests/docs/test_pages.py runs its blocks."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

import gough_stewart as gs
from tests.support.demo import Demo
from tests.support.fmu_plants import Fmu
from tests.support.snippets import PAGES, commands_of, run_command
from tools.pages.blocks import ROOT
from tools.pages.story import FailedCommandError


def test_the_picture_of_the_house_is_that_of_the_contracts() -> None:
    """Expected: the layers that import-linter checks, each on a line of its own, from the highest to the lowest."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = {each["containers"][0]: each["layers"] for each in settings["contracts"] if each["type"] == "layers"}
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (picture,) = re.findall(r"^```text\n(gough_stewart .*?)^```$", page, re.MULTILINE | re.DOTALL)
    drawn = re.findall(r"^(  [├└]─ )?(\w+(?: \| \w+)*)(?:  .*)?$", picture, re.MULTILINE)
    assert [names for room, names in drawn if room] == layers["gough_stewart.harness"]
    assert [names for room, names in drawn if not room] == ["gough_stewart", *layers["gough_stewart"][1:]]
    assert len(drawn) + picture.count("\n  │\n") == len(picture.splitlines())


def test_the_two_commands_come_first_and_the_demo_runs(demo: Demo) -> None:
    assert commands_of("README.md")[:2] == ["make demo", "make test"]
    assert "Agreement of the formulations" in demo.text
    assert (demo.paper / "comparison.json").exists()
    assert "Step response" in demo.text
    assert (demo.heave / "report.html").exists()


def test_the_pages_name_every_key_of_an_experiment() -> None:
    """Expected: the schema's own fields, each in backticks on the page."""
    names = ("control", "experiment-file", "motion", "ensembles")
    page = "".join((ROOT / f"docs/{name}.md").read_text() for name in names)
    keys = keys_of(gs.Experiment) - {"platform", "reference", "controller", "start"}
    assert {"position_amplitude", "proportional_gain", "leg_lengths", "lines_at_most"} <= keys
    assert [key for key in sorted(keys) if not re.search(rf"[`\[.]{key}[`\].]", page)] == []


def keys_of(table: type[BaseModel]) -> set[str]:
    """The keys of a table, of the tables in it, and of all their kinds."""
    tables: set[type[BaseModel]] = set()
    waiting: list[Any] = [table]
    while waiting:
        annotation = waiting.pop()
        waiting += get_args(annotation)
        if isinstance(annotation, type) and issubclass(annotation, BaseModel) and annotation not in tables:
            tables.add(annotation)
            waiting += annotation.__subclasses__()
            waiting += [field.annotation for field in annotation.model_fields.values()]
    return {key for found in tables for key in found.model_fields}


# Examples that take longer are evidence.
QUICK = ("fmu_in_fmpy.py", "lqr.py", "pole_placement.py")
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize(
    "example",
    [pytest.param(p, marks=[] if p.name in QUICK else pytest.mark.evidence) for p in EXAMPLES],
    ids=[p.name for p in EXAMPLES],
)
def test_the_examples_run(example: Path, fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: exit code 0 in a folder as `gough-stewart build` leaves it; of some, what their output says."""
    for fmu in fmus.values():
        shutil.copy(fmu.path, tmp_path)
    printed = run_command(f"python {example}", tmp_path)
    assert printed
    says = {"fmu_in_fmpy.py": lifts_and_carries, "two_platforms.py": each_moves_alone}
    says.get(example.name, lambda _: None)(printed.splitlines())


def lifts_and_carries(lines: list[str]) -> None:
    """Expected: 0.1 m more leg lifts by 0.1 · 3.246/3 = 0.108 m; 5 kg are 5 · 9.81/6 · 3.353/3.109 N a leg more."""
    height, force = (np.array([float(re.findall(p, line)[0]) for line in lines]) for p in (r"z = (\S+)", r"F = (\S+)"))
    assert abs(height[-1] - 3.108) < 2e-3
    assert force[-1] - force[2] == pytest.approx(5 * 9.81 / 6 * 3.353 / 3.109, rel=0.03)


def each_moves_alone(lines: list[str]) -> None:
    """Expected: the harness, to 1e-9 m; steps at different times, so that mixed-up connections would show."""
    moved, differs = ([float(re.findall(p, line)[0]) for line in lines] for p in (r"by (\S+) mm", r"at most (\S+) m"))
    assert moved[0] > moved[1] > 10
    assert max(differs) <= 1e-9


def test_an_example_without_its_fmu_says_how_to_make_it(tmp_path: Path) -> None:
    with pytest.raises(FailedCommandError, match="gough-stewart build"):
        run_command(f"python {ROOT / 'examples/fmu_in_fmpy.py'}", tmp_path)


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
    code = "".join((ROOT / f"model/{name}.py").read_text() for name in ("formulations/kane", "vectors", "rotations"))
    names = {name.split(".")[-1] for _, where in rows for name in re.findall(r"`([\w.]+)`", where)}
    assert [name for name in names if f"def {name}(" not in code] == []


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["platform", "loop", "heave", "architecture", "paper", "workspace", "recorded"])
def test_a_picture_is_what_its_script_draws(name: str, tmp_path: Path) -> None:
    """Expected: the committed bytes' shapes; matplotlib versions may differ in digits, so elements are counted."""
    for script in (ROOT / "docs/figures").glob("*.py"):
        shutil.copy(script, tmp_path)
    script = tmp_path / ("draw.py" if name == "platform" else f"draw_{name}.py")
    subprocess.run([sys.executable, str(script)], cwd=tmp_path, check=True)
    drawn, kept = ((p / f"{name}.svg").read_text().count("<path") for p in (tmp_path, ROOT / "docs/figures"))
    assert drawn == pytest.approx(kept, rel=0.2)

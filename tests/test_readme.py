"""Every command and snippet of the README runs; every file that the pages name is there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
COMMANDS = [
    line.split("#")[0].strip() for block in re.findall(r"```sh\n(.*?)```", README, re.S) for line in block.splitlines()
]
SNIPPETS = re.findall(r"```python\n(.*?)```", README, re.S)
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


def test_the_two_commands_come_first() -> None:
    assert COMMANDS[:2] == ["make demo", "make test"]


@pytest.mark.skipif(not (ROOT / ".venv" / "run").exists(), reason="not set up by make")
def test_make_demo_runs(tmp_path: Path) -> None:
    done = run(f"make -C {ROOT} demo OUT={tmp_path}", ROOT)
    assert done.returncode == 0, done.stderr
    assert "Agreement of the formulations" in done.stdout
    assert (tmp_path / "report.md").exists()


def test_make_test_is_a_target() -> None:
    """`make test` is what runs this file, so it is not run again from here."""
    assert run("make -n test", ROOT).returncode == 0


def test_the_commands_run_in_order(tmp_path: Path) -> None:
    for command in COMMANDS[2:]:
        done = run(command, tmp_path)
        assert done.returncode == 0, f"{command}: {done.stderr}"
    assert (tmp_path / "results" / "mine" / "figure-4.png").exists()


@pytest.mark.parametrize("snippet", SNIPPETS, ids=lambda s: s.splitlines()[0])
def test_the_snippets_run(snippet: str, tmp_path: Path) -> None:
    (tmp_path / "snippet.py").write_text(snippet)
    done = run(f"{sys.executable} snippet.py", tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_stepping_snippet_does_what_its_comment_says(tmp_path: Path) -> None:
    """Expected: δz = δL · L/z for equal legs, 0.05 · 3.2459/3 = 0.0541 m."""
    (tmp_path / "snippet.py").write_text(SNIPPETS[0] + "\nassert abs(plant.get('position[3]') - 3.0541) < 2e-3\n")
    assert run(f"{sys.executable} snippet.py", tmp_path).returncode == 0


def test_the_lqr_snippet_stabilises_an_unstable_platform(tmp_path: Path) -> None:
    done_line = "\nassert np.abs(plant.state - start).max() < 1e-3\nassert np.linalg.eigvals(A).real.max() > 0\n"
    (tmp_path / "snippet.py").write_text(SNIPPETS[1] + done_line)
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


def test_the_picture_is_what_its_script_draws(tmp_path: Path) -> None:
    """Expected: the committed bytes' shapes; matplotlib versions may differ in digits, so elements are counted."""
    script = (ROOT / "docs/figures/draw.py").read_text()
    (tmp_path / "draw.py").write_text(script)
    assert run(f"{sys.executable} draw.py", tmp_path).returncode == 0
    drawn, kept = ((p / "platform.svg").read_text().count("<path") for p in (tmp_path, ROOT / "docs/figures"))
    assert drawn == pytest.approx(kept, rel=0.2)

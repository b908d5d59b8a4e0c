"""Every code block of README, CONTRIBUTING and docs/ runs, or is checked otherwise if it is slow or needs other tools.

README's in `make test`, those of the other pages in `make evidence`: in order in one folder (`tools/pages/story.py`).
Not what `make demo` or another test runs; of `make`, `pytest`, `pip install` and slow builds what they name is there.
"""

import json
import re
import shlex
import shutil
import subprocess
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

import gough_stewart as gs
from gough_stewart.fmu_build.sources import standard_headers
from tests.support.c_hosts import ZIG
from tests.support.commands import invoke
from tests.support.demo import Demo
from tests.support.fmu_plants import Fmu
from tests.support.foreign_controller import foreign_controller
from tests.support.snippets import BLOCKS, PAGES, SET_UP_BY_MAKE, commands_of, run_command
from tools.pages.blocks import ROOT, Block, commands_in, text_of
from tools.pages.story import run_in_shell, run_page
from tools.pages.tables import PAGE, page_with_tables

EVERY = [command for page in PAGES for command in commands_of(page)]
# What `make demo` runs, with its folder.
BY_DEMO = re.compile(
    r"gough-stewart (reproduce|run heave_step --plant fmu3)(?: --report)?(?: --figures)?(?: --out \S+)?$"
)
# Others that run elsewhere: the platform of one's own in tests/harness/cli/test_commands.py, whose name is harder
# there; the build by the README, all other pages find the FMUs in their folder.
ONES_OWN = re.compile(r"gough-stewart reproduce --platform mine\.toml --out \S+$")
BUILD = "gough-stewart build"
# The tutorial exports in all forms, and runs what it has exported.
EXPORT = "gough-stewart export heave_step --as c,fmu,ssp --out exported"
# Pages that run, but for the tutorial, which tests/docs/test_tutorial.py runs.
RUNNING = sorted({b.page for b in BLOCKS if b.language in {"sh", "python"}} - {"docs/tutorial.md", "CONTRIBUTING.md"})


# What somebody comes for: the page that says how, the beginnings of its blocks, and the file that is wanted.
TASKS = (
    ("docs/motion.md", r"gough-stewart (check pitch_sine|run pitch_sine)", "results/check/needs.csv"),
    ("docs/ensembles.md", r"gough-stewart (ensemble|tune) heave_tolerances", "results/tuned/tuned.toml"),
    ("docs/control.md", r".*(pid\.toml|results/pid|pid\.o)", "pid.o"),
    (
        "docs/export.md",
        r"gough-stewart export heave_step --as c,ssp|import gough_stewart as gs\nfrom fmpy",
        "exported/heave_step.ssp",
    ),
)
# A file that a page's commands are for.
LEFT_BY = {
    "README.md": "report.html",
    "docs/control.md": "results/mine/pose.png",
    "docs/ensembles.md": "results/tuned/tuned.toml",
    "docs/export.md": "heave_step.o",
    "docs/identify.md": "results/identified/estimate.json",
    "docs/live.md": "pages/pitch_sine_live.html",
    "docs/motion.md": "results/fitted/record.csv",
    "docs/robot-simulators.md": "simulators/motion_base.xml",
    "docs/view.md": "compared.html",
    "docs/workspace.md": "results/volume/report.html",
}
# What a page says of its snippet, by a word that no other has.
CLAIMS = {
    # "joints of 0.031 mm are needed", and then 0.100 mm
    "def error_at_rest(spread)": "assert abs(needed - 0.031) < 5e-4 and abs(confirmed - 0.1) < 5e-4",
    # "it stands" for 1 s
    "mujoco.mj_step(model, data, 1000)": "assert abs(data.sensordata[:3] - [0, 0, 2]).max() < 1e-6",
    # "it rises" from 3 m
    "[29.924] * 6": "assert result['position'][-1][2] > 3.01",
}
# Languages of Simulink, OpenModelica and Dymola, which are not here. Their names of files and variables are checked.
NOT_RUN = ("matlab", "modelica")
AROUND_C = """\
#include "fmi3Functions.h"
void host(fmi3String token, fmi3ValueReference actuator_force, fmi3ValueReference leg_length, fmi3Float64 *force,
          fmi3Float64 *length) {{
{}}}
"""


def of_language(*languages: str) -> list[Block]:
    return [block for block in BLOCKS if block.language in languages]


def test_every_language_is_dealt_with_and_what_pages_say_is_checked_once() -> None:
    known = {"python", "sh", "c", "toml", "json", "text", *NOT_RUN}
    assert [b.place for b in BLOCKS if b.language not in known] == []
    assert {word: sum(word in b.text for b in of_language("python")) for word in CLAIMS} == dict.fromkeys(CLAIMS, 1)


@pytest.mark.parametrize(
    "page", ["README.md", *(pytest.param(p, marks=pytest.mark.evidence) for p in RUNNING if p != "README.md")]
)
def test_the_blocks_of_a_page_run_in_order(page: str, fmus: dict[str, Fmu], demo: Demo, tmp_path: Path) -> None:
    """Expected: exit code 0; of snippets what the page says; of commands the file that they are for."""
    for fmu in fmus.values() if page != "README.md" else ():
        shutil.copy(fmu.path, tmp_path)
    (tmp_path / "results").mkdir()
    # a copy, since commands of the page write there, too
    shutil.copytree(demo.heave, tmp_path / "results/run_heave_step")

    def left_out(command: str) -> bool:
        if "libcosimpy" in command:
            return find_spec("libcosimpy") is None  # it has no wheel for some machines
        if "import mujoco" in command:
            return find_spec("mujoco") is None  # of the extra `evidence`
        if command in {BUILD, EXPORT}:
            return page != "README.md"
        return bool(BY_DEMO.match(command) or ONES_OWN.match(command))

    def check_of(block: Block) -> str:
        return "".join(f"\n{line}\n" for word, line in CLAIMS.items() if word in block.text)

    run_page(page, tmp_path, run_command, left_out=left_out, after=check_of)
    assert (tmp_path / LEFT_BY.get(page, ".")).exists()
    if page == "docs/control.md":  # the gain that its search found leaves in the C that is traced from its class
        tuned = tomllib.loads((tmp_path / "results/pid/tuned.toml").read_text(encoding="utf-8"))["controller"]
        code = (tmp_path / "own/tuned_controller.c").read_text(encoding="utf-8")
        assert f"(real){tuned['parameters']['kp']:g}" in code


@pytest.mark.evidence
@pytest.mark.parametrize(("page", "blocks", "file"), TASKS)
def test_a_task_is_done_in_an_empty_folder_by_four_commands_at_most(
    page: str, blocks: str, file: str, tmp_path: Path
) -> None:
    """Expected: the page's blocks, as they stand, leave the file that the task is for."""
    printed = run_page(page, tmp_path, run_command, left_out=lambda text: not re.match(blocks, text))
    commands = [c for block in printed for c in commands_in(block) if re.match(blocks, c)]
    assert 1 <= len(commands) <= 4
    assert (tmp_path / file).stat().st_size > 0


def test_the_targets_of_make_and_the_options_of_the_long_build_are_there() -> None:
    """`make` is not run from here: its targets take minutes, and one of them runs this file."""
    table = re.findall(r"^\| `make ([\w-]+)` \|", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE)
    targets = {c.split()[1] for c in EVERY if c.startswith("make ")} | set(table)
    assert {"demo", "test", "docs", "evidence", "bench"} <= targets
    done = run_in_shell(f"make -n {' '.join(sorted(targets))}", ROOT)
    assert done.returncode == 0, done.stderr
    recipe = (line.removeprefix(".venv/bin/") for line in run_in_shell("make -n demo", ROOT).stdout.splitlines())
    assert len({found[1] for line in recipe if (found := BY_DEMO.match(line))}) == 2
    # the build for all targets takes minutes on a cold cache
    options = {word for c in EVERY if "--target all" in c for word in c.split() if word.startswith("--")}
    assert options >= {"--target", "--fmi"}
    said = invoke("build", "--help").stdout
    assert [o for o in options if o not in said] == []


def test_the_tests_that_the_pages_name_are_there() -> None:
    named = {name for page in PAGES for name in re.findall(r"`(tests/[\w/.]+)`", text_of(page))}
    assert len(named) > 10
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_table_has_a_head(page: str) -> None:
    """Expected: below the first row of each group of rows, the line that makes it a head; a blank line ends a table."""
    lines = ["", *(ROOT / page).read_text(encoding="utf-8").splitlines(), ""]
    firsts = [k for k in range(1, len(lines) - 1) if lines[k].startswith("|") and not lines[k - 1].startswith("|")]
    assert [lines[k] for k in firsts if not lines[k + 1].startswith("| ---")] == []


@pytest.mark.parametrize("block", of_language("json"), ids=lambda b: b.place)
def test_reports_as_data_can_be_read(block: Block) -> None:
    """Expected: a report of today's version, whose first number is the one of its verdict."""
    report = json.loads(block.text)
    number = report["verdict"]["numbers"][0]
    factor = report["quantities"].get(number.get("quantity"), {}).get("factor", 1.0)
    assert (report["version"], f"{factor * number['value']:.3g}" in report["verdict"]["text"]) == (1, True)


# A fastest path is planned for seconds.
FILES = [
    pytest.param(b, id=b.place, marks=pytest.mark.evidence if 'timing = "fastest"' in b.text else ())
    for b in of_language("toml")
    if not b.title
]


@pytest.mark.parametrize("block", FILES)
def test_experiment_files_run(block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: that it completes; a tenth of a second shows whether its keys are right."""
    monkeypatch.chdir(tmp_path)
    if "theirs.fmu" in block.text:
        foreign_controller(tmp_path / "theirs.fmu")
    (tmp_path / "mine.toml").write_text(block.text, encoding="utf-8")
    assert gs.run("mine.toml", {"loop.duration": 0.1}).metadata["outcome"]["status"] == "completed"


@pytest.mark.parametrize("block", of_language("c"), ids=lambda b: b.place)
def test_c_compiles_with_the_standards_headers(block: Block, tmp_path: Path) -> None:
    """Expected: no error and no warning, in a function of the text's values, or whole, beside the exported C."""
    if block.text.startswith("#include"):
        gs.export("heave_step", forms="c", out=tmp_path)
        (tmp_path / "host.c").write_text(block.text)
    else:
        for name, text in standard_headers("3.0").items():
            (tmp_path / name).write_text(text)
        (tmp_path / "host.c").write_text(AROUND_C.format(block.text))
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-c", "host.c", "-o", "host.o"]
    done = subprocess.run([*ZIG, *flags], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("block", of_language(*NOT_RUN), ids=lambda b: b.place)
def test_blocks_for_tools_that_are_not_here_name_what_there_is(block: Block) -> None:
    """Expected: the files that the build writes, the variables of the interface."""
    files = re.findall(r"[\w.]+\.fmu\b", block.text)
    assert set(files) <= {"gough_stewart_fmi2.fmu", "gough_stewart_fmi3.fmu"}
    assert files or block.language != "modelica"
    variables = re.findall(r"platform\.(\w+)", block.text)
    assert set(variables) <= {variable.name for variable in gs.VARIABLES}


@pytest.mark.skipif(not SET_UP_BY_MAKE, reason="not set up by make")
def test_what_the_pages_install_are_extras_of_this_package() -> None:
    """Expected: the extras of pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {""} | {f"[{name}]" for name in project["optional-dependencies"]}
    words = [word for c in EVERY if c.startswith("pip install ") for word in shlex.split(c)[2:]]
    assert words
    assert {word.partition(project["name"])[2] for word in words} <= extras


def test_the_table_of_metrics_is_what_the_metrics_declare() -> None:
    """Expected: the page as `python -m tools.pages` writes it; a metric of a run that is read back is in its table."""
    text = text_of(PAGE)
    assert text == page_with_tables(text)
    found = gs.metrics(gs.run("heave_step", {"loop.duration": 0.3, "reference.at": 0.02}))
    for section, numbers in (("tracking.position", found["tracking"]["position"]), ("force", found["force"])):
        assert all(f"| `{section}.{name}` |" in text for name in numbers if not isinstance(numbers[name], list))

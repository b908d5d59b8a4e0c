"""The command line as a user meets it: files, tables, and one clear line for what goes wrong."""

import json
import os
import re
import subprocess
import sys
from html import unescape
from io import BytesIO
from pathlib import Path

import polars
import pytest
from PIL import Image

from gough_stewart.harness.paper.report import to_markdown
from gough_stewart.harness.paper.reproduce import Reproduction
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.platform import preset_names, preset_text
from tests.support.commands import invoke
from tests.support.demo import Demo
from tests.support.interpreter import Interpreter

FILES = {
    "open_loop.csv",
    "figure-4.png",
    "figure-5.png",
    "figure-6.png",
    "figure-7.png",
    "drift.png",
    "report.md",
    "report.json",
    "comparison.json",
    "gough_stewart_fmi2.fmu",
    "gough_stewart_fmi3.fmu",
}


def test_reproduce_writes_its_files_and_the_page_and_no_others(demo: Demo) -> None:
    assert {p.name for p in demo.paper.iterdir()} == FILES | {"report.html"}


def test_reproduce_prints_the_tables(demo: Demo) -> None:
    text = demo.text
    for title in (
        "Open-loop case of Liu",
        "Agreement of the formulations",
        "Drift of Kane's DAE",
        "What the scan leaves",
    ):
        assert title in text
    assert "MISSED" not in text


def test_table_has_101_rows_and_the_promised_columns(demo: Demo) -> None:
    table = polars.read_csv(demo.paper / "open_loop.csv")
    assert table.columns == ["time", *interface.RESULT_COLUMNS]
    assert table.height == 101
    assert table["time"][100] == 1.0
    assert table["position[3]"][0] == 3.0


@pytest.mark.parametrize("name", sorted(f for f in FILES if f.endswith("png")))
def test_figures_are_pictures_with_something_on_them(demo: Demo, name: str) -> None:
    with Image.open(BytesIO((demo.paper / name).read_bytes())) as picture:
        assert picture.width >= 800
        assert picture.height >= 500
        colours = picture.convert("RGB").getcolors(maxcolors=1 << 24)
    assert colours is not None
    assert len(colours) > 50


def test_report_data_and_page_say_the_same(demo: Demo) -> None:
    out = demo.paper
    report = json.loads((out / "comparison.json").read_text())
    page = (out / "report.md").read_text()
    assert all(row["holds"] for row in report["agreement"])
    assert {"python", "numpy", "scipy", "casadi", "gough-stewart"} <= report["versions"].keys()
    for row in report["agreement"]:
        assert row["what"] in page
        assert f"{row['measured']:.2e}" in page
    for reading in report["readings"]:
        assert reading["other"] in page
    assert "far from equilibrium" in page


def test_two_runs_write_the_same_bytes(demo: Demo, interpreter: Interpreter, tmp_path: Path) -> None:
    """Expected: the files of the demonstration, but for the page, and charts as data, which were not asked for."""
    assert interpreter.command("reproduce", "--out", "new/folder", cwd=tmp_path).returncode == 0
    out = tmp_path / "new" / "folder"
    assert {p.name for p in out.iterdir()} == FILES
    for name in set(FILES) - {"report.json"}:
        assert (out / name).read_bytes() == (demo.paper / name).read_bytes(), name


def test_reproduce_takes_a_platform_of_ones_own_whose_name_is_only_a_name(
    interpreter: Interpreter, tmp_path: Path
) -> None:
    """Expected: title, platform and every comparison of the report, on the page as in the data.

    Names are texts to the terminal, to Markdown, to the figures and to the page, in any script.
    """
    name = "a [red]b[/nope] $\\frac{c$ <b> 台"
    mine = preset_text("motion_base").replace('name = "motion_base"', f"name = '{name}'")
    (tmp_path / "mine.toml").write_text(mine)
    wide = {"COLUMNS": "200", "NO_COLOR": "1"}
    done = interpreter.command(
        "reproduce", "--platform", "mine.toml", "--report", "--out", "out", cwd=tmp_path, env=wide
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.strip() == ""
    assert "[red]b[/nope]" in done.stdout
    assert "scan" not in done.stdout
    out = tmp_path / "out"
    report = json.loads((out / "comparison.json").read_text())
    assert report["case"]["platform"] == name
    assert report["readings"] == []
    assert [row for row in report["agreement"] if not row["holds"]] == []
    # CommonMark: a backslash makes any punctuation a plain character
    assert "a \\[red\\]b\\[/nope\\] \\$\\\\frac\\{c\\$ \\<b\\> 台" in (out / "report.md").read_text()
    html = (out / "report.html").read_text()
    assert "<b> 台" not in html
    page = unescape(re.sub(r'<span class="term"[^>]*>([^<]*)</span>', r"\1", html))
    title = report["case"]["title"]
    assert f"<title>{title[0].upper()}{title[1:]}</title>" in page
    assert [row["what"] for row in report["agreement"] if row["what"] not in page] == []


def test_presets_are_listed_and_printed() -> None:
    listed = invoke("presets").stdout
    assert all(name in listed for name in preset_names())
    assert invoke("presets", "liu2000").stdout == preset_text("liu2000")


@pytest.mark.parametrize("arguments", [["--help"], ["reproduce", "--help"], ["presets", "-h"], []])
def test_help_teaches(arguments: list[str]) -> None:
    assert "Usage" in invoke(*arguments).output


def test_help_of_reproduce_shows_examples_and_choices() -> None:
    text = invoke("reproduce", "--help").stdout
    assert "plus-first|minus-first" in text
    assert "gough-stewart reproduce --order minus-first" in text


def test_the_command_is_installed_and_says_its_version() -> None:
    command = [str(Path(sys.executable).with_name("gough-stewart")), "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.startswith("gough-stewart 0.")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["reproduce", "--platform", "none.toml"], "none.toml: cannot read this platform file: No such file"),
        (["reproduce", "--platform", "heavy.toml"], "platform_mass: is -10 kg; expected > 0"),
        (["reproduce", "--platform", "typo.toml"], "did you mean 'platform_mass'?"),
        (["reproduce", "--platform", "broken.toml"], "is not TOML"),
        (["reproduce", "--preset", "liu"], "did you mean 'liu2000'?"),
        (["reproduce", "--out", "heavy.toml"], "heavy.toml is a file; expected a folder"),
        (["reproduce", "--out", "heavy.toml/below"], "heavy.toml is a file; expected a folder"),
        (["presets", "liu"], "did you mean 'liu2000'?"),
        (["reproduce", "--preset", ""], "preset '': no such preset"),
        (["reproduce", "--out", "taken"], "report.md is a folder there"),
        (["reproduce", "--platform", "huge.toml"], "platform_mass"),
    ],
)
def test_wrong_input_gets_one_clear_line(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = preset_text("liu2000")
    (tmp_path / "heavy.toml").write_text(text.replace("platform_mass = 10.0", "platform_mass = -10.0"))
    (tmp_path / "typo.toml").write_text(text.replace("platform_mass", "platfom_mass"))
    (tmp_path / "broken.toml").write_text("= 3")
    (tmp_path / "huge.toml").write_text(text.replace("platform_mass = 10.0", "platform_mass = " + "9" * 400))
    (tmp_path / "taken" / "report.md").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    done = invoke(*arguments)
    assert done.exit_code == (2 if "preset" in message or "liu2000" in message else 1)
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["reproduce", "--preset", "liu2000", "--platform", "heavy.toml"], "exclude each other"),
        (["reproduce", "--preset", "motion_base", "--order", "plus-first"], "--order applies only to the paper's own"),
        (["run", "heave_step", "--set", "x"], "--set x: expected key=value"),
        (["run", "heave_step", "--set", "title.x=1"], "title is not a table of the experiment"),
        (["view", "record", "--out", "page"], "expected the name of a page"),
        (["workspace", "--at", "z"], "--at z: found no value"),
        (["run", "heave_step", "--out", ""], "Invalid value for '--out': is empty"),
        (["build", "--out", ""], "Invalid value for '--out': is empty"),
        (["run", "heave_step", "--fmu", ""], "Invalid value for '--fmu': is empty"),
    ],
)
def test_wrong_use_of_a_command_exits_with_2(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke(*arguments)
    assert done.exit_code == 2
    assert message in done.output
    assert list(tmp_path.iterdir()) == []


def test_a_terminal_without_unicode_gets_no_traceback(tmp_path: Path) -> None:
    env = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "TERM": "dumb"}
    command = [str(Path(sys.executable).with_name("gough-stewart")), "reproduce", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False, cwd=tmp_path)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


def test_an_unknown_choice_is_a_usage_error() -> None:
    done = invoke("reproduce", "--order", "sideways")
    assert done.exit_code == 2
    assert "plus-first" in done.stderr


def test_a_plant_that_cannot_pass_says_so_and_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: with the start turned by −0.1 − 1.5 rad the mechanism stands beside its singular pose."""
    (tmp_path / "turned.toml").write_text(
        preset_text("liu2000").replace("home_orientation = [0.0, 0.0, 0.0]", "home_orientation = [0.0, 0.0, -1.5]")
    )
    monkeypatch.chdir(tmp_path)
    done = invoke("reproduce", "--platform", "turned.toml", "--out", "out")
    assert done.exit_code == 1
    assert "singular pose" in done.stderr
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_with_one_line_and_no_files(interpreter: Interpreter, tmp_path: Path) -> None:
    """Expected: exit code 130; the signal comes when Kane's equations begin, however fast the machine is."""
    code = [
        "import os, signal",
        "from gough_stewart.harness.cli.app import main",
        "from gough_stewart.harness.paper import reproduce",
        "run_kane = reproduce.run_kane",
        "def interrupted(*arguments, **options):",
        "    os.kill(os.getpid(), signal.SIGINT)",
        "    return run_kane(*arguments, **options)",
        "reproduce.run_kane = interrupted",
        "main()",
    ]
    (tmp_path / "interrupted.py").write_text("\n".join(code))
    done = interpreter.script(tmp_path / "interrupted.py", "reproduce", "--out", "out", cwd=tmp_path)
    assert done.returncode == 130
    assert "interrupted; nothing written" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_missed_bound_of_the_other_order_exits_with_3_after_writing(
    demo: Demo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the demonstration's files, with a report in which one comparison was made to miss its bound."""
    report = json.loads((demo.paper / "comparison.json").read_text())
    report["agreement"][2]["holds"] = False
    files = {name: (demo.paper / name).read_bytes() for name in FILES} | {"report.md": to_markdown(report)}
    asked: list[OpenLoopCase] = []

    def reproduced(case: OpenLoopCase, *_: object) -> Reproduction:
        asked.append(case)
        return Reproduction(report, files)

    monkeypatch.setattr("gough_stewart.harness.paper.reproduce.reproduce", reproduced)
    done = invoke("reproduce", "--order", "minus-first", "--out", str(tmp_path))
    assert done.exit_code == 3
    assert "a comparison misses its bound" in done.output
    assert {p.name for p in tmp_path.iterdir()} == FILES
    assert (tmp_path / "report.md").read_text().count("MISSED") == 1
    assert done.output.count("MISSED") == 1
    assert "− before +" in asked[0].title


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    done = invoke("reproduce", "--out", str(tmp_path / "out"))
    assert done.exit_code == 1
    assert "no permission to write" in done.output


def test_a_full_disk_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(tmp_path / "open_loop.csv"))

    ready = Reproduction({"agreement": []}, {"open_loop.csv": b"time\n"})
    monkeypatch.setattr("gough_stewart.harness.paper.reproduce.reproduce", lambda *_, **__: ready)
    monkeypatch.setattr("gough_stewart.model.process.files.write_whole", full)
    done = invoke("reproduce", "--out", str(tmp_path))
    assert done.exit_code == 1
    assert "No space left on device" in done.output
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []

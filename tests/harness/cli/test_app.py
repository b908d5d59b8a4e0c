"""The command line as a user meets it: files, tables, and one clear line for what goes wrong."""

import json
import os
import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

from gough_stewart.harness.paper.reproduce import Reproduction
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
    "report.json",
    "comparison.json",
    "gough_stewart_fmi2.fmu",
    "gough_stewart_fmi3.fmu",
}


def test_reproduce_writes_its_files_and_the_page_and_no_others(demo: Demo) -> None:
    assert {p.name for p in demo.paper.iterdir()} == FILES | {"report.html"}


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

    Names are texts to the terminal, to the figures and to the page, in any script.
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


def test_the_command_is_installed_and_says_its_version() -> None:
    command = [str(Path(sys.executable).with_name("gough-stewart")), "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.startswith("gough-stewart 0.")


def test_a_terminal_without_unicode_gets_no_traceback(tmp_path: Path) -> None:
    env = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "TERM": "dumb"}
    command = [str(Path(sys.executable).with_name("gough-stewart")), "reproduce", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False, cwd=tmp_path)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


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
    files = {name: (demo.paper / name).read_bytes() for name in FILES - {"report.json"}}
    asked: list[OpenLoopCase] = []

    def reproduced(case: OpenLoopCase, *_: object) -> Reproduction:
        asked.append(case)
        return Reproduction(report, files)

    monkeypatch.setattr("gough_stewart.harness.paper.reproduce.reproduce", reproduced)
    done = invoke("reproduce", "--order", "minus-first", "--out", str(tmp_path))
    assert done.exit_code == 3
    assert "a comparison misses its bound" in done.output
    assert {p.name for p in tmp_path.iterdir()} == FILES
    assert done.output.count("MISSED") == 1
    assert "− before +" in asked[0].title


def test_a_full_disk_is_one_clear_line(demo: Demo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(tmp_path / "open_loop.csv"))

    ready = Reproduction(json.loads((demo.paper / "comparison.json").read_text()), {"open_loop.csv": b"time\n"})
    monkeypatch.setattr("gough_stewart.harness.paper.reproduce.reproduce", lambda *_, **__: ready)
    monkeypatch.setattr("gough_stewart.model.process.files.write_whole", full)
    done = invoke("reproduce", "--out", str(tmp_path))
    assert done.exit_code == 1
    assert "No space left on device" in done.output
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []

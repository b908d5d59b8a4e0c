"""The command `reproduce`: its files, a platform of one's own, and a comparison that misses its bound."""

import json
import re
from html import unescape
from pathlib import Path

import pytest

from gough_stewart.harness.paper.reproduce import Reproduction
from gough_stewart.model.formulations.cases import OpenLoopCase
from gough_stewart.model.platform import preset_text
from tests.support.commands import invoke
from tests.support.demo import Demo
from tests.support.interpreter import Interpreter

FILES = {
    *("open_loop.csv", "figure-4.png", "figure-5.png", "figure-6.png", "figure-7.png", "drift.png", "report.json"),
    *("comparison.json", "gough_stewart_fmi2.fmu", "gough_stewart_fmi3.fmu"),
}


def test_two_runs_write_the_same_bytes(demo: Demo, interpreter: Interpreter, tmp_path: Path) -> None:
    """Expected: the files of the demonstration, but for the page, and charts as data, which were not asked for."""
    assert {p.name for p in demo.paper.iterdir()} == FILES | {"report.html"}
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

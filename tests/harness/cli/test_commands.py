"""Every study as a command, with --report, --json, --figures and --open, and `view` of what it wrote: one of each.

Expected: its exit code and its files, no others; the standard output is the report alone, report.json beside the files
has the same verdict, the browser opens the page of that folder, and `view` makes a page of it that has the verdict and
the charts of the first.
"""

import html
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.main import get_command

from gough_stewart.harness.cli.app import app
from gough_stewart.harness.experiment.run import save_record
from gough_stewart.harness.report.codec import from_json
from gough_stewart.harness.report.document import Report
from tests.harness.cli.test_identify import written
from tests.harness.experiment.test_frf import uneven_run
from tests.support.commands import invoke
from tests.support.demo import Demo
from tests.support.machine_logs import Course, machine_log

SHORT = ("--set", "loop.duration=0.3")
FEW = ("--members", "6", "--workers", "1", *SHORT)
BANDWIDTH = ("--vary", "controller.bandwidth=1..6Hz", "--minimise", "tracking.position.norm_rms")
# Words, the exit code, the files, and the figures. 3: the members of a short run do not settle; a log is too short.
USES: dict[str, tuple[tuple[str, ...], tuple[int, ...], str, str]] = {
    "run": (
        ("heave_step", *SHORT),
        (0,),
        "record.csv record.parquet metadata.json metrics.json",
        "errors pose actuators legs",
    ),
    "check": (("heave_step", *SHORT), (0,), "check.json needs.csv", "shares"),
    "margins": (("heave_step",), (0,), "margins.json", "bode step"),
    "ensemble": (
        ("heave_tolerances", *FEW),
        (0, 3),
        "members.parquet bands.parquet samples.parquet ensemble.json worst",
        "distribution bands dependence beside",
    ),
    "ensemble --compare": (
        ("heave_tolerances", *FEW, "--set", "controller.bandwidth=3", "--compare", "slower.toml"),
        (0, 3),
        "differences.parquet heave_tolerances slower",
        "distribution dependence",
    ),
    "tune": (
        ("heave_step", *BANDWIDTH, *SHORT, "--generations", "1", "--population", "5"),
        (0,),
        "tuned.toml tuning.json candidates.csv",
        "search values",
    ),
    "frf": (("injected",), (0,), "frf.csv frf.parquet", "bode"),
    "identify": (
        ("log.csv", "--preset", "motion_base", "--estimate", "platform_mass,platform_com"),
        (0, 3),
        "platform.toml estimate.json",
        "parameters fit residuals",
    ),
    "excite": (("--preset", "motion_base", "--trials", "1", "--duration", "10"), (0,), "excitation.toml", "pose"),
    "poses": (("log.csv", "--preset", "motion_base"), (0,), "poses.csv poses.parquet", "pose"),
    "workspace": (("--preset", "motion_base", "--points", "5"), (0,), "workspace.csv", "maps"),
    "build": (("--fmi", "3.0", "--check"), (0,), "gough_stewart_fmi3.fmu", ""),
    "export": (
        ("heave_step", "--as", "c"),
        (0,),
        "heave_step_controller.c heave_step_controller.h example_main.c",
        "",
    ),
    "reproduce": ((), (0,), "open_loop.csv", ""),
}


def figures(report: Report, *_: object) -> dict[str, bytes]:
    """A file for each group of charts."""
    return {f"{chart.group}.svg": b"" for chart in report.charts if chart.group}


def prepared(use: str) -> None:
    """The files in the present folder that a use needs."""
    if use == "frf":
        injection = {"type": "multisine", "leg": 4, "amplitude": 0.2, "band": [2, 100], "lines_at_most": 9, "settle": 1}
        save_record(uneven_run(injection, loop={"duration": 1.5, "sample_time": 4e-3, "delay": 1}), Path("injected"))
    elif use in ("identify", "poses"):
        written(machine_log(course=Course(duration=8.0)), Path("log.csv"))
    elif use == "ensemble --compare":
        Path("slower.toml").write_text(invoke("experiments", "heave_tolerances").stdout)


@pytest.mark.parametrize("use", USES)
def test_every_command_shows_what_it_found_in_all_ways(
    use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    opened: list[str] = []

    def opens(address: str) -> bool:
        opened.append(address)
        return True

    monkeypatch.setattr("webbrowser.open", opens)
    # what figures show, and that matplotlib draws them, is tested in the rooms of the studies
    monkeypatch.setattr("gough_stewart.harness.report.figures.figures", figures)
    monkeypatch.chdir(tmp_path)
    prepared(use)
    if use == "reproduce":
        demo: Demo = request.getfixturevalue("demo")
        kept = from_json((demo.paper / "report.json").read_bytes())
        found = SimpleNamespace(files={"open_loop.csv": b""}, agrees=True, document=lambda **_: kept)
        monkeypatch.setattr("gough_stewart.harness.paper.reproduce.reproduce", lambda *_: found)
    words, codes, files, groups = USES[use]
    done = invoke(use.split(maxsplit=1)[0], *words, "--report", "--json", "--figures", "--open", "--out", "out")
    assert done.exit_code in codes, done.output
    printed = from_json(done.stdout.encode())
    assert "Wrote to out" in done.stderr
    assert opened == [Path("out/report.html").absolute().as_uri()]
    assert printed.study == use
    names = {path.name for path in Path("out").iterdir()}
    pictures = {name for name in names if name.endswith(".svg")}
    wanted = {f"{group}.svg" for group in groups.split()}
    if use != "reproduce":  # its figures are those of the paper
        # the page of some studies has more charts
        assert (pictures >= wanted) if use == "run" else (pictures == wanted), pictures
    data = {"report.html"} if use == "run" else {"report.html", "report.json"}
    assert names - pictures == {*files.split()} | data
    if use != "run":
        assert from_json(Path("out/report.json").read_bytes()).verdict.text == printed.verdict.text

    done = invoke("view", "out", "--out", "again.html", "--open")
    assert done.exit_code == 0, done.output
    assert opened[1:] == [Path("again.html").absolute().as_uri()]
    first, again = (Path(name).read_text(encoding="utf-8") for name in ("out/report.html", "again.html"))
    for page in (first, again):
        assert verdict_of(page) == re.sub(r"-(?=\d)", "−", printed.verdict.text)
    assert charts_of(again) == charts_of(first) == [chart.title for chart in printed.charts]
    assert not Path("report.html").exists()


def verdict_of(page: str) -> str:
    """The verdict as a reader sees it."""
    shown = re.findall(r'<p class="verdict \w+"><span[^>]*>.</span><span[^>]*>[^<]*</span>(.*?)</p>', page)[0]
    return html.unescape(re.sub(r"<[^>]+>", "", shown))


def charts_of(page: str) -> list[str]:
    """The titles of the charts in a page's data."""
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    return [chart["title"] for chart in json.loads(data[1])["charts"]]


def test_these_are_all_commands_with_a_report() -> None:
    """Expected: every command that has --report, by the command line itself."""
    commands: Any = get_command(app)
    known = {name for name, each in commands.commands.items() if any(p.name == "report" for p in each.params)}
    assert known == {use.split()[0] for use in USES}

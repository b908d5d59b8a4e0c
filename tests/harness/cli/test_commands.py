"""Every command as a user meets it, in a table: its words, its exit code, its files, and what it says.

Each study is also asked for a page, its report as data, and the browser: the standard output is the report alone,
report.json beside the files has the same verdict, the browser opens the page of that folder, and `view` makes a page of
it that has the verdict and the charts of the first.
"""

import html
import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from typer.main import get_command

import gough_stewart as gs
from gough_stewart.harness.cli.app import app
from gough_stewart.harness.report.codec import from_json
from tests.harness.experiment.test_frf import uneven_run
from tests.support.commands import invoke
from tests.support.demo import Demo
from tests.support.machine_logs import Course, machine_log, save_log

SHORT = "--set loop.duration=0.3"
FEW = f"--members 6 --workers 1 {SHORT}"
SEARCH = "--vary controller.bandwidth=1..6Hz --minimise tracking.position.norm_rms --generations 1 --population 5"
EXCITE = "--preset motion_base --estimate platform_mass --duration 2 --frequency 0.5 --harmonics 2 --trials 1"
# Words, the exit codes, the files, and the groups of charts. 3: members of a short run do not settle; a log is short.
STUDIES: dict[str, tuple[str, tuple[int, ...], str, str]] = {
    "run": (
        f"heave_step {SHORT}", (0,),
        "record.csv record.parquet metadata.json metrics.json", "errors pose actuators legs",
    ),
    "check": (f"heave_step {SHORT}", (0,), "check.json needs.csv", "shares"),
    "margins": ("heave_step", (0,), "margins.json", "bode step"),
    "ensemble": (
        f"heave_tolerances {FEW}", (0, 3),
        "members.parquet bands.parquet samples.parquet ensemble.json worst", "distribution bands dependence beside",
    ),
    "ensemble --compare": (
        f"heave_tolerances {FEW} --set controller.bandwidth=3 --compare slower.toml", (0, 3),
        "differences.parquet heave_tolerances slower", "distribution dependence",
    ),
    "tune": (f"heave_step {SEARCH} {SHORT}", (0,), "tuned.toml tuning.json candidates.csv", "search values"),
    "frf": ("injected", (0,), "frf.csv frf.parquet", "bode"),
    "identify": (
        "log.csv --preset motion_base --estimate platform_mass,platform_com", (0, 3),
        "platform.toml estimate.json", "parameters fit residuals",
    ),
    "excite": (EXCITE, (0,), "excitation.toml", "pose"),
    "poses": ("log.csv --preset motion_base", (0,), "poses.csv poses.parquet", "pose"),
    "workspace": ("--preset motion_base --points 5", (0,), "workspace.csv", "maps"),
    "build": ("--fmi 3.0 --check", (0,), "gough_stewart_fmi3.fmu", ""),
    "export": ("heave_step --as c", (0,), "heave_step_controller.c heave_step_controller.h example_main.c", ""),
}  # fmt: skip


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_shows_what_it_found_in_all_ways(study: str, opened: list[str]) -> None:
    if study == "frf":
        injection = {"type": "multisine", "leg": 4, "amplitude": 0.2, "band": [2, 100], "lines_at_most": 9, "settle": 1}
        gs.save_record(uneven_run(injection, loop={"duration": 1.5, "sample_time": 4e-3, "delay": 1}), "injected")
    elif study in ("identify", "poses"):
        save_log(machine_log(course=Course(duration=2.0)), Path("log.csv"))
    elif study == "ensemble --compare":
        text = invoke("experiments", "heave_tolerances").stdout
        Path("slower.toml").write_text(text.replace('bandwidth = "3.5 Hz"', 'bandwidth = "2.5 Hz"'), encoding="utf-8")
    words, codes, files, groups = STUDIES[study]
    done = invoke(study.split(maxsplit=1)[0], *shlex.split(words), "--report", "--json", "--open", "--out", "out")
    assert done.exit_code in codes, done.output
    printed = from_json(done.stdout.encode())
    assert (printed.study, "Wrote to out" in done.stderr) == (study, True)
    assert opened == [Path("out/report.html").absolute().as_uri()]
    shown = {chart.group for chart in printed.charts} - {""}
    # the page of a run has more charts
    assert (shown >= {*groups.split()}) if study == "run" else (shown == {*groups.split()})
    data = {"report.html"} if study == "run" else {"report.html", "report.json"}
    assert names_in("out") == {*files.split()} | data
    if study != "run":
        assert from_json(Path("out/report.json").read_bytes()).verdict.text == printed.verdict.text
    check_view(Path("out"), printed.verdict.text)
    assert opened[1:] == [Path("again.html").absolute().as_uri()]
    assert charts_of(Path("again.html")) == [chart.title for chart in printed.charts]


def test_the_reproduction_is_viewed_again(demo: Demo, opened: list[str]) -> None:
    """Expected: of the last study, whose run takes long, what `make demo` has left."""
    assert names_in(demo.paper) >= {"open_loop.csv", "comparison.json", "figure-4.png", "drift.png", "report.html"}
    check_view(demo.paper, from_json((demo.paper / "report.json").read_bytes()).verdict.text)
    assert len(opened) == 1
    commands: Any = get_command(app)
    known = {name for name, each in commands.commands.items() if any(p.name == "report" for p in each.params)}
    assert known == {study.split()[0] for study in STUDIES} | {"reproduce"}


def names_in(folder: Path | str) -> set[str]:
    return {path.name for path in Path(folder).iterdir()} if Path(folder).exists() else set()


def check_view(folder: Path, verdict: str) -> None:
    """`view` of a folder has the verdict and the charts of the page there; it writes one file."""
    done = invoke("view", str(folder), "--out", "again.html", "--open")
    assert done.exit_code == 0, done.output
    for page in (folder / "report.html", Path("again.html")):
        text = page.read_text(encoding="utf-8")
        shown = re.findall(r'<p class="verdict \w+"><span[^>]*>.</span><span[^>]*>[^<]*</span>(.*?)</p>', text)[0]
        assert html.unescape(re.sub(r"<[^>]+>", "", shown)) == re.sub(r"-(?=\d)", "−", verdict)
    assert charts_of(Path("again.html")) == charts_of(folder / "report.html")
    assert not Path("report.html").exists()


def charts_of(page: Path) -> list[str]:
    """The titles of the charts in a page's data."""
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page.read_text("utf-8"), re.DOTALL)
    assert data is not None
    return [chart["title"] for chart in json.loads(data[1])["charts"]]


RUN = "record.csv record.parquet metadata.json metrics.json"
CHECK = "check.json needs.csv report.json"
COARSE = "--set loop.duration=2.5 --set 'loop.sample_time=25 ms'"
STROKE = (
    "run saturation --set limits.stroke=stop --set platform.parameters.leg_length_max=3.2 --set loop.duration=1 "
    "--set actuators.force_limit=none"
)
UNIT = "run circle --controller fmu3 --set loop.duration=0.02 --set loop.delay=1"
UNSTABLE = r"the closed loop is unstable with a delay of 1 sample: \|z\| = 1\.0505"
FORMS = "heave_step_controller.c heave_step_controller.h example_main.c"
UNSAID = "the platform states no limit: stroke, joint angle, leg velocity, leg acceleration, force and power"
# Words, the exit code, the files in `out` (None: as they are), and patterns of what is said, in one line.
CASES: list[tuple[str, int, str | None, list[str]]] = [
    (f"check pitch_sine {COARSE} --figures", 0, f"{CHECK} shares.pdf shares.png shares.svg",
     ["^Can be done; leg 3 needs 28 % of its stroke at ", "leg velocity", "states no limit: leg acceleration"]),
    (f"check pitch_sine {COARSE} --set reference.frequency=4", 3, CHECK,
     ["^Cannot be done; leg 3 needs 21", r"times as long \(--fit time\)", r"times as large \(--fit amplitude\)"]),
    (f"check pitch_sine {COARSE} --set platform.preset=liu2000", 0, CHECK,
     ["^Can be done as far as is known: the platform states no limit of its legs", UNSAID, "states no friction"]),
    (f"check pitch_sine {COARSE} --set platform.parameters.platform_mass=20000 --fit time", 1, CHECK,
     ["no time_scale makes the motion fit"]),
    (f"check pitch_sine {COARSE} --payload 300kg --payload-height '0.4 m' --set reference.frequency=0.4", 0, CHECK,
     ["^Can be done"]),
    ("run too_slow --set loop.plant_step=0.02", 3, RUN,
     [r"Not completed: \d\.\d+ of 8 s simulated in \d+\.\d s\. Wrote to ", "left its stroke at", "diverged at"]),
    (STROKE, 1, None, ["the length of leg 1 is"]),
    (f"{STROKE} --set 'reference.position_change=[0, 0, 0.06]' --set controller.damping_ratio=0.3", 3, RUN,
     ["stopped at", r"its stroke is 2\.6 to 3\.2 m"]),
    ("run heave_step --set loop.duration=0.3 --require 'tracking.position.norm_peak<=1mm for 90% of members'", 2, None,
     ["is on a share of members, and this study has none"]),
    ("ensemble heave_tolerances --require 'margins.disk>=0.1'", 2, None, [r"no number 'margins\.disk'"]),
    (f"ensemble heave_tolerances {FEW} --set ensemble.worst=0 --require 'step_response.x.rise_time<=1s for 9% of "
     "members'", 4, "members.parquet bands.parquet samples.parquet ensemble.json report.json",
     ["^Inconclusive: step_response.x.rise_time<=1s for 9% of members .not defined in this study."]),
    ("export heave_step --as 'c, fmu,ssp' --fmi 2.0", 0,
     f"{FORMS} heave_step.ssp heave_step_controller_fmi2.fmu report.json",
     [*(f"the {form} is without sensors.quantisation: it " for form in ("FMU", "C", "SSP")),
      *(f"{where} │ +stable │ +1 │ +0.99098 │ the nominal machine in its first pose │ +1.161"
        for where in ("in C", "with the FMU", "in the SSP"))]),
    ("export circle --as c,ssp", 1, None, [f"in the SSP {UNSTABLE}"]),
    ("export circle --as c,ssp --allow-unstable", 0,
     "circle.ssp circle_controller.c circle_controller.h example_main.c report.json",
     ["warning: exported on request: in the SSP the closed loop is unstable", "UNSTABLE in the SSP with a"]),
    (UNIT, 1, None, [f"with the unit in the run {UNSTABLE}", "--allow-unstable runs it"]),
    (f"{UNIT} --allow-unstable", 0, RUN, ["warning: run on request: with the unit in the run"]),
]  # fmt: skip


@pytest.mark.parametrize(("words", "code", "files", "says"), CASES, ids=[words for words, *_ in CASES])
def test_commands_end_with_their_code_files_and_words(
    words: str, code: int, files: str | None, says: list[str]
) -> None:
    done = invoke(*shlex.split(words), "--out", "out")
    said = " ".join(done.output.split())
    assert done.exit_code == code, done.output
    assert [pattern for pattern in says if re.search(pattern, said) is None] == [], done.output
    assert names_in("out") == {*(files or "").split()}


def test_a_fitted_experiment_is_written_beside_and_checked_and_can_be_run() -> None:
    """Expected: the shipped file with the settings and the scale; its motion, which was refused, is taken."""
    fast = ["--set", "reference.frequency=4", *shlex.split(COARSE)]
    done = invoke("check", "pitch_sine", *fast, "--fit", "amplitude")
    assert done.exit_code == 0, done.output
    assert "Wrote pitch_sine-fitted.toml (" in done.output
    assert "Next: gough-stewart run pitch_sine-fitted.toml" in done.output
    values = tomllib.loads(Path("pitch_sine-fitted.toml").read_text())
    assert values["reference"]["frequency"] == 4
    new = set(values["reference"]) - {"type", "orientation_amplitude", "frequency", "fade_in"}
    assert new == {"amplitude_scale"}
    assert names_in(".") == {"results", "pitch_sine-fitted.toml"}
    slow = ("--set", "controller.bandwidth=0.1")
    assert "the reference cannot be reached" in invoke("run", "pitch_sine", *fast, *slow).stderr
    assert invoke("run", "pitch_sine-fitted.toml", *slow).exit_code in (0, 3)


def test_needs_are_the_same_numbers_in_the_table_the_file_and_the_record() -> None:
    done = invoke("check", "pitch_sine", "--set", "platform.preset=liu2000", *shlex.split(COARSE), "--out", "out")
    table, numbers = polars.read_csv("out/needs.csv"), json.loads(Path("out/check.json").read_text())
    assert numbers["within"] is True
    assert len(numbers["not_stated"]) == 6
    assert table["leg"].to_list() == [1, 2, 3, 4, 5, 6]
    assert list(table.columns[1:]) == [f"{name} [{need['unit']}]" for name, need in numbers["needs"].items()]
    for column, need in zip(table.columns[1:], numbers["needs"].values(), strict=True):
        assert table[column].to_list() == pytest.approx(need["of_leg"], rel=1e-12)
    assert f"{max(numbers['needs']['actuator_force_peak']['of_leg']):.3g}" in done.stdout


def test_the_exported_unit_runs_in_the_place_of_the_controller() -> None:
    """Expected: the run with the controller in Python; its plant is stepped by other code, to a tolerance of 1e-8."""
    # a reference that moves from the beginning, and clocks that differ
    settings = ("loop.duration=0.06", "loop.delay=1", "loop.plant_step=0.0005", "reference.at=0.01")
    words = [word for setting in settings for word in ("--set", setting)]
    for name, options in (("python", []), ("unit", ["--controller", "fmu3"])):
        done = invoke("run", "heave_step", *words, *options, "--out", name)
        assert done.exit_code == 0, done.output
    found, expected = (gs.read_record(f"{name}/record.parquet") for name in ("unit", "python"))
    assert np.ptp(expected["controller.force"]) > 100
    assert np.allclose(found["controller.force"], expected["controller.force"], rtol=1e-9, atol=0)
    assert np.abs(found["position"] - expected["position"]).max() <= 1e-10


def test_switch_and_safe_forces_are_chosen_at_the_command() -> None:
    """Expected: the header states the safe force, what counts as frozen, the switch; and what float costs."""
    options = ("--with", "manual", "--safe-force", "zero", "--frozen", "50, 1 mm", "--set", "loop.duration=0.05")
    assert invoke("export", "saturation", "--as", "c", *options, "--out", "out").exit_code == 0
    header = " ".join(Path("out/saturation_controller.h").read_text().split())
    for said in (
        "REAL=float, forces deviate from those in double precision, in 0.05 s of the designed loop, by at most",
        "While `input_status` is not good, all six forces are 0,",
        "the same for 50 samples while its reference moves by more than 0.001 m",
        "saturation_controller_real enabled;",
    ):
        assert said in header, said


def test_lists_and_texts_of_what_ships() -> None:
    """Expected: all names in the lists; a text that loads as that platform or experiment."""
    listed, experiments = invoke("presets").stdout, invoke("experiments").stdout
    assert all(name in listed for name in ("liu2000", "motion_base", "desktop_hexapod"))
    assert all(name in experiments for name in ("heave_step", "circle", "paper_open_loop"))
    Path("liu.toml").write_text(invoke("presets", "liu2000").stdout)
    assert gs.load_platform("liu.toml") == gs.load_preset("liu2000")
    Path("circle.toml").write_text(invoke("experiments", "circle").stdout)
    assert gs.load_experiment("circle.toml").title == gs.load_experiment("circle").title

"""Every command as a user meets it, in one table: its words, its exit code, its files, and what it says."""

import json
import re
import shlex
import time
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gough_stewart as gs
from tests.harness.identify.machine_logs import HEAVE, Course, Sensing, Swing, machine_log
from tests.support.commands import commands, invoke
from tests.support.demo import Demo
from tests.support.page_arrays import data_of, elements
from tests.support.records import log_file, waving_record

SHORT = "--set loop.duration=0.3"
FEW = f"heave_tolerances --members 6 --workers 1 --set ensemble.worst=1 {SHORT}"
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
        FEW, (0, 3),
        "members.parquet bands.parquet samples.parquet ensemble.json worst", "distribution bands dependence beside",
    ),
    "ensemble --compare": (
        f"{FEW} --set controller.bandwidth=3 --compare slower.toml", (0, 3),
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


def names_in(folder: Path | str) -> set[str]:
    return {path.name for path in Path(folder).iterdir()} if Path(folder).exists() else set()


def charts_of(page: Path) -> list[str]:
    return [chart["title"] for chart in data_of(page.read_bytes())["charts"]]


def check_view(folder: Path, verdict: str) -> None:
    """`view` of a folder has the verdict and the charts of the page there; it writes one file."""
    done = invoke("view", str(folder), "--out", "again.html", "--open")
    assert done.exit_code == 0, done.output
    for page in (folder / "report.html", Path("again.html")):
        (shown,) = elements(page.read_bytes(), "//p[starts-with(@class, 'verdict ')]")
        assert re.sub(r"^.[a-z]+: ", "", shown.text_content()) == re.sub(r"-(?=\d)", "−", verdict)
    assert charts_of(Path("again.html")) == charts_of(folder / "report.html")
    assert not Path("report.html").exists()


@pytest.mark.parametrize("study", STUDIES)
def test_every_study_shows_what_it_found_in_all_ways(study: str, opened: list[str]) -> None:
    """Expected: the data alone on the standard output, the same in report.json and on the page, which is opened."""
    if study == "frf":
        gs.save_record(gs.run("frequency_response", {"loop.duration": 6}), "injected")
    elif study in ("identify", "poses"):
        log_file(machine_log(course=Course(duration=2.0)), "log.csv")
    elif study == "ensemble --compare":
        text = invoke("experiments", "heave_tolerances").stdout
        judged = '[require]\ntracking.position.norm_peak = "> 0 mm"\n'  # of the two files, those of the second
        for old, new in (
            ('"2 Hz"', '"1.5 Hz"'), ('"1 s"', '"0.3 s"'), ("[ensemble]\n", f"{judged}[ensemble]\nworst = 1\n"),
        ):  # fmt: skip
            assert text.count(old) == 1
            text = text.replace(old, new)
        Path("slower.toml").write_text(text, encoding="utf-8")
    words, codes, files, groups = STUDIES[study]
    done = invoke(study.split(maxsplit=1)[0], *shlex.split(words), "--report", "--json", "--open", "--out", "out")
    assert done.exit_code in codes, done.output
    printed = json.loads(done.stdout)
    assert (printed["study"], "Wrote to out" in done.stderr) == (study, True)
    assert len(printed.get("requirements", [])) == (study == "ensemble --compare")
    assert opened == [Path("out/report.html").absolute().as_uri()]
    charts = [part for section in printed["sections"] for part in section["parts"] if part["part"] == "chart"]
    shown = {chart.get("group", "") for chart in charts} - {""}
    # the page of a run has more charts
    assert (shown >= {*groups.split()}) if study == "run" else (shown == {*groups.split()})
    data = {"report.html"} if study == "run" else {"report.html", "report.json"}
    assert names_in("out") == {*files.split()} | data
    if study != "run":
        assert json.loads(Path("out/report.json").read_bytes())["verdict"] == printed["verdict"]
    check_view(Path("out"), printed["verdict"]["text"])
    assert opened[1:] == [Path("again.html").absolute().as_uri()]
    assert charts_of(Path("again.html")) == [chart["title"] for chart in charts]


def test_the_reproduction_is_viewed_again(demo: Demo, opened: list[str]) -> None:
    """Expected: of the last study, whose run takes long, what `make demo` has left."""
    assert names_in(demo.paper) >= {"open_loop.csv", "comparison.json", "figure-4.png", "drift.png", "report.html"}
    check_view(demo.paper, json.loads((demo.paper / "report.json").read_bytes())["verdict"]["text"])
    assert len(opened) == 1
    known = {name for name, each in commands().items() if any(option.name == "report" for option in each.params)}
    assert known == {study.split()[0] for study in STUDIES} | {"reproduce"}


RUN = "record.csv record.parquet metadata.json metrics.json"
CHECK = "check.json needs.csv report.json"
MEMBERS = "members.parquet bands.parquet samples.parquet ensemble.json report.json"
COARSE = "--set loop.duration=2.5 --set 'loop.sample_time=25 ms'"
STROKE = (
    "run saturation --set limits.stroke=stop --set platform.parameters.leg_length_max=3.2 --set loop.duration=1 "
    "--set actuators.force_limit=none"
)
UNIT = "run circle --controller fmu3 --set loop.duration=0.02 --set loop.delay=1"
UNSTABLE = r"the closed loop is unstable with a delay of 1 sample: \|z\| = 1\.0505"
FORMS = "heave_step_controller.c heave_step_controller.h example_main.c"
UNSAID = "the platform states no limit: stroke, joint angle, leg velocity, leg acceleration, force and power"
LISTED = ["liu2000", "motion_base", "desktop_hexapod"]
# Words, the exit code, the files in `out` (None: as they are), and patterns of what is said, in one line.
CASES: list[tuple[str, int, str | None, list[str]]] = [
    ("presets", 0, None, LISTED),
    ("experiments", 0, None, ["heave_step", "circle", "paper_open_loop"]),
    (f"check pitch_sine {COARSE} --figures --fit time", 0, f"{CHECK} shares.pdf shares.png shares.svg",
     ["^Can be done; leg 3 needs 28 % of its stroke at ", "leg velocity", "limit: leg acceleration", "nothing to fit"]),
    (f"check pitch_sine {COARSE} --set reference.frequency=4", 3, CHECK,
     ["^Cannot be done; leg 3 needs 21", r"times as long \(--fit time\)", r"times as large \(--fit amplitude\)"]),
    (f"check pitch_sine {COARSE} --set platform.preset=liu2000", 0, CHECK,
     ["^Can be done as far as is known: the platform states no limit of its legs", UNSAID, "states no friction"]),
    (f"check pitch_sine {COARSE} --set platform.parameters.platform_mass=20000 --fit time", 1, CHECK,
     ["no time_scale makes the motion fit"]),
    ("run heave_step --set controller.bandwidth=20 --set loop.delay=4", 0, RUN,
     [r"leg \d oscillates at 38(\.\d)? Hz without input, with"]),
    ("run too_slow --set loop.plant_step=0.02", 3, RUN,
     [r"Not completed: \d\.\d+ of 8 s simulated in \d+\.\d s\. Wrote to ", "left its stroke at", "diverged at"]),
    (STROKE, 1, None, ["the length of leg 1 is"]),
    (f"{STROKE} --set 'reference.position_change=[0, 0, 0.06]' --set controller.damping_ratio=0.3", 3, RUN,
     ["stopped at", r"its stroke is 2\.6 to 3\.2 m"]),
    (f"ensemble {FEW} --set ensemble.worst=0 --require 'step_response.x.rise_time<=1s for 9% of members'", 4, MEMBERS,
     ["^Inconclusive: step_response.x.rise_time<=1s for 9% of members .not defined in this study."]),
    (f"ensemble {FEW} --set limits.position_error=1e-6", 3, f"{MEMBERS} worst",
     ["none of 6 members completed its run; the first: the platform is .* its reference; the limit is 1e-06 m"]),
    (f"tune heave_step {SEARCH} {SHORT} --subject-to 'stroke.margin > 100 m'", 3, None,
     ["no candidate meets the conditions"]),
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
    done = invoke(*shlex.split(words), *([] if " " not in words else ["--out", "out"]))
    said = " ".join(done.output.split())
    assert done.exit_code == code, done.output
    assert [pattern for pattern in says if re.search(pattern, said) is None] == [], done.output
    assert names_in("out") == {*(files or "").split()}


def test_presets_are_listed_with_mass_leg_and_conditioning() -> None:
    """Expected: distances of the joints at home, which is level; NumPy's number, angles times the joints' radius."""
    said = " ".join(invoke("presets").output.split())
    for name in LISTED:
        machine = gs.load_preset(name)
        leg = machine.home_position + machine.platform_points - machine.base_points
        length, radius = np.linalg.norm(leg, axis=1), np.sqrt((machine.platform_points**2).sum(axis=1).mean())
        number = np.linalg.cond(np.hstack([leg, np.cross(machine.platform_points, leg) / radius]) / length[:, None])
        assert f"│ {name} │ {machine.platform_mass:.6g} │ {length.mean():.5g} │ {number:.3g} │" in said


# Words, and the folder of the files: named like the command and its file, which keeps its suffix if its name ships.
FOLDERS = [
    ("check heave_step", "results/check_heave_step"),
    ("check heave_step.toml", "results/check_heave_step.toml"),
    ("check ./a/mine.toml", "results/check_mine"),
    ("check a/b.c.toml", "results/check_b.c"),
    ("run heave_tolerances --member 1 --set loop.duration=0.01", "results/run_heave_tolerances_member_1"),
    ("workspace --points 3 --over x,y", "results/workspace_liu2000"),
    ("workspace --points 3 --preset motion_base --at pitch=5°", "results/workspace_motion_base"),
    ("workspace --points 3 --platform a/motion_base.toml", "results/workspace_motion_base.toml"),
    ("workspace --points 3 --platform a/own.toml", "results/workspace_own"),
    *((f"poses run.1{file} --preset motion_base", "results/poses_run.1") for file in ("", "/record.parquet")),
    ("poses log.7.csv --preset motion_base", "results/poses_log.7"),
    ("check heave_step --out=~/of/me", "home/of/me"),
    ("check heave_step --out=~nobody_of_that_name/x", "~nobody_of_that_name/x"),
]


@pytest.mark.parametrize(("words", "folder"), FOLDERS, ids=[words for words, _ in FOLDERS])
def test_files_are_where_their_name_says(words: str, folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(Path("home").absolute()))
    Path("a").mkdir()
    for name in ("heave_step", "a/mine", "a/b.c"):
        Path(f"{name}.toml").write_text(invoke("experiments", "heave_step").stdout, encoding="utf-8")
    for name in ("a/motion_base", "a/own"):
        gs.save_platform(gs.load_preset("motion_base"), f"{name}.toml")
    record = waving_record(gs.load_preset("motion_base"), rows=3)
    gs.save_record(record, "run.1")
    record.write_csv(Path("log.7.csv"))
    done = invoke(*shlex.split(words))
    assert done.exit_code == 0, done.output
    assert names_in(folder)
    assert names_in("results") == ({folder.partition("/")[2]} if folder.startswith("results") else set())


def test_what_is_odd_in_a_platform_file_is_a_warning_with_its_name() -> None:
    machine = gs.load_preset("motion_base")
    gs.save_platform(replace(machine, base_points=np.roll(machine.base_points, 1, axis=0)), "own.toml")
    done = invoke("excite", "--platform", "own.toml", "--estimate", "nothing")
    hints = gs.load_platform("own.toml").hints
    assert hints
    assert done.stderr.splitlines()[:-1] == [f"warning: own.toml: {hint}" for hint in hints]


def test_a_fitted_experiment_is_written_beside_and_checked_and_can_be_run() -> None:
    """Expected: the shipped file with settings, payload and scale; its motion, which was refused, is taken."""
    fast = ["--set", "reference.frequency=4", *shlex.split(COARSE)]
    done = invoke("check", "pitch_sine", *fast, "--payload", "150 kg", "--fit", "amplitude")
    assert done.exit_code == 0, done.output
    assert "Wrote pitch_sine-fitted.toml (" in done.output
    assert "Next: gough-stewart run pitch_sine-fitted.toml" in done.output
    values = tomllib.loads(Path("pitch_sine-fitted.toml").read_text())
    assert values["reference"]["frequency"] == 4
    mass = gs.load_preset("motion_base").platform_mass + 150
    assert values["platform"]["parameters"]["platform_mass"] == pytest.approx(mass)
    new = set(values["reference"]) - {"type", "orientation_amplitude", "frequency", "fade_in"}
    assert new == {"amplitude_scale"}
    assert names_in(".") == {"results", "pitch_sine-fitted.toml"}
    slow = ("--set", "controller.bandwidth=0.1")
    assert "the reference cannot be reached" in invoke("run", "pitch_sine", *fast, *slow).stderr
    assert invoke("run", "pitch_sine-fitted.toml", *slow).exit_code in (0, 3)
    # what is checked beside it carries the same load
    payload = ("--payload", "300kg", "--payload-height", ".4")
    fitted = invoke("check", "pitch_sine", *fast, "--fit", "amplitude", *payload).output.partition("-fitted.toml:")[2]
    alone = invoke("check", "pitch_sine-fitted.toml").output
    force = next(line for line in alone.splitlines() if line.startswith("│ force "))
    assert force in fitted


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


NAMES = "platform_mass,platform_com,leg_armature,leg_viscous_friction,leg_coulomb_friction"


def test_several_logs_are_fitted_another_validates_and_what_is_missing_is_proposed() -> None:
    """Expected: of heave alone the height of the centre of mass is null, and a command that runs proposes a motion."""
    slow, fast = (Course(Swing(axes=HEAVE.axes, size=size)) for size in (0.04, 0.06))
    late = Sensing(delay=-0.5e-3)
    logs = [
        log_file(machine_log(course=course, sensing=late, seed=seed), f"{seed}.csv")
        for seed, course in enumerate((slow, fast, slow), 1)
    ]
    options = ("--preset", "motion_base", "--estimate", NAMES, "--out", "out")
    done = invoke("identify", *logs[:2], "--validate", logs[2], "--holds-force", *options)
    assert done.exit_code == 0, done.stderr
    found = json.loads(Path("out/estimate.json").read_text("utf-8"))
    assert found["parameters"]["platform_com[3]"]["value"] is None
    low, high = found["parameters"]["platform_mass"]["interval"]
    assert low < 1516.9 < high
    assert found["alarms"] == []
    np.testing.assert_allclose(found["residuals"]["validation_rms"], found["residuals"]["rms"], rtol=0.3)
    assert "not excited" in done.stdout
    (next_line,) = (line for line in done.stdout.splitlines() if line.startswith("Next: "))
    proposed = shlex.split(next_line.removeprefix("Next: gough-stewart "))
    assert proposed == ["excite", "--preset", "motion_base", "--estimate", NAMES]


def test_a_log_that_contradicts_the_model_is_written_with_an_alarm_and_exit_code_3() -> None:
    """Expected: files, the alarm on the terminal, in the numbers and on the page; one leg's forces read 2 % high."""
    wrong = Sensing(force_gain=(1.02, 1.0, 1.0, 1.0, 1.0, 1.0))
    log = log_file(machine_log(course=Course(duration=6.0), sensing=wrong), "log.csv")
    options = ("--preset", "motion_base", "--estimate", f"{NAMES},platform_inertia", "--out", "out")
    done = invoke("identify", log, "--validation", "0.3", "--report", *options)
    assert done.exit_code == 3
    assert "warning: the log contradicts the model" in done.stderr
    found = json.loads(Path("out/estimate.json").read_text("utf-8"))
    assert len(found["alarms"]) == 1
    assert found["diagnosis"]["alarm"]
    assert elements(Path("out/report.html").read_bytes(), "//p[@class='verdict bad']")
    assert Path("out/platform.toml").is_file()


def test_a_record_makes_the_same_page_from_each_of_its_files(
    opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the same bytes from Parquet, from CSV, and from the folder; report.html where the user is."""
    record = waving_record(gs.load_preset("desktop_hexapod"), rows=50)
    gs.save_record(record, "waves")
    for name, place in (("a", "waves"), ("b", "waves/record.parquet"), ("c", "waves/record.csv")):
        done = invoke("view", place, "--out", f"{name}.html")
        assert (done.exit_code, f"{name}.html" in done.output) == (0, True), done.output
    pages = [Path(f"{name}.html").read_bytes() for name in "abc"]
    assert pages[0] == pages[1] == pages[2]
    assert invoke("view", "waves", "--open").exit_code == 0
    assert Path("report.html").read_bytes() == pages[0]
    page = Path("new folder/page.htm").absolute()
    assert "by hand" not in invoke("view", "waves", "--out", str(page), "--open").output
    assert opened == [Path("report.html").absolute().as_uri(), page.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda _: False)
    later = SimpleNamespace(perf_counter=lambda: time.perf_counter() + 125)
    monkeypatch.setattr("gough_stewart.harness.cli.command.time", later)
    said = invoke("view", "waves", "--out", str(page), "--open").output
    assert re.search(r"^Done in 2 min \d+ s\. (.*\n)+.*by hand", said), said


def test_a_page_alone_is_opened_as_it_is(opened: list[str]) -> None:
    """Expected: from the folder or from report.json the same page; of a folder without it, the page that is there."""
    assert invoke("check", "pitch_sine", *shlex.split(COARSE), "--report", "--out", "checked").exit_code == 0
    for name, place in (("a", "checked"), ("b", "checked/report.json")):
        assert invoke("view", place, "--out", f"{name}.html").exit_code == 0
    assert Path("a.html").read_bytes() == Path("b.html").read_bytes()
    Path("checked/report.json").unlink()
    assert invoke("view", "checked", "--open").exit_code == 0
    assert opened == [Path("checked/report.html").absolute().as_uri()]
    done = invoke("view", "checked/report.json")
    assert (done.exit_code, "checked/report.json: no such file" in done.stderr) == (1, True)


LAW, UNIT_CODE = "law.py", "unit.fmu"
EXECUTED = [
    ("run both.toml", [LAW, UNIT_CODE]),
    ("run both.toml --plant fmu2", [LAW, UNIT_CODE]),
    ("run both.toml --plant fmu3 --fmu mine.fmu", [LAW]),
    ("run both.toml --plant model", [LAW]),
    ("run both.toml --fmu mine.fmu", [LAW]),
    ("run both.toml --controller fmu3", [LAW, UNIT_CODE]),
    ("run both.toml --controller mine.fmu", [UNIT_CODE]),
    ("run both.toml --member 0", [LAW]),
    ("run both.toml --member 0 --plant fmu2", [LAW, UNIT_CODE]),
    ("run both.toml --member 0 --fmu mine.fmu", [LAW]),
    ("margins both.toml", [LAW]),
    ("frf record --experiment both.toml", [LAW]),
    ("export both.toml", [LAW]),
    ("ensemble both.toml", [LAW]),
    ("ensemble heave_tolerances --members 2 --compare both.toml", [LAW]),
    ("tune both.toml --vary controller.x=1..2 --minimise force.peak", [LAW]),
    ("identify log.csv --estimate platform_mass --experiment both.toml", [LAW, UNIT_CODE]),
]


@pytest.mark.parametrize(("words", "files"), EXECUTED, ids=[words for words, _ in EXECUTED])
def test_what_is_executed_is_announced_and_refused_on_request(words: str, files: list[str]) -> None:
    """Expected: the law of designs, runs and members; the unit only of a run that simulates it."""
    Path("law.py").write_text(
        "import pathlib\npathlib.Path('mark').touch()\ncontroller = lambda sample: [4078.57] * 6\n"
    )
    Path("both.toml").write_text(
        'title = "own"\nplatform.preset = "motion_base"\nreference.type = "hold"\nloop.duration = 0.005\n'
        'plant = {kind = "fmu2", fmu = "unit.fmu"}\ncontroller = {type = "python", file = "law.py"}\n'
    )
    if not words.startswith("frf"):  # has no such option: only who names an experiment has code executed
        said = invoke(*words.split(), "--no-python").stderr
        assert f"both.toml: executes {', '.join(files)}; omit --no-python" in said
        assert not Path("mark").exists()
    said = invoke(*words.split()).stderr
    announced = [line for line in said.splitlines() if line.startswith("executes")]
    assert announced == [f"executes {file}, named by both.toml" for file in files], said


FAILURES = [
    (OSError(28, "No space left on device", "out/pose.png"), 1, "error: out/pose.png: No space left on device"),
    (MemoryError(), 1, "error: not enough memory; make the run shorter, its plant_step longer, or the grid coarser"),
    (KeyboardInterrupt(), 130, "interrupted"),
]


@pytest.mark.parametrize(("error", "code", "said"), FAILURES)
def test_figures_that_fail_cost_no_record(
    error: BaseException, code: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the record first of all, what is missing named, and no figure of the run before."""
    Path("out").mkdir()
    for name in ("metrics.json", "errors.pdf"):
        Path("out", name).touch()

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr("gough_stewart.harness.experiment.run.readable_json", fails)
    done = invoke("run", "heave_step", *SHORT.split(), "--out", "out", "--figures")
    assert done.exit_code == code
    assert f"{said}; out has record.parquet" in done.stderr
    assert "missing: metrics.json, errors.pdf" in done.stderr
    assert names_in("out") == {"record.parquet", "record.csv", "metadata.json"}
    assert gs.read_record("out").metadata["rows"] == 301


def contents(folder: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_a_folder_holds_the_newest_result_of_one_study() -> None:
    """Expected: page and figures of the result before go, files of the user stay; another study is refused there."""
    for options, then in ((["--report"], ("mine.txt", "bode.pdf", ".a.0123abcd.part")), ([], ())):
        done = invoke("margins", "heave_step", *options, "--out", "out")
        told = re.search(r"^Done in \d+\.\d+ s\. Wrote to out \((\S+) (kB|MB)\):$", done.stdout, re.MULTILINE)
        assert told is not None, done.output
        assert ("what a command left that was killed: .a.0123abcd.part\n" in done.stderr) == (not options)
        size = sum(map(len, contents("out").values())) / {"kB": 1e3, "MB": 1e6}[told[2]]
        assert float(told[1]) == pytest.approx(size, abs=0.06)
        assert names_in("out") == {"margins.json", "report.json", *(["report.html"] if options else ["mine.txt"])}
        for name in then:
            Path("out", name).touch()
    Path("ran").mkdir()
    Path("ran/record.parquet").touch()
    for folder, study in (("out", "margins"), ("ran", "run")):
        before, done = contents(folder), invoke("check", "heave_step", "--out", folder)
        said = f"output folder {folder}: it holds the results of `gough-stewart {study}`; choose another"
        assert (done.exit_code, said in done.stderr, contents(folder)) == (1, True, before)
    Path("foreign").mkdir()
    for text in ("{", "[1]", '{"study": ""}'):  # a file of another program is no study
        Path("foreign/report.json").write_text(text)
        assert invoke("check", "heave_step", *shlex.split(COARSE), "--out", "foreign").exit_code == 0, text

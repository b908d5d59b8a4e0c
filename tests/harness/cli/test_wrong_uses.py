"""Wrong and clumsy uses of the command line: the exit code, and what the one line says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.errors import PlantError
from gough_stewart.harness.plants.unit import UnitFile
from gough_stewart.harness.quantities import number
from tests.support.commands import invoke
from tests.support.fmu_plants import Fmu

TUNE = ("tune", "heave_step", "--minimise", "tracking.position.norm_rms")
BANDWIDTH = ("--vary", "controller.bandwidth=1..6Hz")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("presets", "nope"), "no such preset; expected one of desktop_hexapod"),
        (("experiments", "nope"), "no such experiment; expected one of circle"),
        (("workspace", "--preset", "nope"), "no such preset; expected one of desktop_hexapod"),
        (("build", "--target", "nope"), "no target 'nope'; expected native, all"),
        (("export", "heave_step", "--target", "nope"), "no target 'nope'; expected native, all"),
        (("export", "heave_step", "--as", "xyz"), "no form 'xyz'; expected one of fmu, c, ssp"),
        ((*TUNE, "--vary", "x"), r"--vary x: expected KEY=LOW\.\.HIGH"),
        ((*TUNE, "--vary", "controller.nope=1..2"), r"controller\.nope: .*did you mean|unknown|no such|no key"),
        ((*TUNE, *BANDWIDTH, "--subject-to", "stroke.margin"), "cannot be read; expected PATH <= NUMBER UNIT"),
        (("tune", "heave_step", *BANDWIDTH, "--minimise", "nope"), "--minimise: no metric 'nope'"),
        (("run", "heave_step", "--set", "x"), "--set x"),
        (("workspace", "--at", "yaw=400deg"), "yaw is 6.98132 rad, 400°; expected from −180° to 180°"),
        (("workspace", "--at", "yaw=40"), "yaw is 40 rad, 2291.83°; expected .*numbers without a unit are in rad"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_wrong_usage_is_exit_code_2(arguments: tuple[str, ...], says: str) -> None:
    done = invoke(*arguments)
    assert (done.exit_code, ExitCode.USAGE) == (2, 2)
    assert re.search(says, done.stderr), done.stderr
    assert done.stderr.count("\n") <= 2


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("workspace", "motion_base"), "--preset motion_base"),
        (("build", "mine.toml"), "--platform mine.toml"),
        (("reproduce", "liu2000"), "--preset liu2000"),
        (("margins", "heave_step", "motion_base"), ""),
    ],
)
def test_a_platform_as_plain_argument_is_told_its_option(arguments: tuple[str, ...], option: str) -> None:
    """Expected: the option that takes it, of commands that have it."""
    done = invoke(*arguments)
    assert done.exit_code == ExitCode.USAGE
    said = " ".join(done.stderr.replace("│", " ").split())
    assert "Got unexpected extra argument" in said
    assert (f"; a platform is given as `{option}`" in said) == ("a platform is given" in said) == bool(option)


def test_the_documentation_has_the_table_of_exit_codes() -> None:
    """Expected: its rows have the codes and meanings of the one place that declares them; no other page has a table."""
    docs = Path(__file__).parents[3] / "docs"
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \|", (docs / "commands.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert [(int(code), meaning) for code, meaning in rows[: len(ExitCode)]] == [
        (int(code), code.meaning) for code in ExitCode
    ]


def test_an_ensemble_in_which_all_fail_is_exit_code_3(tmp_path: Path) -> None:
    """Expected: its files, and one line with the number and a cause."""
    settings = ("limits.position_error=1e-6", "limits.reference=ignore")[:1]
    arguments = [part for each in settings for part in ("--set", each)]
    done = invoke(
        "ensemble", "heave_tolerances", "--members", "4", "--workers", "1", *arguments, "--out", str(tmp_path)
    )
    assert done.exit_code == ExitCode.MISSED, done.stderr
    assert re.search(
        "none of 4 members completed its run; the first: the platform is .* from its reference; the limit is 1e-06 m",
        done.stderr,
    )
    assert (tmp_path / "members.parquet").is_file()
    assert invoke("view", str(tmp_path), "--out", str(tmp_path / "page.html")).exit_code == 0


def test_a_search_without_a_candidate_is_exit_code_3(tmp_path: Path) -> None:
    conditions = ("--subject-to", "stroke.margin > 100 m", "--set", "loop.duration=0.3")
    done = invoke(*TUNE, *BANDWIDTH, *conditions, "--generations", "1", "--population", "5", "--out", str(tmp_path))
    assert done.exit_code == ExitCode.MISSED
    assert "no candidate meets the conditions" in done.stderr


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("tuning.json", "it has a tuning; run tuned.toml"),
        ("plan.json", "it has an unfinished ensemble; continue it with"),
        ("gough_stewart_fmi3.fmu", "it has FMUs: gough_stewart_fmi3.fmu"),
        ("a.txt", "it has a.txt; expected record.parquet"),
        ("member-3/record.parquet", "it has folders of records: member-3; view one of them"),
        (".hidden", "it is empty"),
    ],
)
def test_view_says_what_a_folder_without_a_record_has(name: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "of" / name).parent.mkdir(parents=True)
    (tmp_path / "of" / name).touch()
    done = invoke("view", str(tmp_path / "of"), "--out", str(tmp_path / "page.html"))
    assert done.exit_code == ExitCode.FAILED
    assert f"the folder has no record; {says}" in done.stderr


def test_each_command_has_a_folder_of_its_own_that_view_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: results/COMMAND_NAME, NAME after experiment, platform or log; `view` opens each."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(invoke("presets", "desktop_hexapod").stdout)
    uses = {
        "check_circle": ("check", "circle"),
        "workspace_mine": ("workspace", "--platform", "mine.toml", "--points", "5"),
        "workspace_liu2000": ("workspace", "--points", "3"),
        "excite_motion_base": ("excite", "--preset", "motion_base", "--trials", "1", "--duration", "10"),
    }
    for folder, arguments in uses.items():
        done = invoke(*arguments)
        assert done.exit_code == 0, (arguments, done.stderr)
        assert [path.name for path in Path("results").iterdir()] == [folder]
        shown = invoke("view", f"results/{folder}")
        assert (shown.exit_code, "Wrote report.html" in shown.stdout) == (0, True)
        Path("results", folder).rename(folder)


def test_open_opens_the_page_wherever_one_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the page of a workspace and that of a run, which --open asks for."""
    opened: list[str] = []

    def opens(address: str) -> bool:
        opened.append(address)
        return True

    monkeypatch.setattr("webbrowser.open", opens)
    for arguments, page in (
        (("workspace", "--points", "3"), "report.html"),
        (("run", "heave_step", "--set", "loop.duration=0.3"), "report.html"),
    ):
        done = invoke(*arguments, "--open", "--out", str(tmp_path))
        assert done.exit_code == 0, done.stderr
        assert opened.pop() == (tmp_path / page).as_uri()


@pytest.mark.parametrize("command", ["run", "ensemble", "view", "identify", "workspace", "reproduce"])
def test_commands_that_write_a_page_can_open_it(command: str) -> None:
    assert "--open" in invoke(command, "--help").stdout


@pytest.mark.parametrize(
    ("command", "place"),
    [(each, f"results/{each}_NAME") for each in ("run", "check", "margins", "ensemble", "tune", "identify")]
    + [(each, f"results/{each}_NAME") for each in ("workspace", "excite", "reproduce")]
    + [("build", "the current folder"), ("export", "the current folder"), ("frf", "the record's folder")],
)
def test_help_names_the_default_folder(command: str, place: str) -> None:
    assert place in " ".join(invoke(command, "--help", columns=300).stdout.split())


def test_a_second_ensemble_in_a_folder_is_refused_while_the_first_runs(tmp_path: Path) -> None:
    """Expected: told that another one writes there, not to resume it; a process that has ended holds nothing."""
    lines = ["import time", "from pathlib import Path", "from gough_stewart.model.process.files import reserved"]
    lines += ["with reserved(Path('.')):", "    print('ready', flush=True)", "    time.sleep(60)"]
    command = [sys.executable, "-c", "\n".join(lines)]
    first = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    first.stdout.readline()
    second = ("ensemble", "heave_tolerances", "--members", "3", "--workers", "1", "--set", "loop.duration=0.1")
    try:
        done = invoke(*second, "--out", str(tmp_path))
    finally:
        first.kill()
        first.communicate()
    assert done.exit_code == ExitCode.FAILED
    assert "another command is writing there; wait for its end" in done.stderr
    assert "--resume" not in done.stderr
    assert list(tmp_path.iterdir()) == []
    assert invoke(*second, "--set", "reference.at=0.01", "--out", str(tmp_path)).exit_code == 0


def test_a_greek_mu_is_a_micro_sign() -> None:
    """Expected: the same length with either; they look alike."""
    assert [number(f"10 {sign}m", "m") for sign in "\u00b5\u03bcu"] == [pytest.approx(1e-5)] * 3


def test_a_full_folder_of_temporary_files_is_said(fmus: dict[str, Fmu], monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the folder, and TMPDIR as the remedy; the unit itself is fine."""

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("zipfile.ZipFile.extractall", full)
    with pytest.raises(PlantError, match=r"cannot be unpacked in .*No space left on device.*set TMPDIR") as caught:
        UnitFile(fmus["3.0"].path)
    assert "gough-stewart build" not in str(caught.value)


def test_a_search_that_is_interrupted_before_its_first_candidate_is_exit_code_130(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: interrupted, not "no candidate meets the conditions"."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gough_stewart.harness.tuning.candidates.Candidates.evaluate", interrupted)
    done = invoke(*TUNE, *BANDWIDTH, "--set", "loop.duration=0.3", "--out", str(tmp_path / "out"))
    assert (done.exit_code, done.stderr) == (ExitCode.INTERRUPTED, "interrupted; nothing written\n")

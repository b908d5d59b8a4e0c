"""The command line as a user meets it: files, tables, and one clear line for what goes wrong."""

import json
import os
import signal
import subprocess
import sys
from functools import partial
from html import unescape
from io import BytesIO
from pathlib import Path

import polars
import pytest
from PIL import Image
from typer.testing import CliRunner

from gough_stewart.harness.cli import app as cli
from gough_stewart.harness.paper.agreement import Row
from gough_stewart.model import interface
from gough_stewart.model.platform_toml import preset_names, preset_text

COMMAND = [sys.executable, "-c", "from gough_stewart.harness.cli.entry import main; main()"]
FILES = {
    "open_loop.csv",
    "figure-4.png",
    "figure-5.png",
    "figure-6.png",
    "figure-7.png",
    "drift.png",
    "report.md",
    "report.json",
    "gough_stewart_fmi2.fmu",
    "gough_stewart_fmi3.fmu",
}


def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, on a wide terminal without colours."""
    env = {**os.environ, "COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, cwd=cwd, env=env, check=False)


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    out = tmp_path_factory.mktemp("reproduce") / "new" / "folder"
    return run("reproduce", "--out", str(out)), out


def test_reproduce_succeeds_and_writes_its_files_and_no_others(
    reproduced: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    done, out = reproduced
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == FILES


def test_reproduce_prints_the_tables(reproduced: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    text = reproduced[0].stdout
    for title in (
        "Open-loop case of Liu",
        "Agreement of the formulations",
        "Drift of Kane's DAE",
        "What the scan left",
    ):
        assert title in text
    assert "MISSED" not in text


def test_table_has_101_rows_and_the_promised_columns(
    reproduced: tuple[subprocess.CompletedProcess[str], Path],
) -> None:
    table = polars.read_csv(reproduced[1] / "open_loop.csv")
    assert table.columns == ["time", *interface.RESULT_COLUMNS]
    assert table.height == 101
    assert table["time"][100] == 1.0
    assert table["position[3]"][0] == 3.0


@pytest.mark.parametrize("name", sorted(f for f in FILES if f.endswith("png")))
def test_figures_are_pictures_with_something_on_them(
    reproduced: tuple[subprocess.CompletedProcess[str], Path], name: str
) -> None:
    with Image.open(BytesIO((reproduced[1] / name).read_bytes())) as picture:
        assert picture.width >= 800
        assert picture.height >= 500
        colours = picture.convert("RGB").getcolors(maxcolors=1 << 24)
    assert colours is not None
    assert len(colours) > 50


def test_report_data_and_page_say_the_same(reproduced: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    out = reproduced[1]
    report = json.loads((out / "report.json").read_text())
    page = (out / "report.md").read_text()
    assert all(row["holds"] for row in report["agreement"])
    assert {"python", "numpy", "scipy", "casadi", "gough-stewart"} <= report["versions"].keys()
    for row in report["agreement"]:
        assert row["what"] in page
        assert f"{row['measured']:.2e}" in page
    for reading in report["readings"]:
        assert reading["other"] in page
    assert "not near balance" in page


def test_two_runs_write_the_same_bytes(
    reproduced: tuple[subprocess.CompletedProcess[str], Path], tmp_path: Path
) -> None:
    again = run("reproduce", "--out", str(tmp_path))
    assert again.returncode == 0
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (reproduced[1] / name).read_bytes(), name


def test_reproduce_takes_the_other_order(tmp_path: Path) -> None:
    done = run("reproduce", "--order", "minus-first", "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "− before +" in json.loads((tmp_path / "report.json").read_text())["case"]["title"]


def test_reproduce_takes_a_platform_of_ones_own_and_shows_it_on_a_page(tmp_path: Path) -> None:
    """Expected: the title, the platform and every comparison of the report, on the page as in the data."""
    mine = tmp_path / "mine.toml"
    mine.write_text(run("presets", "motion_base").stdout.replace('name = "motion_base"', 'name = "mine"'))
    done = run("reproduce", "--platform", str(mine), "--report", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["case"]["platform"] == "mine"
    assert report["readings"] == []
    page = unescape((tmp_path / "out" / "report.html").read_text())
    assert f"<title>{report['case']['title']}</title>" in page
    assert [row["what"] for row in report["agreement"] if row["what"] not in page] == []
    assert "scan" not in done.stdout


def test_presets_are_listed_and_printed() -> None:
    listed = run("presets")
    assert all(name in listed.stdout for name in preset_names())
    assert run("presets", "liu2000").stdout == preset_text("liu2000")


@pytest.mark.parametrize("arguments", [["--help"], ["reproduce", "--help"], ["presets", "-h"], []])
def test_help_teaches(arguments: list[str]) -> None:
    done = run(*arguments)
    assert "Usage" in done.stdout + done.stderr


def test_help_of_reproduce_shows_examples_and_choices() -> None:
    text = run("reproduce", "--help").stdout
    assert "plus-first|minus-first" in text
    assert "gough-stewart reproduce --order minus-first" in text


def test_version() -> None:
    assert run("--version").stdout.startswith("gough-stewart 0.")


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
def test_wrong_input_gets_one_clear_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    text = preset_text("liu2000")
    (tmp_path / "heavy.toml").write_text(text.replace("platform_mass = 10.0", "platform_mass = -10.0"))
    (tmp_path / "typo.toml").write_text(text.replace("platform_mass", "platfom_mass"))
    (tmp_path / "broken.toml").write_text("= 3")
    (tmp_path / "huge.toml").write_text(text.replace("platform_mass = 10.0", "platform_mass = " + "9" * 400))
    (tmp_path / "taken" / "report.md").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 1
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr + done.stdout
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["reproduce", "--preset", "liu2000", "--platform", "heavy.toml"], "exclude each other"),
        (["reproduce", "--preset", "motion_base", "--order", "plus-first"], "--order is a reading of the paper's own"),
        (["run", "heave_step", "--set", "x"], "--set x: expected key=value"),
        (["run", "heave_step", "--set", "title.x=1"], "title is no table of the experiment"),
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
    done = CliRunner(env={"COLUMNS": "200"}).invoke(cli.app, arguments)
    assert done.exit_code == 2
    assert message in done.output
    assert list(tmp_path.iterdir()) == []


def test_a_name_full_of_markup_is_only_a_name(tmp_path: Path) -> None:
    """Expected: names are texts to the terminal, to Markdown and to the figures, in any script."""
    name = "a [red]b[/nope] $\\frac{c$ <b> 台"
    text = (
        preset_text("liu2000")
        .replace('name = "liu2000"', f"name = '{name}'")
        .replace("leg_upper_mass = 1.0", "leg_upper_mass = 1.1")
    )
    (tmp_path / "odd.toml").write_text(text)
    done = run("reproduce", "--platform", "odd.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr.strip() == ""
    assert "[red]b[/nope]" in done.stdout
    # CommonMark: a backslash makes any punctuation a plain character
    page = (tmp_path / "out" / "report.md").read_text()
    assert "a \\[red\\]b\\[/nope\\] \\$\\\\frac\\{c\\$ \\<b\\> 台" in page


def test_a_terminal_without_unicode_gets_no_traceback(tmp_path: Path) -> None:
    env = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii", "TERM": "dumb"}
    command = [*COMMAND, "reproduce", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, env=env, check=False, cwd=tmp_path)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr


def test_an_unknown_choice_is_a_usage_error() -> None:
    done = run("reproduce", "--order", "sideways")
    assert done.returncode == 2
    assert "plus-first" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_plant_that_cannot_pass_says_so_and_writes_nothing(tmp_path: Path) -> None:
    """Expected: with the start turned by −0.1 − 1.5 rad the mechanism stands beside its singular pose."""
    (tmp_path / "turned.toml").write_text(
        preset_text("liu2000").replace("home_orientation = [0.0, 0.0, 0.0]", "home_orientation = [0.0, 0.0, -1.5]")
    )
    done = run("reproduce", "--platform", "turned.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 1
    assert "singular pose" in done.stderr
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_with_one_line_and_no_files(tmp_path: Path) -> None:
    """Expected: exit code 130; the signal comes when Kane's equations begin, however fast the machine is."""
    code = [
        "import os, signal",
        "from gough_stewart.harness.cli import app",
        "from gough_stewart.harness.paper import reproduce",
        "run_kane = reproduce.run_kane",
        "def interrupted(*arguments, **options):",
        "    os.kill(os.getpid(), signal.SIGINT)",
        "    return run_kane(*arguments, **options)",
        "reproduce.run_kane = interrupted",
        "app.main()",
    ]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(code), "reproduce", "--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "TERM": "dumb"},
        # a test run in the background may have been told to ignore it
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    assert done.returncode == 130
    assert "interrupted; nothing written" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_missed_bound_exits_with_1_after_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "gough_stewart.harness.paper.reproduce.agreement", lambda *_: [Row("made to miss", 1.0, 1e-9, "m")]
    )
    done = CliRunner().invoke(cli.app, ["reproduce", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "a comparison misses its bound" in done.output
    assert {p.name for p in tmp_path.iterdir()} == FILES
    assert "MISSED" in (tmp_path / "report.md").read_text()


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    done = CliRunner().invoke(cli.app, ["reproduce", "--out", str(tmp_path / "out")])
    assert done.exit_code == 1
    assert "no permission to write" in done.output


def test_a_full_disk_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", str(tmp_path / "open_loop.csv"))

    monkeypatch.setattr("gough_stewart.model.files.write_whole", full)
    done = CliRunner().invoke(cli.app, ["reproduce", "--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "No space left on device" in done.output
    assert list(tmp_path.iterdir()) == []

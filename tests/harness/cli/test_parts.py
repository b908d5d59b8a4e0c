"""What commands share: paths and folders by default, progress, errors, the order of the help."""

import io
import logging
import re
import time
from pathlib import Path

import pytest
import typer
from rich.console import Console

import gough_stewart as gs
from gough_stewart import GoughStewartError
from gough_stewart.harness.cli import terminal
from gough_stewart.harness.cli.command import Command, clear_errors
from gough_stewart.harness.cli.options import (
    chosen_platform,
    log_folder,
    path,
    platform_folder,
    results_folder,
)
from gough_stewart.harness.errors import MissedError, UsageError
from gough_stewart.model.platform import platform_to_toml
from tests.support.uneven import UNEVEN


def test_a_path_may_begin_at_home_and_is_never_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/of me")
    assert path("~/x") == Path("/home/of me/x")
    assert path("a/~/x") == Path("a/~/x")
    assert path("~no_such_user_here/x") == Path("~no_such_user_here/x")
    with pytest.raises(typer.BadParameter, match=r"is empty; expected a path, or \. for the current folder"):
        path("")


@pytest.mark.parametrize(
    ("given", "folder"),
    [
        ("circle", "run_circle"),
        ("circle.toml", "run_circle.toml"),
        ("./circle", "run_circle"),
        ("a/mine.toml", "run_mine"),
        ("a/b.c.toml", "run_b.c"),
        ("mine", "run_mine"),
    ],
)
def test_folders_of_experiments(given: str, folder: str) -> None:
    """Expected: results/COMMAND_NAME; a file named like what ships keeps its suffix."""
    assert results_folder("run", given) == Path("results", folder)
    assert results_folder("run", given, "_x") == Path("results", folder + "_x")


def test_folders_of_platforms_and_logs(tmp_path: Path) -> None:
    assert platform_folder("excite", None, None) == Path("results/excite_liu2000")
    assert platform_folder("excite", "motion_base", None) == Path("results/excite_motion_base")
    assert platform_folder("excite", None, Path("a/motion_base.toml")) == Path("results/excite_motion_base.toml")
    assert platform_folder("excite", None, Path("a/own.toml")) == Path("results/excite_own")
    (tmp_path / "run.1").mkdir()
    for name in ("record.parquet", "record.csv", ""):
        assert log_folder("identify", tmp_path / "run.1" / name) == Path("results/identify_run.1")
    assert log_folder("identify", tmp_path / "log.7.csv") == Path("results/identify_log.7")
    assert log_folder("identify", tmp_path / "other.parquet") == Path("results/identify_other")


def test_texts_are_shown_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: no markup, emoji or highlighting, control characters made visible; newlines and tabs stay."""
    terminal.Terminal().say("[b]x[/b] :smile: \x1b[31m", ("12", "bold"), "\u202e\x1b\x9b")
    out, err = capsys.readouterr()
    assert (out, err) == ("[b]x[/b] :smile: \ufffd[31m12\ufffd\ufffd\ufffd\n", "")
    terminal.Terminal().say("a\nc\x00\x1f\x7f\u2028\u2066")
    assert capsys.readouterr().out == "a\nc" + "\ufffd" * 5 + "\n"
    terminal.warn("[x] take care")
    assert capsys.readouterr().err == "warning: [x] take care\n"


class OwnError(GoughStewartError):
    """Of no kind."""


def with_note(error: Exception) -> Exception:
    error.add_note("the record is written")
    error.add_note("missing: pose.png")
    return error


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (OwnError("failed"), 1, "error: failed"),
        (UsageError("wrong"), 2, "error: wrong"),
        (MissedError("missed"), 3, "error: missed"),
        (with_note(OwnError("failed")), 1, "error: failed; the record is written; missing: pose.png"),
        (OSError(28, "No space left", "a/b.csv"), 1, "error: a/b.csv: No space left"),
        (OSError("only words"), 1, "error: output: only words"),
        (
            MemoryError(),
            1,
            "error: not enough memory; make the run shorter, its plant_step longer, or the grid coarser",
        ),
        (KeyboardInterrupt(), 130, "interrupted; nothing written"),
        (with_note(KeyboardInterrupt()), 130, "interrupted; the record is written; missing: pose.png"),  # type: ignore[arg-type]
    ],
)
def test_an_error_is_a_line_and_an_exit_code(
    error: Exception, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as caught, clear_errors():
        raise error
    assert caught.value.exit_code == code
    assert capsys.readouterr() == ("", said + "\n")


def test_remarks_of_functions_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: what the module on temporary files remarks, such as leftovers that it removed, but no details."""
    log = logging.getLogger("gough_stewart.model.process.files")
    log.info("removed %d leftovers", 3)
    log.debug("and more")
    assert capsys.readouterr().err == "removed 3 leftovers\n"


def test_progress_is_shown_on_the_error_stream_if_that_is_a_terminal() -> None:
    """Expected: task, bar and duration; of members also their number, speed over a minute, and the time left."""
    texts = []
    for bar in (terminal.progress_bar(), terminal.progress_bar(of_members=True)):
        assert (bar.console.stderr, bar.disable, bar.live.transient) == (True, not terminal.errors.is_terminal, True)
        bar.update(bar.add_task("[red]seven", total=40), completed=10)
        console = Console(width=100, color_system=None, file=io.StringIO(), markup=False)
        console.print(bar.make_tasks_table(bar.tasks))
        texts.append(" ".join(console.file.getvalue().split()))  # type: ignore[attr-defined]
    assert re.fullmatch(r"\[red\]seven \S+ (\S+ )?0:00:0\d", texts[0])
    assert re.fullmatch(r"\[red\]seven \S+ (\S+ )?10/40 (\d+ members/s )?0:00:0\d left \S+", texts[1])
    assert bar.speed_estimate_period == 60


@pytest.mark.parametrize(
    ("size", "seconds", "said"),
    [
        (0, 0.04, "Done in 0.0 s. Wrote x.csv (0 kB)."),
        (12345, 59.9, "Done in 59.9 s. Wrote x.csv (12.3 kB)."),
        (2_345_678, 125.4, "Done in 2 min 5 s. Wrote x.csv (2.3 MB)."),
    ],
)
def test_closing_lines_have_time_and_size(
    size: int, seconds: float, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.csv").write_bytes(bytes(size))
    Command(time.perf_counter() - seconds).close(["x.csv"], tmp_path, then="look")
    assert capsys.readouterr().out.replace(f"{tmp_path}/", "") == f"{said}\nNext: look\n"


def test_what_is_odd_in_a_platform_file_is_a_warning_with_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own.toml").write_text(platform_to_toml(UNEVEN))
    found = chosen_platform(None, tmp_path / "own.toml")
    assert found == UNEVEN
    assert capsys.readouterr().err == "".join(f"warning: {tmp_path}/own.toml: {hint}\n" for hint in found.hints)
    assert chosen_platform(None, None) == gs.load_preset("liu2000")

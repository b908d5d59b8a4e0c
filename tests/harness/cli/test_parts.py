"""What commands share: paths and folders by default, progress, errors, the order of the help."""

import gc
import io
import logging
import re
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from gough_stewart.harness.cli import app, terminal
from gough_stewart.harness.cli.command import clear_errors, duration_text, size_text, wrong_use_if
from gough_stewart.harness.cli.options import (
    chosen_experiment,
    chosen_platform,
    chosen_targets,
    log_folder,
    path,
    platform_folder,
    results_folder,
)
from gough_stewart.harness.errors import MissedError, UsageError
from gough_stewart.model.errors import GoughStewartError
from gough_stewart.model.platform import load_preset, platform_to_toml
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


def test_a_platform_is_the_papers_a_preset_or_a_file_with_its_hints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: the platform that was asked for; what is odd in a file is a warning with its name."""
    own = tmp_path / "own.toml"
    own.write_text(platform_to_toml(UNEVEN))
    assert chosen_platform(None, None) == load_preset("liu2000")
    assert chosen_platform("desktop_hexapod", None) == load_preset("desktop_hexapod")
    found = chosen_platform(None, own)
    assert found == UNEVEN
    warned = [line for line in capsys.readouterr().err.replace("\n", "\0").split("\0") if line]
    assert len(warned) == len(found.hints)
    assert all(line == f"warning: {own}: {hint}" for line, hint in zip(warned, found.hints, strict=True))
    with pytest.raises(UsageError, match="--preset and --platform exclude each other; give one"):
        chosen_platform("liu2000", own)
    with pytest.raises(UsageError, match="no such preset"):
        chosen_platform("nope", None)
    assert chosen_targets(None) == ["native"]
    assert chosen_targets(["all", "x86_64-linux"]) == ["all", "x86_64-linux"]
    with pytest.raises(UsageError, match="no target 'nope'"):
        chosen_targets(["x86_64-linux", "nope"])
    assert chosen_experiment("circle", ["loop.delay=2", "loop.delay=3"], no_python=True).loop.delay == 3


def forced(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> terminal.Terminal:
    console = terminal.Terminal(stderr=True)
    console._force_terminal = is_terminal
    console.file = io.StringIO()
    monkeypatch.setattr(terminal, "errors", console)
    return console


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_on_the_error_stream_if_that_is_a_terminal(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: task, bar and duration; of members also their number, speed over a minute, and the time left."""
    console = forced(monkeypatch, is_terminal)
    one, many = terminal.progress_bar(), terminal.members_bar()
    for bar in (one, many):
        assert bar.console is console
        assert bar.disable is not is_terminal
        assert bar.live.transient
    assert one.live.refresh_per_second == 4
    assert many.speed_estimate_period == 60
    for bar in (one, many):
        bar.update(bar.add_task("[red]seven", total=40), completed=10)
    texts = []
    for bar in (one, many):
        with console.capture() as shown:
            console.print(bar.make_tasks_table(bar.tasks))
        texts.append(" ".join(re.sub(r"\x1b\[[0-9;]*m", "", shown.get()).split()))
    assert re.fullmatch(r"\[red\]seven \S+ (\S+ )?0:00:0\d", texts[0])
    assert re.fullmatch(r"\[red\]seven \S+ (\S+ )?10/40 (\d+ members/s )?0:00:0\d left \S+", texts[1])
    assert terminal.errors.stderr


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


def test_only_the_errors_named_are_wrong_usage() -> None:
    with pytest.raises(UsageError, match="as it was"), wrong_use_if(MissedError, OwnError):
        raise OwnError("as it was")
    with pytest.raises(MissedError), wrong_use_if(OwnError):
        raise MissedError("x")


def test_remarks_of_functions_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: what the module on temporary files remarks, such as leftovers that it removed, but no details."""
    log = logging.getLogger("gough_stewart.model.process.files")
    log.info("removed %d leftovers", 3)
    log.debug("and more")
    assert capsys.readouterr().err == "removed 3 leftovers\n"


def test_durations_and_sizes_as_text() -> None:
    assert [duration_text(seconds) for seconds in (0.04, 59.9, 125.4)] == ["0.0 s", "59.9 s", "2 min 5 s"]
    sizes = (0, 1500, 12345, 999_999, 1_000_000, 2_345_678)
    assert [size_text(size) for size in sizes] == ["0 kB", "1.5 kB", "12.3 kB", "1e+03 kB", "1.0 MB", "2.3 MB"]


def test_the_process_collects_garbage_seldom_and_shows_what_it_cannot_encode(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: an alpha in a terminal of ASCII is a question mark; the command line is then run."""
    before, called = gc.get_threshold(), []
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii") for _ in range(2)]
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    monkeypatch.setattr(app, "app", lambda: called.append(gc.get_threshold()))
    try:
        app.main()
    finally:
        gc.set_threshold(*before)
    assert called == [(200_000, 30, 30)]
    for stream in streams:
        stream.write("α")
        stream.flush()
        raw: Any = stream.buffer
        assert raw.getvalue() == b"?"

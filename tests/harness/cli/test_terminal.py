"""What reaches the terminal: texts are only texts, streams may be full, and the process may be asked to end."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from gough_stewart.harness.cli import app as cli
from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.terminal import Terminal
from gough_stewart.harness.results.record import read_record

COMMAND = [sys.executable, "-c", "from gough_stewart.harness.cli.entry import main; main()"]
SHORT = ("--set", "loop.duration=0.02", "--set", "change=[]")


def invoke(*arguments: str) -> Result:
    """In this process, on a wide terminal without colours."""
    return CliRunner(env={"COLUMNS": "300", "NO_COLOR": "1", "TERM": "dumb"}).invoke(cli.app, list(arguments))


def started(code: str, *arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    """Lines of Python in a process of its own, with arguments, and with Ctrl-C as a shell leaves it."""
    done: subprocess.CompletedProcess[str] = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        text=True,
        check=False,
        env={**os.environ, "TERM": "dumb"},
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        **({"capture_output": True} | options),  # type: ignore[call-overload]
    )
    return done


def test_titles_and_folders_may_hold_markup_emoji_codes_and_control_characters(tmp_path: Path) -> None:
    """Expected: every character as it is, but for control characters, which are shown and not obeyed."""
    title = "a [/b] [mm] :x: \x1b[31m\x9b\u202e"
    setting = "title=" + json.dumps(title)
    folder = tmp_path / "out [bold] \x1b[2J"
    done = invoke("margins", "heave_step", "--set", setting, "--out", str(folder))
    assert done.exit_code == 0, done.output
    assert "a [/b] [mm] :x: �[31m��" in done.output
    assert f"Wrote to {tmp_path}/out [bold] �[2J" in done.output
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", done.output)


def test_errors_with_control_characters_are_shown_not_obeyed() -> None:
    done = invoke("run", "no\x1b[31mthing.toml")
    assert done.exit_code == 1
    assert "no�[31mthing.toml: cannot read this experiment" in done.output


@pytest.fixture
def full() -> Iterator[int]:
    """A device that takes nothing."""
    device = os.open("/dev/full", os.O_WRONLY)
    yield device
    os.close(device)


MAIN = "from gough_stewart.harness.cli.entry import main; main()"


def test_a_full_error_stream_costs_no_file(tmp_path: Path, full: int) -> None:
    """Expected: what a run with an error stream that works gives: exit code, files, table."""
    arguments = ("run", "heave_step", *SHORT, "--out", str(tmp_path / "out"))
    done = started(MAIN, *arguments, capture_output=False, stdout=subprocess.PIPE, stderr=full)
    assert done.returncode == 0
    assert "record.parquet, record.csv" in done.stdout
    assert read_record(tmp_path / "out").table.height == 21


@pytest.mark.parametrize("arguments", [("--help",), ("presets",), ("experiments", "heave_step")])
def test_a_full_output_is_one_line(arguments: tuple[str, ...], full: int) -> None:
    done = started(MAIN, *arguments, capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "ignored" not in done.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_an_interrupt_while_modules_load_is_one_line(name: str) -> None:
    """Expected: exit code 130; the signal comes while the command line itself is imported."""
    lines = [
        "import builtins, os, signal",
        # nohup ignores it, and processes inherit that
        "signal.signal(signal.SIGHUP, signal.SIG_DFL)",
        "load = builtins.__import__",
        "def interrupted(name, *more):",
        "    if name == 'gough_stewart.harness.cli.app' or name.endswith('.cli') and 'app' in (more[2] or ()):",
        "        builtins.__import__ = load",
        f"        os.kill(os.getpid(), signal.{name})",
        "    return load(name, *more)",
        "builtins.__import__ = interrupted",
        MAIN,
    ]
    done = started("\n".join(lines), "presets")
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted; nothing written\n")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_an_interrupt_in_a_module_that_turns_it_into_an_error_of_its_own_waits(name: str, tmp_path: Path) -> None:
    """Expected: one line, exit code 130; extension modules say "initialization failed", as this module does."""
    brittle = ["import os, signal, time", "try:", f"    os.kill(os.getpid(), signal.{name})", "    time.sleep(0.05)"]
    brittle += ["except KeyboardInterrupt as error:", "    raise ImportError('initialization failed') from error"]
    (tmp_path / "brittle.py").write_text("\n".join(brittle))
    lines = ["import builtins, sys, time", f"sys.path.insert(0, {str(tmp_path)!r})", "load = builtins.__import__"]
    lines += ["def loading(name, *more):", "    if name.endswith('.cli') and 'app' in (more[2] or ()):"]
    lines += ["        builtins.__import__ = load", "        import brittle", "    return load(name, *more)"]
    lines += ["builtins.__import__ = loading", MAIN]
    # long enough that it has not ended when the signal comes again
    done = started("\n".join(lines), "margins", "heave_step", "--out", str(tmp_path / "margins"))
    assert (done.returncode, done.stderr) == (130, "interrupted; nothing written\n")


def test_an_interrupt_in_a_finaliser_is_not_lost() -> None:
    """Expected: one line, exit code 130, although Python can only ignore what a finaliser raises."""
    lines = ["import os, signal, time", "class Held:", "    def __del__(self):"]
    lines += ["        os.kill(os.getpid(), signal.SIGINT)", "        time.sleep(0.01)"]
    lines += ["from gough_stewart.harness.cli import app, entry", "def work():", "    Held()", "    time.sleep(5)"]
    lines += ["app.main = work", "entry.main()"]
    done = started("\n".join(lines))
    assert (done.returncode, done.stderr) == (130, "interrupted; nothing written\n")


def test_an_interrupt_between_import_and_start_is_one_line() -> None:
    lines = ["import os, signal", "from gough_stewart.harness.cli.entry import main"]
    lines += ["os.kill(os.getpid(), signal.SIGINT)", "main()"]
    done = started("\n".join(lines), "experiments")
    assert done.returncode in (0, 130)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_while_the_process_ends_changes_nothing(name: str) -> None:
    """Expected: the code and output of the command; the signal comes after its last line is flushed."""
    lines = ["import os, signal", "from gough_stewart.harness.cli import entry", "end = entry._flushed"]
    lines += [f"entry._flushed = lambda code: (end(code), os.kill(os.getpid(), signal.{name}))[0]", "entry.main()"]
    done = started("\n".join(lines), "--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("gough-stewart ")


def test_a_run_starts_no_process(tmp_path: Path) -> None:
    """Expected: all files, though no process can be started: none can be left behind."""
    lines = ["import os, subprocess", "def refused(*_, **__):", "    raise AssertionError('started a process')"]
    lines += ["subprocess.Popen = os.fork = refused", MAIN]
    done = started("\n".join(lines), "run", "heave_step", *SHORT, "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "metrics.json").is_file()


def test_a_wish_to_end_keeps_what_ran_so_far(tmp_path: Path) -> None:
    """Expected: as after Ctrl-C: exit code 130, and a record that says so."""
    lines = ["import os, signal", "def controller(sample):", "    if sample.time > 0.0195:"]
    lines += ["        os.kill(os.getpid(), signal.SIGTERM)", "    return [4078.57] * 6"]
    (tmp_path / "stopping.py").write_text("\n".join(lines))
    (tmp_path / "mine.toml").write_text(
        """
        title = "a law that holds still, and is ended"
        platform.preset = "motion_base"
        reference.type = "hold"
        controller = { type = "python", file = "stopping.py" }
        loop.duration = "100 s"
        """
    )
    done = started(MAIN, "run", "mine.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert "interrupted at" in done.stderr
    assert read_record(tmp_path / "out").metadata["outcome"]["status"] == "interrupted"


def test_an_interrupt_after_the_files_says_where_they_are(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    def interrupted() -> None:
        with clear_errors() as command:
            command.written.append(tmp_path)
            raise KeyboardInterrupt

    with pytest.raises(typer.Exit):
        interrupted()
    assert capsys.readouterr().err.replace("\n", "") == f"interrupted; the files are in {tmp_path}"


def test_too_little_memory_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit), clear_errors():
        raise MemoryError
    assert capsys.readouterr().err.startswith("error: not enough memory; ")


def test_a_line_is_not_broken_however_narrow_the_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    Terminal().say("word " * 100, ("styled", "bold"))
    assert capsys.readouterr().out.count("\n") == 1

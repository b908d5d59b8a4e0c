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

import gough_stewart as gs
from gough_stewart.harness.cli.terminal import Terminal
from tests.support.commands import invoke

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and streams of POSIX")
SHORT = ("--set", "loop.duration=0.02", "--set", "change=[]")
MAIN = "from gough_stewart.harness.cli.entry import main; main()"
NOTHING = "interrupted; nothing written\n"


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
    setting = "title=" + json.dumps("a [/b] [mm] :x: \x1b[31m\x9b\u202e")
    folder = tmp_path / "out [bold] \x1b[2J"
    done = invoke("margins", "heave_step", "--set", setting, "--out", str(folder), columns=300)
    assert done.exit_code == 0, done.output
    assert "a [/b] [mm] :x: �[31m��" in done.output
    assert f"Wrote to {tmp_path}/out [bold] �[2J" in done.output
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", done.output)
    done = invoke("run", "no\x1b[31mthing.toml")
    assert done.exit_code == 1
    assert "no�[31mthing.toml: cannot read this experiment" in done.output


def test_a_line_is_not_broken_however_narrow_the_terminal_is(capsys: pytest.CaptureFixture[str]) -> None:
    Terminal().say("word " * 100, ("styled", "bold"))
    assert capsys.readouterr().out.count("\n") == 1


@pytest.fixture
def full() -> Iterator[int]:
    """A device that takes nothing."""
    device = os.open("/dev/full", os.O_WRONLY)
    yield device
    os.close(device)


def test_a_full_error_stream_costs_no_file(tmp_path: Path, full: int) -> None:
    """Expected: what a run with an error stream that works gives: exit code, files, table."""
    arguments = ("run", "heave_step", *SHORT, "--out", str(tmp_path / "out"))
    done = started(MAIN, *arguments, capture_output=False, stdout=subprocess.PIPE, stderr=full)
    assert done.returncode == 0
    assert "record.parquet, record.csv" in done.stdout
    assert gs.read_record(tmp_path / "out").table.height == 21


@pytest.mark.parametrize("arguments", [("--help",), ("presets",)])
def test_a_full_output_is_one_line(arguments: tuple[str, ...], full: int) -> None:
    done = started(MAIN, *arguments, capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert not re.search("Traceback|ignored", done.stderr)


# An extension module that turns an interrupt into an error of its own, while the command line is imported.
BRITTLE = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.{0})
    time.sleep({1})
except KeyboardInterrupt as error:
    raise ImportError("initialization failed") from error
"""
LOADING = """
import builtins
load = builtins.__import__
def loading(name, *more):
    if name.endswith(".cli") and "app" in (more[2] or ()):
        builtins.__import__ = load
        import brittle
    return load(name, *more)
builtins.__import__ = loading
"""
# The command line is replaced by lines.
WORK = """
import os, signal, sys, time
from gough_stewart.harness.cli import app, command, entry
def work():
    {lines}
app.main = work
entry.main()
"""
HELD = "type('Held', (), {{'__del__': lambda self: ({0})}})()"
INTERRUPT = "os.kill(os.getpid(), signal.SIGINT)"
FLUSHED = "end = entry._flushed; entry._flushed = lambda code: (end(code), os.kill(os.getpid(), signal.{0}))[0]"
# Lines of Python, the exit code, and the error stream.
ENDS: dict[str, tuple[str, int, str]] = {
    **{f"{name} while modules load": (LOADING + MAIN, 130, NOTHING) for name in ("SIGINT", "SIGTERM")},
    "between import and start": (f"import os, signal; {MAIN.replace('main()', INTERRUPT + '; main()')}", 130, NOTHING),
    "in a finaliser": (WORK.format(lines=f"{HELD.format(INTERRUPT)}; time.sleep(5)"), 130, NOTHING),
    "after files": (
        WORK.format(lines=f"command.Command.latest.written.append('a/b'); {INTERRUPT}"),
        *(130, "interrupted; the files are in a/b\n"),
    ),
    "of nohup": (WORK.format(lines="os.kill(os.getpid(), signal.SIGHUP); sys.exit(3)"), 3, ""),
    **{
        f"{name} when all is done": (WORK.replace("app.main", FLUSHED.format(name) + "\napp.main").format(lines="pass"),
                                     0, "")
        for name in ("SIGINT", "SIGTERM")
    },
    "during the exit": (
        WORK.format(lines="try: sys.exit(3)\n    except SystemExit: raise KeyboardInterrupt"), 3, "",
    ),
    "no output": (WORK.format(lines="raise OSError(28, 'No space left')"), 1, "error: No space left\n"),
    "in a thread": (
        "import importlib, threading\n"
        "one = threading.Thread(target=importlib.import_module, args=['gough_stewart.harness.cli.entry'])\n"
        "one.start(); one.join()", 0, "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("way", ENDS)
def test_how_a_command_line_ends(way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one line or none, and the code; signals come again until imports are over, or are too late."""
    lines, code, said = ENDS[way]
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "brittle.py").write_text(BRITTLE.format(way.split(maxsplit=1)[0], 0.05))
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n" if way == "of nohup" else ""
    done = started(before + lines, "margins", "heave_step", "--out", "/nowhere/out")
    assert (done.returncode, done.stderr) == (code, said)


def test_an_import_that_takes_too_long_is_interrupted_and_other_lost_errors_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: after the patience, here a tenth of a second, the interrupt itself; an error of a finaliser as ever."""
    lines = "from gough_stewart.harness.cli import entry; entry._Interrupts._PATIENCE = 0.1\n"
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "brittle.py").write_text(BRITTLE.format("SIGINT", 30))
    done = started(lines + LOADING + "entry.main()", "presets")
    assert "initialization failed" in done.stderr
    done = started(WORK.format(lines=HELD.format("1 / 0")))
    assert (done.returncode, "ZeroDivisionError" in done.stderr) == (0, True)


def test_a_run_starts_no_process(tmp_path: Path) -> None:
    """Expected: all files, though no process can be started: none can be left behind."""
    lines = ["import os, subprocess", "def refused(*_, **__):", "    raise AssertionError('started a process')"]
    lines += ["subprocess.Popen = os.fork = refused", MAIN]
    done = started("\n".join(lines), "run", "heave_step", *SHORT, "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "metrics.json").is_file()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_wish_to_end_keeps_what_ran_so_far(name: str, tmp_path: Path) -> None:
    """Expected: exit code 130, all files, marked as interrupted."""
    lines = ["import os, signal", "def controller(sample):", "    if sample.time > 0.0195:"]
    lines += [f"        os.kill(os.getpid(), signal.{name})", "    return [4078.57] * 6"]
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
    assert "Traceback" not in done.stderr
    record = gs.read_record(tmp_path / "out")
    assert record.metadata["outcome"]["status"] == "interrupted"
    assert record.table.height in (20, 21)

"""Commands in processes of their own: what they import, streams, signals, locales, and unusual surroundings."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.fmu_plants import Fmu

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals, streams, locales and bytes in names are POSIX's")
SHORT = ("--set", "loop.duration=0.02", "--set", "reference.at=0.01", "--set", "change=[]")
MAIN = "from gough_stewart.harness.cli.entry import main; main()"


def started(
    code: str, *arguments: str, cwd: Path | None = None, environment: Mapping[str, str] | None = None, **streams: Any
) -> subprocess.CompletedProcess[str]:
    """Lines of Python in a process of its own, with arguments, and with Ctrl-C as a shell leaves it."""
    options: dict[str, Any] = {"capture_output": True, **streams}
    done: subprocess.CompletedProcess[str] = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        text=True,
        check=False,
        cwd=cwd,
        env={**os.environ, "TERM": "dumb", **(environment or {})},
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
        **options,
    )
    return done


# --- what is imported, instead of timings, which vary ----------------------------------------------------------------

# Each takes a tenth of a second or more; all together take two.
SLOW = {"casadi", "control", "fmpy", "lxml", "bokeh", "matplotlib", "polars", "scipy"}
ALL = {*SLOW, "numpy", "pydantic"}
UNTIL_PROGRESS = "import rich.progress; rich.progress.Progress.start = sys.exit"
NO_PROCESS = """
import os, subprocess
def refused(*_, **__):
    raise AssertionError("started a process")
subprocess.Popen = os.fork = refused
"""
GIVEN = """
from gough_stewart.fmu_build.plant import plant_component as c
sources, dependencies = c.Sources({}, {}), {}
c._code, c.slot_dependencies = (lambda _: sources), (lambda _: dependencies)
import gough_stewart.fmu_build.build, gough_stewart.model.kernel
from gough_stewart.model.platform import load_preset
c.plant_component(load_preset('liu2000'))
"""
EACH = """
from gough_stewart.harness.cli.entry import main
for words in sys.argv[1:]:
    sys.argv[1:] = words.split()
    try:
        main()
    except SystemExit as ended:
        assert ended.code in (None, 0, 1, 2), ended.code
"""


def loaded_after(code: str, *commands: str) -> set[str]:
    """Those of `ALL` that a new interpreter has after some code, and after commands one by one."""
    report = "sys.stderr.write('loaded: ' + ' '.join(sys.modules))"
    done = started("\n".join(["import sys", code, *([EACH] if commands else []), report]), *commands)
    assert done.returncode == 0, done.stderr
    return ALL & set(done.stderr.rpartition("loaded: ")[2].split())


@pytest.mark.parametrize(
    ("code", "commands", "most"),
    [
        ("import gough_stewart", (), set()),
        ("", ("--help", "run --help", "run --plnat fmu3"), {"pydantic"}),
        ("", ("presets", "run heave_step --set loop.dely=1"), {"numpy", "pydantic"}),
        (UNTIL_PROGRESS, ("run heave_step --out {}", "view .", "build"), {"numpy", "pydantic"}),
    ],
)
def test_little_is_imported_before_there_is_something_to_see(
    code: str, commands: tuple[str, ...], most: set[str], tmp_path: Path
) -> None:
    """Expected: help and mistyped commands do without numbers, lists without simulation; progress comes first."""
    assert loaded_after(code, *(words.format(tmp_path) for words in commands)) <= most


def test_runs_and_builds_do_without_what_they_do_not_need(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: what has to be traced and compiled is there, as from a wheel; a run with an FMU needs none."""
    none = {"casadi", "control", "matplotlib", "scipy"}
    run = f"run heave_step --set loop.duration=0.01 --out {tmp_path}"
    loaded_after("", run)  # keeps what it compiles
    assert not loaded_after(NO_PROCESS, run) & none
    assert (tmp_path / "metrics.json").is_file()
    assert not loaded_after("", f"{run} --plant fmu3 --fmu {fmus['3.0'].path}") & none
    assert gs.read_record(tmp_path).metadata["plant"] == "fmu3"
    assert not loaded_after(GIVEN) & none


# --- streams ---------------------------------------------------------------------------------------------------------


def test_texts_may_hold_markup_emoji_codes_and_control_characters(tmp_path: Path) -> None:
    """Expected: every character as it is, but for control characters, which are shown and not obeyed."""
    setting = "title=" + json.dumps("a [/b] [mm] :x: \x1b[31m\x9b\u202e")
    folder = tmp_path / "out [bold] \x1b[2J"
    done = invoke("margins", "heave_step", "--set", setting, "--out", str(folder), columns=300)
    assert done.exit_code == 0, done.output
    assert "a [/b] [mm] :x: �[31m��" in done.output
    assert f"Wrote to {tmp_path}/out [bold] �[2J" in done.output
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]", done.output)
    # an error is one line, however narrow the terminal is
    done = invoke("run", "no\x1b[31mthing.toml", columns=30)
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
    assert "no�[31mthing.toml: cannot read this experiment" in done.output


def test_progress_is_shown_on_a_terminal_with_members_and_their_speed(tmp_path: Path) -> None:
    """Expected: on the error stream the number of members, and the time that passed; nothing without a terminal."""
    few = ("--members", "4", "--workers", "1", "--set", "ensemble.worst=0", "--set", "loop.duration=0.02")
    words = ("ensemble", "heave_tolerances", *few, "--out")
    shown = started(MAIN, *words, str(tmp_path / "a"), environment={"FORCE_COLOR": "1", "TERM": "xterm"})
    text = re.sub("\x1b\\[[0-9;?]*[A-Za-z]", "", shown.stderr)
    assert re.search(r"[04]/4.*0:00:0\d left", text), text
    assert "0:00:0" not in invoke(*words, str(tmp_path / "b")).output


@pytest.fixture
def full() -> Iterator[int]:
    """A device that takes nothing."""
    device = os.open("/dev/full", os.O_WRONLY)
    yield device
    os.close(device)


def test_a_full_error_stream_costs_no_file_and_a_full_output_is_one_line(tmp_path: Path, full: int) -> None:
    """Expected: what a run with an error stream that works gives: exit code, files, table."""
    arguments = ("run", "heave_step", *SHORT, "--out", str(tmp_path / "out"))
    done = started(MAIN, *arguments, capture_output=False, stdout=subprocess.PIPE, stderr=full)
    assert (done.returncode, "record.parquet, record.csv" in done.stdout) == (0, True)
    assert gs.read_record(tmp_path / "out").table.height == 21
    done = started(MAIN, "presets", capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, "No space left on device" in done.stderr) == (1, True)
    assert not re.search("Traceback|ignored", done.stderr)


@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)])
def test_closed_streams_change_nothing(closed: tuple[int, ...]) -> None:
    """Expected: exit code 0 and whole files, none of which has taken the place of a stream."""
    command = [sys.executable, "-m", "gough_stewart", "presets", "liu2000"]
    done = started(f"import os, sys; [os.close(k) for k in {closed}]; os.execv(sys.executable, {command!r})")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# --- signals ---------------------------------------------------------------------------------------------------------

NOTHING = "interrupted; nothing written\n"
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
app.app = work
entry.main()
"""
HELD = "type('Held', (), {{'__del__': lambda self: ({0})}})()"
INTERRUPT = "os.kill(os.getpid(), signal.SIGINT)"
LATE = f"end = sys.stdout.flush; sys.stdout.flush = lambda: ({INTERRUPT}, end())"
# Lines of Python, the exit code, and a pattern of the error stream.
ENDS: dict[str, tuple[str, int, str]] = {
    **{f"{name} while modules load": (LOADING + MAIN, 130, NOTHING) for name in ("SIGINT", "SIGTERM")},
    "between import and start": (f"import os, signal; {MAIN.replace('main()', INTERRUPT + '; main()')}", 130, NOTHING),
    "in a finaliser": (WORK.format(lines=f"{HELD.format(INTERRUPT)}; time.sleep(5)"), 130, NOTHING),
    "after files": (
        WORK.format(lines=f"command.Command.latest.written.append('a/b'); {INTERRUPT}"),
        *(130, "interrupted; the files are in a/b\n"),
    ),
    "of nohup": (
        "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        + WORK.format(lines="os.kill(os.getpid(), signal.SIGHUP); sys.exit(3)"), 3, "",
    ),
    "when all is done": (WORK.format(lines=LATE), 0, ""),
    "during the exit": (
        WORK.format(lines="try: sys.exit(3)\n    except SystemExit: raise KeyboardInterrupt"), 3, "",
    ),
    "no output": (WORK.format(lines="raise OSError(28, 'No space left')"), 1, "error: No space left\n"),
    "in a thread": (
        "import importlib, threading\n"
        "one = threading.Thread(target=importlib.import_module, args=['gough_stewart.harness.cli.entry'])\n"
        "one.start(); one.join()", 0, "",
    ),
    "after ten seconds": (
        "from gough_stewart.harness.cli import entry; entry._Interrupts._PATIENCE = 0.1\n" + LOADING + "entry.main()",
        *(1, "(?s).*initialization failed.*"),
    ),
    "in another error": (WORK.format(lines=HELD.format("1 / 0")), 0, "(?s).*ZeroDivisionError.*"),
}  # fmt: skip


@pytest.mark.parametrize("way", ENDS)
def test_how_a_command_line_ends(way: str, tmp_path: Path) -> None:
    """Expected: one line or none, and the code; signals come again until imports are over, or are too late."""
    lines, code, said = ENDS[way]
    name = "SIGTERM" if way.startswith("SIGTERM") else "SIGINT"
    patience = 30 if way == "after ten seconds" else 0.05
    (tmp_path / "brittle.py").write_text(BRITTLE.format(name, patience))
    # a command that computes for a while after its imports
    words = ("margins", "heave_step", "--out", "/nowhere/out")
    done = started(lines, *words, environment={"PYTHONPATH": str(tmp_path)})
    assert done.returncode == code
    assert re.fullmatch(said, done.stderr), done.stderr


def test_a_wish_to_end_keeps_what_ran_so_far(tmp_path: Path) -> None:
    """Expected: exit code 130, all files, marked as interrupted."""
    lines = ["import os, signal", "def controller(sample):", "    if sample.time > 0.0195:"]
    lines += ["        os.kill(os.getpid(), signal.SIGTERM)", "    return [4078.57] * 6"]
    (tmp_path / "stopping.py").write_text("\n".join(lines))
    (tmp_path / "mine.toml").write_text(
        'title = "is ended"\nplatform.preset = "motion_base"\nreference.type = "hold"\nloop.duration = "100 s"\n'
        'controller = { type = "python", file = "stopping.py" }\n'
    )
    done = started(MAIN, "run", "mine.toml", "--out", "out", cwd=tmp_path)
    assert done.returncode == 130, done.stderr
    assert ("interrupted at" in done.stderr, "Traceback" in done.stderr) == (True, False)
    record = gs.read_record(tmp_path / "out")
    assert record.metadata["outcome"]["status"] == "interrupted"
    assert record.table.height in (20, 21)


# --- locales, names, environment -------------------------------------------------------------------------------------


def test_umlauts_in_a_locale_of_ascii_and_the_backend_of_a_notebook_that_is_not_installed(tmp_path: Path) -> None:
    """Expected: folder and title as given, as in cron and containers; figures, though Jupyter sets this."""
    arguments = ("run", "heave_step", *SHORT, "--set", 'title="Größe"', "--out", "umläut")
    odd = {"LC_ALL": "C", "PYTHONUTF8": "0", "MPLBACKEND": "module://no_such_package.backend_inline"}
    done = started(MAIN, *arguments, cwd=tmp_path, environment=odd)
    assert done.returncode == 0, done.stderr
    assert gs.read_record(tmp_path / "umläut").metadata["title"] == "Größe"
    assert (tmp_path / "umläut" / "metrics.json").is_file()


def test_a_folder_that_is_not_utf_8(tmp_path: Path) -> None:
    """Expected: a record there that can be viewed, as in a folder from an archive of another system."""
    place = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9")
    record = gs.run("heave_step", {"loop.duration": 0.3})
    gs.save_record(record, place, report=True)
    assert gs.read_record(place).table.equals(gs.read_record(f"{place}/record.csv").table)
    gs.view(place, f"{place}/page.html")
    found = gs.ensemble("heave_tolerances", {"loop.duration": 0.3}, members=3, workers=1, out=place)
    assert gs.read_ensemble(place).members.equals(found.members)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("POLARS_MAX_THREADS", "0", "POLARS_MAX_THREADS is '0'; expected a number of threads of at least 1; unset it"),
        ("SOURCE_DATE_EPOCH", "abc", "SOURCE_DATE_EPOCH is 'abc'; expected a whole number of seconds since 1970"),
    ],
)
def test_variables_that_libraries_cannot_read_are_refused(name: str, value: str, says: str) -> None:
    """Expected: one line at the command, one error of the package in Python."""
    done = started(MAIN, "run", "heave_step", environment={name: value})
    assert done.returncode == 1
    assert done.stderr.startswith("error: the environment variable " + says)
    assert done.stderr.count("\n") == 1
    code = "import gough_stewart as gs\ntry: gs.run\nexcept gs.GoughStewartError as error: print(error)"
    assert says in started(code, environment={name: value}).stdout

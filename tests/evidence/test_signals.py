"""Slow evidence: Ctrl-C and SIGTERM at random times in every command leave no process, traceback or broken file."""

import ctypes
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytestmark = [pytest.mark.evidence, pytest.mark.skipif(sys.platform != "linux", reason="adopts orphans as Linux does")]

_SHORT = ("--set", "loop.duration=0.3")
_SEARCH = ("--vary", "controller.bandwidth=1..6Hz", "--minimise", "tracking.position.norm_rms")
# Once for all trials: what other commands read.
_INPUTS = (
    ("run", "heave_step", *_SHORT, "--out", "record"),
    ("run", "frequency_response", "--out", "injected"),
    ("run", "excitation", "--set", "loop.duration=5", "--out", "log"),
)
_COMMANDS: tuple[tuple[str, ...], ...] = (
    ("run", "heave_step", *_SHORT, "--out", "out"),
    ("run", "heave_step", *_SHORT, "--report", "--out", "out"),
    ("run", "heave_step", *_SHORT, "--plant", "fmu3", "--out", "out"),
    ("ensemble", "heave_tolerances", "--members", "1100", *_SHORT, "--workers", "2", "--out", "out"),
    ("build", "--out", "out"),
    ("export", "heave_step", "--out", "out"),
    ("check", "circle", "--out", "out"),
    ("margins", "heave_step", "--out", "out"),
    ("view", "{inputs}/record", "--out", "out/page.html"),
    ("frf", "{inputs}/injected", "--out", "out"),
    ("tune", "heave_step", *_SEARCH, "--generations", "2", *_SHORT, "--out", "out"),
    ("workspace", "--points", "21", "--out", "out"),
    ("excite", "--preset", "motion_base", "--trials", "3", "--duration", "10", "--out", "out"),
    ("identify", "{inputs}/log", "--preset", "motion_base", "--estimate", "platform_mass", "--out", "out"),
    ("reproduce", "--out", "out"),
    ("presets",),
    ("experiments",),
)


_PR_SET_CHILD_SUBREAPER = 36
# An isolated unit looks twice a second whether its parent lives, and gets two seconds to end [s].
_PATIENCE = 6.0
# One that waits longer than this after the signal hangs [s].
_LONGEST = 60.0
# Says when the entry is imported, from which moment on there may be no traceback.
_PROGRAM = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a campaign in the background ignores it
from gough_stewart.harness.cli.entry import main
os.write({mark}, b"x")
main()
"""


class Ended(NamedTuple):
    """How a command ended: code and errors, seconds from the import of its entry, processes that live, whether hung."""

    code: int
    errors: str
    seconds: float
    left: list[str]
    hung: bool


def children() -> set[int]:
    return {int(pid) for task in Path("/proc/self/task").glob("*/children") for pid in task.read_text().split()}


def living(others: set[int]) -> dict[int, str]:
    """Command lines of children but these; those that ended are buried."""
    found = {}
    for pid in children() - others:
        try:
            if os.waitpid(pid, os.WNOHANG)[0] == 0:
                found[pid] = Path(f"/proc/{pid}/cmdline").read_text(errors="replace").replace("\0", " ")[:200]
        except OSError:
            continue
    return found


def run(arguments: Sequence[str], folder: Path, name: str = "SIGINT", after: float | None = None) -> Ended:
    """Run a command in a folder, with a signal so long after the import of its entry [s]; None: no signal."""
    others, hung = children(), False
    reader, writer = os.pipe()
    with tempfile.TemporaryFile() as errors:
        quiet: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": errors}
        program = [sys.executable, "-c", _PROGRAM.format(mark=writer), *arguments]
        process = subprocess.Popen(program, cwd=folder, pass_fds=(writer,), start_new_session=True, **quiet)
        os.close(writer)
        os.read(reader, 1)
        os.close(reader)
        began = time.monotonic()
        try:
            process.wait(_LONGEST if after is None else after)
        except subprocess.TimeoutExpired:
            # a terminal's Ctrl-C reaches the whole group, another process's signal only this one
            (os.killpg if name == "SIGINT" else os.kill)(process.pid, getattr(signal, name))
        try:
            process.wait(_LONGEST)
        except subprocess.TimeoutExpired:
            hung = True
            process.kill()
            process.wait()
        seconds = time.monotonic() - began
        until = time.monotonic() + _PATIENCE
        while (left := living(others)) and time.monotonic() < until:
            time.sleep(0.05)
        for pid in left:
            os.kill(pid, signal.SIGKILL)
        errors.seek(0)
        return Ended(process.returncode, errors.read().decode(errors="replace"), seconds, list(left.values()), hung)


def faults(ended: Ended, folder: Path, undisturbed: int) -> list[str]:
    """A traceback, an orphan, a code that is neither the undisturbed one nor says why, a file that is not whole."""
    marks = ("Traceback", "Exception ignored", "Fatal Python error", "panicked")
    found = [f"{mark}: {ended.errors[-600:]}" for mark in marks if mark in ended.errors]
    if ended.left or ended.hung:
        found.append(f"hung: {ended.hung}, left: {ended.left}")
    if ended.code not in (undisturbed, 130) or (ended.code == 130 and "interrupted" not in ended.errors):
        found.append(f"exit code {ended.code}: {ended.errors[-300:]!r}")
    return found + [f"not whole: {path.relative_to(folder)}" for path in folder.rglob("*") if not is_whole(path)]


def is_whole(path: Path) -> bool:
    """No temporary file, and none that ends before its format does."""
    if path.is_dir() or path.name.endswith(".part"):
        return path.is_dir()
    content, kind = path.read_bytes(), path.suffix
    try:
        if kind == ".json":
            return json.loads(content) is not None
        if kind in (".fmu", ".ssp", ".npz", ".zip"):
            return zipfile.ZipFile(io.BytesIO(content)).testzip() is None
    except (ValueError, zipfile.BadZipFile):
        return False
    end = {".png": b"IEND\xaeB`\x82", ".parquet": b"PAR1", ".svg": b"</svg>", ".html": b"</html>"}.get(kind)
    return content.rstrip(b"\n").endswith(end) if end else content.endswith(b"\n")


def with_out(folder: Path) -> Path:
    """A new folder in it, with the empty one that the commands write to."""
    place = Path(tempfile.mkdtemp(dir=folder))
    (place / "out").mkdir()
    return place


def test_signals_at_random_times_leave_nothing(tmp_path: Path) -> None:
    """Expected: of 500 signals, no process left, no traceback, exit code 130 or 0, every file whole."""
    # orphans of this process's children become its own children
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    random = np.random.default_rng(0)
    for arguments in _INPUTS:
        ended = run(arguments, tmp_path)
        assert ended.code == 0, ended.errors
    undisturbed: dict[int, Ended] = {}
    codes, wrong = Counter[str](), []
    for k in range(500):
        of = k % len(_COMMANDS)
        command = [part.format(inputs=tmp_path) for part in _COMMANDS[of]]
        if of not in undisturbed:
            undisturbed[of] = run(command, with_out(tmp_path))
        place, name = with_out(tmp_path), ("SIGINT", "SIGTERM")[k // len(_COMMANDS) % 2]
        seconds = float(random.uniform(0, 1.05 * undisturbed[of].seconds))
        ended = run(command, place, name, seconds)
        codes[f"{command[0]} {ended.code}"] += 1
        bad = faults(ended, place, undisturbed[of].code)
        wrong += [f"{' '.join(command)} {name} after {seconds:.3f} s: {fault}" for fault in bad]
        shutil.rmtree(place)
    print("\n" + ", ".join(f"{name}: {count}" for name, count in sorted(codes.items())))
    assert not wrong, "\n".join(wrong)

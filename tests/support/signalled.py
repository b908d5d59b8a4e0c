"""A command that gets a signal at a given time after its start, and what it leaves behind.

As a script it runs one command: it starts it, sends the signal, waits for its end, and adopts the processes that it
leaves (Linux's subreaper), so that every orphan is seen. Only standard library and tests import this file.
"""

import ctypes
import io
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

_SUBREAPER = 36  # PR_SET_CHILD_SUBREAPER
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


@dataclass
class Ended:
    """How a command ended after a signal."""

    code: int
    errors: str
    seconds: float  # from the import of the entry to the end
    left: list[str] = field(default_factory=list)  # command lines of processes that still live
    hung: bool = False


class Trial(NamedTuple):
    """A command in a folder, and a signal so long after the import of its entry [s]; None: no signal."""

    arguments: Sequence[str]
    folder: Path
    signal: str
    after: float | None


def signalled(trial: Trial) -> Ended:
    """Run a trial in a process of its own, which is the adoptive parent of all that is left."""
    command = [sys.executable, __file__, json.dumps([list(trial.arguments), trial.signal, trial.after])]
    done = subprocess.run(command, cwd=trial.folder, capture_output=True, text=True, check=True)
    return Ended(**json.loads(done.stdout.splitlines()[-1]))


def faults(trial: Trial, ended: Ended, undisturbed: int = 0) -> list[str]:
    """What is wrong: a traceback, an orphan, a code that says nothing, a file that is not whole.

    `undisturbed` is the exit code without a signal.
    """
    found = []
    for mark in ("Traceback", "Exception ignored", "Fatal Python error", "panicked"):
        if mark in ended.errors:
            found.append(f"{mark}: {ended.errors[-600:]}")
    if ended.left:
        found.append(f"left: {ended.left}")
    if ended.hung:
        found.append("hung")
    if ended.code not in (undisturbed, 130):
        found.append(f"exit code {ended.code}: {ended.errors[-300:]}")
    if ended.code == 130 and "interrupted" not in ended.errors:
        found.append(f"130 without a word: {ended.errors[-300:]!r}")
    return found + [f"not whole: {path}" for path in broken_files(trial.folder)]


def broken_files(folder: Path) -> list[str]:
    """Temporary files, and files that end before their format does."""
    return [str(path.relative_to(folder)) for path in sorted(folder.rglob("*")) if not _is_whole(path)]


def _is_whole(path: Path) -> bool:
    if path.name.endswith(".part"):
        return False
    if path.is_dir():
        return True
    content = path.read_bytes()
    try:
        return _ENDS_WELL.get(path.suffix, _ends_with_a_line)(content)
    except (ValueError, OSError, zipfile.BadZipFile):
        return False


def _ends_with_a_line(content: bytes) -> bool:
    return content.endswith(b"\n")


def _is_archive(content: bytes) -> bool:
    return zipfile.ZipFile(io.BytesIO(content)).testzip() is None


_ENDS_WELL: dict[str, Callable[[bytes], bool]] = {
    ".png": lambda content: content[-8:-4] == b"IEND",
    ".svg": lambda content: content.rstrip().endswith(b"</svg>"),
    ".html": lambda content: content.rstrip().endswith(b"</html>"),
    ".json": lambda content: json.loads(content) is not None,
    ".parquet": lambda content: content[:4] == content[-4:] == b"PAR1",
    **dict.fromkeys((".fmu", ".ssp", ".npz", ".zip"), _is_archive),
}


# --- the process of one trial --------------------------------------------------------------------------------------


def _children() -> list[int]:
    found = []
    for task in Path("/proc/self/task").iterdir():
        found += [int(pid) for pid in (task / "children").read_text().split()]
    return found


def _command_line(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()[:200]
    except OSError:
        return ""


def _reap() -> list[int]:
    """Children that live; those that ended are buried."""
    living = []
    for pid in _children():
        try:
            if os.waitpid(pid, os.WNOHANG)[0] == 0:
                living.append(pid)
        except ChildProcessError:
            continue
    return living


def _trial(arguments: list[str], name: str, after: float | None) -> Ended:
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    reader, writer = os.pipe()
    with Path(".errors").open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM.format(mark=writer), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            pass_fds=(writer,),
            start_new_session=True,
        )
    os.close(writer)
    os.read(reader, 1)
    began, hung = time.monotonic(), False
    if after is not None:
        try:
            process.wait(after)
        except subprocess.TimeoutExpired:
            # a terminal's Ctrl-C reaches the whole group, another process's signal only this one
            if name == "SIGINT":
                os.killpg(process.pid, signal.SIGINT)
            else:
                process.send_signal(getattr(signal, name))
    try:
        process.wait(_LONGEST)
    except subprocess.TimeoutExpired:
        hung = True
        process.kill()
        process.wait()
    seconds = time.monotonic() - began
    until = time.monotonic() + _PATIENCE
    while (living := _reap()) and time.monotonic() < until:
        time.sleep(0.05)
    left = [_command_line(pid) for pid in living]
    for pid in living:
        os.kill(pid, signal.SIGKILL)
    said = Path(".errors").read_text(errors="replace")
    Path(".errors").unlink()
    return Ended(process.returncode, said, seconds, left, hung)


if __name__ == "__main__":
    print(json.dumps(_trial(*json.loads(sys.argv[1])).__dict__))

"""A new user's first minutes: every command of the README and the tutorial, timed in a terminal.

    python benchmarks/first_minutes.py [PAGE …]

Commands and programs of a page run one after the other in a new folder, each in a terminal of 80 columns. The table
has the time of each and its longest silence: the longest time without new output on the terminal, from the start of
the process, imports included. `make …`, `pip …` and `pytest …` are left out, and no browser is opened.
"""

import os
import pty
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parents[1]))
from tools.pages.blocks import ROOT
from tools.pages.story import run_page

PAGES = ("README.md", "docs/tutorial.md")
MOST_SILENCE = 1.0  # s


class Timed(NamedTuple):
    """Times of a command."""

    seconds: float
    silence: float
    after: str  # the last output before the silence
    code: int


def timed(command: str, folder: Path) -> Timed:
    """Run one shell command in its own terminal."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "TERM": "xterm", "COLUMNS": "80", "LINES": "24", "BROWSER": "true"}
    inner, outer = pty.openpty()
    start = last = time.perf_counter()
    process = subprocess.Popen(
        command, shell=True, cwd=folder, env=environment, stdin=outer, stdout=outer, stderr=outer, close_fds=True
    )
    os.close(outer)
    silence, after, shown = 0.0, "", b""
    while True:
        ready, _, _ = select.select([inner], [], [], 0.05)
        try:
            piece = os.read(inner, 65536) if ready else b""
        except OSError:  # the other end is closed
            break
        now = time.perf_counter()
        if piece:
            if now - last > silence:
                silence, after = now - last, _last_words(shown)
            last, shown = now, (shown + piece)[-400:]
        elif process.poll() is not None:
            break
    os.close(inner)
    code, end = process.wait(), time.perf_counter()
    if end - last > silence:
        silence, after = end - last, _last_words(shown)
    return Timed(end - start, silence, after, code)


def _last_words(shown: bytes) -> str:
    """The end of the terminal output, without control sequences."""
    text = "".join(each if each.isprintable() else " " for each in shown.decode(errors="replace"))
    return " ".join(text.split())[-30:] or "the start"


def main() -> int:
    """Run and measure the commands, and print a row for each; silences that are too long are marked."""
    pages = [page for page in sys.argv[1:] or PAGES if (ROOT / page).is_file()]
    table = Table("command", "s", "longest silence s", "after", title="a new user's first minutes")
    total, missed = 0.0, 0

    def run(command: str, folder: Path) -> str:
        nonlocal total, missed
        found = timed(command, folder)
        total += found.seconds
        is_missed = found.silence > MOST_SILENCE or found.code != 0
        missed += is_missed
        mark = " [bold red]missed[/bold red]" if is_missed else ""
        ended = f" (exit code {found.code})" if found.code else ""
        table.add_row(command + ended, f"{found.seconds:.1f}", f"{found.silence:.2f}{mark}", found.after)
        print(f"{found.seconds:6.1f} {found.silence:5.2f}  {command}{ended}", flush=True)
        return ""

    with tempfile.TemporaryDirectory() as name:
        for page in pages:
            run_page(page, Path(name), run)
        table.add_section()
        table.add_row(f"all of {' and '.join(pages)}", f"{total:.1f}", "", "")
    Console().print(table)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())

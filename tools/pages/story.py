"""A page as a story: its blocks in order in one folder.

- `sh`: each line is a command; those of the environment (`pip`, `make`, `pytest`, activation) are left out;
- a block with `title="FILE"`: written to that file, behind what earlier blocks wrote there;
- `python` without a title: a program;
- `text` right below one of them: what it prints (`outputs.py`).
"""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tools.pages.blocks import Block, blocks_of, commands_in

# What a command prints; it raises if the command fails.
Runner = Callable[[str, Path], str]
# outputs are those of a terminal of 80 columns without colours
TERMINAL = {"COLUMNS": "80", "NO_COLOR": "1", "TERM": "dumb", "MPLBACKEND": "agg", "BROWSER": "true"}
OF_THE_ENVIRONMENT = re.compile(r"make |pytest |pip install |\. \.venv/bin/activate$|.* --target all")
_SNIPPET = "snippet.py"


class FailedCommandError(AssertionError):
    """A command of a page that failed, with what it printed."""

    def __init__(self, command: str, done: subprocess.CompletedProcess[str]) -> None:
        super().__init__(f"{command}\n{done.stdout}{done.stderr}")


def run_page(
    page: str,
    folder: Path,
    run: Runner,
    *,
    left_out: Callable[[str], bool] = lambda _: False,
    after: Callable[[Block], str] = lambda _: "",
) -> dict[Block, str]:
    """Run a page in a folder; returns what each block printed.

    Parameters
    ----------
    page
        Its path from the root of the repository.
    folder
        Where files are written and commands run.
    run
        Runs one command in a folder.
    left_out
        Further commands, and programs by their text, that are not run.
    after
        Lines of Python to run behind those of a block.
    """
    printed = {}
    for block in blocks_of(page):
        if block.title:
            _write(block, folder)
            continue
        commands = [c for c in commands_in(block) if not (OF_THE_ENVIRONMENT.match(c) or left_out(c))]
        if block.language == "python" and not left_out(block.text):
            (folder / _SNIPPET).write_text(block.text + after(block), encoding="utf-8")
            commands = [f"python {_SNIPPET}"]
        elif block.language != "sh":
            continue
        try:
            printed[block] = "".join(run(command, folder) for command in commands)
        except FailedCommandError as error:
            error.add_note(block.place)
            raise
    return printed


def run_in_shell(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command in a shell whose PATH begins with the environment of this interpreter."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, **TERMINAL, "PATH": path}
    return subprocess.run(command, shell=True, cwd=cwd, capture_output=True, text=True, check=False, env=environment)


def printed_in_shell(command: str, cwd: Path) -> str:
    """What a command prints that does not fail."""
    done = run_in_shell(command, cwd)
    if done.returncode:
        raise FailedCommandError(command, done)
    return done.stdout + done.stderr


def _write(block: Block, folder: Path) -> None:
    path = folder / block.title
    before = path.read_text(encoding="utf-8") + "\n" if path.exists() else ""
    path.write_text(before + block.text, encoding="utf-8")

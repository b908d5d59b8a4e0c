"""Code blocks of the pages, and how to run them."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.fmu_plants import Fmu
from tests.support.interpreter import COMMAND, Interpreter

ROOT = Path(__file__).parents[2]
SET_UP_BY_MAKE = (ROOT / ".venv" / "run").exists()
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").glob("**/*.md"))]


class Block(NamedTuple):
    """A fenced block: where it stands, its language, its text."""

    page: str
    line: int
    language: str
    text: str

    @property
    def place(self) -> str:
        """For the name of a test."""
        return f"{self.page}:{self.line}"


def blocks_of(page: str) -> list[Block]:
    """All fenced blocks of a page in their order."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.finditer(r"^```([^\n`]*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [Block(page, text.count("\n", 0, f.start()) + 1, f[1].strip(), f[2]) for f in found]


BLOCKS = [block for page in PAGES for block in blocks_of(page)]


def commands_of(page: str) -> list[str]:
    """The lines of the shell blocks of a page, without comments."""
    lines = [line for block in blocks_of(page) if block.language == "sh" for line in block.text.splitlines()]
    return [command for line in lines if (command := re.sub(r"(^|\s)#.*", "", line).strip())]


def run(command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """In a shell whose PATH begins with the environment of these tests."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        command,
        shell=True,
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PATH": path},
    )


def run_commands(commands: list[str], interpreter: Interpreter, cwd: Path) -> str:
    """What lines of commands print, run in order as by a shell; the first that fails, fails the test.

    `gough-stewart …` runs in an interpreter that has imported most of it; a compiler, and what it makes, in a shell.
    """
    printed = ""
    for command in commands:
        program, *arguments = shlex.split(command)
        if command.startswith(("python -m ziglang cc ", "./")):
            done = run(command, cwd)
            assert done.returncode == 0, f"{command}\n{done.stderr}{done.stdout}"
            printed += done.stdout
            continue
        assert program == COMMAND, command
        *arguments, target = arguments if ">" in arguments else [*arguments, ""]
        done = interpreter.command(*(word for word in arguments if word != ">"), cwd=cwd)
        assert done.returncode == 0, f"{command}\n{done.stderr}{done.stdout}"
        if target:
            (cwd / target).write_text(done.stdout)
        else:
            printed += done.stdout
    return printed


def folder_with_fmus(fmus: Mapping[str, Fmu], factory: pytest.TempPathFactory) -> Path:
    """A folder as `gough-stewart build` leaves it, which the pages tell their readers to call."""
    folder = factory.mktemp("built")
    for fmu in fmus.values():
        shutil.copy(fmu.path, folder)
    return folder

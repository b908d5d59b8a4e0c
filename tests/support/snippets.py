"""Code blocks of the pages, and how to run them."""

import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from tests.support.fmu_plants import Fmu
from tests.support.interpreter import COMMAND, Interpreter
from tools.pages.blocks import ROOT, blocks_of, commands_in
from tools.pages.story import TERMINAL, FailedCommandError, Runner, run_in_shell

SET_UP_BY_MAKE = (ROOT / ".venv" / "run").exists()
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").glob("**/*.md"))]
BLOCKS = [block for page in PAGES for block in blocks_of(page)]


def commands_of(page: str) -> list[str]:
    """The lines of the shell blocks of a page, without comments."""
    return [command for block in blocks_of(page) if block.language == "sh" for command in commands_in(block)]


def runner(interpreter: Interpreter) -> Runner:
    """What runs one command of a page, as a shell would in a terminal of 80 columns.

    `gough-stewart …` and `python FILE` run in an interpreter that has imported most of it; a compiler, and what it
    makes, in a shell. With `|| test $? -eq 3` behind it, it must end with just that exit code.
    """

    def run_one(command: str, cwd: Path) -> str:
        command, _, exit_code = command.partition(" || test $? -eq ")
        program, *arguments = shlex.split(command)
        target = ""
        if ">" in arguments:
            *arguments, _, target = arguments
        if program == COMMAND:
            done = interpreter.command(*arguments, cwd=cwd, env=TERMINAL)
        elif program == "python" and arguments[0] != "-m":
            done = interpreter.script(cwd / arguments[0], *arguments[1:], cwd=cwd, env=TERMINAL)
        else:
            assert command.startswith(("python -m ziglang cc ", "./")), command
            done = run_in_shell(command, cwd)
        if done.returncode != int(exit_code or 0):
            raise FailedCommandError(command, done)
        if target:
            (cwd / target).write_text(done.stdout)
            return done.stderr
        return done.stdout + done.stderr

    return run_one


def run_commands(commands: list[str], interpreter: Interpreter, cwd: Path) -> str:
    """What lines of commands print, run in order; the first that fails, fails the test."""
    run_one = runner(interpreter)
    return "".join(run_one(command, cwd) for command in commands)


def folder_with_fmus(fmus: Mapping[str, Fmu], factory: pytest.TempPathFactory) -> Path:
    """A folder as `gough-stewart build` leaves it, which the pages tell their readers to call."""
    folder = factory.mktemp("built")
    for fmu in fmus.values():
        shutil.copy(fmu.path, folder)
    return folder

"""Code blocks of the pages, and how to run them."""

import contextlib
import io
import os
import runpy
import shlex
import subprocess
import sys
import traceback
import warnings
from pathlib import Path
from unittest.mock import patch

from tests.support.commands import invoke
from tools.pages.blocks import ROOT, blocks_of, commands_in
from tools.pages.story import TERMINAL, FailedCommandError, run_in_shell

COMMAND = "gough-stewart"
SET_UP_BY_MAKE = (ROOT / ".venv" / "run").exists()
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").glob("**/*.md"))]
BLOCKS = [block for page in PAGES for block in blocks_of(page)]


def commands_of(page: str) -> list[str]:
    """The lines of the shell blocks of a page, without comments."""
    return [command for block in blocks_of(page) if block.language == "sh" for command in commands_in(block)]


def _run_program(path: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`python path arguments` in the present folder, within this process, which has imported most of it."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    before = set(sys.modules)
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        patch.object(sys, "argv", [str(path), *arguments]),
        patch.object(sys, "path", [str(path.parent), *sys.path]),
    ):
        try:
            runpy.run_path(str(path), run_name="__main__")
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
            err.write(str(end.code) if isinstance(end.code, str) else "")
        except Exception:
            code = 1
            traceback.print_exc()
    for name in set(sys.modules) - before:  # another page may have a module of that name
        if str(path.parent) in (getattr(sys.modules[name], "__file__", None) or ""):
            del sys.modules[name]
    return subprocess.CompletedProcess([str(path), *arguments], code, out.getvalue(), err.getvalue())


def run_command(command: str, cwd: Path) -> str:
    """What a command of a page prints in a folder, on a terminal of 80 columns; a failure is an error."""
    # commands run in this process, a compiler and what it makes in a shell; `|| test $? -eq 3` asks for that exit code
    command, _, exit_code = command.partition(" || test $? -eq ")
    program, *arguments = shlex.split(command)
    target = ""
    if ">" in arguments:
        *arguments, _, target = arguments
    with contextlib.chdir(cwd), patch.dict(os.environ, TERMINAL), warnings.catch_warnings():
        warnings.simplefilter("default")
        if program == COMMAND:
            result = invoke(*arguments, columns=80)
            done = subprocess.CompletedProcess(command, result.exit_code, result.stdout, result.stderr)
        elif program == "python" and arguments[0] != "-m":
            done = _run_program(cwd / arguments[0], *arguments[1:])
        else:
            assert command.startswith(("python -m ziglang cc ", "./")), command
            done = run_in_shell(command, cwd)
    if done.returncode != int(exit_code or 0):
        raise FailedCommandError(command, done)
    if target:
        (cwd / target).write_text(done.stdout)
        return done.stderr
    return done.stdout + done.stderr

"""The command line within this process, for what needs no process of its own."""

import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any, NamedTuple

import typer.main
from typer.testing import CliRunner

_SCRIPT = entry_points(group="console_scripts")["gough-stewart"]
# beside the script's own entry, which handles the signals of a process
_APP = import_module(f"{_SCRIPT.module.rpartition('.')[0]}.app").app


class Result(NamedTuple):
    """How a command ended, and what it said."""

    exit_code: int
    stdout: str
    stderr: str
    output: str  # both
    exception: Exception | None


def invoke(*arguments: str, columns: int = 200, catch_exceptions: bool = False) -> Result:
    """`gough-stewart arguments` on a wide terminal without colours; an error without a message of its own is raised."""
    runner = CliRunner(env={"COLUMNS": str(columns), "NO_COLOR": "1", "TERM": "dumb"})
    code = 0
    exception: Exception | None = None
    # as `CliRunner.invoke`, which makes all commands anew each time
    with runner.isolation() as streams:
        try:
            _command().main(list(arguments), prog_name="gough-stewart")
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        except Exception as error:
            if not catch_exceptions:
                raise
            code, exception = 1, error
        sys.stdout.flush()
        sys.stderr.flush()
        stdout, stderr, output = (stream.getvalue().decode(errors="replace") for stream in streams)
    return Result(code, stdout, stderr, output, exception)


@cache
def _command() -> Any:
    return typer.main.get_command(_APP)


def commands() -> Mapping[str, Any]:
    """Every command by its name, as click has it: with its options and arguments in `params`."""
    return dict(_command().commands)

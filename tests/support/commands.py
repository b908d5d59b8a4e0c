"""The command line within this process, for what needs no process of its own."""

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

import typer.main
from typer.testing import CliRunner, Result

_SCRIPT = entry_points(group="console_scripts")["gough-stewart"]
# beside the script's own entry, which handles the signals of a process
_APP = import_module(f"{_SCRIPT.module.rpartition('.')[0]}.app").app


def invoke(*arguments: str, columns: int = 200, catch_exceptions: bool = False) -> Result:
    """`gough-stewart arguments` on a wide terminal without colours; an error without a message of its own is raised."""
    runner = CliRunner(env={"COLUMNS": str(columns), "NO_COLOR": "1", "TERM": "dumb"})
    return runner.invoke(_APP, list(arguments), catch_exceptions=catch_exceptions)


def commands() -> Mapping[str, Any]:
    """Every command by its name, as click has it: with its options and arguments in `params`."""
    found: Any = typer.main.get_command(_APP)
    return dict(found.commands)

"""The command line: `gough-stewart`."""

import gc
import io
import sys
from collections.abc import Callable
from typing import Annotated

import typer

from gough_stewart.harness.cli.build import build_command
from gough_stewart.harness.cli.check import check_command
from gough_stewart.harness.cli.ensemble import ensemble_command
from gough_stewart.harness.cli.excite import excite_command
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.experiments import experiments_command
from gough_stewart.harness.cli.export import export_command
from gough_stewart.harness.cli.frf import frf_command
from gough_stewart.harness.cli.help import PlainCommand, PlainGroup
from gough_stewart.harness.cli.identify import identify_command
from gough_stewart.harness.cli.margins import margins_command
from gough_stewart.harness.cli.presets import presets_command
from gough_stewart.harness.cli.reproduce import reproduce_command
from gough_stewart.harness.cli.run import run_command
from gough_stewart.harness.cli.tune import tune_command
from gough_stewart.harness.cli.view import view_command
from gough_stewart.harness.cli.workspace import workspace_command

app = typer.Typer(
    name="gough-stewart",
    help="Dynamics of the Gough–Stewart platform (Liu, Li & Li 2000): a plant for simulation and control.",
    epilog="Exit codes: " + "; ".join(f"{code:d} {code.meaning}" for code in ExitCode) + ".",
    cls=PlainGroup,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        typer.echo(f"gough-stewart {version('gough-stewart')}")
        raise typer.Exit


@app.callback()
def _global(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass


# By panel of the help, in its order.
_COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "Platforms and experiments": {
        "presets": presets_command,
        "experiments": experiments_command,
        "workspace": workspace_command,
    },
    "Runs": {"run": run_command, "view": view_command},
    "Design": {
        "check": check_command,
        "margins": margins_command,
        "frf": frf_command,
        "ensemble": ensemble_command,
        "tune": tune_command,
    },
    "Parameters from logs": {"excite": excite_command, "identify": identify_command},
    "For other tools": {"build": build_command, "export": export_command},
    "The paper": {"reproduce": reproduce_command},
}
for _panel, _commands in _COMMANDS.items():
    for _name, _function in _commands.items():
        app.command(_name, cls=PlainCommand, rich_help_panel=_panel)(_function)


def main() -> None:
    """Run the command line in a process of its own; the console script calls it through `entry`."""
    # imports and figures create many objects that live to the end; without this, collection would scan them often
    gc.set_threshold(200_000, 30, 30)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek shows question marks instead of a traceback
    app()

"""The command line: `gough-stewart`."""

import gc
import io
import sys
from typing import Annotated

import typer

from gough_stewart.harness.cli.build import build_command
from gough_stewart.harness.cli.check import check_command
from gough_stewart.harness.cli.ensemble import ensemble_command
from gough_stewart.harness.cli.excite import excite_command
from gough_stewart.harness.cli.experiments import experiments_command
from gough_stewart.harness.cli.export import export_command
from gough_stewart.harness.cli.frf import frf_command
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
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
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


app.command("reproduce")(reproduce_command)
app.command("build")(build_command)
app.command("presets")(presets_command)
app.command("run")(run_command)
app.command("experiments")(experiments_command)
app.command("check")(check_command)
app.command("margins")(margins_command)
app.command("frf")(frf_command)
app.command("excite")(excite_command)
app.command("identify")(identify_command)
app.command("ensemble")(ensemble_command)
app.command("tune")(tune_command)
app.command("export")(export_command)
app.command("view")(view_command)
app.command("workspace")(workspace_command)


def main() -> None:
    """The command line in a process of its own; the console script comes here through `entry`."""
    # imports and figures make objects by the hundred thousand, none of them garbage to look for
    gc.set_threshold(200_000, 30, 30)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without Greek gets question marks, not a traceback
    app()

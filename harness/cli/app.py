"""The command line: `gough-stewart`."""

import gc
import io
import re
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from gough_stewart.harness.cli.design import (
    check_command,
    ensemble_command,
    frf_command,
    margins_command,
    tune_command,
)
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.live import live_command
from gough_stewart.harness.cli.logs import excite_command, identify_command, poses_command
from gough_stewart.harness.cli.platforms import (
    experiments_command,
    presets_command,
    reproduce_command,
    workspace_command,
)
from gough_stewart.harness.cli.run import run_command, view_command
from gough_stewart.harness.cli.stream import serve_command
from gough_stewart.harness.cli.units import build_command, export_command

# Wrong usage of any kind; Typer carries a click of its own in some versions.
_WrongUse: type[Exception] = typer.BadParameter.__mro__[1]
# Parts of Typer's messages on wrong values, and their plain replacements.
_PLAIN = {
    "Value error, ": "",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
    "Input should be a valid number, unable to parse string as a number": "expected a number",
    "Input should be": "expected a number",
}


class PlainCommand(TyperCommand):
    """A command whose help names no Python types."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters as in Typer, without the names of types."""
        return _without_types(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As in Typer, with plain messages for wrong values."""
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            for pedantic, plain in _PLAIN.items():
                error.message = error.message.replace(pedantic, plain)
            raise
        except _WrongUse as error:
            said = getattr(error, "message", "")
            error.message = said + self._platform_option(said)  # type: ignore[attr-defined]
            raise

    def _platform_option(self, message: str) -> str:
        """How a platform is given to a command that takes none as a plain argument, as in `workspace motion_base`."""
        extra = re.fullmatch(r"Got unexpected extra argument(?:\(s\))? \((\S+)\)", message)
        if extra is None or not any(parameter.name == "preset" for parameter in self.params):
            return ""
        option = "--platform" if extra[1].endswith(".toml") else "--preset"
        return f"; a platform is given as `{option} {extra[1]}`"


class PlainGroup(TyperGroup):
    """The same for the group of all commands."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Parameters as in Typer, without the names of types."""
        return _without_types(super().get_params(ctx))


def _without_types(parameters: list[Any]) -> list[Any]:
    """Remove <bool> from flags and <str> from arguments, whose names are clear."""
    for parameter in parameters:
        if isinstance(parameter, TyperArgument):
            parameter.display_type_rich = _no_type  # type: ignore[method-assign]
        elif getattr(parameter, "is_flag", False):
            parameter.metavar = ""
            # a flag that is not set needs no conversion, for which Typer would load Pydantic
            parameter.default = parameter.default or False
    return parameters


def _no_type(ctx: Any) -> None:
    """Return no text to print beside the name."""


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
    "Runs": {"live": live_command, "run": run_command, "serve": serve_command, "view": view_command},
    "Design": {
        "check": check_command,
        "margins": margins_command,
        "frf": frf_command,
        "ensemble": ensemble_command,
        "tune": tune_command,
    },
    "From logs": {"excite": excite_command, "identify": identify_command, "poses": poses_command},
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

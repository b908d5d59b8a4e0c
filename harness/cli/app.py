"""The command line: `gough-stewart`."""

import re
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup

from gough_stewart.harness.cli import ExitCode, logs, platforms
from gough_stewart.harness.cli import loop_commands as loops
from gough_stewart.harness.cli import run_commands as runs
from gough_stewart.harness.cli import unit_commands as units

# Wrong usage of any kind; Typer carries a click of its own in some versions.
_WrongUse: type[Exception] = typer.BadParameter.__mro__[1]
# Parts of Typer's messages on wrong values, and their plain replacements.
_PLAIN = {
    "Value error, ": "",
    "Input should be a valid integer, unable to parse string as an integer": "expected a whole number",
    "Input should be a valid number, unable to parse string as a number": "expected a number",
    "Input should be": "expected a number",
}


class _PlainHelp:
    """Parameters as in Typer, without <bool> for flags and <str> for arguments, whose names are clear."""

    def get_params(self, ctx: Any) -> list[Any]:
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if isinstance(parameter, TyperArgument):
                parameter.display_type_rich = lambda ctx: None  # type: ignore[method-assign]  # noqa: ARG005
            elif getattr(parameter, "is_flag", False):
                parameter.metavar = ""
                # a flag that is not set needs no conversion, for which Typer would load Pydantic
                parameter.default = parameter.default or False
        return parameters


class PlainCommand(_PlainHelp, TyperCommand):
    """A command whose help names no Python types."""

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
            extra = re.fullmatch(r"Got unexpected extra argument(?:\(s\))? \((\S+)\)", said)
            # as in `workspace motion_base`, whose platform is no plain argument
            if extra is not None and any(parameter.name == "preset" for parameter in self.params):
                option = "--platform" if extra[1].endswith(".toml") else "--preset"
                said += f"; a platform is given as `{option} {extra[1]}`"
            error.message = said  # type: ignore[attr-defined]
            raise


class PlainGroup(_PlainHelp, TyperGroup):
    """The same for the group of all commands."""


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
_COMMANDS: dict[str, list[Callable[..., None]]] = {
    "Platforms and experiments": [
        *(platforms.presets_command, platforms.experiments_command, platforms.workspace_command),
    ],
    "Runs": [runs.live_command, runs.run_command, runs.serve_command, runs.view_command],
    "Design": [
        *(loops.check_command, loops.margins_command, loops.frf_command, loops.ensemble_command, loops.tune_command),
    ],
    "From logs": [logs.excite_command, logs.identify_command, logs.poses_command],
    "For other tools": [units.build_command, units.export_command],
    "The paper": [platforms.reproduce_command],
}
for _panel, _functions in _COMMANDS.items():
    for _function in _functions:
        _name = _function.__name__.removesuffix("_command")
        app.command(_name, cls=PlainCommand, rich_help_panel=_panel)(_function)

"""The command `experiments`: those that ship with the package."""

from typing import Annotated

import typer
from rich.table import Table

from gough_stewart.harness.cli.options import experiments
from gough_stewart.harness.cli.terminal import Terminal, clear_errors


def experiments_command(
    name: Annotated[
        str | None,
        typer.Argument(help="Print this experiment's TOML file.", metavar="[NAME]", autocompletion=experiments),
    ] = None,
) -> None:
    """List the experiments that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.experiment.file import experiment_names, shipped_experiment, shipped_text

        if name is not None:
            typer.echo(shipped_text(name), nl=False)
            return
        table = Table("name", "platform", "what")
        for each in experiment_names():
            experiment = shipped_experiment(each)
            table.add_row(each, experiment.platform.preset_name, experiment.description)
        Terminal().print(table)

"""The command `experiments`: lists the shipped experiments."""

from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import experiments
from gough_stewart.harness.cli.terminal import show


def experiments_command(
    name: Annotated[
        str | None,
        typer.Argument(help="Print this experiment's TOML file.", metavar="NAME", autocompletion=experiments),
    ] = None,
) -> None:
    """List the experiments that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.experiment.file import experiment_names, shipped_experiment, shipped_text
        from gough_stewart.harness.output.tables import Sheet

        if name is not None:
            typer.echo(shipped_text(name), nl=False)
            return
        sheet = Sheet("", ("name", "platform", "what"))
        for each in experiment_names():
            experiment = shipped_experiment(each)
            sheet.add(each, experiment.platform.preset_name, experiment.description)
        show(sheet)

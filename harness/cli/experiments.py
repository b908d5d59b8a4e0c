"""The command `experiments`: lists the shipped experiments."""

from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors, wrong_use_if
from gough_stewart.harness.cli.options import experiments
from gough_stewart.harness.cli.terminal import show
from gough_stewart.harness.errors import ExperimentError


def experiments_command(
    name: Annotated[
        str | None,
        typer.Argument(help="Print this experiment's TOML file.", metavar="NAME", autocompletion=experiments),
    ] = None,
) -> None:
    """List the experiments that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.experiment.file import experiment_names, shipped_experiment, shipped_text
        from gough_stewart.harness.report.table import Column, Table

        if name is not None:
            with wrong_use_if(ExperimentError):
                text = shipped_text(name)
            typer.echo(text, nl=False)
            return
        rows = []
        for each in experiment_names():
            experiment = shipped_experiment(each)
            rows.append((each, experiment.platform.preset_name, experiment.description))
        show(Table("", (Column("name"), Column("platform"), Column("what")), tuple(rows)))

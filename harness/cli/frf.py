"""The command `frf`: estimates frequency responses from a run with an injection."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import chosen_experiment, experiments, path
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import progress_bar


@shows
def frf_command(
    record: Annotated[Path, typer.Argument(help="A record from `run`, or its folder.", metavar="RECORD", parser=path)],
    experiment: Annotated[
        str | None,
        typer.Option(
            help="The experiment of the run, if its controller is a Python file: that file is executed for the linear "
            "model. A record alone never executes code.",
            metavar="FILE.toml|NAME",
            autocompletion=experiments,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the files; created if needed. Default: the record's folder; with --report or --figures, "
            "frf in it.",
            metavar="DIR",
            parser=path,
        ),
    ] = None,
    *,
    showing: Showing,
) -> None:
    """Estimate the frequency responses S, T and L of the leg or mode excited in a run, beside the linear model.

    The run's experiment needs an `[injection]`. Writes **frf.csv** and **frf.parquet** with confidence and coherence;
    with `--figures` also the Bode plot **bode**.

    Examples
    --------
    - `gough-stewart run frequency_response` and `gough-stewart frf results/run_frequency_response`
    """
    with clear_errors() as command:
        own = record if record.is_dir() else record.parent
        # the page of the run is in its folder
        folder = out or (own / "frf" if showing.page or showing.figures else own)
        chosen = None if experiment is None else chosen_experiment(experiment, None, no_python=False)
        with progress_bar() as bar:
            bar.add_task("transforms, linear model, figure", total=None)
            from gough_stewart.harness.experiment.frf import FILES, frf, frf_files
            from gough_stewart.model.process.files import check_output_folder, write_files

            check_output_folder(folder, FILES)
            found = frf(record, experiment=chosen)
            files = frf_files(found)
            report = found.report(charts=showing.draws)
        requirements = showing.requirements(found.requirements, report.numbers)
        write_files(folder, files)
        showing.present(
            command,
            report,
            folder,
            list(files),
            requirements=requirements,
            figures=("bode",),
            keeps_data=folder != own,
        )

"""The commands of the closed loop: `run`, `experiments`, `margins`."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from gough_stewart.harness.kinds import PlantKind
from gough_stewart.harness.terminal import clear_errors, errors

if TYPE_CHECKING:
    from gough_stewart.harness.experiment import Experiment
    from gough_stewart.harness.record import Record

ExperimentArgument = Annotated[
    str, typer.Argument(help="A TOML file, or the name of a shipped experiment.", metavar="FILE.toml|NAME")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="Set one key of the experiment, such as loop.duration=3; may be repeated.", metavar="KEY=VALUE"
    ),
]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder for the files; made if needed. Default: results/NAME.", metavar="DIR")
]
ReportOption = Annotated[
    bool, typer.Option("--report", help="Write report.html too: the motion in 3-D beside its curves, for a browser.")
]
# Beside 0 and 1 (an error): the run is there, but it did not come to its end.
EXIT_NOT_COMPLETED = 3
EXIT_INTERRUPTED = 130


def run_command(
    experiment: ExperimentArgument,
    plant: Annotated[
        PlantKind | None, typer.Option(help="What simulates the platform, instead of what the experiment says.")
    ] = None,
    fmu: Annotated[
        Path | None, typer.Option(help="The FMU for the plant fmu2 or fmu3; built if none is given.", metavar="FILE")
    ] = None,
    out: OutOption = None,
    settings: SetOption = None,
    report: ReportOption = False,
) -> None:
    """Run an experiment: a controller around the stepping model or the FMU, sampled as on the machine.

    Writes **record.csv**, **record.parquet** and **metadata.json** (all variables, references, errors, controller
    states, flags), **metrics.json**, and **pose**, **errors**, **forces** and **legs** as PNG and SVG; with `--report`
    also **report.html**.

    Exit code 3 if the loop diverged or was stopped by a limit, 130 after Ctrl-C; what ran so far is written all the
    same.

    Examples
    --------
    - `gough-stewart run heave_step --plant fmu3`

    - `gough-stewart run heave_step --set controller.bandwidth=4 --set loop.delay=2 --out results/faster`

    - `gough-stewart experiments heave_step > mine.toml`, change it, then `gough-stewart run mine.toml`
    """
    with clear_errors():
        chosen = _experiment(experiment, settings or [])
        from gough_stewart.harness.run_files import names_of_files, result_files, warnings_of
        from gough_stewart.model.files import check_output_folder, write_files

        folder = out or Path("results", Path(experiment).stem)
        check_output_folder(folder, names_of_files())
        record = _run(chosen, plant, fmu)
        with ThreadPoolExecutor(1) as aside:  # polars works outside of Python's lock
            written = aside.submit(_write_record, record, folder)
            more, tables = result_files(record, report)
            files = written.result()
        write_files(folder, more)
        console = Console()
        console.print(tables)
        for warning in warnings_of(record):
            errors.print(f"[bold yellow]warning:[/bold yellow] {warning}", soft_wrap=True, highlight=False)
        outcome = record.metadata["outcome"]
        console.print(f"Wrote {', '.join([*files, *more])} to {folder}", style="dim", highlight=False)
        if outcome["status"] == "completed":
            return
        errors.print(f"[bold red]{outcome['status']}[/bold red] at {outcome['time']:.6g} s: ", end="", highlight=False)
        errors.print(outcome["cause"], markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(EXIT_INTERRUPTED if outcome["status"] == "interrupted" else EXIT_NOT_COMPLETED)


def experiments_command(
    name: Annotated[str | None, typer.Argument(help="Print this experiment's TOML file.", metavar="[NAME]")] = None,
) -> None:
    """List the experiments that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.experiment_file import shipped_experiment, shipped_names, shipped_text

        if name is not None:
            typer.echo(shipped_text(name), nl=False)
            return
        table = Table("name", "platform", "what")
        for each in shipped_names():
            experiment = shipped_experiment(each)
            table.add_row(each, experiment.platform.preset_name, experiment.description)
        Console().print(table)


def margins_command(
    experiment: ExperimentArgument,
    out: OutOption = None,
    settings: SetOption = None,
) -> None:
    """Gains, closed-loop modes and stability margins of an experiment's controller, on the linear model.

    Linear at the beginning of the reference, sampled and delayed as in the experiment. Writes **margins.json**, and
    **bode** and **step** as PNG and SVG.

    Examples
    --------
    - `gough-stewart margins heave_step`

    - `gough-stewart margins heave_step --set controller.bandwidth=8 --out results/eight`
    """
    with clear_errors():
        chosen = _experiment(experiment, settings or [])
        from gough_stewart.harness.analysis import FILES, analyse
        from gough_stewart.model.files import check_output_folder, write_files

        folder = out or Path("results", f"{Path(experiment).stem}-margins")
        check_output_folder(folder, FILES)
        with Progress(
            TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=errors, transient=True
        ) as bar:
            bar.add_task("linear model, margins, figures", total=None)
            analysis = analyse(chosen)
        write_files(folder, analysis.files)
        console = Console()
        console.print(analysis.tables)
        console.print(f"Wrote {', '.join(analysis.files)} to {folder}", style="dim", highlight=False)


def _experiment(given: str, settings: list[str]) -> "Experiment":
    from gough_stewart.harness.experiment_file import load_experiment, shipped_experiment, shipped_names

    if given in shipped_names() and not Path(given).is_file():
        return shipped_experiment(given, settings)
    return load_experiment(given, settings)


def _write_record(record: "Record", folder: Path) -> list[str]:
    """Write the run itself, whatever else may go wrong; names of its files."""
    from gough_stewart.harness.run_files import record_files
    from gough_stewart.model.files import write_files

    files = record_files(record)
    write_files(folder, files)
    return list(files)


def _run(experiment: "Experiment", plant: PlantKind | None, fmu: Path | None) -> "Record":
    from gough_stewart.harness.run import run

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # every refresh costs the run as much as a hundred of its steps
    with Progress(*columns, console=errors, transient=True, refresh_per_second=4) as progress:
        task = progress.add_task("preparing", total=experiment.loop.duration)
        return run(
            experiment,
            plant=plant,
            fmu=fmu,
            progress=lambda time: progress.update(task, completed=time, description=experiment.title),
            told=lambda what: progress.update(task, description=what),
        )

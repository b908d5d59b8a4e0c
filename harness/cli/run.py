"""The command `run`: runs an experiment and writes its record and figures."""

import shlex
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    NoPythonOption,
    SetOption,
    chosen_experiment,
    out_option,
    path,
    results_folder,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import errors, progress_bar, warn
from gough_stewart.harness.plants.kinds import FMI_VERSIONS, PlantKind

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.schema import Experiment


@shows
def run_command(
    experiment: ExperimentArgument,
    plant: Annotated[
        PlantKind | None,
        typer.Option(
            help="Simulator of the platform. Default: from the experiment.", metavar="|".join(get_args(PlantKind))
        ),
    ] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(
            help="The FMU for the plant fmu2 or fmu3; built if omitted. Its code is executed in a process of its own.",
            metavar="FILE",
            parser=path,
        ),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            help="The controller as FMU: fmu2 or fmu3 exports the experiment's own; a file is executed in a process "
            "of its own. Needs a loop.delay of at least 1.",
            metavar="fmu2|fmu3|FILE.fmu",
        ),
    ] = None,
    anyway: Annotated[
        bool,
        typer.Option("--anyway", help="Run with --controller fmu2 or fmu3 although that loop is unstable when linear."),
    ] = False,
    member: Annotated[
        int | None,
        typer.Option(
            help="Run this member of the experiment's ensemble, with the same results as there; with --plant, in that "
            "plant.",
            metavar="K",
        ),
    ] = None,
    out: Annotated[Path | None, out_option("results/run_NAME, after the experiment")] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
    *,
    showing: Showing,
) -> None:
    """Run an experiment: a controller in a loop with the stepping model or the FMU, sampled as on the machine.

    Says first how closely the platform follows, what it uses of its drives, and when it settles. Writes **record.csv**,
    **record.parquet** and **metadata.json** (all variables, references, errors, controller states, flags) and
    **metrics.json**; with `--figures` also **errors**, **pose**, **actuators** and **legs**.

    Exit code 3 if a requirement is not met, or the loop diverged or grows by itself, or was stopped by a limit, by its
    controller or by the FMU; 4 if a requirement cannot be told; 130 after Ctrl-C. The rows up to that time are still
    written. A loop that oscillates by itself gets a warning.

    Examples
    --------
    - `gough-stewart run heave_step --plant fmu3`

    - `gough-stewart run heave_step --set controller.bandwidth=4 --set loop.delay=2 --out results/faster`

    - `gough-stewart run heave_step --plant fmu3 --controller fmu3 --set loop.delay=1`

    - `gough-stewart run heave_tolerances --member 17 --report`

    - `gough-stewart experiments heave_step > mine.toml`, change it, then `gough-stewart run mine.toml`
    """
    with clear_errors() as command:

        def executed(chosen: "Experiment") -> tuple[str, ...]:
            law = chosen.controller.code if controller is None or controller in FMI_VERSIONS else ()
            # members without a plant of their own run in the compiled batch
            in_batch = member is not None and plant is None and fmu is None
            unit = None if in_batch else chosen.plant.own_unit(plant, fmu)
            return law if unit is None else (*law, unit)

        chosen = chosen_experiment(experiment, settings, no_python, executed)
        folder = out or results_folder("run", experiment, "" if member is None else f"_member_{member}")
        # each refresh takes as long as a hundred steps of the run
        with progress_bar(refresh_per_second=4) as progress:
            task = progress.add_task("preparing", total=chosen.loop.duration)
            from gough_stewart.harness.experiment.run import names_of_files, run, warnings_of, write_results
            from gough_stewart.harness.report.document import Note
            from gough_stewart.harness.results.metric_folds import METRICS
            from gough_stewart.harness.results.oscillation import oscillation
            from gough_stewart.model.process.files import check_output_folder

            check_output_folder(folder, names_of_files())
            requirements = showing.requirements(chosen.requirements, METRICS)

            def status(what: str) -> None:
                progress.update(task, description=what)

            with _unit_of(controller, chosen, status, anyway=anyway) as unit:
                record = run(
                    chosen,
                    plant=plant,
                    fmu=fmu,
                    controller=unit,
                    member=member,
                    progress=lambda time: progress.update(task, completed=time, description=chosen.title),
                    status=status,
                    warn=warn,
                )
            progress.update(task, total=None, description="files and report")
            robustness = None
            if controller is None and member is None and any(each.path == "margins.disk" for each in requirements):
                from gough_stewart.harness.experiment.margins import robustness_of

                robustness = robustness_of(chosen)
            own = oscillation(record)
            warnings = warnings_of(record) + ([own.text()] if own is not None and not own.is_growing else [])
            files, report = write_results(
                record,
                folder,
                page=showing.page,
                figures=showing.figures,
                charts=showing.as_json,
                requirements=requirements,
                notes=[Note(warning, "warning") for warning in warnings],
                robustness=robustness,
            )
        outcome = record.metadata["outcome"]
        is_whole = outcome["status"] == "completed"
        simulated = f"{outcome['time']:.6g} s" if is_whole else f"{outcome['time']:.6g} of {chosen.loop.duration:.6g} s"
        showing.end(
            command,
            report,
            folder,
            files,
            done=f"{'Completed' if is_whole else 'Not completed'}: {simulated} simulated",
            then=None if showing.page else f"gough-stewart view {shlex.quote(str(folder))} --open",
        )
        if not is_whole:
            errors.say((outcome["status"], "bold red"), f" at {outcome['time']:.6g} s: {outcome['cause']}")
            raise typer.Exit(ExitCode.INTERRUPTED if outcome["status"] == "interrupted" else ExitCode.MISSED)
        if own is not None and own.is_growing:
            errors.say(("growing: ", "bold red"), own.text())
            raise typer.Exit(ExitCode.MISSED)
        showing.exit(report)


def _unit_of(
    controller: str | None, experiment: "Experiment", status: Callable[[str], None], *, anyway: bool
) -> AbstractContextManager[Any]:
    """The controller that replaces the experiment's; None for its own."""
    if controller is None:
        return nullcontext()
    if controller not in FMI_VERSIONS:
        warn(f"the stability of the loop with {controller} is not judged: an FMU has no linear form")
        return nullcontext(path(controller))
    from gough_stewart.harness.export.fmu import exported_controller

    return exported_controller(experiment, FMI_VERSIONS[controller], status, anyway=anyway, warn=warn)

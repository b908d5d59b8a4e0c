"""The command `ensemble`: runs the members of an experiment, and writes tables and bands."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gough_stewart.harness.cli.command import Command, clear_errors
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    NoPythonOption,
    SetOption,
    chosen_experiment,
    out_option,
    results_folder,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import members_bar
from gough_stewart.harness.errors import MissedError, UsageError
from gough_stewart.model.process.files import reserved

if TYPE_CHECKING:
    from gough_stewart.harness.ensemble.report import Ensemble
    from gough_stewart.harness.experiment.schema import Experiment


@shows
def ensemble_command(
    experiment: ExperimentArgument,
    members: Annotated[
        int | None, typer.Option(help="Number of members. Default: from the experiment.", metavar="N", min=1)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of samples and noise. Default: from the experiment.", metavar="N", min=0)
    ] = None,
    out: Annotated[Path | None, out_option("results/ensemble_NAME, after the experiment")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an interrupted run in the folder from its finished chunks.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Number of processes on this machine. Default: one thread or process per core.", metavar="N", min=1
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Compute on the workers of this dask.distributed scheduler instead, such as tcp://HOST:8786.",
            metavar="ADDRESS",
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            help="Also run this experiment with the same members, and show the differences: it minus the first one. "
            "--set changes only the first.",
            metavar="FILE.toml|NAME",
        ),
    ] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
    *,
    showing: Showing,
) -> None:
    """Run the members of an experiment's [ensemble]: machines that differ, all with the same controller.

    Writes **members.parquet** (one row per member: varied quantities, metrics, outcome), **bands.parquet** (quantiles
    of signals over time), **samples.parquet** (signals of the first 1,000 members at 101 times), **ensemble.json**, and
    in **worst** the records of the worst members and of the nominal machine; with `--report` a page of all, of each
    worst member, and of these beside the nominal machine; with `--figures` **distribution**, **bands**,
    **dependence** and **sensitivity**.
    `gough-stewart run FILE --member 17` repeats a member exactly.

    A requirement is on every member, or with "for 95 % of members" on that share of all machines: exit code 3 if it is
    not met, 4 if there are too few members to tell; the report says how many would. Exit code 3 also if no member
    completes its run with a loop that does not grow by itself. Members whose loops grow or oscillate are counted in a
    warning.

    With `--compare`, a requirement is on the second experiment; "first.PATH" is on the first, "difference.PATH" on the
    second minus the first.

    Ctrl-C keeps the finished chunks; the same command with `--resume` continues, and gives the same bytes.

    Examples
    --------
    - `gough-stewart ensemble heave_tolerances --members 200`

    - `gough-stewart ensemble mine.toml --set controller.bandwidth=3 --out results/faster`

    - `gough-stewart ensemble mine.toml --require "tracking.position.norm_peak <= 1 mm for 95 % of members"`

    - `gough-stewart ensemble slow.toml --compare fast.toml`

    - `gough-stewart ensemble mine.toml --members 100000 --scheduler tcp://10.0.0.1:8786`
    """
    with clear_errors() as command:
        if workers is not None and scheduler is not None:
            raise UsageError("--workers and --scheduler exclude each other: a scheduler has its own workers; give one")
        chosen = chosen_experiment(experiment, settings, no_python)
        folder = out or results_folder("ensemble", experiment)
        if compare is not None:
            other = chosen_experiment(compare, None, no_python)
            folder = out or results_folder("ensemble", experiment, "_compared")
            options = {"members": members, "seed": seed, "resume": resume, "workers": workers, "scheduler": scheduler}
            _compare(command, showing, (chosen, other), (experiment, compare), folder, options)
            return
        with reserved(folder), members_bar() as progress:
            task = progress.add_task("preparing", total=None)
            from gough_stewart.harness.ensemble.ensemble import ensemble
            from gough_stewart.harness.results.metric_folds import METRICS

            requirements = showing.requirements(chosen.requirements, METRICS)
            found = ensemble(
                chosen,
                members=members,
                seed=seed,
                out=folder,
                resume=resume,
                workers=workers,
                scheduler=scheduler,
                progress=lambda done, total: progress.update(
                    task, completed=done, total=total, description=chosen.title
                ),
                status=lambda what: progress.update(task, description=what),
            )
            command.written.append(folder)
            progress.update(task, total=None, description="worst members and report")
            from gough_stewart.harness.ensemble.charts import FIGURES
            from gough_stewart.harness.ensemble.data import BANDS, MEMBERS, METADATA, SAMPLES
            from gough_stewart.harness.ensemble.worst import WORST, write_worst

            worst = write_worst(found, folder, pages=showing.page)
            report = worst.shown_in(found.report(charts=showing.draws, worst=worst.links))
            report = replace(report, repeat=_repeats(experiment, settings, members, seed))
        files = [MEMBERS, BANDS, SAMPLES, METADATA, *([WORST] if worst.links else [])]
        report = showing.present(
            command, report, folder, files, requirements=requirements, figures=FIGURES, exits=False
        )
        _check_some_work(found)
        showing.exit(report)


def _repeats(experiment: str, settings: Sequence[str] | None, members: int | None, seed: int | None) -> str:
    """The command that runs a member again, without its number."""
    numbers = {"ensemble.members": members, "ensemble.seed": seed}
    changed = [*(settings or ()), *(f"{key}={value}" for key, value in numbers.items() if value is not None)]
    options = "".join(f"--set {quote(each)} " for each in changed)
    return f"gough-stewart run {quote(str(experiment))} {options}--open --member"


def _compare(
    command: Command,
    showing: Showing,
    experiments: "tuple[Experiment, Experiment]",
    texts: tuple[str, str],
    folder: Path,
    options: dict[str, Any],
) -> None:
    with members_bar() as progress:
        task = progress.add_task("preparing", total=None)
        from gough_stewart.harness.ensemble.charts import FIGURES
        from gough_stewart.harness.ensemble.compare import (
            DIFFERENCES,
            comparison_report,
            known_numbers,
            names_of,
            run_compared,
        )
        from gough_stewart.harness.ensemble.worst import write_worst

        requirements = showing.requirements(experiments[1].requirements, known_numbers())
        names = names_of(*texts)
        found = run_compared(
            experiments,
            names,
            folder,
            lambda what: progress.update(task, description=what, completed=0, total=None),
            **options,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
        command.written.append(folder)
        progress.update(task, total=None, description="worst members and reports")
        for name, each in zip(names, (found.a, found.b), strict=True):
            worst = write_worst(each, folder / name, pages=showing.page)
            of_one = worst.shown_in(each.report(charts=showing.draws, worst=worst.links))
            showing.write(of_one, folder / name, FIGURES)
        report = comparison_report(found, charts=showing.draws)
    report = showing.present(
        command, report, folder, [*names, DIFFERENCES], requirements=requirements, figures=FIGURES, exits=False
    )
    for each in (found.a, found.b):
        _check_some_work(each)
    showing.exit(report)


def _check_some_work(found: "Ensemble") -> None:
    """Raise `MissedError` if no member has completed its run, or the loops of all that have grow by themselves."""
    from gough_stewart.harness.ensemble.data import oscillation_warning, works

    members = found.members
    if works(members).any():
        return
    if (members["outcome"] == "completed").any():
        raise MissedError(f"no member completed its run with a loop that does not grow: {oscillation_warning(members)}")
    raise MissedError(f"none of {members.height} members completed its run; the first: {members['cause'][0]}")

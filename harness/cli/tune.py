"""The command `tune`: searches numbers of an experiment for the best value of a metric."""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    NoPythonOption,
    SeedOption,
    SetOption,
    chosen_experiment,
    out_option,
    results_folder,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import errors, progress_bar, warn
from gough_stewart.harness.errors import UsageError

if TYPE_CHECKING:
    from gough_stewart.harness.tuning.search import Search


# Numbers of a search; the others are metrics of runs with the values found.
_OWN = ("value", "fresh")


@shows
def tune_command(
    experiment: ExperimentArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            help="A key and its bounds, such as controller.bandwidth=1..6Hz; add ,log for a logarithmic scale. "
            "May be repeated.",
            metavar="KEY=LOW..HIGH",
        ),
    ],
    minimise: Annotated[
        str, typer.Option(help="The metric to minimise, such as tracking.position.norm_rms.", metavar="METRIC")
    ],
    subject_to: Annotated[
        list[str] | None,
        typer.Option(
            help="A condition, such as 'disk_margin > 0.5' or 'stroke.margin >= 10 mm'; may be repeated.",
            metavar="CONDITION",
        ),
    ] = None,
    over_ensemble: Annotated[
        str | None,
        typer.Option(
            help="Minimise this quantile over the members of the [ensemble], such as quantile=0.95.",
            metavar="quantile=Q",
        ),
    ] = None,
    members: Annotated[
        int | None,
        typer.Option(help="Number of members that evaluate a candidate. Default: at most 64.", metavar="N", min=1),
    ] = None,
    fresh: Annotated[
        int | None,
        typer.Option(help="Number of members, not used in the search, that evaluate the result.", metavar="N", min=1),
    ] = None,
    generations: Annotated[int, typer.Option(help="Number of generations.", metavar="N", min=1)] = 25,
    population: Annotated[
        int | None, typer.Option(help="Candidates per generation. Default: 16 per key.", metavar="N", min=5)
    ] = None,
    seed: SeedOption = 0,
    out: Annotated[Path | None, out_option("results/tune_NAME, after the experiment")] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
    *,
    showing: Showing,
) -> None:
    """Find the numbers of an experiment that minimise a metric, over many machines if it has an [ensemble].

    Writes **tuned.toml**, an experiment for `gough-stewart run`, **tuning.json** and **candidates.csv**; with
    `--figures` also **search** and **values**. Ctrl-C ends the search and writes the best so far.

    Examples
    --------
    - `gough-stewart tune heave_step --vary controller.bandwidth=1..6Hz --vary controller.damping_ratio=0.4..1.2
      --minimise tracking.position.norm_rms --subject-to 'step_response.z.overshoot_percent < 5'`

    - `gough-stewart tune heave_tolerances --vary controller.bandwidth=1..6Hz --minimise tracking.position.norm_peak
      --over-ensemble quantile=0.95`
    """
    with clear_errors() as command:
        quantile = _quantile(over_ensemble)
        chosen = chosen_experiment(experiment, settings, no_python)
        folder = out or results_folder("tune", experiment)
        with progress_bar(refresh_per_second=4) as progress:
            task = progress.add_task("preparing", total=None)
            from gough_stewart.harness.experiment.file import text_with_settings
            from gough_stewart.harness.report.requirements import check_known
            from gough_stewart.harness.results.metric_folds import METRICS, metric_of
            from gough_stewart.harness.tuning.files import FILES, tuning_files
            from gough_stewart.harness.tuning.tune import tune
            from gough_stewart.model.process.files import check_output_folder, write_files

            check_output_folder(folder, FILES)
            # before a long search: whether its result can be judged, and written as a file
            check_known([each for each in showing.required if not each.path.startswith(_OWN)], METRICS)
            text_with_settings(experiment, settings or (), folder=folder)

            def status(found: "Search") -> None:
                quantity, best = metric_of(found.goal.metric).quantity, found.best
                so_far = "none yet" if best is None else quantity.text(best.value)
                done = found.generation[-1] + 1
                progress.update(task, description=f"best {so_far}", completed=done, total=generations)

            if over_ensemble is not None and chosen.ensemble is None:
                raise UsageError(
                    f"--over-ensemble {over_ensemble}: {experiment} has no [ensemble], so there are no machines that "
                    "differ; add one, or leave the option out"
                )
            if over_ensemble is None and chosen.ensemble is not None:
                chosen = chosen.model_copy(update={"ensemble": None})
            found = tune(
                chosen,
                vary,
                minimise,
                subject_to=subject_to or (),
                quantile=quantile,
                members=members,
                fresh=fresh,
                generations=generations,
                population=population,
                seed=seed,
                status=status,
            )
            progress.update(task, description="files and report", total=None)
            files = tuning_files(found, experiment, folder, settings or ())
        write_files(folder, files)
        command.written.append(folder)
        report = found.report(charts=showing.draws)
        if found.left_out:
            warn(f"{found.left_out} members have impossible parameters and are left out")
        then = f"gough-stewart run {shlex.quote(str(folder / 'tuned.toml'))}"
        requirements = showing.requirements(chosen.requirements, report.numbers)
        report = showing.present(
            command,
            report,
            folder,
            list(files),
            requirements=requirements,
            figures=("search", "values"),
            then=then,
            exits=False,
        )
        if found.is_interrupted:
            errors.say(("interrupted", "bold red"), "; the best candidate so far is written")
            raise typer.Exit(ExitCode.INTERRUPTED)
        showing.exit(report)


def _quantile(text: str | None) -> float:
    """From `quantile=0.95`."""
    if text is None:
        return 0.95
    name, _, number = (part.strip() for part in text.partition("="))
    try:
        quantile = float(number)
    except ValueError:
        quantile = 0.0
    if name != "quantile" or not 0 < quantile <= 1:
        raise UsageError(f"--over-ensemble {text}: expected quantile=Q with Q above 0, up to 1, such as quantile=0.95")
    return quantile

"""The commands `check`, `margins`, `frf`, `ensemble` and `tune`: what a loop allows, over many machines, at best."""

import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Literal

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli import options as opt
from gough_stewart.harness.cli.command import Terminal, errors, warn
from gough_stewart.harness.cli.options import choice, flag, option
from gough_stewart.harness.cli.study import Running, study
from gough_stewart.harness.errors import MissedError, UsageError

if TYPE_CHECKING:
    from gough_stewart.harness.tuning.search import Search

Fit = Literal["time", "amplitude"]


@study(figures=("shares",))
def check_command(
    running: Running,
    experiment: opt.PlainExperimentArgument,
    out: Path | None = opt.out_option("results/check_NAME, after the experiment"),
    settings: opt.SetOption = None,
    fit: Fit | None = choice(
        "Also slow the motion down (time) or reduce it (amplitude) until it is within all limits, less the "
        "margin of a path, write it to NAME-fitted.toml beside the experiment, and check it.",
        Fit,
    ),
    payload: str | None = option("A point mass that the platform carries, such as 300kg.", "MASS"),
    payload_height: str = option(
        "Its height above the platform's origin, in the platform's axes.", "LENGTH", default="0 m"
    ),
) -> None:
    """Check whether the platform can follow the motion of an experiment, without running it.

    Along the whole motion it checks stroke, joint angles, distance from singular poses, leg velocity, leg acceleration,
    and force and power by inverse dynamics without external forces. The first line says whether it can be done, and
    what it needs most; if a limit is exceeded, also how much slower or smaller the motion would have to be. Tables have
    the largest share of each limit by leg, and when, and what the motion needs of each leg: stroke, speed, force,
    power, energy and joint angles, peak and RMS.

    Writes **check.json** and **needs.csv**, a row for each leg to choose actuators by; with `--figures` also
    **shares**, the shares of all limits over time.

    Exit code 3 if the motion, or the fitted one, exceeds a limit, or a requirement is not met.

    Examples
    --------
    - `gough-stewart check pitch_sine`

    - `gough-stewart check pitch_sine --set reference.frequency=4 --fit time`
    """
    loaded = opt.chosen_experiment(experiment, settings, executed=lambda _: ())
    from gough_stewart.harness.experiment.checking import FILES, PATHS, absent_numbers, check, check_files
    from gough_stewart.harness.experiment.overrides import typed_value

    running.expect(PATHS, absent=absent_numbers(loaded))
    running.hold(out or opt.results_folder("check", experiment), FILES)
    running.step("shares of all limits")
    mass = None if payload is None else typed_value(payload)
    checked = check(loaded, payload=mass, payload_height=typed_value(payload_height))
    report = checked.report(charts=running.draws)
    running.require(loaded.requirements, report.numbers)
    running.present(report, check_files(checked))
    if fit is not None and not (checked.within and checked.keeps_margin):
        from gough_stewart.harness.experiment.file import text_with_settings
        from gough_stewart.harness.report.terminal import show
        from gough_stewart.model.process.files import write_whole

        # beside the experiment, so that paths in it stay valid; a shipped one is written to the current folder
        fitted = checked.experiment.folder / f"{Path(experiment).stem}-fitted.toml"
        text = text_with_settings(
            experiment,
            {key: changed["value"] for key, changed in checked.experiment.changed.items()},  # the payload's among them
            checked.settings_that_fit(fit),
        )
        write_whole(fitted, text.encode())
        running.command.written.append(fitted.parent)
        checked = check(str(fitted))
        Terminal().say(f"\n{fitted.name}:")
        show(checked.report(charts=False), Terminal())
        next_step = f"gough-stewart run {quote(str(fitted))}"
        running.command.close([fitted.name], fitted.parent, done=None, then=next_step)
    elif fit is not None:
        Terminal().say("The motion is within all limits: there is nothing to fit, and no file is written.")
    if not checked.within:
        raise typer.Exit(ExitCode.MISSED)


@study(figures=("bode", "step"))
def margins_command(
    running: Running,
    experiment: opt.ExperimentArgument,
    out: Path | None = opt.out_option("results/margins_NAME, after the experiment"),
    settings: opt.SetOption = None,
    no_python: opt.NoPythonOption = False,
) -> None:
    """Compute gains, closed-loop modes and stability margins of an experiment, on the linear model.

    The model is linearised at the first pose of the reference, and sampled and delayed as in the experiment. Writes
    **margins.json**; with `--figures` also **bode** and **step**.

    Exit code 3 if a requirement is not met, 4 if that is inconclusive.

    Examples
    --------
    - `gough-stewart margins heave_step`

    - `gough-stewart margins heave_step --set controller.bandwidth=8 --out results/eight`
    """
    loaded = opt.chosen_experiment(experiment, settings, no_python)
    from gough_stewart.harness.experiment.margins import PATHS, absent_numbers, margins
    from gough_stewart.model.process.installed import versions

    running.expect(PATHS, absent=absent_numbers(loaded))
    running.hold(out or opt.results_folder("margins", experiment), ["margins.json"])
    running.step("linear model, margins")
    analysis = margins(loaded)
    report = analysis.report(charts=running.draws)
    running.require(loaded.requirements, report.numbers, "; ".join(analysis.warnings))
    numbers = {**analysis.as_dict(), "versions": versions()}
    running.present(report, {"margins.json": (json.dumps(numbers, indent=2) + "\n").encode()})


@study(numbers=("S", "T", "L", "agreement", "coherence"), figures=("bode",))
def frf_command(
    running: Running,
    record: Path = opt.argument("A record from `run`, or its folder.", "RECORD", parser=opt.path),
    experiment: str | None = option(
        "The experiment of the run, if its controller is a Python file: that file is executed for the linear "
        "model. A record alone never executes code.",
        "FILE.toml|NAME",
        autocompletion=opt.experiments,
    ),
    out: Path | None = option(
        "Folder for the files; created if needed. Default: the record's folder; with --report or --figures, frf in it.",
        "DIR",
        parser=opt.path,
    ),
) -> None:
    """Estimate the frequency responses S, T and L of the leg or mode excited in a run, beside the linear model.

    The run's experiment needs an `[injection]`. Writes **frf.csv** and **frf.parquet** with confidence and coherence;
    with `--figures` also the Bode plot **bode**.

    Examples
    --------
    - `gough-stewart run frequency_response` and `gough-stewart frf results/run_frequency_response`
    """
    run_folder = record if record.is_dir() else record.parent
    # the page of the run is in its folder
    folder = out or (run_folder / "frf" if running.page or running.options.figures else run_folder)
    loaded = None if experiment is None else opt.chosen_experiment(experiment, None)
    from gough_stewart.harness.experiment.frf import FILES, frf

    running.hold(folder, FILES, keeps_data=folder != run_folder)
    running.step("transforms, linear model, figure")
    responses = frf(record, experiment=loaded)
    report = responses.report(charts=running.draws)
    running.require(responses.requirements, report.numbers)
    table, parquet = responses.table(), BytesIO()
    table.write_parquet(parquet)
    running.present(report, {"frf.csv": table.write_csv().encode(), "frf.parquet": parquet.getvalue()})


@study(figures=("distribution", "bands", "dependence", "sensitivity", "beside"), many=True)
def ensemble_command(
    running: Running,
    experiment: opt.ExperimentArgument,
    members: int | None = option("Number of members. Default: from the experiment.", "N", min=1),
    seed: int | None = option("Seed of samples and noise. Default: from the experiment.", "N", min=0),
    out: Path | None = opt.out_option("results/ensemble_NAME, after the experiment"),
    resume: bool = flag("Continue an interrupted run in the folder from its finished chunks.", "--resume"),
    workers: int | None = option(
        "Number of processes on this machine. Default: one thread or process per core.", "N", min=1
    ),
    scheduler: str | None = option(
        "Compute on the workers of this dask.distributed scheduler instead, such as tcp://HOST:8786.", "ADDRESS"
    ),
    compare: str | None = option(
        "Also run this experiment with the same members, and show the differences: it minus the first one. "
        "--set changes only the first.",
        "FILE.toml|NAME",
    ),
    settings: opt.SetOption = None,
    no_python: opt.NoPythonOption = False,
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
    completes its run with a loop that does not grow without input. Members whose loops grow or oscillate are counted in
    a warning.

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
    if workers is not None and scheduler is not None:
        raise UsageError("--workers and --scheduler exclude each other: a scheduler has its own workers; give one")
    loaded = opt.chosen_experiment(experiment, settings, no_python)
    second = None if compare is None else opt.chosen_experiment(compare, None, no_python)
    from gough_stewart.harness.ensemble import compare as comparing
    from gough_stewart.harness.ensemble.ensemble import ensemble
    from gough_stewart.harness.ensemble.member_table import BANDS, MEMBERS, METADATA, SAMPLES
    from gough_stewart.harness.ensemble.worst import WORST, write_worst
    from gough_stewart.harness.report.document import Number
    from gough_stewart.harness.results.metric_folds import METRICS

    # requirements, before anything runs: of margins only if they are computed
    has_margins = loaded.ensemble is not None and loaded.ensemble.margins
    metrics = [metric for metric in METRICS if has_margins or not metric.path.startswith("margins.")]
    # of a comparison those of the second, of the first, or their difference
    prefixes = ("",) if second is None else ("", "first.", "difference.")
    numbers = [Number(f"{prefix}{m.path}", m.text, None, m.quantity) for prefix in prefixes for m in metrics]
    paths = [number.path for number in numbers]
    folder = out or opt.results_folder("ensemble", experiment, "" if second is None else "_compared")
    running.hold(folder, study="ensemble" if second is None else "ensemble --compare")
    running.expect(paths, paths)
    running.require((second or loaded).requirements, numbers)

    options: dict[str, Any] = {
        "members": members,
        "seed": seed,
        "resume": resume,
        "workers": workers,
        "scheduler": scheduler,
        "progress": lambda done, total: running.step(completed=done, total=total),
    }
    if second is None:
        result = ensemble(loaded, out=folder, **options, status=running.step)
        running.command.written.append(folder)
        running.step("worst members and report", total=None)
        report = write_worst(result, folder, pages=running.page, charts=running.draws)
        replaced = {"ensemble.members": members, "ensemble.seed": seed}
        changed = [*(settings or ()), *(f"{key}={value}" for key, value in replaced.items() if value is not None)]
        repeat = "".join(f"--set {quote(setting)} " for setting in changed)
        report = replace(report, repeat=f"gough-stewart run {quote(experiment)} {repeat}--open --member")
        worst = [WORST] if (folder / WORST).is_dir() else []
        running.present(report, [MEMBERS, BANDS, SAMPLES, METADATA, *worst])
        results = [result]
    else:
        stems = Path(experiment).stem, Path(str(compare)).stem
        names = stems if stems[0] != stems[1] else ("A", "B")
        compared = comparing.run_compared((loaded, second), names, folder, running.step, **options)
        running.command.written.append(folder)
        running.step("worst members and reports", total=None)
        results = [compared.a, compared.b]
        for name, result in zip(names, results, strict=True):
            report = write_worst(result, folder / name, pages=running.page, charts=running.draws)
            running.write(report, folder / name, {})
        running.present(comparing.comparison_report(compared, charts=running.draws), [*names, comparing.DIFFERENCES])
    for result in results:
        if not result.works.any():
            how_many, cause = result.members.height, result.members["cause"][0]
            said = f"none of {how_many} members completed its run; the first: {cause}"
            if result.is_complete.any():
                said = f"no member completed its run with a loop that does not grow: {result.oscillation_warning}"
            raise MissedError(said)


@study(figures=("search", "values"))
def tune_command(
    running: Running,
    experiment: opt.ExperimentArgument,
    vary: list[str] = option(
        "A key and its bounds, such as controller.bandwidth=1..6Hz; add ,log for a logarithmic scale. May be repeated.",
        "KEY=LOW..HIGH",
        default=...,
    ),
    minimise: str = option("The metric to minimise, such as tracking.position.norm_rms.", "METRIC", default=...),
    subject_to: list[str] | None = option(
        "A condition, such as 'margins.disk > 0.5' or 'stroke.margin >= 10 mm'; may be repeated.", "CONDITION"
    ),
    over_ensemble: str | None = option(
        "Minimise this quantile over the members of the [ensemble], such as quantile=0.95.", "quantile=Q"
    ),
    members: int | None = option("Number of members that evaluate a candidate. Default: at most 64.", "N", min=1),
    fresh: int | None = option("Number of members, not used in the search, that evaluate the result.", "N", min=1),
    generations: int = option("Number of generations.", "N", default=25, min=1),
    population: int | None = option("Candidates per generation. Default: 16 per key.", "N", min=5),
    seed: opt.SeedOption = 0,
    out: Path | None = opt.out_option("results/tune_NAME, after the experiment"),
    settings: opt.SetOption = None,
    no_python: opt.NoPythonOption = False,
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
    quantile = 0.95
    if over_ensemble is not None:
        name, _, number = (part.strip() for part in over_ensemble.partition("="))
        try:
            quantile = float(number)
        except ValueError:
            quantile = 0.0
        if name != "quantile" or not 0 < quantile <= 1:
            raise UsageError(
                f"--over-ensemble {over_ensemble}: expected quantile=Q with Q above 0, up to 1, such as quantile=0.95"
            )
    loaded = opt.chosen_experiment(experiment, settings, no_python)
    if over_ensemble is not None and loaded.ensemble is None:
        raise UsageError(
            f"--over-ensemble {over_ensemble}: {experiment} has no [ensemble], so there are no machines that "
            "differ; add one, or leave the option out"
        )
    if over_ensemble is None:
        loaded = loaded.model_copy(update={"ensemble": None})
    from gough_stewart.harness.experiment.file import text_with_settings
    from gough_stewart.harness.results.metric_folds import METRICS, metric_of
    from gough_stewart.harness.tuning.tune import tune
    from gough_stewart.harness.tuning.tuning import TUNED, tuning_files

    # before a long search: whether its result can be judged, and written as a file
    metrics = [metric.path for metric in METRICS]
    differs = over_ensemble is not None or loaded.sensors.noise or loaded.loop.jitter
    running.expect(["value", "values", "fresh", *metrics], metrics if differs and fresh != 1 else ())
    folder = running.hold(out or opt.results_folder("tune", experiment), (TUNED, "tuning.json", "candidates.csv"))
    text_with_settings(experiment, settings or (), folder=folder)

    def status(search: "Search") -> None:
        quantity, best = metric_of(search.goal.metric).quantity, search.best
        so_far = "none yet" if best is None else quantity.text(best.value)
        running.step(f"best {so_far}", completed=search.generation[-1] + 1, total=generations)

    result = tune(
        loaded,
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
    report = result.report(charts=running.draws)
    if result.left_out:
        warn(f"{result.left_out} members have impossible parameters and are left out")
    running.require(loaded.requirements, report.numbers)
    then = f"gough-stewart run {quote(str(folder / TUNED))}"
    running.present(report, tuning_files(result, experiment, folder, settings or ()), then=then)
    if result.is_interrupted:
        errors.say(("interrupted", "bold red"), "; the best candidate so far is written")
        raise typer.Exit(ExitCode.INTERRUPTED)

"""The commands `run`, `live` and `serve`, which run an experiment's loop, and `view`, the page of any command."""

import math
import shlex
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli import options as opt
from gough_stewart.harness.cli.command import Terminal, clear_errors, errors, progress_bar, warn, wrong_use_if
from gough_stewart.harness.cli.options import choice, flag, option
from gough_stewart.harness.cli.study import DATA, PAGE, RECORDS, Running, study
from gough_stewart.harness.errors import ExportError, MissedError, RecordError, UsageError
from gough_stewart.harness.plants import FMI_VERSIONS, PlantKind

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.schema import Experiment


@study()
def run_command(
    running: Running,
    experiment: opt.ExperimentArgument,
    plant: PlantKind | None = choice("Simulator of the platform. Default: from the experiment.", PlantKind),
    fmu: Path | None = option(
        "The FMU for the plant fmu2 or fmu3; built if omitted. Its code is executed in a process of its own.",
        "FILE",
        parser=opt.path,
    ),
    controller: str | None = option(
        "The controller as FMU: fmu2 or fmu3 exports the experiment's own; a file is executed in a process of"
        " its own. Needs a loop.delay of at least 1.",
        "fmu2|fmu3|FILE.fmu",
    ),
    allow_unstable: bool = flag(
        "Run with --controller fmu2 or fmu3 although that loop is unstable when linear.", "--allow-unstable"
    ),
    anyway: opt.FormerNameOption = False,
    member: int | None = option(
        "Run this member of the experiment's ensemble, with the same results as there; with --plant, in that plant.",
        "K",
    ),
    out: Path | None = opt.out_option("results/run_NAME, after the experiment"),
    settings: opt.SetOption = None,
    no_python: opt.NoPythonOption = False,
) -> None:
    """Run an experiment: a controller in a loop with the stepping model or the FMU, sampled as on the machine.

    Says first how closely the platform follows, what it uses of its drives, and when it settles. Writes **record.csv**,
    **record.parquet** and **metadata.json** (all variables, references, errors, controller states, flags) and
    **metrics.json**; with `--figures` also **errors**, **pose**, **actuators** and **legs**.

    Exit code 3 if a requirement is not met, or the loop diverged or grows without input, or was stopped by a limit, by
    its controller or by the FMU; 4 if a requirement is inconclusive; 130 after Ctrl-C. The rows up to that time are
    still written. A loop that oscillates without input gets a warning.

    Examples
    --------
    - `gough-stewart run heave_step --plant fmu3`

    - `gough-stewart run heave_step --set controller.bandwidth=4 --set loop.delay=2 --out results/faster`

    - `gough-stewart run heave_step --plant fmu3 --controller fmu3 --set loop.delay=1`

    - `gough-stewart run heave_tolerances --member 17 --report`

    - `gough-stewart experiments heave_step > mine.toml`, change it, then `gough-stewart run mine.toml`
    """

    def executed(loaded: "Experiment") -> tuple[str, ...]:
        law = loaded.controller.code if controller is None or controller in FMI_VERSIONS else ()
        # members without a plant of their own run in the compiled batch
        in_batch = member is not None and plant is None and fmu is None
        is_own = fmu is None and plant in (None, loaded.plant.kind) and not in_batch
        return law if loaded.plant.fmu is None or not is_own else (*law, loaded.plant.fmu)

    loaded = opt.chosen_experiment(experiment, settings, no_python, executed)
    folder = out or opt.results_folder("run", experiment, "" if member is None else f"_member_{member}")
    from gough_stewart.harness.experiment.run import names_of_files, run, warnings_of, write_results
    from gough_stewart.harness.report.document import Note
    from gough_stewart.harness.results.metric_folds import METRICS
    from gough_stewart.harness.results.oscillation import oscillation

    running.hold(folder, names_of_files())
    # of margins a run has the disk margin of its own experiment alone
    margins = {"margins.disk"} if controller is None and member is None else set()
    metrics = [metric for metric in METRICS if not metric.path.startswith("margins.") or metric.path in margins]
    running.expect([metric.path for metric in metrics])
    requirements = running.require(loaded.requirements, metrics)
    running.step(total=loaded.loop.duration)
    replacement: AbstractContextManager[Any] = nullcontext()  # of the experiment's own controller
    if controller is not None and controller in FMI_VERSIONS:
        from gough_stewart.harness.export.controller_units import exported_controller

        allowed = allow_unstable or anyway
        version = FMI_VERSIONS[controller]
        replacement = exported_controller(loaded, version, running.step, allow_unstable=allowed, warn=warn)
    elif controller is not None:
        warn(f"the stability of the loop with {controller} is not judged: an FMU has no linear form")
        replacement = nullcontext(opt.path(controller))
    with replacement as unit:
        record = run(
            loaded,
            plant=plant,
            fmu=fmu,
            controller=unit,
            member=member,
            progress=lambda time: running.step(loaded.title, completed=time),
            status=running.step,
            warn=warn,
        )
    running.step("files and report", total=None)
    robustness = None
    if any(required.path == "margins.disk" for required in requirements):
        from gough_stewart.harness.experiment.margins import robustness_of

        robustness = robustness_of(loaded)
    swinging = oscillation(record)
    swings = [] if swinging is None or swinging.is_growing else [swinging.text()]
    files, report = write_results(
        record,
        folder,
        page=running.page,
        figures=running.options.figures,
        charts=running.options.as_json,
        requirements=requirements,
        notes=[Note(warning, "warning") for warning in (*warnings_of(record), *swings)],
        robustness=robustness,
    )
    outcome = record.metadata["outcome"]
    is_whole = outcome["status"] == "completed"
    simulated = f"{outcome['time']:.6g} s" if is_whole else f"{outcome['time']:.6g} of {loaded.loop.duration:.6g} s"
    running.present(
        report,
        files,
        done=f"{'Completed' if is_whole else 'Not completed'}: {simulated} simulated",
        then=None if running.page else f"gough-stewart view {shlex.quote(str(folder))} --open",
        is_written=True,
    )
    if not is_whole:
        errors.say((outcome["status"], "bold red"), f" at {outcome['time']:.6g} s: {outcome['cause']}")
        raise typer.Exit(ExitCode.INTERRUPTED if outcome["status"] == "interrupted" else ExitCode.MISSED)
    if swinging is not None and swinging.is_growing:
        errors.say(("growing: ", "bold red"), swinging.text())
        raise typer.Exit(ExitCode.MISSED)


def live_command(
    experiment: opt.PlainExperimentArgument,
    settings: opt.SetOption = None,
    out: Path | None = option("The page to write. Default: NAME_live.html.", "FILE.html", parser=opt.path),
    no_open: bool = flag("Do not open it in the browser.", "--no-open"),
) -> None:
    """Play with the loop of an experiment in the browser: it runs there, from the same compiled code as everywhere.

    Writes one page, which needs no network, server or installation, and opens it: drag the platform, load and push it,
    and see what its legs do.

    Examples
    --------
    - `gough-stewart live heave_step`

    - `gough-stewart live mine.toml --set controller.bandwidth=3 --out mine.html --no-open`
    """
    with clear_errors() as command:
        if out is not None:
            opt.check_page_name(out)
        with progress_bar() as progress:
            progress.add_task("writing the page", total=None)
            from gough_stewart.harness.export.choices import name_of
            from gough_stewart.harness.export.live.page import live_page
            from gough_stewart.model.process.files import write_files

            loaded = opt.chosen_experiment(experiment, settings, executed=lambda _: ())
            page = Path(f"{name_of(loaded)}_live.html") if out is None else out
            write_files(page.parent, {page.name: live_page(loaded)})
        command.written.append(page)
        command.close([page.name], page.parent, open_it=not no_open)


def serve_command(
    experiment: opt.PlainExperimentArgument,
    udp: int = option("The port to listen on; 0 is any that is free.", "PORT", "--udp", default=..., min=0, max=65535),
    settings: opt.SetOption = None,
    host: str = option("The address to listen on; 0.0.0.0 opens it to the network.", "HOST", default="127.0.0.1"),
    rate: float = option("Rows a second, at most 250.", "HZ", default=100.0),
    binary: bool = flag("Fixed binary rows instead of JSON.", "--binary"),
    silence: float = option("A sender that is silent for this long is lost.", "SECONDS", default=1.0),
    stop: bool = flag("End when the sender is lost; else its pose holds.", "--stop"),
    duration: float = option("End after this time. Default: at Ctrl-C.", "SECONDS", default=math.inf, min=0),
) -> None:
    """Run the loop of an experiment in real time, for games, displays and motion software: poses out and in, over UDP.

    A datagram, also an empty one, asks for rows for 10 s; one with a pose is where the platform is to go, by a filter
    with limits of speed and acceleration. Ends at Ctrl-C or SIGTERM and says what came and went.

    Examples
    --------
    - `gough-stewart serve heave_step --udp 9750`

    - `gough-stewart serve mine.toml --udp 9750 --binary --rate 250 --stop`
    """
    with clear_errors():
        with progress_bar() as progress:
            progress.add_task("preparing", total=None)
            from gough_stewart.harness.export.stream import Stream

            loaded = opt.chosen_experiment(experiment, settings, executed=lambda _: ())
            try:
                with wrong_use_if(ExportError):
                    stream = Stream(loaded, (host, udp), rate, binary, silence, stop)
            except OSError as error:
                raise UsageError(f"--udp {udp}, --host {host}: {error.strerror or error}; choose others") from error
        Terminal().say(f"Listening on {host}:{stream.port}, UDP. Ctrl-C ends it.")
        sys.stdout.flush()  # a program that has started this one waits for it
        tally = stream.run(duration)
        Terminal().say(
            f"{tally.time:.1f} s simulated: {tally.rows} rows out, {tally.packets} packets in, {tally.malformed} "
            f"malformed, {tally.out_of_reach} out of reach, {tally.late} late rows, "
            f"{tally.losses} losses of the sender."
        )
        if tally.ended:
            raise MissedError(f"the loop ended at {tally.time:.3f} s: {tally.ended}")


def view_command(
    records: list[Path] = opt.argument(
        "The folder of any command, or a report.json; of runs also several, or their record.parquet or record.csv.",
        "FOLDER",
        parser=opt.path,
    ),
    out: Path = option("The page to write.", "FILE.html", default=Path("report.html"), parser=opt.path),
    open_it: bool = flag("Open the page in the browser.", "--open"),
) -> None:
    """Show in a browser what a command found: verdict, numbers, charts; of runs also the platform in 3-D motion.

    Writes one self-contained page: it needs no network, server or other file. Several runs are overlaid.

    Examples
    --------
    - `gough-stewart view results/run_heave_step --open`

    - `gough-stewart view results/margins_heave_step --open`

    - `gough-stewart view results/run_circle results/run_circle_computed_torque --out compared.html`
    """
    with clear_errors() as command:
        opt.check_page_name(out)
        for missing in (record for record in records if not record.exists()):
            raise RecordError(
                f"{missing}: no such file or folder; expected the folder of a command, its report.json, or the "
                "record.parquet or record.csv of a run"
            )
        page, place = out, records[0]
        is_run = any((place / name).is_file() for name in RECORDS)
        is_report = place.name == DATA or any((place / name).is_file() for name in (DATA, PAGE))
        data = place if place.name == DATA else place / DATA
        with progress_bar() as progress:
            task = progress.add_task("reading", total=None)
            if len(records) > 1 or is_run or not is_report:
                from gough_stewart.harness.view.view import view

                view(records, out, progress=lambda stage: progress.update(task, description=stage))
            elif place.name != DATA and not data.is_file():
                page = place / PAGE  # that its command has written
            else:
                from gough_stewart.harness.report.document import from_json
                from gough_stewart.harness.report.page import page_of
                from gough_stewart.model.process.files import write_files

                try:
                    report = from_json(data.read_bytes())
                except (ValueError, KeyError) as error:
                    raise RecordError(
                        f"{data}: cannot be read as a report: {error}; expected what a command writes"
                    ) from error
                # of an ensemble with signals of its members, from which their bands are drawn
                if report.study == "ensemble" and (data.parent / "samples.parquet").exists():
                    from gough_stewart.harness.ensemble.charts import with_samples
                    from gough_stewart.harness.ensemble.ensemble_report import read_ensemble

                    samples = read_ensemble(data.parent).samples
                    report = report if samples is None else with_samples(report, samples)
                write_files(out.parent, {out.name: page_of(report)})
        if page == out:
            command.written.append(out)
        command.close([page.name], page.parent, open_it=open_it)

"""The command `identify`: identifies parameters of a platform from a log."""

import shlex
import warnings
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.options import (
    NoPythonOption,
    PlatformOption,
    PresetOption,
    SetOption,
    choices,
    chosen_experiment,
    chosen_platform,
    experiments,
    log_folder,
    out_option,
    path,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import preparing, progress_bar
from gough_stewart.harness.errors import IdentificationWarning, UsageError


class Method(StrEnum):
    """How parameters are estimated."""

    linear = "linear"
    geometry = "geometry"


class Side(StrEnum):
    """The side of legs that give at which lengths were measured."""

    leg = "leg"
    motor = "motor"


class PoseFrame(StrEnum):
    """The frame in which poses are measured."""

    world = "world"
    own = "own"


@shows
def identify_command(
    logs: Annotated[
        list[Path],
        typer.Argument(
            help="A CSV or Parquet file, or the folder of a record; several of one machine are fitted at once.",
            metavar="LOG",
            parser=path,
        ),
    ],
    estimate: Annotated[
        str,
        typer.Option(
            help="Parameters to estimate, separated by commas; NAME[1..6] for each leg.",
            metavar="NAME,…",
        ),
    ],
    preset: PresetOption = None,
    platform: PlatformOption = None,
    method: Annotated[Method, typer.Option(help="Method of estimation.", metavar=choices(Method))] = Method.linear,
    force_per_current: Annotated[
        float | None,
        typer.Option(
            help="Force per current of each motor [N/A], for logs with motor_current[1..6].", metavar="FACTOR"
        ),
    ] = None,
    holds_force: Annotated[
        bool,
        typer.Option(
            "--holds-force",
            help="Forces are commands of a sampled controller: each acts from its row to the next. Without it, forces "
            "are readings at the times of their rows. Records of `run` say so themselves.",
        ),
    ] = False,
    side: Annotated[
        Side | None,
        typer.Option(
            help="Of legs that give, where leg_length was measured. Records of `run` say so themselves; columns "
            "motor_position[1..6] are the motors'.",
            metavar=choices(Side),
            show_default="leg",
        ),
    ] = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(
            help="A log of the same machine that validates the fit and is not fitted; may be repeated. Then all of the "
            "other logs is fitted.",
            metavar="LOG",
            parser=path,
        ),
    ] = None,
    validation: Annotated[
        float | None,
        typer.Option(
            help="Share of each log, at its end, that validates the fit and is not fitted.",
            metavar="SHARE",
            show_default="0.2",
        ),
    ] = None,
    pose_frame: Annotated[
        PoseFrame | None,
        typer.Option(
            help="Frame of measured poses: world, or the tracker's own, at any unknown pose.",
            metavar=choices(PoseFrame),
        ),
    ] = None,
    experiment: Annotated[
        str | None,
        typer.Option(
            help="Run this experiment with the nominal platform and with the identified one, and compare errors and "
            "margins.",
            metavar="FILE.toml|NAME",
            autocompletion=experiments,
        ),
    ] = None,
    settings: SetOption = None,
    no_python: NoPythonOption = False,
    out: Annotated[Path | None, out_option("results/identify_NAME, after the log")] = None,
    *,
    showing: Showing,
) -> None:
    """Identify parameters of a platform from logs of time, leg lengths and forces, with their uncertainty.

    A log is a record of `run`, or has the columns `time`, `leg_length[1..6]`, `actuator_force[1..6]` or
    `motor_current[1..6]`, with units in their names where they are not SI: `time [ms]`.

    Writes **platform.toml** for `run`; **estimate.json** with values, intervals, correlation, observability and
    residuals; with `--figures` also **parameters**, **fit** and **residuals**.

    If the log contradicts the model, or much of it is damaged, the files are written, and the exit code is 3.

    Examples
    --------
    - `gough-stewart identify log.csv --platform nominal.toml --estimate platform_mass,platform_com`

    - `gough-stewart identify slow.csv fast.csv --platform nominal.toml --estimate platform_mass --validate other.csv`

    - `gough-stewart identify poses.csv --platform nominal.toml --estimate base_points,leg_length_offset`
    """
    with clear_errors() as command:
        out = out or log_folder("identify", logs[0])
        if validate and validation is not None:
            raise UsageError("--validate and --validation exclude each other; give one")
        nominal = chosen_platform(preset, platform)
        with preparing():
            from gough_stewart.harness.identify.estimate import FILES, identification_files
            from gough_stewart.harness.identify.identify import identify
            from gough_stewart.harness.identify.log import read_log
            from gough_stewart.harness.identify.report import estimate_report
            from gough_stewart.harness.identify.retuned import before_and_after
            from gough_stewart.harness.report.document import settings_of
            from gough_stewart.model.process.files import check_output_folder, write_files

        check_output_folder(out, FILES)
        chosen = None
        if experiment is not None:
            chosen = chosen_experiment(experiment, settings, no_python, lambda chosen: chosen.code)
        with progress_bar() as progress:
            task = progress.add_task("identifying", total=None)
            options: dict[str, Any] = {} if pose_frame is None else {"pose_frame": pose_frame.value}
            of_log: dict[str, Any] = {"holds_force": holds_force or None, "side": side and side.value}
            read = [read_log(log, force_per_current, **of_log) for log in logs]
            if validate:
                options["validation"] = [read_log(log, force_per_current, **of_log) for log in validate]
            elif validation is not None:
                options["validation"] = validation
            with warnings.catch_warnings(action="ignore", category=IdentificationWarning):  # the report says it
                found = identify(read, nominal, estimate, method.value, **options)
            compared = None
            if chosen is not None:
                progress.update(task, description="before and after")
                compared = before_and_after(chosen, nominal, found.platform(nominal))
            files = identification_files(found, nominal)
        write_files(out, files)
        command.written.append(out)
        more = [] if compared is None else [compared.table]
        report = estimate_report(found, nominal.name, more, charts=showing.draws)
        of_file: tuple[str, ...] = ()
        if chosen is not None and compared is not None:
            report = replace(report, settings=settings_of(chosen.changed), numbers=(*report.numbers, *compared.numbers))
            of_file = chosen.requirements
        then = None
        if found.not_excited:
            of = f"--platform {shlex.quote(str(platform))}" if platform else f"--preset {preset or nominal.name}"
            then = f"gough-stewart excite {of} --estimate {shlex.quote(estimate)}"
        report = showing.present(
            command,
            report,
            out,
            list(files),
            requirements=showing.requirements(of_file, report.numbers),
            figures=("parameters", "fit", "residuals"),
            then=then,
            exits=False,
        )
        if found.alarms:
            raise typer.Exit(ExitCode.MISSED)
        showing.exit(report)

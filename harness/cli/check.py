"""The command `check`: checks whether a platform can follow the motion of an experiment."""

import shlex
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.exit_codes import ExitCode
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    SetOption,
    choices,
    chosen_experiment,
    out_option,
    results_folder,
)
from gough_stewart.harness.cli.showing import DATA, PAGE, Showing, shows
from gough_stewart.harness.cli.terminal import Terminal, progress_bar

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.checking import MotionCheck


# Pictures of an older check, which do not stay beside new numbers.
FORMER = [f"shares.{kind}" for kind in ("pdf", "png", "svg")]


class Fit(StrEnum):
    """How a motion is made to fit the limits."""

    time = "time"
    amplitude = "amplitude"


@shows
def check_command(
    experiment: ExperimentArgument,
    out: Annotated[Path | None, out_option("results/check_NAME, after the experiment")] = None,
    settings: SetOption = None,
    fit: Annotated[
        Fit | None,
        typer.Option(
            help="Also slow the motion down (time) or reduce it (amplitude) until it is within all limits, less the "
            "margin of a path, write it to NAME-fitted.toml beside the experiment, and check it.",
            metavar=choices(Fit),
        ),
    ] = None,
    payload: Annotated[
        str | None, typer.Option(help="A point mass that the platform carries, such as 300kg.", metavar="MASS")
    ] = None,
    payload_height: Annotated[
        str, typer.Option(help="Its height above the platform's origin, in the platform's axes.", metavar="LENGTH")
    ] = "0 m",
    *,
    showing: Showing,
) -> None:
    """Check whether the platform can follow the motion of an experiment, without running it.

    Along the whole motion it checks stroke, joint angles, distance from singular poses, leg velocity, leg acceleration,
    and force and power by inverse dynamics without load. The first line says whether it can be done, and what it needs
    most; if a limit is exceeded, also how much slower or smaller the motion would have to be. Tables have the largest
    share of each limit by leg, and when, and what the motion needs of each leg: stroke, speed, force, power, energy
    and joint angles, peak and RMS.

    Writes **check.json** and **needs.csv**, a row for each leg to choose actuators by; with `--figures` also
    **shares**, the shares of all limits over time.

    Exit code 3 if the motion, or the fitted one, exceeds a limit, or a requirement is not met.

    Examples
    --------
    - `gough-stewart check pitch_sine`

    - `gough-stewart check pitch_sine --set reference.frequency=4 --fit time`
    """
    with clear_errors() as command:
        chosen = chosen_experiment(experiment, settings, no_python=False, executed=lambda _: ())
        folder = out or results_folder("check", experiment)
        with progress_bar() as bar:
            bar.add_task("shares of all limits", total=None)
            from gough_stewart.harness.experiment.checking import FILES, check, check_files
            from gough_stewart.model.process.files import check_output_folder, write_files

            check_output_folder(folder, [*FILES, PAGE, DATA])
            found = check(chosen, payload=payload, payload_height=payload_height)
            report = found.report(charts=showing.draws)
            requirements = showing.requirements(found.experiment.requirements, report.numbers)
            files = check_files(found)
        write_files(folder, files, FORMER)
        report = showing.present(command, report, folder, list(files), requirements=requirements, exits=False)
        if fit is not None and not (found.within and found.keeps_margin):
            with progress_bar() as bar:
                bar.add_task("fitting", total=None)
                path = _write_fitted(experiment, settings or [], found, fit.value)
                command.written.append(path.parent)
                found = check(str(path), payload=payload, payload_height=payload_height)
            from gough_stewart.harness.report.terminal import show

            Terminal().say(f"\n{path.name}:")
            show(found.report(charts=False), Terminal())
            command.close([path.name], path.parent, done=None, then=f"gough-stewart run {shlex.quote(str(path))}")
        if not found.within:
            raise typer.Exit(ExitCode.MISSED)
        showing.exit(report)


def _write_fitted(experiment: str, settings: list[str], found: "MotionCheck", fit: str) -> Path:
    """Write the fitted experiment beside its file, so that paths in it stay valid.

    A shipped experiment is written to the current folder.
    """
    from gough_stewart.harness.experiment.file import text_with_settings
    from gough_stewart.model.process.files import write_whole

    fitting = found.settings_that_fit("time" if fit == "time" else "amplitude")
    path = found.experiment.folder / f"{Path(experiment).stem}-fitted.toml"
    write_whole(path, text_with_settings(experiment, settings, fitting).encode())
    return path

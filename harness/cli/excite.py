"""The command `excite`: designs a motion for identification."""

import shlex
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import (
    PlatformOption,
    PresetOption,
    SeedOption,
    choices,
    chosen_platform,
    out_option,
    platform_folder,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import preparing, progress_bar
from gough_stewart.harness.errors import UsageError


class Criterion(StrEnum):
    """What is optimised."""

    determinant = "determinant"
    trace = "trace"


@shows
def excite_command(
    preset: PresetOption = None,
    platform: PlatformOption = None,
    estimate: Annotated[
        str,
        typer.Option(
            help="The parameters to identify.",
            metavar="NAME,…",
            show_default="mass, com and inertia of the platform, friction of the legs",
        ),
    ] = "platform_mass,platform_com,platform_inertia,leg_viscous_friction,leg_coulomb_friction",
    duration: Annotated[float, typer.Option(help="Duration of the motion [s].", metavar="SECONDS")] = 20.0,
    frequency: Annotated[float, typer.Option(help="Frequency of the first harmonic [Hz].", metavar="HZ")] = 0.1,
    harmonics: Annotated[int, typer.Option(help="Number of harmonics.", metavar="N", min=1, max=100)] = 5,
    fade: Annotated[
        float, typer.Option(help="Duration of the fade from rest and to rest [s].", metavar="SECONDS")
    ] = 1.0,
    criterion: Annotated[
        Criterion,
        typer.Option(
            help="What to optimise: the determinant of the information, or the trace of its inverse.",
            metavar=choices(Criterion),
        ),
    ] = Criterion.determinant,
    trials: Annotated[
        int, typer.Option(help="Number of motions from which the search starts.", metavar="N", min=1)
    ] = 2,
    seed: SeedOption = 0,
    out: Annotated[Path | None, out_option("results/excite_NAME, after the platform")] = None,
    *,
    showing: Showing,
) -> None:
    """Design a motion for the identification of parameters: a finite Fourier series within all limits.

    Writes **excitation.toml**, an experiment for `run`, and, if the platform is your own file, **platform.toml** beside
    it.

    Examples
    --------
    - `gough-stewart excite --preset motion_base`, then `gough-stewart run results/excite_motion_base/excitation.toml`
    """
    with clear_errors() as command:
        out = out or platform_folder("excite", preset, platform)
        for name, value in (("duration", duration), ("frequency", frequency), ("fade", fade)):
            if not 0 < value < float("inf"):
                raise UsageError(f"--{name} is {value:g}; expected a number > 0")
        chosen = chosen_platform(preset, platform)
        with preparing():
            from gough_stewart.harness.identify.excite import excite, excite_report, experiment_text
            from gough_stewart.harness.identify.names import expanded
            from gough_stewart.model.platform import platform_to_toml
            from gough_stewart.model.process.files import Content, check_output_folder, write_files

        check_output_folder(out, ("excitation.toml", "platform.toml"))
        with progress_bar() as progress:
            task = progress.add_task("motions", total=None)
            found = excite(
                chosen,
                estimate,
                duration=duration,
                frequency=frequency,
                harmonics=harmonics,
                fade=fade,
                criterion=criterion.value,
                trials=trials,
                seed=seed,
                status=lambda what: progress.update(task, description=what),
            )
        line = 'file = "platform.toml"' if platform is not None else f'preset = "{chosen.name}"'
        text = experiment_text(found, chosen, line, estimate, seed)
        files: dict[str, Content] = {"excitation.toml": text.encode()}
        if platform is not None:
            files["platform.toml"] = platform_to_toml(chosen).encode()
        write_files(out, files)
        command.written.append(out)
        report = excite_report(found, chosen, expanded(estimate.split(","), chosen), duration)
        then = f"gough-stewart run {shlex.quote(str(out / 'excitation.toml'))}"
        showing.present(command, report, out, list(files), then=then)

"""The command `excite`: a motion made to tell parameters."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.options import PlatformOption, PresetOption, chosen_platform, path
from gough_stewart.harness.cli.terminal import Terminal, clear_errors, preparing, progress_bar, say_written
from gough_stewart.harness.errors import UsageError


class Criterion(StrEnum):
    """What is made best."""

    condition = "condition"
    determinant = "determinant"


def excite_command(
    preset: PresetOption = None,
    platform: PlatformOption = None,
    estimate: Annotated[
        str, typer.Option(help="The parameters that the motion is to tell.", metavar="NAME,…")
    ] = "platform_mass,platform_com,platform_inertia,leg_viscous_friction,leg_coulomb_friction",
    duration: Annotated[float, typer.Option(help="[s]")] = 20.0,
    frequency: Annotated[float, typer.Option(help="Of the first harmonic [Hz].")] = 0.1,
    harmonics: Annotated[int, typer.Option(help="How many there are.", min=1, max=100)] = 5,
    fade: Annotated[float, typer.Option(help="From and to rest [s].")] = 1.0,
    criterion: Annotated[
        Criterion, typer.Option(help="The regressor's condition number, or the determinant of its information.")
    ] = Criterion.condition,
    trials: Annotated[int, typer.Option(help="How many motions are tried.", min=1)] = 150,
    seed: Annotated[int, typer.Option(help="The same seed, the same motion.", min=0)] = 0,
    out: Annotated[Path, typer.Option(help="Folder for the files; made if needed.", metavar="DIR", parser=path)] = Path(
        "results/excite"
    ),
) -> None:
    """A motion within all limits of a platform that tells its parameters as well as it can: finite Fourier series.

    Writes **excitation.toml**, an experiment that `run` takes, and **platform.toml** beside it, if the platform is a
    file of your own.

    Examples
    --------
    - `gough-stewart excite --preset motion_base`, then `gough-stewart run results/excite/excitation.toml`
    """
    with clear_errors() as written:
        for name, value in (("duration", duration), ("frequency", frequency), ("fade", fade)):
            if not 0 < value < float("inf"):
                raise UsageError(f"--{name} is {value:g}; expected a number > 0")
        chosen = chosen_platform(preset, platform)
        with preparing():
            from gough_stewart.harness.identify.excite import excite
            from gough_stewart.harness.identify.experiment_text import experiment_text
            from gough_stewart.model.files import Content, check_output_folder, write_files
            from gough_stewart.model.platform_toml import platform_to_toml

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
        written.append(out)
        Terminal().say(f"Condition number {found.condition_number:.4g}, log det {found.log_determinant:.4g}")
        say_written(files, out)

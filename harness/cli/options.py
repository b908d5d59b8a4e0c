"""Options that several commands have, and what they choose.

Commands import what they work with inside of their functions: --help and a mistyped command need not wait for NumPy.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.errors import UsageError

if TYPE_CHECKING:
    from gough_stewart.harness.experiment.schema import Experiment
    from gough_stewart.model.platform import Platform


def path(text: str) -> Path:
    """A path; nothing is none, though pathlib takes it for the folder one is in."""
    if not text:
        raise typer.BadParameter("is empty; expected a path, or . for the folder you are in")
    return Path(text)


PresetOption = Annotated[
    str | None,
    typer.Option(help="A platform that ships with the package; see `gough-stewart presets`.", metavar="NAME"),
]
PlatformOption = Annotated[
    Path | None, typer.Option(help="A platform file of your own, TOML.", metavar="FILE", parser=path)
]
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
    Path | None,
    typer.Option(help="Folder for the files; made if needed. Default: results/NAME.", metavar="DIR", parser=path),
]
ReportOption = Annotated[
    bool, typer.Option("--report", help="Write report.html too: the motion in 3-D beside its curves, for a browser.")
]


def chosen_platform(preset: str | None, platform: Path | None) -> "Platform":
    """The platform of a preset or a file; the paper's if there is neither.

    Raises
    ------
    UsageError
        Both are given.
    """
    if preset is not None and platform is not None:
        raise UsageError("--preset and --platform exclude each other; give one")
    from gough_stewart.model.formulations import cases
    from gough_stewart.model.platform_toml import load_platform, load_preset

    if platform is not None:
        return load_platform(platform)
    return load_preset(cases.PAPER_PRESET if preset is None else preset)


def chosen_experiment(given: str, settings: list[str] | None) -> "Experiment":
    """The experiment of a file, or a shipped one by its name; a file of that name goes first."""
    from gough_stewart.harness.experiment.file import load_experiment

    return load_experiment(given, settings or [])

"""The options that choose a platform, shared by the commands."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.terminal import UsageError
from gough_stewart.model import cases
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_platform, load_preset

PresetOption = Annotated[
    str | None,
    typer.Option(help="A platform that ships with the package; see `gough-stewart presets`.", metavar="NAME"),
]
PlatformOption = Annotated[Path | None, typer.Option(help="A platform file of your own, TOML.", metavar="FILE")]


def chosen_platform(preset: str | None, platform: Path | None) -> Platform:
    """The platform of a preset or a file; the paper's if there is neither.

    Raises
    ------
    UsageError
        Both are given.
    """
    if preset is not None and platform is not None:
        raise UsageError("--preset and --platform exclude each other; give one")
    if platform is not None:
        return load_platform(platform)
    return load_preset(cases.PAPER_PRESET if preset is None else preset)

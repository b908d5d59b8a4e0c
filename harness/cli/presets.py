"""The command `presets`: lists the shipped platforms."""

from dataclasses import replace
from typing import Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors, wrong_use_if
from gough_stewart.harness.cli.options import presets
from gough_stewart.harness.cli.terminal import show
from gough_stewart.model.errors import PlatformFileError


def presets_command(
    name: Annotated[
        str | None,
        typer.Argument(help="Print this preset's TOML file.", metavar="NAME", autocompletion=presets),
    ] = None,
) -> None:
    """List the platforms that ship with the package, or print one as TOML to start a file of your own."""
    with clear_errors():
        from gough_stewart.harness.report.quantities import MASS, NUMBER, POSITION
        from gough_stewart.harness.report.table import Column, Table
        from gough_stewart.model import kinematics
        from gough_stewart.model.platform import load_preset, preset_names, preset_text

        if name is not None:
            with wrong_use_if(PlatformFileError):
                text = preset_text(name)
            typer.echo(text, nl=False)
            return
        rows = []
        for each in preset_names():
            p = load_preset(each)
            home = (p, p.home_position, p.home_orientation)
            length = kinematics.leg_geometry(*home).length.mean()
            number = kinematics.conditioning(*home).condition_number
            rows.append((each, p.platform_mass, float(length), float(number), p.source))
        columns = (
            Column("name"),
            Column("platform", replace(MASS, digits=6)),
            Column("home leg", POSITION),
            Column("condition", replace(NUMBER, digits=3)),
            Column("source"),
        )
        show(Table("", columns, tuple(rows)))

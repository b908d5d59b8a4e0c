"""The command `build`: the platform as FMU."""

from pathlib import Path
from typing import Annotated

import typer

from gough_stewart.harness.cli.options import (
    FmiOption,
    PlatformOption,
    PresetOption,
    TargetOption,
    chosen_platform,
    path,
)
from gough_stewart.harness.cli.terminal import Terminal, clear_errors, preparing, progress_bar


def build_command(
    fmi: FmiOption = None,
    target: TargetOption = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the FMUs; made if needed.", metavar="DIR", parser=path)
    ] = Path(),
) -> None:
    """Build the platform as FMU: self-contained, compiled, Co-Simulation and Model Exchange.

    Writes **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**. The compiler is a Python package,
    which `pip install 'gough-stewart[fmu]'` brings; it makes binaries for every target on every machine. A first
    build takes ten seconds a target (Windows: two minutes), the next ones two.

    The platform chosen gives the start values; another one can be set through the parameters, without a build.

    Examples
    --------
    - `gough-stewart build`

    - `gough-stewart build --fmi 3.0 --target all --preset motion_base --out fmus`
    """
    with clear_errors() as written:
        with preparing():
            from gough_stewart.fmu_build.build import build
            from gough_stewart.fmu_build.builder import VERSIONS, number_of_steps

        chosen = chosen_platform(preset, platform)
        versions = [v.value for v in fmi] if fmi else VERSIONS
        targets = target or ["native"]
        with progress_bar() as progress:
            task = progress.add_task("building", total=number_of_steps(versions, targets))

            def told(what: str) -> None:
                progress.update(task, advance=1, description=what)

            files = build(out, fmi=versions, targets=targets, platform=chosen, progress=told)
        written.append(out)
        for file in files:
            Terminal().say(f"{file}  {file.stat().st_size / 1024:.0f} KiB")

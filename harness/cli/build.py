"""The command `build`: compiles the platform as an FMU."""

from pathlib import Path

from gough_stewart.harness.cli.command import clear_errors
from gough_stewart.harness.cli.options import (
    FmiOption,
    FolderOption,
    PlatformOption,
    PresetOption,
    TargetOption,
    chosen_platform,
    chosen_targets,
)
from gough_stewart.harness.cli.terminal import preparing, progress_bar


def build_command(
    fmi: FmiOption = None,
    target: TargetOption = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    out: FolderOption = Path(),
) -> None:
    """Build the platform as an FMU: self-contained, compiled, Co-Simulation and Model Exchange.

    Writes **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**. `pip install 'gough-stewart[fmu]'`
    installs the compiler, which builds for all targets on any machine. The first build takes ten seconds per target
    (Windows: two minutes), later ones two.

    The chosen platform sets the start values; parameters can change them to another platform without a new build.

    Examples
    --------
    - `gough-stewart build`

    - `gough-stewart build --fmi 3.0 --target all --preset motion_base --out fmus`
    """
    with clear_errors() as command:
        with preparing():
            from gough_stewart.fmu_build.build import build
            from gough_stewart.fmu_build.builder import VERSIONS, number_of_steps

        chosen = chosen_platform(preset, platform)
        versions = [v.value for v in fmi] if fmi else VERSIONS
        targets = chosen_targets(target)
        with progress_bar() as progress:
            task = progress.add_task("building", total=number_of_steps(versions, targets))

            files = build(
                out,
                fmi=versions,
                targets=targets,
                platform=chosen,
                progress=lambda what: progress.update(task, advance=1, description=what),
            )
        command.written.append(out)
        command.close([file.relative_to(out) for file in files], out)

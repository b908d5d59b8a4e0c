"""The command `build`: compiles the platform as an FMU."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

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
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import preparing, progress_bar

if TYPE_CHECKING:
    from gough_stewart.harness.report.document import Report


@shows
def build_command(
    fmi: FmiOption = None,
    target: TargetOption = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    out: FolderOption = Path(),
    *,
    showing: Showing,
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
        names = [str(file.relative_to(out)) for file in files]
        showing.present(command, _report(chosen.name, versions, targets, names), out, names, keeps_data=False)


def _report(platform: str, versions: Sequence[str], targets: Sequence[str], files: Sequence[str]) -> "Report":
    """What was built: of which platform, for what, and that it has not been run."""
    from gough_stewart.harness.report.document import Number, Report, Verdict
    from gough_stewart.harness.report.words import listed, sentence

    systems = "this machine" if list(targets) == ["native"] else listed([*targets])
    fmi = f"FMI {listed([*versions])} of the platform {platform}, compiled for {systems}"
    signals = "six actuator forces in, pose and leg lengths out"
    text = sentence([fmi, signals, "not yet run: `gough-stewart reproduce` runs and compares them"])
    number = Number("files", "files written", float(len(files)))
    return Report(f"FMU of {platform}", Verdict(text, "good"), study="build", numbers=(number,))

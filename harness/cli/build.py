"""The command `build`: compiles the platform as an FMU."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors, wrong_use_if
from gough_stewart.harness.cli.exit_codes import ExitCode
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
    from gough_stewart.harness.plants.unit_check import UnitCheck
    from gough_stewart.harness.report.document import Report


@shows
def build_command(
    fmi: FmiOption = None,
    target: TargetOption = None,
    preset: PresetOption = None,
    platform: PlatformOption = None,
    out: FolderOption = Path(),
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Also check the units here: FMPy's validation, and their reference results in Co-Simulation and Model "
            "Exchange.",
        ),
    ] = False,
    *,
    showing: Showing,
) -> None:
    """Build the platform as an FMU: self-contained, compiled, Co-Simulation and Model Exchange.

    Writes **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**. The package carries the compiled code for all
    targets. That of platforms whose legs stick or give, and all code of a checkout of the sources, is compiled at the
    first build (Windows: two minutes) and kept.

    The chosen platform sets the start values; parameters can change them to another platform without a new build.

    With `--check` exit code 3 if a check fails.

    Examples
    --------
    - `gough-stewart build`

    - `gough-stewart build --check`

    - `gough-stewart build --fmi 3.0 --target all --preset motion_base --out fmus`
    """
    with clear_errors() as command:
        with preparing():
            from gough_stewart.fmu_build.build import VERSIONS, build, number_of_steps
            from gough_stewart.fmu_build.cache import BuildError
            from gough_stewart.fmu_build.toolchain import chosen_targets as targets_by_name
            from gough_stewart.fmu_build.toolchain import native

        chosen = chosen_platform(preset, platform)
        versions = [version.value for version in fmi] if fmi else VERSIONS
        targets = chosen_targets(target)
        if check:
            with wrong_use_if(BuildError):
                here = native()
                if here not in targets_by_name(targets):
                    raise BuildError(
                        f"--check runs the units on this machine, {here.name}, and the targets are "
                        f"{', '.join(targets)}; add `--target native`"
                    )
        checks: list[UnitCheck] | None = None
        with progress_bar() as progress:
            task = progress.add_task("building", total=number_of_steps(versions, targets))
            files = build(
                out,
                fmi=versions,
                targets=targets,
                platform=chosen,
                progress=lambda step: progress.update(task, advance=1, description=step),
            )
            if check:
                from gough_stewart.harness.plants.unit_check import check_units

                progress.add_task("checking", total=None)
                checks = list(check_units(files))
        command.written.append(out)
        names = [str(file.relative_to(out)) for file in files]
        report = _report(chosen.name, versions, targets, names, checks)
        report = showing.present(command, report, out, names, keeps_data=showing.page or out != Path(), exits=False)
        if not all(outcome.passed for outcome in checks or ()):
            raise typer.Exit(ExitCode.MISSED)
        showing.exit(report)


def _report(
    platform: str,
    versions: Sequence[str],
    targets: Sequence[str],
    files: Sequence[str],
    checks: "Sequence[UnitCheck] | None",
) -> "Report":
    """What was built: of which platform, for what, and how it passed its checks, or that it has not been run."""
    from gough_stewart.harness.report.document import Number, Report, Section, Verdict
    from gough_stewart.harness.report.quantities import COUNT, NUMBER
    from gough_stewart.harness.report.table import Column, Table
    from gough_stewart.harness.report.words import listed, sentence

    systems = "this machine" if list(targets) == ["native"] else listed([*targets])
    built = [
        f"FMI {listed([*versions])} of the platform {platform}, compiled for {systems}",
        "six actuator forces in, pose and leg lengths out",
    ]
    title, written = f"FMU of {platform}", Number("files", "files written", float(len(files)), COUNT)
    if checks is None:
        verdict = Verdict(sentence([*built, "not yet run: `--check` runs and compares them"]), "good")
        return Report(title, verdict, study="build", numbers=(written,))
    from gough_stewart.harness.plants.unit_check import EXPLANATION

    failed = [check for check in checks if not check.passed]
    outcome = f"all {len(checks)} checks passed"
    if failed:
        names = listed([f"{check.name} of {check.file}" for check in failed])
        outcome = f"{len(failed)} of {len(checks)} checks failed: {names}"
    worst = max((check.deviation for check in checks if check.deviation is not None), default=None)
    numbers = (
        Number("checks.failed", "failed checks", float(len(failed)), COUNT),
        Number("checks.deviation", "largest deviation from reference results", worst, NUMBER),
    )
    table = Table(
        "",
        (Column("unit"), Column("check"), Column("outcome"), Column("deviation or problem")),
        tuple((check.file, check.name, "passed" if check.passed else "FAILED", check.result) for check in checks),
        note=EXPLANATION,
    )
    verdict = Verdict(sentence([*built, outcome]), "bad" if failed else "good", numbers)
    return Report(title, verdict, (Section("Checks", (table,)),), study="build", numbers=(written, *numbers))

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

        chosen = chosen_platform(preset, platform)
        versions = [v.value for v in fmi] if fmi else VERSIONS
        targets = chosen_targets(target)
        checks: list[UnitCheck] | None = None
        if check:
            with wrong_use_if(BuildError):
                _check_runs_here(targets)
        with progress_bar() as progress:
            task = progress.add_task("building", total=number_of_steps(versions, targets))

            files = build(
                out,
                fmi=versions,
                targets=targets,
                platform=chosen,
                progress=lambda what: progress.update(task, advance=1, description=what),
            )
            if check:
                from gough_stewart.harness.plants.unit_check import check_units

                progress.add_task("checking", total=None)
                checks = list(check_units(files))
        command.written.append(out)
        names = [str(file.relative_to(out)) for file in files]
        report = _report(chosen.name, versions, targets, names, checks)
        report = showing.present(command, report, out, names, keeps_data=showing.page or out != Path(), exits=False)
        if not all(each.passed for each in checks or ()):
            raise typer.Exit(ExitCode.MISSED)
        showing.exit(report)


def _check_runs_here(targets: Sequence[str]) -> None:
    """Refuse to check units without a library for this machine."""
    from gough_stewart.fmu_build import toolchain as known
    from gough_stewart.fmu_build.cache import BuildError

    here = known.native()
    if here not in known.chosen_targets(targets):
        raise BuildError(
            f"--check runs the units on this machine, {here.name}, and the targets are {', '.join(targets)}; add "
            "`--target native`"
        )


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
    fmi = f"FMI {listed([*versions])} of the platform {platform}, compiled for {systems}"
    signals = "six actuator forces in, pose and leg lengths out"
    numbers = [Number("files", "files written", float(len(files)), COUNT)]
    if checks is None:
        text = sentence([fmi, signals, "not yet run: `--check` runs and compares them"])
        return Report(f"FMU of {platform}", Verdict(text, "good"), study="build", numbers=tuple(numbers))
    from gough_stewart.harness.plants.unit_check import EXPLANATION

    failed = [each for each in checks if not each.passed]
    outcome = (
        f"{len(failed)} of {len(checks)} checks failed: " + listed([f"{each.name} of {each.file}" for each in failed])
        if failed
        else f"all {len(checks)} checks passed"
    )
    rows = tuple((each.file, each.name, "passed" if each.passed else "FAILED", each.result) for each in checks)
    table = Table(
        "",
        (Column("unit"), Column("check"), Column("outcome"), Column("deviation or problem")),
        rows,
        note=EXPLANATION,
    )
    numbers.append(Number("checks.failed", "failed checks", float(len(failed)), COUNT))
    known = [each.deviation for each in checks if each.deviation is not None]
    worst = max(known, default=None)
    numbers.append(Number("checks.deviation", "largest deviation from reference results", worst, NUMBER))
    verdict = Verdict(sentence([fmi, signals, outcome]), "bad" if failed else "good", tuple(numbers[1:]))
    return Report(f"FMU of {platform}", verdict, (Section("Checks", (table,)),), study="build", numbers=tuple(numbers))

"""The commands `build` and `export`: the platform and the controller for other tools."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from gough_stewart.harness.cli import ExitCode
from gough_stewart.harness.cli import options as opt
from gough_stewart.harness.cli.command import wrong_use_if
from gough_stewart.harness.cli.options import choice, flag, option
from gough_stewart.harness.cli.study import Running, study
from gough_stewart.harness.errors import ExportError

if TYPE_CHECKING:
    from gough_stewart.harness.export.stability import LoopStability
    from gough_stewart.harness.plants.unit_check import UnitCheck


@study(numbers=("files", "checks"))
def build_command(
    running: Running,
    fmi: opt.FmiOption = None,
    target: opt.TargetOption = None,
    preset: opt.PresetOption = None,
    platform: opt.PlatformOption = None,
    out: opt.FolderOption = Path(),
    forms: str = option(
        "What to write: fmu, mjcf (a model for MuJoCo), or both with a comma.", "FORMS", "--as", default="fmu"
    ),
    check: bool = flag(
        "Also check the units here: FMPy's validation, and their reference results in Co-Simulation and Model"
        " Exchange.",
        "--check",
    ),
) -> None:
    """Build the platform as an FMU: self-contained, compiled, Co-Simulation and Model Exchange.

    Writes **gough_stewart_fmi2.fmu** and **gough_stewart_fmi3.fmu**; `--as mjcf` writes **NAME.xml** for MuJoCo. The
    package carries the compiled code for all targets. That of platforms with stiction or elastic legs, and all code of
    a checkout of the sources, is compiled at the first build (Windows: two minutes) and kept.

    The chosen platform sets the start values; parameters can change them to another platform without a new build.

    With `--check` exit code 3 if a check fails.

    Examples
    --------
    - `gough-stewart build`

    - `gough-stewart build --check`

    - `gough-stewart build --fmi 3.0 --target all --preset motion_base --out fmus`

    - `gough-stewart build --as mjcf --preset motion_base`
    """
    from gough_stewart.fmu_build.build import FORMS, VERSIONS, build, number_of_steps
    from gough_stewart.fmu_build.cache import BuildError
    from gough_stewart.fmu_build.toolchain import chosen_names, native
    from gough_stewart.fmu_build.toolchain import chosen_targets as targets_by_name
    from gough_stewart.harness.plants.unit_report import unit_report

    loaded = opt.chosen_platform(preset, platform)
    versions, targets = [version.value for version in fmi] if fmi else VERSIONS, opt.chosen_targets(target)
    with wrong_use_if(BuildError):
        chosen_as = chosen_names("form", [form.strip() for form in forms.split(",")], FORMS)
        if check and "fmu" not in chosen_as:
            raise BuildError(f"--check runs units, and --as is {forms}; expected fmu among the forms")
        if check and native() not in targets_by_name(targets):
            raise BuildError(
                f"--check runs the units on this machine, {native().name}, and the targets are "
                f"{', '.join(targets)}; add `--target native`"
            )
    running.hold(out, keeps_data=running.page or out != Path())
    running.step("building", total=number_of_steps(versions, targets))
    files = build(
        out,
        forms=chosen_as,
        fmi=versions,
        targets=targets,
        platform=loaded,
        progress=lambda stage: running.step(stage, advance=1),
    )
    checks: list[UnitCheck] | None = None
    if check:
        from gough_stewart.harness.plants.unit_check import check_units

        running.step("checking", total=None)
        checks = list(check_units([file for file in files if file.suffix == ".fmu"]))
    running.command.written.append(out)
    names = [str(file.relative_to(out)) for file in files]
    running.present(unit_report(loaded, versions if "fmu" in chosen_as else (), targets, names, checks), names)
    if not all(outcome.passed for outcome in checks or ()):
        raise typer.Exit(ExitCode.MISSED)


SafeForce = Literal["feedforward", "zero"]
SspVersion = Literal["1.0", "2.0"]
ReferenceFrom = Literal["inside", "inputs"]


@study(numbers=("files", "stability", "margins"))
def export_command(
    running: Running,
    experiment: opt.ExperimentArgument,
    forms: str = option(
        "What to write: fmu, c, ssp, page, or several with commas between them.", "FORMS", "--as", default="fmu"
    ),
    fmi: opt.FmiOption = None,
    ssp_fmi: opt.FmiVersion = choice(
        "FMI version of the FMUs in an SSP: 2.0, which all importers of SSP 1.0 support, or 3.0.",
        opt.FmiVersion,
        default=opt.FmiVersion.fmi2,
    ),
    ssp: SspVersion = choice("Version of SSP.", SspVersion, default="1.0"),
    target: opt.TargetOption = None,
    reference: ReferenceFrom = choice(
        "Put the experiment's reference inside the controller, or make references its inputs.",
        ReferenceFrom,
        default="inside",
    ),
    safe_force: SafeForce = choice(
        "Forces while a measurement is NaN or out of its range: the feedforward, or zero.",
        SafeForce,
        default="feedforward",
    ),
    frozen: str | None = option(
        "Take a measurement for frozen that is the same for N samples while its reference moves by more than "
        "a length, such as `50,1 mm`.",
        "N,LENGTH",
    ),
    allow_unstable: bool = flag("Export a loop that is unstable in one of the forms; they say so.", "--allow-unstable"),
    anyway: opt.FormerNameOption = False,
    parts: str | None = option(
        "What the controller includes: drives, sensors, manual, or several with commas between them.", "PARTS", "--with"
    ),
    settings: opt.SetOption = None,
    out: opt.FolderOption = Path(),
    no_python: opt.NoPythonOption = False,
) -> None:
    """Export the controller of an experiment, to run without Python.

    `--as fmu` writes **NAME_controller_fmi2.fmu** and **NAME_controller_fmi3.fmu**, Co-Simulation; `--as c`
    **NAME_controller.c**, **NAME_controller.h** and **example_main.c**, C99 for any processor; `--as ssp` **NAME.ssp**,
    plant and controller connected, for co-simulation tools; `--as page` **NAME_live.html**, the loop live in a browser.

    Each form's loop is judged with the delay that it has there, for the experiment's machine and all members of its
    [ensemble]; an unstable one is refused. The files say what was judged and what they leave out.

    Examples
    --------
    - `gough-stewart export heave_step --out exported`

    - `gough-stewart export heave_step --as c,fmu,ssp --target all --out exported`

    - `gough-stewart export mine.toml --as fmu --fmi 2.0 --reference inputs`

    - `gough-stewart export mine.toml --as ssp --with drives,sensors`
    """
    from gough_stewart.fmu_build.build import number_of_steps
    from gough_stewart.harness.export.choices import requested
    from gough_stewart.harness.export.export import export
    from gough_stewart.harness.export.notes import export_report
    from gough_stewart.harness.report.document import settings_of
    from gough_stewart.model.units import number

    loaded = opt.chosen_experiment(experiment, settings, no_python)
    with wrong_use_if(ExportError):
        chosen_as = requested("form", [form.strip() for form in forms.split(",")])
        inside = requested("part", [part.strip() for part in (parts or "").split(",") if part.strip()])
    versions, targets = [version.value for version in fmi] if fmi else ["2.0", "3.0"], opt.chosen_targets(target)
    held: tuple[int, float] | None = None
    if frozen is not None:
        samples, _, movement = frozen.partition(",")
        try:
            held = int(samples), number(movement.strip(), "m")
        except ValueError:
            raise ExportError(
                f"--frozen is '{frozen}'; expected a number of samples and a length with a comma between them, such as "
                "'50,1 mm'"
            ) from None
    running.hold(out, keeps_data=running.page or out != Path())
    steps_of_one = number_of_steps(["2.0"], targets)
    steps = {"c": 1, "fmu": number_of_steps(versions, targets), "ssp": 1 + 2 * steps_of_one, "page": 1}
    running.step("exporting", total=sum(steps[form] for form in chosen_as))
    judging = running.progress.add_task("judging the members", total=None, visible=False)
    warnings: list[str] = []
    verdicts: list[str] = []
    loops: list[LoopStability] = []
    files = export(
        loaded,
        forms=chosen_as,
        out=out,
        fmi=versions,
        ssp_fmi=ssp_fmi.value,
        targets=targets,
        reference=reference,
        safe_force=safe_force,
        ssp=ssp,
        parts=inside,
        frozen=held,
        allow_unstable=allow_unstable or anyway,
        progress=lambda stage: running.step(stage, advance=1),
        judging=lambda k, of: running.progress.update(judging, completed=k, total=of, visible=k < of),
        warn=warnings.append,
        verdict=verdicts.append,
        stability=loops.extend,
    )
    running.command.written.append(out)
    names = [str(file.relative_to(out)) for file in files]
    report = export_report(loaded.title, chosen_as, verdicts, warnings, names, loops)
    report = replace(report, settings=settings_of(loaded.changed))
    running.require(loaded.requirements, report.numbers)
    running.present(report, names)

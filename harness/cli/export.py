"""The command `export`: writes a designed controller as C, FMU and SSP."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gough_stewart.harness.cli.command import clear_errors, wrong_use_if
from gough_stewart.harness.cli.options import (
    ExperimentArgument,
    FmiOption,
    FmiVersion,
    FolderOption,
    NoPythonOption,
    SetOption,
    TargetOption,
    choices,
    chosen_experiment,
    chosen_targets,
)
from gough_stewart.harness.cli.showing import Showing, shows
from gough_stewart.harness.cli.terminal import preparing, progress_bar
from gough_stewart.harness.errors import ExportError

if TYPE_CHECKING:
    from gough_stewart.harness.export.stability import LoopStability


class SafeForceChoice(StrEnum):
    """The forces while inputs are bad."""

    feedforward = "feedforward"
    zero = "zero"


class SspVersion(StrEnum):
    """Versions of SSP."""

    ssp1 = "1.0"
    ssp2 = "2.0"


class ReferenceSource(StrEnum):
    """Where the reference comes from."""

    inside = "inside"
    inputs = "inputs"


@shows
def export_command(
    experiment: ExperimentArgument,
    forms: Annotated[
        str,
        typer.Option(
            "--as",
            help="What to write: fmu, c, ssp, page, or several with commas between them.",
            metavar="FORMS",
        ),
    ] = "fmu",
    fmi: FmiOption = None,
    ssp_fmi: Annotated[
        FmiVersion,
        typer.Option(
            "--ssp-fmi",
            help="FMI version of the FMUs in an SSP: 2.0, which all importers of SSP 1.0 support, or 3.0.",
            metavar=choices(FmiVersion),
        ),
    ] = FmiVersion.fmi2,
    ssp: Annotated[SspVersion, typer.Option(help="Version of SSP.", metavar=choices(SspVersion))] = SspVersion.ssp1,
    target: TargetOption = None,
    reference: Annotated[
        ReferenceSource,
        typer.Option(
            help="Put the experiment's reference inside the controller, or make references its inputs.",
            metavar=choices(ReferenceSource),
        ),
    ] = ReferenceSource.inside,
    safe_force: Annotated[
        SafeForceChoice,
        typer.Option(
            help="Forces while a measurement is NaN or out of its range: the feedforward, or zero.",
            metavar=choices(SafeForceChoice),
        ),
    ] = SafeForceChoice.feedforward,
    frozen: Annotated[
        str | None,
        typer.Option(
            help="Take a measurement for frozen that is the same for N samples while its reference moves by more than "
            "a length, such as `50,1 mm`.",
            metavar="N,LENGTH",
        ),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Export a loop that is unstable in one of the forms; they say so.")
    ] = False,
    parts: Annotated[
        str | None,
        typer.Option(
            "--with",
            help="What the controller includes: drives, sensors, manual, or several with commas between them.",
            metavar="PARTS",
        ),
    ] = None,
    settings: SetOption = None,
    out: FolderOption = Path(),
    no_python: NoPythonOption = False,
    *,
    showing: Showing,
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
    with clear_errors() as command:
        with preparing():
            from gough_stewart.fmu_build.build import number_of_steps
            from gough_stewart.harness.export.choices import chosen_forms, chosen_parts
            from gough_stewart.harness.export.export import export
            from gough_stewart.harness.export.notes import export_report
            from gough_stewart.harness.report.document import settings_of

        chosen = chosen_experiment(experiment, settings, no_python)
        with wrong_use_if(ExportError):
            chosen_as = chosen_forms(form.strip() for form in forms.split(","))
            inside = chosen_parts(part.strip() for part in (parts or "").split(",") if part.strip())
        versions = [v.value for v in fmi] if fmi else ("2.0", "3.0")
        targets = chosen_targets(target)
        one = number_of_steps(["2.0"], targets)
        steps = {"c": 1, "fmu": number_of_steps(versions, targets), "ssp": 1 + 2 * one, "page": 1}
        with progress_bar() as progress:
            task = progress.add_task("exporting", total=sum(steps[form] for form in chosen_as))
            judging = progress.add_task("judging the members", total=None, visible=False)
            said: list[str] = []
            verdicts: list[str] = []
            loops: list[LoopStability] = []
            files = export(
                chosen,
                forms=chosen_as,
                out=out,
                fmi=versions,
                ssp_fmi=ssp_fmi.value,
                ssp=ssp.value,
                targets=targets,
                reference=reference.value,
                safe_force=safe_force.value,
                parts=inside,
                frozen=None if frozen is None else _frozen(frozen),
                anyway=anyway,
                progress=lambda what: progress.update(task, advance=1, description=what),
                judging=lambda k, of: progress.update(judging, completed=k, total=of, visible=k < of),
                warn=said.append,
                verdict=verdicts.append,
                stability=loops.extend,
            )
        command.written.append(out)
        names = [str(file.relative_to(out)) for file in files]
        report = replace(
            export_report(chosen.title, chosen_as, verdicts, said, names, loops), settings=settings_of(chosen.changed)
        )
        requirements = showing.requirements(chosen.requirements, report.numbers)
        showing.present(
            command, report, out, names, requirements=requirements, keeps_data=showing.page or out != Path()
        )


def _frozen(text: str) -> tuple[int, float]:
    """Samples and movement [m] from the text of the option."""
    from gough_stewart.harness.errors import ExportError
    from gough_stewart.harness.quantities import number

    samples, _, movement = text.partition(",")
    try:
        return int(samples), number(movement.strip(), "m")
    except ValueError:
        raise ExportError(
            f"--frozen is '{text}'; expected a number of samples and a length with a comma between them, such as "
            "'50,1 mm'"
        ) from None

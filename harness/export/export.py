"""Export a designed controller as C, as FMU, or with the plant as SSP; all files are written, or none."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from gough_stewart.fmu_build.build import VERSIONS, unit_archives
from gough_stewart.fmu_build.cache import check_installed
from gough_stewart.fmu_build.component import UnitComponent
from gough_stewart.fmu_build.plant.plant_component import plant_component
from gough_stewart.fmu_build.toolchain import chosen_names, chosen_targets
from gough_stewart.harness.control.traced_law import is_casadi_function
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.overrides import Settings
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.choices import (
    Form,
    Part,
    ReferenceFrom,
    SafeForce,
    faults_of,
    name_of,
    requested,
)
from gough_stewart.harness.export.live.page import live_page
from gough_stewart.harness.export.notes import in_short, notes_of, refusal, robustness_of
from gough_stewart.harness.export.stability import Host, LoopStability, MemberProgress, output_delay_of, stability_of
from gough_stewart.model.process.files import check_output_folder, write_files
from gough_stewart.model.process.installed import TRACER
from gough_stewart.model.process.progress import StepProgress

if TYPE_CHECKING:
    import casadi


def export(  # noqa: PLR0912, PLR0915 - one road, in sections
    experiment: "Experiment | Path | str | casadi.Function",
    settings: Settings = (),
    *,
    forms: Iterable[Form] | Form = ("fmu",),
    out: Path | str = ".",
    fmi: Iterable[str] = ("2.0", "3.0"),
    ssp_fmi: str = "2.0",
    ssp: str = "1.0",
    targets: Iterable[str] = ("native",),
    reference: ReferenceFrom = "inside",
    controller: Any = None,
    safe_force: SafeForce = "feedforward",
    frozen: tuple[int, float] | None = None,
    parts: Iterable[Part] | Part = (),
    allow_unstable: bool = False,
    progress: StepProgress | None = None,
    judging: MemberProgress | None = None,
    warn: Callable[[str], None] | None = None,
    verdict: Callable[[str], None] | None = None,
    stability: Callable[[Sequence[LoopStability]], None] | None = None,
    anyway: bool = False,  # the former name of `allow_unstable`
) -> list[Path]:
    """Write the controller of an experiment as C, as FMU, or with its plant as SSP; after an error, no file is written.

    Parameters
    ----------
    experiment, settings
        As for `run`; or a `casadi.Function` from named signals to `actuator_force`, by default for the paper's platform
        at home with a sample time of 1 ms.
    forms
        "fmu": `NAME_controller_fmi2.fmu` and `NAME_controller_fmi3.fmu`. "c": `NAME_controller.c`, `.h` and
        `example_main.c`, C99 without dependencies. "ssp": `NAME.ssp`, plant and controller as FMUs, connected.
        "page": `NAME_live.html`, in which the loop runs in a browser, as `gough-stewart live`; it is not judged.
    out
        Folder, created if needed.
    fmi
        Versions of the form "fmu": "2.0", "3.0".
    ssp_fmi
        Version of the FMUs in an SSP: "2.0", which all its importers support, or "3.0".
    ssp
        Version of SSP: "1.0", or "2.0", whose documents differ in that number only.
    targets
        Target systems of the FMUs, as for `build`.
    reference
        "inside": the experiment's motion is part of the controller. "inputs": the reference is an input at each sample.
    controller
        Replaces the experiment's: a discrete python-control system, a `LinearController`, a class or function whose
        call is arithmetic, or a `casadi.Function` from named signals to `actuator_force`. The feedforward is unchanged.
    safe_force
        All six forces while an input is NaN or out of its range, which is the stroke with a margin: "feedforward", or
        the start forces if there is none; or "zero".
    frozen
        (n, q): a measured length or position that is the same for n samples while its reference moves by more than q
        [m] counts as frozen, with the safe force until it changes. By default no input does.
    parts
        Parts of the machine to include in the controller: "drives", so that its forces are those that act, behind rate
        limit and lag; "sensors", with their quantisation and sample time, so that it takes true signals. Their settings
        become parameters. The step function, and the unit, then run at the `plant_step` where drives or readings do.
        "manual": it can be switched off and on without a bump, by `enabled`; while it is off, its force follows
        `manual_force`, which is the force that acts.
    allow_unstable
        Export a loop that is unstable in one of the forms; its documentation says so.
    progress
        Called with the present action.
    judging
        Called with the number of members of the `[ensemble]` whose loops have been judged, and the total.
    warn
        Called with warnings: what a form leaves out of the experiment, a delay that it adds, a loop whose stability
        cannot be judged, an unstable loop that is exported on request. The forms' documentation says the same.
    verdict
        Called with the largest |z| and the margins of each form's loop, the least robust first.
    stability
        Called once with the stability results of all these loops, in the same order.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    UnstableLoopError
        The closed loop is unstable in one of the forms, with the delay that it has there, for the experiment's machine
        or a member of its `[ensemble]`.
    ControllerError
        A controller that cannot be exported, is itself unstable, or has the wrong size.
    ExportError
        An unknown form, part, safe force or version of SSP, no signal to watch for freezing, or an SSP with
        external reference.
    ExperimentError, ReachError, BuildError, OutputError
        As `run` and `build`.

    See Also
    --------
    build, margins, run

    Examples
    --------
    >>> gs.export("heave_step", {"controller.bandwidth": 3}, forms=["c"], out="exported")
    """
    if is_casadi_function(experiment):
        minimal = {"controller": {"type": "open_loop"}, "reference": {"type": "hold"}, "loop": {"duration": 1.0}}
        made = Experiment.built().model_validate({"title": experiment.name(), **minimal})
        controller, experiment = experiment, made
    chosen = load_experiment(cast("Experiment | Path | str", experiment), settings)
    wanted, name, inside = requested("form", forms), name_of(chosen), requested("part", parts)
    if "ssp" in wanted and reference == "inputs":
        raise ExportError(
            "reference = 'inputs' leaves an SSP without a reference; expected 'inside', or the forms fmu and c"
        )
    if ssp not in ("1.0", "2.0"):
        raise ExportError(f"ssp is {ssp!r}; expected '1.0' or '2.0'")
    versions, (in_ssp,) = (chosen_names("FMI version", names, VERSIONS) for names in (fmi, [ssp_fmi]))
    systems = chosen_targets(targets)
    folder, files, report = Path(out), dict[str, bytes](), progress or (lambda _text: None)
    check_output_folder(folder, names_of_files(name, wanted, versions))
    if "page" in wanted:
        if controller is not None:
            raise ExportError("a page has the controllers of experiments; expected no controller, or the other forms")
        report("page")
        files[f"{name}_live.html"] = live_page(chosen)
    hosts: tuple[Host, ...] = tuple(form for form in wanted if form != "page")
    if not hosts:
        write_files(folder, files)
        return [folder / file for file in files]

    # the controller, and how its loops are judged; what traces is imported for controllers only, since a page's code is
    # carried
    check_installed(TRACER)
    from gough_stewart.harness.export.controller_units import component_of, loop_archive
    from gough_stewart.harness.export.design import designed
    from gough_stewart.harness.export.trace import traced
    from gough_stewart.harness.export.write import c_files, controller_sources

    prepared = prepare(chosen, controller)
    law = designed(chosen, controller, reference, faults_of(safe_force, frozen), prepared, inside)
    judged = stability_of(chosen, prepared, hosts, parts=inside, progress=judging)
    refused = refusal(chosen, judged.items())
    if refused is not None and not (allow_unstable or anyway):
        raise refused
    notes = {host: notes_of(chosen, host, judged[host], law.carried) for host in hosts}
    duration, late, functions = chosen.loop.duration, output_delay_of(chosen), traced(law)

    def unit_of(host: Host) -> UnitComponent:
        """Its forces act at least one sample late.

        All of the delay is the unit's only in an SSP, or with drives, behind which nothing else could have the rest.
        """
        delay = late if host == "ssp" or "drives" in law.carried.parts else 1
        of_host = replace(law, delay=late, notes=notes[host].inside)
        return component_of(of_host, functions, f"{name}_controller", duration, output_delay=delay)

    if "c" in hosts:
        report("C")
        sources = controller_sources(replace(law, notes=notes["c"].inside), functions, f"{name}_controller")
        files |= c_files(chosen, law, sources, prepared, controller)
    if "fmu" in hosts:
        files |= unit_archives(unit_of("fmu"), versions, systems, report)
    if "ssp" in hosts:
        plant = plant_component(
            prepared.machine,
            start=prepared.start,
            actuator_force=prepared.loop.start_force,
            tolerance=chosen.plant.tolerance,
            fixed_step_size=chosen.plant.fixed_step_size,
            file_stem=f"{name}_plant",
            is_in_a_system=True,
        )
        report("SSP")
        files[f"{name}.ssp"] = loop_archive(
            *(name, plant, unit_of("ssp"), duration, law.step, systems, notes["ssp"].inside),
            fmi_version=in_ssp,
            ssp_version=ssp,
            side=prepared.loop.sensors.side,
            progress=report,
        )
    write_files(folder, files)
    loops = sorted((loop for report in judged.values() for loop in report.loops), key=robustness_of)
    if stability is not None:
        stability(loops)
    for listener, texts in (
        (warn, [text for of_form in notes.values() for text in of_form.warnings]),
        (verdict, list(map(in_short, loops))),
    ):
        for text in texts if listener is not None else ():
            listener(text)  # type: ignore[misc]
    return [folder / file for file in files]


def names_of_files(name: str, forms: Iterable[Form], versions: Iterable[str]) -> list[str]:
    """The names of the files that `export` writes."""
    files: dict[Form, list[str]] = {
        "c": [f"{name}_controller.c", f"{name}_controller.h", "example_main.c"],
        "fmu": [f"{name}_controller_fmi{version[0]}.fmu" for version in versions],
        "ssp": [f"{name}.ssp"],
        "page": [f"{name}_live.html"],
    }
    return [file for form in forms for file in files[form]]

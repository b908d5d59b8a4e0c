"""The files of an experiment's controller in its forms: C, FMUs, an SSP with the plant."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from gough_stewart.fmu_build.build import unit_archives
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.harness.export.choices import Part
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.write import deviation_of
from gough_stewart.harness.export.choices import Faults
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.export.choices import EXAMPLE, Real, ReferenceFrom
from gough_stewart.harness.export.loop_archive import loop_archive
from gough_stewart.harness.export.notes import notes_of, refusal
from gough_stewart.harness.export.stability import Host, MemberProgress, StabilityReport, output_delay_of, stability_of
from gough_stewart.model.process.progress import StepProgress


class ControllerFiles(NamedTuple):
    """What is written, and what is said of it."""

    files: dict[str, bytes]
    loops: Mapping[Host, StabilityReport]
    warnings: Sequence[str]


def controller_files(
    experiment: Experiment,
    controller: Any,
    name: str,
    forms: Sequence[Host],
    *,
    versions: Sequence[str],
    ssp_version: str,
    systems: Sequence[Target],
    reference: ReferenceFrom,
    faults: Faults,
    real: Real,
    parts: tuple[Part, ...],
    anyway: bool,
    progress: StepProgress,
    judging: MemberProgress | None,
) -> ControllerFiles:
    """The files by name; the arguments are those of `export`, checked.

    Raises
    ------
    UnstableLoopError, ControllerError, ExportError, BuildError
        As `export`.
    """
    prepared = prepare(experiment, controller)
    law = designed(experiment, controller, reference, faults, prepared, parts)
    found = stability_of(experiment, prepared, forms, parts=parts, progress=judging)
    refused = refusal(experiment, found.items())
    if refused is not None and not anyway:
        raise refused
    notes = {host: notes_of(experiment, host, each, law.carried) for host, each in found.items()}
    files = dict[str, bytes]()
    if "c" in forms:
        progress("C")
        in_c = replace(law, notes=notes["c"].inside)
        deviation = "" if real == "double" else str(deviation_of(experiment, in_c, controller))
        files |= c_files(in_c, f"{name}_controller", real, deviation)
    # the forces of a unit act at least one sample late; all of the delay is the unit's only in an SSP, or with drives
    late, duration = replace(law, delay=output_delay_of(experiment)), experiment.loop.duration
    if "fmu" in forms:
        unit = component_of(
            replace(late, notes=notes["fmu"].inside),
            f"{name}_controller",
            duration,
            # behind the drives there is nothing else that could have the rest of the delay
            output_delay=output_delay_of(experiment) if law.carried.drives else 1,
        )
        files |= unit_archives(unit, versions, systems, progress)
    if "ssp" in forms:
        said_inside = notes["ssp"].inside
        unit = component_of(
            replace(late, notes=said_inside), f"{name}_controller", duration, output_delay=output_delay_of(experiment)
        )
        plant = plant_component(
            prepared.machine,
            start=prepared.start,
            actuator_force=prepared.loop.start_force,
            tolerance=experiment.plant.tolerance,
            fixed_step_size=experiment.plant.fixed_step_size,
            file_stem=f"{name}_plant",
            is_in_a_system=True,
        )
        progress("SSP")
        files[f"{name}.ssp"] = loop_archive(
            name,
            plant,
            unit,
            duration,
            law.step,
            systems,
            said_inside,
            fmi_version=ssp_version,
            side=prepared.loop.sensors.side,
            progress=progress,
        )
    warnings = [text for each in notes.values() for text in each.warnings]
    return ControllerFiles(files, found, warnings)


def c_files(law: Designed, prefix: str, real: Real = "double", deviation: str = "") -> dict[str, bytes]:
    """The C source of the controller and an example program, by file name."""
    sources = controller_sources(law, prefix, real, deviation)
    texts = {**sources.units, **sources.headers, EXAMPLE: sources.example}
    return {name: text.encode() for name, text in texts.items()}

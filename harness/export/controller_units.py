"""A designed controller as an FMU: alone, for a run with it, or with its plant as SSP.

An SSP is one archive of connected FMUs, with SystemStructure.ssd and a parameter set. It is limited to what the tested
importers read: one flat system without its own connectors, scalars with `ssc:Real` in every connector, connected
connectors only, the standard's prefixes, SI units, and components of which no name begins with another's, since FMPy
finds parameters by the beginning of their names.
"""

import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from gough_stewart.fmu_build.build import build_units, to_zip, unit_archives
from gough_stewart.fmu_build.component import Role, Sources, UnitComponent
from gough_stewart.fmu_build.controller import ControllerParameter, SampledController, controller_component
from gough_stewart.fmu_build.documents import BY_NAME, installed_package, rendered
from gough_stewart.fmu_build.plant.drawing import icon_of
from gough_stewart.fmu_build.toolchain import Target
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.notes import notes_of, refusal
from gough_stewart.harness.export.stability import stability_of
from gough_stewart.harness.export.trace import Traced, traced
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.harness.plants.signals import AT_MOTORS, Side
from gough_stewart.model.process.progress import StepProgress

PLANT, CONTROLLER = "plant", "controller"


def component_of(
    designed: Designed, functions: Traced, name: str = "controller", stop_time: float = 1.0, *, output_delay: int = 1
) -> UnitComponent:
    """The controller as input of the FMU builder; `output_delay` [samples] is that of the unit."""
    # the notes are in the unit's page: they do not change the meaning of its saved states
    plain = controller_sources(replace(designed, notes=()), functions)
    # what is expected, in the user's terms: `anti_windup_time[1] >= sample_time`
    parameters = []
    for setting in designed.settings:
        texts = []
        for condition in setting.conditions:
            text = re.sub(r"\[(\d+)\]", lambda index: f"[{int(index[1]) + 1}]", condition.replace("parameters->", ""))
            if "DEFAULT_SAMPLE_TIME" in text:
                text = f"{designed.sample_time!r} s, since the controller was designed for it"
            texts.append(re.sub(r"!\((.*) > 0\)", r"\1 = 0", text))
        expected = setting.expected or " and ".join(texts) or "another value"
        parameters.append(ControllerParameter(setting.variable, setting.value, setting.may_be_infinite, expected))
    controller = SampledController(
        title=designed.title or name,
        sample_time=designed.sample_time,
        stop_time=stop_time,
        measured=designed.measured,
        reference=designed.reference_variables,
        parameters=tuple(parameters),
        code=Sources(plain.units, plain.headers),
        icon=icon_of(designed.platform),
        output_delay=output_delay,
        notes=designed.notes,
        steps_a_sample=designed.carried.steps_a_sample,
        has_rate_limit="drives" in designed.carried.parts,
        has_switch="manual" in designed.carried.parts,
    )
    return controller_component(controller, name)


@contextmanager
def exported_controller(
    experiment: Experiment,
    fmi_version: str,
    progress: StepProgress | None = None,
    *,
    allow_unstable: bool = False,
    warn: Callable[[str], None] | None = None,
) -> Iterator[UnitController]:
    """The exported controller of an experiment as an FMU of FMI "2.0" or "3.0", while the context is open."""
    if not experiment.loop.delay:
        raise ControllerError(
            f"{experiment.where}: controller: a unit outputs the forces of a sample after a step over it; expected a "
            "loop.delay of at least 1, for instance by --set loop.delay=1"
        )
    prepared = prepare(experiment)
    law = designed(experiment, prepared=prepared)
    # a run with a unit has the experiment's own machine, and no member of its ensemble
    alone = experiment.model_copy(update={"ensemble": None})
    stability = stability_of(alone, prepared, ("run",), margins=False)
    refused = refusal(experiment, stability.items())
    if refused is not None and not allow_unstable:
        raise refused
    if warn is not None:
        for text in notes_of(experiment, "run", stability["run"]).warnings:
            warn(text)
    with tempfile.TemporaryDirectory(prefix="gough-stewart-", ignore_cleanup_errors=True) as folder:
        unit = component_of(law, traced(law), "controller", experiment.loop.duration)
        (path,) = build_units(unit, folder, fmi=[fmi_version], progress=progress)
        yield UnitController(path, is_foreign=False)


# ---- with its plant ----


def loop_archive(
    name: str,
    plant: UnitComponent,
    controller: UnitComponent,
    duration: float,  # of the experiment [s]
    step: float,  # of the master, the controller's clock [s]
    targets: Iterable[Target],
    notes: Iterable[str] = (),  # paragraphs about the loop, for the page and the description of the system
    *,
    # of both units; with "3.0" they describe scalars, too, since connectors of SSP 1.0 have no dimensions
    fmi_version: str = "2.0",
    ssp_version: str = "1.0",
    side: Side = "leg",  # of elastic legs, where encoders read
    progress: StepProgress | None = None,
) -> bytes:
    """The archive: SystemStructure.ssd, both FMUs, their parameters again as an SSV file, and a page.

    Each output is connected to the input of the same name; encoders at the motors' side of elastic legs read that. The
    parameters of the SSV file are named `component.parameter`, as importers expect.
    """
    targets, notes = tuple(targets), tuple(notes)
    components = {PLANT: replace(plant, has_scalars_only=True), CONTROLLER: replace(controller, has_scalars_only=True)}
    files = {
        f"resources/{key}.fmu": next(iter(unit_archives(unit, (fmi_version,), targets, progress).values()))
        for key, unit in components.items()
    }
    at_motors = side == "motor" and AT_MOTORS["leg_length"] in components[PLANT].layout.by_name
    connections, connectors = list[dict[str, str]](), dict[str, list[tuple[str, str, str]]]()
    for source, sink in ((PLANT, CONTROLLER), (CONTROLLER, PLANT)):
        rows, outputs = components[source].layout, {row.variable.name for row in components[source].layout.outputs()}
        for row in components[sink].layout.of_role(Role.INPUT):
            variable = row.variable
            if variable.name not in outputs:
                continue
            read = AT_MOTORS.get(variable.name, variable.name) if at_motors else variable.name
            for out, into in zip(rows.by_name[read].variable.scalar_names, variable.scalar_names, strict=True):
                connectors.setdefault(source, []).append(("output", out, variable.unit))
                connectors.setdefault(sink, []).append(("input", into, variable.unit))
                connections.append(
                    {"startElement": source, "startConnector": out, "endElement": sink, "endConnector": into}
                )
    structure = rendered(
        "systemStructure.xml",
        version=ssp_version,
        name=name,
        tool=f"gough-stewart {installed_package()[0]['Version']}",
        description=" ".join(notes) or None,
        components=[
            {
                "name": key,
                "connectors": sorted(connectors.get(key, ()), key=lambda connector: connector[0]),
                "set": _parameters({"": unit}),
            }
            for key, unit in components.items()
        ],
        connections=connections,
        all_units=_units(unit for rows in connectors.values() for *_, unit in rows),
        step=repr(step),
        duration=repr(duration),
    )
    named = _parameters({f"{key}.": unit for key, unit in components.items()})
    return to_zip(
        {
            "SystemStructure.ssd": structure,
            "documentation/index.html": rendered("loop.html", title=f"{name}: plant and controller", notes=notes),
            f"resources/{name}.ssv": rendered("parameterSet.xml", version=ssp_version, name=name, set=named),
            **files,
        }
    )


def _parameters(components: Mapping[str, UnitComponent]) -> dict[str, Any]:
    """Of components by the beginning of their names: name, value and unit of each parameter, and all units."""
    rows = [
        (f"{prefix}{scalar}", repr(float(value)), row.variable.unit)
        for prefix, unit in components.items()
        for row in unit.layout.of_role(Role.FIXED_PARAMETER, Role.TUNABLE_PARAMETER)
        for scalar, value in zip(row.variable.scalar_names, unit.starts[row.variable.name].flat, strict=True)
    ]
    return {"rows": rows, "units": _units(unit for *_, unit in rows)}


def _units(names: Iterable[str]) -> list[Any]:
    return [BY_NAME[name] for name in sorted({*names} - {""})]

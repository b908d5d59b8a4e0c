"""A designed controller as an FMU; and that of an experiment for a run with it."""

import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.component import Sources, UnitComponent
from gough_stewart.fmu_build.controller import ControllerParameter, SampledController, controller_component
from gough_stewart.fmu_build.plant.drawing import icon_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.notes import notes_of, refusal
from gough_stewart.harness.export.stability import stability_of
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.model.process.progress import StepProgress


def component_of(
    designed: Designed, name: str = "controller", stop_time: float = 1.0, *, output_delay: int = 1
) -> UnitComponent:
    """The controller as input of the FMU builder; `output_delay` [samples] is that of the unit."""
    # the notes are in the unit's page: they do not change the meaning of its saved states
    plain = controller_sources(replace(designed, notes=()))
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
        has_rate_limit=designed.carried.drives,
        has_switch=designed.carried.manual,
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
        unit = component_of(law, "controller", experiment.loop.duration)
        (path,) = build_units(unit, folder, fmi=[fmi_version], progress=progress)
        yield UnitController(path, is_foreign=False)

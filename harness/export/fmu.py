"""A designed controller as an FMU."""

import re
from dataclasses import replace

from gough_stewart.fmu_build.component import Sources, UnitComponent
from gough_stewart.fmu_build.controller import ControllerParameter, SampledController, controller_component
from gough_stewart.fmu_build.plant.drawing import icon_of
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.harness.export.design import Designed
from gough_stewart.harness.export.settings import Setting


def component_of(
    designed: Designed,
    name: str = "controller",
    stop_time: float = 1.0,
    *,
    output_delay: int = 1,
) -> UnitComponent:
    """The controller as input of the FMU builder; `output_delay` [samples] is that of the unit."""
    # the notes are in the unit's page: they do not change the meaning of its saved states
    plain = controller_sources(replace(designed, notes=()))
    controller = SampledController(
        title=designed.title or name,
        sample_time=designed.sample_time,
        stop_time=stop_time,
        measured=designed.measured,
        reference=designed.reference_variables,
        parameters=tuple(_parameter(setting, designed) for setting in designed.settings),
        code=Sources(plain.units, plain.headers),
        icon=icon_of(designed.platform),
        output_delay=output_delay,
        notes=designed.notes,
        steps_a_sample=designed.carried.steps_a_sample,
        has_rate_limit=designed.carried.drives,
    )
    return controller_component(controller, name)


def _parameter(setting: Setting, designed: Designed) -> ControllerParameter:
    expected = setting.expected or " and ".join(_in_words(each, designed) for each in setting.conditions)
    return ControllerParameter(setting.variable, setting.value, setting.may_be_infinite, expected or "another value")


def _in_words(condition: str, designed: Designed) -> str:
    """A C condition in the user's terms: `anti_windup_time[1] >= sample_time`."""
    if "DEFAULT_SAMPLE_TIME" in condition:
        return f"{designed.sample_time!r} s, since the controller was designed for it"
    plain = condition.replace("parameters->", "")
    plain = re.sub(r"\[(\d+)\]", lambda match: f"[{int(match[1]) + 1}]", plain)
    return re.sub(r"!\((.*) > 0\)", r"\1 = 0", plain)

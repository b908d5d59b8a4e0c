"""A designed controller as FMU."""

import re
from collections.abc import Iterable
from pathlib import Path

from gough_stewart.fmu_build.builder import VERSIONS, build_units
from gough_stewart.fmu_build.component import Code, Component, Icon
from gough_stewart.fmu_build.controller.component import controller_component
from gough_stewart.fmu_build.controller.controller import Controller, Parameter
from gough_stewart.fmu_build.plant.drawing import icon_png, icon_svg
from gough_stewart.harness.export.c_source import controller_sources
from gough_stewart.harness.export.designed import Designed
from gough_stewart.harness.export.settings import Setting
from gough_stewart.model.progress import StepProgress


def controller_fmu(
    designed: Designed,
    out: Path | str,
    fmi: Iterable[str] = VERSIONS,
    targets: Iterable[str] = ("native",),
    progress: StepProgress | None = None,
    *,
    name: str = "controller",
    stop_time: float = 1.0,
) -> list[Path]:
    """Write `NAME_fmi2.fmu` and `NAME_fmi3.fmu`; all that are asked for, or none on an error.

    Parameters
    ----------
    designed
        The controller.
    out
        Folder, made if needed.
    fmi
        "2.0", "3.0".
    targets
        Systems that the units shall run on, as for the plant's.
    progress
        Called with what is being done.
    name
        How the names of the files begin.
    stop_time
        Of an experiment that asks for nothing [s].

    Raises
    ------
    BuildError
        An unknown version or target, or the compiler's complaint.
    OutputError
        The files cannot be written there.
    """
    return build_units(component_of(designed, name, stop_time), out, fmi=fmi, targets=targets, progress=progress)


def component_of(designed: Designed, name: str = "controller", stop_time: float = 1.0) -> Component:
    """The controller as the builder of units knows it."""
    plain = controller_sources(designed)
    controller = Controller(
        title=designed.title or name,
        sample_time=designed.sample_time,
        stop_time=stop_time,
        measured=designed.measured,
        reference=designed.reference_variables,
        parameters=tuple(_parameter(setting, designed) for setting in designed.settings),
        code=Code(plain.units, plain.headers),
        icon=Icon(icon_png(designed.platform), icon_svg(designed.platform)),
    )
    return controller_component(controller, name)


def _parameter(setting: Setting, designed: Designed) -> Parameter:
    expected = " and ".join(_in_words(condition, designed) for condition in setting.conditions)
    return Parameter(setting.variable, setting.value, setting.may_be_infinite, expected or "another value")


def _in_words(condition: str, designed: Designed) -> str:
    """A condition of the C as users read it: `anti_windup_time[1] >= sample_time`."""
    if "DEFAULT_SAMPLE_TIME" in condition:
        return f"{designed.sample_time!r} s, since the controller was designed for it"
    plain = condition.replace("parameters->", "")
    plain = re.sub(r"\[(\d+)\]", lambda match: f"[{int(match[1]) + 1}]", plain)
    return re.sub(r"!\((.*) > 0\)", r"\1 = 0", plain)

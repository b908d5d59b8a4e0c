"""The plant as a component, with start values, pictures and documents of a platform."""

from functools import cache

import numpy as np

from gough_stewart.fmu_build.archive import PLANT_STEM
from gough_stewart.fmu_build.codegen import kernel_source
from gough_stewart.fmu_build.component import Code, Component, Icon, Terminal, terminals_of
from gough_stewart.fmu_build.package import package_metadata
from gough_stewart.fmu_build.plant.dependencies import slot_dependencies
from gough_stewart.fmu_build.plant.documentation import documentation_page
from gough_stewart.fmu_build.plant.drawing import icon_png, icon_svg
from gough_stewart.fmu_build.plant.layout import NOMINAL, PLANT
from gough_stewart.fmu_build.plant.reference_results import reference_files, reference_runs
from gough_stewart.fmu_build.plant.tables import plant_header
from gough_stewart.fmu_build.sources import c_folder
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.tolerance import DEFAULT_TOLERANCE
from gough_stewart.model.vectors import Array

IDENTIFIER = "gough_stewart"
_Group = tuple[str, ...]
_ACTUATOR: _Group = ("actuator_force", "leg_length", "leg_velocity")
_POSE: _Group = ("position", "orientation", "velocity", "angular_velocity")
_WRENCH: _Group = ("external_force", "external_torque")


def plant_component(
    platform: Platform,
    *,
    start: State | None = None,
    actuator_force: Array | None = None,
    tolerance: float = DEFAULT_TOLERANCE,
    fixed_step_size: float = 0.0,
    file_stem: str = PLANT_STEM,
    is_in_a_system: bool = False,
) -> Component:
    """The plant with the start values of a platform.

    Parameters
    ----------
    platform
        The platform with the parameters and the default start pose, home.
    start
        Start state, if not home.
    actuator_force
        Start values of the forces (6,) [N], if not those that hold the home pose; positive extends the leg.
    tolerance, fixed_step_size
        Default values of the unit.
    file_stem
        Beginning of the archives' names.
    is_in_a_system
        Whether the unit is for a system with its controller: without reference results, and in the first step,
        actuator forces that are all 0 are replaced by their start values, which some masters do not propagate.
    """
    starts = interface.start_values(interface.VARIABLES, platform)
    own: dict[str, Array] = {"fixed_step_size": np.array(fixed_step_size)}
    own |= {} if start is None else start._asdict()
    if actuator_force is not None:
        own["actuator_force"] = actuator_force
    starts |= {name: interface.checked_value(interface.BY_NAME[name], value) for name, value in own.items()}
    runs = cache(lambda: reference_runs(platform))

    def documents(fmi_version: str) -> dict[str, bytes]:
        page = {"documentation/index.html": documentation_page(platform, fmi_version, starts)}
        return page | (reference_files(runs(), IDENTIFIER, fmi_version) if not is_in_a_system else {})

    return Component(
        identifier=IDENTIFIER,
        name="GoughStewart",
        description=package_metadata()["Summary"],
        file_stem=file_stem,
        layout=PLANT,
        starts=starts,
        dependencies=slot_dependencies(),
        experiment={"startTime": "0", "stopTime": "1", "tolerance": repr(tolerance), "stepSize": "0.001"},
        code=_code(fixed_step_size, is_in_a_system),
        icon=Icon(icon_png(platform), icon_svg(platform)),
        terminals=_terminals,
        documents=documents,
        nominal=NOMINAL,
        settings=frozenset({"fixed_step_size"}),
    )


@cache
def _code(fixed_step_size: float, is_in_a_system: bool) -> Code:
    own = c_folder("plant")
    header = plant_header(fixed_step_size, is_in_a_system=is_in_a_system)
    return Code({**own.units, "kernel.c": kernel_source()}, {**own.headers, "plant_table.h": header})


def _terminals(fmi_version: str) -> tuple[Terminal, ...]:
    """Six actuators, the pose, the external wrench."""
    groups = (("pose", "pose and its rates", _POSE), ("external_wrench", "load at Op", _WRENCH))
    return terminals_of(PLANT, fmi_version, _ACTUATOR, groups)

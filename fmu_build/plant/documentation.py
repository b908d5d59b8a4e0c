"""documentation/index.html of the plant's unit, for the platform that gives the start values."""

from collections.abc import Mapping
from importlib.resources import files
from math import log10

import numpy as np

from gough_stewart.fmu_build.documentation import page
from gough_stewart.fmu_build.formulas import STYLE, to_html
from gough_stewart.fmu_build.layout import Layout, Role
from gough_stewart.fmu_build.plant.drawing import drawing_svg
from gough_stewart.fmu_build.plant.tables import MOST_FIXED_STEPS
from gough_stewart.model import interface
from gough_stewart.model.platform import Platform
from gough_stewart.model.step_times import DEFAULT_TOLERANCE, MOST_INTERNAL_STEPS, TOLERANCES
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import Array


def plant_page(platform: Platform, layout: Layout, starts: Mapping[str, Array], fmi_version: str) -> bytes:
    """The page as well-formed, self-contained HTML.

    Parameters
    ----------
    platform
        The platform of the drawing.
    layout, starts
        The unit's variables, and their start values by name.
    fmi_version
        "2.0" or "3.0"; determines names, example and the description of the interface.
    """
    home = interface.start_values((row.variable for row in layout.rows), platform)
    equations = files("gough_stewart.model").joinpath("task_space.md").read_text(encoding="utf-8")
    return page(
        "plant.html",
        title=f"Gough–Stewart platform, FMI {fmi_version}",
        fmi_version=fmi_version,
        platform=platform,
        variant=Variant.of(platform),
        drawing=drawing_svg(platform),
        notes=(),
        rows=layout.described(fmi_version),
        starts=starts,
        stands_still=all(np.array_equal(starts[name], value) for name, value in home.items()),
        equations=to_html(equations),
        formula_style=STYLE,
        tolerances=[f"1e{round(log10(tolerance))}" for tolerance in TOLERANCES],
        default_tolerance=f"1e{round(log10(DEFAULT_TOLERANCE))}",
        tunable=[row.variable.name for row in layout.of_role(Role.TUNABLE_PARAMETER)],
        most_steps=MOST_INTERNAL_STEPS,
        most_fixed_steps=MOST_FIXED_STEPS,
        force=[f"{force:.6g}" for force in 1.05 * platform.home_actuator_force],
    )

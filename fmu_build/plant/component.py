"""The plant as a component, with start values, pictures and documents of a platform."""

import json
from collections.abc import Iterable
from functools import cache, partial

import numpy as np

from gough_stewart.fmu_build.archive import PLANT_STEM
from gough_stewart.fmu_build.component import Code, Component, Icon, Kind, SlotDependencies, Terminal, terminals_of
from gough_stewart.fmu_build.errors import check_installed
from gough_stewart.fmu_build.layout import Layout, Role, Row
from gough_stewart.fmu_build.package import package_metadata
from gough_stewart.fmu_build.plant.documentation import plant_page
from gough_stewart.fmu_build.plant.drawing import icon_png, icon_svg
from gough_stewart.fmu_build.plant.layout import plant_layout, unit_order
from gough_stewart.fmu_build.plant.reference_results import reference_cases, reference_files, reference_results
from gough_stewart.fmu_build.plant.related_files import related_files
from gough_stewart.fmu_build.plant.tables import plant_header
from gough_stewart.fmu_build.source_state import state_of_texts
from gough_stewart.fmu_build.sources import c_folder
from gough_stewart.model import interface
from gough_stewart.model.machine_dynamics import states_at
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.installed import TRACER
from gough_stewart.model.process.prebuilt import prebuilt_content
from gough_stewart.model.state import State
from gough_stewart.model.step_times import DEFAULT_TOLERANCE
from gough_stewart.model.variant import IDEAL, Variant
from gough_stewart.model.vectors import Array

IDENTIFIER = "gough_stewart"
# Names of what is traced, in the manifest of prebuilt files.
KERNEL_SOURCE, DEPENDENCIES = "kernel.c", "dependencies.json"
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
    variant = Variant.of(platform)
    layout = plant_layout(variant)
    starts = interface.start_values((row.variable for row in layout.rows), platform)
    own: dict[str, Array] = {"fixed_step_size": np.array(fixed_step_size)}
    if start is not None:
        own |= states_at(platform, start)
    if actuator_force is not None:
        own["actuator_force"] = actuator_force
    starts |= {name: interface.checked_value(interface.BY_NAME[name], value) for name, value in own.items()}
    runs = cache(lambda: tuple((case, reference_results(case)) for case in reference_cases(platform)))

    def documents(fmi_version: str) -> dict[str, bytes]:
        page = {"documentation/index.html": plant_page(platform, layout, starts, fmi_version)}
        if is_in_a_system:
            return page
        related = related_files((case.name for case, _ in runs()), IDENTIFIER)
        return page | reference_files(runs(), IDENTIFIER, fmi_version) | related

    return Component(
        identifier=IDENTIFIER,
        name="GoughStewart",
        description=package_metadata()["Summary"],
        file_stem=file_stem,
        layout=layout,
        starts=starts,
        dependencies=slot_dependencies(variant),
        experiment={"startTime": "0", "stopTime": "1", "tolerance": repr(tolerance), "stepSize": "0.001"},
        code=_code(variant),
        icon=Icon(icon_png(platform), icon_svg(platform)),
        terminals=partial(_terminals, layout),
        documents=documents,
        settings=frozenset({"fixed_step_size"}),
        options={"ZEROS_ARE_UNSET_AT_START": is_in_a_system},
    )


@cache
def _code(variant: Variant) -> Code:
    own = c_folder("plant")
    units = {**own.units, KERNEL_SOURCE: _kernel_source(variant)}
    headers = {**own.headers, "plant_table.h": plant_header(variant)}
    if variant.bristles:
        headers |= {name: c_folder("lanes").headers[name] for name in ("exponential_step.h", "vectors.h")}
    return Code(units, headers)


def _kernel_source(variant: Variant) -> str:
    """The C of the equations: what came with the package, else traced."""
    content = prebuilt_content(KERNEL_SOURCE, state_of_texts()) if variant == IDEAL else None
    if content is not None:
        return content.decode()
    check_installed(TRACER)
    from gough_stewart.fmu_build.codegen import kernel_source

    return kernel_source(variant, () if variant == IDEAL else unit_order(variant))


def _terminals(layout: Layout, fmi_version: str) -> tuple[Terminal, ...]:
    """Six actuators, the pose, the external wrench."""
    groups = (("pose", "pose and its rates", _POSE), ("external_wrench", "load at Op", _WRENCH))
    return terminals_of(layout, fmi_version, _ACTUATOR, groups)


@cache
def slot_dependencies(variant: Variant = IDEAL) -> SlotDependencies:
    """Dependencies of derivatives, outputs and locals on inputs, states and parameters.

    A dependency is `constant` if its entry of the Jacobian is a plain number. The table came with the package, else the
    equations are traced.
    """
    content = prebuilt_content(DEPENDENCIES, state_of_texts()) if variant == IDEAL else None
    if content is not None:
        read = json.loads(content)
        return {int(slot): {int(known): kind for known, kind in kinds.items()} for slot, kinds in read.items()}
    check_installed(TRACER)
    return traced_dependencies(variant)


def traced_dependencies(variant: Variant = IDEAL) -> SlotDependencies:
    """The same, traced."""
    import casadi

    from gough_stewart.model import traced

    layout = plant_layout(variant)
    x, u, p = traced.derivatives_function(variant).sx_in()
    y = traced.outputs_function(variant)(x, u, p)
    f = casadi.vertcat(traced.derivatives_function(variant)(x, u, p), y)
    jacobian = casadi.jacobian(f, casadi.vertcat(x, u, p))
    rows, columns = jacobian.sparsity().get_triplet()
    unknowns = [
        *_slots_of(layout.of_role(Role.DERIVATIVE)),
        *_slots_of(layout.by_name[v.name] for v in variant.results),
    ]
    parameters = (layout.by_name[v.name] for v in variant.parameters)
    knowns = [*_slots_of(layout.of_role(Role.STATE)), *_slots_of(layout.of_role(Role.INPUT)), *_slots_of(parameters)]
    found: dict[int, dict[int, Kind]] = {slot: {} for slot in unknowns}
    for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
        kind: Kind = "constant" if jacobian.nz[k].is_constant() else "dependent"
        found[unknowns[row]][knowns[column]] = kind
    return {slot: dict(sorted(kinds.items())) for slot, kinds in found.items()}


def _slots_of(rows: Iterable[Row]) -> list[int]:
    return [slot for row in rows for slot in row.slots]

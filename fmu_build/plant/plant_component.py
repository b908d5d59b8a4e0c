"""The plant as a component, with start values, pictures and documents of a platform."""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from importlib.resources import files
from math import log10

import numpy as np

from gough_stewart.fmu_build.cache import cache_folder, check_installed, kept, state_of_sources
from gough_stewart.fmu_build.component import (
    Kind,
    LayoutRow,
    Role,
    SlotDependencies,
    Sources,
    UnitComponent,
)
from gough_stewart.fmu_build.documents import installed_package, rendered, to_html
from gough_stewart.fmu_build.plant.drawing import drawing_svg, icon_of
from gough_stewart.fmu_build.plant.layout import MOST_FIXED_STEPS, plant_header, plant_layout
from gough_stewart.fmu_build.plant.reference_results import (
    FOLDER,
    reference_files,
    reference_runs,
)
from gough_stewart.fmu_build.sources import c_folder
from gough_stewart.model import interface
from gough_stewart.model.dynamics import states_at
from gough_stewart.model.interface import (
    DEFAULT_TOLERANCE,
    ELASTO_PLASTIC,
    IDEAL,
    MOST_INTERNAL_STEPS,
    TOLERANCES,
    State,
    Variant,
)
from gough_stewart.model.platform import Platform, load_preset
from gough_stewart.model.process.installed import TRACER, prebuilt, state_of_texts
from gough_stewart.model.vectors import Array

IDENTIFIER = PLANT_STEM = "gough_stewart"
# Names of what is traced, in the cache and in the manifest of prebuilt files.
KERNEL_SOURCE, DEPENDENCIES = "kernel.c", "dependencies.json"
_ACTUATOR = ("actuator_force", "leg_length", "leg_velocity")
_TERMINALS = (
    ("pose", "pose and its rates", ("position", "orientation", "velocity", "angular_velocity")),
    ("external_wrench", "load at Op", ("external_force", "external_torque")),
)
# FMI-LS-REF, whose manifest tells the roles of related files.
_LAYERED_STANDARD = "org.fmi-standard.fmi-ls-ref"


def plant_component(
    platform: Platform,
    *,
    start: State | None = None,  # if not home
    actuator_force: Array | None = None,  # (6,) [N], if not those that hold the home pose
    tolerance: float = DEFAULT_TOLERANCE,
    fixed_step_size: float = 0.0,
    file_stem: str = PLANT_STEM,
    # with its controller: without reference results; forces that are all 0 in the first step stand for their start
    # values, which some masters do not propagate
    is_in_a_system: bool = False,
) -> UnitComponent:
    """The plant with the start values of a platform."""
    variant = Variant.of(platform)
    layout = plant_layout(variant)
    home = interface.start_values((row.variable for row in layout.rows), platform)
    changes: dict[str, Array] = {"fixed_step_size": np.array(fixed_step_size)}
    if start is not None:
        changes |= states_at(platform, start)
    if actuator_force is not None:
        changes["actuator_force"] = actuator_force
    checked = {name: interface.checked_value(interface.BY_NAME[name], value) for name, value in changes.items()}
    starts = home | checked

    def documents(fmi_version: str) -> dict[str, bytes]:
        page = rendered(
            "plant.html",
            title=f"Gough–Stewart platform, FMI {fmi_version}",
            fmi_version=fmi_version,
            platform=platform,
            variant=variant,
            drawing=drawing_svg(platform),
            notes=(),
            rows=layout.described(fmi_version),
            starts=starts,
            stands_still=all(np.array_equal(starts[name], value) for name, value in home.items()),
            equations=to_html(files("gough_stewart.model").joinpath("task_space.md").read_text(encoding="utf-8")),
            tolerances=[f"1e{round(log10(tolerance))}" for tolerance in TOLERANCES],
            default_tolerance=f"1e{round(log10(DEFAULT_TOLERANCE))}",
            tunable=[row.variable.name for row in layout.of_role(Role.TUNABLE_PARAMETER)],
            most_steps=MOST_INTERNAL_STEPS,
            most_fixed_steps=MOST_FIXED_STEPS,
            force=[f"{force:.6g}" for force in 1.05 * platform.home_actuator_force],
        )
        if is_in_a_system:
            return {"documentation/index.html": page}
        runs = reference_runs(platform)
        manifest = rendered(
            "fmi-ls-manifest.xml",
            name=_LAYERED_STANDARD,
            folder=FOLDER,
            identifier=IDENTIFIER,
            cases=[run.name for run in runs],
        )
        return {
            "documentation/index.html": page,
            **reference_files(runs, IDENTIFIER, fmi_version),
            f"extra/{_LAYERED_STANDARD}/fmi-ls-manifest.xml": manifest,
        }

    return UnitComponent(
        identifier=IDENTIFIER,
        name="GoughStewart",
        description=installed_package()[0]["Summary"],
        file_stem=file_stem,
        layout=layout,
        starts=starts,
        dependencies=slot_dependencies(variant),
        experiment={"startTime": "0", "stopTime": "1", "tolerance": repr(tolerance), "stepSize": "0.001"},
        code=_code(variant),
        icon=icon_of(platform),
        actuator=_ACTUATOR,
        groups=_TERMINALS,
        documents=documents,
        settings=frozenset({"fixed_step_size"}),
        options={"ZEROS_ARE_UNSET_AT_START": is_in_a_system},
    )


def platform_of(variant: Variant) -> Platform:
    """Any platform of a variant, the paper's if it is ideal: all its parameters are set when it runs."""
    platform = load_preset("liu2000")
    if variant.bristles:
        platform = replace(platform, leg_friction_model=ELASTO_PLASTIC, leg_coulomb_friction=1.0)
    if variant.springs:
        platform = replace(platform, leg_stiffness=1e6, leg_armature=1.0)
    return platform


@cache
def _code(variant: Variant) -> Sources:
    """The C of the plant with its equations."""

    def traced() -> bytes:
        check_installed(TRACER)
        from gough_stewart.fmu_build.codegen import kernel_source

        places = interface.places(variant.results)
        order = [int(k) for v in variant.unit_results for k in places[v.name].flat]
        return kernel_source(variant, () if variant == IDEAL else order).encode()

    kernel = _traced_once(KERNEL_SOURCE, variant, traced).decode()
    plant = c_folder("plant")
    headers = {**plant.headers, "plant_table.h": plant_header(variant)}
    headers |= {name: c_folder("lanes").headers[name] for name in ("steps.h", "vectors.h")}
    return Sources({**plant.units, KERNEL_SOURCE: kernel}, headers)


def _traced_once(name: str, variant: Variant, trace: Callable[[], bytes]) -> bytes:
    """What is traced from the equations: that of ideal plants may have come with the package, else from the cache."""
    carried = prebuilt(name, state_of_texts()) if variant == IDEAL else None
    if carried is not None:
        return carried.content
    folder = "-".join([state_of_sources(), *variant.parts])
    return kept(cache_folder() / "traced" / folder / name, trace).read_bytes()


@cache
def slot_dependencies(variant: Variant = IDEAL) -> SlotDependencies:
    """What derivatives, outputs and locals depend on; `constant` if an entry of the Jacobian is a plain number."""
    content = _traced_once(DEPENDENCIES, variant, lambda: json.dumps(traced_dependencies(variant)).encode())
    return {
        int(unknown): {int(slot): kind for slot, kind in kinds.items()}
        for unknown, kinds in json.loads(content).items()
    }


def traced_dependencies(variant: Variant = IDEAL) -> SlotDependencies:
    """`slot_dependencies` from the sparsity of the traced Jacobian."""
    check_installed(TRACER)
    import casadi

    from gough_stewart.model.traced import traced_function

    def slots_of(rows: Iterable[LayoutRow]) -> list[int]:
        return [slot for row in rows for slot in row.slots]

    layout = plant_layout(variant)
    derivatives, outputs = (traced_function(name, variant) for name in ("derivatives", "outputs"))
    x, u, p = derivatives.sx_in()
    f = casadi.vertcat(derivatives(x, u, p), outputs(x, u, p))
    jacobian = casadi.jacobian(f, casadi.vertcat(x, u, p))
    unknowns = slots_of(layout.of_role(Role.DERIVATIVE)) + slots_of(layout.by_name[v.name] for v in variant.results)
    knowns = slots_of(layout.of_role(Role.STATE)) + slots_of(layout.of_role(Role.INPUT))
    knowns += slots_of(layout.by_name[v.name] for v in variant.parameters)
    dependencies: dict[int, dict[int, Kind]] = {slot: {} for slot in unknowns}
    for k, (row, column) in enumerate(zip(*jacobian.sparsity().get_triplet(), strict=True)):
        kind: Kind = "constant" if jacobian.nz[k].is_constant() else "dependent"
        dependencies[unknowns[row]][knowns[column]] = kind
    return {slot: dict(sorted(kinds.items())) for slot, kinds in dependencies.items()}

"""A sampled controller as a component, from its signals, parameters and plain C."""

import hashlib
import json

import numpy as np

from gough_stewart.fmu_build.component import Code, Component, Kind, Terminal, terminals_of
from gough_stewart.fmu_build.controller.controller import OUTPUT_DELAY, Controller, Parameter
from gough_stewart.fmu_build.documentation import page
from gough_stewart.fmu_build.layout import Layout
from gough_stewart.fmu_build.sources import c_folder
from gough_stewart.fmu_build.tables import GENERATED, defines
from gough_stewart.model.vectors import Array

IDENTIFIER = "gough_stewart_controller"
_ACTUATOR = "actuator_force leg_length leg_velocity"
_POSE = "position orientation velocity angular_velocity"
# In one communication step; takes about 1 s.
MOST_SAMPLES = 1_000_000


def controller_component(controller: Controller, file_stem: str = "controller") -> Component:
    """The controller as a sampled component: no continuous states; Co-Simulation only.

    Parameters
    ----------
    controller
        Its signals, parameters and plain C.
    file_stem
        Beginning of the archives' names.
    """
    layout = controller.layout
    variables = [row.variable for row in layout.rows]
    starts = {each.name: np.zeros(each.shape) for each in variables if each.causality == "input"}
    starts |= {p.variable.name: _start(p) for p in controller.parameters}
    starts[OUTPUT_DELAY] = np.array(float(controller.output_delay))
    own = c_folder("controller")

    def documents(fmi_version: str) -> dict[str, bytes]:
        title = f"Controller of a Gough–Stewart platform, FMI {fmi_version}"
        values = {"title": title, "fmi_version": fmi_version, "controller": controller, "notes": controller.notes}
        rows = layout.described(fmi_version)
        return {"documentation/index.html": page("controller.html", rows=rows, starts=starts, **values)}

    texts = "".join((*controller.code.units.values(), *controller.code.headers.values()))
    return Component(
        identifier=IDENTIFIER,
        name="GoughStewartController",
        description=f"Controller of a Gough–Stewart platform: {controller.title}",
        file_stem=file_stem,
        layout=layout,
        starts=starts,
        dependencies=_dependencies(layout),
        experiment={
            "startTime": "0",
            "stopTime": repr(float(controller.stop_time)),
            "stepSize": repr(controller.step_time),
        },
        code=Code(
            {**own.units, **controller.code.units},
            {**own.headers, **controller.code.headers, "controller_table.h": controller_header(controller)},
        ),
        icon=controller.icon,
        terminals=lambda fmi_version: _terminals(layout, fmi_version),
        documents=documents,
        settings=frozenset({OUTPUT_DELAY}),
        # the plain C defines the meaning of the memory
        saved_form=hashlib.sha256(f"{texts}{controller.most_output_delay}".encode()).hexdigest(),
    )


def _start(parameter: Parameter) -> Array:
    value = np.asarray(parameter.value, dtype=float)
    return np.where(np.isinf(value), 0.0, value) if parameter.is_none_at_zero else value


def _dependencies(layout: Layout) -> dict[int, dict[int, Kind]]:
    """Until sample 1 the forces are the start forces; later they do not depend on current inputs."""
    forces, starts = layout.by_name["actuator_force"], layout.by_name["start_force"]
    return {slot: {start: "constant"} for slot, start in zip(forces.slots, starts.slots, strict=True)}


def _terminals(layout: Layout, fmi_version: str) -> tuple[Terminal, ...]:
    """Terminals: the actuators, as in the plant; the measured pose; the reference."""
    names: list[str] = [row.variable.name for row in layout.rows if row.variable.causality in ("input", "output")]
    actuators, pose = ([name for name in group.split() if name in names] for group in (_ACTUATOR, _POSE))
    reference = [name for name in names if name.startswith("reference_")]
    groups = (("pose", "pose and its rates", pose), ("reference", "reference of the platform", reference))
    return terminals_of(layout, fmi_version, actuators, groups)


def controller_header(controller: Controller) -> str:
    """`controller_table.h`."""
    rows = controller.layout.by_name
    named = ("actuator_force", "force_limited", "rate_limited", "output_delay", "input_status", "input_bad_time")
    slots = {name.upper(): rows[name].first for name in named if name in rows}
    limits = [rows[p.variable.name].first for p in controller.parameters if p.is_none_at_zero]
    facts = {
        "HAS_REFERENCE_INPUTS": int(bool(controller.reference)),
        "HAS_RATE_LIMITED": int(controller.has_rate_limit),
        "STEPS_A_SAMPLE": controller.steps_a_sample,
        "MOST_SAMPLES": MOST_SAMPLES,
        "MOST_OUTPUT_DELAY": controller.most_output_delay,
    }
    expectations = " \\\n".join(f"        {json.dumps(p.expected)}," for p in controller.parameters)
    return f"""{GENERATED}
#ifndef CONTROLLER_TABLE_H
#define CONTROLLER_TABLE_H

/* slots of the outputs, and of the unit's own parameter */
{defines(slots)}

{defines(facts)}
#define EXPECTED_OUTPUT_DELAY "a whole number of samples from 1 to {controller.most_output_delay}"

/* limits: no limit is infinity in the controller and 0 in the unit */
#define IS_NONE_AT_ZERO(slot) ({" || ".join(f"(slot) == {slot}" for slot in limits) or "0"})

/* for each parameter, what the controller expects if it rejects the value */
#define EXPECTATIONS \\
    {{ \\
{expectations} \\
    }}

#endif
"""

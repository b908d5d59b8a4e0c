"""A sampled controller as a component: from its signals, parameters and plain C."""

import hashlib

import numpy as np

from gough_stewart.fmu_build.component import Code, Component, Kind, Terminal, terminals_of
from gough_stewart.fmu_build.controller.controller import Controller, Parameter
from gough_stewart.fmu_build.controller.documentation import documentation_page
from gough_stewart.fmu_build.controller.tables import controller_header
from gough_stewart.fmu_build.layout import Layout
from gough_stewart.fmu_build.sources import room
from gough_stewart.model.interface import Variable
from gough_stewart.model.vectors import Array

IDENTIFIER = "gough_stewart_controller"
_ACTUATOR = "actuator_force leg_length leg_velocity"
_POSE = "position orientation velocity angular_velocity"


def controller_component(controller: Controller, file_stem: str = "controller") -> Component:
    """The controller as a sampled component: no continuous states, Co-Simulation only.

    Parameters
    ----------
    controller
        Its signals, parameters and plain C.
    file_stem
        How the names of the archives begin.
    """
    layout = controller.layout
    starts = {row.variable.name: _zeros(row.variable) for row in layout.rows if row.variable.causality == "input"}
    starts |= {p.variable.name: _start(p) for p in controller.parameters}
    own = room("controller")
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
            "stepSize": repr(float(controller.sample_time)),
        },
        code=Code(
            {**own.units, **controller.code.units},
            {**own.headers, **controller.code.headers, "controller_table.h": controller_header(controller)},
        ),
        icon=controller.icon,
        terminals=lambda fmi_version: _terminals(layout, fmi_version),
        documents=lambda fmi_version: {"documentation/index.html": documentation_page(controller, starts, fmi_version)},
        # what the memory means is in the plain C
        saved_form=hashlib.sha256(texts.encode()).hexdigest(),
    )


def _zeros(variable: Variable) -> Array:
    return np.zeros(variable.shape)


def _start(parameter: Parameter) -> Array:
    value = np.asarray(parameter.value, dtype=float)
    return np.where(np.isinf(value), 0.0, value) if parameter.is_none_at_zero else value


def _dependencies(layout: Layout) -> dict[int, dict[int, Kind]]:
    """Before the first sample the forces are the start forces; later they are those of an earlier time."""
    forces, starts = layout.by_name["actuator_force"], layout.by_name["start_force"]
    return {slot: {start: "constant"} for slot, start in zip(forces.slots, starts.slots, strict=True)}


def _terminals(layout: Layout, fmi_version: str) -> tuple[Terminal, ...]:
    """The actuators, as the plant has them; what is measured of the pose; the reference."""
    names: list[str] = [row.variable.name for row in layout.rows if row.variable.causality in ("input", "output")]
    actuators, pose = ([name for name in group.split() if name in names] for group in (_ACTUATOR, _POSE))
    reference = [name for name in names if name.startswith("reference_")]
    groups = (("pose", "pose and its rates", pose), ("reference", "where the platform should be", reference))
    return terminals_of(layout, fmi_version, actuators, groups)

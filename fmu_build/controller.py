"""A sampled controller as a component of a unit, from its signals, its parameters and the plain C made for it."""

import hashlib
import json
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gough_stewart.fmu_build.component import (
    Icon,
    Layout,
    Sources,
    UnitComponent,
    laid_out,
)
from gough_stewart.fmu_build.documents import rendered
from gough_stewart.fmu_build.sources import c_folder, defines, filled
from gough_stewart.model.parameters import Variable
from gough_stewart.model.vectors import Array

IDENTIFIER = "gough_stewart_controller"
# In one communication step; takes about 1 s.
MOST_SAMPLES = 1_000_000
# [samples]; a unit has memory for it from the beginning. One that starts with a longer delay has memory for that.
MOST_OUTPUT_DELAY = 12
OUTPUT_DELAY = "output_delay"
_ACTUATOR = "actuator_force leg_length leg_velocity"
_POSE = "position orientation velocity angular_velocity"
_SLOTS_IN_C = (
    "actuator_force force_limited rate_limited start_force sample_time output_delay input_status input_bad_time "
    "enabled manual_force"
)


def _output(name: str, shape: tuple[int, ...], unit: str, description: str) -> Variable:
    return Variable(name, shape, unit, "output", "continuous", description)


OUTPUTS = (
    _output("actuator_force", (6,), "N", "force of each actuator, positive extends the leg"),
    _output("force_limited", (6,), "", "1 if the force limit is active, else 0"),
)
RATE_LIMITED = _output("rate_limited", (6,), "", "1 if the rate limit is active, else 0")
# Where the controller can be switched.
SWITCH = (
    Variable("enabled", (), "", "input", "continuous", "1: on; 0: off, its force follows manual_force"),
    Variable("manual_force", (6,), "N", "input", "continuous", "force that acts while it is off"),
)
# What the plain C says about its inputs; added later than the other outputs.
REPORTS = (
    _output(
        "input_status",
        (),
        "",
        "inputs of the last sample: 0 good, 1 out of range, 2 frozen; unless they are good, the forces are safe ones",
    ),
    _output("input_bad_time", (), "s", "for how long the inputs have not been good; 0 while they are"),
)


@dataclass(frozen=True)
class ControllerParameter:
    """A parameter of the controller, a field of its struct in the plain C."""

    variable: Variable
    value: Array  # infinite if there is no limit
    is_none_at_zero: bool = False  # a limit: no limit is infinity in C and 0 in the unit
    expected: str = "another value"  # the condition in the plain C, in addition to the variable's bound

    @property
    def described(self) -> Variable:
        """The variable in the unit."""
        if not self.is_none_at_zero:
            return self.variable
        return replace(self.variable, lower_bound=">= 0", description=f"{self.variable.description}; 0: no limit")

    @property
    def start(self) -> Array:
        """Its start value in the unit."""
        value = np.asarray(self.value, dtype=float)
        return np.where(np.isinf(value), 0.0, value) if self.is_none_at_zero else value


@dataclass(frozen=True)
class SampledController:
    """The description of a controller for its unit."""

    title: str
    sample_time: float  # [s]
    stop_time: float  # of the default experiment [s]
    measured: tuple[Variable, ...]  # in the order of the plain C
    reference: tuple[Variable, ...]  # reference inputs; empty if the reference is part of the unit
    parameters: tuple[ControllerParameter, ...]  # in the order of the struct; with sample_time and start_force
    code: Sources  # controller.c and controller.h
    icon: Icon
    output_delay: int = 1  # start value of the unit's parameter [samples]
    notes: tuple[str, ...] = ()  # paragraphs about its loop
    steps_a_sample: int = 1  # calls of the plain C in a sample
    has_rate_limit: bool = False  # whether it carries drives, with the memory `rate_limited`
    has_switch: bool = False  # whether it can be switched off and on, by the memory `enabled`

    @property
    def most_output_delay(self) -> int:
        """The largest value of `output_delay` for which the unit has memory [samples]."""
        return max(MOST_OUTPUT_DELAY, self.output_delay)

    @cached_property
    def layout(self) -> Layout:
        """Inputs, outputs, parameters, time; what was added later, so that older value references stay."""
        signals = [(v, v.name, v.description) for v in self.measured]
        signals += [(v, f"reference_{v.name}", f"reference: {v.description}") for v in self.reference]
        inputs = [Variable(name, v.shape, v.unit, "input", "continuous", text) for v, name, text in signals]
        inputs += SWITCH if self.has_switch else ()
        outputs = (*OUTPUTS, RATE_LIMITED) if self.has_rate_limit else OUTPUTS
        expected = f"a whole number from 1 to {self.most_output_delay}"
        text = f"samples from the inputs to the forces that they determine, {expected}"
        delay = Variable(OUTPUT_DELAY, (), "", "parameter", "fixed", text, lower_bound="> 0")
        return laid_out((*inputs, *outputs, *(p.described for p in self.parameters)), {}, (delay, *REPORTS))


def controller_component(controller: SampledController, file_stem: str = "controller") -> UnitComponent:
    """The controller as a sampled component: no continuous states; Co-Simulation only."""
    layout, code, c = controller.layout, controller.code, c_folder("controller")
    inputs = (row.variable for row in layout.rows if row.variable.causality == "input")
    starts: dict[str, Array] = {v.name: np.zeros(v.shape) for v in inputs}
    if controller.has_switch:
        starts["enabled"] = np.ones(())
    starts |= {p.variable.name: p.start for p in controller.parameters}
    starts[OUTPUT_DELAY] = np.array(float(controller.output_delay))
    ports = [row.variable.name for row in layout.rows if row.variable.causality in ("input", "output")]
    actuator, pose = (tuple(name for name in names.split() if name in ports) for names in (_ACTUATOR, _POSE))
    reference = tuple(name for name in ports if name.startswith("reference_"))

    def documents(fmi_version: str) -> dict[str, bytes]:
        return {
            "documentation/index.html": rendered(
                "controller.html",
                title=f"Controller of a Gough–Stewart platform, FMI {fmi_version}",
                fmi_version=fmi_version,
                controller=controller,
                notes=controller.notes,
                rows=layout.described(fmi_version),
                starts=starts,
            )
        }

    slots = layout.by_name
    limits = [slots[p.variable.name].first for p in controller.parameters if p.is_none_at_zero]
    facts = {
        "HAS_REFERENCE_INPUTS": int(bool(controller.reference)),
        "HAS_RATE_LIMITED": int(controller.has_rate_limit),
        "HAS_SWITCH": int(controller.has_switch),
        "STEPS_A_SAMPLE": controller.steps_a_sample,
        "MOST_SAMPLES": MOST_SAMPLES,
        "MOST_OUTPUT_DELAY": controller.most_output_delay,
    }
    header = filled(
        "controller/controller_table.h",
        slots=defines({name.upper(): slots[name].first for name in _SLOTS_IN_C.split() if name in slots}),
        facts=defines(facts),
        most_output_delay=controller.most_output_delay,
        is_none_at_zero=" || ".join(f"(slot) == {slot}" for slot in limits) or "0",
        expectations=" \\\n".join(f"        {json.dumps(p.expected)}," for p in controller.parameters),
    )
    # until sample 1 the forces are the start forces; later they do not depend on current inputs
    forces, start_forces = layout.by_name["actuator_force"], layout.by_name["start_force"]
    # the plain C defines the meaning of the memory
    texts = "".join((*code.units.values(), *code.headers.values(), f"{controller.most_output_delay} slots"))
    return UnitComponent(
        identifier=IDENTIFIER,
        name="GoughStewartController",
        description=f"Controller of a Gough–Stewart platform: {controller.title}",
        file_stem=file_stem,
        layout=layout,
        starts=starts,
        dependencies={slot: {k: "constant"} for slot, k in zip(forces.slots, start_forces.slots, strict=True)},
        experiment={
            "startTime": "0",
            "stopTime": repr(float(controller.stop_time)),
            "stepSize": repr(float(controller.sample_time / controller.steps_a_sample)),
        },
        code=Sources(
            {**c.units, **code.units},
            {**c.headers, **code.headers, "controller_table.h": header},
        ),
        icon=controller.icon,
        actuator=actuator,
        groups=(("pose", "pose and its rates", pose), ("reference", "reference of the platform", reference)),
        documents=documents,
        settings=frozenset({OUTPUT_DELAY}),
        saved_form=hashlib.sha256(texts.encode()).hexdigest(),
    )

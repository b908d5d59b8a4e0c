"""`controller_table.h`: the slots of the controller's variables and the conditions on its parameters."""

import json

from gough_stewart.fmu_build.controller.controller import Controller
from gough_stewart.fmu_build.tables import GENERATED, defines

# In one communication step; takes about 1 s.
MOST_SAMPLES = 1_000_000


def controller_header(controller: Controller) -> str:
    """`controller_table.h`."""
    rows = controller.layout.by_name
    named = ("actuator_force", "force_limited", "output_delay", "input_status", "input_bad_time")
    slots = {name.upper(): rows[name].first for name in named}
    limits = [rows[p.variable.name].first for p in controller.parameters if p.is_none_at_zero]
    facts = {
        "HAS_REFERENCE_INPUTS": int(bool(controller.reference)),
        "MOST_SAMPLES": MOST_SAMPLES,
        "START_OUTPUT_DELAY": controller.output_delay,
        "MOST_OUTPUT_DELAY": controller.most_output_delay,
    }
    expectations = " \\\n".join(f"        {json.dumps(p.expected)}," for p in controller.parameters)
    return f"""{GENERATED}
#ifndef CONTROLLER_TABLE_H
#define CONTROLLER_TABLE_H

/* slots of the outputs, and of the unit's own parameter */
{defines(slots)}

{defines(facts)}
#define EXPECTED_OUTPUT_DELAY "a whole number of samples from 1 to {facts["MOST_OUTPUT_DELAY"]}"

/* limits: no limit is infinity in the controller and 0 in the unit */
#define IS_NONE_AT_ZERO(slot) ({" || ".join(f"(slot) == {slot}" for slot in limits) or "0"})

/* for each parameter, what the controller expects if it rejects the value */
#define EXPECTATIONS \\
    {{ \\
{expectations} \\
    }}

#endif
"""

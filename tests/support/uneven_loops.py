"""Three loops at rest in a pose away from home, as experiments and as options of the documented loop."""

from typing import Any

import numpy as np

import gough_stewart as gs
from tests.support.uneven import PARAMETERS, UNEVEN

LEG = {
    "kp": [1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0],
    "kd": [110.0, 140.0, 95.0, 125.0, 150.0, 105.0],
    "ki": [900.0, 0.0, 700.0, 1100.0, 2000.0, 800.0],
}
TASK = {
    "kp": [6000.0, 7500.0, 9000.0, 5200.0, 4100.0, 3300.0],
    "kd": [520.0, 610.0, 700.0, 430.0, 390.0, 310.0],
    "ki": [5000.0, 8000.0, 9000.0, 4500.0, 3000.0, 2500.0],
}
POSE = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation]) + np.array([0.2, -0.1, 0.15, 0.1, -0.05, 0.2])
# Space, discretisation, filter, delay, lag and sample time are others in each.
LOOPS: dict[str, dict[str, Any]] = {
    "pd": {**LEG, "ki": [0.0] * 6, "space": "leg", "discretisation": "tustin", "derivative_filter": None, "delay": 2,
           "lag": 0.0, "sample_time": 5e-3},
    "task": {**TASK, "space": "task", "discretisation": "zoh", "derivative_filter": 9e-3, "delay": 0, "lag": 12e-3,
             "sample_time": 5e-3},
    "pid": {**LEG, "space": "leg", "discretisation": "backward_diff", "derivative_filter": 6e-3, "delay": 1,
            "lag": 4e-3, "sample_time": 4e-3},
}  # fmt: skip
# The machine is another one, which a designer does not know.
MACHINE: dict[str, Any] = {"platform_mass": 14.5, "platform_com": [-0.02, 0.05, 0.3], "leg_viscous_friction": 19.0}


def experiment_of(name: str, **tables: Any) -> gs.Experiment:
    """The experiment of a loop, with other tables beside it or in the place of its own."""
    options = LOOPS[name]
    has_integral = any(options["ki"])
    controller = {
        "type": "pid" if has_integral else "pd",
        "space": options["space"],
        "proportional_gain": options["kp"],
        "derivative_gain": options["kd"],
        "discretisation": options["discretisation"],
        **({"integral_gain": options["ki"]} if has_integral else {}),
        **({"derivative_filter": options["derivative_filter"]} if options["derivative_filter"] else {}),
    }
    values = {
        "title": f"uneven {name}",
        "platform": {"preset": "liu2000", "parameters": PARAMETERS},
        "plant": {"parameters": MACHINE},
        "reference": {"type": "hold", "position": POSE[:3].tolist(), "orientation": POSE[3:].tolist()},
        "controller": controller,
        "loop": {"duration": 1.0, "sample_time": options["sample_time"], "delay": options["delay"]},
        "actuators": {"lag": options["lag"]},
    }
    return gs.Experiment(**(values | tables))

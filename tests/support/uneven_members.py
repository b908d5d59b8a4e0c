"""An uneven loop with everything at once, its members that differ, and a law of a user in both forms."""

from typing import Any

import casadi
import numpy as np

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven_loops import experiment_of

NAMES = ("memory", "time", "reference_acceleration", "reference_leg_length", "leg_velocity", "leg_length", "position")
GAINS = np.array([1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0])


def law_of(_platform: object, sample_time: float, scale: float = 1.0) -> casadi.Function:
    """A law with a limited integral, a cubic spring and functions of time; its inputs are in an order of their own."""
    inputs = [casadi.SX.sym(name, size) for name, size in zip(NAMES, (6, 1, 3, 6, 6, 6, 3), strict=True)]
    memory, time, acceleration, wanted, velocity, length, position = inputs
    error = wanted - length
    integral = casadi.fmin(casadi.fmax(memory + scale * 900 * sample_time * error, -0.5), 0.4)
    force = scale * GAINS * (error + 900 * error**3) - 110 * velocity + integral
    force += casadi.if_else(time > 0.06, 2 * casadi.sin(40 * time), 0.0) + casadi.repmat(acceleration, 2, 1) / 7
    force += casadi.atan2(position[1], 3) * casadi.tanh(velocity)
    return casadi.Function("law", inputs, [integral, force], list(NAMES), ["memory_next", "actuator_force"])


class Law:
    """The same with a memory that nobody sees."""

    def __init__(self, platform: object, sample_time: float, scale: float = 1.0) -> None:
        self._function, self._memory = law_of(platform, sample_time, scale), np.zeros(6)

    def __call__(self, sample: gs.Sample) -> FloatArray:
        reference = sample.reference
        inputs = [self._memory, sample.time, reference["acceleration"], reference["leg_length"]]
        outputs = self._function(*inputs, *(sample.measured[name] for name in NAMES[4:]))
        self._memory, force = (np.asarray(output).ravel() for output in outputs)
        return force


CLOCKS = {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "jitter": "2 ms", "delay": 1}
# Everything at once; each clock is another one, and each member has other numbers.
ALL: dict[str, Any] = {
    "loop": CLOCKS,
    "sensors": {
        "noise": {"leg_length": "20 um", "leg_velocity": "1 mm/s"},
        "quantisation": {"leg_length": "3 um"},
        "sample_time": "3 ms",
        "seed": 5,
    },
    "actuators": {"force_limit": "75 N", "rate_limit": "2 kN/s", "lag": "3 ms"},
    "change": [{"at": 0.05, "factors": {"platform_mass": 1.4}}],
    "disturbance": [{"at": 0.03, "duration": 0.03, "force": ["180 N", "-90 N", "120 N"]}],
    "fault": [
        {"at": 0.035, "cut": [2, 5], "duration": 0.02},
        {"at": 0.05, "freeze": {"leg_length": [3, 4]}, "duration": 0.045},
        {"at": 0.08, "cut": [1], "freeze": {"leg_length": [4]}},
    ],
}
MANY: dict[str, Any] = {
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "platform_points": {"normal": "1 mm"},
    "fault.1.at": {"choice": ["21 ms", "35 ms"]},
    "fault.2.duration": {"choice": ["20 ms", "45 ms"]},
    "loop": {"delay": {"choice": [0, 1, 3]}, "jitter": {"choice": ["0 ms", "1 ms", "3 ms"]}},
    "sensors": {"noise": {"leg_length": {"uniform": ["0 um", "40 um"]}}},
    "actuators": {"lag": {"choice": ["0 ms", "2 ms", "5 ms"]}, "force_limit": {"uniform": ["68 N", "80 N"]}},
}


def members_of(tables: dict[str, Any], varied: dict[str, Any], kind: str = "pid", members: int = 11) -> gs.Experiment:
    """Members of an uneven loop whose reference moves."""
    motion = {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"}
    shared = {"limits": {"reference": "warn"}, "reference": motion}
    return experiment_of(kind, **{**shared, **tables, "ensemble": {**varied, "members": members, "seed": 4}})

"""How much of its limits a run has used: velocity, force and power of the legs against what the platform states."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gough_stewart.harness.results.record import Record
from gough_stewart.model.vectors import FloatArray


def shares_of_limits(record: Record, platform: Mapping[str, Any]) -> dict[str, FloatArray]:
    """By limit that the platform's parameters state, the share of it that each leg uses (n, 6) [1]: 1 is at the limit.

    - `leg_velocity_max`: |L̇|;
    - `actuator_force_max`: |F|;
    - `actuator_power_max`: |F L̇|, the larger of both ends of the row, over which F is held.
    """
    velocity, force = record["leg_velocity"], record["actuator_force"]
    values = {
        "leg_velocity_max": np.abs(velocity),
        "actuator_force_max": np.abs(force),
        "actuator_power_max": np.abs(force) * _larger_of_both_ends(np.abs(velocity)),
    }
    return {name: used / platform[name] for name, used in values.items() if platform.get(name) is not None}


def _larger_of_both_ends(values: FloatArray) -> FloatArray:
    """Of each row and the next (n, 6); nothing follows the last."""
    return np.asarray(np.maximum(values, np.concatenate([values[1:], values[-1:]])))

"""How much of the platform's limits a run uses: velocity, force and power of the legs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gough_stewart.harness.results.record import Record
from gough_stewart.model.vectors import FloatArray


def shares_of_limits(record: Record, platform: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Share of each limit that each leg uses (n, 6) [1], by the limit's name; 1 is at the limit.

    - `leg_velocity_max`: |L̇|;
    - `actuator_force_max`: |F|;
    - `actuator_power_max`: |F L̇|, the larger of the values at both ends of the row, over which F is held.
    """
    velocity, force = record["leg_velocity"], record["actuator_force"]
    values = {
        "leg_velocity_max": np.abs(velocity),
        "actuator_force_max": np.abs(force),
        "actuator_power_max": np.abs(force) * _larger_of_both_ends(np.abs(velocity)),
    }
    return {name: used / platform[name] for name, used in values.items() if platform.get(name) is not None}


def _larger_of_both_ends(values: FloatArray) -> FloatArray:
    """The larger of each row and the next (n, 6); the last row has no next."""
    return np.asarray(np.maximum(values, np.concatenate([values[1:], values[-1:]])))

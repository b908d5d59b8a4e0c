"""A PID loop that hunts: it sticks beside its goal until the integral part breaks it loose, and overshoots."""

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

import gough_stewart as gs
from tests.support.arrays import FloatArray

GOAL = 2.005
SETTINGS: dict[str, Any] = {
    "plant.parameters": {
        "leg_friction_model": "elasto_plastic",
        "leg_coulomb_friction": 400.0,
        "leg_static_friction": 2000.0,
        "leg_stribeck_velocity": 0.02,
    },
    "plant.tolerance": 1e-10,
    "reference": {"type": "step", "position_change": [0, 0, GOAL - 2.0], "at": 0.05},
    "controller.bandwidth": "2 Hz",
    "controller.damping_ratio": 0.8,
    "controller.integral_time": "0.1 s",
    "loop.duration": 4.6,
}
GIVES = {"plant.parameters.leg_stiffness": 1e8}


class Cycle(NamedTuple):
    """Of the height about its goal, after 2 s."""

    period: float  # [s]
    height: float  # from its lowest to its highest place [m]


def hunting(plant: Any = "model", **changed: Any) -> Cycle:
    """The cycle of `hold_against_gravity` with SETTINGS."""
    return cycle_of(*_rows(gs.run("hold_against_gravity", SETTINGS | changed, plant=plant)))


def cycle_of(time: FloatArray, height: FloatArray, velocity: FloatArray) -> Cycle:
    """Between the two upward passages of the goal after 2 s, by cubics through heights and velocities."""
    late = time >= 2.0
    curve = CubicHermiteSpline(time[late], height[late] - GOAL, velocity[late])
    roots = curve.roots(extrapolate=False)
    upward = roots[curve(roots, 1) > 0]
    assert len(upward) == 2
    return Cycle(float(upward[1] - upward[0]), float(np.ptp(height[late])))


def _rows(record: gs.Record) -> tuple[FloatArray, FloatArray, FloatArray]:
    return record["time"], record["position"][:, 2], record["velocity"][:, 2]

"""One reference of each kind, and times between their jumps."""

from typing import Any

import numpy as np

from gough_stewart import Chirp, Circle, Hold, PointToPoint, Sine, Step
from gough_stewart.harness.motion.motion import Reference
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.harness.motion.references import ReferenceChoice
from tests.support.arrays import FloatArray

POSITION, ORIENTATION = np.array([0.1, -0.2, 3.0]), np.array([0.2, -0.3, 0.4])
POSE: dict[str, Any] = {"position": POSITION, "orientation": ORIENTATION}
CHANGE: dict[str, Any] = {"position_change": [0.1, 0.2, -0.3], "orientation_change": [0.3, -0.2, 0.5]}
AMPLITUDE: dict[str, Any] = {"position_amplitude": [0.1, 0.2, -0.3], "orientation_amplitude": [0.3, -0.2, 0.5]}
STILL: dict[str, Any] = {"position": np.zeros(3), "orientation": np.zeros(3)}
HEAVE: dict[str, Any] = {"position_amplitude": [0, 0, 1], "orientation_amplitude": np.zeros(3)}


def table_of(reference: Reference, time: FloatArray) -> FromTable:
    motion = reference(time)
    return FromTable(time, motion.position, motion.orientation)


# Jumps of position or acceleration are at 0.5 and 2.0 s, between the times below.
KINDS: dict[str, Reference] = {
    "hold": Hold(**POSE),
    "step": Step(**POSE, **CHANGE, at=0.5),
    "point_to_point": PointToPoint(**POSE, **CHANGE, at=0.5, duration=1.5),
    "sine": Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=0.3),
    "faded sine": Sine(**POSE, **AMPLITUDE, frequency=0.7, phase=0.3, fade_in=1.1),
    "circle xy": Circle(**POSE, radius=0.2, frequency=0.7),
    "circle xz": Circle(**POSE, radius=0.2, frequency=0.7, plane="xz"),
    "faded circle": Circle(**POSE, radius=0.2, frequency=0.7, plane="yz", fade_in=1.1),
    "chirp": Chirp(**POSE, **AMPLITUDE, from_frequency=0.2, to_frequency=1.5, duration=2.0),
    "faded falling chirp": Chirp(**POSE, **AMPLITUDE, from_frequency=1.5, to_frequency=0.2, duration=2.0, fade_in=1.1),
    "table": table_of(Sine(**POSE, **AMPLITUDE, frequency=0.7), np.linspace(-0.1, 3.1, 50)),
}
SLOW, SIZE = 1.3, -0.7
SCALED: dict[str, Reference] = {
    name: kind.model_copy(update={"time_scale": SLOW, "amplitude_scale": SIZE})
    for name, kind in KINDS.items()
    if isinstance(kind, ReferenceChoice)
}
TIMES = np.linspace(0.003, 2.997, 500)

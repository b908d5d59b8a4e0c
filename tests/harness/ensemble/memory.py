"""A PID, uneven over the legs, that keeps integral and last error in each of the ways that a user may write it."""

from collections.abc import Callable
from inspect import getsource
from typing import Any

import numpy as np

import gough_stewart as gs
from tests.support.arrays import FloatArray

LEGS = 1 + 0.05 * np.arange(6)
EXPERIMENT = "heave_tolerances"
SHORT: dict[str, Any] = {
    "loop.duration": 0.03,
    "reference.position_change": [1e-4, 0, -5e-5],
    "reference.at": 0.002,
    "reference.duration": 0.02,
}
RMS = "tracking.position.norm_rms"


class Pid:
    """As a class."""

    def __init__(self, _platform: gs.Platform, sample_time: float, kp: float = 8e4, kd: float = 9e3) -> None:
        self.sample_time, self.kp, self.kd = sample_time, kp, kd
        self.integral = np.zeros(6)
        self.before: FloatArray | None = None

    def __call__(self, sample: gs.Sample) -> FloatArray:
        """The forces kp e + ki ∑ e T + kd Δe/T, with ki = 5 kp."""
        error = LEGS * (sample.reference["leg_length"] - sample.measured["leg_length"])
        self.integral += self.sample_time * error
        change = 0 * error if self.before is None else (error - self.before) / self.sample_time
        self.before = error
        return np.asarray(self.kp * error + 5 * self.kp * self.integral + self.kd * change)


def factory(_platform: gs.Platform, sample_time: float, kp: float = 8e4, kd: float = 9e3) -> Callable[..., FloatArray]:
    """As a closure, the same arithmetic."""
    integral, before = np.zeros(6), None

    def law(sample: gs.Sample) -> FloatArray:
        nonlocal integral, before
        error = LEGS * (sample.reference["leg_length"] - sample.measured["leg_length"])
        integral = integral + sample_time * error
        change = 0 * error if before is None else (error - before) / sample_time
        before = error
        return np.asarray(kp * error + 5 * kp * integral + kd * change)

    return law


def an_object() -> Pid:
    """As an object, for the sample time of the experiment."""
    return Pid(gs.load_preset("motion_base"), 1e-3)


WAYS: dict[str, Callable[[], Any]] = {"class": lambda: Pid, "object": an_object, "factory": lambda: factory}

FILE = f"""
from __future__ import annotations
import numpy as np
from legs import LEGS, remembered

{getsource(Pid)}
# the same in globals of a module beside it, which all members share
def in_globals(sample):
    return remembered.setdefault("pid", Pid(None, 1e-3))(sample)

def make(platform, sample_time, kp=8e4, kd=9e3):
    return Pid(platform, sample_time, kp, kd)

as_object = Pid(None, 1e-3)
"""
BESIDE = "import numpy as np\nLEGS = 1 + 0.05 * np.arange(6)\nremembered = {}\n"
NAMED: dict[str, dict[str, str]] = {
    "class": {"name": "Pid"},
    "factory": {"factory": "make"},
    "object": {"name": "as_object"},
}

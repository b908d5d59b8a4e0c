"""The sampled loop as data: clocks, references, sensors, actuators, limits and changes of a run, without its plant.

The same serves a run of one member and of many in parallel: where members differ, arrays have a member axis.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.vectors import FloatArray

OnStroke = Literal["ignore", "warn", "stop"]
LENGTHS = slice(12, 18)  # leg lengths, in the vector of all signals


@dataclass(frozen=True)
class Change:
    """From `time` [s] on, new values of tunable parameters, or a new external wrench (6,) [N, N m].

    With many members, parameters and wrench may have a leading axis (N,), and `members` (N,) selects those that change.
    """

    time: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    external_wrench: FloatArray | None = None
    members: BoolArray | None = None


@dataclass(frozen=True)
class Limits:
    """Conditions that end a run."""

    stroke: tuple[PerMember, PerMember] = (0.0, np.inf)  # leg lengths [m]
    on_stroke: OnStroke = "warn"
    largest_position_error: PerMember = np.inf  # [m]

    def beyond_stroke(self, lengths: FloatArray) -> BoolArray:
        """Which leg lengths (..., 6) [m] are outside of the stroke."""
        low, high = (np.asarray(each)[..., None] for each in self.stroke)
        return np.asarray((lengths < low) | (lengths > high))


def stroke_of(low: PerMember | None, high: PerMember | None) -> tuple[PerMember, PerMember]:
    """The ends of the stroke [m] from limits of a platform, None where it states none."""
    return 0.0 if low is None else low, np.inf if high is None else high


@dataclass(frozen=True)
class Loop:
    """Everything in a run except plant and controller.

    For many members, made by `together`: where members differ, arrays have a member axis after that of time, such as
    (n, N, 30), and `shape` is (N,).
    """

    timing: Timing
    reference: FloatArray | None  # reference signals and accelerations at every row (n, 30); None without a reference
    feedforward: FloatArray  # at every sample (m, 6) [N]
    start_force: FloatArray  # actuator forces before the first command (6,) [N]
    sensors: Sensors = field(default_factory=Sensors)
    actuators: Actuators = field(default_factory=Actuators)
    limits: Limits = field(default_factory=Limits)
    changes: tuple[Change, ...] = ()
    injection: FloatArray | None = None  # added to the command at every sample (m, 6) [N], to excite the loop
    shape: tuple[int, ...] = ()

"""The sampled loop as data: clocks, references, sensors, actuators, limits and changes of a run, without its plant.

The same serves a run of one member and of many in parallel: where members differ, arrays have a member axis.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from gough_stewart.harness.loop.actuators import Actuators
from gough_stewart.harness.loop.sensors import Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

OnStroke = Literal["ignore", "warn", "stop"]
LENGTHS = slice(12, 18)  # leg lengths, in the vector of all signals


@dataclass(frozen=True)
class Change:
    """From `time` [s] on, new values of tunable parameters, a new external wrench (6,) [N, N m], or what has failed.

    Faults are flags (N_FAULTS,), see `control/faults.py`. With many members, all of these may have a leading axis (N,),
    and `members` (N,) selects those that change.
    """

    time: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    external_wrench: FloatArray | None = None
    members: BoolArray | None = None
    faults: FloatArray | None = None


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

    For many members: where they differ, arrays have a member axis after that of time, such as (n, N, 30), and `shape`
    is (N,).
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

    @property
    def has_faults(self) -> bool:
        """Whether something may fail in it."""
        return any(change.faults is not None for change in self.changes)

    @property
    def worst_delay(self) -> float:
        """What the sensors' own clock and jitter add at most to the delay of the loop [s].

        With readings every m plant steps and samples every n, that of a sample is up to m − gcd(m, n) steps old.
        """
        timing, own = self.timing, self.sensors.sample_time
        n = timing.steps_a_sample
        m = n if own is None else timing.steps_in(own, "the sensors' sample_time")
        return (m - math.gcd(m, n) + timing.most_steps_late) * timing.plant_step

    @property
    def reference_rows(self) -> FloatArray | None:
        """The reference with the members last (n, 30, N), or (n, 30, 1) if common to all; None without one."""
        if self.reference is None:
            return None
        return self.reference[..., None] if self.reference.ndim == 2 else np.moveaxis(self.reference, 1, 2)


def failure_of_forces(injection: FloatArray | None, sample: int, command: FloatArray) -> str:
    """Who made a command (6,) [N] no number, or too large: the injection of a function, or the controller."""
    if injection is not None and not (np.abs(injection[sample]) <= LARGEST_NUMBER).all():
        return f"the injection's forces are {injection[sample].tolist()} N"
    return f"the controller's forces are {command.tolist()} N"


def changes_of_members(each: Sequence[Sequence[Change]], timing: Timing) -> tuple[Change, ...]:
    """The changes of N members as those of one loop, in order of time, and of each member's own at equal times.

    The i-th changes of members at a row are one if they change the same parameters, the wrench, or faults.
    """
    if all(changes is each[0] for changes in each):
        return tuple(each[0])
    kinds: dict[Any, dict[int, Change]] = {}
    for member, changes in enumerate(each):
        of_row: dict[int, int] = {}
        for change in changes:
            row = timing.row(change.time, "a change")
            of_row[row] = of_row.get(row, -1) + 1
            given = change.external_wrench is not None, change.faults is not None
            kind = (row, of_row[row], tuple(sorted(change.parameters)), *given)
            kinds.setdefault(kind, {})[member] = change
    return tuple(_change_of_some(kinds[kind], len(each)) for kind in sorted(kinds))


def _change_of_some(changes: Mapping[int, Change], n: int) -> Change:
    """The changes of some of n members as one; others have any values."""
    some = next(iter(changes.values()))
    own = [changes.get(member, some) for member in range(n)]
    whose = np.array([member in changes for member in range(n)])

    def values(each: list[Any]) -> Any:
        return each[0] if all(np.array_equal(value, each[0]) for value in each) else np.stack(each)

    return Change(
        some.time,
        {name: values([change.parameters[name] for change in own]) for name in some.parameters},
        None if some.external_wrench is None else values([change.external_wrench for change in own]),
        None if whose.all() else whose,
        None if some.faults is None else values([change.faults for change in own]),
    )

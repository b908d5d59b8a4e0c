"""The sampled loop as data: clocks, references, sensors, actuators, limits and changes of a run, without its plant.

The same serves a run of one member and of many in parallel: where members differ, arrays have a member axis.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.harness.control.component import N_FAULTS
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant
from gough_stewart.harness.plants.signals import N_LEGS, PerMember
from gough_stewart.model import interface
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

# Seed of one run; member k of an ensemble has `SeedSequence(seed, spawn_key=(k,))`.
Seed = int | SeedSequence
# Seed of one run or common to all members, or one per member.
Seeds = Seed | tuple[Seed, ...]

MOST_STEPS = 1_000_000
# Measured: some 150 numbers a row, in the loop's arrays, in the record's table, and in a copy while it is built.
BYTES_A_STEP = 4_000
# Relative tolerance within which times are multiples of the plant step.
_ROUNDING = 1e-6
OnStroke = Literal["ignore", "warn", "stop"]
LENGTHS = slice(12, 18)  # leg lengths, in the vector of all signals


def as_numbers(seed: Seeds) -> Any:
    """A seed as plain types: itself, or a sequence's entropy and its spawn key."""
    if isinstance(seed, tuple):
        return [as_numbers(of_member) for of_member in seed]
    return {"entropy": seed.entropy, "spawn_key": list(seed.spawn_key)} if isinstance(seed, SeedSequence) else seed


@dataclass(frozen=True)
class Timing:
    """Clocks of a run: plant step and recording every `plant_step`, controller every `sample_time`.

    With `jitter` J each sample but the first is delayed by a random number of plant steps h, uniform on 0 … ⌊J/h⌋, both
    ends included. For many members the jitter may be an array (N,), with one seed for each.
    """

    duration: float  # [s]
    sample_time: float  # [s]
    plant_step: float  # [s]
    jitter: PerMember = 0.0  # [s]
    seed: Seeds = 0  # of the jitter

    steps: int = field(init=False)  # plant steps in the run
    steps_a_sample: int = field(init=False)
    # whole plant steps in the jitter, () or (N,); rounded, since 0.3e-3 / 0.1e-3 is below 3
    steps_late: FloatArray = field(init=False, compare=False)
    times: FloatArray = field(init=False, compare=False)  # of the rows (steps + 1,) [s]
    # nominal times of the controller's samples [s]; none at the end of the run
    samples: FloatArray = field(init=False, compare=False)
    # the rows of the samples, with jitter: (m,), or (m, N) where members differ
    rows_of_samples: NDArray[np.intp] = field(init=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("duration", "sample_time", "plant_step"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ControllerError(f"{name} is {value!r}; expected a time > 0 s")
        short = self.plant_step
        for name, long in (("sample_time", self.sample_time), ("duration", self.duration)):
            if not long / short <= MOST_STEPS:
                raise ControllerError(
                    f"{name} {long:g} s has {long / short:.3g} plant steps of {short:g} s; expected at most "
                    f"{MOST_STEPS}, which fill about {MOST_STEPS * BYTES_A_STEP / 1e9:.2g} GB of memory; make it "
                    "shorter, or the plant_step longer"
                )
            if round(long / short) < 1 or abs(long / short - round(long / short)) > _ROUNDING:
                raise ControllerError(
                    f"plant_step {short:g} s does not divide {name} {long:g} s ({long / short:g} times); expected a "
                    f"whole number, for instance a plant_step of {long / max(1, round(long / short)):g} s"
                )
        steps, steps_a_sample = round(self.duration / short), round(self.sample_time / short)
        steps_late = np.asarray(np.floor(np.asarray(self.jitter) / short + _ROUNDING))
        times = np.arange(steps + 1, dtype=float) * short
        jitter, late = np.ravel(self.jitter), np.ravel(steps_late)
        beyond = (jitter != 0) & ~((late >= 1) & (late < steps_a_sample))
        if beyond.any():
            raise ControllerError(
                f"jitter is {jitter[beyond][0]:g} s; expected less than the sample_time of {self.sample_time:g} s, and "
                f"at least the plant_step of {self.plant_step:g} s, since samples are delayed by whole plant steps"
            )
        rows = np.arange(0, steps, steps_a_sample)
        if jitter.any():
            # of each seed a stream after those of the signals' noise; of one (m, 1), scaled by each member's jitter
            shares, stream = list[FloatArray](), len(signals.NAMES)
            for seed in self.seed if isinstance(self.seed, tuple) else (self.seed,):
                words: Any = [seed, stream]
                if isinstance(seed, SeedSequence):
                    words = SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, stream))
                shares.append(np.random.default_rng(words).uniform(size=len(rows)))
            delays = np.floor(np.stack(shares, axis=-1) * (steps_late + 1)).astype(np.intp)
            delays[0] = 0  # the first sample is at the start
            differ = isinstance(self.seed, tuple) or np.ndim(self.jitter) > 0
            rows = np.minimum(rows[:, None] + delays if differ else rows + delays[:, 0], steps - 1)
        for shared in (steps_late, times, rows):
            shared.setflags(write=False)
        for name, value in (
            ("steps", steps),
            ("steps_a_sample", steps_a_sample),
            ("steps_late", steps_late),
            ("times", times),
            ("samples", times[:steps:steps_a_sample]),
            ("rows_of_samples", rows),
        ):
            object.__setattr__(self, name, value)

    @property
    def sample_of_row(self) -> NDArray[np.intp]:
        """The last sample at or before each row: (n,), or (n, N) where members differ."""
        rows, all_rows = self.rows_of_samples, np.arange(self.steps + 1)
        if rows.ndim == 1:
            return np.searchsorted(rows, all_rows, side="right") - 1
        return np.stack([np.searchsorted(of_member, all_rows, side="right") - 1 for of_member in rows.T], axis=-1)

    def steps_in(self, time: float, name: str) -> int:
        """The number of plant steps in a time [s], which must be a whole number."""
        steps = round(time / self.plant_step)
        if steps < 1 or abs(time / self.plant_step - steps) > _ROUNDING:
            raise ControllerError(
                f"{name} is {time:g} s; expected a multiple of the plant_step of {self.plant_step:g} s"
            )
        return steps

    def row(self, time: float, name: str) -> int:
        """The row of a time [s], which must be a multiple of the plant step."""
        k = round(time / self.plant_step)
        if abs(time / self.plant_step - k) > _ROUNDING or not 0 <= k <= self.steps:
            raise ControllerError(
                f"{name} at {time:g} s; expected a time from 0 to {self.duration:g} s that is a multiple of the "
                f"plant_step of {self.plant_step:g} s"
            )
        return k


@dataclass(frozen=True)
class Sensors:
    """Per signal: standard deviation of white noise, and quantisation step, in the signal's unit.

    measured = q · round((true + σ N(0, 1)) / q), independently for each reading and element. Readings are taken at the
    controller's samples; with a separate `sample_time` [s], at its multiples, and the controller uses the latest one.
    For many members σ and q may be arrays (N,), 0 where a member has none, with one seed for each.
    """

    noise: Mapping[str, PerMember] = field(default_factory=dict)
    quantisation: Mapping[str, PerMember] = field(default_factory=dict)
    sample_time: float | None = None
    seed: Seeds = 0
    side: signals.Side = "leg"  # of elastic legs, where lengths and velocities are read


@dataclass(frozen=True)
class Actuators:
    """The path from the commanded force to the force that acts.

    The command is clipped to ± `force_limit`, held, and reaches the drive `delay` samples later. The drive follows it
    within `rate_limit` [N/s] and, with a time constant `lag` τ [s], as τ ḟ = r − f. No limits by default. For many
    members each may be an array (N,), with infinite limits for members that have none; a force limit of legs that
    differ is (1, 6) or (N, 6).
    """

    force_limit: PerMember | None = None  # [N]
    rate_limit: PerMember | None = None  # [N/s]
    lag: PerMember = 0.0  # [s]
    delay: PerMember = 0  # [samples], integer

    @property
    def values(self) -> dict[str, PerMember]:
        """Limits and lag by the keys of `[actuators]`; infinite where there is none."""
        limits = {"force_limit": self.force_limit, "rate_limit": self.rate_limit}
        return {key: np.inf if limit is None else limit for key, limit in limits.items()} | {"lag": self.lag}


class LoopSettings(NamedTuple):
    """Settings of a loop that may change while it runs: the law, noise and quantisation, force limit and delay."""

    system: Any  # of the linear controller, of the structure of that before; None for feedforward alone
    sensors: Sensors
    actuators: Actuators


@dataclass(frozen=True)
class Change:
    """From `time` [s] on, new values of tunable parameters, a new external wrench (6,) [N, N m], or what has failed.

    Faults are flags (N_FAULTS,), see `FaultChoice.flags`; `manual` is (12,), see `ChangeChoice.manual`, and holds from
    the next sample on. With many members, all of these may have a leading axis (N,), and `members` (N,) selects those
    that change. Settings are those of one member; `time` is then that of a sample, and the feedforward knows them.
    """

    time: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    external_wrench: FloatArray | None = None
    members: BoolArray | None = None
    faults: FloatArray | None = None
    settings: LoopSettings | None = None
    manual: FloatArray | None = None


@dataclass(frozen=True)
class Limits:
    """Conditions that end a run."""

    stroke: tuple[PerMember, PerMember] = (0.0, np.inf)  # leg lengths [m], of legs that differ (1, 6) or (N, 6)
    on_stroke: OnStroke = "warn"
    largest_position_error: PerMember = np.inf  # [m]

    def beyond_stroke(self, lengths: FloatArray) -> BoolArray:
        """Which leg lengths (..., 6) [m] are outside of the stroke."""
        low, high = (signals.of_legs(end).T for end in self.stroke)
        return np.asarray((lengths < low) | (lengths > high))


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

    has_faults: bool = field(init=False)  # whether something may fail in it
    has_switch: bool = field(init=False)  # whether its controller is switched off and on
    # plant steps between readings of sensors with a clock of their own; 0 for readings at the samples
    steps_a_reading: int = field(init=False)

    def __post_init__(self) -> None:
        period = self.sensors.sample_time
        steps = 0 if period is None else self.timing.steps_in(period, "the sensors' sample_time")
        object.__setattr__(self, "steps_a_reading", steps)
        object.__setattr__(self, "has_faults", any(change.faults is not None for change in self.changes))
        object.__setattr__(self, "has_switch", any(change.manual is not None for change in self.changes))

    @property
    def worst_delay(self) -> float:
        """What the sensors' own clock and jitter add at most to the delay of the loop [s].

        With readings every m plant steps and samples every n, that of a sample is up to m − gcd(m, n) steps old.
        """
        n = self.timing.steps_a_sample
        m = self.steps_a_reading or n
        return (m - math.gcd(m, n) + int(np.max(self.timing.steps_late))) * self.timing.plant_step

    def failure_of_forces(self, sample: int, command: FloatArray) -> str:
        """Who made a command (6,) [N] no number, or too large: the injection of a function, or the controller."""
        injected = None if self.injection is None else self.injection[sample]
        if injected is not None and not (np.abs(injected) <= LARGEST_NUMBER).all():
            return f"the injection's forces are {injected.tolist()} N"
        return f"the controller's forces are {command.tolist()} N"


def members_last(values: FloatArray | None) -> FloatArray | None:
    """Values over time (n, size, N) of arrays (n, N, size), or (n, size, 1) of (n, size), which all members share."""
    if values is None:
        return None
    return values[..., None] if values.ndim == 2 else np.moveaxis(values, 1, 2)


def changes_of_members(by_member: Sequence[Sequence[Change]], timing: Timing) -> tuple[Change, ...]:
    """The changes of N members as those of one loop, in order of time, and of each member's own at equal times.

    The i-th changes of members at a row are one if they change the same parameters, the wrench, faults, or the switch.
    """
    if all(changes is by_member[0] for changes in by_member):
        return tuple(by_member[0])
    alike: dict[Any, dict[int, Change]] = {}
    for member, changes in enumerate(by_member):
        number_at_row: dict[int, int] = {}
        for change in changes:
            row = timing.row(change.time, "a change")
            number = number_at_row[row] = number_at_row.get(row, -1) + 1
            has = [part is not None for part in (change.external_wrench, change.faults, change.manual)]
            kind = row, number, tuple(sorted(change.parameters)), *has
            alike.setdefault(kind, {})[member] = change

    def values(of_members: list[Any]) -> Any:
        are_equal = all(np.array_equal(value, of_members[0]) for value in of_members)
        return of_members[0] if are_equal else np.stack(of_members)

    joined = []
    for (*_, names, has_wrench, has_faults, has_manual), changing in sorted(alike.items(), key=lambda item: item[0]):
        any_change = next(iter(changing.values()))  # gives those who do not change some values
        changes = [changing.get(member, any_change) for member in range(len(by_member))]
        whose = np.array([member in changing for member in range(len(by_member))])

        joined.append(
            Change(
                any_change.time,
                {name: values([change.parameters[name] for change in changes]) for name in names},
                values([change.external_wrench for change in changes]) if has_wrench else None,
                None if whose.all() else whose,
                values([change.faults for change in changes]) if has_faults else None,
                manual=values([change.manual for change in changes]) if has_manual else None,
            )
        )
    return tuple(joined)


class ScheduledChanges:
    """The changes of a loop by row, and what they change: parameters of a plant, its inputs, what fails, the switch."""

    def __init__(self, loop: Loop, plant: Plant) -> None:
        self._plant = plant
        # (N, size), members contiguous: inputs of the plant, 1 of what has failed, and see `Change`
        self.inputs, self.faults, self.manual = (
            np.zeros((size, *plant.shape)).T for size in (interface.N_INPUTS, N_FAULTS, 2 * N_LEGS)
        )
        self.inputs[:, :N_LEGS] = loop.start_force
        self.by_row: dict[int, list[Change]] = {}
        for change in loop.changes:
            self.by_row.setdefault(loop.timing.row(change.time, "a change"), []).append(change)

    def apply(self, row: int) -> None:
        """Pass the changes of a row to the plant, the inputs, the faults, and the switch."""
        for change in self.by_row.get(row, ()):
            if change.members is not None and change.parameters:
                self._plant.set_parameters_of(change.members, change.parameters)
            elif change.parameters:
                self._plant.set_parameters(change.parameters)
            whose = True if change.members is None else change.members[:, None]
            if change.external_wrench is not None:
                np.copyto(self.inputs[:, N_LEGS:], change.external_wrench, where=whose)
            if change.faults is not None:
                np.copyto(self.faults, change.faults, where=whose)
            if change.manual is not None:
                np.copyto(self.manual, change.manual, where=whose)

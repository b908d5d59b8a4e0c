"""The sampled loop: a controller in discrete time around the plant, as it would run on the machine."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.laws import Law
from gough_stewart.harness.errors import ControllerError, PlantError
from gough_stewart.harness.loop.actuators import Actuators, Drives
from gough_stewart.harness.loop.sensors import Encoders, Sensors
from gough_stewart.harness.loop.timing import Timing
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import Plant
from gough_stewart.model import interface
from gough_stewart.model.errors import StepError
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

LawFrom = Callable[[FloatArray, FloatArray], Law]
Status = Literal["completed", "diverged", "stopped", "interrupted"]
OnStroke = Literal["ignore", "warn", "stop"]
_LENGTHS = slice(12, 18)  # of the legs, in the vector of all signals
_ROWS_A_REPORT = 64


@dataclass(frozen=True)
class Change:
    """From `time` [s] on, other tunable parameters of the plant, or another external wrench (6,) [N, N m]."""

    time: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    external_wrench: FloatArray | None = None


@dataclass(frozen=True)
class Limits:
    """What ends a run."""

    stroke: tuple[float, float] = (0.0, np.inf)  # leg lengths [m]
    on_stroke: OnStroke = "warn"
    largest_position_error: float = np.inf  # [m]

    def beyond_stroke(self, lengths: FloatArray) -> NDArray[np.bool_]:
        """Which leg lengths (..., 6) [m] are outside of the stroke."""
        return np.asarray((lengths < self.stroke[0]) | (lengths > self.stroke[1]))


class Outcome(NamedTuple):
    """How a run ended."""

    status: Status
    time: float  # [s]
    cause: str | None


@dataclass(frozen=True)
class Loop:
    """Everything of a run but plant and controller."""

    timing: Timing
    wanted: FloatArray | None  # signals and accelerations on the reference at every row (n, 30); None without one
    feedforward: FloatArray  # at every sample (m, 6) [N]
    start_force: FloatArray  # of the actuators before the first command (6,) [N]
    sensors: Sensors = field(default_factory=Sensors)
    actuators: Actuators = field(default_factory=Actuators)
    limits: Limits = field(default_factory=Limits)
    changes: tuple[Change, ...] = ()
    injection: FloatArray | None = None  # added to the command at every sample (m, 6) [N], to excite the loop


@dataclass(frozen=True)
class Run:
    """What happened, row by row as far as the run came; per sample what the controller did."""

    time: FloatArray  # (n,)
    results: FloatArray  # (n, N_RESULTS)
    inputs: FloatArray  # (n, 12)
    rate_limited: NDArray[np.bool_]  # (n, 6)
    stroke_exceeded: NDArray[np.bool_]  # (n, 6)
    sample_of_row: NDArray[np.intp]  # (n,), the last sample at or before each row
    measured: FloatArray  # (m, 24)
    command: FloatArray  # (m, 6), before any limit
    controller_state: FloatArray  # (m, n_states), with which the command was made
    force_limited: NDArray[np.bool_]  # (m, 6)
    outcome: Outcome


def simulate(plant: Plant, law_from: LawFrom | None, loop: Loop, progress: TimeProgress | None = None) -> Run:
    """Run the loop to its end, or to where it cannot go on; that is an outcome, not an error.

    At each sample: measure, compute, and from then on (`actuators.delay` samples later) hold the forces. At each
    plant step: changes come into effect, the drives act, everything is recorded, the plant goes on.

    Parameters
    ----------
    law_from
        Makes the controller from references (30,) and signals (24,) of the first sample; None for feedforward alone.
    progress
        Called with the time [s] now and then.

    Raises
    ------
    ControllerError
        The controller gave no forces at its first sample.
    PlantError
        The plant refuses what it is asked for before there is a row; later it ends the run.
    """
    n, times = loop.timing.steps, loop.timing.times
    n_results, n_inputs = interface.size_of(interface.RESULTS), interface.size_of(interface.INPUTS)
    drives = Drives(loop.actuators, loop.start_force, loop.timing.sample_time, loop.timing.plant_step)
    sampler, changes = _Sampler(loop, law_from, drives), _by_row(loop)
    results, inputs = np.zeros((n + 1, n_results)), np.zeros((n + 1, n_inputs))
    rate_limited = np.zeros((n + 1, 6), dtype=bool)
    acting = np.append(loop.start_force, np.zeros(n_inputs - 6))
    outcome: Outcome | None = None
    rows = 0
    try:
        for k, time in enumerate(times.tolist()):
            for change in changes.get(k, ()):
                _apply(change, plant, acting)
            now = plant.results()[: signals.SIZE]
            if k < n:
                outcome = sampler.at_row(k, time, now)
                if outcome is None:
                    acting[:6], rate_limited[k] = drives.step()
            plant.set_inputs(acting)
            # once more: accelerations and joint forces under the forces that act from here on
            results[k], inputs[k] = plant.results(), acting
            rows = k + 1
            outcome = outcome or _end_of(loop, k, time, now)
            if outcome is not None:
                break
            if k < n:
                plant.do_step(time, loop.timing.plant_step)
            if progress is not None and k % _ROWS_A_REPORT == 0:
                progress(time)
    except (StepError, ControllerError, PlantError) as error:
        if not rows:
            raise
        outcome = Outcome("diverged" if isinstance(error, StepError) else "stopped", float(times[rows - 1]), str(error))
    except KeyboardInterrupt:
        if not rows:
            raise
        outcome = Outcome("interrupted", float(times[rows - 1]), "interrupted by the user")
    return Run(
        times[:rows],
        results[:rows],
        inputs[:rows],
        rate_limited[:rows],
        loop.limits.beyond_stroke(results[:rows, _LENGTHS]),
        sampler.sample_of_row[:rows],
        sampler.measured,
        sampler.command,
        sampler.state,
        sampler.force_limited,
        outcome or Outcome("completed", float(times[-1]), None),
    )


class _Sampler:
    """The controller's side of the loop: it wakes up at the samples, and keeps what it did."""

    def __init__(self, loop: Loop, law_from: LawFrom | None, drives: Drives) -> None:
        timing = loop.timing
        m = len(timing.samples)
        self._loop, self._law_from, self._drives = loop, law_from, drives
        own = loop.sensors.sample_time
        every = None if own is None else timing.steps_in(own, "the sensors' sample_time")
        self._encoders = Encoders(loop.sensors, every, m if every is None else timing.steps // every + 1)
        if law_from is not None and loop.wanted is None:
            raise ControllerError("a controller without a reference; expected the signals that it is to follow")
        self._wanted: FloatArray = np.zeros((0, 0)) if loop.wanted is None else loop.wanted
        self._rows = timing.rows_of_samples.tolist()
        self._next = 0
        self._law: Law | None = None
        self._excess = np.zeros(6)
        self.measured, self.command = np.zeros((m, signals.SIZE)), np.zeros((m, 6))
        self.force_limited = np.zeros((m, 6), dtype=bool)
        self.state: FloatArray = np.zeros((m, 0))
        self.sample_of_row = np.searchsorted(self._rows, np.arange(timing.steps + 1), side="right") - 1
        self._every = timing.steps_a_sample

    def at_row(self, k: int, time: float, now: FloatArray) -> Outcome | None:
        """Measure, compute and command, if there is a sample at this row; an outcome if that cannot be done."""
        j = self._next
        is_sample = j < len(self._rows) and self._rows[j] == k
        reading = self._encoders(k, now, is_sample)
        if not is_sample:
            return None
        self._next += 1
        self.measured[j] = reading
        # the controller counts its samples, and knows nothing of their being late
        nominal = j * self._every
        command = self._loop.feedforward[j]
        if self._loop.injection is not None:
            command = command + self._loop.injection[j]
        if self._law_from is not None:
            wanted = self._wanted[nominal]
            if self._law is None:
                self._law = self._law_from(wanted, self.measured[0])
                self.state = np.zeros((len(self.measured), len(self._law.state)))
            self.state[j] = self._law.state
            command = command + self._law.force(
                j, nominal * self._loop.timing.plant_step, wanted, self.measured[j], self._excess
            )
        self.command[j] = command
        # false of NaN, too; NumPy takes three times as long
        if not all(abs(force) <= LARGEST_NUMBER for force in command.tolist()):
            return Outcome("diverged", time, f"the controller's forces are {command.tolist()} N")
        self.force_limited[j], self._excess = self._drives.command(command)
        if self._law is not None and self._law.limited is not None:
            self.force_limited[j] |= self._law.limited
        return None


def _apply(change: Change, plant: Plant, acting: FloatArray) -> None:
    """Parameters to the plant, the wrench into the inputs (12,)."""
    if change.parameters:
        plant.set_parameters(change.parameters)
    if change.external_wrench is not None:
        acting[6:] = change.external_wrench


def _end_of(loop: Loop, k: int, time: float, now: FloatArray) -> Outcome | None:
    """The reason to end the run at a row, if there is one."""
    limits = loop.limits
    if limits.on_stroke == "stop" and limits.beyond_stroke(now[_LENGTHS]).any():
        leg = int(limits.beyond_stroke(now[_LENGTHS]).argmax())
        low, high = limits.stroke
        cause = f"leg {leg + 1} is {now[_LENGTHS][leg]:.6g} m long; its stroke is {low:g} to {high:g} m"
        return Outcome("stopped", time, cause)
    if loop.wanted is not None:
        gap = loop.wanted[k, :3] - now[:3]
        error, bound = math.sqrt(gap @ gap), limits.largest_position_error
        if not error <= bound:  # true of NaN, too
            cause = f"the platform is {error:.3g} m from its reference; the bound is {bound:g} m"
            return Outcome("diverged", time, cause)
    return None


def _by_row(loop: Loop) -> dict[int, list[Change]]:
    rows: dict[int, list[Change]] = {}
    for change in loop.changes:
        rows.setdefault(loop.timing.row(change.time, "a change"), []).append(change)
    return rows

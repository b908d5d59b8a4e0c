"""The controllers' part of a run: measure, compute and command at the samples."""

from typing import TYPE_CHECKING, cast

import numpy as np

from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.actuators import Drives
from gough_stewart.harness.loop.loop import LawFrom, Loop
from gough_stewart.harness.loop.observing import Sampled
from gough_stewart.harness.loop.outcomes import Outcomes
from gough_stewart.harness.loop.sensors import Encoders
from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.control.laws import Law
    from gough_stewart.harness.control.laws_together import LawOfMany


class Sampler:
    """The actions at the samples of one run, or of many in parallel.

    With jitter, members may be sampled at different rows, but always within the same sample time.
    """

    def __init__(
        self,
        loop: Loop,
        law_from: LawFrom | None,
        drives: Drives,
        outcomes: Outcomes,
        shape: tuple[int, ...],
    ) -> None:
        timing = loop.timing
        own = loop.sensors.sample_time
        every = None if own is None else timing.steps_in(own, "the sensors' sample_time")
        rows = timing.rows_of_samples
        self._encoders = Encoders(loop.sensors, every, shape)
        if law_from is not None and loop.reference is None:
            raise ControllerError("a controller without a reference; expected the reference signals for it to follow")
        self._loop, self._law_from, self._drives, self._outcomes, self._shape = loop, law_from, drives, outcomes, shape
        self._every, self._plant_step = timing.steps_a_sample, timing.plant_step
        # a list if common to all members, since Python reads it faster; None where members differ
        self._rows = rows.tolist() if rows.ndim == 1 else None
        self._rows_of_members = rows
        self._law: Law | None = None
        self._no_state = np.zeros((*shape, 0))
        self._excess = members.zeros(shape, 6)
        self.command = members.zeros(shape, 6)
        self.force_limited = members.flags(shape, 6)

    def at_row(self, k: int, time: float, now: FloatArray) -> Sampled | None:
        """Measure, compute and command, for members with a sample at this row; failures end members."""
        j, due = k // self._every, None
        if self._rows is not None:
            is_sample = self._rows[j] == k
        else:
            due = self._rows_of_members[j] == k
            is_sample = bool(due.any())
        reading = self._encoders(k, now, j if is_sample else None)
        if not is_sample:
            return None
        return self._sample(j, time, reading, due)

    def _sample(self, j: int, time: float, reading: FloatArray, due: BoolArray | None) -> Sampled:
        if not self._outcomes.all_go:  # of many: a single run has ended
            due = self._outcomes.going & (True if due is None else due)
        command = self._loop.feedforward[j]
        if self._loop.injection is not None:
            command = command + self._loop.injection[j]
        state = self._no_state
        if self._law_from is not None and self._loop.reference is not None:
            # the controller counts nominal samples, regardless of jitter
            reference = self._loop.reference[j * self._every]
            if self._law is None:
                self._law = self._law_from(reference, reading)
                self._encoders.only(self._law.used)
            state = self._law.state
            at = j * self._every * self._plant_step
            if self._shape:
                force, due = self._forces(cast("LawOfMany", self._law), j, at, reference, reading, due)
            else:
                force = self._law.force(j, at, reference, reading, self._excess)
            command = command + force
        if self._shape:
            self._command_many(j, time, command, due)
        else:
            self._command_one(j, time, command)
        used = () if self._law is None else self._law.used
        return Sampled(j, due, reading, state, self.command, self.force_limited, used)

    def _command_one(self, j: int, time: float, command: FloatArray) -> None:
        self.command = command
        # this sum is fast in Python, and conclusive except for the largest forces; also false for NaN
        if not (sum(map(abs, command.tolist())) < LARGEST_NUMBER or (np.abs(command) <= LARGEST_NUMBER).all()):
            self._outcomes.end(True, "diverged", _forces_are(command), time=time)
            self.force_limited = np.zeros(6, dtype=bool)
            return
        self.force_limited, self._excess = self._drives.command(j, command)
        if self._law is not None and self._law.limited is not None:
            self.force_limited = self.force_limited | self._law.limited

    def _command_many(self, j: int, time: float, command: FloatArray, due: BoolArray | None) -> None:
        going = self._outcomes.going
        if due is not None:
            # a member's command stays until its next sample; that of an ended member is cleared
            command = np.where(due[:, None], command, np.where(going[:, None], self.command, 0.0))
        self.command = command if command.ndim == 2 else np.broadcast_to(command, (*self._shape, 6))
        if not members.all_below(self.command, LARGEST_NUMBER):
            beyond = ~(np.abs(self.command) <= LARGEST_NUMBER).all(axis=-1)
            self._outcomes.end(beyond, "diverged", lambda member: _forces_are(self.command[member]), time=time)
            due = going & (True if due is None else due)
        # for commands that were held, both stay the same
        cut, self._excess = self._drives.command(j, self.command, due)
        self.force_limited = cut & going[:, None]

    def _forces(
        self, law: "LawOfMany", j: int, at: float, reference: FloatArray, reading: FloatArray, due: BoolArray | None
    ) -> tuple[FloatArray, BoolArray | None]:
        """Forces of many members, and which are due now, without those whose controllers gave none."""
        force = law.force(j, at, reference, reading, self._excess, due)
        if law.failures:
            failed = np.isin(np.arange(self._shape[0]), list(law.failures))
            self._outcomes.end(failed, "stopped", lambda k: str(law.failures[k]), counts=False)
            due = self._outcomes.going & (True if due is None else due)
        return force, due


def _forces_are(command: FloatArray) -> str:
    return f"the controller's forces are {command.tolist()} N"

"""The controllers' part of a run: measure, compute and command at the samples."""

from collections.abc import Mapping

import numpy as np

from gough_stewart.harness.control.faults import FROZEN
from gough_stewart.harness.control.laws_of_members import Law, LawFrom
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.actuators import Drives
from gough_stewart.harness.loop.loop import Loop, failure_of_forces
from gough_stewart.harness.loop.outcomes import Outcomes
from gough_stewart.harness.loop.rows import AllRows, Rows
from gough_stewart.harness.loop.sensors import Encoders
from gough_stewart.harness.plants import members
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.vectors import FloatArray


class Sampler:
    """The actions at the samples of a run.

    With jitter, members may be sampled at different rows, but always within the same sample time. `faults` (N, 30) are
    flags that others change, None if nothing can fail.
    """

    def __init__(
        self,
        loop: Loop,
        law_from: LawFrom | None,
        drives: Drives,
        outcomes: Outcomes,
        rows_of_run: Rows,
        faults: FloatArray | None = None,
    ) -> None:
        timing, shape = loop.timing, outcomes.going.shape
        own = loop.sensors.sample_time
        every = None if own is None else timing.steps_in(own, "the sensors' sample_time")
        rows = timing.rows_of_samples
        frozen = None if faults is None else faults[..., FROZEN]
        self._encoders = Encoders(loop.sensors, every, *shape, frozen=frozen)
        self._loop, self._law_from, self._drives, self._outcomes, self._shape = loop, law_from, drives, outcomes, shape
        self._every, self._plant_step = timing.steps_a_sample, timing.plant_step
        self._kept = rows_of_run if isinstance(rows_of_run, AllRows) else None
        # a list if common to all members, since Python reads it faster; None where members differ
        self._rows = rows.tolist() if rows.ndim == 1 else None
        self._rows_of_members = rows
        self._law: Law | None = None
        self.failures: Mapping[int, ControllerError] = {}  # members whose controller gave no forces at the last sample
        self._no_state = np.zeros((*shape, 0))
        self._excess = members.zeros(shape, 6)
        self.command = members.zeros(shape, 6)
        self.force_limited = members.zeros(shape, 6).astype(bool)

    def at_row(self, k: int, now: FloatArray) -> None:
        """Measure, compute and command, for members with a sample at this row; failures end members."""
        j, due = k // self._every, None
        if self._rows is not None:
            is_sample = self._rows[j] == k
        else:
            due = self._rows_of_members[j] == k
            is_sample = bool(due.any())
        reading = self._encoders(k, now, j if is_sample else None, due)
        if is_sample:
            self._sample(j, reading, due)

    def _sample(self, j: int, reading: FloatArray, due: BoolArray | None) -> None:
        if not self._outcomes.all_go:
            due = self._outcomes.going & (True if due is None else due)
        command = self._loop.feedforward[j]
        if self._loop.injection is not None:
            command = command + self._loop.injection[j]
        state, law = self._no_state, self._law
        if self._law_from is not None and self._loop.reference is not None:
            # the controller counts nominal samples, regardless of jitter
            reference = self._loop.reference[j * self._every]
            if law is None:
                law = self._law = self._law_from(reference, reading)
                self._encoders.only(law.used)
            state = law.state
            force = law.force(j, j * self._every * self._plant_step, reference, reading, self._excess, due)
            if law.failures:
                self.failures = law.failures
                due = self._without_failures(due)
            command = command + force
        self._command(j, command, due, law)
        if self._kept is not None:
            used = () if law is None else law.used
            self._kept.sample(j, due, reading, state, self.command, self.force_limited, used)

    @property
    def may_overrun(self) -> bool:
        """Whether samples after the end of a run do no harm; known after the first one."""
        return self._law is None or self._law.may_overrun

    def _without_failures(self, due: BoolArray | None) -> BoolArray:
        """End the members whose controllers gave no forces; the members that are due without them."""
        failed = np.isin(np.arange(*self._shape), list(self.failures))
        self._outcomes.end(failed, "stopped", lambda k: str(self.failures[k]))
        return self._outcomes.going & (True if due is None else due)

    def _command(self, j: int, command: FloatArray, due: BoolArray | None, law: Law | None) -> None:
        going = self._outcomes.going
        if due is not None:
            # a member's command stays until its next sample; that of an ended member is cleared
            command = np.where(due[:, None], command, np.where(going[:, None], self.command, 0.0))
        self.command = command if command.ndim == 2 else np.broadcast_to(command, (*self._shape, 6))
        if not members.all_below(self.command.T, LARGEST_NUMBER):
            beyond = ~(np.abs(self.command) <= LARGEST_NUMBER).all(axis=-1)
            self._outcomes.end(
                beyond,
                "diverged",
                lambda member: failure_of_forces(self._loop.injection, j, self.command[member]),
                at_next=True,
            )
            due = going & (True if due is None else due)
        # for commands that were held, both stay the same
        self.force_limited, self._excess = self._drives.command(j, self.command, due)
        if law is not None and law.limited is not None:
            self.force_limited = self.force_limited | law.limited
        if not self._outcomes.all_go:
            self.force_limited = self.force_limited & going[:, None]

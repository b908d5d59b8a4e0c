"""The host of the sampled loop in Python, for what calls back into it: functions of users, FMUs, any plant.

It moves time and values, one row after the other; what a component does is in its own file, as for machine code.
"""

import ctypes
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.harness.control.component import (
    CUT,
    FROZEN,
    Cut,
    Drive,
    ForceLimits,
    Freeze,
    NoCoefficients,
    Sensor,
    Takeover,
)
from gough_stewart.harness.control.laws_of_members import Law, SeparateLaws
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.loop.folds import AT
from gough_stewart.harness.loop.libraries import loop_kernel
from gough_stewart.harness.loop.loop import Loop, ScheduledChanges, Seeds
from gough_stewart.harness.loop.rows import AllRows, RowMonitor
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray, Plant, PlantOfOne, seen
from gough_stewart.harness.plants.signals import MOTORS, N_LEGS, PerMember
from gough_stewart.model.errors import MembersError
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

_ROWS_A_REPORT = 64
# Readings of all members in a block in which noise is drawn; the numbers do not depend on it.
_BLOCK = 64
_NO_COEFFICIENTS = NoCoefficients()


def run_in_python(  # noqa: PLR0912, PLR0915 - a row, in the order of what happens
    plant: Plant,
    law: Law | None,
    loop: Loop,
    readings: "SensorReadings",  # after the first reading, which the law has had
    monitor: RowMonitor,
    changes: ScheduledChanges,  # of which those of the first row have been applied
    progress: TimeProgress | None,
) -> None:
    """Run any plant with any controllers row by row, to the end or until no member is left."""
    if any(change.settings is not None for change in loop.changes):
        raise ControllerError(
            "settings of the loop change during the run, which only machine code can; expected a linear controller, "
            "and the plant 'model'"
        )
    timing, (n,), going = loop.timing, plant.shape, monitor.going
    steps, step, every, reading_every = timing.steps, timing.plant_step, timing.steps_a_sample, loop.steps_a_reading
    sampled = timing.rows_of_samples
    sampled_together = sampled.tolist() if sampled.ndim == 1 else None  # a list, since Python reads it faster
    inputs, forces, cut = changes.inputs, changes.inputs[:, :N_LEGS], changes.faults[:, CUT]
    has_motors, reads_motors = MOTORS in plant.columns, loop.sensors.side == "motor"
    has_faults, has_switch = loop.has_faults, loop.has_switch
    reading = readings.latest

    # limits, a line of forces (slots, 6, N) that wait for their delay, and drives; members last. NumPy is twice as fast
    # with arrays of full size as with a number beside them.
    start = np.broadcast_to(loop.start_force, (n, N_LEGS)).T.copy()
    values = {key: np.full(start.shape, np.transpose(value)) for key, value in loop.actuators.values.items()}
    limits = ForceLimits.without_idle(ForceLimits.prepare(values, timing.sample_time))
    drive = Drive.without_idle(Drive.prepare(values, step))
    planned, driven, target = ForceLimits.start(limits, (start,)), Drive.start(drive, (start,)), start
    delay = np.broadcast_to(np.asarray(loop.actuators.delay), (n,))
    delayed = np.tile(start, (int(delay.max()) + 1, 1, 1))
    has_one_delay, all_members = delay.min() == delay.max(), np.arange(n)
    command, excess = start.copy().T, signals.zeros((n,), N_LEGS)
    takeover = Takeover.prepare({}, timing.sample_time)
    transfer, switched_off, manual_force = Takeover.start(takeover, (start,)), np.zeros(n, dtype=bool), start
    no_flags, state = np.zeros((N_LEGS, n), dtype=bool).T, np.zeros((n, 0))
    force_limited: BoolArray = no_flags

    for row, time in enumerate(timing.times.tolist()):
        if row in changes.by_row:
            if row:
                changes.apply(row)
            switched_off, force_by_hand = changes.manual[:, 0] > 0, changes.manual[:, N_LEGS:]
            manual_force = np.where(np.isnan(force_by_hand), command, force_by_hand).T
        # what ends and is recorded is where the platform is
        now = plant.signals()
        at_motors = seen(plant, "motor") if has_motors else now
        monitor.check_plant(now, at_motors)
        rate_limited = no_flags
        if row < steps:
            # readings; with jitter members may be sampled at different rows, but always within the same sample time
            j, due = row // every, None
            if sampled_together is not None:
                is_sample = sampled_together[j] == row
            else:
                due = sampled[j] == row
                is_sample = bool(due.any())
            measured = at_motors if reads_motors else now
            if reading_every and row % reading_every == 0:
                reading = readings.read(row // reading_every, measured)
            elif is_sample and not reading_every:
                reading = readings.read(j, measured, due)

            if is_sample:
                # the command; the controller counts nominal samples, regardless of jitter, and may end members
                due = _due_and_going(due, monitor)
                off = None
                if has_switch and switched_off.any():
                    off = switched_off if due is None else switched_off & due
                new = loop.feedforward[j] if loop.injection is None else loop.feedforward[j] + loop.injection[j]
                if law is not None and loop.reference is not None:
                    state = law.state
                    force = law.force(j, j * every * step, loop.reference[j * every], reading, excess, due, off)
                    for member, error in law.failures.items():
                        monitor.end(member, monitor.n_rows, "stopped", str(error))
                    due = _due_and_going(due, monitor)
                    new = new + force
                new = new if new.shape == command.shape else np.broadcast_to(new, command.shape)
                if has_switch:
                    is_off = switched_off.astype(float)
                    lacked, (taken,) = Takeover.step(takeover, transfer, (new.T, manual_force, is_off))
                    new = taken.T
                    transfer = lacked if due is None else (np.where(due, lacked[0], transfer[0]),)
                if due is not None:
                    # a member's command stays until its next sample; that of an ended member is cleared
                    new = np.where(due[:, None], new, np.where(going[:, None], command, 0.0))
                command, commanded = new, due
                if has_switch and isinstance(law, SeparateLaws):
                    law.hear(command)
                if not signals.all_below(command.T, LARGEST_NUMBER):
                    beyond = ~(np.abs(command) <= LARGEST_NUMBER).all(axis=1)
                    for member in np.flatnonzero(beyond).tolist():  # with this row, before its limits are checked
                        cause = loop.failure_of_forces(j, command[member])
                        monitor.end(member, monitor.n_rows + 1, "diverged", cause)
                    due = _due_and_going(due, monitor)

                # what of the command is allowed, and what of that reaches the drives now
                following, (allowed, is_cut, rest) = ForceLimits.step(limits, planned, (command.T,))
                delayed[j % len(delayed)] = allowed  # of members that are not due the last ones, replaced at their row
                late = delayed[(j - int(delay[0])) % len(delayed)]
                if not has_one_delay:
                    late = delayed[(j - delay) % len(delayed), :, all_members].T
                rest = rest if rest is None or off is None else np.where(off, 0.0, rest)
                if due is None:
                    planned, target = following, late
                    excess = excess if rest is None else rest.T
                else:
                    # for the others the command is still the last one, and so is what the drives make of it
                    target = np.where(due, late, target)
                    planned = tuple(np.where(due, *states) for states in zip(following, planned, strict=True))
                    excess = excess if rest is None else np.where(due, rest, excess.T).T
                force_limited = no_flags if is_cut is None else is_cut.T
                if law is not None and law.limited is not None:
                    force_limited = force_limited | law.limited
                if not monitor.all_go:
                    force_limited = force_limited & going[:, None]
                if isinstance(monitor.rows, AllRows):
                    rows, of_due = monitor.rows, ... if commanded is None else (slice(None), commanded)
                    rows.measured[j][of_due], rows.state[j][of_due] = reading.T[of_due], state.T[of_due]
                    rows.command[j][of_due], rows.limited[j][of_due] = command.T[of_due], force_limited.T[of_due]
                if not monitor.all_go and not (monitor.counting > row).any():
                    # all controllers have failed: this row does not count
                    if law is not None and isinstance(plant, PlantOfOne) and not row:
                        raise law.failures[0]
                    return

            # the drives
            driven, (mean, is_behind) = Drive.step(drive, driven, (target,))
            rate_limited = rate_limited if is_behind is None else is_behind.T
            if monitor.all_go:
                forces[...] = mean.T
            else:
                np.copyto(forces, mean.T, where=going[:, None])
                rate_limited = rate_limited & going[:, None]
        if has_faults:
            _, (left,) = Cut.step(_NO_COEFFICIENTS, (), (forces, cut))
            np.copyto(forces, left, where=going[:, None])
        plant.set_inputs(inputs)
        monitor.add(now, inputs, force_limited, rate_limited)
        if progress is not None and row % _ROWS_A_REPORT == 0:
            progress(time)
        if row == steps:
            return

        # the plant; members that have ended, or that it cannot step, stay at their last row
        if monitor.ended_now:
            monitor.ended_now = False
            if not going.any():
                return
            plant.freeze(~going)
        try:
            plant.do_step(time, step)
        except MembersError as error:
            for member, failure in error.failures.items():
                monitor.end(member, row + 1, "diverged", str(failure))
            monitor.ended_now = False  # the plant has already frozen them
            if not going.any():
                return


def _due_and_going(due: BoolArray | None, monitor: RowMonitor) -> BoolArray | None:
    """Members that are due (N,) and still run; None for all."""
    if monitor.all_go:
        return due
    return monitor.going & (True if due is None else due)


class SensorReadings:
    """What the sensors of N members read, by their noise, quantisation and faults.

    Faults are flags (N, N_FAULTS), changed by others; what is frozen stays as the member's last reading was. Signals
    that are not used, None for all, are without noise.
    """

    def __init__(self, loop: Loop, members: int, faults: FloatArray, used: Iterable[str] | None = None) -> None:
        sensors = loop.sensors
        names = signals.NAMES if used is None else tuple(used)
        self._frozen = faults[:, FROZEN] if loop.has_faults else None
        self._coefficients = Sensor.without_idle(
            Sensor.prepare({"quantisation": by_element(sensors.quantisation, names, members)})
        )
        self._deviations = by_element(sensors.noise, names, members)
        noisy = np.flatnonzero((self._deviations > 0).any(axis=1)).tolist()
        self._noisy = range(noisy[0], noisy[-1] + 1) if noisy else range(0)
        self._streams = streams_of(sensors.seed)
        self._block, self._first, self._size = np.zeros((0, signals.SIZE, members)), 0, max(1, _BLOCK // members)
        self.latest: FloatArray = np.zeros((0, signals.SIZE))  # reading (N, 24)

    def read(self, k: int, true: FloatArray, due: BoolArray | None = None) -> FloatArray:
        """Reading k (N, 24) of the true signals, for the members that are due (N,), by default for all."""
        noise = None
        if self._noisy:
            if not 0 <= k - self._first < len(self._block):
                self._first = k
                self._block = np.zeros((self._size, *self._deviations.shape))
                # standard normal numbers of c/loop/noise.h, each a function of seed, reading and element alone
                drawn = np.zeros((self._size, len(self._noisy), self._streams.shape[1]))
                sizes = (drawn.shape[2], k, self._size, self._noisy.start, len(self._noisy))
                loop_kernel(IDEAL).library.loop_noise(
                    *(ctypes.c_void_p(self._streams.ctypes.data), *map(ctypes.c_int64, sizes)),
                    ctypes.c_void_p(drawn.ctypes.data),
                )
                self._block[:, self._noisy] = drawn * self._deviations[self._noisy]
            noise = self._block[k - self._first]
        columns = true.T
        reading: FloatArray
        _, (reading,) = Sensor.step(self._coefficients, (), (columns, noise))
        reading = reading.copy().T if reading is columns else reading.T
        if self._frozen is not None:
            if not len(self.latest):  # a sensor that is frozen from the start has its first reading
                self.latest = reading.copy()
            _, (reading,) = Freeze.step(_NO_COEFFICIENTS, (), (reading, self.latest, self._frozen))
            if due is not None:
                reading = np.where(due[:, None], reading, self.latest)
        self.latest = reading
        return reading


def by_element(sizes: Mapping[str, PerMember], names: Iterable[str], members: int) -> FloatArray:
    """A size of these signals' sensors for all elements (24, N); 0 where there is none."""
    values = np.zeros((signals.SIZE, members))
    for name in names:
        values[AT[name]] = sizes.get(name, 0.0)
    return values


def streams_of(seeds: Seeds) -> NDArray[np.int64]:
    """The streams (4, N) of the members' seeds, or (4, 1) of one seed for all: words of 32 bits."""
    several = seeds if isinstance(seeds, tuple) else (seeds,)
    sequences = (seed if isinstance(seed, SeedSequence) else SeedSequence(seed) for seed in several)
    return np.array([sequence.generate_state(4) for sequence in sequences], np.int64).T.copy()

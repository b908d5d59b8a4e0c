"""The host of the sampled loop in Python, for what calls back into it: functions of users, FMUs, any plant.

It moves time and values, one row after the other; what a component does is in its own file, as for machine code.
"""

import ctypes
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.harness.control.drive import Drive, ForceLimits
from gough_stewart.harness.control.faults import CUT, FROZEN, Cut, Freeze, NoCoefficients
from gough_stewart.harness.control.laws_of_members import Law
from gough_stewart.harness.control.manual import Takeover
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.loop.folds import AT
from gough_stewart.harness.loop.libraries import loop_kernel
from gough_stewart.harness.loop.loop import Loop, ScheduledChanges
from gough_stewart.harness.loop.rows import AllRows, RowMonitor
from gough_stewart.harness.loop.timing import Seeds
from gough_stewart.harness.plants import members, signals
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.plant import BoolArray, Plant, PlantOfOne, seen
from gough_stewart.harness.plants.signals import MOTORS, N_LEGS
from gough_stewart.model.errors import MembersError
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.platform import LARGEST_NUMBER
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

_ROWS_A_REPORT = 64
# Readings of all members in a block in which noise is drawn; the numbers do not depend on it.
_BLOCK = 64
_NO_COEFFICIENTS = NoCoefficients()


class PythonHost:
    """A run of any plant with any controllers."""

    def __init__(self, plant: Plant, law: Law | None, loop: Loop, readings: "SensorReadings") -> None:
        (n,) = plant.shape
        self._plant, self._law, self._loop, self._readings = plant, law, loop, readings
        self._every, self._plant_step = loop.timing.steps_a_sample, loop.timing.plant_step
        start = np.broadcast_to(loop.start_force, (n, N_LEGS)).T.copy()
        # NumPy is twice as fast with arrays of full size as with a number beside them
        values = {key: np.full(start.shape, np.transpose(value)) for key, value in loop.actuators.values.items()}
        self._limits = ForceLimits.without_idle(ForceLimits.prepare(values, loop.timing.sample_time))
        self._drive = Drive.without_idle(Drive.prepare(values, loop.timing.plant_step))
        self._planned = ForceLimits.start(self._limits, (start,))
        self._driven = Drive.start(self._drive, (start,))
        # a line of forces (slots, 6, N), of which each member takes those of its number of samples ago
        delay = np.broadcast_to(np.asarray(loop.actuators.delay), (n,))
        self._delay = int(delay[0]) if delay.min() == delay.max() else delay
        self._delayed = np.tile(start, (int(delay.max()) + 1, 1, 1))
        self._members = slice(None) if isinstance(self._delay, int) else np.arange(n)
        self._target = start
        self._no_flags = np.zeros((N_LEGS, n), dtype=bool).T
        self._no_state = np.zeros((n, 0))
        self._command, self._excess = start.T.copy(), members.zeros((n,), N_LEGS)
        self._takeover = Takeover.prepare({}, loop.timing.sample_time)
        self._transfer = Takeover.start(self._takeover, (start,))
        self._off, self._manual_force = np.zeros(n, dtype=bool), start
        self._force_limited: BoolArray = self._no_flags

    def run(  # noqa: PLR0912, PLR0915 - a row, in the order of what happens
        self, monitor: RowMonitor, changes: ScheduledChanges, progress: TimeProgress | None
    ) -> None:
        """Run row by row to the end or until no member is left; the changes of the first row have been applied."""
        plant, loop, timing, readings = self._plant, self._loop, self._loop.timing, self._readings
        n, every, reading_every, has_faults = timing.steps, self._every, loop.steps_a_reading, loop.has_faults
        sampled = timing.rows_of_samples
        sampled_together = sampled.tolist() if sampled.ndim == 1 else None  # a list, since Python reads it faster
        inputs, forces, cut = changes.inputs, changes.inputs[:, :N_LEGS], changes.faults[:, CUT]
        has_motors, reads_motors = MOTORS in plant.columns, loop.sensors.side == "motor"
        reading = readings.latest
        for row, time in enumerate(timing.times.tolist()):
            if row in changes.by_row:
                if row:
                    changes.apply(row)
                self._off, force = changes.manual[:, 0] > 0, changes.manual[:, N_LEGS:]
                self._manual_force = np.where(np.isnan(force), self._command, force).T
            # what ends and is recorded is where the platform is
            now = plant.signals()
            at_motors = seen(plant, "motor") if has_motors else now
            monitor.check_plant(now, at_motors)
            rate_limited = self._no_flags
            if row < n:
                # with jitter members may be sampled at different rows, but always within the same sample time
                sample, due = row // every, None
                if sampled_together is not None:
                    is_sample = sampled_together[sample] == row
                else:
                    due = sampled[sample] == row
                    is_sample = bool(due.any())
                measured = at_motors if reads_motors else now
                if reading_every and row % reading_every == 0:
                    reading = readings.read(row // reading_every, measured)
                elif is_sample and not reading_every:
                    reading = readings.read(sample, measured, due)
                if is_sample:
                    self._sample(sample, reading, due, monitor)
                    if not monitor.all_go and not (monitor.counting > row).any():
                        # all controllers have failed: this row does not count
                        if self._law is not None and isinstance(plant, PlantOfOne) and not row:
                            raise self._law.failures[0]
                        return
                self._driven, (mean, is_behind) = Drive.step(self._drive, self._driven, (self._target,))
                rate_limited = rate_limited if is_behind is None else is_behind.T
                if monitor.all_go:
                    forces[...] = mean.T
                else:
                    np.copyto(forces, mean.T, where=monitor.going[:, None])
                    rate_limited = rate_limited & monitor.going[:, None]
            if has_faults:
                _, (left,) = Cut.step(_NO_COEFFICIENTS, (), (forces, cut))
                np.copyto(forces, left, where=monitor.going[:, None])
            plant.set_inputs(inputs)
            monitor.add(now, inputs, self._force_limited, rate_limited)
            if progress is not None and row % _ROWS_A_REPORT == 0:
                progress(time)
            if row == n:
                return

            # members that have ended, or that the plant cannot step, stay at their last row
            if monitor.ended_now:
                monitor.ended_now = False
                if not monitor.going.any():
                    return
                plant.freeze(~monitor.going)
            try:
                plant.do_step(time, self._plant_step)
            except MembersError as error:
                for member, failure in error.failures.items():
                    monitor.end_one(member, row + 1, "diverged", str(failure))
                monitor.ended_now = False  # the plant has already frozen them
                if not monitor.going.any():
                    return

    def _sample(  # noqa: PLR0915 - a sample, in the order of what happens
        self, j: int, reading: FloatArray, due: BoolArray | None, monitor: RowMonitor
    ) -> None:
        """Compute and command at sample j, for members that are due (N,), None for all; failures end members."""
        loop, law, state = self._loop, self._law, self._no_state
        due = _those_going(due, monitor)
        off = None if not self._off.any() else self._off if due is None else self._off & due
        command = loop.feedforward[j]
        if loop.injection is not None:
            command = command + loop.injection[j]
        if law is not None and loop.reference is not None:
            # the controller counts nominal samples, regardless of jitter
            row = j * self._every
            state = law.state
            force = law.force(j, row * self._plant_step, loop.reference[row], reading, self._excess, due, off)
            if failures := law.failures:
                failed = np.isin(np.arange(len(monitor.going)), list(failures))
                monitor.end(failed, monitor.n_rows, "stopped", lambda k: str(failures[k]))
                due = _those_going(due, monitor)
            command = command + force
        if loop.has_switch:
            wanted = np.broadcast_to(command, self._command.shape).T
            transfer, (taken,) = Takeover.step(
                self._takeover, self._transfer, (wanted, self._manual_force, self._off.astype(float))
            )
            command = taken.T
            self._transfer = transfer if due is None else (np.where(due, transfer[0], self._transfer[0]),)
        if due is not None:
            # a member's command stays until its next sample; that of an ended member is cleared
            held = np.where(monitor.going[:, None], self._command, 0.0)
            command = np.where(due[:, None], command, held)
        self._command = command = command if command.ndim == 2 else np.broadcast_to(command, self._command.shape)
        sampled = due
        if not members.all_below(command.T, LARGEST_NUMBER):
            beyond = ~(np.abs(command) <= LARGEST_NUMBER).all(axis=1)
            rows = monitor.n_rows + 1  # with this one, before its limits are checked
            monitor.end(beyond, rows, "diverged", lambda k: loop.failure_of_forces(j, command[k]))
            due = _those_going(due, monitor)

        # what of the command is allowed, and what of that reaches the drives now
        planned, (allowed, is_cut, excess) = ForceLimits.step(self._limits, self._planned, (command.T,))
        slots = self._delayed
        slots[j % len(slots)] = allowed  # of members that are not due the last ones, replaced at their own row
        late = slots[(j - self._delay) % len(slots), :, self._members]
        if not isinstance(self._delay, int):
            late = late.T
        if due is None:
            self._target = late
        else:
            # for the others the command is still the last one, and so is what the drives make of it
            self._target = np.where(due, late, self._target)
            planned = tuple(np.where(due, *states) for states in zip(planned, self._planned, strict=True))
            excess = None if excess is None else np.where(due, excess, self._excess.T)
        self._planned = planned
        if excess is not None:
            self._excess = excess.T if off is None else np.where(off, 0.0, excess).T
        limited = self._no_flags if is_cut is None else is_cut.T
        if law is not None and law.limited is not None:
            limited = limited | law.limited
        self._force_limited = limited if monitor.all_go else limited & monitor.going[:, None]
        if isinstance(monitor.rows, AllRows):
            monitor.rows.add_sample(j, sampled, reading, state, command, self._force_limited)


def _those_going(due: BoolArray | None, monitor: RowMonitor) -> BoolArray | None:
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
                drawn = standard_normal(self._streams, range(k, k + self._size), self._noisy)
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


def standard_normal(streams: NDArray[np.int64], readings: range, elements: range) -> FloatArray:
    """White noise (readings, elements, N) of streams (4, N): of consecutive readings, and elements of all signals.

    Standard normal numbers of c/loop/noise.h, each a function of seed, reading and element alone.

    Raises
    ------
    BuildError, OSError
        See `loop_kernel`.
    """
    n = streams.shape[1]
    noise = np.zeros((len(readings), len(elements), n))
    sizes = (n, readings.start, len(readings), elements.start, len(elements))
    loop_kernel(IDEAL).library.loop_noise(
        ctypes.c_void_p(streams.ctypes.data), *map(ctypes.c_int64, sizes), ctypes.c_void_p(noise.ctypes.data)
    )
    return noise

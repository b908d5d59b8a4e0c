"""The sampled loop of many members in machine code: c/loop moves time and values, the components' equations are theirs.

It runs linear controllers and feedforward alone, on platforms that machine code steps. Rows, ends and causes are those
of NumPy's loop, which stays the readable reference, to rounding.
"""

import ctypes
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from threading import Event
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.control.drive import Drive, ForceLimits
from gough_stewart.harness.control.faults import CUT, FROZEN
from gough_stewart.harness.control.laws_of_members import LinearLaw
from gough_stewart.harness.control.sensor import Sensor
from gough_stewart.harness.loop.law_library import CompiledLaw
from gough_stewart.harness.loop.loop import Loop, failure_of_forces
from gough_stewart.harness.loop.loop_library import coefficients_of
from gough_stewart.harness.loop.noise import streams_of
from gough_stewart.harness.loop.rows import AllRows, Rows
from gough_stewart.harness.loop.sensors import deviations_of
from gough_stewart.harness.loop.watch import Watch
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import LanesPlant, lane_rows
from gough_stewart.harness.plants.members import PerMember
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

# Internal steps of eight members between two looks at the world, some 0.05 s: interrupts wait for them.
_WORK = 30_000
# Rows in one call, where all rows are kept.
_ROWS = 1024
# Parts of the members per thread, since some take longer.
_PARTS = 4
# Of `senses`: it reads at the motor's side of a leg that gives.
_AT_MOTOR = 2
_TABLES = ("reference", "feedforward", "injection")


class _Table(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_int64 if k else ctypes.c_void_p) for k, name in enumerate(("at", "row", "element", "member"))
    ]


class _Indices(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int64 if k else ctypes.c_void_p) for k, name in enumerate(("at", "row", "member"))]


class _Out(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int64 if k else ctypes.c_void_p) for k, name in enumerate(("at", "row", "element"))]


MEMORY = (
    *(
        "signals",
        "measured",
        "streams",
        "memory",
        "next",
        "pose",
        "lengths",
        "command",
        "excess",
        "limited",
        "planned",
    ),
    *("delayed", "target", "driven", "acting", "cut", "frozen", "held", "at_row", "ended"),
)
_ROWS_OUT = ("row_signals", "row_results", "row_forces", "row_motors", "row_force_limited", "row_rate_limited")
_SAMPLES_OUT = ("sample_measured", "sample_state", "sample_command", "sample_limited")


class Structure(ctypes.Structure):
    """`loop` of c/loop/loop.h."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("members", "last", "every", "reading_every")),
        ("sampled", _Indices),
        ("plant_step", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("substeps", ctypes.c_int64),
        *((name, _Table) for name in _TABLES),
        *((name, ctypes.c_int64) for name in ("kinds", "size", "n_states")),
        ("law", ctypes.c_void_p),
        ("entries", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("entry_row", "entry_column")),
        ("values", _Table),
        ("used", ctypes.c_void_p),
        ("jacobian", _Table),
        ("inverse", _Table),
        ("senses", ctypes.c_void_p),
        ("n_noisy", ctypes.c_int64),
        ("noisy", ctypes.c_void_p),
        *((name, _Table) for name in ("deviations", "sensors", "limits", "drives", "delay")),
        ("most_delay", ctypes.c_int64),
        *((name, _Table) for name in ("shortest", "longest", "farthest")),
        *((name, ctypes.c_void_p) for name in MEMORY),
        ("first_row", ctypes.c_int64),
        *((name, _Out) for name in (*_ROWS_OUT, *_SAMPLES_OUT)),
        ("takes", ctypes.c_void_p),
    ]


class CompiledLoop:
    """A run of a plant with the machine code of c/loop.

    Parameters
    ----------
    plant
        Steps its members in machine code that has the loop.
    law, reading
        Linear or traced controllers before their first sample, and what they read then (N, 24); None for feedforward
        alone.
    pool, threads
        Threads that help with many members, and their number with the calling one.
    """

    def __init__(
        self,
        plant: LanesPlant,
        law: LinearLaw | CompiledLaw | None,
        loop: Loop,
        watch: Watch,
        reading: FloatArray,
        pool: ThreadPoolExecutor,
        threads: int,
    ) -> None:
        self._plant, self._loop, self._watch, self._law = plant, loop, watch, law
        self._n, self._steps = plant.shape[0], loop.timing.steps
        self._kept: list[Any] = []  # arrays that the structure points to
        self._c = c = Structure()
        timing = loop.timing
        c.members, c.last, c.every = self._n, self._steps, timing.steps_a_sample
        own = loop.sensors.sample_time
        c.reading_every = 0 if own is None else timing.steps_in(own, "the sensors' sample_time")
        c.plant_step, c.tolerance, c.substeps = timing.plant_step, plant.tolerance, plant.substeps or 0
        rows = np.ascontiguousarray(timing.rows_of_samples, np.int64)
        c.sampled = _Indices(self._pointer(rows), rows.strides[0] // 8, int(rows.ndim == 2))
        c.reference = self._table(loop.reference_rows)
        c.feedforward, c.injection = self._table(_by_row(loop.feedforward)), self._table(_by_row(loop.injection))
        blocks = plant.batch.blocks
        self._pool, self._parts = pool, 1 if threads == 1 else min(blocks, _PARTS * threads)
        self._ended = np.full(blocks * WIDTH, -1, np.int64)
        self._at_row = np.zeros(blocks, np.int64)
        c.ended, c.at_row = self._pointer(self._ended), self._pointer(self._at_row)
        self._signals = self._memory("signals", signals.SIZE)
        self._signals[:, : self._n] = plant.signals().T
        self._set_controller(law, reading)
        self._set_sensors(law)
        self._set_actuators()
        self._set_limits()
        self._set_faults(reading)
        self._set_samples(watch.rows)
        self.taker = watch.observer.taker()
        if self.taker is not None:
            self.taker.counting[: self._n] = np.where(watch.outcomes.going, -1, 0)
            c.takes = self.taker.address

    def run(self, row: int, to: int) -> None:
        """Run rows from `row` to before `to`, and give them to the watch with all ends.

        Raises
        ------
        KeyboardInterrupt
            Between two parts of the work; rows that all members have done count.
        """
        batch, rows, c = self._plant.batch, self._watch.rows, self._c
        if self.taker is None:
            self._set_rows(rows, row)
        run = self._plant.loop_run
        assert run is not None  # whoever made this has asked for it
        of, with_, is_interrupted = batch.reference, ctypes.byref(c), Event()

        def advance(vectors: tuple[int, int]) -> None:
            numbers = [ctypes.c_int64(each) for each in (*vectors, to, _WORK)]
            while not is_interrupted.is_set() and not run(of, with_, *numbers):
                pass

        parts = list(pairwise(np.linspace(0, batch.blocks, self._parts + 1).astype(int).tolist()))
        started = [self._pool.submit(advance, part) for part in parts[1:]]
        try:
            advance(parts[0])
            for each in started:
                each.result()
        except BaseException:
            is_interrupted.set()
            wait(started)
            raise
        finally:
            done = int(self._at_row.min())
            self._watch.outcomes.rows = done
            if self.taker is None:
                rows.count += done - row
            else:
                self.taker.rows = done
        self._end_members(done)
        self._watch.has_checked()

    def not_started(self, failures: Mapping[int, Exception]) -> None:
        """Members that the plant cannot step end at the first row."""
        self._failures = dict(failures)
        for k in failures:
            self._plant.batch.failure[k], self._plant.batch.running[k] = Failure.NOT_STARTED, -1

    def finish(self) -> None:
        """Leave the plant at the last row."""
        self._plant.came_to(float(self._loop.timing.times[self._watch.outcomes.rows - 1]), self._signals)

    def _end_members(self, done: int) -> None:
        """The outcomes of members that ended in rows before `done`."""
        batch, watch, plant = self._plant.batch, self._watch, self._plant
        if not batch.failure.any():
            return
        times = self._loop.timing.times
        for k in np.flatnonzero(batch.failure[: self._n]).tolist():
            row, failure = int(self._ended[k]), int(batch.failure[k])
            if not 0 <= row < done:
                continue
            if failure in (Failure.STROKE, Failure.AWAY):
                watch.end_beyond(k, row, self._signals[:, k], stroke=failure == Failure.STROKE)
            elif failure == Failure.COMMAND:
                cause = failure_of_forces(self._loop.injection, row // self._c.every, self._command[:, k])
                watch.outcomes.end_after(k, row + 1, "diverged", cause)
            elif failure == Failure.NOT_STARTED:
                watch.outcomes.end_after(k, row + 1, "diverged", str(self._failures[k]))
            else:
                batch.inputs[:N_LEGS, k] = self._acting[:, k]
                watch.outcomes.end_after(k, row + 1, "diverged", str(plant.failure(k, float(times[row]))))
            batch.failure[k] = Failure.GOES_ON

    def _set_controller(self, law: LinearLaw | CompiledLaw | None, reading: FloatArray) -> None:
        c = self._c
        c.kinds = c.size = c.n_states = c.entries = 0
        measured = self._memory("measured", signals.SIZE)
        self._command = self._memory("command", N_LEGS)
        self._memory("excess", N_LEGS)
        self._memory("limited", N_LEGS)
        self._memory("pose", N_LEGS)
        lengths = self._memory("lengths", N_LEGS)
        if law is None:
            self._memory("memory", 1)
            self._memory("next", N_LEGS)
            return
        measured[:, : self._n] = reading.T
        if isinstance(law, CompiledLaw):
            self._set_traced(law)
            return
        parts = law
        n_states, columns = parts.state.shape[1], parts.matrices.shape[2]
        at = np.argwhere((parts.matrices != 0).any(axis=0))
        entries = [np.ascontiguousarray(at[:, k], np.int64) for k in range(2)]
        c.kinds, c.size, c.n_states, c.entries = parts.kinds, len(parts.positions), n_states, len(at)
        c.entry_row, c.entry_column = map(self._pointer, entries)
        values = np.ascontiguousarray(parts.matrices[:, entries[0], entries[1]].T)
        c.values = self._table(values[None])
        c.used = self._pointer(np.ascontiguousarray(parts.positions, np.int64))
        memory = self._memory("memory", columns)
        memory[:n_states, : self._n] = parts.state.T
        self._memory("next", N_LEGS + n_states)
        if parts.jacobians is not None and parts.inverses is not None:
            lengths[:, : self._n] = parts.lengths
            c.jacobian = self._table(parts.jacobians.reshape(len(parts.jacobians), 36, -1))
            c.inverse = self._table(parts.inverses.reshape(len(parts.inverses), 36, -1))

    def _set_traced(self, compiled: CompiledLaw) -> None:
        """A user's law: see c/law/law.h."""
        c, law = self._c, compiled.law
        k = len(law.coefficients)
        c.kinds, c.size, c.n_states, c.law = 2, signals.SIZE, law.n_states, compiled.address
        c.used = self._pointer(np.arange(signals.SIZE, dtype=np.int64))
        memory = self._memory("memory", law.function.numel_in(0))
        memory[len(memory) - k :, : self._n] = law.coefficients
        self._memory("next", N_LEGS + law.n_states)

    def _set_sensors(self, law: LinearLaw | CompiledLaw | None) -> None:
        c, sensors = self._c, self._loop.sensors
        used = () if law is None else law.used
        noise = deviations_of(sensors, used)
        self._set_noise(noise)
        steps = np.zeros((signals.SIZE, self._n))
        senses = np.zeros(signals.SIZE, np.int64)
        for name in used:
            at, step = signals.positions([name]), sensors.quantisation.get(name, 0.0)
            steps[at] = step
            senses[at] = name in noise or bool(np.any(step))
        is_any = bool(senses.any())
        if sensors.side == "motor" and self._plant.batch.variant.springs:
            senses[signals.LEGS] |= _AT_MOTOR
        c.senses = self._pointer(senses)
        if is_any:
            found = [coefficients_of(Sensor, {"quantisation": step}, np.nan) for step in steps]
            c.sensors = self._table(np.concatenate(found)[None])

    def _set_noise(self, deviations: Mapping[str, PerMember]) -> None:
        c, elements = self._c, [signals.positions([name]) for name in deviations]
        c.n_noisy = len(deviations)
        streams = self._memory("streams", 4).view(np.int64)
        if deviations:
            streams[:, : self._n] = streams_of(self._loop.sensors.seed)
            c.noisy = self._pointer(np.array([(at[0], len(at)) for at in elements], np.int64))
            of_members = [np.broadcast_to(each, (self._n,)) for each in deviations.values()]
            c.deviations = self._table(np.array(of_members, dtype=float)[None])

    def _set_actuators(self) -> None:
        c, actuators, step = self._c, self._loop.actuators, self._loop.timing
        n = self._n
        values = {name: np.broadcast_to(np.asarray(each, float), (n,)) for name, each in actuators.values.items()}
        limits = ForceLimits.prepare(values, step.sample_time)
        forces = np.broadcast_to(self._loop.start_force, (n, N_LEGS)).T
        if np.isfinite(limits.high).any() or np.isfinite(limits.change).any():
            c.limits = self._table(coefficients_of(ForceLimits, values, step.sample_time)[None])
        if np.isfinite(values["rate_limit"]).any() or (values["lag"] > 0).any():
            c.drives = self._table(coefficients_of(Drive, values, step.plant_step)[None])
        delay = np.broadcast_to(np.asarray(actuators.delay, float), (n,))
        c.delay, c.most_delay = self._table(np.array(delay)[None, None]), int(delay.max())
        self._memory("planned", N_LEGS)[:, :n] = forces
        self._memory("target", N_LEGS)[:, :n] = forces
        self._memory("driven", 2 * N_LEGS)[:, :n] = np.tile(forces, (2, 1))
        self._memory("delayed", (c.most_delay + 1) * N_LEGS)[:, :n] = np.tile(forces, (c.most_delay + 1, 1))
        self._acting = self._memory("acting", N_LEGS)
        self._acting[:, :n] = forces

    def _set_limits(self) -> None:
        c, limits = self._c, self._loop.limits
        if limits.on_stroke == "stop":
            c.shortest, c.longest = (self._table(_numbers(each)) for each in limits.stroke)
        if self._loop.reference is not None:  # without a limit, what is not a number ends a run
            c.farthest = self._table(_numbers(limits.largest_position_error))

    def _set_faults(self, reading: FloatArray) -> None:
        self._faults = None
        if self._loop.has_faults:
            self._faults = self._memory("cut", N_LEGS), self._memory("frozen", signals.SIZE)
            self._memory("held", signals.SIZE)[:, : self._n] = reading.T

    def fail(self, faults: FloatArray) -> None:
        """What has failed from now on, by flags (N, N_FAULTS); none of them change nothing."""
        if self._faults is not None and faults.size:
            for memory, part in zip(self._faults, (CUT, FROZEN), strict=True):
                memory[:, : self._n] = faults[:, part].T

    def _set_samples(self, rows: Rows) -> None:
        if not isinstance(rows, AllRows):
            return
        c, law = self._c, self._law
        state = law.state if isinstance(law, LinearLaw) else np.zeros((self._n, 0))
        rows.begin(() if law is None else law.used, state.shape[1])
        c.sample_measured = self._out(rows.measured)
        if state.size:
            c.sample_state = self._out(rows.state)
        c.sample_command, c.sample_limited = self._out(rows.command), self._out(rows.limited)

    def _set_rows(self, rows: Rows, row: int) -> None:
        c = self._c
        c.first_row = row
        at = rows.count + 1
        if isinstance(rows, AllRows):
            c.row_results, c.row_forces = self._out(rows.results[at:]), self._out(rows.inputs[at:])
        else:
            c.row_signals, c.row_forces = self._out(rows.signals[at:]), self._out(rows.forces[at:])
            c.row_force_limited = self._out(rows.force_limited[at:])
            if rows.motors.size:
                c.row_motors = self._out(rows.motors[at:])
        c.row_rate_limited = self._out(rows.rate_limited[at:])

    @property
    def structure(self) -> Structure:
        """What machine code gets."""
        return self._c

    @property
    def arrays(self) -> dict[int, NDArray[Any]]:
        """The arrays that the structure points to, by address."""
        return {each.ctypes.data: each for each in self._kept}

    def _memory(self, name: str, size: int) -> FloatArray:
        """Zeros (size, M) that the loop remembers by this name."""
        array = lane_rows(size, self._plant.batch.blocks)
        setattr(self._c, name, self._pointer(array))
        return array

    def _pointer(self, array: NDArray[Any]) -> int:
        self._kept.append(array)
        return array.ctypes.data

    def _table(self, values: FloatArray | None) -> _Table:
        if values is None:
            return _Table()
        if values.shape[-1] > 1 and values.strides[-1] != values.itemsize:
            values = np.ascontiguousarray(values)
        self._kept.append(values)
        return _table(values)

    def _out(self, values: NDArray[Any]) -> _Out:
        """Rows (n, size, N) that are written."""
        return _Out(values.ctypes.data, *(each // values.itemsize for each in values.strides[:2]))


def _table(values: FloatArray) -> _Table:
    """Numbers (rows, elements, N), or (rows, elements, 1) common to all."""
    row, element, _ = (each // values.itemsize for each in values.strides)
    return _Table(values.ctypes.data, row, element, int(values.shape[-1] > 1))


def _by_row(values: FloatArray | None) -> FloatArray | None:
    """(n, size, N) or (n, size, 1) of (n, N, size) or (n, size)."""
    if values is None:
        return None
    return values[..., None] if values.ndim == 2 else np.moveaxis(values, 1, 2)


def _numbers(values: Any) -> FloatArray:
    """(1, 1, N) or (1, 1, 1)."""
    return np.atleast_1d(np.asarray(values, float))[None, None]


def run_compiled(
    plant: LanesPlant,
    law: LinearLaw | CompiledLaw | None,
    reading: FloatArray,
    loop: Loop,
    watch: Watch,
    acting: FloatArray,
    faults: FloatArray,
    apply: Callable[[int], FloatArray],
    changes: Collection[int],
    progress: TimeProgress | None = None,
    threads: int = 1,
) -> None:
    """Run a loop to its end or until no member is left.

    Parameters
    ----------
    law, reading
        Linear or traced controllers before their first sample, and what they read then (N, 24); None for feedforward
        alone.
    apply
        Applies the changes of a row, if there are any, gives the inputs (N, 12) of then, and changes the faults
        (N, N_FAULTS).
    changes
        Rows that have changes; those of the first one have been applied, to these inputs and faults.
    threads
        Their number at the most; results do not depend on it.
    """
    outcomes, rows, steps = watch.outcomes, watch.rows, loop.timing.steps
    rows.host = f"compiled, {plant.features}"
    with ThreadPoolExecutor(threads) as pool:
        own = CompiledLoop(plant, law, loop, watch, reading, pool, threads)
        plant.set_inputs(acting)
        own.fail(faults)
        plant.freeze(~outcomes.going)
        own.not_started(plant.begin())
        stops = sorted({*changes, steps + 1} - {0})
        row = 0
        while row <= steps and outcomes.going.any():
            if row and row in changes:
                plant.set_inputs(apply(row))
                own.fail(faults)
            room = _ROWS if isinstance(rows, AllRows) else rows.most - rows.count
            room = room if own.taker is None else steps + 1
            to = min(row + room, next(stop for stop in stops if stop > row))
            own.run(row, to)
            row = to
            if rows.count == rows.most:
                watch.pass_on()
            if progress is not None:
                progress(float(loop.timing.times[to - 1]))
        own.finish()

"""The host of the sampled loop: c/loop moves time and values, the components' equations are theirs.

Of platforms that machine code steps, under linear controllers, traced laws or feedforward alone, it runs all rows. For
what calls back into Python, functions of users, FMUs and any plant, Python steps the plant between two calls of it.
"""

import ctypes
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from itertools import pairwise
from threading import Event
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from gough_stewart.fmu_build.libraries import WIDTH
from gough_stewart.fmu_build.plant.layout import MemberFailure as Failure
from gough_stewart.harness.control.component import CUT, FROZEN, Drive, ForceLimits, Sensor, Takeover
from gough_stewart.harness.control.laws_of_members import Law, LinearLaw, SeparateLaws, rests_of
from gough_stewart.harness.control.state_space import stacked_blocks
from gough_stewart.harness.loop.folds import AT
from gough_stewart.harness.loop.libraries import CompiledLaw, coefficients_of, loop_kernel
from gough_stewart.harness.loop.loop import (
    Actuators,
    Loop,
    LoopSettings,
    ScheduledChanges,
    Seeds,
    Sensors,
    members_last,
)
from gough_stewart.harness.loop.rows import AllRows, RowMonitor, Status
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.lanes import BatchPlant, LaneArrays, lane_rows
from gough_stewart.harness.plants.plant import Plant, PlantOfOne, seen
from gough_stewart.harness.plants.signals import N_LEGS, PerMember
from gough_stewart.model.errors import MembersError, StepError
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.process.progress import TimeProgress
from gough_stewart.model.vectors import FloatArray

# Internal steps of eight members between two looks at the world, some 0.05 s: interrupts wait for them.
_WORK = 30_000
# Rows in one call, where all rows are kept; and between two reports of progress, where Python steps the plant.
_ROWS, _ROWS_A_REPORT = 1024, 64
# Parts of the members per thread, since some take longer.
_PARTS = 4
# Nearer to 1 a pole integrates.
_INTEGRATES = 1e-6
# Of `kinds`: a controller elsewhere, see c/loop/loop.h.
_ASKED = 4
# Of `senses`: whether a sensor does anything, and whether it reads at the motor's side of an elastic leg.
_SENSES, _AT_MOTOR = 1, 2


class _Table(ctypes.Structure):
    """`table` of c/loop/loop.h, as the structures below."""

    _fields_ = [("at", ctypes.c_void_p), *((name, ctypes.c_int64) for name in ("row", "element", "member"))]


class _Indices(ctypes.Structure):
    _fields_ = [("at", ctypes.c_void_p), ("row", ctypes.c_int64), ("member", ctypes.c_int64)]


class _Out(ctypes.Structure):
    _fields_ = [("at", ctypes.c_void_p), ("row", ctypes.c_int64), ("element", ctypes.c_int64)]


# Arrays that the loop remembers.
MEMORY = (
    *("signals", "measured", "streams", "memory", "next", "pose", "lengths", "command", "excess", "limited"),
    *("planned", "delayed", "target", "driven", "acting", "cut", "frozen", "held", "at_row", "ended"),
    *("off", "manual_force", "transfer"),
)
_ROWS_OUT = ("row_signals", "row_results", "row_forces", "row_motors", "row_force_limited", "row_rate_limited")
_SAMPLES_OUT = ("sample_measured", "sample_state", "sample_command", "sample_limited")


class LoopBlock(ctypes.Structure):
    """`loop` of c/loop/loop.h."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("members", "last", "every", "reading_every")),
        ("sampled", _Indices),
        ("plant_step", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("substeps", ctypes.c_int64),
        *((name, _Table) for name in ("reference", "feedforward", "injection")),
        *((name, ctypes.c_int64) for name in ("kinds", "size", "n_states")),
        ("law", ctypes.c_void_p),
        ("entries", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("entry_row", "entry_column")),
        ("values", _Table),
        ("rest_entries", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("rest_row", "rest_column")),
        ("rests", _Table),
        ("used", ctypes.c_void_p),
        ("jacobian", _Table),
        ("inverse", _Table),
        ("senses", ctypes.c_void_p),
        ("n_noisy", ctypes.c_int64),
        ("noisy", ctypes.c_void_p),
        *((name, _Table) for name in ("deviations", "sensors", "limits", "drives", "takeover", "delay")),
        ("most_delay", ctypes.c_int64),
        *((name, _Table) for name in ("shortest", "longest", "farthest")),
        *((name, ctypes.c_void_p) for name in MEMORY),
        ("first_row", ctypes.c_int64),
        *((name, _Out) for name in (*_ROWS_OUT, *_SAMPLES_OUT)),
        ("takes", ctypes.c_void_p),
    ]


class LoopHost:
    """The loop around a plant of N members: machine code moves time and values, and knows what components do.

    It has the start of the run, and reads the sensors for the first time; then `control` gives it the controllers. Rows
    run in machine code if plant and controllers do. Else Python steps the plant row by row, and calls controllers that
    are functions, between the readings and the rest of a row.
    """

    def __init__(self, plant: Plant, loop: Loop) -> None:
        self._plant, self._loop = plant, loop
        self._law: Law | CompiledLaw | None = None
        self._used: Sequence[str] = ()
        self._noisy = dict[str, slice]()
        self._lanes = plant if isinstance(plant, BatchPlant) and plant.loop_library is not None else None
        (n,), timing, sensors = plant.shape, loop.timing, loop.sensors
        self.batch = LaneArrays(n) if self._lanes is None else self._lanes.batch
        self._library: Any = loop_kernel(IDEAL).library if self._lanes is None else self._lanes.loop_library
        if self._lanes is None:
            self.batch.running[:n] = -1
        self.memory: dict[str, NDArray[Any]] = {}  # (size, M) by name, see `MEMORY`
        # there is room for all settings of the loop
        self._turned = [change.settings for change in loop.changes if change.settings is not None]
        self.arrays: dict[int, NDArray[Any]] = {}  # that the structure points to, by address
        c = self.structure = LoopBlock(
            members=n,
            last=timing.steps,
            every=timing.steps_a_sample,
            reading_every=loop.steps_a_reading,
            plant_step=timing.plant_step,
            tolerance=0.0 if self._lanes is None else self._lanes.tolerance,
            substeps=0 if self._lanes is None else self._lanes.substeps or 0,
            reference=self._table(members_last(loop.reference)),
            feedforward=self._table(members_last(loop.feedforward)),
            injection=self._table(members_last(loop.injection)),
        )
        # readings, and the rest of a row
        self.read, self.act = (
            partial(function, self.batch.reference, ctypes.byref(c))
            for function in (self._library.loop_read, self._library.loop_act)
        )
        sampled = timing.rows_of_samples.astype(np.int64, order="C")  # a copy, since environments write to it
        c.sampled = _Indices(self._address(sampled), sampled.strides[0] // 8, int(sampled.ndim == 2))

        # actuators
        tables, every_path = self._tables_of(sensors, loop.actuators), [loop.actuators]
        every_path += [settings.actuators for settings in self._turned]
        largest = [path.values["force_limit"] for path in every_path] + [loop.actuators.values["rate_limit"]]
        if np.isfinite(np.concatenate([np.ravel(limit) for limit in largest])).any():
            c.limits = self._table(tables["limits"])
        if np.isfinite(loop.actuators.values["rate_limit"]).any() or np.any(np.asarray(loop.actuators.lag) > 0):
            c.drives = self._table(tables["drives"])
        c.takeover = self._table(coefficients_of(Takeover, {}, timing.sample_time))
        c.delay = self._table(tables["delay"])
        c.most_delay = max(int(np.max(path.delay)) for path in every_path)
        forces = np.broadcast_to(loop.start_force, (n, N_LEGS)).T

        # ends of runs; without a limit, what is not a number is too far from the reference
        if loop.limits.on_stroke == "stop":
            ends = (np.ascontiguousarray(signals.of_legs(end)) for end in loop.limits.stroke)
            c.shortest, c.longest = map(self._table, ends)
        if loop.reference is not None:
            c.farthest = self._table(np.atleast_1d(np.asarray(loop.limits.largest_position_error, float))[None])

        # the first readings, of all signals; a sensor that is frozen from the start has its first one
        blocks, slots = self.batch.blocks, c.most_delay + 1
        for name, size in (("signals", signals.SIZE), ("measured", signals.SIZE), ("streams", 4), ("memory", 1)):
            self._remember(name, size)
        for name in ("pose", "lengths", "excess", "limited"):
            self._remember(name, N_LEGS)
        for name in ("command", "planned", "target", "acting"):
            self._remember(name, N_LEGS, forces)
        self._remember("driven", 2 * N_LEGS, np.tile(forces, (2, 1)))
        self._remember("delayed", slots * N_LEGS, np.tile(forces, (slots, 1)))
        self.memory["at_row"], self.memory["ended"] = np.zeros(blocks, np.int64), np.full(blocks * WIDTH, -1, np.int64)
        c.at_row, c.ended = self._address(self.memory["at_row"]), self._address(self.memory["ended"])
        self.memory["signals"][:, :n] = seen(plant, sensors.side).T
        self.reading = self.memory["measured"][:, :n].T  # the latest one (N, 24)
        self.sense(signals.NAMES)
        self.read(0)
        self.memory["signals"][:, :n] = plant.signals().T
        if loop.has_faults:
            for name, size in (("cut", N_LEGS), ("frozen", signals.SIZE)):
                self._remember(name, size)
            self._remember("held", signals.SIZE, self.reading.T)
        for name in ("off", "manual_force", "transfer") if loop.has_switch else ():
            self._remember(name, N_LEGS)

    def control(self, law: Law | CompiledLaw | None) -> None:
        """Give it the controllers, which have not been sampled yet; without them, None, there is feedforward alone."""
        c, n = self.structure, self._plant.shape[0]
        self._law, c.kinds = law, 0 if law is None else _ASKED
        if isinstance(law, CompiledLaw):
            traced = law.law
            memory = self._remember("memory", traced.function.numel_in(0))
            memory[len(memory) - len(traced.coefficients) :, :n] = traced.coefficients
            address = ctypes.cast(law.library.law_step, ctypes.c_void_p).value or 0  # see c/law/law.c
            c.law, c.kinds, c.n_states = address, 2, traced.n_states
        elif isinstance(law, LinearLaw):
            c.kinds, c.n_states = law.kinds, len(law.state)
            self._remember("memory", law.matrices.shape[2])[: c.n_states, :n] = law.state
            # the elements of [C D; A B]
            laws = [*law.matrices, *(stacked_blocks(s.system) for s in self._turned if s.system is not None)]
            entry_row, entry_column = self.entries = np.argwhere(np.any([M != 0 for M in laws], axis=0)).T
            c.entries = len(entry_row)
            c.entry_row, c.entry_column = self._address(entry_row, np.int64), self._address(entry_column, np.int64)
            c.values = self._table(np.ascontiguousarray(law.matrices[:, entry_row, entry_column].T))
            if self._loop.has_switch:
                rest_row, rest_column = self.rest_entries = np.indices(law.rests.shape[1:]).reshape(2, -1)
                c.rest_entries = len(rest_row)
                c.rest_row = self._address(rest_row, np.int64)
                c.rest_column = self._address(rest_column + c.n_states, np.int64)
                c.rests = self._table(np.ascontiguousarray(law.rests[:, rest_row, rest_column].T))
            if law.jacobians is not None and law.inverses is not None:
                self.memory["lengths"][:, :n] = law.lengths
                m = len(law.jacobians)
                c.jacobian = self._table(law.jacobians.reshape(m, 36, -1))
                c.inverse = self._table(law.inverses.reshape(m, 36, -1))
        self.sense(() if law is None else law.used)
        self._remember("next", N_LEGS + c.n_states)

    def sense(self, used: Sequence[str]) -> None:
        """Read these signals."""
        c, n, sensors = self.structure, self._plant.shape[0], self._loop.sensors
        every = [sensors, *(settings.sensors for settings in self._turned)]
        deviations = np.max([by_element(sensors.noise, used, n) for sensors in every], axis=0)
        steps = np.max([by_element(sensors.quantisation, used, n) for sensors in every], axis=0)
        positions = signals.positions(used) if used else np.zeros(0)
        c.size, c.used, self._used = len(positions), self._address(positions, np.int64), used
        noisy = self._noisy = {name: at for name in used if (deviations[at := AT[name]] > 0).any()}
        senses = np.where((deviations > 0).any(axis=1) | (steps != 0).any(axis=1), _SENSES, 0)
        tables = self._tables_of(sensors, self._loop.actuators)
        c.sensors, c.deviations = _Table(), _Table()
        if senses.any():
            c.sensors = self._table(tables["sensors"])
        if sensors.side == "motor" and self.batch.variant.springs:
            senses[signals.LEGS] |= _AT_MOTOR
        if noisy:
            self.memory["streams"].view(np.int64)[:, :n] = streams_of(sensors.seed)
            c.noisy = self._address(np.array([(at.start, at.stop - at.start) for at in noisy.values()]), np.int64)
            c.deviations = self._table(tables["deviations"])
        c.senses, c.n_noisy = self._address(senses, np.int64), len(noisy)

    def _remember(self, name: str, size: int, start: FloatArray | float = 0.0) -> FloatArray:
        """Memory (size, M) that begins with these values (size, N)."""
        memory = self.memory[name] = lane_rows(size, self.batch.blocks)
        memory[:, : self._plant.shape[0]] = start
        setattr(self.structure, name, self._address(memory))
        return memory

    def _address(self, values: NDArray[Any], kind: type | None = None) -> int:
        """The address of an array as it is, or of its numbers as those of a kind; 0 if there are none."""
        array = values if kind is None else np.ascontiguousarray(values, kind)
        if array.size:
            self.arrays[array.ctypes.data] = array
        return array.ctypes.data if array.size else 0

    def _table(self, values: FloatArray | None) -> _Table:
        """Numbers (elements, N) in one row, or (rows, elements, N); (…, 1) common to all members."""
        if values is None:
            return _Table()
        values = values[None] if values.ndim == 2 else values
        if values.shape[-1] > 1 and values.strides[-1] != values.itemsize:
            values = np.ascontiguousarray(values)
        row, element, _ = (stride // values.itemsize for stride in values.strides)
        return _Table(self._address(values), row, element, int(values.shape[-1] > 1))

    def follow(self, faults: FloatArray, manual: FloatArray) -> None:
        """What has failed from now on, by flags (N, N_FAULTS), and which controllers are off from the next sample on.

        Of the latter also the forces (N, 12), see `ChangeChoice.manual`; (N, 0) change nothing.
        """
        n, memory = len(faults), self.memory
        if self._loop.has_faults and faults.size:
            memory["cut"][:, :n], memory["frozen"][:, :n] = faults[:, CUT].T, faults[:, FROZEN].T
        if self._loop.has_switch and manual.size:
            force = manual[:, N_LEGS:].T
            memory["off"][:, :n] = manual[:, :N_LEGS].T
            memory["manual_force"][:, :n] = np.where(np.isnan(force), memory["command"][:, :n], force)

    def _tables_of(self, sensors: Sensors, actuators: Actuators) -> dict[str, FloatArray]:
        """Coefficients of what measures and what acts, (size, N)."""
        (n,), timing = self._plant.shape, self._loop.timing
        steps, deviations = (by_element(sizes, self._used, n) for sizes in (sensors.quantisation, sensors.noise))
        values = {key: np.full(n, value, float) for key, value in actuators.values.items() if key != "force_limit"}
        by_leg = signals.of_legs(actuators.values["force_limit"])
        values["force_limit"] = np.broadcast_to(by_leg, (N_LEGS, n))
        by_signal = coefficients_of(Sensor, {"quantisation": steps}, np.nan)  # (size, 24, N)
        return {
            "sensors": by_signal.swapaxes(0, 1).reshape(-1, n),
            "deviations": np.array([deviations[at.start] for at in self._noisy.values()]),
            "limits": coefficients_of(ForceLimits, values, timing.sample_time),
            "drives": coefficients_of(Drive, values, timing.plant_step),
            "delay": np.full((1, n), actuators.delay, float),
        }

    def turn(self, settings: LoopSettings) -> None:
        """Other settings of the loop of one member from the next sample on.

        Each filter of a derivative, a state of the first order that is fed by inputs alone, goes on with the force that
        it gave: x = r' + c/c' (x − r) about its rest r.
        """
        c, tables = self.structure, self._tables_of(settings.sensors, settings.actuators)
        if isinstance(self._law, LinearLaw) and settings.system is not None:
            new, memory = stacked_blocks(settings.system), self.memory["memory"][:, 0]
            old = np.zeros_like(new)
            old[*self.entries] = self.arrays[c.values.at][0, :, 0]
            tables["values"] = new[*self.entries][:, None]
            if self._loop.has_switch:
                tables["rests"] = rests_of([settings.system], c.kinds)[0][*self.rest_entries][:, None]
            n = c.n_states
            A = old[N_LEGS:, :n]
            for state in range(n):
                integrates = abs(1 - A[state, state]) <= _INTEGRATES
                if integrates or np.delete(A[state], state).any() or not old[:N_LEGS, state].any():
                    continue
                rests = [float(M[N_LEGS + state, n:] @ memory[n:] / (1 - M[N_LEGS + state, state])) for M in (old, new)]
                output = int(np.abs(old[:N_LEGS, state]).argmax())
                memory[state] = rests[1] + old[output, state] / new[output, state] * (memory[state] - rests[0])
        for name, table in tables.items():
            at = getattr(c, name).at
            if at:
                self.arrays[at].reshape(table.shape)[...] = table

    def run(
        self, monitor: RowMonitor, changes: ScheduledChanges, progress: TimeProgress | None = None, threads: int = 1
    ) -> None:
        """Run the loop to its end or until no member is left; the changes of the first row have been applied.

        In machine code, an interrupt comes between two parts of the work; rows that all members have done count.
        """
        c, rows = self.structure, monitor.rows
        self.follow(changes.faults, changes.manual)
        # rows are written from the second place of their arrays on
        if isinstance(rows, AllRows):
            c.sample_measured, c.sample_command = _out(rows.measured), _out(rows.command)
            c.sample_state, c.sample_limited = _out(rows.state), _out(rows.limited)
        else:
            c.row_signals, c.row_forces = _out(rows.signals[1:]), _out(rows.forces[1:])
            c.row_force_limited, c.row_motors = _out(rows.force_limited[1:]), _out(rows.motors[1:])
        c.row_rate_limited = _out(rows.rate_limited[1:])
        if self._lanes is None or isinstance(self._law, SeparateLaws):
            self._run_in_python(monitor, changes, progress)
        else:
            self._run_compiled(self._lanes, monitor, changes, progress, threads)

    def _run_in_python(  # noqa: PLR0912, PLR0915 - a row, in the order of what happens
        self, monitor: RowMonitor, changes: ScheduledChanges, progress: TimeProgress | None
    ) -> None:
        """Step the plant row by row, and call functions."""
        plant, loop, c, rows, going = self._plant, self._loop, self.structure, monitor.rows, monitor.going
        law = self._law if isinstance(self._law, SeparateLaws) else None
        (n,), timing, sampled, every = plant.shape, loop.timing, loop.timing.rows_of_samples, c.every
        signals_now, measured, acting = (self.memory[name][:, :n] for name in ("signals", "measured", "acting"))
        command, excess, following = (self.memory[name][:, :n] for name in ("command", "excess", "next"))
        has_motors, reads_motors = signals.MOTORS in plant.columns, loop.sensors.side == "motor"
        inputs = changes.inputs

        for row, time in enumerate(timing.times.tolist()):
            if row and row in changes.by_row:
                self._change(row, changes)
            # what ends and is recorded is where the platform is
            now = plant.signals()
            at_motors = seen(plant, "motor") if has_motors else now
            monitor.check_plant(now, at_motors)
            self.batch.running[:n][~going] = 0
            is_sample = False
            if row < c.last:
                # with jitter members may be sampled at different rows, but always within the same sample time
                j = row // every
                due = going & (sampled[j] == row)
                is_sample = bool(due.any())
                signals_now[...] = (at_motors if reads_motors else now).T
                self.read(row)
                reference = None if loop.reference is None else loop.reference[j * every]
                if law is not None and reference is not None and is_sample:
                    off = due & (self.memory["off"][0, :n] > 0) if loop.has_switch else None
                    time_of_sample = j * every * timing.plant_step
                    following[:N_LEGS] = law.force(j, time_of_sample, reference, measured.T, excess.T, due, off).T
                    for member, error in law.failures.items():
                        monitor.end(member, monitor.n_rows, "stopped", str(error))
                    if not (monitor.counting > row).any():  # all controllers have failed: this row does not count
                        if isinstance(plant, PlantOfOne) and not row:
                            raise law.failures[0]
                        return
            c.first_row, signals_now[...] = rows.first, now.T
            self.act(row)
            if law is not None and is_sample:
                if loop.has_switch:
                    law.hear(command.T)
                if law.limited is not None and isinstance(rows, AllRows):
                    rows.limited[j] |= law.limited.T

            # the row, and the step of the plant from there
            inputs[:, :N_LEGS] = acting.T
            plant.set_inputs(inputs)
            rows.add(inputs)
            monitor.n_rows += 1
            self._end_members(monitor)
            if rows.count == rows.most:
                monitor.pass_on()
            if progress is not None and row % _ROWS_A_REPORT == 0:
                progress(time)
            if row == c.last or not going.any():
                return
            if not going.all():
                plant.freeze(~going)
            try:
                plant.do_step(time, timing.plant_step)
            except MembersError as error:
                for member, failure in error.failures.items():
                    monitor.end(member, row + 1, "diverged", str(failure))
                if not going.any():
                    return

    def _run_compiled(  # noqa: PLR0915 - from the first row to the last
        self,
        plant: BatchPlant,
        monitor: RowMonitor,
        changes: ScheduledChanges,
        progress: TimeProgress | None,
        threads: int,
    ) -> None:
        batch, rows, c = self.batch, monitor.rows, self.structure
        times, loop_run = self._loop.timing.times, self._library.loop_run
        rows.host = f"compiled, {plant.features}"
        sink = monitor.observer.sink()
        if sink is not None:
            sink.counting[: len(monitor.going)] = np.where(monitor.going, -1, 0)
            c.takes = sink.address
        if isinstance(rows, AllRows):
            c.row_results, c.row_forces = _out(rows.results[1:]), _out(rows.inputs[1:])
        plant.set_inputs(changes.inputs)
        plant.freeze(~monitor.going)
        not_started = plant.begin()
        for member in not_started:  # they end at the first row
            batch.failure[member], batch.running[member] = Failure.NOT_STARTED, -1
        parts = 1 if threads == 1 else min(batch.blocks, _PARTS * threads)
        ends_of_parts = np.linspace(0, batch.blocks, parts + 1).astype(int).tolist()
        stops = sorted({*changes.by_row, len(times)} - {0})
        row, is_interrupted = 0, Event()

        def advance(vectors: tuple[int, int], to: int) -> None:
            """Run the members of some vectors up to a row."""
            numbers = [ctypes.c_int64(number) for number in (*vectors, to, _WORK)]
            while not is_interrupted.is_set() and not loop_run(batch.reference, ctypes.byref(c), *numbers):
                pass

        with ThreadPoolExecutor(threads) as pool:
            while row < len(times) and monitor.going.any():
                if row and row in changes.by_row:
                    self._change(row, changes)
                    plant.set_inputs(changes.inputs)
                room = _ROWS if isinstance(rows, AllRows) else rows.most - rows.count
                room = room if sink is None else len(times)
                to = min(row + room, next(stop for stop in stops if stop > row))
                c.first_row = rows.first
                started: list[Future[None]] = []
                try:
                    # the first part of the vectors in this thread, others in threads of their own
                    first, *others = pairwise(ends_of_parts)
                    started = [pool.submit(advance, part, to) for part in others]
                    advance(first, to)
                    for part in started:
                        part.result()
                except BaseException:
                    is_interrupted.set()
                    wait(started)
                    raise
                finally:
                    monitor.n_rows = done = int(self.memory["at_row"].min())
                    if sink is None:
                        rows.count += done - row
                    else:
                        sink.rows = done
                    self._end_members(monitor, not_started)
                row = to
                if rows.count == rows.most:
                    monitor.pass_on()
                if progress is not None:
                    progress(float(times[to - 1]))
        plant.came_to(float(times[monitor.n_rows - 1]), self.memory["signals"])

    def _change(self, row: int, changes: ScheduledChanges) -> None:
        changes.apply(row)
        self.follow(changes.faults, changes.manual)
        for change in changes.by_row[row]:
            if change.settings is not None:
                self.turn(change.settings)

    def _end_members(self, monitor: RowMonitor, not_started: Mapping[int, StepError] = MappingProxyType({})) -> None:
        """End the members that machine code has ended in the rows so far, and say why."""
        memory, batch = self.memory, self.batch
        for k in np.flatnonzero(batch.failure[: len(monitor.going)]).tolist():
            ended, failure = int(memory["ended"][k]), int(batch.failure[k])
            if not 0 <= ended < monitor.n_rows:
                continue
            status: Status = "stopped" if failure == Failure.STROKE else "diverged"
            now = memory["signals"][:, k]
            if failure == Failure.STROKE:
                cause = monitor.beyond_stroke(now)
            elif failure == Failure.AWAY:
                cause = monitor.too_far(k, ended, now)
            elif failure == Failure.COMMAND:
                sample = ended // self._loop.timing.steps_a_sample
                cause = self._loop.failure_of_forces(sample, memory["command"][:, k])
            elif k in not_started:
                cause = str(not_started[k])
            else:
                assert self._lanes is not None  # other plants raise their errors
                batch.inputs[:N_LEGS, k] = memory["acting"][:, k]
                cause = str(self._lanes.failure(k, float(self._loop.timing.times[ended])))
            monitor.end(k, ended + 1, status, cause)
            batch.failure[k] = Failure.GOES_ON


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


def _out(values: NDArray[Any]) -> _Out:
    """Rows (n, size, N) that are written; nothing of a size of 0."""
    if not values.size:
        return _Out()
    return _Out(values.ctypes.data, *(stride // values.itemsize for stride in values.strides[:2]))

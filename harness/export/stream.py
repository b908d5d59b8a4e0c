"""The loop of an experiment in real time, by the C of c/machine: rows out and pose references in, over UDP.

1. The clock paces rows: the n-th of a rate is sent n periods after the start, with the loop as far as that time.
2. An address is sent rows while it is heard: 10 s after each of its datagrams, an empty one included; eight at most.
3. A datagram in the stream's format is where a sender wants the platform. The motion goes there through the filter with
   limits of a hand (`by_hand`). Another one is counted and ignored.
4. A sender that falls silent leaves the last pose that it asked for, or ends the stream.
"""

import ctypes
import json
import math
import socket
import struct
import time
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.cache import COMPILER, check_installed
from gough_stewart.fmu_build.libraries import machine_library
from gough_stewart.fmu_build.toolchain import native
from gough_stewart.harness.control.by_hand import lengths_for_hands
from gough_stewart.harness.errors import ExportError
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.export.machine import FAILURES, Block, endless_machine, fields, planned_motion
from gough_stewart.harness.export.machine_c import machine_c
from gough_stewart.harness.plants import signals
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.process.installed import TRACER

Format = Literal["json", "binary"]
Address = tuple[Any, ...]
LARGEST_RATE = 250.0  # [Hz]
# Out: time [s], pose [m, rad], lengths [m], reference pose [m, rad]. In: a pose. Little-endian doubles.
ROW, REFERENCE = struct.Struct("<19d"), struct.Struct("<6d")
_ROW_KEYS = {"pose": slice(1, 7), "leg_length": slice(7, 13), "reference": slice(13, 19)}
# Of a datagram [bytes], and how many a period takes; the rest waits.
_LARGEST, _MOST = 512, 64
_LISTENERS, _HEARD_FOR = 8, 10.0  # [s]
_REFERENCE_SIZE = 30  # of a row of the plan
# A clock that is further behind than this leaves the time out [s].
_SKIPPED = 1.0
_BIN, _BINS = 5e-5, 20_000  # of the histogram of lateness [s]


class NativeMachine:
    """An open block, and the functions of c/machine as a library of this computer.

    Raises
    ------
    BuildError
        The compiler is missing or fails.
    """

    def __init__(self, block: Block) -> None:
        check_installed(TRACER, COMPILER)
        self._c = ctypes.CDLL(str(machine_library(machine_c(block.law, block.variant), native()).kept(native())))
        self._c.machine_field.restype = ctypes.c_void_p
        for name in ("open", "run", "ended", "failure"):
            getattr(self._c, f"machine_{name}").restype = ctypes.c_int64
        self._words = block.words.copy()
        self.row = 0  # the next one
        self("open", len(self._words))

    def __call__(self, name: str, *numbers: int) -> int:
        """The result of a function."""
        function = getattr(self._c, f"machine_{name}")
        return int(function(ctypes.c_void_p(self._words.ctypes.data), *map(ctypes.c_int64, numbers)) or 0)

    def array(self, name: str, size: int) -> NDArray[np.float64]:
        """What a field holds, as a view."""
        place = ctypes.cast(self("field", fields()[name]), ctypes.POINTER(ctypes.c_double))
        return np.ctypeslib.as_array(place, (size,))

    def run(self, end: int) -> int:
        """Run rows to before `end`; the number of those that the last call computed."""
        computed = 0
        while self.row < end:
            following = self("run", end)
            if following == self.row:
                break
            computed, self.row = following - self.row, following
        return computed


@dataclass
class Tally:
    """What a stream did."""

    time: float = 0.0  # simulated [s]
    rows: int = 0  # sent
    packets: int = 0  # received, of all kinds
    malformed: int = 0
    out_of_reach: int = 0  # references that no pose within the stroke has
    late: int = 0  # rows sent more than half a period after their time
    losses: int = 0  # of the sender
    unsent: int = 0  # rows that the network refused
    skipped: float = 0.0  # time that the clock left out [s]
    ended: str = ""  # by itself: why
    lateness: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_BINS, np.int64))

    def quantile(self, share: float) -> float:
        """Of the rows' lateness, an upper bound [s]."""
        below = np.cumsum(self.lateness)
        return _BIN * float(np.searchsorted(below, share * below[-1]) + 1)

    def verdict(self) -> str:
        """The counts in a sentence."""
        words = (
            f"{self.time:.1f} s simulated: {self.rows} rows out, {self.packets} packets in, {self.malformed} "
            f"malformed, {self.out_of_reach} out of reach, {self.late} late rows (99 % within "
            f"{1e3 * self.quantile(0.99):.2f} ms), {self.losses} losses of the sender"
        )
        words += f", {self.unsent} rows not sent" if self.unsent else ""
        return words + (f", {self.skipped:.1f} s left out by a clock that was late" if self.skipped else "")


class Stream:
    """An experiment's loop behind a socket.

    Parameters
    ----------
    address
        Host and port to listen on; port 0 is any that is free.
    rate
        Of rows [Hz].
    form
        Of datagrams, both ways.
    stop_without_sender
        End when no reference has come for `silence` [s], instead of holding the last.

    Raises
    ------
    ExportError
        A rate out of bounds, a loop that c/machine lacks, or one that follows no reference.
    OSError
        The address cannot be listened on.
    """

    def __init__(
        self,
        experiment: Experiment,
        address: tuple[str, int],
        rate: float = 100.0,
        form: Format = "json",
        silence: float = 1.0,
        stop_without_sender: bool = False,
    ) -> None:
        block, prepared, _ = endless_machine(experiment, 512, "a stream")
        timing = prepared.loop.timing
        fastest = min(LARGEST_RATE, 1 / timing.plant_step)
        if not 1 <= rate <= fastest:
            raise ExportError(f"a stream of {rate:g} rows a second; expected 1 to {fastest:g}")
        if not 0 < silence < math.inf:
            raise ExportError(f"a sender that is lost after {silence:g} s; expected a time above 0")
        if prepared.reference is None or planned_motion(prepared.reference) is None:
            raise ExportError(
                f"{experiment.where}: its loop follows no reference that a sender could take over; expected a "
                "controller with a reference, and none of the type excitation"
            )
        self._platform, self._lengths = prepared.platform, lengths_for_hands(prepared.platform)
        self._home = np.concatenate([prepared.platform.home_position, prepared.platform.home_orientation])
        self._step, self._every, self._period = timing.plant_step, timing.steps_a_sample, 1 / rate
        self._form, self._silence, self._stops = form, silence, stop_without_sender
        self._machine = NativeMachine(block)
        self._rows = self._machine.array("row_signals", 512 * signals.SIZE).reshape(-1, signals.SIZE)
        planned = self._machine.array("plan_reference", (512 + self._every) * _REFERENCE_SIZE)
        self._planned = planned.reshape(-1, _REFERENCE_SIZE)
        self._target = self._machine.array("plan_target", 6)
        self._listeners = dict[Address, float]()
        self._is_taken = False
        self._asked_at = math.inf  # when the sender's last reference came; infinite: there is none
        self.tally = Tally()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except (OSError, OverflowError):
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]

    def run(self, duration: float = math.inf) -> Tally:
        """Serve for a time [s] of the clock, until the loop ends, or Ctrl-C; then the socket is closed."""
        tally, start, period = self.tally, time.monotonic(), 0
        try:
            while not tally.ended and (period + 0.5) * self._period < duration:
                period += 1
                due = start + period * self._period
                time.sleep(max(0.0, due - time.monotonic()))
                if (behind := time.monotonic() - due) > _SKIPPED:
                    tally.skipped += behind
                    start, due = start + behind, due + behind
                self._receive(time.monotonic())
                self._send(self._row_at(round(period * self._period / self._step)), time.monotonic())
                lateness = time.monotonic() - due
                tally.late += lateness > self._period / 2
                tally.lateness[min(int(lateness / _BIN), _BINS - 1)] += 1
        except KeyboardInterrupt:  # the usual end
            pass
        finally:
            self._socket.close()
        return tally

    def _receive(self, now: float) -> None:
        """Take what has come; the last reference holds."""
        for _ in range(_MOST):
            try:
                datagram, sender = self._socket.recvfrom(_LARGEST + 1)
            except BlockingIOError:
                break
            except OSError:  # of Windows, about a row that nobody took, or a datagram that is too long
                continue
            self.tally.packets += 1
            pose = pose_of(datagram, self._form) if datagram else self._target
            if pose is None:
                self.tally.malformed += 1
                continue
            if sender in self._listeners or len(self._listeners) < _LISTENERS:
                self._listeners[sender] = now
            if datagram and self._can_reach(pose):
                if not self._is_taken:
                    self._machine("take")
                    self._is_taken = True
                self._target[:] = pose
                self._asked_at = now
            elif datagram:
                self.tally.out_of_reach += 1
        if now - self._asked_at > self._silence:
            self.tally.losses += 1
            self._asked_at = math.inf
            if self._stops:
                self.tally.ended = f"no reference for {self._silence:g} s"

    def _can_reach(self, pose: NDArray[np.float64]) -> bool:
        """Whether all legs are within their stroke, and the platform is turned by less than a quarter from home."""
        if np.abs(pose - self._home)[3:].max() >= math.pi / 2:
            return False
        length, (low, high) = leg_geometry(self._platform, pose[:3], pose[3:]).length, self._lengths
        return bool((length >= low).all() and (length <= high).all())

    def _row_at(self, row: int) -> NDArray[np.float64]:
        """Run to a row: its time, pose, lengths and reference pose (19,)."""
        machine = self._machine
        computed = machine.run(row + 1)
        if (failed := machine("ended")) >= 0:
            self.tally.ended = FAILURES.get(machine("failure"), "a leg has collapsed")
        last, first = machine.row - 1, machine.row - computed
        if failed >= 0:
            last = max(first, min(last, failed))
        values, planned = self._rows[last - first], self._planned[last - first + first % self._every]
        self.tally.time = last * self._step
        return np.concatenate([[self.tally.time], values[:6], values[12:18], planned[:6]])

    def _send(self, row: NDArray[np.float64], now: float) -> None:
        datagram = ROW.pack(*row) if self._form == "binary" else _json_row(row)
        for listener, heard in list(self._listeners.items()):
            if now - heard > _HEARD_FOR:
                del self._listeners[listener]
                continue
            try:
                self._socket.sendto(datagram, listener)
                self.tally.rows += 1
            except OSError:  # a full buffer, or a network that is down
                self.tally.unsent += 1


def pose_of(datagram: bytes, form: Format) -> NDArray[np.float64] | None:
    """The pose (6,) [m, rad] that a datagram asks for; None if it is malformed."""
    if form == "binary":
        values: Any = list(REFERENCE.unpack(datagram)) if len(datagram) == REFERENCE.size else None
    else:
        try:
            message = json.loads(datagram) if len(datagram) <= _LARGEST else None
        except (ValueError, RecursionError):
            return None
        values = message.get("pose") if isinstance(message, dict) else None
    if not isinstance(values, list) or len(values) != 6 or not {*map(type, values)} <= {int, float}:
        return None
    # of an integer that no double holds, too
    return np.array(values, dtype=float) if all(abs(value) < 1e6 for value in values) else None


def _json_row(row: NDArray[np.float64]) -> bytes:
    values = row.tolist()
    return json.dumps({"time": values[0], **{key: values[part] for key, part in _ROW_KEYS.items()}}).encode()

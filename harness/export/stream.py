"""The loop of an experiment in real time, by the C of c/machine: rows out and pose references in, over UDP.

1. The n-th row is sent n periods after the start, with the loop as far as that time.
2. An address gets rows for 10 s after each of its datagrams, an empty one included; eight addresses at most.
3. A datagram in the stream's format says where the platform is to go, by the limited filter of a hand (`by_hand`).
   Others are counted and ignored.
4. A sender that falls silent leaves the last pose that it asked for, or ends the stream.
"""

import ctypes
import json
import math
import socket
import struct
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

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
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.process.installed import TRACER

LARGEST_RATE = 250.0  # [Hz]
# Out: time [s], pose [m, rad], lengths [m], reference pose [m, rad]. In: a pose. Little-endian doubles.
ROW, REFERENCE = struct.Struct("<19d"), struct.Struct("<6d")
# Of a datagram [bytes], and how many a period takes; the rest waits.
_LARGEST, _MOST = 512, 64
_LISTENERS, _HEARD_FOR = 8, 10.0  # [s]
# By how much a sleep of the system may be too long; the rest is waited for awake [s].
_OVERSLEPT = 1.5e-3
_FAR_BEHIND = 1.0  # a clock that was asleep; the loop does not catch up [s]


class NativeMachine:
    """An open block with the functions of c/machine, compiled for this computer (BuildError without a compiler)."""

    def __init__(self, block: Block) -> None:
        check_installed(TRACER, COMPILER)
        library = machine_library(machine_c(block.variant), native()).kept(native())
        self._c, self._words = ctypes.CDLL(str(library)), block.words.copy()
        self("open", len(self._words))

    def __call__(self, name: str, *numbers: int) -> int:
        """The result of a function."""
        function = getattr(self._c, f"machine_{name}")
        function.restype = ctypes.c_int64
        return int(function(ctypes.c_void_p(self._words.ctypes.data), *map(ctypes.c_int64, numbers)))

    def array(self, name: str, *shape: int) -> NDArray[np.float64]:
        """A view of what a field holds."""
        place = ctypes.cast(self("field", fields()[name]), ctypes.POINTER(ctypes.c_double))
        return np.ctypeslib.as_array(place, shape)


@dataclass
class PacketTally:
    """What a stream did: counts, the time of its last row [s], and why the loop ended."""

    rows: int = 0  # sent
    packets: int = 0  # received, of all kinds
    malformed: int = 0
    out_of_reach: int = 0
    late: int = 0  # rows, by more than half a period
    losses: int = 0  # of the sender
    time: float = 0.0
    ended: str = ""
    lateness: deque[float] = field(default_factory=lambda: deque(maxlen=10_000))  # of the latest rows [s]


class Stream:
    """An experiment's loop behind a socket at an `address`, host and port (0: any), with rows at a `rate` [Hz].

    `silence` [s] makes a sender lost, which can end the stream. Raises ExportError for a rate out of bounds and a loop
    that c/machine lacks or that follows no reference, OSError for an address that is not free.
    """

    def __init__(
        self,
        experiment: Experiment,
        address: tuple[str, int],
        rate: float = 100.0,
        binary: bool = False,
        silence: float = 1.0,
        stops_without_sender: bool = False,
    ) -> None:
        block, prepared, _ = endless_machine(experiment, 1, "a stream")
        self._platform, timing = prepared.platform, prepared.loop.timing
        self._lengths = lengths_for_hands(prepared.platform)
        fastest = min(LARGEST_RATE, 1 / timing.plant_step)
        if not 1 <= rate <= fastest:
            raise ExportError(f"a stream of {rate:g} rows a second; expected 1 to {fastest:g}")
        if not 0 < silence < math.inf:
            raise ExportError(f"a sender that is lost after {silence:g} s; expected a time above 0")
        if prepared.reference is None or planned_motion(prepared.reference) is None:
            raise ExportError(f"{experiment.where}: its loop follows no reference that a sender can take over")
        self._step, self._every, self._period = timing.plant_step, timing.steps_a_sample, 1 / rate
        self._binary, self._silence, self._stops = binary, silence, stops_without_sender
        self._machine = machine = NativeMachine(block)
        self._signals, self._target = machine.array("row_signals", 24), machine.array("plan_target", 6)
        self._planned = machine.array("plan_reference", self._every, 30)
        self._next, self._is_taken = 0, False
        self._listeners = dict[Any, float]()  # when they were heard
        self._asked_at = math.inf  # when the sender's last reference came, or there is none
        self.tally = PacketTally()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError:
            self._socket.close()
            raise
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]

    def run(self, duration: float = math.inf) -> PacketTally:
        """Serve for a time [s] of the clock, until the loop ends, or Ctrl-C; then the socket is closed."""
        tally, start, period = self.tally, time.monotonic(), 0
        try:
            while (period + 0.5) * self._period < duration and not (tally.ended or (self._stops and tally.losses)):
                period += 1
                time.sleep(max(0.0, start + period * self._period - _OVERSLEPT - time.monotonic()))
                while time.monotonic() < start + period * self._period:
                    time.sleep(0)
                behind = time.monotonic() - start - period * self._period
                start += behind if behind > _FAR_BEHIND else 0.0
                self._receive(time.monotonic())
                self._send(round(period * self._period / self._step), time.monotonic())
                tally.lateness.append(time.monotonic() - start - period * self._period)
                tally.late += max(behind, tally.lateness[-1]) > self._period / 2
        except KeyboardInterrupt:  # the usual end
            pass
        finally:
            self._socket.close()
        return tally

    def _receive(self, now: float) -> None:
        """Take what has come; the last pose within reach holds."""
        poses = list[NDArray[np.float64]]()
        for _ in range(_MOST):
            try:
                datagram, sender = self._socket.recvfrom(_LARGEST + 1)
            except BlockingIOError:
                break
            except OSError:  # of Windows: a row that nobody took, a datagram that is too long
                continue
            self.tally.packets += 1
            pose = pose_of(datagram, self._binary)
            if pose is not None:
                poses.append(pose)
            elif datagram:
                self.tally.malformed += 1
                continue
            if sender in self._listeners or len(self._listeners) < _LISTENERS:
                self._listeners[sender] = now
        # all legs within their stroke, turned by less than a quarter from home
        within = np.array(poses).reshape(-1, 6)
        turned = np.abs(within[:, 3:] - self._platform.home_orientation)
        length = leg_geometry(self._platform, within[:, :3], within[:, 3:]).length
        low, high = self._lengths
        within = within[((length >= low) & (length <= high)).all(axis=1) & (turned < math.pi / 2).all(axis=1)]
        self.tally.out_of_reach += len(poses) - len(within)
        if len(within):
            if not self._is_taken:
                self._machine("take")
            self._target[:], self._asked_at, self._is_taken = within[-1], now, True
        if now - self._asked_at > self._silence:
            self.tally.losses += 1
            self._asked_at = math.inf

    def _send(self, index: int, now: float) -> None:
        """Run to a row, and send its time, pose, lengths and reference pose (19,)."""
        while self._next <= index and self._machine("ended") < 0:
            self._next = self._machine("run", index + 1)
        if self._machine("ended") >= 0:
            self.tally.ended = FAILURES.get(self._machine("failure"), "a leg has collapsed")
        self.tally.time = (self._next - 1) * self._step
        planned, now_at = self._planned[(self._next - 1) % self._every], self._signals
        row = np.concatenate([[self.tally.time], now_at[:6], now_at[12:18], planned[:6]])
        if self._binary:
            datagram = ROW.pack(*row)
        else:
            pose, length, reference = (part.tolist() for part in np.split(row[1:], 3))
            values = {"time": row[0], "pose": pose, "leg_length": length, "reference": reference}
            datagram = json.dumps(values).encode()
        self._listeners = {name: heard for name, heard in self._listeners.items() if now - heard <= _HEARD_FOR}
        for listener in self._listeners:
            try:
                self._socket.sendto(datagram, listener)
                self.tally.rows += 1
            except OSError:  # a full buffer, or a network that is down: a row that is lost, as UDP may lose it
                continue


def pose_of(datagram: bytes, binary: bool = False) -> NDArray[np.float64] | None:
    """The pose (6,) [m, rad] that a datagram asks for; None if it is malformed."""
    try:
        if binary:
            values: Any = list(REFERENCE.unpack(datagram))
        else:
            values = json.loads(datagram)["pose"] if len(datagram) <= _LARGEST else None
    except (ValueError, TypeError, KeyError, RecursionError, struct.error):
        return None
    if not isinstance(values, list) or len(values) != 6 or not {*map(type, values)} <= {int, float}:
        return None
    # refuses NaN, and whole numbers that no double holds
    return np.array(values, dtype=float) if all(abs(value) < 1e6 for value in values) else None

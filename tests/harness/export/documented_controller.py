"""An exported controller written a second time, from docs/export.md and docs/control.md, without the harness."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi
import control
import numpy as np
from numpy.typing import NDArray

from gough_stewart import LinearController, Platform
from tests.support.arrays import FloatArray
from tests.support.documented_loop import (
    PidLaw,
    feedforward,
    jacobian,
    motion_of,
    static_forces,
    stepped,
    twist_of_rates,
)
from tests.support.lagrangian import Pose, legs_along

GOOD, OUT_OF_RANGE, FROZEN = range(3)
Measured = Mapping[str, FloatArray]


@dataclass
class Sample:
    """What comes out of a sample."""

    force: FloatArray  # (6,) [N]
    limited: NDArray[np.bool_]  # (6,)
    status: int
    bad_time: float  # [s]


class DocumentedController:
    """A controller of some options: numbers in SI units under the names of the experiment file."""

    def __init__(self, options: Mapping[str, Any], believed: Platform, start_force: FloatArray) -> None:
        self.options, self.believed, self.start_force = options, believed, start_force
        self.motion = motion_of(options, _home(believed))
        self.T = options["sample_time"]
        self.samples, self.bad = 0, 0  # so far; the last ones
        self.law: Any = None
        self.excess, self.planned = np.zeros(6), start_force.copy()
        self.known: FloatArray | None = None  # the feedforward of the last good reference
        self.held: _Held | None = None

    def sample(self, measured: Measured, reference: FloatArray | None = None) -> Sample:
        """Forces of the next sample, from measurements by name and, if it comes in, the reference (18,)."""
        options, limit, time = self.options, self.options["force_limit"], self.samples * self.T
        self.samples += 1
        inputs = [*measured.values(), *([] if reference is None else [reference])]
        if self.law is None and inputs and not any(np.any(each) for each in inputs):
            return Sample(self.start_force, np.zeros(6, dtype=bool), GOOD, 0.0)
        now = self.motion(np.array([time])) if reference is None else coordinates_of(reference)
        status = GOOD if _may_be(now) and self._may_be_lengths(measured) else OUT_OF_RANGE
        known = self._feedforward(now, time) if _may_be(now) else self.known
        if status == GOOD and self._is_frozen(measured, now):
            status = FROZEN
        if status == GOOD:
            assert known is not None
            command = known + self._feedback(now, time, measured)
            self.known, self.bad = known, 0
        else:
            command = self._safe(known)
            self.bad += 1
        force = np.clip(command, -limit, limit)
        step = options["rate_limit"] * self.T
        self.planned = self.planned + np.clip(force - self.planned, -step, step)
        if status == GOOD:  # what the limits leave of a command after one sample; a law that did not run hears nothing
            self.excess = self.planned - command
        return Sample(force, np.abs(command) > limit, status, self.bad * self.T)

    def _feedback(self, now: Pose, time: float, measured: Measured) -> FloatArray:
        kind = self.options["type"]
        if kind == "open_loop":
            self.law = kind
            return np.zeros(6)
        if kind == "function":
            self.law = self.law or FunctionLaw(self.believed)
            return np.asarray(self.law(time, now, measured))
        at = jacobian(self.believed, now.q[0]), legs_along(self.believed, now)[0][0], measured["leg_length"]
        if self.law is None:
            self.law = (SystemLaw if kind == "system" else PidLaw)(self.options, *at)
        elif self.bad > 1:
            self.law.settle(*at)
        return np.asarray(self.law.force(*at, self.excess))

    def _feedforward(self, now: Pose, time: float) -> FloatArray:
        """At the middle of the interval over which the force acts, with constant forces."""
        options = self.options
        h = (options["delay"] + 0.5) * self.T
        ahead = self.motion(np.array([time + h]))
        if options["reference_from"] == "inputs":
            ahead = Pose(now.q + h * now.rate + h * h / 2 * now.acceleration, now.rate + h * now.acceleration, now[2])
        constant = options["constant_force"] if options["type"] == "open_loop" else 0.0
        return np.asarray(feedforward(options, self.believed, ahead) + constant)

    def _safe(self, known: FloatArray | None) -> FloatArray:
        if self.options["safe_force"] == "zero":
            return np.zeros(6)
        return self.start_force if self.options["feedforward"] == "none" or known is None else known

    def _may_be_lengths(self, measured: Measured) -> bool:
        low, high = range_of_lengths(self.believed)
        lengths = measured.get("leg_length", np.full(6, low))
        return bool(((lengths >= low) & (lengths <= high)).all())

    def _is_frozen(self, measured: Measured, now: Pose) -> bool:
        """Whether a length is the same for so many samples while its reference has moved by more than so much."""
        if self.options["frozen"] is None:
            return False
        samples, movement = self.options["frozen"]
        wanted, value = legs_along(self.believed, now)[0][0], measured["leg_length"]
        last = self.held or _Held(np.full(6, np.nan), np.zeros(6), wanted, np.zeros(6))
        same = value == last.value
        there = np.where(same, last.there, wanted)
        way = np.where(same, np.maximum(last.way, np.abs(wanted - there)), 0.0)
        self.held = _Held(value.copy(), np.where(same, last.since + 1, 0), there, way)
        return bool(((self.held.since >= samples) & (way > movement)).any())


@dataclass
class _Held:
    """Lengths that may be frozen, each (6,)."""

    value: FloatArray  # [m]
    since: FloatArray  # [samples]
    there: FloatArray  # their references when they changed last [m]
    way: FloatArray  # how far these have moved since [m]


def range_of_lengths(believed: Platform) -> tuple[float, float]:
    """The stroke, with a tenth of its width on either side [m]."""
    low, high = believed.leg_length_min, believed.leg_length_max
    assert isinstance(low, float)
    assert isinstance(high, float)
    return low - 0.1 * (high - low), high + 0.1 * (high - low)


def start_of(options: Mapping[str, Any], believed: Platform, machine: Platform, q: FloatArray) -> FloatArray:
    """The forces (6,) before the first sample: those that hold the machine, or the own ones of an open loop."""
    held = static_forces(machine, q)
    if options["type"] == "open_loop":
        h = (options["own_delay"] + 0.5) * options["sample_time"]
        ahead = motion_of(options, _home(believed))(np.array([h]))
        held = feedforward(options, believed, ahead) + options["constant_force"]
    return np.clip(held, -options["force_limit"], options["force_limit"])


def closed(
    options: Mapping[str, Any],
    believed: Platform,
    machine: Platform,
    start: FloatArray | None,
    measure: Callable[[FloatArray, FloatArray], Measured],
) -> tuple[FloatArray, FloatArray]:
    """Leg lengths and forces (n, 6) at an importer's steps from inputs of zero; a force acts `delay` samples later."""
    q, rate = (each[0] for each in motion_of(options, _home(believed))(np.zeros(1))[:2])
    if start is not None:
        q, rate = start.copy(), np.zeros(6)
    controller = DocumentedController(options, believed, start_of(options, believed, machine, q))
    line = [controller.start_force] * options["delay"]
    lengths, forces = [], []
    for k in range(round(options["duration"] / options["sample_time"])):
        measured = measure(q, legs_along(machine, Pose(q[None], rate[None], rate[None]))[0][0])
        line.append(controller.sample({n: 0 * v for n, v in measured.items()} if k == 0 else measured).force)
        q, rate = stepped(machine, q, rate, line.pop(0), np.zeros(6), options["sample_time"])
        lengths.append(legs_along(machine, Pose(q[None], rate[None], rate[None]))[0][0])
        forces.append(line[0])
    return np.array(lengths), np.array(forces)


def _home(believed: Platform) -> FloatArray:
    return np.concatenate([believed.home_position, believed.home_orientation])


def _may_be(now: Pose) -> bool:
    """References here are poses of the platform, or far away, or zeros."""
    return bool(np.isfinite(now.rate).all() and np.abs(now.q[0, :3]).max() < 8 and now.q.any())


def reference_rows(pose: Pose) -> FloatArray:
    """Position, orientation, velocity, angular velocity and their rates (n, 18) of a motion in coordinates."""
    rows = []
    for q, rate, acceleration in zip(*pose, strict=True):
        E = twist_of_rates(q)
        rows.append(np.concatenate([q, E @ rate, E @ acceleration + _turning(q, rate) @ rate]))
    return np.array(rows)


def coordinates_of(row: FloatArray) -> Pose:
    """The motion (1, 6) in coordinates of such a row (18,)."""
    q, twist, change = row[:6], row[6:12], row[12:]
    E = twist_of_rates(q)
    rate = np.asarray(np.linalg.solve(E, twist), dtype=float)
    return Pose(q[None], rate[None], np.linalg.solve(E, change - _turning(q, rate) @ rate)[None])


def _turning(q: FloatArray, rate: FloatArray) -> FloatArray:
    """Ė along a motion, by central differences."""
    h = 1e-6
    return np.asarray((twist_of_rates(q + h * rate) - twist_of_rates(q - h * rate)) / (2 * h))


_random = np.random.default_rng(11)
STIFFNESS = np.diag([900.0, 1100, 800, 1200, 1000, 700]) + _random.uniform(-150, 150, (6, 6))
TILT, DAMPING = _random.uniform(-40, 40, (6, 3)), _random.uniform(-60, 60, (6, 6))
RAMP, COUNT = _random.uniform(-50, 50, 6), _random.uniform(-0.8, 0.8, 6)
INTEGRAL, SMOOTHING = np.array([900.0, 1500, 700, 1100, 2000, 800]), np.array([0.5, 0.6, 0.45, 0.7, 0.55, 0.65])
DERIVATIVE, TRACKING = np.array([2500.0, 3100, 1900, 2700, 3600, 2200]), 0.05


class FunctionLaw:
    """F = K (L_r − L) + W θ + D L̇_r + r t + c n of lengths, angles, wanted velocities, time, and samples so far."""

    def __init__(self, believed: Platform) -> None:
        self.believed, self.count = believed, 0

    def __call__(self, time: float, now: Pose, measured: Measured) -> FloatArray:
        """Forces (6,)."""
        wanted, velocity = (each[0] for each in legs_along(self.believed, now))
        force = STIFFNESS @ (wanted - measured["leg_length"]) + TILT @ measured["orientation"]
        force += DAMPING @ velocity + RAMP * time + COUNT * self.count
        self.count += 1
        return np.asarray(force)


class SystemLaw:
    """w = K e + s + d (e − f): s⁺ = s + T (ki e + excess/Tt), of legs the excess over limits; f⁺ = a f + (1 − a) e."""

    def __init__(self, options: Mapping[str, Any], J: FloatArray, wanted: FloatArray, measured: FloatArray) -> None:
        self.T, self.is_task = options["sample_time"], options["space"] == "task"
        self.s = np.zeros(6)
        self.settle(J, wanted, measured)

    def settle(self, J: FloatArray, wanted: FloatArray, measured: FloatArray) -> None:
        """Let the filter rest in the error; the integral goes on."""
        self.f = self._error(J, wanted, measured)

    def _error(self, J: FloatArray, wanted: FloatArray, measured: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(J, wanted - measured) if self.is_task else wanted - measured)

    def force(self, J: FloatArray, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,)."""
        e = self._error(J, wanted, measured)
        w = STIFFNESS @ e + self.s + DERIVATIVE * (e - self.f)
        self.s = self.s + self.T * (INTEGRAL * e + (0.0 if self.is_task else excess / TRACKING))
        self.f = SMOOTHING * self.f + (1 - SMOOTHING) * e
        return np.asarray(np.linalg.solve(J.T, w) if self.is_task else w)


def linear_law(sample_time: float, space: str) -> LinearController:
    """The law of `SystemLaw` as matrices: of references, measurements and excess of legs; of errors in task space."""
    one, none = np.eye(6), np.zeros((6, 6))
    A = np.block([[np.diag(SMOOTHING), none], [none, one]])
    filtered, summed = one - np.diag(SMOOTHING), sample_time * np.diag(INTEGRAL)
    C, D = np.hstack([-np.diag(DERIVATIVE), one]), STIFFNESS + np.diag(DERIVATIVE)
    if space == "task":
        return LinearController(control.ss(A, np.vstack([filtered, summed]), C, D, sample_time), space="task")
    B = np.block([[filtered, -filtered, none], [summed, -summed, one * sample_time / TRACKING]])
    return LinearController(control.ss(A, B, C, np.hstack([D, -D, none]), sample_time))


def function_law() -> casadi.Function:
    """The law of `FunctionLaw`."""
    sizes = {"leg_length": 6, "orientation": 3, "reference_leg_length": 6, "reference_leg_velocity": 6}
    s = {name: casadi.SX.sym(name, size) for name, size in {**sizes, "time": 1, "memory": 1}.items()}
    force = casadi.DM(STIFFNESS) @ (s["reference_leg_length"] - s["leg_length"]) + casadi.DM(TILT) @ s["orientation"]
    force += casadi.DM(DAMPING) @ s["reference_leg_velocity"] + casadi.DM(RAMP) * s["time"]
    force += casadi.DM(COUNT) * s["memory"]
    return casadi.Function(
        "law", list(s.values()), [force, s["memory"] + 1], list(s), ["actuator_force", "memory_next"]
    )

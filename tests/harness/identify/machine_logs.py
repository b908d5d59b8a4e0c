"""Logs of machines by `tests.support.lagrangian`, perfect or with one thing wrong; nothing is what a fit inverts."""

from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

import gough_stewart as gs
from gough_stewart import Log, Platform, load_preset
from tests.support.arrays import FloatArray
from tests.support.lagrangian import Pose, forces_along, legs_along

RATE = 1000.0  # of logs [Hz]
# Frictionless forces are smooth: at this rate a spline of fifth degree through them is exact to 1e-9.
_COARSE = 100.0

NOMINAL = load_preset("motion_base")
# With a payload that its designer does not know.
MACHINE = replace(
    NOMINAL,
    platform_mass=1516.9,
    platform_com=np.array([0.05, -0.03, 0.19]),
    platform_inertia=np.array([[380.0, 12.0, -20.0], [12.0, 410.0, 8.0], [-20.0, 8.0, 690.0]]),
    leg_viscous_friction=560.0,
    leg_coulomb_friction=130.0,
    leg_armature=530.0,
)
# What is usually estimated.
NAMES = (
    *("platform_mass", "platform_com", "platform_inertia"),
    *("leg_armature", "leg_viscous_friction", "leg_coulomb_friction"),
)


# From 0 to 1 with six derivatives that are 0 at both ends: forces have four that are continuous.
_RISE = Polynomial.fromroots([0.0] * 6 + [1.0] * 6).integ()
_RISE = _RISE / _RISE(1.0)


@dataclass(frozen=True)
class Swing:
    """q(t) = home + w(t) Σ_k (a_k sin 2π k f t + b_k cos 2π k f t), a and b random; w rises and falls with `fade`."""

    seed: int = 3
    frequency: float = 0.15  # of the first harmonic [Hz]
    harmonics: int = 5
    size: float = 0.03  # standard deviation of coefficients, in radius of the platform's joints or rad
    fade: float = 1.0  # [s]
    # share of each coordinate: (0, 0, 1, 0, 0, 0) is heave alone, (0, 0, 0, 0, 1, 0) pitch alone
    axes: tuple[float, ...] = (1.0,) * 6

    def coefficients(self, machine: Platform) -> FloatArray:
        """A and b (2, harmonics, 6)."""
        rng = np.random.default_rng(self.seed)
        size = self.size * np.repeat([machine.characteristic_length, 1.0], 3) * np.array(self.axes)
        return np.asarray(size * rng.standard_normal((2, self.harmonics, 6)))

    def along(self, machine: Platform, time: FloatArray, duration: float) -> Pose:
        """The pose at times (n,) [s], which lie in 0 … duration or a few milliseconds beside."""
        a, b = self.coefficients(machine)
        omega = 2 * np.pi * self.frequency * np.arange(1, self.harmonics + 1)
        s, c = np.sin(np.outer(time, omega)), np.cos(np.outer(time, omega))
        series = (s @ a + c @ b, (c * omega) @ a - (s * omega) @ b, -(s * omega**2) @ a - (c * omega**2) @ b)
        # the window: 0 before and after the motion, 1 between the fades
        rising = time < duration / 2
        share = np.clip(np.where(rising, time, duration - time) / self.fade, 0.0, 1.0)[:, None]
        pace = np.where(rising, 1.0, -1.0)[:, None] / self.fade
        w, w1, w2 = _RISE(share), _RISE.deriv()(share) * pace, _RISE.deriv(2)(share) * pace**2
        home = np.concatenate([machine.home_position, machine.home_orientation])
        x, x1, x2 = series
        return Pose(home + w * x, w1 * x + w * x1, w2 * x + 2 * w1 * x1 + w * x2)


HEAVE = Swing(axes=(0.0, 0.0, 1.0, 0.0, 0.0, 0.0), size=0.06)


@dataclass(frozen=True)
class Sensing:
    """How a machine records, by default well: gain · F(t − delay) + offset + noise, and L(t) + offset + noise."""

    force_gain: float | tuple[float, ...] = 1.0  # of all legs, or of each
    force_offset: float | tuple[float, ...] = 0.0  # [N]
    delay: float = 0.0  # of forces, late if > 0, also fractions of a sample [s]
    length_offset: float | tuple[float, ...] = 0.0  # [m]
    force_noise: float = 0.01  # standard deviation, as a share of each leg's RMS force
    length_noise: float = 1e-6  # standard deviation [m]
    encoder: float = 1e-6  # quantisation of lengths [m]; 0 for none
    coloured: float | None = None  # corner frequency of the noise of forces [Hz]; white by default


@dataclass(frozen=True)
class Course:
    """What a machine does: `Swing` for a duration, and what of the machine the platform's file cannot say."""

    swing: Swing = field(default_factory=Swing)
    duration: float = 10.0  # [s]
    rate: float = RATE
    base_tilt: tuple[float, float] = (0.0, 0.0)  # of the base from level, about X, then Y [rad]
    joints: float = 0.0  # standard deviation of the error of each coordinate of each joint [m]
    joints_seed: int = 0
    static_friction: float = 0.0  # Coulomb friction is higher by this share when a leg starts to slide
    stribeck_velocity: float = 5e-3  # [m/s]


def machine_log(
    machine: Platform = MACHINE, course: Course = Course(), sensing: Sensing = Sensing(), *, seed: int = 0
) -> Log:
    """What a machine, whose joints and gravity the fit believes, records along a course; `seed` is the noise's."""
    time = np.arange(round(course.duration * course.rate)) / course.rate
    # only the sensing of forces depends on the delay, so that draws of one machine share the rest
    length, force = _recorded(_Machine(machine), course, sensing.delay)
    rng = np.random.default_rng(seed)
    n = len(time)
    noise = sensing.force_noise * np.sqrt((force**2).mean(axis=0))
    gain, offset = np.array(sensing.force_gain), np.array(sensing.force_offset)
    force = gain * force + offset + noise * _noise(rng, n, sensing.coloured, course.rate)
    length = length + np.array(sensing.length_offset)
    length = length + sensing.length_noise * rng.standard_normal((n, 6))
    if sensing.encoder:
        length = sensing.encoder * np.rint(length / sensing.encoder)
    return Log(length, time, force, where="machine")


@dataclass(frozen=True, eq=False)
class _Machine:
    """A platform as a key: equal if it is the same object."""

    platform: Platform

    def __hash__(self) -> int:
        return id(self.platform)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Machine) and other.platform is self.platform


@lru_cache(maxsize=8)
def _recorded(key: _Machine, course: Course, delay: float) -> tuple[FloatArray, FloatArray]:
    """Lengths at the rows, and forces as late as they are recorded."""
    machine = key.platform
    if course.joints:
        rng = np.random.default_rng(course.joints_seed)
        base, top = course.joints * rng.standard_normal((2, 6, 3))
        machine = replace(
            machine, base_points=machine.base_points + base, platform_points=machine.platform_points + top
        )
    if any(course.base_tilt):
        machine = replace(machine, gravity=tilted(machine.gravity, *course.base_tilt))
    time = np.arange(round(course.duration * course.rate)) / course.rate
    coarse = np.arange(-0.05, course.duration + 0.05 + 1 / _COARSE, 1 / _COARSE)
    smooth = forces_along(machine, course.swing.along(machine, coarse, course.duration))
    length, velocity = legs_along(machine, course.swing.along(machine, time, course.duration))
    if delay:
        velocity = legs_along(machine, course.swing.along(machine, time - delay, course.duration))[1]
    force = make_interp_spline(coarse, smooth, k=5)(time - delay)
    return length, force + friction(machine, course, velocity)


def friction(machine: Platform, course: Course, velocity: FloatArray) -> FloatArray:
    """Friction of the legs (n, 6) [N]: viscous, Coulomb, and what is more when a leg starts to slide."""
    viscous = machine.leg_viscous_friction * machine.leg_viscous_friction_factor * velocity
    sliding = machine.leg_coulomb_friction * machine.leg_coulomb_friction_factor
    more = 1 + course.static_friction * np.exp(-((velocity / course.stribeck_velocity) ** 2))
    return viscous + sliding * more * np.tanh(velocity / machine.leg_friction_velocity)


def tilted(gravity: FloatArray, about_x: float, about_y: float) -> FloatArray:
    """Gravity in the axes of a base that is turned out of level about X, then Y [rad]: Rᵀ g with R = R_y R_x."""
    cx, sx, cy, sy = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
    R_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    R_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return np.asarray((R_y @ R_x).T @ gravity, dtype=float)


def _noise(rng: np.random.Generator, n: int, corner: float | None, rate: float) -> FloatArray:
    """Noise (n, 6) of variance 1: white, or through a low-pass of first order."""
    if corner is None:
        return rng.standard_normal((n, 6))
    pole = np.exp(-2 * np.pi * corner / rate)
    first = rng.standard_normal((1, 6))
    driven = np.sqrt(1 - pole**2) * rng.standard_normal((n, 6))
    # from the stationary distribution on
    found, _ = lfilter([1.0], [1.0, -pole], driven, axis=0, zi=pole * first)
    return np.asarray(found)


def force_of(log: Log) -> FloatArray:
    """The forces of a log that has them."""
    assert log.actuator_force is not None
    return log.actuator_force


def value_of(machine: Platform, element: str) -> float:
    """The machine's value of an element such as `platform_inertia[1,2]`; of a leg's friction its own."""
    stem, index = place(element)
    value = np.asarray(getattr(machine, stem))
    if index and stem in ("leg_viscous_friction", "leg_coulomb_friction"):
        return float(value * getattr(machine, f"{stem}_factor")[index])
    return float(value[index])


def place(element: str) -> tuple[str, tuple[int, ...]]:
    """Name and index, from 0, of an element."""
    stem, _, index = element.partition("[")
    return stem, tuple(int(k) - 1 for k in index[:-1].split(",")) if index else ()


# Faults of data, each a function of a log.


def with_spikes(log: Log, signal: str, height: float, number: int, *, seed: int = 0) -> Log:
    """Single rows of "leg_length" or "actuator_force" are off by ± height, at random rows and legs."""
    rng = np.random.default_rng(seed)
    values: Any = np.array(getattr(log, signal))
    rows = rng.choice(np.arange(len(log) // 20, len(log) - len(log) // 20), number, replace=False)
    values[rows, rng.integers(0, 6, number)] += height * rng.choice([-1.0, 1.0], number)
    return replace(log, **{signal: values})


def clipped(log: Log, share: float = 0.9) -> Log:
    """Forces are clipped at a share of the largest one."""
    assert log.actuator_force is not None
    limit = share * np.abs(log.actuator_force).max()
    return replace(log, actuator_force=np.clip(log.actuator_force, -limit, limit))


def without_rows(log: Log, first: int, number: int = 1, *, renumbered: bool = False) -> Log:
    """Rows are lost; if renumbered, times go on as if none were."""
    kept = np.delete(np.arange(len(log)), slice(first, first + number))
    values: dict[str, Any] = {name: getattr(log, name)[kept] for name in ("leg_length", "actuator_force", "time")}
    assert log.time is not None
    return replace(log, **values | ({"time": log.time[: len(kept)]} if renumbered else {}))


def frozen(log: Log, signal: str, first: int, number: int, legs: slice = slice(None)) -> Log:
    """Readings of some legs stay what they are at a row, for a number of rows."""
    values: Any = np.array(getattr(log, signal))
    values[first : first + number, legs] = values[first, legs]
    return replace(log, **{signal: values})


def held(log: Log, every: int = 2, signals: tuple[str, ...] = ("leg_length", "actuator_force")) -> Log:
    """Sensors are read at every n-th row only; rows between repeat the latest reading."""
    at = np.arange(len(log)) // every * every
    values: dict[str, Any] = {name: getattr(log, name)[at] for name in signals}
    return replace(log, **values)


def exchanged(log: Log, a: int = 0, b: int = 1) -> Log:
    """The forces of two legs are in each other's columns."""
    assert log.actuator_force is not None
    order = np.arange(6)
    order[[a, b]] = b, a
    return replace(log, actuator_force=log.actuator_force[:, order])


@cache
def perfect_estimate() -> gs.Estimate:
    """What is identified of a log without an error."""
    return gs.identify(machine_log(), NOMINAL, NAMES)


def random_machine(seed: int, *, equal_friction: bool = True) -> tuple[Platform, Platform]:
    """A machine near `motion_base`, whose joints differ by centimetres, and what its designer believes."""
    rng = np.random.default_rng([seed, 24])
    while True:
        joints = [
            getattr(NOMINAL, name) + 0.03 * rng.standard_normal((6, 3)) for name in ("base_points", "platform_points")
        ]
        legs = {
            name: getattr(NOMINAL, name) * rng.uniform(0.8, 1.2)
            for name in ("leg_lower_mass", "leg_upper_mass", "leg_lower_com", "leg_upper_com")
        }
        believed = replace(NOMINAL, base_points=joints[0], platform_points=joints[1], **legs)
        # inertia of random point masses: meets every condition an inertia has to meet
        mass = NOMINAL.platform_mass * rng.uniform(0.8, 1.6)
        points = rng.normal(scale=(0.5, 0.5, 0.35), size=(8, 3))
        points -= points.mean(axis=0)
        inertia = mass / 8 * (np.eye(3) * (points**2).sum() - points.T @ points)
        factors = np.ones((2, 6)) if equal_friction else rng.uniform(0.85, 1.15, (2, 6))
        try:
            machine = replace(
                believed,
                platform_mass=mass,
                platform_com=rng.uniform((-0.1, -0.1, 0.0), (0.1, 0.1, 0.3)),
                platform_inertia=inertia,
                leg_armature=NOMINAL.leg_armature * rng.uniform(0.8, 1.2),
                leg_viscous_friction=NOMINAL.leg_viscous_friction * rng.uniform(0.7, 1.4),
                leg_coulomb_friction=NOMINAL.leg_coulomb_friction * rng.uniform(0.7, 1.6),
                leg_viscous_friction_factor=factors[0],
                leg_coulomb_friction_factor=factors[1],
            )
        except gs.GoughStewartError:
            continue
        return machine, believed

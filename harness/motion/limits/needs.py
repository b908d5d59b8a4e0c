"""What a motion needs of each leg, whatever limits its platform states: the figures that choose an actuator.

Speeds, forces and powers are peaks, with the speed and force at the same time, and root mean squares over the run.
Forces are those of inverse dynamics without load, so all figures are without reserve.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER, Acceleration, inverse_dynamics
from gough_stewart.model.kinematics import (
    LegGeometry,
    condition_number_bound,
    joint_angles,
    leg_accelerations,
    leg_geometry,
    rates_of_legs,
    scaled_jacobian_of_legs,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray, first_of_largest


@dataclass(frozen=True, eq=False)
class LegLoads:
    """What a motion asks of the legs at n times, each (n, 6), evaluated when it is needed."""

    platform: Platform
    motion: Motion
    legs: LegGeometry
    # rows (n,) in which the legs can hold the pose; all rows by default
    regular: NDArray[np.bool_] | None = None

    @cached_property
    def velocity(self) -> FloatArray:
        """L̇ [m/s]."""
        return np.asarray(rates_of_legs(self.legs, State(*self.motion[:4])).length_rate)

    @cached_property
    def acceleration(self) -> FloatArray:
        """L̈ [m/s²]."""
        return leg_accelerations(self.legs, State(*self.motion[:4]), *self.motion[4:])

    @cached_property
    def force(self) -> FloatArray:
        """F [N] by inverse dynamics without load; 0 where the legs cannot hold the pose, which is refused elsewhere."""
        n = len(self.motion.position)
        regular = np.ones(n, dtype=bool) if self.regular is None else self.regular
        force = np.zeros((n, 6))
        if regular.any():
            rows = [part[regular] for part in self.motion]
            force[regular] = inverse_dynamics(self.platform, State(*rows[:4]), Acceleration(*rows[4:]))
        return force

    @cached_property
    def power(self) -> FloatArray:
        """F L̇ [W]."""
        return self.force * self.velocity


# A step between two rows that the velocities do not explain is a jump if it exceeds this share of the stroke used.
_JUMP = 0.01


class Need(NamedTuple):
    """One figure of every leg."""

    unit: str
    of_leg: FloatArray  # (6,), NaN if it is not defined


@dataclass(frozen=True, eq=False)
class Needs:
    """What a motion needs of each leg, by name, in the order of tables."""

    of: dict[str, Need]
    # what these figures leave out
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> FloatArray:
        """A figure of every leg (6,), by its name, such as "actuator_force_rms"."""
        return self.of[name].of_leg


def needs_along(platform: Platform, time: FloatArray, motion: Motion) -> Needs:
    """What a motion needs of each leg.

    Stroke, speed, acceleration, force, power, energy and joint angle: peak, root mean square (√(∫x² dt/T), of the
    length about its mean), and the leg velocity [m/s], time [s] and force [N] at the peak. Positive forces push the
    platform; positive power is motoring, negative power is regenerated. Energies are integrals of each sign of F L̇,
    by the trapezoidal rule.

    Parameters
    ----------
    time
        Times of the motion's rows (n,) [s].
    """
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        legs = leg_geometry(platform, motion.position, motion.orientation)
        regular = condition_number_bound(scaled_jacobian_of_legs(legs)[0]) < LARGEST_CONDITION_NUMBER
        loads = LegLoads(platform, motion, legs, regular)
        length, v, a = np.asarray(legs.length), loads.velocity, loads.acceleration
        home = (platform.home_position, platform.home_orientation)
        base_angle, platform_angle = joint_angles(platform, motion.position, motion.orientation, *home)
    # forces exist in all rows, or none of their figures does
    F, P = (part if regular.all() else np.full_like(part, np.nan) for part in (loads.force, loads.power))
    needs = {
        **_lengths(time, length),
        **_peak("leg_velocity", "m/s", v, time, force=F),
        **_peak("leg_acceleration", "m/s2", a, time, velocity=v, force=F),
        **_peak("actuator_force", "N", F, time, velocity=v),
        "actuator_force_push": Need("N", np.maximum(F, 0.0).max(axis=0)),
        "actuator_force_pull": Need("N", np.maximum(-F, 0.0).max(axis=0)),
        **_peak("actuator_power", "W", P, time, velocity=v, force=F),
        **_peak("motoring_power", "W", np.maximum(P, 0.0), time, velocity=v, force=F),
        **_peak("regenerated_power", "W", np.maximum(-P, 0.0), time, velocity=v, force=F),
        "motoring_energy": Need("J", _integral_of_positive(time, P)),
        "regenerated_energy": Need("J", _integral_of_positive(time, -P)),
        **_peak("base_joint_angle", "rad", base_angle, time, velocity=v),
        **_peak("platform_joint_angle", "rad", platform_angle, time, velocity=v),
    }
    return Needs(needs, tuple(_notes(platform, time, length, v)))


def _lengths(time: FloatArray, length: FloatArray) -> dict[str, Need]:
    """Length and stroke; the root mean square is about the mean length."""
    mean = _integral(time, length) / (time[-1] - time[0]) if len(time) > 1 else length[0]
    return {
        "leg_length_min": Need("m", length.min(axis=0)),
        "leg_length_max": Need("m", length.max(axis=0)),
        "stroke": Need("m", np.ptp(length, axis=0)),
        "stroke_rms": Need("m", _rms(time, length - mean)),
        "distance": Need("m", np.abs(np.diff(length, axis=0)).sum(axis=0)),
    }


def _peak(name: str, unit: str, values: FloatArray, time: FloatArray, **beside: FloatArray) -> dict[str, Need]:
    """The value (n, 6) of largest magnitude, what else there was at that time, and the root mean square."""
    row, leg = first_of_largest(np.abs(values)), np.arange(6)  # NaN is the largest
    known = np.isfinite(values[row, leg])
    figures = {f"{name}_peak": Need(unit, values[row, leg])}
    for companion, at in beside.items():
        its_unit = {"velocity": "m/s", "force": "N"}[companion]
        figures[f"{name}_peak_{companion}"] = Need(its_unit, np.where(known, at[row, leg], np.nan))
    figures[f"{name}_peak_time"] = Need("s", np.where(known, time[row], np.nan))
    figures[f"{name}_rms"] = Need(unit, _rms(time, values))
    return figures


def _integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """∫ x dt (6,) of values (n, 6), by the trapezoidal rule."""
    return np.asarray((np.diff(time)[:, None] * (values[1:] + values[:-1]) / 2).sum(axis=0))


def _rms(time: FloatArray, values: FloatArray) -> FloatArray:
    """√(∫ x² dt/T) (6,)."""
    if len(time) < 2:
        return np.asarray(np.abs(values[0]))
    return np.asarray(np.sqrt(_integral(time, values**2) / (time[-1] - time[0])))


def _integral_of_positive(time: FloatArray, values: FloatArray) -> FloatArray:
    """∫ max(x, 0) dt (6,) of values (n, 6), linear between rows."""
    first, last, h = values[:-1], values[1:], np.diff(time)[:, None]
    high, span = np.maximum(first, last), np.abs(last - first)
    crosses = first * last < 0
    triangle = np.maximum(high, 0.0) ** 2 / (2 * np.where(crosses, span, 1.0))
    trapezoid = (np.maximum(first, 0.0) + np.maximum(last, 0.0)) / 2
    return np.asarray((h * np.where(crosses, triangle, trapezoid)).sum(axis=0))


def _notes(platform: Platform, time: FloatArray, length: FloatArray, velocity: FloatArray) -> list[str]:
    notes = ["nominal model, without load and without reserve for the controller"]
    missing = {
        "friction": not (platform.leg_viscous_friction or platform.leg_coulomb_friction),
        "inertia of motors and screws (leg_armature)": not platform.leg_armature,
    }
    absent = " and no ".join(name for name, is_missing in missing.items() if is_missing)
    if absent:
        notes.append(f"the platform states no {absent}, so forces and powers have none")
    if platform.leg_stiffness:
        notes.append("speeds and powers are those of rigid legs; springs let the motors move otherwise, as a run shows")
    steps = np.diff(length, axis=0)
    by_velocity = np.diff(time)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    unexplained = np.abs(steps - by_velocity).max(axis=1, initial=0.0)
    jump = unexplained > _JUMP * np.ptp(length, axis=0).max()
    if jump.any():
        notes.append(
            f"the reference jumps at {time[1:][jump][0]:.6g} s, or moves much between two rows: what that needs is not "
            "in these figures"
        )
    return notes

"""The share of every limit of a platform that a motion uses: 1 is at the limit."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.motion.motion import Motion, distinct_rows
from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER, Acceleration, inverse_dynamics
from gough_stewart.model.interface import State
from gough_stewart.model.kinematics import (
    LARGEST_PITCH,
    LegGeometry,
    condition_number_bound,
    conditioning_of_legs,
    jacobian_of_legs,
    joint_angles,
    leg_accelerations,
    leg_geometry,
    rates_of_legs,
    side_of_singular_poses,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray, first_of_largest

# Of the leg Jacobian with angles scaled to lengths; a motion with a larger one is too close to a singular pose.
WORST_CONDITION_NUMBER = 100.0
# Limits of the poses alone; a slower motion or stronger actuators do not help.
GEOMETRIC = ("pitch", "condition_number", "side", "stroke", "joint_angle_max")
# Limits of speed and effort, of which a margin can be reserved.
DYNAMIC = ("leg_velocity_max", "leg_acceleration_max", "actuator_force_max", "actuator_power_max")
# What they limit.
LOADS = ("velocity", "acceleration", "force", "power")
_UNITS = ("m/s", "m/s²", "N", "W")
# Limits that a platform may state or not.
OPTIONAL = ("stroke", "joint_angle_max", *DYNAMIC)
# Names for tables and figures.
LABELS = {
    "stroke": "stroke",
    "joint_angle_max": "joint angle",
    "leg_velocity_max": "leg velocity",
    "leg_acceleration_max": "leg acceleration",
    "actuator_force_max": "force",
    "actuator_power_max": "power",
    "condition_number": "condition number",
    "pitch": "pitch",
    "side": "singular pose",
}


def loads_of_legs(
    platform: Platform,
    motion: Motion,
    legs: LegGeometry,
    regular: NDArray[np.bool_] | None = None,  # rows (n,) in which the legs can hold the pose; all by default
    names: Collection[str] = LOADS,
) -> dict[str, FloatArray]:
    """What a motion asks of the legs, each (n, 6): `velocity` L̇ [m/s], `acceleration` L̈ [m/s²], `force` F [N], `power`.

    Forces are those of inverse dynamics without external forces; 0 where legs cannot hold the pose. Power is F L̇ [W].
    """
    state, loads = State(*motion[:4]), dict[str, FloatArray]()
    if not {"velocity", "power"}.isdisjoint(names):
        loads["velocity"] = np.asarray(rates_of_legs(legs, state).length_rate)
    if "acceleration" in names:
        loads["acceleration"] = leg_accelerations(legs, state, *motion[4:])
    if not {"force", "power"}.isdisjoint(names):
        rows = motion if regular is None else [part[regular] for part in motion]
        loads["force"] = force = np.zeros((len(motion.position), 6))
        if len(rows[0]):
            of_rows = inverse_dynamics(platform, State(*rows[:4]), Acceleration(*rows[4:]))
            force[slice(None) if regular is None else regular] = of_rows
    if "power" in names:
        loads["power"] = loads["force"] * loads["velocity"]
    return loads


class Beyond(NamedTuple):
    """The first point where a limit is exceeded."""

    row: int
    leg: int | None  # from 1; None if the limit is of the whole platform
    value: float
    text: str  # quantity, leg, value and what was expected


class Limited(NamedTuple):
    """A quantity of a motion with its lower and upper limit."""

    limit: str  # the name of a limit of the platform, or one of `GEOMETRIC`
    quantity: str
    unit: str
    values: FloatArray  # (n,), or per leg (n, 6)
    low: float | FloatArray  # for all, or per leg (6,)
    high: float | FloatArray
    middle: float | FloatArray = 0.0  # the value at which the share is 0

    @property
    def within(self) -> NDArray[np.bool_]:
        """Where the values are within the limits; false for NaN."""
        return (self.values >= self.low) & (self.values <= self.high)

    @property
    def first_beyond(self) -> Beyond:
        """The first row outside the limits."""
        outside = ~self.within
        row = int(outside.any(axis=tuple(range(1, outside.ndim))).argmax())
        leg = int(outside[row].argmax()) + 1 if self.values.ndim == 2 else None
        value = float(self.values[row, leg - 1] if leg else self.values[row])
        of_leg = f" of leg {leg}" if leg else ""
        unit = f" {self.unit}" if self.unit else ""
        low, high = (float(np.ravel(end)[leg - 1 if leg and np.size(end) > 1 else 0]) for end in (self.low, self.high))
        expected = f"{low:g} to {high:g}" if low < high else f"{low:g}"
        return Beyond(row, leg, value, f"{self.quantity}{of_leg} is {value:.6g}{unit}; expected {expected}{unit}")

    @property
    def share(self) -> FloatArray:
        """|x − middle| / (high − middle), or low / x without an upper limit; infinite for NaN."""
        with np.errstate(all="ignore"):
            if np.all(self.low == self.high):
                share = np.where(self.values == self.low, 0.0, np.inf)
            elif np.isfinite(self.high).all():
                share = np.abs(self.values - self.middle) / (self.high - self.middle)
            else:
                share = self.low / self.values
        return np.where(np.isnan(share), np.inf, share)


class Peak(NamedTuple):
    """The largest share of a limit."""

    limit: str
    share: float
    time: float  # [s]
    leg: int | None  # from 1; None if the limit is of the whole platform


@dataclass(frozen=True, eq=False)
class Shares:
    """The shares of all limits along a motion."""

    time: FloatArray  # (n,) [s]
    limited: tuple[Limited, ...]

    @cached_property
    def of(self) -> dict[str, FloatArray]:
        """By limit, (n, 6) per leg or (n,); for joint angles, the larger of a leg's two."""
        by_limit: dict[str, FloatArray] = {}
        for limited in self.limited:
            share = limited.share
            by_limit[limited.limit] = np.maximum(by_limit[limited.limit], share) if limited.limit in by_limit else share
        return by_limit

    @cached_property
    def over_time(self) -> dict[str, FloatArray]:
        """By limit, the largest over all legs (n,)."""
        return {name: share if share.ndim == 1 else share.max(axis=1) for name, share in self.of.items()}

    @cached_property
    def total(self) -> FloatArray:
        """The largest share over all limits (n,)."""
        return np.asarray(np.max(list(self.over_time.values()), axis=0))

    @property
    def within(self) -> bool:
        """Whether all limits are kept."""
        return all(bool(limited.within.all()) for limited in self.limited)

    def peak(self, limit: str, leg: int | None = None) -> Peak:
        """The largest share of a limit, for one leg (from 1) or all, at the first time at which it occurs."""
        share = self.of[limit]
        if share.ndim == 1:
            return Peak(limit, float(share.max()), float(self.time[first_of_largest(share)]), None)
        if leg is None:
            leg = int(first_of_largest(share.max(axis=0))) + 1
        of_leg = share[:, leg - 1]
        return Peak(limit, float(of_leg.max()), float(self.time[first_of_largest(of_leg)]), leg)

    @property
    def largest(self) -> Peak:
        """The largest share over all limits."""
        peaks = [self.peak(name) for name in self.of]
        return peaks[int(first_of_largest(np.array([peak.share for peak in peaks])))]


def shares_along(
    platform: Platform, time: FloatArray, motion: Motion, largest_condition_number: float = WORST_CONDITION_NUMBER
) -> Shares:
    """The shares that a motion, with rows at times (n,) [s], uses of the platform's and of the geometric limits.

    - `pitch`: |β| relative to ±90°; `side`: of the singular poses, 0 on home's side, infinite on the other;
      `condition_number`: of the leg Jacobian with angles scaled to lengths, relative to the largest allowed;
    - `stroke`: |L − middle| relative to half the stroke, or relative to the one limit that is stated;
    - `joint_angle_max`: the larger angle of a leg's two joints from home;
    - `leg_velocity_max`, `leg_acceleration_max`: |L̇| and |L̈|;
    - `actuator_force_max`, `actuator_power_max`: |F| and |F L̇|, F by inverse dynamics without external forces.
    """
    rows, of_row = distinct_rows(motion)
    pose = (rows.position, rows.orientation)
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction; its condition number is not finite
        legs = leg_geometry(platform, *pose)
        condition_number = condition_number_bound(jacobian_of_legs(legs, scaled=True))
        if not (condition_number <= largest_condition_number).all():
            condition_number = np.asarray(conditioning_of_legs(legs).condition_number)
        side = side_of_singular_poses(platform, legs)
        pitch = float(np.nextafter(LARGEST_PITCH, 0.0))  # the plant refuses LARGEST_PITCH itself
        name = "the condition number of the leg Jacobian"
        limited = [
            Limited("pitch", "the pitch", "rad", rows.orientation[:, 1], -pitch, pitch),
            Limited("condition_number", name, "", condition_number, 1.0 - 1e-9, largest_condition_number),
            Limited("side", "the side of the singular poses (sign of det J against home)", "", side, 1.0, 1.0),
        ]
        low, high = platform.leg_length_min, platform.leg_length_max
        if low is not None or high is not None:
            middle = 0.0 if low is None or high is None else (low + high) / 2
            ends = (0.0 if low is None else low, np.inf if high is None else high)
            limited.append(Limited("stroke", "the length", "m", np.asarray(legs.length), *ends, middle))
        if platform.joint_angle_max is not None:
            angles = joint_angles(platform, *pose, platform.home_position, platform.home_orientation)
            for where, values in zip(("base", "platform"), angles, strict=True):
                quantity = f"the angle of the {where} joint"
                limited.append(Limited("joint_angle_max", quantity, "rad", values, 0.0, platform.joint_angle_max))
        stated = [
            (*kind, most)
            for kind in zip(LOADS, DYNAMIC, _UNITS, strict=True)
            if (most := getattr(platform, kind[1])) is not None
        ]
        regular = condition_number < LARGEST_CONDITION_NUMBER
        loads = loads_of_legs(platform, rows, legs, regular, [name for name, *_ in stated])
        for name, limit, unit, most in stated:
            limited.append(Limited(limit, f"the {name}", unit, loads[name], -most, most))
    return Shares(time, tuple(quantity._replace(values=quantity.values[of_row]) for quantity in limited))

"""Ranges of what comes in: measurements and references outside of them are faults, not poses of this platform."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.motion.limits.reach import LegMotion
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import Variable
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import SHORTEST_LEG
from gough_stewart.model.vectors import FloatArray

# Of the width of the range of lengths, at both ends: sensors have offsets, and legs overshoot.
MARGIN = 0.1


class Range(NamedTuple):
    """Lowest and highest values of a variable's elements; each (size,)."""

    low: FloatArray
    high: FloatArray


class Ranges(NamedTuple):
    """Where measurements and references can be."""

    leg_length: tuple[float, float]  # [m], with the margin
    is_of_stroke: bool  # otherwise of the poses at which the legs exist
    position: Range  # [m]
    sample_time: float  # [s]

    def of(self, variable: Variable) -> Range:
        """The range of a signal, by the name of the interface.

        Rates are those that cross the whole range within one sample, accelerations those that reverse them.
        """
        name, T = variable.name, self.sample_time
        if name == "leg_length":
            low, high = self.leg_length
            return Range(np.full(6, low), np.full(6, high))
        if name == "position":
            return self.position
        if name == "orientation":
            # a platform cannot make a full turn, but roll and yaw may be counted on beyond half a turn
            largest = np.array([2 * np.pi, np.pi / 2, 2 * np.pi])
            return Range(-largest, largest)
        width = {
            "leg_velocity": np.full(6, self.leg_length[1] - self.leg_length[0]),
            "velocity": self.position.high - self.position.low,
            "acceleration": 2 * (self.position.high - self.position.low) / T,
            "angular_velocity": np.full(3, 2 * np.pi),
            "angular_acceleration": np.full(3, 4 * np.pi / T),
        }[name]
        return Range(-width / T, width / T)

    def joined(self, variables: Iterable[Variable]) -> Range:
        """The ranges of several signals, one after the other."""
        found = [self.of(variable) for variable in variables]
        empty = [np.zeros(0)]
        return (
            Range(*(np.concatenate([*parts, *empty]) for parts in zip(*found, strict=True)))
            if found
            else Range(*2 * empty)
        )


def ranges_of(platform: Platform, sample_time: float, legs: LegMotion | None) -> Ranges:
    """The ranges for a platform that follows a motion of its legs.

    Leg lengths are those of the stroke and of the motion, with a margin. Where the platform states no end of its
    stroke, legs are as long as they can be while the platform frame is within a mean leg length of home, in any
    orientation; at that distance a closed loop counts as lost. They are never as short as a collapsed leg, so a
    length of 0 is out of range. Positions are those whose joints such legs reach, B_i ± (L + |p_i|) for every leg.
    """
    home = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    arms = np.linalg.norm(platform.platform_points, axis=1)
    collapsed = SHORTEST_LEG * platform.characteristic_length
    low, high = platform.leg_length_min, platform.leg_length_max
    away = float(home.mean())
    shortest = collapsed if low is None else low
    longest = float((home + 2 * arms).max()) + away if high is None else high
    if legs is not None:
        shortest, longest = min(shortest, float(legs.leg_length.min())), max(longest, float(legs.leg_length.max()))
    margin = MARGIN * (longest - shortest)
    ends = max(shortest - margin, collapsed), longest + margin
    reach = (ends[1] + arms)[:, None]
    position = Range((platform.base_points - reach).max(axis=0), (platform.base_points + reach).min(axis=0))
    return Ranges(ends, low is not None and high is not None, position, sample_time)


def words_of_ranges(variables: Iterable[Variable], ranges: Ranges) -> str:
    """The ranges of signals, for the header of the C source."""
    texts = []
    for v in variables:
        low, high = ranges.of(v)
        ends = [f"{a:.6g} to {b:.6g}" for a, b in zip(low, high, strict=True)]
        # once for all elements, if it is the same
        texts.append(f"{v.name} {ends[0] if len(set(ends)) == 1 else ', '.join(ends)} {v.unit}")
    return "; ".join(texts) or "none, since nothing comes in"

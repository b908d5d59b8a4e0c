"""Scaled motions, slower or smaller, with exact rates and accelerations."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.motion.motion import Motion, Reference, coordinates_of, end_of, motion_of
from gough_stewart.model.operations import numbers_or_symbols
from gough_stewart.model.vectors import FloatArray


@dataclass(frozen=True, eq=False)
class Scaled:
    """A motion that is slower and smaller: pose₀ + a (pose(t/s) − pose₀), angles as roll, pitch, yaw."""

    reference: Reference
    time_scale: float = 1.0  # s > 0
    amplitude_scale: float = 1.0  # a

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""
        motion = slower(self.reference(numbers_or_symbols(time) / self.time_scale), self.time_scale)
        return motion if self.amplitude_scale == 1 else smaller(motion, self.amplitude_scale, self.centre)

    @property
    def end(self) -> float:
        """The last defined time [s]."""
        return end_of(self.reference) * self.time_scale

    @cached_property
    def centre(self) -> FloatArray:
        """pose₀ (6,)."""
        return centre_of(self.reference)


def centre_of(reference: Reference) -> FloatArray:
    """The pose (6,) about which amplitudes are scaled: a reference's `centre`, or else its first pose."""
    own: Any = getattr(reference, "centre", None)
    if own is not None:
        return np.asarray(own, dtype=float)
    return pose_at_start(reference(np.zeros(1)))


def pose_at_start(motion: Motion) -> FloatArray:
    """The pose (6,) of a motion's first row."""
    return np.concatenate([motion.position[0], motion.orientation[0]])


def slower(motion: Motion, scale: float) -> Motion:
    """The same poses s times later: v/s, ω/s, v̇/s², ω̇/s²."""
    if scale == 1:
        return motion
    position, orientation, *rates = motion
    velocity, spin, acceleration, angular = rates
    return Motion(position, orientation, velocity / scale, spin / scale, acceleration / scale**2, angular / scale**2)


def smaller(motion: Motion, scale: float, centre: FloatArray) -> Motion:
    """All deviations from a pose (6,) times a, in position and in roll, pitch, yaw."""
    pose, rate, acceleration = coordinates_of(motion)
    return motion_of(centre + scale * (pose - centre), scale * rate, scale * acceleration)

"""A motion of the platform frame: poses with their exact first and second derivatives."""

from typing import Any, NamedTuple, Protocol

from numpy.typing import ArrayLike

from gough_stewart.model.rotations import (
    angular_acceleration_from_orientation_rates,
    angular_velocity_from_orientation_rate,
)
from gough_stewart.model.vectors import FloatArray

# Times are multiples of a step up to rounding: a jump at 0.2 s has happened in the row of 0.19999999999 s [s].
ROUNDING = 1e-9


class Motion(NamedTuple):
    """A motion of the platform frame at n times; each (n, 3)."""

    position: FloatArray  # [m]
    orientation: FloatArray  # roll, pitch, yaw [rad]
    velocity: FloatArray  # [m/s]
    angular_velocity: FloatArray  # world components [rad/s]
    acceleration: FloatArray  # [m/s²]
    angular_acceleration: FloatArray  # world components [rad/s²]


class Reference(Protocol):
    """A wanted motion."""

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s]."""


def motion_of(pose: Any, rate: Any, acceleration: Any) -> Motion:
    """The motion that (n, 6) of x, y, z, roll, pitch, yaw and their first and second derivatives are."""
    angles, rates, accelerations = pose[:, 3:], rate[:, 3:], acceleration[:, 3:]
    return Motion(
        pose[:, :3],
        angles,
        rate[:, :3],
        angular_velocity_from_orientation_rate(angles, rates),
        acceleration[:, :3],
        angular_acceleration_from_orientation_rates(angles, rates, accelerations),
    )

"""State and inputs of the platform, the arguments of the equations."""

from typing import NamedTuple, Self

from gough_stewart.model.vectors import Array, concatenate


class State(NamedTuple):
    """Minimal state, 12 numbers: pose and twist of the platform frame."""

    position: Array
    """Of Op in world (..., 3) [m]."""
    orientation: Array
    """Roll, pitch, yaw about fixed X, Y, Z (..., 3) [rad]."""
    velocity: Array
    """Of Op in world (..., 3) [m/s]."""
    angular_velocity: Array
    """In world components (..., 3) [rad/s]."""

    @classmethod
    def from_vector(cls, x: Array) -> Self:
        """Split a vector x (..., 12) in SI units [m, rad, m/s, rad/s]."""
        return cls(x[..., :3], x[..., 3:6], x[..., 6:9], x[..., 9:])

    def to_vector(self) -> Array:
        """Concatenate to a vector (..., 12) in SI units [m, rad, m/s, rad/s]; leading axes broadcast."""
        return concatenate(self)


class Inputs(NamedTuple):
    """External forces: six actuators and one wrench at Op in world components."""

    actuator_force: Array  # (..., 6) [N], positive extends the leg
    external_force: Array  # (..., 3) [N]
    external_torque: Array  # (..., 3) [N m], about Op

    @classmethod
    def from_vector(cls, u: Array) -> Self:
        """Split a (..., 12) vector."""
        return cls(u[..., :6], u[..., 6:9], u[..., 9:])

    def to_vector(self) -> Array:
        """Join to a (..., 12) vector; leading axes broadcast."""
        return concatenate(self)

"""What a motion asks of the legs, and whether the platform can reach it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER, Acceleration, inverse_dynamics
from gough_stewart.model.kinematics import (
    condition_number_bound,
    conditioning_of_legs,
    joint_angles,
    leg_geometry,
    rates_of_legs,
    scaled_jacobian_of_legs,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH, side_of_singular_poses
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

# Of the leg Jacobian with angles scaled to lengths; a motion that comes as near to a singular pose is refused.
WORST_CONDITION_NUMBER = 100.0


class LegMotion(NamedTuple):
    """A motion of the legs at n times; each (n, 6)."""

    leg_length: FloatArray  # [m]
    leg_velocity: FloatArray  # [m/s]


class _Bound(NamedTuple):
    """A quantity (n,) or (n, 6) that has to stay from low to high."""

    quantity: str
    unit: str
    values: FloatArray
    low: float
    high: float


def legs_of(platform: Platform, motion: Motion) -> LegMotion:
    """Leg lengths and velocities of a motion, by inverse kinematics."""
    legs = leg_geometry(platform, motion.position, motion.orientation)
    rates = rates_of_legs(legs, State(*motion[:4]))
    return LegMotion(np.asarray(legs.length), np.asarray(rates.length_rate))


def check_reach(
    platform: Platform, time: FloatArray, motion: Motion, largest_condition_number: float = WORST_CONDITION_NUMBER
) -> None:
    """Refuse a motion that leaves stroke, joint angles, velocity or power, or comes near a singular pose.

    Power is that of the forces by inverse dynamics which give the platform this motion without a load.

    Parameters
    ----------
    time
        Of the motion's rows (n,) [s].
    largest_condition_number
        Of the leg Jacobian with angles scaled to lengths.

    Raises
    ------
    ReachError
        Names the first time at which a limit is passed, the quantity, its value, and the leg.
    """
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction; its condition number is not finite
        bounds = _bounds(platform, motion, largest_condition_number)
    first: tuple[int, _Bound, NDArray[np.bool_]] | None = None
    for bound in bounds:
        outside = ~((bound.values >= bound.low) & (bound.values <= bound.high))  # NaN is outside
        rows = np.flatnonzero(outside.any(axis=tuple(range(1, outside.ndim))))
        if rows.size and (first is None or rows[0] < first[0]):
            first = (int(rows[0]), bound, outside)
    if first is None:
        return
    row, bound, outside = first
    per_leg = bound.values.ndim == 2
    leg = int(outside[row].argmax()) + 1 if per_leg else None
    value = float(bound.values[row, leg - 1] if leg else bound.values[row])
    of_leg = f" of leg {leg}" if leg else ""
    unit = f" {bound.unit}" if bound.unit else ""
    expected = f"{bound.low:g} to {bound.high:g}" if bound.low < bound.high else f"{bound.low:g}"
    raise ReachError(
        f"the reference cannot be reached: at time {time[row]:.6g} s {bound.quantity}{of_leg} is {value:.6g}{unit}; "
        f"expected {expected}{unit}; make the motion smaller, or move where it happens",
        float(time[row]),
        bound.quantity,
        value,
        leg,
    )


def _bounds(platform: Platform, motion: Motion, largest_condition_number: float) -> list[_Bound]:
    pose = (motion.position, motion.orientation)
    legs = leg_geometry(platform, *pose)
    condition_number = condition_number_bound(scaled_jacobian_of_legs(legs)[0])
    if not (condition_number <= largest_condition_number).all():
        condition_number = np.asarray(conditioning_of_legs(legs).condition_number)
    side = side_of_singular_poses(platform, legs)
    pitch = float(np.nextafter(LARGEST_PITCH, 0.0))  # at LARGEST_PITCH itself the plant refuses
    bounds = [
        _Bound("the pitch", "rad", motion.orientation[:, 1], -pitch, pitch),
        _Bound(
            "the condition number of the leg Jacobian",
            "",
            condition_number,
            1.0 - 1e-9,
            largest_condition_number,
        ),
        _Bound("the side of the singular poses (sign of det J against home)", "", side, 1.0, 1.0),
    ]
    low, high = platform.leg_length_min, platform.leg_length_max
    if low is not None or high is not None:
        stroke = (0.0 if low is None else low, np.inf if high is None else high)
        bounds.append(_Bound("the length", "m", np.asarray(legs.length), *stroke))
    if platform.joint_angle_max is not None:
        angles = joint_angles(platform, *pose, platform.home_position, platform.home_orientation)
        for where, values in zip(("base", "platform"), angles, strict=True):
            bounds.append(_Bound(f"the angle of the {where} joint", "rad", values, 0.0, platform.joint_angle_max))
    fastest, strongest = platform.leg_velocity_max, platform.actuator_power_max
    velocity = np.asarray(rates_of_legs(legs, State(*motion[:4])).length_rate)
    if fastest is not None:
        bounds.append(_Bound("the velocity", "m/s", velocity, -fastest, fastest))
    if strongest is not None:
        power = velocity * _forces_of(platform, motion, condition_number < LARGEST_CONDITION_NUMBER)
        bounds.append(_Bound("the power", "W", power, -strongest, strongest))
    return bounds


def _forces_of(platform: Platform, motion: Motion, regular: NDArray[np.bool_]) -> FloatArray:
    """Actuator forces (n, 6) that give the motion; 0 where the legs cannot hold the pose, which is refused for that."""
    forces = np.zeros((len(regular), 6))
    if regular.any():
        rows = [part[regular] for part in motion]
        forces[regular] = inverse_dynamics(platform, State(*rows[:4]), Acceleration(*rows[4:]))
    return forces

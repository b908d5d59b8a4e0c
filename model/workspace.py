"""Workspace analysis at poses: reachability, conditioning and static load capacity.

All functions are NumPy only and broadcast over leading axes of poses.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER, bias_wrench
from gough_stewart.model.kinematics import (
    LegGeometry,
    conditioning_of_legs,
    jacobian_of_legs,
    joint_angles,
    leg_geometry,
    scaled_jacobian_of_legs,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH, side_of_singular_poses
from gough_stewart.model.state import State
from gough_stewart.model.stiffness import pose_stiffness
from gough_stewart.model.vectors import Array, FloatArray, apply, transpose

# Poses per chunk: enough for fast NumPy loops, with tens of MB of intermediate results.
CHUNK = 4096


class Limit(IntEnum):
    """The limit that makes a pose unreachable; if there are several, the first in this order."""

    NONE = 0
    PITCH = 1
    SINGULAR = 2
    LEG_TOO_SHORT = 3
    LEG_TOO_LONG = 4
    BASE_JOINT = 5
    PLATFORM_JOINT = 6

    @property
    def text(self) -> str:
        """Description of the limit."""
        return _TEXTS[self]


_TEXTS = {
    Limit.NONE: "reachable",
    Limit.PITCH: "pitch at ±90°",
    Limit.SINGULAR: "beyond a singular pose",
    Limit.LEG_TOO_SHORT: "a leg too short",
    Limit.LEG_TOO_LONG: "a leg too long",
    Limit.BASE_JOINT: "angle of a base joint",
    Limit.PLATFORM_JOINT: "angle of a platform joint",
}


class PoseQualities(NamedTuple):
    """Results at poses, each (...); None if the platform does not state the limit, or has rigid legs."""

    limit: NDArray[np.int8]  # a `Limit`, 0 if the pose is reachable
    leg_length_margin: FloatArray | None  # of the leg nearest to an end of its stroke [m], negative beyond
    joint_angle_margin: FloatArray | None  # of the joint nearest to `joint_angle_max` [rad], negative beyond
    singular_margin: FloatArray  # smallest singular value of the scaled leg Jacobian, negative beyond a singular pose
    condition_number: FloatArray  # of the same; infinite at a singular pose
    payload: FloatArray | None  # largest point mass at Op that the actuators hold at rest [kg]
    force_margin: FloatArray | None  # largest force at Op in any direction that they hold at rest [N]
    largest_speed: FloatArray | None  # of the twist [v; ρ ω] in any direction, limited by `leg_velocity_max` [m/s]
    # of legs that give, with motors that hold; see `stiffness.PoseStiffness`
    translational_stiffness: FloatArray | None  # in the softest direction [N/m]
    translational_stiffness_max: FloatArray | None  # in the stiffest [N/m]
    rotational_stiffness: FloatArray | None  # about the softest axis [N m/rad]
    rotational_stiffness_max: FloatArray | None  # about the stiffest [N m/rad]
    first_mode: FloatArray | None  # lowest natural frequency [Hz]

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether the pose is within all limits."""
        return np.asarray(self.limit == Limit.NONE)


def evaluate_poses(
    platform: Platform, position: Array, orientation: Array, progress: Callable[[int], None] | None = None
) -> PoseQualities:
    """Reachability, conditioning and static load capacity at poses.

    A pose is reachable if all leg lengths are between `leg_length_min` and `leg_length_max`, no joint deviates more
    than `joint_angle_max` from its direction in the home pose, |pitch| is below 90°, and det J has the same sign as at
    home (otherwise every path from home passes a singular pose). Payload and force margin are static, for leg forces
    within ±`actuator_force_max`; they are 0 where the actuators cannot hold the platform, and at poses with a condition
    number of J above `LARGEST_CONDITION_NUMBER`. The largest speed is the s for which no leg exceeds
    V = `leg_velocity_max` in any direction of motion with √(|v|² + ρ² |ω|²) = s: s = V/max_i |row_i|, with the rows of
    the scaled leg Jacobian. For translation alone it would be V at every pose.

    Parameters
    ----------
    position, orientation
        Poses (..., 3) [m], [rad]; they broadcast.
    progress
        Called with the number of completed poses.

    Returns
    -------
    PoseQualities
        Arrays with the poses' leading axes, each None if the platform does not state its limit: `limit`, 0 if the
        pose is reachable; `leg_length_margin` [m] and `joint_angle_margin` [rad], negative beyond; `singular_margin`,
        the smallest singular value of the scaled leg Jacobian, negative beyond a singular pose; `condition_number`;
        `payload` [kg]; `force_margin` [N]; `largest_speed` [m/s]. Of legs that give, whose motors hold: the stiffness
        at Op in the softest and the stiffest direction, `translational_stiffness` and `translational_stiffness_max`
        [N/m], `rotational_stiffness` and `rotational_stiffness_max` [N m/rad], and `first_mode`, the lowest natural
        frequency [Hz].

    Examples
    --------
    >>> found = gs.evaluate_poses(gs.load_preset("motion_base"), [[0, 0, 2.0], [0, 0, 3.5]], [0, 0.1, 0])
    >>> found.reachable, found.condition_number, found.payload
    """
    position, orientation = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
    shape = position.shape[:-1]
    positions, orientations = position.reshape(-1, 3), orientation.reshape(-1, 3)
    parts = []
    # without poses, there is one empty chunk
    for first in range(0, max(len(positions), 1), CHUNK):
        here = slice(first, first + CHUNK)
        parts.append(_evaluated(platform, positions[here], orientations[here]))
        if progress is not None:
            progress(min(first + CHUNK, len(positions)))
    columns: list[Any] = [None if c[0] is None else np.concatenate(c) for c in zip(*parts, strict=True)]
    return PoseQualities._make(None if column is None else column.reshape(shape) for column in columns)


def limits_at(platform: Platform, position: Array, orientation: Array) -> NDArray[np.int8]:
    """The `Limit` at poses (..., 3) only, at a third of the cost of `evaluate_poses`."""
    position, orientation = np.broadcast_arrays(np.asarray(position, float), np.asarray(orientation, float))
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        legs = leg_geometry(platform, position, orientation)
        side = side_of_singular_poses(platform, legs)
        leg_margins = _leg_margins(platform, legs)
        joint_margins = _joint_margins(platform, position, orientation)
    return _first_limit(orientation, side, leg_margins, joint_margins)


class LoadCapacity(NamedTuple):
    """Static load capacity of the actuators, each (...)."""

    payload: FloatArray  # [kg]
    force_margin: FloatArray  # [N]


def _evaluated(platform: Platform, position: FloatArray, orientation: FloatArray) -> PoseQualities:
    """Results at poses (n, 3)."""
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        legs = leg_geometry(platform, position, orientation)
        side = side_of_singular_poses(platform, legs)
        number, smallest, _ = conditioning_of_legs(legs)
        leg_margins = _leg_margins(platform, legs)
        joint_margins = _joint_margins(platform, position, orientation)
    capacity: LoadCapacity | tuple[None, None] = (None, None)
    if platform.actuator_force_max is not None:
        regular = number < LARGEST_CONDITION_NUMBER
        capacity = _load_capacity(platform, position, orientation, legs, regular, platform.actuator_force_max)
    stiffness = pose_stiffness(platform, position, orientation) if platform.leg_stiffness > 0 else (None,) * 5
    return PoseQualities(
        _first_limit(orientation, side, leg_margins, joint_margins),
        _nearest([leg_margins[limit] for limit in leg_margins]),
        _nearest([joint_margins[limit] for limit in joint_margins]),
        np.where(side == 1, smallest, -smallest),
        number,
        capacity[0],
        capacity[1],
        None if platform.leg_velocity_max is None else _largest_speed(legs, platform.leg_velocity_max),
        *stiffness,
    )


def _largest_speed(legs: LegGeometry, fastest: float) -> FloatArray:
    """Largest speed at poses (n, 3) [m/s]; 0 if a leg has no direction."""
    with np.errstate(all="ignore"):
        rows, _ = scaled_jacobian_of_legs(legs)
        speed = fastest / np.sqrt((rows * rows).sum(axis=-1)).max(axis=-1)
    return np.asarray(np.nan_to_num(speed))


def _first_limit(
    orientation: FloatArray,
    side: FloatArray,
    leg_margins: dict[Limit, FloatArray],
    joint_margins: dict[Limit, FloatArray],
) -> NDArray[np.int8]:
    kept = {Limit.PITCH: np.abs(orientation[..., 1]) < LARGEST_PITCH, Limit.SINGULAR: side == 1}
    kept |= {limit: margin >= 0 for limit, margin in (leg_margins | joint_margins).items()}
    limit = np.zeros(orientation.shape[:-1], np.int8)
    for each in sorted(kept, reverse=True):
        limit[~kept[each]] = each
    return limit


def _leg_margins(platform: Platform, legs: LegGeometry) -> dict[Limit, FloatArray]:
    """Stroke margin of the worst leg [m]."""
    margins = {}
    if platform.leg_length_min is not None:
        margins[Limit.LEG_TOO_SHORT] = np.asarray(legs.length.min(axis=-1) - platform.leg_length_min)
    if platform.leg_length_max is not None:
        margins[Limit.LEG_TOO_LONG] = np.asarray(platform.leg_length_max - legs.length.max(axis=-1))
    return margins


def _joint_margins(platform: Platform, position: FloatArray, orientation: FloatArray) -> dict[Limit, FloatArray]:
    """Angle margin of the worst joint [rad]."""
    if platform.joint_angle_max is None:
        return {}
    angles = joint_angles(platform, position, orientation, platform.home_position, platform.home_orientation)
    margins = (np.asarray(platform.joint_angle_max - each.max(axis=-1)) for each in angles)
    return dict(zip((Limit.BASE_JOINT, Limit.PLATFORM_JOINT), margins, strict=True))


def _nearest(margins: list[FloatArray]) -> FloatArray | None:
    return np.minimum.reduce(margins) if margins else None


def _load_capacity(
    platform: Platform,
    position: FloatArray,
    orientation: FloatArray,
    legs: LegGeometry,
    regular: NDArray[np.bool_],
    largest_force: float,
) -> LoadCapacity:
    """Largest payload and largest force in any direction that leg forces within ±`largest_force` hold at rest.

    With A = J⁻ᵀ[:, :3] and the static leg forces f0, a force f at Op requires leg forces f0 − A f. A point mass m at Op
    adds m f1, f1 = −A g, so m = min_i (F − sign(f1_i) f0_i)/|f1_i|, which is infinite if no leg force changes. The
    worst direction for leg i is ±A_i, so the force margin is min_i (F − |f0_i|)/|A_i|. Both are 0 where |f0_i| > F for
    some leg, and at poses that are not `regular`.
    """
    payload, margin = np.zeros(regular.shape), np.zeros(regular.shape)
    rest = np.zeros((np.count_nonzero(regular), 3))
    # at rest the bias wrench is the weight of platform and legs, which the actuators hold
    held = bias_wrench(platform, State(position[regular], orientation[regular], rest, rest))
    unit_forces = np.broadcast_to(np.eye(6)[:, :3], (len(rest), 6, 3))
    J = jacobian_of_legs(LegGeometry(*(part[regular] for part in legs)))
    forces = np.linalg.solve(transpose(J), np.concatenate([held[..., None], unit_forces], axis=-1))
    f0, A = forces[..., 0], forces[..., 1:]
    f1 = -apply(A, platform.gravity)
    holds = (np.abs(f0) <= largest_force).all(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # 0/0: the leg is already at its limit, and the load does not change its force
        masses = np.where(f1 == 0, np.inf, (largest_force - np.sign(f1) * f0) / np.abs(f1))
        reserves = (largest_force - np.abs(f0)) / np.sqrt((A * A).sum(axis=-1))
    payload[regular] = np.where(holds, masses.min(axis=-1), 0.0)
    margin[regular] = np.where(holds, np.where(np.isnan(reserves), np.inf, reserves).min(axis=-1), 0.0)
    return LoadCapacity(payload, margin)

"""Limits of the pose: leg length 0, a pitch of ±90°, a singular leg Jacobian."""

import numpy as np

from gough_stewart.model.errors import StepError
from gough_stewart.model.kinematics import (
    LegGeometry,
    condition_number_bound,
    conditioning_of_legs,
    handedness_of_legs,
    leg_geometry,
    scaled_jacobian_of_legs,
)
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.vectors import Array, FloatArray

# 0.06° below the singular pitch of 90° [rad].
LARGEST_PITCH = np.pi / 2 - 1e-3
# A shorter leg has collapsed; as a fraction of the platform's characteristic length.
SHORTEST_LEG = 1e-3
# Of the leg Jacobian with angles scaled to lengths; above this, the pose is practically singular.
SINGULAR_CONDITION_NUMBER = 1e8
PITCHED, COLLAPSED = "the pitch has reached ±90°", "the leg has collapsed"


def check_pose(platform: PlatformFields, x: Array, time: float, handedness: float | None = None) -> float:
    """Raise `StepError` if the pose of a state x (12,), or longer, is beyond a limit; returns the sign of det J.

    It changes at singular poses; `handedness` is the one at an earlier state of the same motion.
    """
    position, orientation = x[:3], x[3:6]
    if not abs(orientation[1]) < LARGEST_PITCH:
        raise StepError("orientation[2]", float(orientation[1]), time, PITCHED)
    legs = leg_geometry(platform, position, orientation)
    leg = int(legs.length.argmin())
    if not legs.length[leg] > SHORTEST_LEG * platform.characteristic_length:
        raise StepError(f"leg_length[{leg + 1}]", float(legs.length[leg]), time, COLLAPSED)
    scaled, _ = scaled_jacobian_of_legs(legs)
    sign = float(np.sign(np.linalg.det(scaled)))
    passed = handedness is not None and sign != handedness
    # the condition number itself would take longer than everything else here
    if passed or not condition_number_bound(scaled) < SINGULAR_CONDITION_NUMBER:
        number = float(conditioning_of_legs(legs).condition_number)
        if passed or not number < SINGULAR_CONDITION_NUMBER:
            raise singular_pose(number, time, passed=passed)
    return sign


def singular_pose(condition_number: float, time: float, *, passed: bool) -> StepError:
    """The error for a singular pose, or for one that was `passed` since the last integration step."""
    since = " (passed since the last internal step)" if passed else ""
    return StepError(
        "condition number of the leg Jacobian",
        condition_number,
        time,
        f"the platform has reached a singular pose{since}; the legs cannot hold it there",
    )


def side_of_singular_poses(platform: PlatformFields, legs: LegGeometry) -> FloatArray:
    """Sign of det J relative to that at home (...): 1 for the same sign, −1 for the opposite.

    0 at a singular pose, NaN if a leg has no direction. The same sign is necessary, not sufficient, for a path from
    home without a singular pose.
    """
    home = leg_geometry(platform, platform.home_position, platform.home_orientation)
    return np.asarray(handedness_of_legs(legs) * handedness_of_legs(home))

"""A symmetric platform from two radii, two angles and a leg length: joints in pairs on two circles."""

from typing import Literal, get_args

import numpy as np

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.vectors import FloatArray, real_array

Pairing = Literal["near", "far"]

# The keys with their units; `pairing` is optional.
LENGTHS = ("base_radius", "platform_radius", "home_leg_length")
ANGLES = ("base_angle", "platform_angle")
PAIRING = "pairing"
KEYS = ("base_radius", "platform_radius", "base_angle", "platform_angle", PAIRING, "home_leg_length")
# What they determine.
REPLACED = ("base_points", "platform_points", "home_position", "home_orientation")
_THIRD = 2 * np.pi / 3


def joints_on_circles(
    base_radius: float,
    platform_radius: float,
    base_angle: float,
    platform_angle: float,
    home_leg_length: float,
    pairing: Pairing = "near",
) -> dict[str, FloatArray]:
    """Joints (6, 3) and home pose (3,) [m, rad] of a symmetric platform, by the names of its parameters.

    From the radii R, r [m], the angles a, b between the two joints of a pair [rad], and the length L of the legs [m].

    The base has pairs of joints about the azimuths 0°, 120°, 240° (from X towards Y), the platform about 60°, 180°,
    300°: for the base angle a, platform angle b and the pair k of the base, its joints are at 120° k ± a/2. With
    `pairing` "near" each leg goes to the nearer joint of the pair beside it, a turn of Δ = 60° − (a + b)/2, with "far"
    to the other one, Δ = 60° − (a − b)/2; legs turn alternately to the left and to the right. Legs 1 to 6 are in order
    of their base joints, from a/2 on. Op is in the plane of the platform joints, level with the base at home:

        z = √(L² − R² − r² + 2 R r cos Δ)

    Raises
    ------
    PlatformError
        A number out of its range, or legs that are too short to reach.
    """
    R, r = _positive("base_radius", base_radius), _positive("platform_radius", platform_radius)
    a, b = _positive("base_angle", base_angle), _positive("platform_angle", platform_angle)
    L = _positive("home_leg_length", home_leg_length)
    if pairing not in get_args(Pairing):
        raise PlatformError(PAIRING, f"is {pairing!r}; expected 'near' or 'far'")
    turn = np.pi / 3 - (a + b) / 2 if pairing == "near" else np.pi / 3 - (a - b) / 2
    across = R * R + r * r - 2 * R * r * np.cos(turn)
    if not across < L * L:
        raise PlatformError(
            "home_leg_length",
            f"is {L:g} m; expected more than the {np.sqrt(across):g} m between a base joint and the platform joint "
            "above it, seen from above",
        )
    # leg 2k + 1 turns to the left, leg 2k + 2, from the other end of the next pair of the base, to the right
    pairs = _THIRD * np.arange(3)
    base = np.stack([pairs + a / 2, pairs + _THIRD - a / 2], axis=-1).reshape(6)
    turns = np.tile([turn, -turn], 3)
    level = np.sqrt(L * L - across)
    return {
        "base_points": _on_circle(R, base),
        "platform_points": _on_circle(r, base + turns),
        "home_position": np.array([0.0, 0.0, level]),
        "home_orientation": np.zeros(3),
    }


def _positive(name: str, value: object) -> float:
    unit, unit_text = ("rad", "in radians, ") if name in ANGLES else ("m", "")
    try:
        number = float(real_array(value, ()))
    except ValueError as error:
        raise PlatformError(name, str(error)) from None
    if not number > 0 or (name in ANGLES and not number < _THIRD):
        bounds = f"{unit_text}above 0 and below 2.0944 (120°)" if name in ANGLES else "above 0"
        raise PlatformError(name, f"is {number:g} {unit}; expected a number {bounds}")
    return number


def _on_circle(radius: float, azimuth: FloatArray) -> FloatArray:
    return radius * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(6)], axis=-1)

"""Joints as data sheets state them: on circles, by cylindrical coordinates, listed once with the legs between them."""

from collections.abc import Mapping
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.units import in_si
from gough_stewart.model.vectors import FloatArray, real_array

Pairing = Literal["near", "far"]
# What states joints on circles, in the order of files, and the parameters that it determines.
CIRCLE_KEYS = ("base_radius", "platform_radius", "base_angle", "platform_angle", "pairing", "home_leg_length")
_LENGTHS, _ANGLES = ("base_radius", "platform_radius", "home_leg_length"), ("base_angle", "platform_angle")
ON_CIRCLES = ("base_points", "platform_points", "home_position", "home_orientation")
_THIRD = 2 * np.pi / 3
UNITS_OF_CIRCLES = dict.fromkeys(_LENGTHS, "m") | dict.fromkeys(_ANGLES, "rad")
# Rows of joints by cylindrical coordinates, and the parameter that they determine: base first, as in `legs`.
_CYLINDRICAL = {"base_points_cylindrical": "base_points", "platform_points_cylindrical": "platform_points"}
_COLUMNS = (("radius", "m"), ("angle", "rad"), ("z", "m"))
# Keys of files that determine parameters of a platform.
JOINT_KEYS = (*CIRCLE_KEYS, *_CYLINDRICAL, "legs")


def joints_of_keys(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with joints and home pose in the place of `JOINT_KEYS`; `PlatformError` for keys that do not fit."""
    joints = dict(values)
    circles = {key: joints.pop(key) for key in CIRCLE_KEYS if key in joints}
    if circles:
        first = next(iter(circles))
        if missing := [key for key in CIRCLE_KEYS if key not in circles and key != "pairing"]:
            expected = ", ".join(_LENGTHS + _ANGLES)
            raise PlatformError(first, f"needs {', '.join(missing)} beside it; expected all of {expected}")
        if repeated := [name for name in (*ON_CIRCLES, *_CYLINDRICAL) if name in joints]:
            raise PlatformError(repeated[0], f"is also determined by {first}; expected only one of the two")
        joints |= joints_on_circles(circles)
    for key, name in _CYLINDRICAL.items():
        if key in joints:
            if name in joints:
                raise PlatformError(name, f"is also determined by {key}; expected only one of the two")
            joints[name] = _cartesian(key, joints.pop(key))
    if "legs" in joints:
        rows = _rows_of("legs", joints.pop("legs"), ("base joint", "platform joint"))
        if len(rows) != 6:
            raise PlatformError("legs", f"has {len(rows)} rows; expected six")
        for k, row in enumerate(rows):
            if not all(type(number) is int and number >= 1 for number in row):
                raise PlatformError(f"legs[{k + 1}]", f"is {row}; expected two numbers of joints, from 1")
        pairs = np.array(rows) - 1
        for end, name in enumerate(_CYLINDRICAL.values()):
            if name in joints:
                joints[name] = _taken(name, joints[name], pairs[:, end])
    return joints


def _rows_of(key: str, value: object, columns: tuple[str, ...]) -> list[Any]:
    """Rows of a list with a value for each column; a `PlatformError` names the one that has not."""
    expected = f"a row [{', '.join(columns)}]"
    if not isinstance(value, list) or not value:
        raise PlatformError(key, f"is {value!r}; expected a list with {expected} for each")
    for k, row in enumerate(value):
        if not isinstance(row, list) or len(row) != len(columns):
            raise PlatformError(f"{key}[{k + 1}]", f"is {row!r}; expected {expected}")
    return value


def _cartesian(key: str, value: object) -> FloatArray:
    """Joints (n, 3) [m] from rows of radius, angle from X towards Y, and z: (r cos φ, r sin φ, z)."""
    points = []
    for k, row in enumerate(_rows_of(key, value, ("radius", "angle", "z"))):
        try:
            parts = [in_si(name, part, unit) for (name, unit), part in zip(_COLUMNS, row, strict=True)]
            radius, angle, z = real_array(parts, (3,))
        except ValueError as error:
            raise PlatformError(f"{key}[{k + 1}]", str(error)) from None
        if not radius >= 0:
            raise PlatformError(f"{key}[{k + 1}]", f"has the radius {radius:g} m; expected 0 or more")
        if not abs(angle) <= 2 * np.pi:
            raise PlatformError(
                f"{key}[{k + 1}]",
                f"has the angle {angle:g} rad; expected a full turn at most, or a text, '{angle:g} deg'",
            )
        points.append([radius * np.cos(angle), radius * np.sin(angle), z])
    return np.array(points)


def _taken(name: str, points: Any, numbers: NDArray[np.intp]) -> Any:
    """The joints of the legs (6, 3), by their numbers in a list of joints; each must be some leg's."""
    if not isinstance(points, list | np.ndarray):
        raise PlatformError(name, f"is {points!r}; expected a list of joints")
    if numbers.max() >= len(points):
        leg = int(numbers.argmax())
        raise PlatformError(
            f"legs[{leg + 1}]", f"names joint {numbers[leg] + 1}; {name} has {len(points)}, numbered from 1"
        )
    if idle := sorted({*range(len(points))} - {*numbers.tolist()}):
        raise PlatformError("legs", f"leaves out joint {idle[0] + 1} of {name}; expected a leg at each joint")
    return points[numbers] if isinstance(points, np.ndarray) else [points[number] for number in numbers]


def joints_on_circles(circles: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Joints (6, 3) and home pose (3,) of `Platform.from_radii` by name, from values of `CIRCLE_KEYS`."""
    numbers, pairing = [], circles.get("pairing", "near")
    for name in (*_LENGTHS, *_ANGLES):
        try:
            number = float(real_array(circles[name], ()))
        except ValueError as error:
            raise PlatformError(name, str(error)) from None
        is_angle = name in _ANGLES
        if not (0 <= number < _THIRD if is_angle else number > 0):
            expected = "in radians, from 0 (one joint for both) to below 2.0944 (120°)" if is_angle else "above 0"
            raise PlatformError(name, f"is {number:g} {'rad' if is_angle else 'm'}; expected a number {expected}")
        numbers.append(number)
    R, r, L, a, b = numbers
    if pairing not in get_args(Pairing):
        raise PlatformError("pairing", f"is {pairing!r}; expected 'near' or 'far'")
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
    tips = base + np.tile([turn, -turn], 3)
    return {
        "base_points": R * np.stack([np.cos(base), np.sin(base), np.zeros(6)], axis=-1),
        "platform_points": r * np.stack([np.cos(tips), np.sin(tips), np.zeros(6)], axis=-1),
        "home_position": np.array([0.0, 0.0, np.sqrt(L * L - across)]),
        "home_orientation": np.zeros(3),
    }

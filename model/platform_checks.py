"""Validation of platforms: every check has its own message (value, expectation, remedy); parameters given per leg."""

from collections.abc import Callable, Collection, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import conditioning_of_legs, leg_geometry
from gough_stewart.model.parameters import FACTOR_OF, TABLE, PlatformFields
from gough_stewart.model.pose_limits import LARGEST_PITCH, SINGULAR_CONDITION_NUMBER
from gough_stewart.model.real import real_array
from gough_stewart.model.vectors import Array, FloatArray, dot, without_warnings

# Relative tolerance of symmetry and of the triangle inequality, for rounded published inertias.
INERTIA_SLACK = 1e-9
# Joints closer than this fraction of the largest joint distance coincide.
COINCIDENCE = 1e-6
_BOUNDED = [name for name, row in TABLE.items() if row.lower_bound is not None]


class Joints(NamedTuple):
    """The parameters that the leg geometry needs."""

    base_points: FloatArray
    platform_points: FloatArray


GEOMETRY = ("base_points", "platform_points", "home_position", "home_orientation")


def check(platform: PlatformFields, changed: Collection[str] = TABLE) -> None:
    """Raise `PlatformError` for the first invalid parameter, or combination with one of those that have changed."""
    for name in _BOUNDED:
        value = getattr(platform, name) if name in changed else None
        if value is not None:
            check_bound(name, value)
    for each, names in _CHECKS:
        if not names.isdisjoint(changed):
            each(platform)


def check_bound(name: str, value: float | FloatArray) -> None:
    """Raise `PlatformError` for the first number of a parameter that violates its bound in the table."""
    row = TABLE[name]
    if type(value) is float and value > 0:  # the usual case, a shortcut
        return
    numbers = np.ravel(value)
    for k, number in enumerate(numbers.tolist()):
        if not (number > 0 if row.lower_bound == "> 0" else number >= 0):
            remedy = ", or leave it out" if row.is_optional else ""
            which = f"{name}[{k + 1}]" if numbers.size > 1 else name
            unit = "" if row.unit == "1" else f" {row.unit}"
            raise PlatformError(which, f"is {number:g}{unit}; expected {row.lower_bound}{remedy}: {row.description}")


def check_inertia(platform: PlatformFields) -> None:
    """The platform's inertia is symmetric, positive definite and satisfies the triangle inequality."""
    J, field = platform.platform_inertia, "platform_inertia"
    size = np.abs(J).max()
    asymmetry = np.abs(J - J.T)
    if asymmetry.max() > INERTIA_SLACK * size:
        a, b = (int(i) + 1 for i in np.unravel_index(asymmetry.argmax(), (3, 3)))
        raise PlatformError(
            field,
            f"is not symmetric: [{a},{b}] = {J[a - 1, b - 1]:g} but [{b},{a}] = {J[b - 1, a - 1]:g} kg m²; "
            "set both to the same value (minus the product of inertia)",
        )
    moments = _principal_moments(J.tobytes())
    if not moments[0] > 0:
        raise PlatformError(
            field, f"is not positive definite: principal moments {_list(moments)} kg m²; expected all > 0"
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + INERTIA_SLACK):
        raise PlatformError(
            field,
            f"is unphysical: principal moments {_list(moments)} kg m², the largest exceeds the sum of the others "
            "(triangle inequality); check the units and that they are about the centre of mass",
        )


def check_joints(platform: PlatformFields) -> None:
    """No two joints of base or platform coincide."""
    for field in ("base_points", "platform_points"):
        points = getattr(platform, field)
        i, j, share = _closest_joints(points.tobytes())
        if share <= COINCIDENCE:
            raise PlatformError(
                field,
                f"joints {i + 1} and {j + 1} coincide at {_list(points[i])} m; expected six different points "
                "(an idealised double joint needs a small offset)",
            )


def check_home_pose(platform: PlatformFields) -> None:
    """The home pose has legs of nonzero length, a pitch below 90° and a regular leg Jacobian."""
    pitch = platform.home_orientation[1]
    if not abs(pitch) < LARGEST_PITCH:
        raise PlatformError("home_orientation", f"has pitch {pitch:g} rad; expected less than ±90°")
    lengths, worst = _home_pose(platform)
    shortest = int(lengths.argmin())
    if lengths[shortest] <= COINCIDENCE * np.abs(platform.base_points).max():
        raise PlatformError(
            "home_position",
            f"base joint and platform joint {shortest + 1} coincide in the home pose; raise home_position",
        )
    if not worst < SINGULAR_CONDITION_NUMBER:
        raise PlatformError(
            "base_points, platform_points, home_position, home_orientation",
            f"the leg Jacobian is singular at the home pose (condition number {worst:.3g}, expected below "
            f"{SINGULAR_CONDITION_NUMBER:g}): the legs cannot hold the platform there; choose different azimuths for "
            "base and platform joints or another home pose",
        )


def check_com_offsets(platform: PlatformFields) -> None:
    """Centres of mass are on the legs and near the platform."""
    check_leg_com_offsets(platform, float(_home_pose(platform)[0].min()), "home")
    reach = float(np.sqrt(dot(platform.platform_points, platform.platform_points)).max())
    offset = float(np.sqrt(dot(platform.platform_com, platform.platform_com)))
    if offset > 10 * reach:
        raise PlatformError(
            "platform_com",
            f"is {offset:g} m from Op, more than ten times the farthest platform joint ({reach:g} m); check units",
        )


def check_leg_com_offsets(platform: PlatformFields, shortest: float, pose: str) -> None:
    """The centres of mass of both parts are on the leg, also on the shortest one [m] of a pose."""
    for name, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        value = getattr(platform, name)
        if value > shortest:  # never below 0, by its bound
            raise PlatformError(
                name,
                f"is {value:g} m from the {end} joint; expected between 0 and the shortest leg of the {pose} pose, "
                f"{shortest:g} m",
            )


def check_limits(platform: PlatformFields) -> None:
    """The home pose is within the stroke and joint limits."""
    low, high = platform.leg_length_min, platform.leg_length_max
    lengths, _ = _home_pose(platform)
    if low is not None and high is not None and not low < high:
        raise PlatformError("leg_length_min", f"is {low:g} m; expected below leg_length_max = {high:g} m")
    if low is not None and lengths.min() < low:
        raise PlatformError("leg_length_min", f"is {low:g} m, but a home leg is {lengths.min():g} m long")
    if high is not None and lengths.max() > high:
        raise PlatformError("leg_length_max", f"is {high:g} m, but a home leg is {lengths.max():g} m long")
    if platform.joint_angle_max is not None and platform.joint_angle_max > np.pi:
        raise PlatformError(
            "joint_angle_max",
            f"is {platform.joint_angle_max:g} rad; expected at most π (radians, not degrees)",
        )


# What a check depends on; bounds come first.
_CHECKS: tuple[tuple[Callable[[PlatformFields], None], frozenset[str]], ...] = (
    (check_inertia, frozenset({"platform_inertia"})),
    (check_joints, frozenset({"base_points", "platform_points"})),
    (check_home_pose, frozenset(GEOMETRY)),
    (check_com_offsets, frozenset({*GEOMETRY, "leg_lower_com", "leg_upper_com", "platform_com"})),
    (check_limits, frozenset({*GEOMETRY, "leg_length_min", "leg_length_max", "joint_angle_max"})),
)

# Successive platforms often differ in a few parameters only, so results are cached by the bytes of the arrays.
_REMEMBERED = 64
_MOST_POSES = 1024
_poses: dict[tuple[bytes, ...], tuple[FloatArray, float]] = {}


def remember_home_poses(*geometry: FloatArray) -> None:
    """Evaluate the home poses of many platforms at once, each of `GEOMETRY` with a leading axis (N, ...)."""
    lengths, worst = _evaluated(*geometry)
    keys = zip(*([each.tobytes() for each in part] for part in geometry), strict=True)
    found = zip(lengths, worst.tolist(), strict=True)
    if len(_poses) > _MOST_POSES:
        _poses.clear()
    _poses.update(zip(keys, found, strict=True))


def _home_pose(platform: PlatformFields) -> tuple[FloatArray, float]:
    """Leg lengths (6,) [m] of the home pose, and the condition number of its leg Jacobian."""
    parts = [getattr(platform, name) for name in GEOMETRY]
    key = tuple(part.tobytes() for part in parts)
    if key not in _poses:
        remember_home_poses(*(part[None] for part in parts))
    return _poses[key]


@without_warnings
def _evaluated(
    base_points: FloatArray, platform_points: FloatArray, position: FloatArray, orientation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    joints: Any = Joints(base_points, platform_points)  # all that the geometry needs
    legs = leg_geometry(joints, position, orientation)
    return np.asarray(legs.length), np.asarray(conditioning_of_legs(legs).condition_number)


@lru_cache(_REMEMBERED)
def _closest_joints(joints: bytes) -> tuple[int, int, float]:
    """The two closest of the joints (6, 3), and their distance as a fraction of the largest distance."""
    points = _points(joints)
    distance = np.linalg.norm(points[:, None] - points[None, :], axis=-1)
    i, j = divmod(int((distance + np.diag(np.full(6, np.inf))).argmin()), 6)
    largest = float(distance.max())
    return i, j, float(distance[i, j]) / largest if largest > 0 else 0.0


@lru_cache(_REMEMBERED)
def _principal_moments(inertia: bytes) -> FloatArray:
    return np.asarray(np.linalg.eigvalsh(np.frombuffer(inertia).reshape(3, 3)))


def _points(joints: bytes) -> FloatArray:
    return np.frombuffer(joints).reshape(6, 3)


def _list(values: Array) -> str:
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"


def by_leg(values: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters by name, with six values of a parameter replaced by their mean and six factors.

    `leg_viscous_friction` = (c_1 … c_6) becomes c = Σ c_i / 6 and `leg_viscous_friction_factor` = c_i / c. The
    parameter stays a scalar: in a batch, six values would be ambiguous between six platforms and six legs. All other
    values are unchanged.

    Raises
    ------
    PlatformError
        Six values together with factors, or a value below the bound of the table.
    """
    spread = dict(values)
    for name, factor in FACTOR_OF.items():
        if name not in values or not _is_six(values[name]):
            continue
        if factor in values:
            raise PlatformError(name, f"has six values beside {factor}; expected only one of the two")
        try:
            each = real_array(values[name], (6,))
        except ValueError as error:
            raise PlatformError(name, str(error)) from None
        check_bound(name, each)
        # equal values stay exact, without the rounding of a mean
        mean = float(each.mean()) if np.ptp(each) > 0 else float(each[0])
        spread |= {name: mean, factor: each / mean if mean > 0 else np.ones(6)}
    return spread


def _is_six(value: Any) -> bool:
    """Whether there are six values; other shapes are rejected later, with all other parameters."""
    try:
        return bool(np.shape(value) == (6,))
    except ValueError:  # ragged
        return False

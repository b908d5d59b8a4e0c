"""What makes a platform impossible: every check with its own message (value, expectation, remedy)."""

import numpy as np

from gough_stewart.model.errors import PlatformError
from gough_stewart.model.kinematics import conditioning, leg_geometry
from gough_stewart.model.parameters import TABLE, PlatformFields
from gough_stewart.model.pose_limits import LARGEST_PITCH, SINGULAR_CONDITION_NUMBER
from gough_stewart.model.vectors import Array

# Rounding of published inertias: relative slack of symmetry and of the triangle inequality.
INERTIA_SLACK = 1e-9
# Joints closer than this fraction of their circle are one joint.
COINCIDENCE = 1e-6


def check(platform: PlatformFields) -> None:
    """Raise `PlatformError` at the first thing that no platform can have."""
    check_bounds(platform)
    check_inertia(platform)
    check_joints(platform)
    check_home_pose(platform)
    check_com_offsets(platform)
    check_limits(platform)


def check_bounds(platform: PlatformFields) -> None:
    """No number lies below the bound that the table gives it."""
    for name, row in TABLE.items():
        value = getattr(platform, name)
        if value is None or row.lower_bound is None:
            continue
        if not (value > 0 if row.lower_bound == "> 0" else value >= 0):
            remedy = ", or leave it out" if row.is_optional else ""
            raise PlatformError(name, f"is {value:g} {row.unit}; expected {row.lower_bound}{remedy}: {row.description}")


def check_inertia(platform: PlatformFields) -> None:
    """The platform's inertia is symmetric, positive definite, and that of a body with positive mass."""
    J, field = platform.platform_inertia, "platform_inertia"
    size = np.abs(J).max()
    asymmetry = np.abs(J - J.T)
    if asymmetry.max() > INERTIA_SLACK * size:
        a, b = (int(i) + 1 for i in np.unravel_index(asymmetry.argmax(), (3, 3)))
        raise PlatformError(
            field,
            f"is not symmetric: [{a},{b}] = {J[a - 1, b - 1]:g} but [{b},{a}] = {J[b - 1, a - 1]:g} kg m²; "
            "give both the same value (minus the product of inertia)",
        )
    moments = np.linalg.eigvalsh(J)
    if not moments[0] > 0:
        raise PlatformError(
            field, f"is not positive definite: principal moments {_list(moments)} kg m²; expected all > 0"
        )
    if moments[2] > (moments[0] + moments[1]) * (1 + INERTIA_SLACK):
        raise PlatformError(
            field,
            f"no body has principal moments {_list(moments)} kg m²: the largest exceeds the sum of the others "
            "(triangle inequality); check units, and that they are about the centre of mass",
        )


def check_joints(platform: PlatformFields) -> None:
    """No two joints of one side are in the same place."""
    for field in ("base_points", "platform_points"):
        points = getattr(platform, field)
        distance = np.linalg.norm(points[:, None] - points[None, :], axis=-1)
        i, j = np.unravel_index((distance + np.diag(np.full(6, np.inf))).argmin(), (6, 6))
        if distance[i, j] <= COINCIDENCE * distance.max():
            raise PlatformError(
                field,
                f"joints {i + 1} and {j + 1} coincide at {_list(points[i])} m; expected six places apart "
                "(an idealised double joint needs a small offset)",
            )


def check_home_pose(platform: PlatformFields) -> None:
    """The home pose has legs of some length, a pitch well below 90°, and a regular leg Jacobian."""
    pitch = platform.home_orientation[1]
    if not abs(pitch) < LARGEST_PITCH:
        raise PlatformError("home_orientation", f"has pitch {pitch:g} rad; expected less than ±90°")
    lengths = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    shortest = int(lengths.argmin())
    if lengths[shortest] <= COINCIDENCE * np.abs(platform.base_points).max():
        raise PlatformError(
            "home_position",
            f"base joint and platform joint {shortest + 1} coincide in the home pose; raise home_position",
        )
    worst = float(conditioning(platform, platform.home_position, platform.home_orientation).condition_number)
    if not worst < SINGULAR_CONDITION_NUMBER:
        raise PlatformError(
            "base_points, platform_points, home_position, home_orientation",
            f"the leg Jacobian is singular at the home pose (condition number {worst:.3g}, expected below "
            f"{SINGULAR_CONDITION_NUMBER:g}): the legs cannot hold the platform there; give base and platform "
            "joints different azimuths or choose another home pose",
        )


def check_com_offsets(platform: PlatformFields) -> None:
    """Centres of mass lie on the legs, and near the platform."""
    lengths = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    check_leg_com_offsets(platform, float(lengths.min()), "home")
    reach = float(np.linalg.norm(platform.platform_points, axis=1).max())
    offset = float(np.linalg.norm(platform.platform_com))
    if offset > 10 * reach:
        raise PlatformError(
            "platform_com",
            f"is {offset:g} m from Op, more than ten times the farthest platform joint ({reach:g} m); check units",
        )


def check_leg_com_offsets(platform: PlatformFields, shortest: float, pose: str) -> None:
    """The centres of mass of both parts lie on every leg, the shortest [m] of a pose included: the legs are alike."""
    for name, end in (("leg_lower_com", "base"), ("leg_upper_com", "platform")):
        value = getattr(platform, name)
        if not 0 <= value <= shortest:
            raise PlatformError(
                name,
                f"is {value:g} m from the {end} joint; expected between 0 and the shortest leg of the {pose} pose, "
                f"{shortest:g} m",
            )


def check_limits(platform: PlatformFields) -> None:
    """Limits of stroke and joints admit the home pose."""
    low, high = platform.leg_length_min, platform.leg_length_max
    lengths = leg_geometry(platform, platform.home_position, platform.home_orientation).length
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


def _list(values: Array) -> str:
    return "(" + ", ".join(f"{v:g}" for v in values) + ")"

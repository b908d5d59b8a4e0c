"""Explains a region: limits that the platform does not state, and why no pose of a grid can be reached."""

import numpy as np

from gough_stewart.harness.workspace.display import Shown, clearance, shown_coordinate, shown_length
from gough_stewart.model.kinematics import joint_angles, leg_geometry
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, Workspace, limits_at

_BOUNDING = ("leg_length_min", "leg_length_max", "joint_angle_max")
_JOINTS = {Limit.BASE_JOINT: "base", Limit.PLATFORM_JOINT: "platform"}
_DEGREES = Shown("°", 180 / np.pi)
# Coordinates closer than this count as equal [m, rad].
_SAME = 1e-9


def notices(workspace: Workspace) -> list[str]:
    """Notices to read before the maps; an empty list in usual cases."""
    platform, found = workspace.platform, []
    if all(getattr(platform, name) is None for name in _BOUNDING):
        found.append(
            f"{platform.name} states no {', '.join(_BOUNDING[:-1])} or {_BOUNDING[-1]}: only singular poses and a "
            "pitch of ±90° bound this region. State limits in the platform's file to see what the machine can reach."
        )
    if not workspace.qualities.reachable.any():
        found.append(_empty_text(workspace))
    return found


def _empty_text(workspace: Workspace) -> str:
    """Which limit is exceeded at the pose of the grid nearest to the limits, and what to change."""
    at = np.unravel_index(int(clearance(workspace).argmax()), workspace.shape)
    places = [
        f"{name} {shown_coordinate(workspace, name).text(values[k], 3)}"
        for k, (name, values) in zip(at, workspace.swept.items(), strict=True)
    ]
    nearest = f"{', '.join(places)}: {_cause(workspace, workspace.coordinates()[at])}"
    return f"No pose of this grid can be reached. The one nearest to the limits is {nearest}. {_remedy(workspace)}"


def _cause(workspace: Workspace, pose: FloatArray) -> str:
    """The first limit that a pose (6,) exceeds, and by how much."""
    platform, position, orientation = workspace.platform, pose[:3], pose[3:]
    limit = Limit(int(limits_at(platform, position, orientation)))
    shown = shown_length(workspace)
    length = leg_geometry(platform, position, orientation).length
    if limit == Limit.LEG_TOO_SHORT and platform.leg_length_min is not None:
        k = int(length.argmin())
        return f"leg {k + 1} is {shown.text(length[k])} long; leg_length_min is {shown.text(platform.leg_length_min)}"
    if limit == Limit.LEG_TOO_LONG and platform.leg_length_max is not None:
        k = int(length.argmax())
        return f"leg {k + 1} is {shown.text(length[k])} long; leg_length_max is {shown.text(platform.leg_length_max)}"
    if limit in _JOINTS and platform.joint_angle_max is not None:
        base, other = joint_angles(platform, position, orientation, platform.home_position, platform.home_orientation)
        angle = base if limit == Limit.BASE_JOINT else other
        k = int(angle.argmax())
        return (
            f"the {_JOINTS[limit]} joint of leg {k + 1} is {_DEGREES.text(angle[k], 3)} from its direction at home; "
            f"joint_angle_max is {_DEGREES.text(platform.joint_angle_max, 3)}"
        )
    return limit.text


def _remedy(workspace: Workspace) -> str:
    """The change that leads back to home, which is within the limits of every platform."""
    home, away = workspace.home, []
    for name, value in workspace.fixed.items():
        if abs(value - home[name]) > _SAME:
            away.append(f"{name} at {shown_coordinate(workspace, name).text(home[name])}")
    if away:
        return f"Home can be reached, with {', '.join(away)}: fix coordinates nearer to it."
    for name, values in workspace.swept.items():
        if not values[0] - _SAME <= home[name] <= values[-1] + _SAME:
            away.append(f"{name} at {shown_coordinate(workspace, name).text(home[name])}")
    if away:
        return f"Home can be reached, with {', '.join(away)}: sweep a range about it, or omit the range."
    return "Home can be reached, but lies between two poses of this grid: use more points or smaller ranges."

"""How a workspace is told and shown: its coordinates, results and border, with names, units and scales."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.output.tables import number_text
from gough_stewart.model.parameters import LIMITS, TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import Limit, PoseQualities
from gough_stewart.model.workspace_grid import COORDINATES, Workspace, home_of

# A platform smaller than this is shown in mm [m].
_SMALL = 0.5
# Coordinates closer than this are the same [m, rad].
_SAME = 1e-9
# Forces from here on are shown in kN [N].
_STRONG = 1e4


@dataclass(frozen=True)
class Shown:
    """A unit to show something in, and its number per SI unit."""

    unit: str
    factor: float

    def text(self, value: float, digits: int = 4) -> str:
        """A value in SI units, with its unit."""
        space = "" if self.unit in ("", "°") else " "
        # no −0, and no rounding errors of degrees
        size = round(value * self.factor, 9) + 0.0 if np.isfinite(value) else value
        return f"{number_text(size, digits)}{space}{self.unit}"


@dataclass(frozen=True, eq=False)
class Result:
    """A number at every pose, and how to show it."""

    name: str  # as in the CSV file
    title: str
    shown: Shown
    values: FloatArray  # of the grid's shape, SI units
    logarithmic: bool = False
    is_best_low: bool = False
    ends_at_border: bool = False  # 0 at the border of what can be reached


def shown_coordinate(workspace: Workspace, name: str) -> Shown:
    """Angles in degrees; lengths in m, or in mm for a small platform."""
    if COORDINATES[name] == "rad":
        return Shown("°", 180 / np.pi)
    return shown_length(workspace)


def shown_length(workspace: Workspace) -> Shown:
    """In m, or in mm for a small platform."""
    return Shown("mm", 1e3) if workspace.platform.characteristic_length < _SMALL else Shown("m", 1.0)


def results_of(workspace: Workspace) -> list[Result]:
    """What is known at the poses; without what the platform states no limit for."""
    q = workspace.qualities
    results = [Result("condition_number", "condition number", Shown("", 1.0), q.condition_number, True, True)]
    if q.payload is not None:
        results.append(Result("payload", "largest payload", Shown("kg", 1.0), q.payload))
    if q.force_margin is not None:
        strongest = reachable_values(workspace, q.force_margin).max(initial=0.0)
        unit = Shown("kN", 1e-3) if strongest >= _STRONG else Shown("N", 1.0)
        results.append(Result("force_margin", "force margin", unit, q.force_margin))
    if q.largest_speed is not None:
        results.append(Result("largest_speed", "largest speed", _shown_speed(workspace), q.largest_speed))
    if q.leg_length_margin is not None:
        length = shown_length(workspace)
        results.append(Result("leg_length_margin", "stroke left", length, q.leg_length_margin, ends_at_border=True))
    if q.joint_angle_margin is not None:
        angle = Shown("°", 180 / np.pi)
        results.append(
            Result("joint_angle_margin", "joint angle left", angle, q.joint_angle_margin, ends_at_border=True)
        )
    return results


def reachable_values(workspace: Workspace, values: FloatArray) -> FloatArray:
    """The finite ones at poses that can be reached (n,)."""
    return values[workspace.qualities.reachable & np.isfinite(values)]


def clearance(workspace: Workspace) -> FloatArray:
    """That of `clearance_of` at every pose of the grid."""
    return clearance_of(workspace.platform, workspace.qualities, workspace.coordinates()[..., 4])


def clearance_of(platform: Platform, q: PoseQualities, pitch: FloatArray) -> FloatArray:
    """A continuous measure of distance from the nearest limit, positive within the border of what can be reached.

    The least of: stroke left in characteristic lengths, joint angle and pitch left in rad, smallest singular value.
    """
    least = np.minimum(LARGEST_PITCH - np.abs(pitch), q.singular_margin)
    if q.leg_length_margin is not None:
        least = np.fmin(least, q.leg_length_margin / platform.characteristic_length)
    if q.joint_angle_margin is not None:
        least = np.fmin(least, q.joint_angle_margin)
    return np.asarray(least)


def limits_met(workspace: Workspace) -> list[Limit]:
    """Those that keep the platform from some pose of the grid."""
    return [Limit(code) for code in np.unique(workspace.qualities.limit) if code != Limit.NONE]


def is_through_home(workspace: Workspace, others: Mapping[str, float]) -> bool:
    """Whether coordinates that are not drawn have their values of home."""
    home = home_of(workspace.platform)
    return all(abs(value - home[name]) < _SAME for name, value in others.items())


def swept_text(workspace: Workspace) -> str:
    """Which coordinates went from where to where."""
    parts = []
    for name, values in workspace.swept.items():
        shown = shown_coordinate(workspace, name)
        parts.append(f"{name} from {shown.text(values[0])} to {shown.text(values[-1])}")
    return ", ".join(parts)


def fixed_text(workspace: Workspace) -> str:
    """The values of the other coordinates."""
    return ", ".join(
        f"{name} {shown_coordinate(workspace, name).text(value)}" for name, value in workspace.fixed.items()
    )


def limits_text(workspace: Workspace) -> str:
    """The limits that pictures show, in one line; those that the platform does not state are named as such."""
    values = limit_values(workspace)
    shown = ("leg_length_min", "leg_length_max", "joint_angle_max", "actuator_force_max")
    return ", ".join(f"{limit_title(name)} {values[name]}" for name in shown)


def limit_title(name: str) -> str:
    """What a limit of the platform is of, in words."""
    return TABLE[name].description.removeprefix("maximum ")


def limit_values(workspace: Workspace) -> dict[str, str]:
    """Each limit of the platform by name, as a text, or that it is not stated."""
    units = {"m": shown_length(workspace), "m/s": _shown_speed(workspace), "rad": Shown("°", 180 / np.pi)}
    found = {}
    for row in LIMITS:
        value = getattr(workspace.platform, row.name)
        found[row.name] = "not stated" if value is None else units.get(row.unit, Shown(row.unit, 1.0)).text(value)
    return found


def _shown_speed(workspace: Workspace) -> Shown:
    """As lengths are."""
    length = shown_length(workspace)
    return Shown(f"{length.unit}/s", length.factor)

"""How a workspace is displayed: names, units and scales of its coordinates, results and border."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gough_stewart.harness.report.words import number_text
from gough_stewart.model.interface import unit_text
from gough_stewart.model.parameters import LIMITS, TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.pose_limits import LARGEST_PITCH
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import COORDINATES, Limit, PoseQualities, Workspace

# Smaller platforms are shown in mm [m].
_SMALL = 0.5
# Coordinates closer than this count as equal [m, rad].
_SAME = 1e-9
# Forces of at least this are shown in kN [N].
_STRONG = 1e4


@dataclass(frozen=True)
class Shown:
    """A unit for display, and the factor from SI units to it."""

    unit: str
    factor: float
    more_digits: int = 0  # than a large machine needs

    def text(self, value: float, digits: int = 4) -> str:
        """A value in SI units, as text with the unit."""
        space = "" if self.unit in ("", "°") else " "
        # avoids −0 and rounding errors of degrees
        size = round(value * self.factor, 9) + 0.0 if np.isfinite(value) else value
        return f"{number_text(size, digits + self.more_digits)}{space}{unit_text(self.unit)}"


@dataclass(frozen=True, eq=False)
class Result:
    """A quantity at every pose, and how to display it."""

    name: str  # column of the CSV file
    title: str
    shown: Shown
    values: FloatArray  # in the shape of the grid, SI units
    logarithmic: bool = False
    is_best_low: bool = False
    ends_at_border: bool = False  # 0 at the border of the reachable region


def shown_coordinate(workspace: Workspace, name: str) -> Shown:
    """How to display a coordinate: angles in degrees; lengths in m, or in mm for a small platform."""
    if COORDINATES[name] == "rad":
        return Shown("°", 180 / np.pi)
    return shown_length(workspace)


def shown_length(workspace: Workspace) -> Shown:
    """How to display lengths: in m, or in mm for a small platform; a thousandth of the stroke is seen."""
    platform, more = workspace.platform, 0
    if platform.leg_length_min is not None and platform.leg_length_max is not None:
        stroke = platform.leg_length_max - platform.leg_length_min
        more = max(0, math.ceil(math.log10(1e3 * platform.characteristic_length / stroke)) - 4)
    return Shown("mm", 1e3, more) if platform.characteristic_length < _SMALL else Shown("m", 1.0, more)


def results_of(workspace: Workspace) -> list[Result]:
    """The results at the poses; those that need a limit which the platform does not state are left out."""
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
    results += _stiffness(workspace)
    if q.leg_length_margin is not None:
        length = shown_length(workspace)
        results.append(Result("leg_length_margin", "stroke left", length, q.leg_length_margin, ends_at_border=True))
    if q.joint_angle_margin is not None:
        angle = Shown("°", 180 / np.pi)
        results.append(
            Result("joint_angle_margin", "joint angle left", angle, q.joint_angle_margin, ends_at_border=True)
        )
    return results


def _stiffness(workspace: Workspace) -> list[Result]:
    """Of legs that give."""
    q, found = workspace.qualities, []
    for name, title, unit in (
        ("translational_stiffness", "stiffness, softest direction", "N/µm"),
        ("translational_stiffness_max", "stiffness, stiffest direction", "N/µm"),
        ("rotational_stiffness", "stiffness, softest axis", "kN.m/rad"),
        ("rotational_stiffness_max", "stiffness, stiffest axis", "kN.m/rad"),
        ("first_mode", "first mode", "Hz"),
    ):
        values: FloatArray | None = getattr(q, name)
        if values is not None:
            factor = {"N/µm": 1e-6, "kN.m/rad": 1e-3}.get(unit, 1.0)
            found.append(Result(name, title, Shown(unit, factor), values))
    return found


def reachable_values(workspace: Workspace, values: FloatArray) -> FloatArray:
    """The finite values at reachable poses (n,)."""
    return values[workspace.qualities.reachable & np.isfinite(values)]


def clearance(workspace: Workspace) -> FloatArray:
    """`clearance_of` at every pose of the grid."""
    return clearance_of(workspace.platform, workspace.qualities, workspace.coordinates()[..., 4])


def clearance_of(platform: Platform, q: PoseQualities, pitch: FloatArray) -> FloatArray:
    """A continuous measure of distance from the nearest limit, positive inside the reachable region.

    The least of: margin of leg length in characteristic lengths, margins of joint angle and pitch in rad, smallest
    singular value.
    """
    least = np.minimum(LARGEST_PITCH - np.abs(pitch), q.singular_margin)
    if q.leg_length_margin is not None:
        least = np.fmin(least, q.leg_length_margin / platform.characteristic_length)
    if q.joint_angle_margin is not None:
        least = np.fmin(least, q.joint_angle_margin)
    return np.asarray(least)


def limits_met(workspace: Workspace) -> list[Limit]:
    """The limits that are exceeded at some pose of the grid."""
    return [Limit(code) for code in np.unique(workspace.qualities.limit) if code != Limit.NONE]


def is_through_home(workspace: Workspace, others: Mapping[str, float]) -> bool:
    """Whether the coordinates that are not drawn have their values at home."""
    home = workspace.home
    return all(abs(value - home[name]) < _SAME for name, value in others.items())


def swept_text(workspace: Workspace) -> str:
    """The ranges of the swept coordinates, as text."""
    parts = []
    for name, values in workspace.swept.items():
        shown = shown_coordinate(workspace, name)
        parts.append(f"{name} from {shown.text(values[0])} to {shown.text(values[-1])}")
    return ", ".join(parts)


def fixed_text(workspace: Workspace) -> str:
    """The values of the fixed coordinates, as text."""
    return ", ".join(
        f"{name} {shown_coordinate(workspace, name).text(value)}" for name, value in workspace.fixed.items()
    )


def limit_title(name: str) -> str:
    """The name of a limit of the platform, in words."""
    return TABLE[name].description.removeprefix("maximum ")


def limit_values(workspace: Workspace) -> dict[str, str]:
    """Each limit of the platform by name, as text, or "not stated"."""
    units = {"m": shown_length(workspace), "m/s": _shown_speed(workspace), "rad": Shown("°", 180 / np.pi)}
    found = {}
    for row in LIMITS:
        value = getattr(workspace.platform, row.name)
        found[row.name] = "not stated" if value is None else units.get(row.unit, Shown(row.unit, 1.0)).text(value)
    return found


def _shown_speed(workspace: Workspace) -> Shown:
    """A length as text."""
    length = shown_length(workspace)
    return Shown(f"{length.unit}/s", length.factor)

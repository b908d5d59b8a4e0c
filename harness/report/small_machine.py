"""Reports of small machines: how finely they tell numbers follows the stroke."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

from gough_stewart.harness.report.quantities import Quantity
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import PlatformFields
from gough_stewart.model.platform import Platform

_Shown = TypeVar("_Shown")
# From this stroke on, micrometres are told [m]; of a smaller one, a millionth.
_SMALL = 0.01
# The stroke of a machine that does not state one, as a share of its legs.
_SHARE_OF_LEGS = 0.01


def fineness_of(platform: PlatformFields) -> float:
    """The smallest numbers that are told of a machine, as a share of those of a machine with a stroke of 1 m."""
    low, high = platform.leg_length_min, platform.leg_length_max
    legs = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    stroke = _SHARE_OF_LEGS * float(legs.mean()) if low is None or high is None else high - low
    return stroke if stroke < _SMALL else 1.0


def fineness_of_record(metadata: Mapping[str, Any]) -> float:
    """The same by the metadata of a record; 1 if they have no whole platform."""
    machine = metadata.get("machine") or metadata.get("platform") or {}
    return fineness_of(Platform(**machine)) if "base_points" in machine else 1.0


def fine(shown: _Shown, fineness: float) -> _Shown:
    """A report, a part of it or a quantity with all quantities as `Quantity.fine`; 1 changes nothing."""
    return shown if fineness >= 1 else cast("_Shown", _fine(shown, fineness))


def _fine(shown: Any, fineness: float) -> Any:
    if isinstance(shown, Quantity):
        return shown.fine(fineness)
    if isinstance(shown, tuple):
        return tuple(_fine(each, fineness) for each in shown)
    if is_dataclass(shown) and not isinstance(shown, type):
        return replace(shown, **{each.name: _fine(getattr(shown, each.name), fineness) for each in fields(shown)})
    return shown

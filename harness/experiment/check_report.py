"""What a check of a motion found, as a report: whether it can be done, the nearest limit, what would fit."""

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from gough_stewart.harness.motion.limits.needs import Needs
from gough_stewart.harness.motion.limits.shares import LABELS, Peak, Shares
from gough_stewart.harness.motion.limits.shares_tables import OF_LIMIT, shares_tables
from gough_stewart.harness.report.chart import Chart, Mark, Series, strip_of, time_axis
from gough_stewart.harness.report.document import Note, Number, Report, Section, Status, Verdict, settings_of
from gough_stewart.harness.report.palette import Role
from gough_stewart.harness.report.words import listed, percent, sentence

# A motion that needs more of a limit is done with little room.
_NEAR = 0.9
# Larger shares would flatten the others; tables have them.
_HIGHEST = 2.0
# Of strips one above the other.
_STRIPS: tuple[Role, ...] = ("bad", "marginal", "published", "measured", "neutral")
_OF_LEG = {
    "stroke": "stroke",
    "joint_angle_max": "joint angle",
    "leg_velocity_max": "speed",
    "leg_acceleration_max": "acceleration",
    "actuator_force_max": "force",
    "actuator_power_max": "power",
}

# All numbers that a check may have.
PATHS = tuple(f"limits.{name}" for name in LABELS)


class Checked(Protocol):
    """What a check has."""

    @property
    def shares(self) -> Shares: ...
    @property
    def needs(self) -> Needs: ...
    @property
    def title(self) -> str: ...
    @property
    def changed(self) -> Mapping[str, Mapping[str, Any]]: ...
    @property
    def platform_name(self) -> str: ...
    @property
    def within(self) -> bool: ...
    @property
    def keeps_margin(self) -> bool: ...
    @property
    def margin(self) -> float: ...
    @property
    def not_stated(self) -> tuple[str, ...]: ...
    @property
    def time_factor(self) -> float | None: ...
    @property
    def amplitude_factor(self) -> float | None: ...


def check_report(found: Checked, *, charts: bool = True) -> Report:
    """The report of a check."""
    sections = [Section("Limits and needs", tuple(shares_tables(found.shares, found.needs)))]
    if charts:
        sections.append(Section("Over time", (_chart(found),)))
    numbers = [_number(found.shares.peak(name)) for name in found.shares.of]
    notes = [Note(f"Not checked, as the platform states no limit: {_unchecked(found)}.")] if found.not_stated else []
    return Report(
        found.title,
        check_verdict(found),
        tuple(sections),
        study="check",
        lead=f"platform {found.platform_name}, nominal model without load, {_duration(found):.6g} s",
        settings=settings_of(found.changed),
        numbers=tuple(numbers),
        notes=tuple(notes),
    )


def check_verdict(found: Checked) -> Verdict:
    """Whether the motion can be done, what it needs most, and what would fit if it cannot."""
    peak = found.shares.largest
    number = _number(peak)
    if found.within and found.keeps_margin:
        # without limits of the legs, only singular poses have been checked
        known = [name for name in _OF_LEG if name in found.shares.of]
        can = "can be done" if known else "can be done as far as is known: the platform states no limit of its legs"
        status: Status = "told" if not known else "marginal" if peak.share > _NEAR else "good"
        return Verdict(sentence([can, _need(peak)]), status, (number,))
    slow, small = found.time_factor, found.amplitude_factor
    fits = [] if slow is None else [f"{slow:.4g} times as long (--fit time)"]
    fits += [] if small is None else [f"{small:.4g} times as large (--fit amplitude)"]
    ways = f"it fits {listed(fits, 'or')}" if fits else "no slower and no smaller motion fits"
    if found.within:
        beyond = f"can be done, but not with its margin of {percent(found.margin)}"
        return Verdict(sentence([beyond, _need(peak), ways]), "marginal", (number,))
    return Verdict(sentence(["cannot be done", _need(peak), ways]), "bad", (number,))


def _need(peak: Peak) -> str:
    """What is used most, and when: "leg 3 needs 92 % of its speed at 4.2 s"."""
    at = f"at {peak.time:.4g} s"
    if peak.limit == "side":
        return f"it leads through a singular pose {at}" if peak.share > 1 else f"no singular pose {at}"
    if peak.limit not in _OF_LEG:
        return f"the {LABELS[peak.limit]} is at {percent(peak.share)} of its limit {at}"
    if not math.isfinite(peak.share):
        return f"leg {peak.leg} has no finite {_OF_LEG[peak.limit]} {at}"
    return f"leg {peak.leg} needs {percent(peak.share)} of its {_OF_LEG[peak.limit]} {at}"


def _number(peak: Peak) -> Number:
    finite = math.isfinite(peak.share)
    who = "" if peak.leg is None else f", leg {peak.leg}"
    return Number(
        f"limits.{peak.limit}",
        f"{LABELS[peak.limit]}{who}",
        peak.share if finite else None,
        OF_LIMIT,
        limit=1.0,
        margin=1 - peak.share if finite else None,
        explanation=f"largest share of the limit along the motion, at {peak.time:.6g} s",
    )


def _unchecked(found: Checked) -> str:
    return listed([LABELS[name] for name in found.not_stated])


def _duration(found: Checked) -> float:
    return float(found.shares.time[-1] - found.shares.time[0])


def _chart(found: Checked) -> Chart:
    """The largest share of each limit over all legs; the one that is used most first."""
    names = sorted(found.shares.of, key=lambda name: -found.shares.peak(name).share)
    series = tuple(
        Series(LABELS[name], OF_LIMIT, np.minimum(found.shares.over_time[name], 10 * _HIGHEST)) for name in names
    )
    mark, time = Mark(1.0, "limit"), found.shares.time
    beyond = [
        strip_of(f"{LABELS[name]} beyond its limit", time, found.shares.over_time[name] > 1, role)
        for name, role in zip(names, _STRIPS, strict=False)
    ]
    strips = tuple(each for each in beyond if each is not None)
    return Chart("share of each limit", time_axis(time), series, marks=(mark,), strips=strips, group="shares")

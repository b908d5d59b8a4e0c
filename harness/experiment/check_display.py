"""The check of a motion as tables, text, numbers and figures."""

import json
import math
from typing import Any

from gough_stewart.harness.experiment.checking import MotionCheck
from gough_stewart.harness.motion.shares import Peak
from gough_stewart.harness.motion.shares_figure import LABELS, shares_pictures
from gough_stewart.harness.output.tables import Sheet, number_text, to_html
from gough_stewart.harness.output.versions import versions

FILES = ("check.json", "shares.png", "shares.svg")
_LEGS = tuple(range(1, 7))


def check_files(found: MotionCheck) -> dict[str, bytes]:
    """Numbers and figure by file name."""
    numbers = {**as_dict(found), "versions": versions()}
    return {
        "check.json": (json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        **shares_pictures(found.shares, f"{found.experiment.title}: shares of the limits of {found.platform.name}"),
    }


def as_dict(found: MotionCheck) -> dict[str, Any]:
    """The largest share of every limit and its time, as plain numbers; None if a share is infinite."""
    limits = {}
    for name, share in found.shares.of.items():
        peaks = [found.shares.peak(name, leg) for leg in _LEGS] if share.ndim == 2 else [found.shares.peak(name)]
        used, times = [_finite(peak.share) for peak in peaks], [peak.time for peak in peaks]
        limits[name] = {"share": used, "time": times} if share.ndim == 2 else {"share": used[0], "time": times[0]}
    largest = found.shares.largest
    return {
        "title": found.experiment.title,
        "platform": found.platform.name,
        "within": found.within,
        "largest": {**largest._asdict(), "share": _finite(largest.share)},
        "time_factor": found.time_factor,
        "amplitude_factor": found.amplitude_factor,
        "limits": limits,
    }


def check_sheets(found: MotionCheck) -> list[Sheet]:
    """The largest share of every limit and its time, per leg and for the whole platform."""
    shares = found.shares
    legs = Sheet("largest share of each limit", ("of leg", *map(str, _LEGS)))
    whole = Sheet("of the whole platform", ("limit", "%", "at s"))
    for name, share in shares.of.items():
        if share.ndim == 2:
            peaks = [shares.peak(name, leg) for leg in _LEGS]
            legs.add(f"{LABELS[name]}, %", *map(_percent, peaks))
            legs.add("  at s", *(number_text(peak.time) for peak in peaks), ends_group=True)
        else:
            peak = shares.peak(name)
            whole.add(LABELS[name], _percent(peak), number_text(peak.time))
    return [sheet for sheet in (legs, whole) if sheet.rows]


def verdict(found: MotionCheck) -> str:
    """Whether the motion is within all limits, the largest share, and what would fit."""
    peak = found.shares.largest
    of_leg = "" if peak.leg is None else f" of leg {peak.leg}"
    used = f"{LABELS[peak.limit]}{of_leg}, {_percent(peak)} % at {peak.time:.6g} s"
    if found.within:
        return f"within all limits; most used: {used}"
    slow, small = found.time_factor, found.amplitude_factor
    ways = [
        "no slower motion fits" if slow is None else f"fits {number_text(slow)} times as long (--fit time)",
        "no smaller motion fits" if small is None else f"fits {number_text(small)} times as large (--fit amplitude)",
    ]
    return f"beyond its limits: {used}; {'; '.join(ways)}"


def check_text(found: MotionCheck) -> str:
    """Title, largest share of each limit, and verdict, one line each."""
    lines = [f"Motion: {found.experiment.title}, of platform {found.platform.name}"]
    for name in found.shares.of:
        peak = found.shares.peak(name)
        of_leg = "" if peak.leg is None else f", leg {peak.leg}"
        lines.append(f"  {LABELS[name]:16}  {_percent(peak):>6} % at {peak.time:.6g} s{of_leg}")
    return "\n".join([*lines, f"  {verdict(found)}"])


def check_html(found: MotionCheck) -> str:
    """The tables, for a notebook."""
    return f"<div>{''.join(map(to_html, check_sheets(found)))}</div>"


def _percent(peak: Peak) -> str:
    """Percent of the limit, 100 only if it is reached; four digits, so that a small excess shows."""
    if not math.isfinite(peak.share):
        return "beyond"
    text = number_text(100 * peak.share)
    return f"{100 * peak.share:.7g}" if text == "100" and peak.share != 1 else text


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

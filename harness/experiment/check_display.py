"""The check of a motion as tables, text, numbers and figures."""

import json
import math
from typing import Any

import numpy as np

from gough_stewart.harness.experiment.checking import MotionCheck
from gough_stewart.harness.motion.needs import Needs
from gough_stewart.harness.motion.shares import Peak
from gough_stewart.harness.motion.shares_figure import LABELS, shares_pictures
from gough_stewart.harness.output.quantities_shown import factor_to
from gough_stewart.harness.output.tables import Named, Sheet, number_text, quantity_text, to_html
from gough_stewart.harness.output.versions import versions

FILES = ("check.json", "needs.csv", "shares.png", "shares.svg")
_LEGS = tuple(range(1, 7))
# Needs in the terminal and on pages, by group.
_NEEDS_SHOWN: tuple[dict[str, str], ...] = (
    {
        "leg_length_min": "shortest",
        "leg_length_max": "longest",
        "stroke": "stroke",
        "stroke_rms": "  RMS",
        "distance": "  travelled",
    },
    {"leg_velocity_peak": "speed, peak", "leg_velocity_peak_force": "  at force", "leg_velocity_rms": "  RMS"},
    {"leg_acceleration_peak": "accel., peak", "leg_acceleration_rms": "  RMS"},
    {
        "actuator_force_peak": "force, peak",
        "actuator_force_peak_velocity": "  at speed",
        "actuator_force_rms": "  RMS",
        "actuator_force_push": "  push, peak",
        "actuator_force_pull": "  pull, peak",
    },
    {
        "motoring_power_peak": "power, peak",
        "motoring_power_peak_velocity": "  at speed",
        "motoring_power_peak_force": "  at force",
        "actuator_power_rms": "  RMS",
        "regenerated_power_peak": "  regen., peak",
    },
    {"motoring_energy": "energy, motoring", "regenerated_energy": "  regenerated"},
    {
        f"{end}_joint_angle_{what}": label
        for end in ("base", "platform")
        for what, label in (("peak", f"{end} joint"), ("peak_velocity", "  at speed"), ("rms", "  RMS"))
    },
)
_UNITS_SHOWN = {"m": "mm", "m/s": "mm/s", "rad": "deg"}


def check_files(found: MotionCheck) -> dict[str, bytes]:
    """Numbers and figure by file name."""
    numbers = {**as_dict(found), "versions": versions()}
    return {
        "check.json": (json.dumps(numbers, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        "needs.csv": _needs_csv(found.needs),
        **shares_pictures(found.shares, f"{found.experiment.title}: shares of the limits of {found.platform.name}"),
    }


def _needs_csv(needs: Needs) -> bytes:
    """One row for each leg, one column for each figure with its unit: "actuator_force_peak [N]"."""
    import polars

    columns = {f"{name} [{need.unit}]": need.of_leg for name, need in needs.of.items()}
    return polars.DataFrame({"leg": _LEGS, **columns}).fill_nan(None).write_csv().encode()


def as_dict(found: MotionCheck) -> dict[str, Any]:
    """The largest share of every limit, its time, and all needs, as plain numbers; None for what is not finite."""
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
        "margin": found.margin,
        "keeps_margin": found.keeps_margin,
        "not_stated": list(found.not_stated),
        "largest": {**largest._asdict(), "share": _finite(largest.share)},
        "time_factor": found.time_factor,
        "amplitude_factor": found.amplitude_factor,
        "limits": limits,
        "needs": {
            name: {"unit": need.unit, "of_leg": [_finite(float(value)) for value in need.of_leg]}
            for name, need in found.needs.of.items()
        },
        "needs_notes": list(found.needs.notes),
    }


def check_sheets(found: MotionCheck) -> list[Sheet]:
    """The largest share of every limit and its time, per leg and for the whole platform, and the needs of each leg."""
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
    return [sheet for sheet in (legs, whole, _needs_sheet(found.needs)) if sheet.rows]


def _needs_sheet(needs: Needs) -> Sheet:
    """What the motion needs of each leg, in the units of data sheets; `needs.csv` has more."""
    sheet = Sheet("needs of each leg", ("leg", *map(str, _LEGS)))
    for group in _NEEDS_SHOWN:
        for k, (name, label) in enumerate(group.items()):
            need = needs.of[name]
            unit = _UNITS_SHOWN.get(need.unit, need.unit)
            cells = (quantity_text(_finite(factor_to(unit) * float(value)), unit, 3) for value in need.of_leg)
            sheet.add(Named(label, unit), *cells, ends_group=k == len(group) - 1)
    return sheet


def verdict(found: MotionCheck) -> str:
    """Whether the motion is within all limits, which were not checked, the largest share, and what would fit."""
    peak = found.shares.largest
    of_leg = "" if peak.leg is None else f" of leg {peak.leg}"
    used = f"{LABELS[peak.limit]}{of_leg}, {_percent(peak)} % at {peak.time:.6g} s"
    missing = ", ".join(LABELS[name] for name in found.not_stated)
    unchecked = f"; not checked, as the platform states no limit: {missing}" if missing else ""
    if found.within and found.keeps_margin:
        return f"within all limits{' that are stated' if missing else ''}; most used: {used}{unchecked}"
    slow, small = found.time_factor, found.amplitude_factor
    ways = [
        "no slower motion fits" if slow is None else f"fits {number_text(slow)} times as long (--fit time)",
        "no smaller motion fits" if small is None else f"fits {number_text(small)} times as large (--fit amplitude)",
    ]
    beyond = f"within its limits, but not within its margin of {100 * found.margin:g} %"
    return f"{beyond if found.within else 'beyond its limits'}: {used}; {'; '.join(ways)}{unchecked}"


def check_text(found: MotionCheck) -> str:
    """Title, largest share of each limit, needs of the most loaded leg, and verdict, one line each."""
    lines = [f"Motion: {found.experiment.title}, of platform {found.platform.name}"]
    for name in found.shares.of:
        peak = found.shares.peak(name)
        of_leg = "" if peak.leg is None else f", leg {peak.leg}"
        lines.append(f"  {LABELS[name]:16}  {_percent(peak):>6} % at {peak.time:.6g} s{of_leg}")
    return "\n".join([*lines, f"  {_largest_needs(found.needs)}", f"  {verdict(found)}"])


def _largest_needs(needs: Needs) -> str:
    """The largest of each need over all legs."""

    def largest(name: str) -> str:
        values = np.abs(needs[name])
        return number_text(_finite(float(values.max())))

    of = {
        "stroke": f"{largest('stroke')} m",
        "speed": f"{largest('leg_velocity_peak')} m/s (RMS {largest('leg_velocity_rms')})",
        "force": f"{largest('actuator_force_peak')} N (RMS {largest('actuator_force_rms')})",
        "power": f"{largest('motoring_power_peak')} W (RMS {largest('actuator_power_rms')})",
        "regenerated": f"{largest('regenerated_power_peak')} W",
    }
    return f"needs: {', '.join(f'{name} {value}' for name, value in of.items())}"


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

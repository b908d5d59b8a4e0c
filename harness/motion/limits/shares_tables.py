"""Shares of the limits and needs of the legs as tables and text."""

import math

import numpy as np

from gough_stewart.harness.motion.limits.needs import Needs
from gough_stewart.harness.motion.limits.shares import LABELS, Peak, Shares
from gough_stewart.harness.output.display_resolution import factor_to
from gough_stewart.harness.output.tables import Named, Sheet, number_text, quantity_text

LEGS = tuple(range(1, 7))
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


def shares_sheets(shares: Shares, needs: Needs) -> list[Sheet]:
    """The largest share of every limit and its time, per leg and for the whole platform, and the needs of each leg."""
    legs = Sheet("largest share of each limit", ("of leg", *map(str, LEGS)))
    whole = Sheet("of the whole platform", ("limit", "%", "at s"))
    for name, share in shares.of.items():
        if share.ndim == 2:
            peaks = [shares.peak(name, leg) for leg in LEGS]
            legs.add(f"{LABELS[name]}, %", *map(percent, peaks))
            legs.add("  at s", *(number_text(peak.time) for peak in peaks), ends_group=True)
        else:
            peak = shares.peak(name)
            whole.add(LABELS[name], percent(peak), number_text(peak.time))
    return [sheet for sheet in (legs, whole, _needs_sheet(needs)) if sheet.rows]


def _needs_sheet(needs: Needs) -> Sheet:
    """What the motion needs of each leg, in the units of data sheets; `needs.csv` has more."""
    sheet = Sheet("needs of each leg", ("leg", *map(str, LEGS)))
    for group in _NEEDS_SHOWN:
        for k, (name, label) in enumerate(group.items()):
            need = needs.of[name]
            unit = _UNITS_SHOWN.get(need.unit, need.unit)
            cells = (quantity_text(finite(factor_to(unit) * float(value)), unit, 3) for value in need.of_leg)
            sheet.add(Named(label, unit), *cells, ends_group=k == len(group) - 1)
    return sheet


def largest_needs(needs: Needs) -> str:
    """The largest of each need over all legs."""

    def largest(name: str) -> str:
        values = np.abs(needs[name])
        return number_text(finite(float(values.max())))

    of = {
        "stroke": f"{largest('stroke')} m",
        "speed": f"{largest('leg_velocity_peak')} m/s (RMS {largest('leg_velocity_rms')})",
        "force": f"{largest('actuator_force_peak')} N (RMS {largest('actuator_force_rms')})",
        "power": f"{largest('motoring_power_peak')} W (RMS {largest('actuator_power_rms')})",
        "regenerated": f"{largest('regenerated_power_peak')} W",
    }
    return f"needs: {', '.join(f'{name} {value}' for name, value in of.items())}"


def percent(peak: Peak) -> str:
    """Percent of the limit, 100 only if it is reached; four digits, so that a small excess shows."""
    if not math.isfinite(peak.share):
        return "beyond"
    text = number_text(100 * peak.share)
    return f"{100 * peak.share:.7g}" if text == "100" and peak.share != 1 else text


def finite(value: float) -> float | None:
    """The value, for tables and JSON; None if it is not finite."""
    return value if math.isfinite(value) else None

"""Shares of the limits and needs of the legs as tables, and the largest needs in a line."""

import math
from dataclasses import replace

import numpy as np

from gough_stewart.harness.motion.limits.needs import Needs
from gough_stewart.harness.motion.limits.shares import LABELS, Shares
from gough_stewart.harness.report.quantities import SHARE, TIME, of_unit
from gough_stewart.harness.report.table import Cell, Column, Table, Value
from gough_stewart.harness.report.words import number_text
from gough_stewart.model.vectors import first_of_largest

LEGS = tuple(range(1, 7))
_LEGS = tuple(Column(str(leg)) for leg in LEGS)
# Four digits, so that a small excess shows.
OF_LIMIT = replace(SHARE, digits=4, name="share of the limit")
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
# Of all legs in one row: label, peak, root mean square.
_SUMMARY = (
    ("stroke", "stroke", "stroke_rms"),
    ("speed", "leg_velocity_peak", "leg_velocity_rms"),
    ("acceleration", "leg_acceleration_peak", "leg_acceleration_rms"),
    ("force", "actuator_force_peak", "actuator_force_rms"),
    ("  push", "actuator_force_push", ""),
    ("  pull", "actuator_force_pull", ""),
    ("power", "motoring_power_peak", "actuator_power_rms"),
    ("  regenerated", "regenerated_power_peak", "regenerated_power_rms"),
    ("energy, motoring", "motoring_energy", ""),
    ("angle of base joint", "base_joint_angle_peak", "base_joint_angle_rms"),
    ("angle of platform joint", "platform_joint_angle_peak", "platform_joint_angle_rms"),
)
_UNITS_SHOWN = {"m": "mm", "m/s": "mm/s", "rad": "deg"}


def summary_tables(shares: Shares, needs: Needs) -> list[Table]:
    """What the motion needs of an actuator, the largest of all legs in a row, and the largest share of every limit."""
    rows: list[tuple[Cell, ...]] = []
    for label, peak, rms in _SUMMARY:
        cells: list[Cell] = [label]
        for name in (peak, rms):
            if not name:
                cells += [""] * 2
                continue
            need = needs.of[name]
            leg = int(first_of_largest(np.abs(need.of_leg)))
            quantity = replace(of_unit(_UNITS_SHOWN.get(need.unit, need.unit)), digits=3)
            cells += [Value(float(abs(need.of_leg[leg])), quantity), str(leg + 1)]
            if name == peak:
                time = needs.of.get(f"{name}_time")
                cells.append("" if time is None else Value(float(time.of_leg[leg]), TIME))
        rows.append(tuple(cells))
    columns = (
        Column(""),
        Column("largest", None, "of all legs"),
        Column("leg"),
        Column("at"),
        Column("RMS", None, "the largest of all legs, over the whole motion"),
        Column("leg "),
    )
    note = f"Needs: {'; '.join(needs.notes)}."
    peaks = [shares.peak(name) for name in shares.of]
    limits = tuple(
        (LABELS[peak.limit], peak.share, "" if peak.leg is None else str(peak.leg), peak.time) for peak in peaks
    )
    share_columns = (Column("limit"), Column("share", OF_LIMIT), Column("leg"), Column("at", TIME))
    return [
        Table("Needs", columns, tuple(rows), note=note),
        Table("Largest share of each limit", share_columns, limits),
    ]


def leg_tables(shares: Shares, needs: Needs) -> list[Table]:
    """The largest share of every limit and its time, and the needs, of each leg."""
    rows: list[tuple[Cell, ...]] = []
    for name in (name for name, share in shares.of.items() if share.ndim == 2):
        peaks = [shares.peak(name, leg) for leg in LEGS]
        rows.append((LABELS[name], *(Value(peak.share, OF_LIMIT) for peak in peaks)))
        rows.append(("  at", *(Value(peak.time, TIME) for peak in peaks)))
    ends = tuple(range(1, len(rows) - 1, 2))
    limits = Table("Largest share of each limit, by leg", (Column("leg"), *_LEGS), tuple(rows), group_ends=ends)
    return [*([limits] if rows else []), _needs_table(needs)]


def _needs_table(needs: Needs) -> Table:
    """What the motion needs of each leg, in the units of data sheets; `needs.csv` has more."""
    rows: list[tuple[Cell, ...]] = []
    ends = []
    for group in _NEEDS_SHOWN:
        for name, label in group.items():
            need = needs.of[name]
            unit = _UNITS_SHOWN.get(need.unit, need.unit)
            quantity = replace(of_unit(unit), digits=3)
            rows.append((label, *(Value(float(value), quantity) for value in need.of_leg)))
        ends.append(len(rows) - 1)
    return Table("Needs of each leg", (Column("leg"), *_LEGS), tuple(rows), group_ends=tuple(ends[:-1]))


def largest_needs(needs: Needs) -> str:
    """The largest of each need over all legs."""

    def largest(name: str) -> str:
        values = np.abs(needs[name])
        return number_text(finite(float(values.max())))

    texts = {
        "stroke": f"{largest('stroke')} m",
        "speed": f"{largest('leg_velocity_peak')} m/s (RMS {largest('leg_velocity_rms')})",
        "force": f"{largest('actuator_force_peak')} N (RMS {largest('actuator_force_rms')})",
        "power": f"{largest('motoring_power_peak')} W (RMS {largest('actuator_power_rms')})",
        "regenerated": f"{largest('regenerated_power_peak')} W",
    }
    return f"needs: {', '.join(f'{name} {value}' for name, value in texts.items())}"


def finite(value: float) -> float | None:
    """The value, for tables and JSON; None if it is not finite."""
    return value if math.isfinite(value) else None

"""What a motion needs of each leg, whatever limits its platform states: the figures that choose an actuator.

Speeds, forces and powers are peaks, with the speed and force at the same time, and root mean squares over the run.
Forces are those of inverse dynamics without external forces, so all figures are without reserve. With their tables,
and those of the shares of the limits.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gough_stewart.harness.motion.limits.shares import LABELS, LOADS, Shares, loads_of_legs
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.report.document import Cell, Column, Table, Value
from gough_stewart.harness.report.quantities import SHARE, TIME, of_unit
from gough_stewart.model.dynamics import LARGEST_CONDITION_NUMBER
from gough_stewart.model.kinematics import (
    condition_number_bound,
    jacobian_of_legs,
    joint_angles,
    leg_geometry,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray, first_of_largest

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
# A step between two rows that the velocities do not explain is a jump if it exceeds this share of the stroke used.
_JUMP = 0.01


class Need(NamedTuple):
    """One figure of every leg."""

    unit: str
    of_leg: FloatArray  # (6,), NaN if it is not defined


@dataclass(frozen=True, eq=False)
class Needs:
    """What a motion needs of each leg, by name, in the order of tables."""

    of: dict[str, Need]
    # what these figures leave out
    notes: tuple[str, ...]

    def __getitem__(self, name: str) -> FloatArray:
        """A figure of every leg (6,), by its name, such as "actuator_force_rms"."""
        return self.of[name].of_leg


def needs_along(platform: Platform, time: FloatArray, motion: Motion) -> Needs:
    """What a motion, with rows at two or more times (n,) [s], needs of each leg.

    Stroke, speed, acceleration, force, power, energy and joint angle: peak, root mean square (√(∫x² dt/T), of the
    length about its mean), and the leg velocity [m/s], time [s] and force [N] at the peak. Positive forces push the
    platform; positive power is motoring, negative power is regenerated. Energies are integrals of each sign of F L̇,
    by the trapezoidal rule.
    """
    with np.errstate(all="ignore"):  # a leg of length 0 has no direction
        legs = leg_geometry(platform, motion.position, motion.orientation)
        regular = condition_number_bound(jacobian_of_legs(legs, scaled=True)) < LARGEST_CONDITION_NUMBER
        loads = loads_of_legs(platform, motion, legs, regular)
        v, a, force, power = (loads[name] for name in LOADS)
        length = np.asarray(legs.length)
        home = (platform.home_position, platform.home_orientation)
        base_angle, platform_angle = joint_angles(platform, motion.position, motion.orientation, *home)
    # forces exist in all rows, or none of their figures does
    F, P = (part if regular.all() else np.full_like(part, np.nan) for part in (force, power))
    mean_length = np.trapezoid(length, time, axis=0) / (time[-1] - time[0])
    needs = {
        "leg_length_min": Need("m", length.min(axis=0)),
        "leg_length_max": Need("m", length.max(axis=0)),
        "stroke": Need("m", np.ptp(length, axis=0)),
        "stroke_rms": Need("m", _rms(time, length - mean_length)),
        "distance": Need("m", np.abs(np.diff(length, axis=0)).sum(axis=0)),
        **_peak("leg_velocity", "m/s", v, time, force=F),
        **_peak("leg_acceleration", "m/s2", a, time, velocity=v, force=F),
        **_peak("actuator_force", "N", F, time, velocity=v),
        "actuator_force_push": Need("N", np.maximum(F, 0.0).max(axis=0)),
        "actuator_force_pull": Need("N", np.maximum(-F, 0.0).max(axis=0)),
        **_peak("actuator_power", "W", P, time, velocity=v, force=F),
        **_peak("motoring_power", "W", np.maximum(P, 0.0), time, velocity=v, force=F),
        **_peak("regenerated_power", "W", np.maximum(-P, 0.0), time, velocity=v, force=F),
        "motoring_energy": Need("J", _integral_of_positive(time, P)),
        "regenerated_energy": Need("J", _integral_of_positive(time, -P)),
        **_peak("base_joint_angle", "rad", base_angle, time, velocity=v),
        **_peak("platform_joint_angle", "rad", platform_angle, time, velocity=v),
    }

    notes = ["nominal model, without external forces and without reserve for the controller"]
    missing = {
        "friction": not (platform.leg_viscous_friction or platform.leg_coulomb_friction),
        "inertia of motors and screws (leg_armature)": not platform.leg_armature,
    }
    absent = " and no ".join(name for name, is_missing in missing.items() if is_missing)
    if absent:
        notes.append(f"the platform states no {absent}, so forces and powers have none")
    if platform.leg_stiffness:
        notes.append("speeds and powers are those of rigid legs; springs let the motors move otherwise, as a run shows")
    by_velocity = np.diff(time)[:, None] * (v[1:] + v[:-1]) / 2
    unexplained = np.abs(np.diff(length, axis=0) - by_velocity).max(axis=1, initial=0.0)
    jump = unexplained > _JUMP * np.ptp(length, axis=0).max()
    if jump.any():
        notes.append(
            f"the reference jumps at {time[1:][jump][0]:.6g} s, or moves much between two rows: what that needs is not "
            "in these figures"
        )
    return Needs(needs, tuple(notes))


def _peak(name: str, unit: str, values: FloatArray, time: FloatArray, **beside: FloatArray) -> dict[str, Need]:
    """The value (n, 6) of largest magnitude, what else there was at that time, and the root mean square."""
    row, leg = first_of_largest(np.abs(values)), np.arange(6)  # NaN is the largest
    known = np.isfinite(values[row, leg])
    figures = {f"{name}_peak": Need(unit, values[row, leg])}
    for companion, at in beside.items():
        its_unit = {"velocity": "m/s", "force": "N"}[companion]
        figures[f"{name}_peak_{companion}"] = Need(its_unit, np.where(known, at[row, leg], np.nan))
    figures[f"{name}_peak_time"] = Need("s", np.where(known, time[row], np.nan))
    figures[f"{name}_rms"] = Need(unit, _rms(time, values))
    return figures


def _rms(time: FloatArray, values: FloatArray) -> FloatArray:
    """√(∫ x² dt/T) (6,)."""
    return np.asarray(np.sqrt(np.trapezoid(values**2, time, axis=0) / (time[-1] - time[0])))


def _integral_of_positive(time: FloatArray, values: FloatArray) -> FloatArray:
    """∫ max(x, 0) dt (6,) of values (n, 6), linear between rows."""
    first, last, h = values[:-1], values[1:], np.diff(time)[:, None]
    high, span = np.maximum(first, last), np.abs(last - first)
    crosses = first * last < 0
    triangle = np.maximum(high, 0.0) ** 2 / (2 * np.where(crosses, span, 1.0))
    trapezoid = (np.maximum(first, 0.0) + np.maximum(last, 0.0)) / 2
    return np.asarray((h * np.where(crosses, triangle, trapezoid)).sum(axis=0))


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
        Table("Needs", columns, tuple(rows), note=note, beside=True),
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

    needed: list[tuple[Cell, ...]] = []  # in the units of data sheets; `needs.csv` has more
    ends_of_groups = []
    for group in _NEEDS_SHOWN:
        for name, label in group.items():
            need = needs.of[name]
            quantity = replace(of_unit(_UNITS_SHOWN.get(need.unit, need.unit)), digits=3)
            needed.append((label, *(Value(float(value), quantity) for value in need.of_leg)))
        ends_of_groups.append(len(needed) - 1)
    by_leg = Table("Needs of each leg", (Column("leg"), *_LEGS), tuple(needed), group_ends=tuple(ends_of_groups[:-1]))
    return [*([limits] if rows else []), by_leg]

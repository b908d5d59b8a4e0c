"""From logs to the parts that are fitted: faults of data are mended or left out, or the log is refused."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.faults import (
    Mask,
    MissingRows,
    clipped,
    frozen,
    lost_rows,
    noise_of,
    runs_of,
    spikes,
    without_held_rows,
)
from gough_stewart.harness.identify.log import VALIDATION, Log, Part, rows_apart
from gough_stewart.harness.identify.lowpass import HALF_LENGTH, LOWEST, cutoff_of, edge, noise_beyond, smoothed
from gough_stewart.harness.identify.regressor import motion_of_lengths
from gough_stewart.model.dynamics import inverse_dynamics, static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Factor between lengths or forces and those at home beyond which another unit is likely.
_LENGTH_FACTOR, _FORCE_FACTOR, _OVER_LIMIT = 3.0, 50.0, 3.0
# Newtons in a pound-force, and how far from it, or its inverse, the forces of each leg may be.
_POUND, _LIKE_POUNDS = 4.4482216152605, 1.4
# The least spike that counts: share of the largest length, and of the RMS force.
_LEAST_LENGTH, _LEAST_FORCE = 2e-6, 5e-3
# Rows with a fault that are interpolated; a longer segment is left out.
_MENDED = 5
_AROUND = 6  # rows on either side that tell what they should have been
# Lengths that vary by fewer standard deviations of their noise are at rest.
_AT_REST = 20.0
_SHORTEST = 20  # rows that tell anything
# More mended rows, or rows that cannot be used, are an alarm; still more, and the log is refused.
_ALARM, _REFUSED = (0.005, 0.15), (0.02, 0.5)
# Length of the filters of rows in periods of the cut-off, and the least length of a segment beyond them.
_FILTERS, _BEYOND = 3 * HALF_LENGTH, 5.0
_EXAMPLES = 3
# Lengths and forces are low-passed at this share of the rows' cut-off, just above the motion.
_OF_CUTOFF, _ROWS_A_PERIOD = 1 / 8, 10
# Two forces are exchanged if what the motion does not explain of them falls to this share, and was at least so much.
_FALLS_TO, _AT_LEAST = 0.25, 0.05
# Noise of forces by that of lengths, as a share of the forces' changes; what is above this share of 1/h is noise.
_HIDDEN, _REJECTED = 0.003, 0.2


class Screened(NamedTuple):
    """What of logs can be fitted."""

    parts: list[Part]
    notes: list[str]
    alarms: list[str]
    cutoff: float | None  # of the filter [Hz]; None if a method may choose it for each part


def screened(
    logs: Sequence[Log],
    platform: Platform,
    validation: float = VALIDATION,
    validating: Sequence[Log] = (),
    cutoff: float | None = None,
) -> Screened:
    """The parts of logs, with what was mended, left out or recognised.

    Single spikes and a few lost rows are interpolated; clipped and frozen segments and longer gaps are left out, and
    so are the filters' lengths beside them. Rows that were lost while times went on divide a log. A share of each log
    at its end, and all of the logs that are `validating`, validate the fit.
    """
    if not 0 <= validation < 1:
        raise LogError(f"validation is {validation:g}; expected a share of the log, 0 or more and less than 1")
    shares = [validation] * len(logs) + [1.0] * len(validating)
    of_logs = [
        _of_log(log, platform, cutoff, which, share)
        for which, (log, share) in enumerate(zip([*logs, *validating], shares, strict=True))
    ]
    parts = [part for of_log in of_logs for part in of_log.parts]
    notes = [note for of_log in of_logs for note in of_log.notes]
    alarms = [alarm for of_log in of_logs for alarm in of_log.alarms]
    # short segments do not tell how fast the motion is
    highest = max(of_log.cutoff or math.inf for of_log in of_logs)
    return Screened(parts, notes, alarms, highest if len(parts) > len(of_logs) else cutoff)


def _of_log(  # noqa: PLR0912, PLR0915 - one station after the other
    log: Log, platform: Platform, cutoff: float | None, which: int, validation: float
) -> Screened:
    check_units(log, platform)
    part, is_missing, notes = _on_even_rows(log, which)
    if not is_missing.any():
        part, notes = without_held_rows(part)
        is_missing = np.zeros(len(part.time), dtype=bool)
    where, time, length, force = part.where, part.time, part.length, part.force
    begin, end = float(time[0]), float(time[-1])

    missing = np.repeat(is_missing[:, None], 6, axis=1)
    none = np.zeros_like(missing)
    # a held force is a command, which the actuator obeys at its limit, too
    beyond = none if part.holds_force else clipped(force, of_legs(platform, "actuator_force_max", np.inf))
    still, silent = frozen(length, True, missing), frozen(force, False, beyond | missing)
    unknown_length, unknown_force = still | missing, silent | beyond | missing
    off, length = spikes(length, unknown_length, _LEAST_LENGTH * float(np.abs(length).max()))
    struck, force = spikes(force, unknown_force, _LEAST_FORCE * float(np.sqrt((force**2).mean())))
    motor, unknown_motor, bumped = part.motor, missing, none
    if motor is not None:
        unknown_motor = frozen(motor, True, missing) | missing
        bumped, motor = spikes(motor, unknown_motor, _LEAST_LENGTH * float(np.abs(motor).max()))
    lost = lost_rows(length, unknown_length)
    travel, unsure = float(np.ptp(length, axis=0).max()), float(noise_of(length).max())
    if len(time) > _SHORTEST and travel <= _AT_REST * unsure:
        raise LogError(
            f"{where}: the legs move by {travel:.3g} m, hardly more than the noise of their lengths, {unsure:.2g} "
            "m; expected a motion: record one that is designed for the parameters (gough-stewart excite)"
        )
    encoder, logger = "check the encoder and its cable", "check the encoder and the logger"
    for fault, readings, remedy in (
        ("spikes in the leg length", off, f"interpolated; {encoder}"),
        ("spikes in the force", struck, "interpolated; check the force sensor and its cable"),
        ("spikes in the motor position", bumped, f"interpolated; {encoder}"),
        ("frozen readings of the motor position", unknown_motor & ~missing, f"left out; {logger}"),
        ("frozen readings of the leg length", still, f"left out; {logger}"),
        ("frozen readings of the force", silent, "left out; check the force sensor and the logger"),
        ("clipped readings of the force", beyond,
         "left out; use a larger range of the force sensor, or a slower motion"),
    ):  # fmt: skip
        if readings.any():
            notes.append(f"{where}: {_told(fault, readings, time)}; {remedy}")

    def places(lost: Sequence[MissingRows]) -> str:
        return _first([f"{time[place.row]:.4g} s ({place.number:+.0f})" for place in lost], "more")

    of_all = [place for place in lost if len(place.legs) > 1]
    if of_all:
        notes.append(
            f"{where}: rows were lost (+) or repeated (−) though times go on, since all legs jump, at "
            f"{places(of_all)}; the log is divided there; check the logger"
        )
    alarms = [
        f"{where}: rows of the length of leg {leg + 1} alone were lost (+) or repeated (−) at {places(of_leg)}, so "
        "that its readings belong to other times from then on; values and intervals are not valid; check the logger"
        for leg in range(6)
        if (of_leg := [place for place in lost if place.legs == (leg,)])
    ]

    # short runs of bad rows are interpolated; good rows between longer ones, and between lost rows, are the segments
    bad = np.asarray((unknown_length | unknown_force | unknown_motor).any(axis=1))
    short = np.zeros(len(bad), dtype=bool)
    for first, last in runs_of(bad):
        short[first:last] = last - first <= _MENDED and first > 0 and last < len(bad)
    for values, unknown in ((length, unknown_length), (force, unknown_force), (motor, unknown_motor)):
        if values is not None:
            _interpolate(values, unknown & short[:, None])
    cuts = [place.row for place in of_all]
    ends = ([int(a), *(cut for cut in cuts if a < cut < b), int(b)] for a, b in runs_of(~(bad & ~short)))
    segments = [slice(*pair) for inner in ends for pair in pairwise(inner)]
    longest = max(segments, key=lambda rows: rows.stop - rows.start, default=slice(0, 0))
    h = float(np.median(np.diff(time)))
    if cutoff is None and longest.stop - longest.start > _SHORTEST:
        cutoff = cutoff_of(length[longest], h)
    if len(segments) > 1 and cutoff is not None:
        least_rows = (_FILTERS + _BEYOND) / cutoff / h
        segments = [rows for rows in segments if rows.stop - rows.start >= least_rows]
    mended = float(((off | struck | bumped).any(axis=1) | short).mean())
    left_out = 1 - sum(rows.stop - rows.start for rows in segments) / len(time)
    if mended > _REFUSED[0] or left_out > _REFUSED[1]:
        raise LogError(
            f"{where}: too many faults of its data: {100 * mended:.2g} % of the rows were to be interpolated and "
            f"{100 * left_out:.2g} % left out; record again. Found: "
            + "; ".join(note.removeprefix(f"{where}: ") for note in notes)
        )
    if mended > _ALARM[0] or left_out > _ALARM[1]:
        alarms.append(
            f"{where}: {100 * mended:.2g} % of the rows were interpolated and {100 * left_out:.2g} % left out; "
            "where so many readings are wrong, others may be that do not show"
        )
    until = -math.inf if validation == 1 else end - validation * (end - begin) if validation else math.inf
    whole = replace(part, length=length, force=force, motor=motor, fitted_until=until)
    return Screened([whole.rows(rows) for rows in segments], notes, alarms, cutoff)


def check_units(log: Log, platform: Platform) -> None:
    """Refuse logs of a few rows, readings that are no numbers, of dead sensors, or in another unit."""
    where, force = log.where, log.actuator_force
    if force is None:
        raise LogError(
            f"{where}: no forces; expected columns actuator_force[1..6], or motor_current[1..6] with force_per_current"
        )
    if len(log) < _SHORTEST:
        raise LogError(f"{where}: {len(log)} rows; expected a log of some seconds")
    for name in ("time", "leg_length", "actuator_force", "motor_position"):
        values = getattr(log, name)
        if values is None:
            continue
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, *leg = bad[0].tolist()
            index = f"[{leg[0] + 1}]" if leg else ""
            raise LogError(
                f"{where}: {name}{index} in row {row + 1} is {values[tuple(bad[0])]}; expected a finite number: "
                "cut the log there, or fill the gap where it was recorded"
            )
        dead = np.flatnonzero(np.ptp(values, axis=0) == 0)
        # commands may be constant; lengths that are all constant are those of a machine at rest
        if name != "time" and dead.size and (dead.size < 6 if name != "actuator_force" else not log.holds_force):
            raise LogError(
                f"{where}: {name}[{dead[0] + 1}] is {values[0, dead[0]]:.6g} in all rows; expected readings of a "
                "sensor: check its channel"
            )

    def unit_for(ratio: float, units: dict[str, float]) -> str:
        likely = [u for u, factor in units.items() if 1 / _LENGTH_FACTOR < ratio / factor < _LENGTH_FACTOR]
        if not likely:
            return ""
        return f"They look like {likely[0]}: write the unit into the column names, such as 'name[1] [{likely[0]}]'. "

    home = np.asarray(leg_geometry(platform, platform.home_position, platform.home_orientation).length)
    median = np.median(log.leg_length, axis=0)
    ratio = median / home
    k = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
    if not 1 / _LENGTH_FACTOR < ratio[k] < _LENGTH_FACTOR:
        raise LogError(
            f"{where}: leg {k + 1} has a median length of {median[k]:.6g} m, but {home[k]:.6g} m at home; expected "
            f"similar lengths. {unit_for(ratio[k], {'cm': 1e2, 'mm': 1e3, 'um': 1e6})}If encoders count from home, "
            "add the length at home"
        )
    weight = float(np.linalg.norm(static_leg_forces(platform, platform.home_position, platform.home_orientation)))
    usual = float(np.median(np.linalg.norm(force, axis=1)))
    ratio_of_forces = usual / weight if weight > 0 else 1.0
    if not 1 / _FORCE_FACTOR < ratio_of_forces < _FORCE_FACTOR:
        raise LogError(
            f"{where}: the six forces have a median norm of {usual:.4g} N, but those that hold the platform at home "
            f"have {weight:.4g} N; expected similar forces. {unit_for(ratio_of_forces, {'kN': 1e-3, 'mN': 1e3})}"
            "Otherwise check force_per_current"
        )
    limits, largest = of_legs(platform, "actuator_force_max", np.inf), np.abs(force).max(axis=0)
    leg = int((largest / limits).argmax())
    if largest[leg] > _OVER_LIMIT * limits[leg]:
        raise LogError(
            f"{where}: a force of {largest[leg]:.6g} N exceeds actuator_force_max, {limits[leg]:g} N; check the unit, "
            "force_per_current, and the platform's limit"
        )


def cutoff_within_noise(log: Log, platform: Platform) -> float:
    """A cut-off of a log whose friction steps [Hz]: `cutoff_of`, or less where noise of the lengths would hide it.

    Accelerations of legs with stiction have no highest frequency. White noise σ of lengths becomes a force of about
    m (2π f)² σ √(2 f h/5) in rows with the cut-off f, m the mass that a leg moves; it may be a share of the forces'.
    """
    check_units(log, platform)
    h, length = rows_apart(log)[2], log.leg_length
    noise = float(noise_beyond(length, h, _REJECTED / h).max())
    mass = platform.platform_mass / 6 + platform.leg_upper_mass + platform.leg_armature
    least = _HIDDEN * float(np.std(np.asarray(log.actuator_force), axis=0).mean())
    quiet = (least / (mass * (2 * math.pi) ** 2 * noise * math.sqrt(2 * h / 5))) ** 0.4
    return max(min(cutoff_of(length, h), float(quiet)), LOWEST)


def compared_forces(parts: Sequence[Part], platform: Platform, cutoff: float | None = None) -> list[str]:
    """Alarms on forces in another unit, by those of the nominal platform along the motion.

    Refuses logs in which two legs' forces follow each other's motion instead of their own: r² leg by leg, up to an
    offset and a factor. Masses that are not nominal hardly matter; legs that move alike are not told apart.
    """
    measured, expected = [], []
    for part in parts:
        h = part.step
        low = _OF_CUTOFF * (cutoff_of(part.length, h) if cutoff is None else cutoff)
        every = max(1, int(1 / (_ROWS_A_PERIOD * low * h)))
        if len(part.time) <= 2 * edge(h, low) + 10 * every:
            continue
        motion = motion_of_lengths(platform, *(smoothed(part.length, h, low, every, k) for k in range(3)))
        expected.append(np.asarray(inverse_dynamics(platform, *motion)))
        measured.append(smoothed(part.force, h, low, every))
    if not measured:
        return []
    read, needed = np.concatenate(measured), np.concatenate(expected)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.nan_to_num(np.corrcoef(np.concatenate([read, needed], axis=1).T)[:6, 6:])
    unexplained, where = 1 - correlation**2, parts[0].where
    for i, j in combinations(range(6), 2):
        now, exchanged = unexplained[[i, j], [i, j]], unexplained[[i, j], [j, i]]
        if now.min() > _AT_LEAST and exchanged.max() < _FALLS_TO * now.min():
            raise LogError(
                f"{where}: the forces of legs {i + 1} and {j + 1} look exchanged: the motion leaves "
                f"{100 * now.min():.0f} % and more of their changes unexplained, but {100 * exchanged.max():.2g} % and "
                "less if each is the other's; exchange the columns of these forces, or of these lengths"
            )
    gains = (read * needed).sum(axis=0) / np.maximum((needed**2).sum(axis=0), 1e-300)
    for factor, unit in (
        (1 / _POUND, "look like lbf: write the unit into the column names, such as 'actuator_force[1] [lbf]'"),
        (_POUND, "look like N that were read as lbf: write [N] into the column names"),
    ):
        if (np.abs(np.log(np.maximum(gains, 1e-9) / factor)) < math.log(_LIKE_POUNDS)).all():
            return [
                f"{where}: the forces of every leg are {gains.min():.3g} to {gains.max():.3g} times those that this "
                f"platform needs, and {unit}. If they are N, its file has other masses than the machine"
            ]
    return []


def _told(fault: str, bad: Mask, time: FloatArray) -> str:
    """The fault with the number of readings, the legs, and times of the first few runs of rows."""
    count, rows = bad.sum(axis=0), np.flatnonzero(bad.any(axis=1))
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > _MENDED) + 1)
    when = _first([f"{time[r[0]]:.4g} s" if len(r) == 1 else f"{time[r[0]]:.4g} to {time[r[-1]]:.4g} s" for r in runs])
    if (count == count[0]).all():
        return f"{count[0]} {fault} of every leg, at {when}"
    if count.sum() == 1:
        fault = fault.replace("spikes", "spike").replace("readings", "reading")
    legs = [str(k + 1) for k in np.flatnonzero(count)]
    return f"{count.sum()} {fault} of leg{'s' if len(legs) > 1 else ''} {', '.join(legs)}, at {when}"


def _first(texts: Sequence[str], others: str = "more times") -> str:
    """The first few texts, and how many more there are."""
    more = f" and {len(texts) - _EXAMPLES} {others}" if len(texts) > _EXAMPLES else ""
    return ", ".join(texts[:_EXAMPLES]) + more


def _on_even_rows(log: Log, which: int) -> tuple[Part, Mask, list[str]]:
    """The log with rows in place of those that are missing by its times, which these are, and a note on them.

    Of a long gap, which will be left out, only a few rows are put in.
    """
    time, number, h = rows_apart(log)
    force = np.asarray(log.actuator_force)
    part = Part(time, log.leg_length, force, log.holds_force, log.side, log.motor_position, log.where, which)
    if (number == 1).all():
        return part, np.zeros(len(log), dtype=bool), []
    at = np.concatenate([[0], np.cumsum(np.minimum(number, _MENDED + 2))])
    rows = np.arange(at[-1] + 1)
    is_missing = ~np.isin(rows, at)
    # a reading is repeated until another one replaces it
    latest = np.searchsorted(at, rows, side="right") - 1
    signals: dict[str, Any] = {
        name: values[latest]
        for name, values in (("length", part.length), ("force", part.force), ("motor", part.motor))
        if values is not None
    }
    for values in signals.values():
        _interpolate(values, np.repeat(is_missing[:, None], 6, axis=1))
    missing = int((number - 1).sum())
    gaps = [
        f"{time[k] + h:.4g} s" + (f" to {time[k + 1] - h:.4g} s" if number[k] > 2 else "")
        for k in np.flatnonzero(number > 1)
    ]
    note = (
        f"{log.where}: {missing} missing row{'s' if missing > 1 else ''}, at {_first(gaps)}; up to {_MENDED} in a row "
        "interpolated, more left out; check the logger"
    )
    return replace(part, time=np.interp(rows, at, time), **signals), is_missing, [note]


def _interpolate(values: FloatArray, bad: Mask) -> None:
    """Replace readings (n, 6) by cubics through their good neighbours; by lines where many are bad in a row."""
    rows = np.arange(len(values))
    for leg in range(values.shape[1]):
        wrong = bad[:, leg]
        if not wrong.any() or wrong.all():
            continue
        good = np.flatnonzero(~wrong)
        values[wrong, leg] = np.interp(rows[wrong], good, values[good, leg])
        for begin, end in runs_of(wrong):
            near = good[max(0, np.searchsorted(good, begin) - _AROUND) : np.searchsorted(good, end) + _AROUND]
            if end - begin <= _MENDED and len(near) == 2 * _AROUND:
                values[begin:end, leg] = np.polynomial.Polynomial.fit(near, values[near, leg], 3)(rows[begin:end])

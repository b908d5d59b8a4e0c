"""From logs to the parts that are fitted: faults of data are mended or left out, or the log is refused."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from gough_stewart.harness.identify.log import (
    VALIDATION,
    Log,
    Part,
    check_forces,
    check_lengths,
    force_of,
    rows_apart,
    sample_time_of,
)
from gough_stewart.harness.identify.regression import HALF_LENGTH, cutoff_of, edge, smoothed
from gough_stewart.harness.identify.regressor import motion_of_lengths
from gough_stewart.model.dynamics import inverse_dynamics
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

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
_OF_CUTOFF = 1 / 8
_ROWS_A_PERIOD = 10
# Two forces are exchanged if what the motion does not explain of them falls to this share, and was at least so much.
_FALLS_TO, _AT_LEAST = 0.25, 0.05


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
    so are the filters' lengths beside them. Rows that were lost while times went on divide a log.

    Parameters
    ----------
    validation
        Share of each log, at its end, that validates the fit.
    validating
        Logs of which all validates the fit.
    cutoff
        Of the filter [Hz]; from the logs by default.

    Raises
    ------
    LogError
        A log that cannot be evaluated, or with too many faults: when, how many, and what helps.
    """
    if not 0 <= validation < 1:
        raise LogError(f"validation is {validation:g}; expected a share of the log, 0 or more and less than 1")
    parts: list[Part] = []
    notes: list[str] = []
    alarms: list[str] = []
    cutoffs: list[float] = []
    for which, log in enumerate([*logs, *validating]):
        share = 1.0 if which >= len(logs) else validation
        of_log = _of_log(log, platform, cutoff, which, share)
        parts += of_log.parts
        notes += of_log.notes
        alarms += of_log.alarms
        cutoffs.append(of_log.cutoff or math.inf)
    # short segments do not tell how fast the motion is
    return Screened(parts, notes, alarms, max(cutoffs) if len(parts) > len(cutoffs) else cutoff)


def _of_log(log: Log, platform: Platform, cutoff: float | None, which: int, validation: float) -> Screened:
    _check_readings(log)
    check_lengths(log, platform)
    check_forces(log, platform)
    log, is_missing, notes = _on_even_rows(log)
    if not is_missing.any():
        log, notes = without_held_rows(log)
        is_missing = np.zeros(len(log), dtype=bool)
    assert log.time is not None  # checked by rows_apart
    time = log.time

    missing = np.repeat(is_missing[:, None], 6, axis=1)
    length, force = log.leg_length, force_of(log)
    # a held force is a command, which the actuator obeys at its limit, too
    beyond = (
        np.zeros_like(missing) if log.holds_force else clipped(force, of_legs(platform, "actuator_force_max", np.inf))
    )
    still, silent = frozen(length, True, missing), frozen(force, False, beyond | missing)
    unknown_length, unknown_force = still | missing, silent | beyond | missing
    off, length = spikes(length, unknown_length, _LEAST_LENGTH * float(np.abs(length).max()))
    struck, force = spikes(force, unknown_force, _LEAST_FORCE * float(np.sqrt((force**2).mean())))
    bumped, halted, motor = _motors(log, missing)
    lost = lost_rows(length, unknown_length)
    travel, unsure = float(np.ptp(length, axis=0).max()), float(noise_of(length).max())
    if len(log) > _SHORTEST and travel <= _AT_REST * unsure:
        raise LogError(
            f"{log.where}: the legs move by {travel:.3g} m, hardly more than the noise of their lengths, {unsure:.2g} "
            "m; expected a motion: record one that is designed for the parameters (gough-stewart excite)"
        )
    for fault, readings, remedy in (
        ("spikes in the leg length", off, "interpolated; check the encoder and its cable"),
        ("spikes in the force", struck, "interpolated; check the force sensor and its cable"),
        ("spikes in the motor position", bumped, "interpolated; check the encoder and its cable"),
        ("frozen readings of the motor position", halted & ~missing, "left out; check the encoder and the logger"),
        ("frozen readings of the leg length", still, "left out; check the encoder and the logger"),
        ("frozen readings of the force", silent, "left out; check the force sensor and the logger"),
        (
            "clipped readings of the force",
            beyond,
            "left out; use a larger range of the force sensor, or a slower motion",
        ),
    ):
        rows = np.flatnonzero(readings.any(axis=1))
        if rows.size:
            notes.append(f"{log.where}: {_legs(fault, readings)}, {_when(time, rows)}; {remedy}")
    of_all = [place for place in lost if len(place.legs) > 1]
    if of_all:
        notes.append(
            f"{log.where}: rows were lost (+) or repeated (−) though times go on, since all legs jump, at "
            f"{_places(time, of_all)}; the log is divided there; check the logger"
        )
    alarms = [
        f"{log.where}: rows of the length of leg {leg + 1} alone were lost (+) or repeated (−) at "
        f"{_places(time, of_leg)}, so that its readings belong to other times from then on; values and intervals are "
        "not valid; check the logger"
        for leg in range(6)
        if (of_leg := [place for place in lost if place.legs == (leg,)])
    ]

    bad = np.asarray((unknown_length | unknown_force | halted).any(axis=1))
    short = _in_short_runs(bad)
    for values, unknown in ((length, unknown_length), (force, unknown_force), (motor, halted)):
        if values is not None:
            _interpolate(values, unknown & short[:, None])
    log = replace(log, leg_length=length, actuator_force=force, motor_position=motor)
    segments = _segments(bad & ~short, [place.row for place in of_all])
    longest = max(segments, key=lambda rows: rows.stop - rows.start, default=slice(0, 0))
    h = float(np.median(np.diff(time)))
    if longest.stop - longest.start > _SHORTEST:
        cutoff = cutoff_of(length[longest], h) if cutoff is None else cutoff
    if len(segments) > 1 and cutoff is not None:
        least_rows = (_FILTERS + _BEYOND) / cutoff / h
        segments = [rows for rows in segments if rows.stop - rows.start >= least_rows]
    mended = float(((off | struck | bumped).any(axis=1) | short).mean())
    left_out = 1 - sum(rows.stop - rows.start for rows in segments) / len(log)
    if mended > _REFUSED[0] or left_out > _REFUSED[1]:
        raise LogError(
            f"{log.where}: too many faults of its data: {100 * mended:.2g} % of the rows were to be interpolated and "
            f"{100 * left_out:.2g} % left out; record again. Found: "
            + "; ".join(note.removeprefix(f"{log.where}: ") for note in notes)
        )
    if mended > _ALARM[0] or left_out > _ALARM[1]:
        alarms.append(
            f"{log.where}: {100 * mended:.2g} % of the rows were interpolated and {100 * left_out:.2g} % left out; "
            "where so many readings are wrong, others may be that do not show"
        )
    begin, end = float(time[0]), float(time[-1])
    until = -math.inf if validation == 1 else end - validation * (end - begin) if validation else math.inf
    return Screened([Part(log.rows(rows), until, which) for rows in segments], notes, alarms, cutoff)


def _motors(log: Log, missing: Mask) -> tuple[Mask, Mask, FloatArray | None]:
    """Spikes in the motors' positions, readings that are not known, and the positions without spikes (n, 6)."""
    if log.motor_position is None:
        return np.zeros_like(missing), missing, None
    halted = frozen(log.motor_position, True, missing) | missing
    bumped, motor = spikes(log.motor_position, halted, _LEAST_LENGTH * float(np.abs(log.motor_position).max()))
    return bumped, halted, motor


def _first(texts: Sequence[str], others: str = "more times") -> str:
    """The first few texts, and how many more there are."""
    more = f" and {len(texts) - _EXAMPLES} {others}" if len(texts) > _EXAMPLES else ""
    return ", ".join(texts[:_EXAMPLES]) + more


def _places(time: FloatArray, lost: Sequence[MissingRows]) -> str:
    return _first([f"{time[place.row]:.4g} s ({place.number:+.0f})" for place in lost], "more")


def _check_readings(log: Log) -> None:
    """Refuse logs of a few rows, and sensors that are dead."""
    force_of(log)
    if len(log) < _SHORTEST:
        raise LogError(f"{log.where}: {len(log)} rows; expected a log of some seconds")
    for name in ("leg_length", "actuator_force", "motor_position"):
        if getattr(log, name) is None:
            continue
        values = np.asarray(getattr(log, name))
        dead = np.flatnonzero(np.ptp(values, axis=0) == 0)
        # commands may be constant; lengths that are all constant are those of a machine at rest
        if dead.size and (dead.size < 6 if name != "actuator_force" else not log.holds_force):
            raise LogError(
                f"{log.where}: {name}[{dead[0] + 1}] is {values[0, dead[0]]:.6g} in all rows; expected readings of a "
                "sensor: check its channel"
            )


def _on_even_rows(log: Log) -> tuple[Log, Mask, list[str]]:
    """The log with rows in place of those that are missing by its times, which these are, and a note on them.

    Of a long gap, which will be left out, only a few rows are put in.
    """
    number, h = rows_apart(log)
    if (number == 1).all():
        return log, np.zeros(len(log), dtype=bool), []
    assert log.time is not None  # checked by rows_apart
    at = np.concatenate([[0], np.cumsum(np.minimum(number, _MENDED + 2))])
    rows = np.arange(at[-1] + 1)
    # a reading is repeated until another one replaces it
    even = log.rows(np.searchsorted(at, rows, side="right") - 1)
    is_missing = ~np.isin(rows, at)
    even = replace(even, time=np.interp(rows, at, log.time))
    for values in (even.leg_length, force_of(even), even.motor_position):
        if values is not None:
            _interpolate(values, np.repeat(is_missing[:, None], 6, axis=1))
    missing = int((number - 1).sum())
    gaps = [
        f"{log.time[k] + h:.4g} s" + (f" to {log.time[k + 1] - h:.4g} s" if number[k] > 2 else "")
        for k in np.flatnonzero(number > 1)
    ]
    note = (
        f"{log.where}: {missing} missing row{'s' if missing > 1 else ''}, at {_first(gaps)}; up to {_MENDED} in a row "
        "interpolated, more left out; check the logger"
    )
    return even, is_missing, [note]


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


def _in_short_runs(bad: Mask) -> Mask:
    """Rows in runs of bad ones that are interpolated."""
    short = np.zeros(len(bad), dtype=bool)
    for begin, end in runs_of(bad):
        short[begin:end] = end - begin <= _MENDED and begin > 0 and end < len(bad)
    return short


def _segments(bad: Mask, cuts: Sequence[int]) -> list[slice]:
    """Runs of good rows, also divided before the rows `cuts`."""
    ends = ((int(begin), *(cut for cut in cuts if begin < cut < end), int(end)) for begin, end in runs_of(~bad))
    return [slice(a, b) for inner in ends for a, b in pairwise(inner)]


def _legs(fault: str, bad: Mask) -> str:
    """The fault with the number of readings and the legs."""
    count = bad.sum(axis=0)
    if (count == count[0]).all():
        return f"{count[0]} {fault} of every leg"
    if count.sum() == 1:
        fault = fault.replace("spikes", "spike").replace("readings", "reading")
    legs = [k + 1 for k in np.flatnonzero(count)]
    return f"{count.sum()} {fault} of leg{'s' if len(legs) > 1 else ''} {', '.join(map(str, legs))}"


def _when(time: FloatArray, rows: NDArray[np.intp]) -> str:
    """Times of the first few runs of rows, and how many there are."""
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > _MENDED) + 1)
    texts = [
        f"{time[run[0]]:.4g} s" if len(run) == 1 else f"{time[run[0]]:.4g} to {time[run[-1]]:.4g} s" for run in runs
    ]
    return f"at {_first(texts)}"


def check_order_of_forces(parts: Sequence[Part], platform: Platform, cutoff: float | None = None) -> None:
    """Refuse logs in which two legs' forces follow each other's motion instead of their own.

    The forces of the nominal platform along the motion, up to an offset and a factor, are compared with those of the
    log, r² leg by leg. Masses that are not nominal hardly matter; legs that move alike are not told apart.

    Raises
    ------
    LogError
        Names the two legs.
    """
    measured, expected = [], []
    for part in parts:
        h = sample_time_of(part.log)
        low = _OF_CUTOFF * (cutoff_of(part.log.leg_length, h) if cutoff is None else cutoff)
        every = max(1, int(1 / (_ROWS_A_PERIOD * low * h)))
        if len(part.log) <= 2 * edge(h, low) + 10 * every:
            continue
        motion = motion_of_lengths(platform, *(smoothed(part.log.leg_length, h, low, every, k) for k in range(3)))
        expected.append(np.asarray(inverse_dynamics(platform, *motion)))
        measured.append(smoothed(force_of(part.log), h, low, every))
    if not measured:
        return
    forces = np.concatenate([np.concatenate(measured), np.concatenate(expected)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        unexplained = 1 - np.nan_to_num(np.corrcoef(forces.T)[:6, 6:]) ** 2
    for i, j in combinations(range(6), 2):
        now, exchanged = unexplained[[i, j], [i, j]], unexplained[[i, j], [j, i]]
        if now.min() > _AT_LEAST and exchanged.max() < _FALLS_TO * now.min():
            raise LogError(
                f"{parts[0].log.where}: the forces of legs {i + 1} and {j + 1} look exchanged: the motion leaves "
                f"{100 * now.min():.0f} % and more of their changes unexplained, but {100 * exchanged.max():.2g} % and "
                "less if each is the other's; exchange the columns of these forces, or of these lengths"
            )

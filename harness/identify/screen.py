"""From logs to the parts that are fitted: faults of data are mended or left out, or the log is refused."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.log import VALIDATION, Log, Part, rows_apart
from gough_stewart.harness.identify.lowpass import HALF_LENGTH, LOWEST, cutoff_of, edge, noise_beyond, smoothed
from gough_stewart.harness.identify.regressor import smooth_motion, states_of
from gough_stewart.model.dynamics import inverse_dynamics, static_leg_forces
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.parameters import of_legs
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

Mask = NDArray[np.bool_]

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
# A reading is a spike if it is off by so many standard deviations of noise; fewer do no harm.
_SPIKE = 8.0
# Readings on either side of suspects that tell what they should have been, and the longest spike in rows.
_BESIDE, _LONGEST_SPIKE = 8, 8
# Repeated readings from which on they may be frozen; a frozen one jumps by so many usual changes when it moves again.
_FROZEN, _JUMP = 5, 4.0
# Readings at the very limit from which on they may be clipped, and how many times as many as just below it.
_CLIPPED, _MORE_THAN_BELOW = 5, 5.0
# Readings on either side of a gap that tell how much time passed in it; when a jump is sure; and the share of the
# length below which it may be a sudden force.
_SIDE, _SURE, _SUDDEN = 6, 12.0, 1e-6
# Relative changes that are none, and that are motion.
_ROUNDING, _FAR = 1e-9, 1e-4
# Readings that change at least this often tell how long each is held, if this share of changes keeps the rhythm.
_CHANGES, _RHYTHM = 40, 0.995
_LONGEST_HOLD = 60  # rows
# Faster signals pass a low-pass before rows are left out: gain 1 up to half of it, 0 from the new Nyquist frequency on.
_CUTOFF = 2 / 3
# The cubic through four neighbours, and its effect on white noise together with the reading.
_NEIGHBOURS = np.array([-1.0, 4.0, 4.0, -1.0]) / 6
_GAIN = float(np.sqrt(1 + (_NEIGHBOURS**2).sum()))


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


def _of_log(  # noqa: PLR0915 - one station after the other
    log: Log, platform: Platform, cutoff: float | None, which: int, validation: float
) -> Screened:
    check_units(log, platform)
    part, is_missing, notes = _on_even_rows(log, which)
    if not is_missing.any():
        part, notes = without_held_rows(part)
        is_missing = np.zeros(len(part.time), dtype=bool)
    where, time, missing = part.where, part.time, np.repeat(is_missing[:, None], 6, axis=1)
    begin, end = float(time[0]), float(time[-1])

    signals = {"leg length": part.length, "force": part.force}
    if part.motor is not None:
        signals["motor position"] = part.motor
    # a held force is a command, which the actuator obeys at its limit, too
    is_command, limit = part.holds_force, of_legs(platform, "actuator_force_max", np.inf)
    beyond = np.zeros_like(missing) if is_command else clipped(part.force, limit)
    stuck, unknown, off = dict[str, Mask](), dict[str, Mask](), dict[str, Mask]()
    for name, values in signals.items():
        of_force = name == "force"
        known_bad = missing | beyond if of_force else missing
        stuck[name] = frozen(values, not of_force, known_bad)
        unknown[name] = stuck[name] | known_bad
        least = _LEAST_FORCE * np.sqrt((values**2).mean()) if of_force else _LEAST_LENGTH * np.abs(values).max()
        off[name], signals[name] = spikes(values, unknown[name], float(least))
    length = signals["leg length"]
    lost = lost_rows(length, unknown["leg length"])
    travel, unsure = float(np.ptp(length, axis=0).max()), float(noise_of(length).max())
    if len(time) > _SHORTEST and travel <= _AT_REST * unsure:
        raise LogError(
            f"{where}: the legs move by {travel:.3g} m, hardly more than the noise of their lengths, {unsure:.2g} "
            "m; expected a motion: record one that is designed for the parameters (gough-stewart excite)"
        )
    sensors = {name: "force sensor" if name == "force" else "encoder" for name in signals}
    faults = [(f"spikes in the {name}", off[name], f"interpolated; check the {sensors[name]} and its cable")
              for name in signals]  # fmt: skip
    faults += [(f"frozen readings of the {name}", stuck[name], f"left out; check the {sensors[name]} and the logger")
               for name in ("motor position", "leg length", "force") if name in signals]  # fmt: skip
    larger = "left out; use a larger range of the force sensor, or a slower motion"
    faults.append(("clipped readings of the force", beyond, larger))
    notes += [
        f"{where}: {_told(fault, readings, time)}; {remedy}" for fault, readings, remedy in faults if readings.any()
    ]

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
    bad = np.any(list(unknown.values()), axis=(0, 2))
    short = np.zeros(len(bad), dtype=bool)
    for first, last in runs_of(bad):
        short[first:last] = last - first <= _MENDED and first > 0 and last < len(bad)
    for name, values in signals.items():
        _interpolate(values, unknown[name] & short[:, None])
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
    mended = float((np.any(list(off.values()), axis=(0, 2)) | short).mean())
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
    motor = signals.get("motor position")
    whole = replace(part, length=length, force=signals["force"], motor=motor, fitted_until=until)
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
        _, motion = smooth_motion(part, platform, low, every)
        expected.append(np.asarray(inverse_dynamics(platform, *states_of(motion))))
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


def runs_of(mask: Mask) -> NDArray[np.intp]:
    """The first row of each run of marked rows, and the one after its last (k, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]))).reshape(-1, 2)


def noise_of(values: FloatArray) -> FloatArray:
    """Standard deviation (6,) of white noise: each reading against the cubic through its four neighbours, robustly.

    Smaller by nothing than the step in which readings come.
    """
    spread = 1.4826 * np.median(np.abs(_against_neighbours(values)), axis=0) / _GAIN
    return np.asarray(np.maximum(spread, step_of(values) / np.sqrt(12)))


def step_of(values: FloatArray) -> FloatArray:
    """The smallest change of each leg's readings (6,): the resolution of its sensor, or next to nothing."""
    changes = np.abs(np.diff(values, axis=0))
    smallest = np.where(changes > 1e-12 * np.abs(values).max(), changes, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(smallest), smallest, 0.0))


def _against_neighbours(values: FloatArray) -> FloatArray:
    """Readings (n − 4, 6) less the cubic through two neighbours on either side."""
    sides = (values[:-4], values[1:-3], values[3:-1], values[4:])
    return np.asarray(values[2:-2] - np.tensordot(_NEIGHBOURS, np.stack(sides), 1))


def spikes(values: FloatArray, known_bad: Mask, smallest: float) -> tuple[Mask, FloatArray]:
    """Single or few readings off what their neighbours on both sides agree on, by more than `smallest`; and the rest.

    Readings that are `known_bad` (n, 6) are not looked at.
    """
    is_spike, mended = np.zeros(values.shape, dtype=bool), values.copy()
    if len(values) < 4 * _BESIDE:
        return is_spike, mended
    limit = np.maximum(_SPIKE * noise_of(values), smallest)
    suspect = np.zeros(values.shape, dtype=bool)
    suspect[2:-2] = (np.abs(_against_neighbours(values)) > limit * _GAIN) & ~known_bad[2:-2]
    for leg in range(values.shape[1]):
        rows = np.flatnonzero(suspect[:, leg])
        for group in np.split(rows, np.flatnonzero(np.diff(rows) > _BESIDE) + 1) if rows.size else ():
            window = slice(max(0, group[0] - _BESIDE), min(len(values), group[-1] + _BESIDE + 1))
            outside, expected = _outliers(values[window, leg], float(limit[leg]))
            if outside.any() and not known_bad[window, leg].any():
                at = np.flatnonzero(outside) + window.start
                is_spike[at, leg], mended[at, leg] = True, expected[outside]
    return is_spike, mended


def _outliers(y: FloatArray, limit: float) -> tuple[Mask, FloatArray]:
    """Readings off a cubic through the others by more than `limit`, and the cubic; none if the others disagree too."""
    basis = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(y)), 3)
    weights = np.ones(len(y))
    for _ in range(20):
        # least absolute deviations: the majority decides
        expected = basis @ np.linalg.lstsq(basis * weights[:, None], y * weights, rcond=None)[0]
        weights = 1 / np.sqrt(np.maximum(np.abs(y - expected), 1e-3 * limit))
    off = np.abs(y - expected) > limit
    for _ in range(3):
        if off.sum() > min(_LONGEST_SPIKE, len(y) // 3) or off[:3].any() or off[-3:].any():
            return np.zeros(len(y), dtype=bool), y
        expected = basis @ np.linalg.lstsq(basis[~off], y[~off], rcond=None)[0]
        error = y - expected
        # a step or a kink of the signal leaves as much beside the suspects
        off = np.abs(error) > max(limit, _SPIKE * float(np.sqrt((error[~off] ** 2).mean())))
    return off, expected


def frozen(values: FloatArray, is_continuous: bool, not_looked_at: Mask) -> Mask:
    """Readings that stay at a value while the leg moves on.

    Where noise should change a reading it does not, or, of a signal that cannot jump, it jumps to where the leg has
    moved meanwhile. A signal that `is_continuous` cannot jump: lengths cannot, forces can.
    """
    is_frozen = np.zeros(values.shape, dtype=bool)
    size = float(np.abs(values).max())
    changes = np.abs(np.diff(values, axis=0))
    changes[changes < _ROUNDING * size] = 0.0
    steps = step_of(values)
    for leg in range(values.shape[1]):
        moved = np.flatnonzero(changes[:, leg]) + 1
        for begin, end in zip(np.append(0, moved), np.append(moved, len(values)), strict=True):
            if end - begin < _FROZEN or not_looked_at[begin, leg]:
                continue
            before, after = changes[max(0, begin - 12) : begin, leg], changes[end : end + 11, leg]
            around = np.concatenate([before, after])
            usual = max(float(around.max(initial=0.0)), float(steps[leg]), _ROUNDING * size)
            jumps = is_continuous and end < len(values) and changes[end - 1, leg] > _JUMP * usual
            is_noisy = len(around) >= 10 and (around == 0).mean() < 0.1
            if silent := is_noisy and end - begin >= 2 * _FROZEN:
                # second differences of noise change sign, those of motion do not
                for side in (values[max(0, begin - 30) : begin + 1, leg], values[end : end + 31, leg]):
                    bends = np.diff(side, 2)
                    silent &= not (len(bends) >= 10 and (bends[1:] * bends[:-1]).sum() > -0.3 * (bends**2).sum())
            # up to the end of the log only the others tell that it should have moved
            stops = is_continuous and end == len(values) and end - begin >= 4 * _FROZEN
            if stops:
                others = np.delete(np.ptp(values[begin:], axis=0) > np.maximum(20 * steps, _FAR * size), leg)
                stops = others.sum() >= 4 and (before > 0).mean() > 0.5
            if jumps or silent or stops:
                is_frozen[begin + 1 : end, leg] = True
    return is_frozen


def clipped(force: FloatArray, actuator_limit: FloatArray) -> Mask:
    """Forces (n, 6) at the end of their sensor's range, and those next to them.

    Many readings equal the largest or the smallest one, which they reach at speed, and hardly any is just below it. A
    force at the actuator's own limit is one that the actuator has.
    """
    is_clipped = np.zeros(force.shape, dtype=bool)
    spread = noise_of(force)
    for leg in range(force.shape[1]):
        for sign in (1.0, -1.0):
            y = sign * force[:, leg]
            top, count = np.unique(y, return_counts=True)
            level = float(top[-1])
            if abs(level) >= (1 - 1e-6) * actuator_limit[leg]:
                continue
            if len(top) < 4 or count[-1] < _CLIPPED or count[-1] <= _MORE_THAN_BELOW * count[-4:-1].max(initial=1):
                continue
            at = y == level
            entries = np.abs(np.diff(y))[at[1:] != at[:-1]]
            if not len(entries) or np.median(entries) < 0.2 * np.median(np.abs(np.diff(y))):
                continue  # a force that comes to rest at its largest value
            # noise takes some readings below the limit while the force is beyond it
            mean = np.convolve(np.pad(y, 10, mode="edge"), np.full(21, 1 / 21), mode="valid")
            for begin, end in runs_of(at | (mean > level - 3 * spread[leg])):
                is_clipped[begin:end, leg] |= at[begin:end].any()
    return is_clipped


class MissingRows(NamedTuple):
    """Rows that are missing before row `row`, though times go on."""

    row: int
    number: float  # of rows; negative if rows are repeated
    legs: tuple[int, ...]  # all, or one


def lost_rows(length: FloatArray, known_bad: Mask) -> list[MissingRows]:
    """Where lengths (n, 6) go on as if rows were missing: legs jump by their velocity times whole samples.

    Quadratics through the rows on either side, extrapolated to the middle, differ by L̇ τ if a time τ is missing; their
    slopes agree. All legs jump alike, or one alone. Rows near `known_bad` readings (n, 6) are not looked at.
    """
    if len(length) < 6 * _SIDE:
        return []
    t = np.arange(_SIDE) + 0.5
    inverse = np.linalg.pinv(np.stack([np.ones(_SIDE), t, t**2], axis=1))
    windows = np.lib.stride_tricks.sliding_window_view(length, _SIDE, axis=0)
    # at the middle between rows k + _SIDE − 1 and k + _SIDE, from either side
    right = windows[_SIDE:] @ inverse[:2].T
    left = windows[: len(right)][..., ::-1] @ inverse[:2].T
    jump, velocity = right[..., 0] - left[..., 0], (right[..., 1] - left[..., 1]) / 2
    bend = right[..., 1] + left[..., 1]
    usual = 1.4826 * float(np.median(np.abs(jump)))
    spread = max(usual, 2 * float(noise_of(length).max()), _SUDDEN * float(np.abs(length).max()))
    bad = np.lib.stride_tricks.sliding_window_view(np.asarray(known_bad.any(axis=1)), 2 * _SIDE)
    is_near_bad = np.asarray(bad.any(axis=1))[: len(right)]
    others = np.sqrt(np.maximum((jump**2).sum(axis=1, keepdims=True) - jump**2, 0.0))
    places: list[MissingRows] = []
    for legs in (tuple(range(6)), *((leg,) for leg in range(6))):
        v = velocity[:, legs]
        speed = np.maximum(np.linalg.norm(v, axis=1), 1e-300)
        along = (jump[:, legs] * v).sum(axis=1) / speed
        number, size = along / speed, np.abs(along)
        from_whole = np.abs(number - np.rint(number))
        rest = np.linalg.norm(jump[:, legs] - number[:, None] * v, axis=1)
        # times that jitter make every row look a little early or late
        jitter = 1.4826 * float(np.median(np.abs(number[speed >= np.median(speed)])))
        sure = (size > _SURE * spread) & (np.abs(number) > max(0.5, _SURE * jitter))
        sure &= (np.linalg.norm(bend[:, legs], axis=1) < 0.3 * speed) & (rest < 0.3 * size + 6 * spread) & ~is_near_bad
        sure &= from_whole < 0.15 + 4 * spread / speed
        if len(legs) == 1:
            sure &= (others[:, legs[0]] < 6 * spread) & (from_whole < 0.1)
        for k in np.flatnonzero(sure):
            if size[k] == size[max(0, k - _SIDE) : k + _SIDE + 1].max():
                places.append(MissingRows(int(k) + _SIDE, float(number[k]), legs))
    return places


def hold_of(values: FloatArray) -> tuple[int, int]:
    """How many rows each reading of a sensor (n,) is held, and the first row at which it changes; 1 if at every row.

    An encoder that moves slowly repeats its readings too, but changes them at any row; a held reading changes them at
    every k-th row only.
    """
    changes = np.flatnonzero(np.diff(values)) + 1
    for rows in range(_LONGEST_HOLD, 1, -1) if len(changes) >= _CHANGES else ():
        count = np.bincount(changes % rows, minlength=rows)
        if count.max() >= _RHYTHM * len(changes):
            return rows, int(count.argmax())
    return 1, 0


def without_held_rows(part: Part) -> tuple[Part, list[str]]:
    """The rows at which the slower signal was read, and notes on what was recognised.

    The faster signal, lengths or forces, passes a low-pass with zero phase before rows are left out.
    """
    signals = {"length": part.length, "force": part.force}
    words = {"length": "leg lengths", "force": "forces"}
    holds: dict[str, tuple[int, int]] = {}
    for name, values in signals.items():
        # legs that hardly move have no rhythm of their own; a longer rhythm contains the shorter one of others
        held = sorted({hold for hold in map(hold_of, values.T) if hold[0] > 1})
        if len(held) > 1 and held[0][0] == held[-1][0]:
            raise LogError(
                f"{part.where}: {words[name]} are held for {held[0][0]} rows, but legs change at different rows "
                f"({', '.join(str(phase + 1) for _, phase in held)}); expected sensors that are read at the same "
                "time: log each reading once, with its own time"
            )
        holds[name] = held[0] if held else (1, 0)
    slow = max(holds, key=lambda name: holds[name][0])
    every, phase = holds[slow]
    if every == 1:
        return part, []
    h, n = part.step, len(part.time)
    notes = [
        f"{part.where}: {words[name]} change at every {rows}. row only, so sensors are read every {1e3 * rows * h:.4g} "
        "ms"
        for name, (rows, _) in holds.items()
        if rows > 1
    ]
    at = np.arange(phase, n, every)
    changed: dict[str, Any] = {}
    first, last = 0, len(at)
    for name, (rows, start) in holds.items():
        if (rows, start) == (every, phase):
            continue
        # the place of the first target between the signal's own rows
        offset = (phase - start) % rows
        is_held_force = part.holds_force and name == "force"
        delay = offset * h - (rows * h / 2 if is_held_force else 0.0)
        cutoff = _CUTOFF * 0.5 / (every * h)
        filtered = smoothed(signals[name][start::rows], rows * h, cutoff, 1, 0, delay)
        index = (at - start - offset) // rows - edge(rows * h, cutoff)
        inside = np.flatnonzero((index >= 0) & (index < len(filtered)))
        values = np.full((len(at), 6), np.nan)
        values[inside] = filtered[index[inside]]
        changed[name] = values
        first = max(first, int(inside[0]) if inside.size else 0)
        last = min(last, int(inside[-1]) + 1 if inside.size else 0)
    if last - first < 2:
        raise LogError(f"{part.where}: {n} rows are too few for readings that are held for {every} of them")
    kept = slice(phase + first * every, phase + (last - 1) * every + 1, every)
    # a force that was brought to other rows belongs to its row; one that is held as long as lengths are stays held
    changed = {name: values[first:last] for name, values in changed.items()}
    return replace(part.rows(kept), holds_force=part.holds_force and "force" not in changed, **changed), notes

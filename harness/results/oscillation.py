"""Loops that grow or oscillate by themselves, found in the rows of a run that completed.

A loop is judged where its own behaviour can be told from what acts on it: at the end of the run, after the last row at
which reference, external wrench, injection or parameters change, or something fails; there a sound loop comes to rest.
If something acts to the end, only frequencies far above the reference's own are judged, where it can have no part.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.plants.signals import NAMES
from gough_stewart.harness.report.quantities import LENGTH
from gough_stewart.harness.results.record_data import RecordData
from gough_stewart.model.vectors import FloatArray

# The end of a run is judged if nothing acts for this share of its rows, and at least so many rows.
_REST, _ROWS = 0.2, 32
# Share of the power in the five bins around the strongest line. Broadband noise does not reach it: with k bins in all,
# the largest of k exponentials is seldom above log(k) / k of their sum.
_LINE = 0.8
# A line lasts if its RMS in the second half of the window is at least this share of that in the first, and is steady
# below this one. An error grows if it comes to so many times its early size.
_LASTS, _STEADY, _GROWS = 0.9, 1.3, 2.0
_BLOCKS = 6
_USED = ("error.leg_length", "reference.leg_length", "leg_length")
_INPUTS = ("reference.leg_length", "controller.injection", "external_force", "external_torque")
# What fails, by leg or element of a signal, as the flags of `control/faults.py`.
FAULTS = ("flag.force_cut", *(f"flag.frozen_{name}" for name in NAMES))
# Cycles in the window: without and with a moving reference.
_CYCLES, _CYCLES_MOVING = 3, 8
# A reference has no part in what is so many times above 99.9 % of the power of its accelerations.
_ABOVE, _POWER = 10.0, 0.999
# Least amplitude: in standard deviations of the noise, in steps of the quantisation, and of the mean leg length.
_NOISES, _STEPS, _RELATIVE = 6.0, 3.0, 1e-6

# Larger lengths are no platform's, and their spectra and accelerations may overflow [m].
_LARGEST = 1e9

_REMEDY = "Lower the bandwidth or the delay; `gough-stewart margins` shows what the loop allows"


class Oscillation(NamedTuple):
    """The motion of a loop by itself."""

    is_growing: bool
    leg: int  # with the largest amplitude, from 1
    amplitude: float  # of that leg's error at the end [m]
    frequency: float | None  # [Hz]; None if it does not oscillate
    earlier: float | None  # its largest error at the beginning of the judged part, if it grows [m]
    since: float  # start of the judged part [s]

    def text(self) -> str:
        """In one sentence."""
        length = replace(LENGTH.telling(self.amplitude), digits=3)
        size = length.text(self.amplitude)
        rate = "" if self.frequency is None else f" at {self.frequency:.3g} Hz"
        if self.is_growing:
            grown = f"from {length.range_text(self.earlier or 0.0, self.amplitude)}"
            return f"leg {self.leg}: by itself, the error grows{rate} {grown} after {self.since:.4g} s. {_REMEDY}"
        return f"leg {self.leg} oscillates at {self.frequency:.3g} Hz by itself, with an amplitude of {size}. {_REMEDY}"


@dataclass(frozen=True)
class LegRows:
    """What is judged of a run: the legs over time, and what acts on them."""

    time: FloatArray  # (n,) [s]
    error: FloatArray  # of the leg lengths (n, 6) [m]
    reference: FloatArray  # leg lengths (n, 6) [m]
    rest_begins: int  # see `rest_begins`
    least: Callable[[float], float]  # the amplitude [m] that sensors do not explain, by frequency [Hz]


def oscillation(record: RecordData) -> Oscillation | None:
    """The oscillation or growth that a completed run of a closed loop ends with; None for a sound one."""
    if not all(name in record for name in _USED) or record.metadata["outcome"]["status"] != "completed":
        return None
    choice = record.metadata.get("experiment", {})
    is_open = choice.get("controller", {}).get("type") == "open_loop"
    if record.table.height < _ROWS or (is_open and "controller" not in record.metadata.get("replaced", ())):
        return None
    sensors = choice.get("sensors") or {}
    # a record from elsewhere may have no platform
    points = record.metadata["platform"].get("platform_points", [[0.0, 0.0, 1.0]])
    least = least_amplitude(
        float(record["leg_length"].mean()), points, sensors.get("noise") or {}, sensors.get("quantisation") or {}
    )
    error, reference = record["error.leg_length"], record["reference.leg_length"]
    return self_excited(LegRows(record["time"], error, reference, rest_begins(_acting(record)), least))


def self_excited(rows: LegRows) -> Oscillation | None:
    """The oscillation or growth of a closed loop, by the rows of a whole run; None for a sound one.

    The error is growing if, after the last change of what acts on the loop, it comes to twice the step of the reference
    or twice the largest value of its first half cycle, or rises ever faster. It oscillates if one line of its spectrum
    has most of the power and lasts, with an amplitude above what quantisation and noise of the sensors explain.
    """
    n = len(rows.time)
    # NaN is not below it either
    if n < _ROWS or not all((np.abs(each) < _LARGEST).all() for each in (rows.error, rows.reference)):
        return None
    if n - rows.rest_begins >= max(_ROWS, _REST * n):
        return _at_rest(rows)
    return _in_motion(rows)


def may_move(errors: FloatArray, time: FloatArray, reference: FloatArray, rest_begins: int) -> NDArray[np.bool_]:
    """Members (N,) of which `self_excited` may say something: a quick look at all that have the same reference.

    Parameters
    ----------
    errors
        Of the leg lengths (n, N, 6) [m].
    time, reference, rest_begins
        As of `LegRows`, for all members.
    """
    n = len(time)
    if n < _ROWS:
        return np.zeros(errors.shape[1], dtype=bool)
    at_rest = n - rest_begins >= max(_ROWS, _REST * n)
    begin = rest_begins + (n - rest_begins) // 3 if at_rest else n // 3
    if at_rest:
        lowest, rest = 0, _without(errors[begin:], _basis(n - begin))
        may = _may_grow(errors[rest_begins:], _step(reference, rest_begins))
    else:
        motion = _Motion.of(reference[begin:], time[begin:])
        if motion is None:
            return np.zeros(errors.shape[1], dtype=bool)
        lowest = motion.lowest
        columns = [_without(errors[begin:, :, k], motion.bases[k]) for k in range(6)]
        rest = np.stack(columns, axis=-1)
        may = np.zeros(errors.shape[1], dtype=bool)
    # as `_line`, with bounds a little wider
    half = len(rest) // 2
    late, early = (np.mean(each**2, axis=0) for each in (rest[half:], rest[:half]))
    lasts = np.ones(len(may), dtype=bool)
    if lowest < 2:
        every, leg = np.arange(len(may)), late.argmax(axis=1)
        lasts = late[every, leg] >= (0.95 * _LASTS) ** 2 * early[every, leg]
    at = np.flatnonzero(lasts & ~may)
    if at.size:
        window = np.hanning(len(rest))[:, None, None]
        power = (np.abs(np.fft.rfft(rest[:, at] * window, axis=0)) ** 2).sum(axis=2)
        power[: max(lowest, 1)] = 0
        peak = power.argmax(axis=0)
        near = np.clip(peak + np.arange(-2, 3)[:, None], max(lowest, 1), len(power) - 1)
        share = np.take_along_axis(power, near, axis=0).sum(axis=0)
        least = max(lowest + 3, _CYCLES_MOVING) if lowest else _CYCLES
        may[at] = (peak >= least - 1) & (share >= 0.95 * _LINE * power.sum(axis=0))
    return may


def _may_grow(errors: FloatArray, step: float) -> NDArray[np.bool_]:
    """Members (N,) whose error (n, N, 6) at rest may grow; as `_at_rest` and `_rising`, with bounds a little wider."""
    n, every = len(errors), np.arange(errors.shape[1])
    from_rest = np.abs(errors - errors[-(n // 3) :].mean(axis=0))
    leg = from_rest.max(axis=0).argmax(axis=1)
    one = from_rest[:, every, leg]
    late, early = one[-(n // 3) :].max(axis=0), one[: n // 4].max(axis=0)
    grows = late >= 0.99 * _GROWS * early
    if step > 0:
        grows |= late >= 0.99 * _GROWS * step
    means = np.stack([block.mean(axis=0) for block in np.array_split(errors, _BLOCKS)])
    changes = np.diff(means[:, every, np.abs(means[-1] - means[0]).argmax(axis=1)], axis=0)
    rises = (changes[1:] * changes[:-1] > 0) & (np.abs(changes[1:]) >= 1.14 * np.abs(changes[:-1]))
    return np.asarray(grows | rises.all(axis=0))


def least_amplitude(
    length: float, platform_points: Any, noise: Mapping[str, float], quantisation: Mapping[str, float]
) -> Callable[[float], float]:
    """The amplitude of a leg's error [m] at a frequency [Hz] that noise and quantisation of the sensors do not explain.

    Parameters
    ----------
    length
        Mean leg length [m].
    platform_points
        Joints (6, 3) [m], whose largest distance from Op turns angles into lengths.
    noise, quantisation
        Of the sensors, by signal, in SI units.
    """
    radius = float(np.linalg.norm(np.asarray(platform_points), axis=1).max())

    def least(frequency: float) -> float:
        turns = 2 * math.pi * frequency
        lengths = {"leg_length": 1.0, "position": 1.0, "orientation": radius}
        lengths |= {"leg_velocity": 1 / turns, "velocity": 1 / turns, "angular_velocity": radius / turns}
        explained = [
            factor * value * lengths[name]
            for factor, kind in ((_NOISES, noise), (_STEPS, quantisation))
            for name, value in kind.items()
            if name in lengths
        ]
        return float(max(_RELATIVE * length, *explained, 0.0))

    return least


def last_change(values: FloatArray) -> int:
    """The row after the last at which a column of (n, k) changes; 0 if none does."""
    scale = np.maximum(1.0, np.abs(values).max(axis=0))
    with np.errstate(over="ignore"):
        changes = np.flatnonzero((np.abs(np.diff(values, axis=0)) > 1e-9 * scale).any(axis=1))
    return int(changes[-1]) + 1 if changes.size else 0


def rest_begins(acting: Iterable[NDArray[Any]]) -> int:
    """The row from which a loop is without input: no column (n, k) that acts on it changes, no flag is set."""
    last = (len(values) if values.dtype == bool and values[-1].any() else last_change(values) for values in acting)
    return max(last, default=0)


def _acting(record: RecordData) -> list[NDArray[Any]]:
    """What acts on the loop of a record: its names are those of `acting_columns`."""
    names = (*_INPUTS, *FAULTS, *record.metadata.get("machine", {}))
    return [record[name].reshape(record.table.height, -1) for name in names if name in record]


def _step(legs: FloatArray, row: int) -> float:
    """The largest step of a leg's reference (n, 6) to this row, from rest; 0 if it came in motion [m]."""
    before = legs[max(row - _ROWS, 0) : row]
    if len(before) < 2 or np.ptp(before, axis=0).max() > 1e-9:
        return 0.0
    return float(np.abs(legs[row] - before[-1]).max())


def _at_rest(rows: LegRows) -> Oscillation | None:
    begin, least = rows.rest_begins, rows.least
    error, time, step = rows.error[begin:], rows.time[begin:], _step(rows.reference, begin)
    since, n = float(time[0]), len(error)
    line = _line(_without(error[n // 3 :], _basis(n - n // 3)), time[n // 3 :], least, 0, _CYCLES)
    steady = None if line is None else Oscillation(False, line.leg, line.amplitude, line.frequency, None, since)
    if line is not None and line.ratio < _STEADY:
        return steady
    from_rest: FloatArray = error - error[-(n // 3) :].mean(axis=0)
    leg = int(np.abs(from_rest).max(axis=0).argmax())
    one = from_rest[:, leg]
    crossings = np.flatnonzero(np.diff(np.signbit(one)))
    late = float(np.abs(one[-(n // 3) :]).max())
    rate = (len(crossings) - 1) / 2 / float(time[crossings[-1]] - time[crossings[0]]) if len(crossings) > 1 else None
    # a sound loop does not come farther from a step than it was; it starts there at rest
    if late >= _GROWS * step > 0:
        return Oscillation(True, leg + 1, late, rate, step, since)
    if rate is not None and len(crossings) >= 3:
        early = float(np.abs(one[: max(int(crossings[0]), n // 4)]).max())
        if late >= _GROWS * early and late >= least(rate):
            return Oscillation(True, leg + 1, late, rate, early, since)
    return steady or _rising(error, since, least(1.0))


def _rising(error: FloatArray, since: float, least: float) -> Oscillation | None:
    """An error that leaves its value ever faster: its mean changes more from each block to the next than before.

    Five changes of one sign, each 1.15 times the one before, come from six independent values in less than 1 of 1,000
    cases.
    """
    means = np.stack([block.mean(axis=0) for block in np.array_split(error, _BLOCKS)])
    leg = int(np.abs(means[-1] - means[0]).argmax())
    changes = np.diff(means[:, leg])
    is_faster = (changes[1:] * changes[:-1] > 0) & (np.abs(changes[1:]) >= 1.15 * np.abs(changes[:-1]))
    early, late = (float(abs(error[k, leg])) for k in (0, -1))
    if is_faster.all() and late > early and abs(changes.sum()) >= least:
        return Oscillation(True, leg + 1, late, None, early, since)
    return None


class _Motion(NamedTuple):
    """What a moving reference explains of an error."""

    bases: tuple[FloatArray, ...]  # of each leg: orthonormal columns that span line, length, velocity, acceleration
    lowest: int  # the first bin of the spectrum in which the motion has no part

    @classmethod
    def of(cls, legs: FloatArray, time: FloatArray) -> "_Motion | None":
        """Of lengths of the legs (n, 6); None without accelerations."""
        velocity = np.gradient(legs, time, axis=0)
        acceleration = np.gradient(velocity, time, axis=0)
        line = _basis(len(time))
        own = np.cumsum(_spectrum(_without(acceleration, line)).sum(axis=1))
        if own[-1] <= 0:
            return None
        highest = int(np.searchsorted(own, _POWER * own[-1]))
        bases = tuple(_basis(len(time), [each[:, k] for each in (legs, velocity, acceleration)]) for k in range(6))
        return cls(bases, math.ceil(_ABOVE * max(highest, 1)))


def _in_motion(rows: LegRows) -> Oscillation | None:
    part = slice(len(rows.time) // 3, None)
    time = rows.time[part]
    motion = _Motion.of(rows.reference[part], time)
    if motion is None:
        return None
    error = np.stack([_without(rows.error[part, k], motion.bases[k]) for k in range(6)], axis=1)
    found = _line(error, time, rows.least, motion.lowest, _CYCLES_MOVING)
    if found is None:
        return None
    earlier = found.amplitude / found.ratio if found.ratio >= _STEADY else None
    return Oscillation(earlier is not None, found.leg, found.amplitude, found.frequency, earlier, float(time[0]))


class _Line(NamedTuple):
    leg: int
    frequency: float
    amplitude: float
    ratio: float  # RMS of the second half over that of the first


def _line(
    error: FloatArray, time: FloatArray, least: Callable[[float], float], lowest: int, cycles: int
) -> _Line | None:
    """The line that dominates an error (n, 6) from a bin on, if it lasts and is large enough."""
    n, step = len(error), float(time[1] - time[0])
    line = _above(error, lowest)
    size = np.sqrt(2 * np.mean(line[n // 2 :] ** 2, axis=0))
    leg = int(size.argmax())
    before = math.sqrt(2 * float(np.mean(line[: n // 2, leg] ** 2)))
    ratio = float(size[leg]) / before if before > 0 else math.inf
    # most loops are sound, and end here
    if ratio < _LASTS:
        return None
    power = _spectrum(error).sum(axis=1)
    if len(power) <= lowest + 8:
        return None
    band = power.copy()
    band[:lowest] = 0
    peak = int(band.argmax())
    near = slice(max(peak - 2, lowest), peak + 3)
    # what leaks from below the band falls from its edge on
    if peak < cycles or (lowest and peak < lowest + 3) or band[near].sum() < _LINE * band.sum():
        return None
    frequency = _between(power, peak) / (n * step)
    if size[leg] < least(frequency):
        return None
    return _Line(leg + 1, frequency, float(size[leg]), ratio)


def _above(values: FloatArray, lowest: int) -> FloatArray:
    """Values (n, k) without what is below a bin of their spectrum, and without their mean."""
    if lowest < 2:
        return np.asarray(values - values.mean(axis=0))
    kept = np.fft.rfft(values, axis=0)
    kept[:lowest] = 0
    line: FloatArray = np.fft.irfft(kept, len(values), axis=0)
    return line


def _spectrum(values: FloatArray) -> FloatArray:
    """Power by bin of a Hann window over (n, k)."""
    window = np.hanning(len(values))[:, None]
    power: FloatArray = np.abs(np.fft.rfft(values * window, axis=0)) ** 2
    power[0] = 0
    return power


def _between(power: FloatArray, peak: int) -> float:
    """The place of a maximum between bins, by a parabola through the logarithms."""
    if not 0 < peak < len(power) - 1 or power[peak - 1 : peak + 2].min() <= 0:
        return float(peak)
    low, middle, high = np.log(power[peak - 1 : peak + 2])
    return float(peak + 0.5 * (low - high) / (low - 2 * middle + high))


def _basis(n: int, signals: Iterable[FloatArray] = ()) -> FloatArray:
    """Orthonormal columns (n, k) that span a straight line and signals (n,), as far as these are independent."""
    columns = np.column_stack([np.ones(n), np.linspace(-1, 1, n), *signals])
    scale = np.abs(columns).max(axis=0)
    U, singular, _ = np.linalg.svd(columns[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(U[:, singular > n * np.finfo(float).eps * singular[0]])


def _without(values: FloatArray, basis: FloatArray) -> FloatArray:
    """Values (n, ...) without what a basis (n, k) explains."""
    flat = values.reshape(len(values), -1)
    return np.asarray(flat - basis @ (basis.T @ flat)).reshape(values.shape)

"""How a run ended, and whether its loop grows or oscillates without input: found in the rows of a run that completed.

A loop is judged where its own behaviour can be told from what acts on it: at the end of the run, after the last row at
which reference, external wrench, injection or parameters change, or something fails; there a sound loop comes to rest.
If something acts to the end, only frequencies far above the reference's own are judged, where it can have no part.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
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
# What fails, by leg or element of a signal, as the flags of `control/component.py`.
FAULTS = ("flag.force_cut", *(f"flag.frozen_{name}" for name in NAMES))
# While the controller is off.
MANUAL = "flag.manual"
# The fewest cycles in the window; with a moving reference, `_ABOVE` asks for more.
_CYCLES = 3
# A reference has no part in what is so many times above 99.9 % of the power of its accelerations.
_ABOVE, _POWER = 10.0, 0.999
# Least amplitude: in standard deviations of the noise, in steps of the quantisation, and of the mean leg length.
_NOISES, _STEPS, _RELATIVE = 6.0, 3.0, 1e-6
# Larger lengths are no platform's, and their spectra and accelerations may overflow [m].
_LARGEST = 1e9

_REMEDY = "Lower the bandwidth or the delay; `gough-stewart margins` shows what the loop allows"


class Oscillation(NamedTuple):
    """The self-excited motion of a loop."""

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
            return f"leg {self.leg}: without input, the error grows{rate} {grown} after {self.since:.4g} s. {_REMEDY}"
        at = f"oscillates at {self.frequency:.3g} Hz without input"
        return f"leg {self.leg} {at}, with an amplitude of {size}. {_REMEDY}"


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
    # what acts on the loop, by the names of `acting_columns`
    names = (*_INPUTS, *FAULTS, MANUAL, *record.metadata.get("machine", {}))
    acting = [record[name].reshape(record.table.height, -1) for name in names if name in record]
    legs = np.ascontiguousarray(record["reference.leg_length"].T)

    def least_of(_: int, frequency: float) -> float:
        length, noise, quantisation = record["leg_length"].mean(), sensors.get("noise"), sensors.get("quantisation")
        return least_amplitude(frequency, float(length), points, noise or {}, quantisation or {})

    errors = record["error.leg_length"][:, :, None]
    return self_excitation(record["time"], legs, rest_begins(acting), errors, least_of)[0]


@np.errstate(all="ignore")  # errors may be no platform's
def self_excitation(  # noqa: PLR0915 - one road, in sections
    time: FloatArray,
    reference: FloatArray,
    begin: int,
    errors: FloatArray,
    least_of: Callable[[int, float], float],
) -> list[Oscillation | None]:
    """The oscillation or growth of each of N closed loops on which the same acts, by their whole runs; None if sound.

    The error is growing if, after the last change of what acts on the loop, it comes to twice the step of the reference
    or twice the largest value of its first half cycle, or rises ever faster. It oscillates if one line of its spectrum
    has most of the power and lasts, with an amplitude above what quantisation and noise of the sensors explain.

    Loops share the times of the rows (n,) [s], the reference's leg lengths (6, n) [m], and the row from which nothing
    acts. Errors of the leg lengths are (n, 6, N) [m]; `least_of` gives the amplitude [m] that sensors do not explain,
    of the k-th loop at a frequency [Hz].
    """
    n, members = len(time), np.arange(errors.shape[2])
    motions: list[Oscillation | None] = [None] * len(members)
    # NaN is not below it either
    if n < _ROWS or not (np.abs(reference) < _LARGEST).all():
        return motions

    if n - begin < max(_ROWS, _REST * n):
        # what a moving reference explains of the errors: a line, its length, velocity and acceleration; of what is
        # without accelerations nothing. Its motion has no part in bins of the spectrum from the lowest one on.
        start = n // 3
        legs, rows = reference[:, start:], time[start:]
        velocity = np.gradient(legs, rows, axis=1)
        acceleration = np.gradient(velocity, rows, axis=1)
        power = np.cumsum(_spectrum(_without(acceleration, _basis(len(rows)))))
        if not power[-1] > 0:
            return motions
        bases = [_basis(len(rows), leg) for leg in zip(legs, velocity, acceleration, strict=True)]
        lowest = math.ceil(_ABOVE * max(int(np.searchsorted(power, _POWER * power[-1])), 1))
        for k in range(len(members)):
            of_legs = np.ascontiguousarray(errors[start:, :, k].T)
            unexplained = np.stack([_without(leg, basis) for leg, basis in zip(of_legs, bases, strict=True)])
            line, ratio = _line(unexplained, rows, partial(least_of, k), lowest)
            if line is not None and ratio >= _STEADY:
                line = line._replace(is_growing=True, earlier=line.amplitude / ratio)
            motions[k] = line if (np.abs(errors[..., k]) < _LARGEST).all() else None
        return motions

    # the largest step of a leg's reference to the row from which nothing acts, from rest; 0 if it came in motion [m]
    before_it, step = reference[:, max(begin - _ROWS, 0) : begin], 0.0
    if before_it.shape[1] >= 2 and np.ptp(before_it, axis=1).max() <= 1e-9:
        step = float(np.abs(reference[:, begin] - before_it[:, -1]).max())
    # without a straight line, the last two thirds of what follows may have a line that lasts
    start = begin + (n - begin) // 3
    basis = _basis(n - start)
    windows = _without(errors[start:].reshape(-1, errors[0].size).T, basis).T
    half = len(windows) // 2
    late_power, early_power = (np.mean(part**2, axis=0).reshape(6, -1) for part in (windows[half:], windows[:half]))
    leg = late_power.argmax(axis=0)
    may_last = late_power[leg, members] >= 0.99 * _LASTS**2 * early_power[leg, members]
    at_rest, time_at_rest = errors[begin:], time[begin:]
    since, n_at_rest = float(time_at_rest[0]), len(time_at_rest)
    from_rest = at_rest - at_rest[-(n_at_rest // 3) :].mean(axis=0)
    far_leg = np.abs(from_rest).max(axis=0).argmax(axis=0)
    of_far_leg = from_rest[:, far_leg, members]
    late, early = (np.abs(part).max(axis=0) for part in (of_far_leg[-(n_at_rest // 3) :], of_far_leg[: n_at_rest // 4]))
    # a sound loop does not come farther from a step than it was; it starts there at rest
    leaves_step = (late >= _GROWS * step) & (step > 0)
    comes_far = leaves_step | (late >= _GROWS * early)
    # its mean changes more from each block to the next than before: five changes of one sign, each 1.15 times the
    # one before, come from six independent values in less than 1 of 1,000 cases.
    means = np.stack([block.mean(axis=0) for block in np.array_split(at_rest, _BLOCKS)])
    rising_leg = np.abs(means[-1] - means[0]).argmax(axis=0)
    changes = np.diff(means[:, rising_leg, members], axis=0)
    is_faster = (changes[1:] * changes[:-1] > 0) & (np.abs(changes[1:]) >= 1.15 * np.abs(changes[:-1]))
    first, last = np.abs(at_rest[[0, -1]][:, rising_leg, members])
    rises = is_faster.all(axis=0) & (last > first)
    # most loops are sound
    for k in np.flatnonzero(may_last | comes_far | rises).tolist():
        window, least = np.ascontiguousarray(errors[start:, :, k].T), partial(least_of, k)
        line, ratio = _line(_without(window, basis), time[start:], least, 0)
        motion = steady = line and line._replace(since=since)
        if comes_far[k] and not (steady is not None and ratio < _STEADY):
            crossings = np.flatnonzero(np.diff(np.signbit(of_far_leg[:, k])))
            rate, amplitude, before = None, float(late[k]), step
            if len(crossings) > 1:
                rate = (len(crossings) - 1) / 2 / float(time_at_rest[crossings[-1]] - time_at_rest[crossings[0]])
            grows = bool(leaves_step[k])
            if not grows and rate is not None and len(crossings) >= 3:
                before = float(np.abs(of_far_leg[: max(int(crossings[0]), n_at_rest // 4), k]).max())
                grows = amplitude >= max(_GROWS * before, least(rate))
            if grows:
                motion = Oscillation(True, int(far_leg[k]) + 1, amplitude, rate, before, since)
        if motion is None and rises[k] and abs(changes[:, k].sum()) >= least(1.0):
            motion = Oscillation(True, int(rising_leg[k]) + 1, float(last[k]), None, float(first[k]), since)
        motions[k] = motion if (np.abs(errors[..., k]) < _LARGEST).all() else None
    return motions


def least_amplitude(
    frequency: float, length: float, platform_points: Any, noise: Mapping[str, float], quantisation: Mapping[str, float]
) -> float:
    """The amplitude of a leg's error [m] at a frequency [Hz] that noise and quantisation of the sensors do not explain.

    These are standard deviations and steps by signal; the largest distance of the joints (6, 3) from Op turns angles
    into lengths, and a share of the mean leg length is never told.
    """
    radius, turns = float(np.linalg.norm(np.asarray(platform_points), axis=1).max()), 2 * math.pi * frequency
    lengths = {"leg_length": 1.0, "position": 1.0, "orientation": radius}
    lengths |= {"leg_velocity": 1 / turns, "velocity": 1 / turns, "angular_velocity": radius / turns}
    largest = _RELATIVE * length
    for factor, kind in ((_NOISES, noise), (_STEPS, quantisation)):
        largest = max(largest, *(factor * size * lengths.get(name, 0.0) for name, size in kind.items()), 0.0)
    return float(largest)


def rest_begins(acting: Iterable[NDArray[Any]]) -> int:
    """The row from which a loop is without input: no column (n, k) that acts on it changes, no flag is set."""
    begin = 0
    for values in acting:
        if values.dtype == bool and values[-1].any():
            return len(values)
        scale = np.maximum(1.0, np.abs(values).max(axis=0))
        with np.errstate(over="ignore"):
            changes = np.flatnonzero((np.abs(np.diff(values, axis=0)) > 1e-9 * scale).any(axis=1))
        begin = max(begin, int(changes[-1]) + 1 if changes.size else 0)
    return begin


def _line(
    error: FloatArray, time: FloatArray, least: Callable[[float], float], lowest: int
) -> tuple[Oscillation | None, float]:
    """The line that dominates an error (6, n) from a bin on, if it lasts and is large enough.

    Also the RMS of the second half over that of the first.
    """
    n, step = len(time), float(time[1] - time[0])
    line = error
    if lowest:  # without what is below it
        spectrum = np.fft.rfft(error)
        spectrum[:, :lowest] = 0
        line = np.fft.irfft(spectrum, n)
    size = np.sqrt(2 * np.mean(line[:, n // 2 :] ** 2, axis=1))
    leg = int(size.argmax())
    before = math.sqrt(2 * float(np.mean(line[leg, : n // 2] ** 2)))
    ratio = float(size[leg]) / before if before > 0 else math.inf
    # most loops are sound, and end here
    if ratio < _LASTS:
        return None, ratio
    power = _spectrum(error)
    if len(power) <= lowest + 8:
        return None, ratio
    band = power.copy()
    band[:lowest] = 0
    peak = int(band.argmax())
    near = slice(max(peak - 2, lowest), peak + 3)
    # what leaks from below the band falls from its edge on
    if peak < _CYCLES or (lowest and peak < lowest + 3) or band[near].sum() < _LINE * band.sum():
        return None, ratio
    place = float(peak)
    if peak < len(power) - 1 and power[peak - 1 : peak + 2].min() > 0:
        # between bins, by a parabola through the logarithms
        left, middle, right = np.log(power[peak - 1 : peak + 2])
        place += float(0.5 * (left - right) / (left - 2 * middle + right))
    frequency = place / (n * step)
    is_large = size[leg] >= least(frequency)
    return Oscillation(False, leg + 1, float(size[leg]), frequency, None, float(time[0])) if is_large else None, ratio


def _spectrum(values: FloatArray) -> FloatArray:
    """Power of all signals (k, n) together, by bin of a Hann window."""
    power: FloatArray = (np.abs(np.fft.rfft(values * np.hanning(values.shape[-1]))) ** 2).sum(axis=0)
    power[0] = 0
    return power


def _basis(n: int, signals: Iterable[FloatArray] = ()) -> FloatArray:
    """Orthonormal columns (n, k) that span a straight line and signals (n,), as far as these are independent."""
    columns = np.column_stack([np.ones(n), np.linspace(-1, 1, n), *signals])
    scale = np.abs(columns).max(axis=0)
    U, singular, _ = np.linalg.svd(columns[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(U[:, singular > n * np.finfo(float).eps * singular[0]])


def _without(values: FloatArray, basis: FloatArray) -> FloatArray:
    """Values (..., n) without what a basis (n, k) explains."""
    return np.asarray(values - (values @ basis) @ basis.T)


def is_sound(outcome: dict[str, Any]) -> bool:
    """Whether a run with this outcome of its metrics completed, and its loop came to rest or followed its reference."""
    return outcome["status"] == "completed" and not outcome.get("oscillation")


def outcome_text(outcome: dict[str, Any]) -> str:
    """How a run ended, in one line: status, time and, if there is one, cause; and what its loop does without input."""
    cause = f": {outcome['cause']}" if outcome.get("cause") else ""
    motion = f"; {Oscillation(**outcome['oscillation']).text()}" if outcome.get("oscillation") else ""
    return f"{outcome['status']} at {outcome['time']:.6g} s{cause}{motion}"

"""Motions from a table of poses, by quintic splines; low-pass filters, and whether their speed is plausible."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.motion import ROUNDING, Motion, Piecewise, motion_of, polynomials_of_spline
from gough_stewart.model.units import UNITS
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_SPLINE_DEGREE = 5
_SMOOTHING_ORDER, _ANTI_ALIAS_ORDER = 3, 8
# Relative to the new rate. Half of it would keep frequencies just above; docs/motion.md states what this value leaves.
_ANTI_ALIAS_CORNER = 0.4
# In periods of the new rate: time in which the filter's slowest mode, of damping sin(π/16), decays to 0.1 %.
_ANTI_ALIAS_MEMORY = 15
# Share of the mean step below which two times are the same: a spline between them would have any slope.
_SAME = 1e-6

_GRAVITY = 9.81
# r below and above which no platform moves: accelerations of 200 g, and of 2e-6 g.
_TOO_FAST, _TOO_SLOW = 0.1, 1000.0
# r, steps between rows [s] and durations [s] that are plausible in the unit that is guessed
_PLAUSIBLE, _STEPS, _SHORTEST = (1.0, 1000.0), (0.9e-4, 1.1), 0.1
# The middle of plausible r: of several units, the guess is the nearest to it.
_USUAL = 10.0
# Smaller ranges, as a share of the platform's size, are a hold with noise, the same at any speed.
_STILL = 1e-3
# Of the speeds between rows, the quantile that is too fast: a few spikes are not a wrong unit.
_MOST_ROWS = 0.9
_NAMES = {"ns": "nanoseconds", "us": "microseconds", "ms": "milliseconds", "s": "seconds"}


@dataclass(frozen=True, eq=False)
class FromTable(Piecewise):
    """Poses at given times with quintic splines between them, differentiated exactly."""

    time: FloatArray  # (n,) [s]
    position: FloatArray  # (n, 3) [m]
    orientation: FloatArray  # (n, 3) [rad]
    end: float = field(init=False, repr=False)  # time of the last row [s]
    defined_until: float = field(init=False, repr=False)  # the same: nothing is known after it
    _spline: "BSpline" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.time)
        if n <= _SPLINE_DEGREE:
            raise MotionError(f"a table of {n} rows; expected at least {_SPLINE_DEGREE + 1} for quintic splines")
        check_increasing(self.time)
        for name in ("time", "position", "orientation"):
            values = np.array(getattr(self, name), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        for name in ("end", "defined_until"):
            object.__setattr__(self, name, float(self.time[-1]))
        from scipy.interpolate import make_interp_spline  # half a second of imports, needed here only

        pose = np.hstack([self.position, self.orientation])
        object.__setattr__(self, "_spline", make_interp_spline(self.time, pose, k=_SPLINE_DEGREE))

    def __call__(self, time: ArrayLike) -> Motion:
        """The motion at times (n,) [s] from the first row to the last."""
        time = np.asarray(time, dtype=float)
        first, last = float(self.time[0]), float(self.time[-1])
        outside = time[~((time >= first - ROUNDING) & (time <= last + ROUNDING))]  # NaN is outside
        if outside.size:
            raise MotionError(
                f"time {outside[0]:g} s is outside the table, which covers {first:g} to {last:g} s; make the run "
                "shorter or the table longer"
            )
        inside = np.clip(time, first, last)
        return motion_of(*(self._spline(inside, k) for k in range(3)))

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The splines as polynomials: start times (n,) [s], and six each in the time since then (n, 6, 6)."""
        return polynomials_of_spline(self._spline)

    @property
    def centre(self) -> FloatArray:
        """The pose (6,) at time 0, or that of the first row if it is later; amplitudes are scaled about it."""
        begin = self(np.clip([0.0], self.time[0], self.time[-1]))
        return np.concatenate([begin.position[0], begin.orientation[0]])

    def scaled(self, start: float, time_scale: float, amplitude_scale: float) -> "FromTable":
        """From a time [s] on, s times as long, and a times as large about its pose there; splines scale exactly."""
        table = self if start == 0 else FromTable(self.time - start, self.position, self.orientation)
        if time_scale == amplitude_scale == 1:
            return table
        position, orientation = np.split(table.centre, 2)
        return FromTable(
            time_scale * table.time,
            position + amplitude_scale * (table.position - position),
            orientation + amplitude_scale * (table.orientation - orientation),
        )


def check_increasing(time: FloatArray, first: float = 0.0) -> None:
    """Refuse times (n,) [s] that do not increase, or by next to nothing; `first` [s] is added in the message."""
    back = np.flatnonzero(~(np.diff(time) > _SAME * np.ptp(time) / len(time)))
    if back.size:
        k = int(back[0])
        raise MotionError(
            f"time goes from {first + time[k]:g} to {first + time[k + 1]:g} s in row {k + 2}; expected increasing times"
        )


def smoothed(table: FromTable, cutoff: float) -> FromTable:
    """Poses through a zero-phase low-pass of a cut-off fc [Hz], at even times.

    A third-order Butterworth filter, forward and backward: gain 1/(1 + (√2 − 1)(f/fc)⁶), so accelerations caused by
    noise beyond fc decay as f⁻⁴. Rows at uneven times are first resampled by the splines.
    """
    n, rate = len(table.time), _rate_of(table)
    corner = cutoff * (math.sqrt(2) - 1) ** (-1 / (2 * _SMOOTHING_ORDER))
    if not corner < rate / 2:
        raise MotionError(f"smoothing is {cutoff:g} Hz; expected below {rate / 2.32:.3g} Hz, for rows at {rate:.4g} Hz")
    padding = math.ceil(rate / cutoff)  # one period of the cut-off
    if not padding < n:
        raise MotionError(
            f"smoothing is {cutoff:g} Hz; expected above {rate / n:.3g} Hz, for {n} rows at {rate:.4g} Hz"
        )
    return _low_passed(table, corner, _SMOOTHING_ORDER, padding)


def resampled(table: FromTable, rate: float) -> FromTable:
    """Rows at a lower rate [Hz], filtered against aliasing.

    An eighth-order Butterworth filter, forward and backward: gain 1/(1 + (f/(0.4 rate))¹⁶), zero phase. The first and
    the last row keep their times, so the rate is higher than requested by at most one row in total.
    """
    n, present = len(table.time), _rate_of(table)
    if not rate < present:
        raise MotionError(
            f"resample is {rate:g} Hz; expected below {present:.4g} Hz, the rate of the rows; splines interpolate them"
        )
    first, last = float(table.time[0]), float(table.time[-1])
    padding = min(math.ceil(_ANTI_ALIAS_MEMORY * present / rate), n - 1)
    slow = _low_passed(table, _ANTI_ALIAS_CORNER * rate, _ANTI_ALIAS_ORDER, padding)
    time: FloatArray = np.linspace(first, last, math.ceil((last - first) * rate - 1e-9) + 1)
    motion = slow(time)
    return FromTable(time, motion.position, motion.orientation)


def _rate_of(table: FromTable) -> float:
    """The mean rate of the rows [Hz]."""
    return (len(table.time) - 1) / float(table.time[-1] - table.time[0])


def _low_passed(table: FromTable, corner: float, order: int, padding: int) -> FromTable:
    """Forward and backward through a Butterworth filter, with the rows mirrored at both ends."""
    from scipy.signal import butter, sosfiltfilt  # takes a second to import, and is rarely needed

    time: FloatArray = np.linspace(table.time[0], table.time[-1], len(table.time))
    sections = butter(order, corner, fs=_rate_of(table), output="sos")
    pose = sosfiltfilt(sections, np.hstack(table(time)[:2]), axis=0, padtype="odd", padlen=padding)
    return FromTable(time, pose[:, :3], pose[:, 3:])


def check_speed(table: FromTable, unit: float, size: float, time_scale: float = 1.0) -> None:
    """Refuse a motion whose times look as if they were in another unit: a thousand times too slow or too fast.

    A speed is compared with that of a free fall over the motion's own range D: r = √(g D)/v. For a sine, r² is 2 g over
    the largest acceleration: motions of platforms have r from 1 (2 g) to 1000 (positioning at 1 mm/s over 0.1 m).
    Beyond, a motion is refused if another unit makes it one that platforms have, in speed, in the rate of its rows and
    in duration. Times were read in a `unit` [s], and are played `time_scale` times as long; `size` is the platform's
    characteristic length [m].
    """
    pose = np.hstack([table.position, size * table.orientation])
    step = time_scale * np.diff(table.time)
    reach = float(np.linalg.norm(np.ptp(pose, axis=0)))
    if reach < _STILL * size:
        return
    speed = np.linalg.norm(np.diff(pose, axis=0), axis=1) / step
    free_fall = np.sqrt(_GRAVITY * reach)
    largest, usual = float(speed.max()), float(np.quantile(speed, _MOST_ROWS))
    if free_fall > _TOO_SLOW * largest:
        what, ratio = "never faster than", free_fall / largest
    elif free_fall < _TOO_FAST * usual:
        what, ratio, largest = "mostly as fast as", free_fall / usual, usual
    else:
        return
    duration = float(step.sum())
    plausible = dict[str, float]()  # by unit, how many times as long
    for name in _NAMES:
        factor = UNITS["s"][name] / unit
        has_rows = _STEPS[0] <= float(np.median(step)) * factor <= _STEPS[1]
        if _PLAUSIBLE[0] <= ratio * factor <= _PLAUSIBLE[1] and has_rows and duration * factor >= _SHORTEST:
            plausible[name] = factor
    if plausible:
        name = min(plausible, key=lambda name: abs(np.log(ratio * plausible[name] / _USUAL)))
        raise MotionError(
            f"times look like {_NAMES[name]}: over a range of {reach:.3g} m, with angles times {size:.3g} m, the "
            f"motion is {what} {largest:.3g} m/s and takes {duration:.6g} s; in {name} it would take "
            f"{duration * plausible[name]:.6g} s; write the unit in the header, 'time [{name}]', or, if this speed "
            "is meant, unusual_speed = true in the reference"
        )

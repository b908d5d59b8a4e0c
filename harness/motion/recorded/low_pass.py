"""Zero-phase low-pass filters for tables of poses: against noise, and against aliasing before resampling."""

import math

import numpy as np

from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.motion.recorded.table import FromTable
from gough_stewart.model.vectors import FloatArray

_SMOOTHING_ORDER = 3
_ANTI_ALIAS_ORDER = 8
# Relative to the new rate. Half of it would keep frequencies just above; docs/motion.md states what this value leaves.
_ANTI_ALIAS_CORNER = 0.4
# In periods of the new rate: time in which the filter's slowest mode, of damping sin(π/16), decays to 0.1 %.
_ANTI_ALIAS_MEMORY = 15


def smoothed(table: FromTable, cutoff: float) -> FromTable:
    """Poses through a zero-phase low-pass, at even times.

    A third-order Butterworth filter, forward and backward: gain 1/(1 + (√2 − 1)(f/fc)⁶), so accelerations caused by
    noise beyond fc decay as f⁻⁴. Rows at uneven times are first resampled by the splines.

    Parameters
    ----------
    cutoff
        fc [Hz]

    Raises
    ------
    MotionError
        The cut-off is not below half the rate of the rows, or the table is shorter than the filter needs.
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
    """Rows at a lower rate, filtered against aliasing.

    An eighth-order Butterworth filter, forward and backward: gain 1/(1 + (f/(0.4 rate))¹⁶), zero phase. The first and
    the last row keep their times, so the rate is higher than requested by at most one row in total.

    Parameters
    ----------
    rate
        [Hz]

    Raises
    ------
    MotionError
        The rate is not below that of the rows, or leaves fewer rows than the splines need.
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

"""The rows of the linear regression from a log: the same low-pass on forces and on the regressor."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from gough_stewart.harness.identify.checks import check_forces, check_lengths, force_of, sample_time_of
from gough_stewart.harness.identify.linear_parameters import SIZE, regressor
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.movement import motion_of_lengths
from gough_stewart.harness.identify.smoothing import edge, smoothed
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Lengths are filtered and differentiated with this multiple of the rows' cut-off, so their gain is flat below it.
_WIDER = 2.0
# The cut-off is this multiple of the frequency below which the motion's accelerations lie, except for this share.
_ABOVE_MOTION = 16.0
_BEYOND = 1e-3
_LOWEST = 2.0  # [Hz]
# A leg reverses below this multiple of the smoothing velocity of friction, or this share of its usual velocity.
_REVERSAL, _SLOW = 10.0, 0.1
# Rows of the motion per period of the lengths' cut-off.
_ROWS_A_PERIOD = 4


@dataclass(frozen=True)
class Rows:
    """F = W φ + ε at times that are nearly independent after the filter."""

    time: FloatArray  # (m,) [s]
    force: FloatArray  # F (m, 6) [N]
    regressor: FloatArray  # W (m, 6, SIZE)
    cutoff: float  # of the filter on forces and regressor [Hz]
    sliding: FloatArray  # 1 if a leg slides during the whole window of a row, 0 if it reverses (m, 6)


def rows_of(log: Log, platform: Platform, cutoff: float | None = None) -> Rows:
    """The rows of the regression.

    One kernel filters and differentiates the lengths; poses and rates follow by forward kinematics. The forces of
    inverse dynamics for each linear parameter, and the measured forces, then pass another low-pass. It removes noise
    beyond the cut-off, with the same effect on both sides of the equation. Rows are half a period of the cut-off apart,
    so white force noise stays nearly white.

    Parameters
    ----------
    cutoff
        [Hz]; by default `_ABOVE_MOTION` times the highest frequency of the log's motion.

    Raises
    ------
    LogError
        A log that cannot be evaluated, or that does not match this platform.
    """
    h = sample_time_of(log)
    check_lengths(log, platform)
    check_forces(log, platform)
    highest = 0.5 / h / (1.5 * _WIDER)
    cutoff = min(highest, cutoff_of(log.leg_length, h) if cutoff is None else cutoff)
    wide = _WIDER * cutoff
    # each row of the regression is a row of the motion, which is a row of the log
    every = max(1, int(1 / (_ROWS_A_PERIOD * wide * h)))
    thin = max(1, int(1 / (2 * cutoff * h * every)))
    lengths = [smoothed(log.leg_length, h, wide, every, k) for k in range(3)]
    state, acceleration = motion_of_lengths(platform, *lengths)
    W = regressor(platform, state, acceleration).reshape(len(lengths[0]), 6 * SIZE)
    W = smoothed(W, h * every, cutoff, thin)
    first = edge(h, wide) + every * edge(h * every, cutoff)
    at = first + every * thin * np.arange(len(W))
    # a held force belongs to the middle of its sample
    delay = -h / 2 if log.holds_force else 0.0
    force = smoothed(force_of(log), h, cutoff, 1, 0, delay)[at - edge(h, cutoff)]
    # the filter's main lobe
    lobe = math.ceil(0.5 / (cutoff * h * every))
    slowest = minimum_filter1d(np.abs(lengths[1]), 2 * lobe + 1, axis=0)[(at - edge(h, wide)) // every]
    fast = np.minimum(_REVERSAL * platform.leg_friction_velocity, _SLOW * np.sqrt((lengths[1] ** 2).mean(axis=0)))
    assert log.time is not None  # checked by sample_time_of
    return Rows(log.time[at], force, W.reshape(len(W), 6, SIZE), cutoff, np.asarray(slowest > fast, dtype=float))


def joined(rows: Sequence[Rows]) -> Rows:
    """The rows of all parts of logs, one part after the other."""

    def all_of(name: str) -> FloatArray:
        return np.concatenate([getattr(each, name) for each in rows])

    cutoff = max(each.cutoff for each in rows)
    return Rows(all_of("time"), all_of("force"), all_of("regressor"), cutoff, all_of("sliding"))


def cutoff_of(leg_length: FloatArray, sample_time: float) -> float:
    """A cut-off above the motion of a log [Hz]; accelerations matter, since they carry the masses and most noise.

    The spectrum of the lengths, times frequency to the fourth power, up to where it rises again into noise.
    """
    n = len(leg_length)
    window = np.hanning(n)[:, None]
    power = (np.abs(np.fft.rfft((leg_length - leg_length.mean(axis=0)) * window, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(n, sample_time)
    # encoder noise is white: its power is estimated from the upper half
    floor = float(np.median(power[len(power) // 2 :]))
    of_acceleration = np.maximum(power - 10 * floor, 0.0) * frequency**4
    share = np.cumsum(of_acceleration) / max(float(of_acceleration.sum()), 1e-300)
    highest = float(frequency[int(np.searchsorted(share, 1 - _BEYOND))])
    return max(_ABOVE_MOTION * highest, _LOWEST)

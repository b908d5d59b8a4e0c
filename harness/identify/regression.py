"""From a log to the rows of the linear regression: the same low-pass on forces and on what explains them."""

import math
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

# Lengths are differentiated below this multiple of the rows' cut-off, so that their filter is flat for what is left.
_WIDER = 2.0
# Of the motion: the cut-off is this multiple of the frequency below which its accelerations lie, but for that share.
_ABOVE_MOTION = 16.0
_BEYOND = 1e-3
_LOWEST = 2.0  # [Hz]
# A leg turns round below so many times the smoothing velocity of friction, or this share of its usual velocity.
_REVERSAL, _SLOW = 10.0, 0.1
# Rows of the motion in a period of the lengths' cut-off.
_ROWS_A_PERIOD = 4


@dataclass(frozen=True)
class Rows:
    """F = W φ + ε at times that are as far apart as the filter lets them tell something new."""

    time: FloatArray  # (m,) [s]
    force: FloatArray  # F (m, 6) [N]
    regressor: FloatArray  # W (m, 6, SIZE)
    cutoff: float  # of forces and regressor [Hz]
    sliding: FloatArray  # 1 where a leg slides all the time that a row is made of, 0 where it turns round (m, 6)


def rows_of(log: Log, platform: Platform, cutoff: float | None = None) -> Rows:
    """The rows of the regression.

    Lengths are low-passed and differentiated by one kernel; poses and rates follow by forward kinematics; the forces
    of inverse dynamics for each linear parameter, and the measured forces, then go through one further low-pass. So
    noise beyond the cut-off is gone, and what the filter does to one side of the equation it does to the other. Rows
    are half a period of the cut-off apart: white noise of the forces stays nearly white.

    Parameters
    ----------
    cutoff
        [Hz]; found from the log by default: `_ABOVE_MOTION` times the highest frequency of its motion.

    Raises
    ------
    LogError
        A log that cannot be evaluated, or is not of this platform.
    """
    h = sample_time_of(log)
    check_lengths(log, platform)
    check_forces(log, platform)
    highest = 0.5 / h / (1.5 * _WIDER)
    cutoff = min(highest, cutoff_of(log.leg_length, h) if cutoff is None else cutoff)
    wide = _WIDER * cutoff
    # every row of the regression is a row of the motion, and that one of the log
    every = max(1, int(1 / (_ROWS_A_PERIOD * wide * h)))
    thin = max(1, int(1 / (2 * cutoff * h * every)))
    lengths = [smoothed(log.leg_length, h, wide, every, k) for k in range(3)]
    state, acceleration = motion_of_lengths(platform, *lengths)
    W = regressor(platform, state, acceleration).reshape(len(lengths[0]), 6 * SIZE)
    W = smoothed(W, h * every, cutoff, thin)
    first = edge(h, wide) + every * edge(h * every, cutoff)
    at = first + every * thin * np.arange(len(W))
    # a held force is that of the middle of its sample
    delay = -h / 2 if log.holds_force else 0.0
    force = smoothed(force_of(log), h, cutoff, 1, 0, delay)[at - edge(h, cutoff)]
    # the filter's main lobe
    lobe = math.ceil(0.5 / (cutoff * h * every))
    slowest = minimum_filter1d(np.abs(lengths[1]), 2 * lobe + 1, axis=0)[(at - edge(h, wide)) // every]
    fast = np.minimum(_REVERSAL * platform.leg_friction_velocity, _SLOW * np.sqrt((lengths[1] ** 2).mean(axis=0)))
    assert log.time is not None  # as sample_time_of has found
    return Rows(log.time[at], force, W.reshape(len(W), 6, SIZE), cutoff, np.asarray(slowest > fast, dtype=float))


def cutoff_of(leg_length: FloatArray, sample_time: float) -> float:
    """A cut-off above the motion of a log [Hz]: its accelerations are what tells masses, and noise has most of them.

    The spectrum of the lengths, times the frequency to the fourth, up to where it rises again into noise.
    """
    n = len(leg_length)
    window = np.hanning(n)[:, None]
    power = (np.abs(np.fft.rfft((leg_length - leg_length.mean(axis=0)) * window, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(n, sample_time)
    # white noise of encoders has the same power everywhere: that of the upper half
    floor = float(np.median(power[len(power) // 2 :]))
    of_acceleration = np.maximum(power - 10 * floor, 0.0) * frequency**4
    share = np.cumsum(of_acceleration) / max(float(of_acceleration.sum()), 1e-300)
    highest = float(frequency[int(np.searchsorted(share, 1 - _BEYOND))])
    return max(_ABOVE_MOTION * highest, _LOWEST)

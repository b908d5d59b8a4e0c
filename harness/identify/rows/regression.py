"""The rows of the linear regression from a log: the same low-pass on forces and on the regressor."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter1d

from gough_stewart.harness.identify.checks import check_forces, check_lengths, force_of, sample_time_of
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.movement import motion_of_lengths
from gough_stewart.harness.identify.rows.linear_parameters import ARMATURE, INERTIAL, SIZE, friction_columns, regressor
from gough_stewart.harness.identify.rows.noise import KernelCorrelations, kernel_correlations
from gough_stewart.harness.identify.rows.sticking import sliding_rows, sticks, unit_friction
from gough_stewart.harness.identify.smoothing import edge, kernel_of, smoothed
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
# Noise of forces by that of lengths, as a share of the forces' changes; what is above this share of 1/h is noise.
_HIDDEN, _REJECTED = 0.003, 0.2
# Rows of the motion per period of the lengths' cut-off.
_ROWS_A_PERIOD = 4
# Median of |x| of the standard normal distribution.
_MEDIAN = 0.6744897501960817


OfVelocity = Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True)
class Rows:
    """F = W φ + ε at the times of the rows."""

    time: FloatArray  # (m,) [s]
    force: FloatArray  # F (m, 6) [N]
    regressor: FloatArray  # W (m, 6, SIZE)
    cutoff: float  # of the filter on forces and regressor [Hz]
    sliding: FloatArray  # 1 if a leg slides during the whole window of a row, 0 if it reverses (m, 6)


class RawNoise(NamedTuple):
    """Noise of the raw signals, and how it reaches the rows."""

    force: FloatArray  # standard deviation (6,) [N]
    length: float  # [m]
    correlations: KernelCorrelations


@dataclass(frozen=True)
class Regression:
    """The rows of a log, and what their covariance and their derivatives need."""

    rows: Rows
    motion: FloatArray  # at the rows: pose, twist, acceleration (m, 18)
    noise: tuple[RawNoise, ...]  # of each part of the log
    sizes: tuple[int, ...]  # rows of each part
    # F if the log's forces are late by this [s]
    force_if_late: Callable[[float], FloatArray]
    # d(W φ)/dt for φ (SIZE,) (m, 6) [N/s]
    rate: Callable[[FloatArray], FloatArray]
    # of leg velocities (j, 6), this step [s] apart, a function (j, k), or its rate, filtered like the forces (m, k)
    filtered: Callable[[OfVelocity, int], FloatArray]


def regression_of(log: Log, platform: Platform, cutoff: float | None = None) -> Regression:
    """The rows of the regression.

    One kernel filters and differentiates the lengths; poses and rates follow by forward kinematics. The forces of
    inverse dynamics for each linear parameter, and the measured forces, then pass another low-pass. It removes noise
    beyond the cut-off, with the same effect on both sides of the equation. Rows are half a period of the cut-off apart.

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
    W = regressor(platform, state, acceleration).reshape(len(lengths[0]), 6, SIZE)
    if log.motor_position is not None:
        # rotor and screw are on the motors' side
        W[:, :, ARMATURE] = smoothed(log.motor_position, h, wide, every, 2)
    inertial = smoothed(W[:, :, :INERTIAL].reshape(len(W), -1), h * every, cutoff, thin)
    first = edge(h, wide) + every * edge(h * every, cutoff)
    at = first + every * thin * np.arange(len(inertial))
    # friction steps where a leg reverses, so it needs all rows of the log
    motors = log.leg_length if log.motor_position is None else log.motor_position
    velocity = smoothed(motors, h, wide, 1, 1)

    raw_rows = at - edge(h, wide) - edge(h, cutoff)

    def filtered(of: OfVelocity, derivative: int = 0) -> FloatArray:
        return smoothed(of(velocity, h), h, cutoff, 1, derivative)[raw_rows]

    per_unit = friction_columns(platform, velocity)
    if sticks(platform):
        per_unit[:, 6:] = unit_friction(platform, velocity, h)
    friction = filtered(lambda _v, _h: per_unit).reshape(len(at), 2, 6)
    alone = [friction[:, k, :, None] * np.eye(6) for k in range(2)]
    whole = np.concatenate([inertial.reshape(len(at), 6, INERTIAL), *alone], axis=2)

    def rate(phi: FloatArray) -> FloatArray:
        smooth = smoothed(W[:, :, :INERTIAL] @ phi[:INERTIAL], h * every, cutoff, thin, 1)
        own = phi[INERTIAL:].reshape(2, 6)
        return smooth + filtered(lambda _v, _h: (per_unit.reshape(-1, 2, 6) * own).sum(axis=1), 1)

    # a held force belongs to the middle of its sample
    held = -h / 2 if log.holds_force else 0.0

    def force_if_late(delay: float) -> FloatArray:
        return smoothed(force_of(log), h, cutoff, 1, 0, held + delay)[at - edge(h, cutoff)]

    # the filter's main lobe
    lobe = math.ceil(0.5 / (cutoff * h * every))
    motion_rows = (at - edge(h, wide)) // every
    # through the rows' filter, so that derivatives at these motions have no noise that the regressor does not have
    motion = smoothed(np.concatenate([state.to_vector(), *acceleration], axis=1), h * every, cutoff, thin)
    if sticks(platform):
        slid = sliding_rows(platform, velocity, h)
        sliding = minimum_filter1d(slid, 2 * lobe * every + 1, axis=0)[at - edge(h, wide)]
    else:
        slowest = minimum_filter1d(np.abs(lengths[1]), 2 * lobe + 1, axis=0)[motion_rows]
        fast = np.minimum(_REVERSAL * platform.leg_friction_velocity, _SLOW * np.sqrt((lengths[1] ** 2).mean(axis=0)))
        sliding = np.asarray(slowest > fast, dtype=float)
    assert log.time is not None  # checked by sample_time_of
    rows = Rows(log.time[at], force_if_late(0.0), whole, cutoff, sliding)
    noise = _raw_noise(log, h, cutoff, every, thin)
    return Regression(rows, motion, (noise,), (len(at),), force_if_late, rate, filtered)


def _raw_noise(log: Log, h: float, cutoff: float, every: int, thin: int) -> RawNoise:
    """Noise of the raw signals from what the wider low-pass rejects, and its correlations in the rows."""
    wide = _WIDER * cutoff
    to_rows, between = kernel_of(h, cutoff), kernel_of(h * every, cutoff)
    spread = np.zeros(every * (len(between) - 1) + 1)
    spread[::every] = between
    to_lengths = np.stack([np.convolve(spread, kernel_of(h, wide, d)) for d in range(3)])
    of_force, of_length = (_noise(values, h, wide) for values in (force_of(log), log.leg_length))
    correlations = kernel_correlations(to_rows, to_lengths, every * thin)
    return RawNoise(of_force, float(np.sqrt((of_length**2).mean())), correlations)


def _noise(values: FloatArray, h: float, wide: float) -> FloatArray:
    """Standard deviation of white noise in each channel, from the median of what the low-pass rejects."""
    kernel, lost = kernel_of(h, wide), slice(edge(h, wide), -edge(h, wide))
    rejected = np.abs(values[lost] - smoothed(values, h, wide))
    share = 1 - 2 * kernel[len(kernel) // 2] + float(kernel @ kernel)
    least = np.finfo(float).eps * np.abs(values).max()
    return np.asarray(np.median(rejected, axis=0) / _MEDIAN / math.sqrt(max(share, 1e-3)) + least)


def joined(parts: Sequence[Regression]) -> Regression:
    """The rows of all parts of logs, one part after the other."""

    def all_of(name: str) -> FloatArray:
        return np.concatenate([getattr(each.rows, name) for each in parts])

    cutoff = max(each.rows.cutoff for each in parts)
    return Regression(
        Rows(all_of("time"), all_of("force"), all_of("regressor"), cutoff, all_of("sliding")),
        np.concatenate([each.motion for each in parts]),
        tuple(noise for each in parts for noise in each.noise),
        tuple(size for each in parts for size in each.sizes),
        lambda delay: np.concatenate([each.force_if_late(delay) for each in parts]),
        lambda phi: np.concatenate([each.rate(phi) for each in parts]),
        lambda of, derivative: np.concatenate([each.filtered(of, derivative) for each in parts]),
    )


def cutoff_within_noise(log: Log, platform: Platform) -> float:
    """A cut-off of a log whose friction steps [Hz]: `cutoff_of`, or less where noise of the lengths would hide it.

    Accelerations of a leg that sticks have no highest frequency. White noise σ of the lengths becomes a force of about
    m (2π f)² σ √(2 f h/5) in rows with the cut-off f, m the mass that a leg moves; it may be a share of the forces'.
    """
    h = sample_time_of(log)
    noise = float(_noise(log.leg_length, h, _REJECTED / h).max())
    mass = platform.platform_mass / 6 + platform.leg_upper_mass + platform.leg_armature
    least = _HIDDEN * float(np.std(force_of(log), axis=0).mean())
    quiet = (least / (mass * (2 * math.pi) ** 2 * noise * math.sqrt(2 * h / 5))) ** 0.4
    return max(min(cutoff_of(log.leg_length, h), float(quiet)), _LOWEST)


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

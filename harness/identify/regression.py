"""The rows of the linear regression from logs: the same zero-phase low-pass on forces and on the regressor."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import oaconvolve

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.friction import sliding_rows, sticks, unit_friction
from gough_stewart.harness.identify.log import Log, force_of, sample_time_of
from gough_stewart.harness.identify.regressor import (
    ARMATURE,
    INERTIAL,
    SIZE,
    friction_columns,
    motion_of_lengths,
    regressor,
)
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Half-length of the low-pass in periods of the cut-off: gain 1 up to half the cut-off, ½ at it, 0 beyond one and a half
# times the cut-off.
HALF_LENGTH = 2.75
# The window cos⁴(π t/2T) = a0 + a1 cos(π t/T) + a2 cos(2π t/T); at its ends it is 0 up to the third derivative.
_WINDOW = (0.375, 0.5, 0.125)
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
# Correlations below this share of the largest are cut off; the kernels' windows make them vanish.
_NEGLIGIBLE = 1e-5

OfVelocity = Callable[[FloatArray, float], FloatArray]


def smoothed(
    values: FloatArray, sample_time: float, cutoff: float, every: int = 1, derivative: int = 0, delay: float = 0.0
) -> FloatArray:
    """The low-passed signal or its derivative, at every k-th of those rows that have the filter's full length.

    (k * x)(t) with k(t) = 2 f_c sinc(2 f_c t) w(t); its derivative uses that of the kernel, k̇ * x, so values, first
    and second derivatives belong to the same smooth signal.

    Parameters
    ----------
    values
        (n, m) at even times.
    sample_time
        [s]
    cutoff
        f_c [Hz], where the gain is ½.
    derivative
        0, 1 or 2.
    delay
        By how much the values are older than their rows state, negative if newer [s].

    Raises
    ------
    LogError
        The log is shorter than the filter.
    """
    kernel = kernel_of(sample_time, cutoff, derivative, delay)
    if len(kernel) > len(values):
        raise LogError(
            f"{len(values)} rows at {1 / sample_time:.4g} Hz are shorter than the filter of {cutoff:.3g} Hz, "
            f"{len(kernel)} rows; expected a longer log, or a higher cut-off"
        )
    # correlation, not convolution: row k + half of the log is row k of the result
    offset = values.mean(axis=0)
    low = oaconvolve(values - offset, kernel[:, None], mode="valid", axes=0)
    return np.asarray(low + offset if derivative == 0 else low)[::every]


def kernel_of(sample_time: float, cutoff: float, derivative: int = 0, delay: float = 0.0) -> FloatArray:
    """Weights (2 `edge` + 1,) of the samples about a row, as `smoothed` convolves them."""
    half = edge(sample_time, cutoff)
    t = np.asarray(np.arange(-half, half + 1) * sample_time + delay, dtype=float)
    kernels = _kernel(t, cutoff)
    # a constant passes unchanged, and has no derivative
    kernel = kernels[derivative] / kernels[0].sum()
    if derivative:
        kernel -= kernel.mean()
        # lines and parabolas have theirs exactly: samples of a kernel of few rows would miss by up to 0.15 %
        kernel /= (kernel @ (-t) ** derivative) / math.factorial(derivative)
    return np.asarray(kernel)


def edge(sample_time: float, cutoff: float) -> int:
    """Rows at either end of a log that the filter drops."""
    return math.ceil(HALF_LENGTH / cutoff / sample_time)


def _kernel(t: FloatArray, cutoff: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The kernel and its first two derivatives, by the product rule."""
    w0, T = 2 * math.pi * cutoff, HALF_LENGTH / cutoff
    # sin(w0 t)/(π t) and derivatives; near 0 by series
    x = w0 * t
    small = np.abs(x) < 1e-2
    safe = np.where(small, 1.0, x)
    sinc, slope = np.sin(safe) / safe, (np.cos(safe) - np.sin(safe) / safe) / safe
    s0 = np.where(small, 1 - x**2 / 6 + x**4 / 120, sinc)
    s1 = np.where(small, -x / 3 + x**3 / 30, slope)
    s2 = np.where(small, -1 / 3 + x**2 / 10, -sinc - 2 * slope / safe)
    (a, b, c), p, q, inside = _WINDOW, math.pi / T, 2 * math.pi / T, np.abs(t) < T
    v0 = inside * (a + b * np.cos(p * t) + c * np.cos(q * t))
    v1 = inside * (-b * p * np.sin(p * t) - c * q * np.sin(q * t))
    v2 = inside * (-b * p * p * np.cos(p * t) - c * q * q * np.cos(q * t))
    gain = 2 * cutoff
    return (
        gain * s0 * v0,
        gain * (w0 * s1 * v0 + s0 * v1),
        gain * (w0 * w0 * s2 * v0 + 2 * w0 * s1 * v1 + s0 * v2),
    )


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


class KernelCorrelations(NamedTuple):
    """Covariances of filtered unit white noise, m rows apart."""

    force: FloatArray  # (g ⋆ g)(m) (M + 1,)
    length: FloatArray  # (c_d ⋆ c_d')(m) (M + 1, 3, 3)


def kernel_correlations(force: FloatArray, length: FloatArray, spacing: int) -> KernelCorrelations:
    """Covariances of the filtered noises, up to the last row that they reach.

    Parameters
    ----------
    force
        Weights of the raw samples in a row of the force (j,).
    length
        Weights in value, velocity and acceleration (3, j), of the same parity.
    spacing
        Raw samples between rows.
    """
    last = max(force.size, length.shape[1]) // spacing
    g = _lagged(force[None], spacing, last)[:, 0, 0]
    c = _lagged(length, spacing, last)
    size = np.sqrt(np.einsum("dd->d", c[0]))
    relative = np.maximum(np.abs(g) / g[0], (np.abs(c) / np.outer(size, size)).max(axis=(1, 2)))
    reach = int(np.flatnonzero(relative > _NEGLIGIBLE)[-1])
    return KernelCorrelations(g[: reach + 1], c[: reach + 1])


def _lagged(kernels: FloatArray, spacing: int, last: int) -> FloatArray:
    """Σ_j k_d(j) k_d'(j + m spacing) for m = 0 … last, (last + 1, d, d)."""
    n = kernels.shape[1]
    lags = range(0, (last + 1) * spacing, spacing)
    return np.stack([kernels[:, : max(n - lag, 0)] @ kernels[:, min(lag, n) :].T for lag in lags])


class RawNoise(NamedTuple):
    """Noise of the raw signals, and how it reaches the rows."""

    force: FloatArray  # standard deviation (6,) [N]
    length: float  # [m]
    correlations: KernelCorrelations


class Rows(NamedTuple):
    """F = W φ + ε at the times of the rows."""

    time: FloatArray  # (m,) [s]
    force: FloatArray  # F (m, 6) [N]
    regressor: FloatArray  # W (m, 6, SIZE)
    cutoff: float  # of the filter on forces and regressor [Hz]
    sliding: FloatArray  # 1 if a leg slides during the whole window of a row, 0 if it reverses (m, 6)


@dataclass(frozen=True, eq=False)
class Segment:
    """The rows of one segment of a log, and the signals from which rows of other delays and frictions follow."""

    rows: Rows
    motion: FloatArray  # at the rows: pose, twist, acceleration (m, 18)
    noise: RawNoise
    step: float  # of the log [s]
    force: FloatArray  # of the log (n, 6) [N]
    held: float  # by how much a force is older than its row, half a step less if it is held [s]
    force_rows: NDArray[np.intp]  # (m,) of the smoothed force
    inertial: FloatArray  # W of masses at the rows of the motion (j, 6, INERTIAL)
    spacing: tuple[int, int]  # rows of the log per row of the motion, and of that per row of the regression
    velocity: FloatArray  # of the motors, smoothed (k, 6) [m/s]
    friction: FloatArray  # of these velocities, for unit viscous and unit Coulomb friction (k, 2, 6)
    velocity_rows: NDArray[np.intp]  # (m,) of functions of the velocity, smoothed


@dataclass(frozen=True, eq=False)
class Regression:
    """The rows of all segments, one after the other."""

    segments: tuple[Segment, ...]

    @cached_property
    def rows(self) -> Rows:
        """The rows of all segments; the cut-off is the highest."""
        time, force, W, cutoffs, sliding = zip(*(segment.rows for segment in self.segments), strict=True)
        join = np.concatenate
        return Rows(join(time), join(force), join(W), max(cutoffs), join(sliding))

    @cached_property
    def motion(self) -> FloatArray:
        """Pose, twist, acceleration at the rows (m, 18)."""
        return np.concatenate([segment.motion for segment in self.segments])

    @property
    def sizes(self) -> tuple[int, ...]:
        """Rows of each segment."""
        return tuple(len(segment.rows.time) for segment in self.segments)

    def force_if_late(self, delay: float) -> FloatArray:
        """F (m, 6) [N] if the forces of the logs are late by this [s]."""
        forces = [smoothed(s.force, s.step, s.rows.cutoff, 1, 0, s.held + delay)[s.force_rows] for s in self.segments]
        return np.concatenate(forces)

    def rate(self, phi: FloatArray) -> FloatArray:
        """d(W φ)/dt (m, 6) for φ (SIZE,) [N/s]."""
        rates = []
        for segment in self.segments:
            (every, thin), step, cutoff = segment.spacing, segment.step, segment.rows.cutoff
            of_masses = smoothed(segment.inertial @ phi[:INERTIAL], step * every, cutoff, thin, 1)
            friction = (segment.friction * phi[INERTIAL:].reshape(2, 6)).sum(axis=1)
            rates.append(of_masses + smoothed(friction, step, cutoff, 1, 1)[segment.velocity_rows])
        return np.concatenate(rates)

    def filtered(self, function: OfVelocity, derivative: int = 0) -> FloatArray:
        """A function (k, j) of the velocities and their step [s], or its rate, filtered like the forces (m, j)."""
        values = [
            smoothed(function(s.velocity, s.step), s.step, s.rows.cutoff, 1, derivative)[s.velocity_rows]
            for s in self.segments
        ]
        return np.concatenate(values)


def segment_of(log: Log, platform: Platform, cutoff: float | None = None) -> Segment:
    """The rows of a segment of even times.

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
        A log that cannot be evaluated.
    """
    h = sample_time_of(log)
    cutoff = min(0.5 / h / (1.5 * _WIDER), cutoff_of(log.leg_length, h) if cutoff is None else cutoff)
    wide = _WIDER * cutoff
    # each row of the regression is a row of the motion, which is a row of the log
    every = max(1, int(1 / (_ROWS_A_PERIOD * wide * h)))
    thin = max(1, int(1 / (2 * cutoff * h * every)))
    lengths = [smoothed(log.leg_length, h, wide, every, k) for k in range(3)]
    state, acceleration = motion_of_lengths(platform, *lengths)
    W = regressor(platform, state, acceleration)[:, :, :INERTIAL]
    if log.motor_position is not None:
        # rotor and screw are on the motors' side
        W[:, :, ARMATURE] = smoothed(log.motor_position, h, wide, every, 2)
    inertial = smoothed(W.reshape(len(W), -1), h * every, cutoff, thin)
    first = edge(h, wide) + every * edge(h * every, cutoff)
    at = first + every * thin * np.arange(len(inertial))
    motion_rows = (at - edge(h, wide)) // every
    # friction steps where a leg reverses, so it needs all rows of the log
    motors = log.leg_length if log.motor_position is None else log.motor_position
    velocity = smoothed(motors, h, wide, 1, 1)
    per_unit = friction_columns(platform, velocity)
    lobe = math.ceil(0.5 / (cutoff * h * every))  # the filter's main one
    if sticks(platform):
        per_unit[:, 6:] = unit_friction(platform, velocity, h)
        slid = sliding_rows(platform, velocity, h)
        sliding = minimum_filter1d(slid, 2 * lobe * every + 1, axis=0)[at - edge(h, wide)]
    else:
        slowest = minimum_filter1d(np.abs(lengths[1]), 2 * lobe + 1, axis=0)[motion_rows]
        fast = np.minimum(_REVERSAL * platform.leg_friction_velocity, _SLOW * np.sqrt((lengths[1] ** 2).mean(axis=0)))
        sliding = np.asarray(slowest > fast, dtype=float)
    velocity_rows = at - edge(h, wide) - edge(h, cutoff)
    friction = smoothed(per_unit, h, cutoff)[velocity_rows].reshape(len(at), 2, 6)
    whole = np.concatenate(
        [inertial.reshape(len(at), 6, INERTIAL), *(friction[:, k, :, None] * np.eye(6) for k in range(2))], axis=2
    )
    assert whole.shape[2] == SIZE
    held = -h / 2 if log.holds_force else 0.0  # a held force belongs to the middle of its sample
    force, force_rows = force_of(log), at - edge(h, cutoff)
    assert log.time is not None  # checked by sample_time_of
    return Segment(
        Rows(log.time[at], smoothed(force, h, cutoff, 1, 0, held)[force_rows], whole, cutoff, sliding),
        # through the rows' filter, so that derivatives at these motions have no noise that the regressor does not have
        smoothed(np.concatenate([state.to_vector(), *acceleration], axis=1), h * every, cutoff, thin),
        _raw_noise(log, h, cutoff, every, thin),
        h,
        force,
        held,
        force_rows,
        W,
        (every, thin),
        velocity,
        per_unit.reshape(-1, 2, 6),
        velocity_rows,
    )


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
    kernel, inner = kernel_of(h, wide), slice(edge(h, wide), -edge(h, wide))
    rejected = np.abs(values[inner] - smoothed(values, h, wide))
    share = 1 - 2 * kernel[len(kernel) // 2] + float(kernel @ kernel)
    least = np.finfo(float).eps * np.abs(values).max()
    return np.asarray(np.median(rejected, axis=0) / _MEDIAN / math.sqrt(max(share, 1e-3)) + least)

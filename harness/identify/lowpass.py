"""The zero-phase low-pass of lengths, forces and regressors, its derivatives, its cut-off, and white noise after it."""

import math

import numpy as np
from scipy.signal import oaconvolve
from scipy.special import spherical_jn

from gough_stewart.harness.errors import LogError
from gough_stewart.model.vectors import FloatArray

# Half-length of the low-pass in periods of the cut-off: gain 1 up to half the cut-off, ½ at it, 0 beyond one and a half
# times the cut-off.
HALF_LENGTH = 2.75
# The window cos⁴(π t/2T) = a0 + a1 cos(π t/T) + a2 cos(2π t/T); at its ends it is 0 up to the third derivative.
_WINDOW = (0.375, 0.5, 0.125)
# The cut-off is this multiple of the frequency below which the motion's accelerations lie, except for this share.
_ABOVE_MOTION, _BEYOND = 16.0, 1e-3
LOWEST = 2.0  # cut-off [Hz]
# A bin is the motion's if its power exceeds these multiples of powers in the upper half of the spectrum: of the median
# of all legs together; of that of the noisiest leg, since the power of one leg varies more; of the largest, since an
# encoder without noise rounds a repeating motion alike each time, which makes lines that no median sees.
_OF_MEDIAN, _OF_NOISIEST, _OF_LARGEST = 10.0, 26.0, 2.0
# Median of |x| of the standard normal distribution.
_MEDIAN = 0.6744897501960817
# Correlations below this share of the largest are cut off; the kernels' windows make them vanish.
_NEGLIGIBLE = 1e-5


def smoothed(
    values: FloatArray, step: float, cutoff: float, every: int = 1, derivative: int = 0, delay: float = 0.0
) -> FloatArray:
    """The low-passed signal or its derivative, at every k-th of those rows that have the filter's full length.

    (k * x)(t) with k(t) = 2 f_c sinc(2 f_c t) w(t); its derivative uses that of the kernel, k̇ * x, so values, first
    and second derivatives belong to the same smooth signal. Values (n, m) are at even times, `delay` older than their
    rows state; f_c is the `cutoff`, where the gain is ½.
    """
    kernel = kernel_of(step, cutoff, derivative, delay)
    if len(kernel) > len(values):
        raise LogError(
            f"{len(values)} rows at {1 / step:.4g} Hz are shorter than the filter of {cutoff:.3g} Hz, "
            f"{len(kernel)} rows; expected a longer log, or a higher cut-off"
        )
    # correlation, not convolution: row k + half of the log is row k of the result
    offset = values.mean(axis=0)
    low = oaconvolve(values - offset, kernel[:, None], mode="valid", axes=0)
    return np.asarray(low + offset if derivative == 0 else low)[::every]


def edge(step: float, cutoff: float) -> int:
    """Rows at either end of a log that the filter drops."""
    return math.ceil(HALF_LENGTH / cutoff / step)


def kernel_of(step: float, cutoff: float, derivative: int = 0, delay: float = 0.0) -> FloatArray:
    """Weights (2 `edge` + 1,) of the samples about a row, as `smoothed` convolves them."""
    half = edge(step, cutoff)
    t = np.asarray(np.arange(-half, half + 1) * step + delay, dtype=float)
    # s = sin(x)/x with x = w0 t, and its derivatives by x: spherical Bessel functions
    w0, T = 2 * math.pi * cutoff, HALF_LENGTH / cutoff
    j0, j1, j2 = (spherical_jn(n, w0 * t) for n in range(3))
    s0, s1, s2 = j0, -j1, (2 * j2 - j0) / 3
    # the window and its derivatives by t
    (a, b, c), p, q, inside = _WINDOW, math.pi / T, 2 * math.pi / T, np.abs(t) < T
    v0 = inside * (a + b * np.cos(p * t) + c * np.cos(q * t))
    v1 = inside * (-b * p * np.sin(p * t) - c * q * np.sin(q * t))
    v2 = inside * (-b * p * p * np.cos(p * t) - c * q * q * np.cos(q * t))
    derivatives = (s0 * v0, w0 * s1 * v0 + s0 * v1, w0 * w0 * s2 * v0 + 2 * w0 * s1 * v1 + s0 * v2)
    # a constant passes unchanged, and has no derivative
    kernel = derivatives[derivative] / derivatives[0].sum()
    if derivative:
        kernel -= kernel.mean()
        # lines and parabolas have theirs exactly: samples of a kernel of few rows would miss by up to 0.15 %
        kernel /= (kernel @ (-t) ** derivative) / math.factorial(derivative)
    return np.asarray(kernel)


def cutoff_of(leg_length: FloatArray, step: float) -> float:
    """A cut-off above the motion of a log [Hz]; accelerations matter, since they carry the masses and most noise.

    The spectrum of the lengths, times frequency to the fourth power, up to where it rises again into noise. A leg that
    moves at the ends of the log leaks into all of that: as f⁻² with Hann's window, as f⁻⁶ with its square.
    """
    window = np.hanning(len(leg_length))[:, None] ** 2
    of_legs = np.abs(np.fft.rfft((leg_length - leg_length.mean(axis=0)) * window, axis=0)) ** 2
    power, frequency = of_legs.sum(axis=1), np.fft.rfftfreq(len(leg_length), step)
    # encoder noise is white: its power is estimated from the upper half
    upper = slice(len(power) // 2, None)
    floor = max(
        _OF_MEDIAN * float(np.median(power[upper])),
        _OF_NOISIEST * float(np.median(of_legs[upper], axis=0).max()),
        _OF_LARGEST * float(power[upper].max()),
    )
    of_acceleration = np.maximum(power - floor, 0.0) * frequency**4
    share = np.cumsum(of_acceleration) / max(float(of_acceleration.sum()), 1e-300)
    # the last frequency where nothing stands out of the noise
    highest = frequency[np.searchsorted(share[:-1], 1 - _BEYOND)]
    return max(_ABOVE_MOTION * float(highest), LOWEST)


def noise_beyond(values: FloatArray, step: float, cutoff: float) -> FloatArray:
    """Standard deviation of white noise in each channel, from the median of what the low-pass rejects."""
    kernel, inner = kernel_of(step, cutoff), slice(edge(step, cutoff), -edge(step, cutoff))
    rejected = np.abs(values[inner] - smoothed(values, step, cutoff))
    share = 1 - 2 * kernel[len(kernel) // 2] + float(kernel @ kernel)
    least = np.finfo(float).eps * np.abs(values).max()
    return np.asarray(np.median(rejected, axis=0) / _MEDIAN / math.sqrt(max(share, 1e-3)) + least)


def kernel_correlations(force: FloatArray, length: FloatArray, spacing: int) -> tuple[FloatArray, FloatArray]:
    """Covariances of filtered unit white noise m rows apart: (g ⋆ g)(m) (M + 1,) and (c_d ⋆ c_d')(m) (M + 1, 3, 3).

    g (j,) weighs raw samples in a row of the force, c (3, j) in value, velocity and acceleration of the lengths.
    """
    last = max(force.size, length.shape[1]) // spacing

    def lagged(kernels: FloatArray) -> FloatArray:
        n = kernels.shape[1]
        lags = range(0, (last + 1) * spacing, spacing)
        return np.stack([kernels[:, : max(n - lag, 0)] @ kernels[:, min(lag, n) :].T for lag in lags])

    g, c = lagged(force[None])[:, 0, 0], lagged(length)
    size = np.sqrt(np.einsum("dd->d", c[0]))
    relative = np.maximum(np.abs(g) / g[0], (np.abs(c) / np.outer(size, size)).max(axis=(1, 2)))
    reach = int(np.flatnonzero(relative > _NEGLIGIBLE)[-1])
    return g[: reach + 1], c[: reach + 1]

"""A zero-phase low-pass with exact derivatives; rows near the ends are dropped."""

import math

import numpy as np
from scipy.signal import oaconvolve

from gough_stewart.harness.errors import LogError
from gough_stewart.model.vectors import FloatArray

# Half-length of the window in periods of the cut-off: gain 1 up to half the cut-off, ½ at it, 0 beyond one and a half
# times the cut-off.
HALF_LENGTH = 2.75
# The window cos⁴(π t/2T) = a0 + a1 cos(π t/T) + a2 cos(2π t/T); at its ends it is 0 up to the third derivative.
_WINDOW = (0.375, 0.5, 0.125)


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
    half = len(kernel) // 2
    if not 2 * half < len(values):
        raise LogError(
            f"{len(values)} rows at {1 / sample_time:.4g} Hz are shorter than the filter of {cutoff:.3g} Hz, "
            f"{2 * half + 1} rows; expected a longer log, or a higher cut-off"
        )
    # correlation, not convolution: row k + half of the log is row k of the result
    offset = values.mean(axis=0)
    found = oaconvolve(values - offset, kernel[:, None], mode="valid", axes=0)
    return np.asarray(found + offset if derivative == 0 else found)[::every]


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
    s0 = np.where(small, 1 - x**2 / 6 + x**4 / 120, np.sin(safe) / safe)
    s1 = np.where(small, -x / 3 + x**3 / 30, (np.cos(safe) - np.sin(safe) / safe) / safe)
    s2 = np.where(small, -1 / 3 + x**2 / 10, -np.sin(safe) / safe - 2 * (np.cos(safe) - np.sin(safe) / safe) / safe**2)
    a, (p, q) = _WINDOW, (math.pi / T, 2 * math.pi / T)
    inside = np.abs(t) < T
    v0 = np.where(inside, a[0] + a[1] * np.cos(p * t) + a[2] * np.cos(q * t), 0.0)
    v1 = np.where(inside, -a[1] * p * np.sin(p * t) - a[2] * q * np.sin(q * t), 0.0)
    v2 = np.where(inside, -a[1] * p * p * np.cos(p * t) - a[2] * q * q * np.cos(q * t), 0.0)
    gain = 2 * cutoff
    return (
        gain * s0 * v0,
        gain * (w0 * s1 * v0 + s0 * v1),
        gain * (w0 * w0 * s2 * v0 + 2 * w0 * s1 * v1 + s0 * v2),
    )

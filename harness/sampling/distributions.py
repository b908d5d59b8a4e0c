"""Distributions by their quantile functions: elementwise from numbers in (0, 1) to values, over any axes.

Quantile functions apply to random numbers, Latin hypercubes and Sobol' points alike. All are computed element by
element, so a value does not depend on its neighbours.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gough_stewart.model.vectors import FloatArray


def normal(u: FloatArray, mean: FloatArray, deviation: FloatArray) -> FloatArray:
    """N(μ, σ²): μ + σ Φ⁻¹(u)."""
    return np.asarray(mean + deviation * _scores(u))


def uniform(u: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """From a to b: a + (b − a) u."""
    return np.asarray(low + (high - low) * u)


def truncated_normal(
    u: FloatArray, mean: FloatArray, deviation: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """N(μ, σ²) between two bounds: μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α))), α and β the bounds as multiples of σ from μ."""
    from scipy.special import ndtr

    a, b = (low - mean) / deviation, (high - mean) / deviation
    # near 1, differences of Φ lose digits: in the upper tail use the mirrored distribution
    upper = a > 0
    a, b, v = np.where(upper, -b, a), np.where(upper, -a, b), np.where(upper, 1 - u, u)
    z = _scores(ndtr(a) + v * (ndtr(b) - ndtr(a)))
    return np.clip(mean + deviation * np.where(upper, -z, z), low, high)


def lognormal(u: FloatArray, median: FloatArray, log_deviation: FloatArray) -> FloatArray:
    """The logarithm is normal, with mean ln m and deviation s: m exp(s Φ⁻¹(u)); m is the median."""
    return np.asarray(median * np.exp(log_deviation * _scores(u)))


def choice(u: FloatArray, values: Sequence[Any]) -> list[Any]:
    """One of n values with equal probability, the one at ⌊n u⌋, for each of u (m, 1)."""
    n = len(values)
    return [values[min(int(n * share), n - 1)] for share in np.ravel(u).tolist()]


def _scores(u: FloatArray) -> FloatArray:
    """Φ⁻¹(u)."""
    from scipy.special import ndtri  # not needed, and slow, without an ensemble

    return np.asarray(ndtri(u))

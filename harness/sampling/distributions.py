"""Distributions by their quantile functions: elementwise from numbers in (0, 1) to values, over any axes.

Quantile functions apply to random numbers, Latin hypercubes and Sobol' points alike. All are computed element by
element, so a value does not depend on its neighbours.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gough_stewart.model.vectors import FloatArray


def _scores(u: FloatArray) -> FloatArray:
    """Φ⁻¹(u)."""
    from scipy.special import ndtri  # not needed, and slow, without an ensemble

    return np.asarray(ndtri(u))


class Distribution:
    """Random numbers, or arrays of them."""

    @abstractmethod
    def quantile(self, u: FloatArray) -> Any:
        """Quantiles of these probabilities u in (0, 1), of the shape of u."""


@dataclass(frozen=True)
class Normal(Distribution):
    """N(μ, σ²): μ + σ Φ⁻¹(u)."""

    mean: FloatArray
    deviation: FloatArray

    def quantile(self, u: FloatArray) -> FloatArray:
        """See `Distribution`."""
        return np.asarray(self.mean + self.deviation * _scores(u))


@dataclass(frozen=True)
class Uniform(Distribution):
    """From a to b: a + (b − a) u."""

    low: FloatArray
    high: FloatArray

    def quantile(self, u: FloatArray) -> FloatArray:
        """See `Distribution`."""
        return np.asarray(self.low + (self.high - self.low) * u)


@dataclass(frozen=True)
class TruncatedNormal(Distribution):
    """N(μ, σ²) between two bounds: μ + σ Φ⁻¹(Φ(α) + u (Φ(β) − Φ(α))), α and β the bounds as multiples of σ from μ."""

    mean: FloatArray
    deviation: FloatArray
    low: FloatArray
    high: FloatArray

    def quantile(self, u: FloatArray) -> FloatArray:
        """See `Distribution`."""
        from scipy.special import ndtr

        a, b = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        # near 1, differences of Φ lose digits: in the upper tail use the mirrored distribution
        upper = a > 0
        a, b, v = np.where(upper, -b, a), np.where(upper, -a, b), np.where(upper, 1 - u, u)
        z = _scores(ndtr(a) + v * (ndtr(b) - ndtr(a)))
        return np.clip(self.mean + self.deviation * np.where(upper, -z, z), self.low, self.high)


@dataclass(frozen=True)
class Lognormal(Distribution):
    """The logarithm is normal, with mean ln m and deviation s: m exp(s Φ⁻¹(u)); m is the median."""

    median: FloatArray
    log_deviation: FloatArray

    def quantile(self, u: FloatArray) -> FloatArray:
        """See `Distribution`."""
        return np.asarray(self.median * np.exp(self.log_deviation * _scores(u)))


@dataclass(frozen=True)
class Choice(Distribution):
    """One of several values with equal probability: the one at ⌊n u⌋."""

    values: Sequence[Any]

    def quantile(self, u: FloatArray) -> list[Any]:
        """One for each of u (n, 1)."""
        n = len(self.values)
        return [self.values[min(int(n * each), n - 1)] for each in np.ravel(u).tolist()]

"""Distributions by their quantile functions: from numbers in (0, 1) to values, element by element over any axes.

A quantile function takes random numbers, Latin hypercubes and Sobol' points alike. All are computed element by element,
so that a value does not depend on those beside it.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gough_stewart.model.vectors import FloatArray


def _scores(u: FloatArray) -> FloatArray:
    """Φ⁻¹(u)."""
    from scipy.special import ndtri  # which runs without an ensemble need not wait for

    return np.asarray(ndtri(u))


class Distribution:
    """Numbers, or arrays of them, at random."""

    @abstractmethod
    def quantile(self, u: FloatArray) -> Any:
        """Values with these probabilities of being less, of the shape of u, in (0, 1)."""


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
        # Φ is near 1 in the upper tail, where differences drown in rounding: there the mirrored one is taken
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
    """One of some values, each as likely: the one at ⌊n u⌋."""

    values: Sequence[Any]

    def quantile(self, u: FloatArray) -> list[Any]:
        """One for each of u (n, 1)."""
        n = len(self.values)
        return [self.values[min(int(n * each), n - 1)] for each in np.ravel(u).tolist()]

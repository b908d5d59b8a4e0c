"""The rows of a fit with their covariance known: what estimates, tests and diagnosis are made of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.identify.instruments import Instruments, instruments_of
from gough_stewart.harness.identify.rows.force_derivatives import ForceDerivatives
from gough_stewart.harness.identify.rows.hypotheses import Family, families_of
from gough_stewart.harness.identify.rows.noise import RowNoise, TwoNoises, fitted_noise, two_noises
from gough_stewart.harness.identify.rows.regression import Regression
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray


class Fit(NamedTuple):
    """A fit of the rows by any method."""

    names: tuple[str, ...]
    values: FloatArray  # (p,)
    columns: FloatArray  # ∂(reading)/∂θ (n, 6, p) of the fitted rows
    force: FloatArray  # of the platform at all rows (m, 6) [N]
    rate: FloatArray  # its derivative by time (m, 6) [N/s]
    derivatives: ForceDerivatives  # at all rows
    is_fitted: NDArray[np.bool_]  # (m,)
    used: FloatArray  # 1 for fitted rows that are used (n, 6)


@dataclass(frozen=True)
class Whitened:
    """The fitted rows with their covariance known: everything the tests and the estimates need."""

    noise: RowNoise
    fit: Fit
    families: tuple[Family, ...]
    regression: Regression
    instruments: Instruments
    platform: Platform  # the nominal one

    def at(self, fit: Fit) -> "Whitened":
        """The same rows and noise for another fit."""
        return replace(self, fit=fit, instruments=instruments_of(fit.names, fit.values))

    def of(self, columns: FloatArray) -> FloatArray:
        """Whitened columns (6 n, k) of rows (n, 6, k)."""
        return self.noise.whitened((self.fit.used[..., None] * columns).reshape(6 * len(columns), -1))

    def residual(self, model: FloatArray, instruments: Instruments) -> FloatArray:
        """Reading less what these forces would be read as, of the fitted rows (n, 6)."""
        read = instruments.gain * model + instruments.offset
        return self.regression.force_if_late(instruments.delay)[self.fit.is_fitted] - read


def whitened(regression: Regression, fit: Fit, platform: Platform, not_excited: Sequence[str] = ()) -> Whitened:
    """The covariance of the rows, with the shares of both noises; what extensions describe is not taken for noise."""
    here = fit.is_fitted
    instruments = instruments_of(fit.names, fit.values)
    families = tuple(
        family._replace(columns=family.columns[here])
        for family in families_of(
            regression, fit.derivatives, fit.force, fit.rate, platform, instruments.tilt, (*fit.names, *not_excited)
        )
    )
    parts: list[TwoNoises] = []
    sizes: list[int] = []
    for raw, part in zip(regression.noise, _split(np.flatnonzero(here), regression.sizes), strict=True):
        if len(part):
            used = fit.used[sum(sizes) : sum(sizes) + len(part)]
            parts.append(two_noises(raw.correlations, fit.derivatives.by_legs[part], raw.force, raw.length, used))
            sizes.append(len(part))
    every = np.concatenate([fit.columns, *(family.columns for family in families)], axis=2)
    read = instruments.gain * fit.force[here] + instruments.offset
    residual = regression.force_if_late(instruments.delay)[here] - read
    noise = fitted_noise(parts, sizes, every, residual, fit.used)
    return Whitened(noise, fit, families, regression, instruments, platform)


def _split(rows: NDArray[np.intp], sizes: Sequence[int]) -> list[NDArray[np.intp]]:
    """Indices of rows by the part that they are in."""
    ends = np.cumsum([0, *sizes])
    return [rows[(rows >= a) & (rows < b)] for a, b in pairwise(ends)]

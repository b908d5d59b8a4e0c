"""The rows of a fit with their covariance known: what estimates, tests and diagnosis are made of."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.identify.rows.force_derivatives import ForceDerivatives
from gough_stewart.harness.identify.rows.hypotheses import Family, families_of
from gough_stewart.harness.identify.rows.noise import RowNoise, TwoNoises, fitted_noise, two_noises
from gough_stewart.harness.identify.rows.row_model import RowModel
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
    families: tuple[Family, ...]  # of the fitted rows
    model: RowModel
    raw_noises: tuple[TwoNoises, ...]  # of each part

    def at(self, fit: Fit) -> "Whitened":
        """The same rows and noise for another fit."""
        return replace(self, fit=fit)

    def of(self, columns: FloatArray) -> FloatArray:
        """Whitened columns (6 n, k) of rows (n, 6, k)."""
        return self.noise.whitened((self.fit.used[..., None] * columns).reshape(6 * len(columns), -1))

    def with_noise_of(self, residual: FloatArray, columns: FloatArray) -> "Whitened":
        """The same rows with the noise of another residual (n, 6), of a fit with further columns (n, 6, q)."""
        every = np.concatenate([self.fit.columns, columns, *(family.columns for family in self.families)], axis=2)
        noise = fitted_noise(self.raw_noises, self.noise.sizes, every, residual, self.fit.used)
        return replace(self, noise=noise)


def whitened(model: RowModel, fit: Fit, not_excited: Sequence[str] = ()) -> Whitened:
    """The covariance of the rows, with the shares of both noises; what extensions describe is not taken for noise."""
    here, regression = fit.is_fitted, model.regression
    tilt = model.instruments(fit.values).tilt
    families = tuple(
        family._replace(columns=family.columns[here])
        for family in families_of(
            regression, fit.derivatives, fit.force, fit.rate, model.platform, tilt, (*fit.names, *not_excited)
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
    noise = fitted_noise(parts, sizes, every, model.residual(fit.values)[here], fit.used)
    return Whitened(noise, fit, families, model, tuple(parts))


def _split(rows: NDArray[np.intp], sizes: Sequence[int]) -> list[NDArray[np.intp]]:
    """Indices of rows by the part that they are in."""
    ends = np.cumsum([0, *sizes])
    return [rows[(rows >= a) & (rows < b)] for a, b in pairwise(ends)]

"""The covariance of a regression's rows: white noise of forces and of lengths, through the filters of the regression.

A row k is F̃ − W φ at its time. Force noise reaches it through the low-pass g, length noise through the combined kernels
c_d of value, velocity and acceleration (d = 0, 1, 2) and through inverse dynamics, A_d = ∂F/∂L⁽ᵈ⁾ at this motion:

    cov(e_k, e_{k+m}) = s_F diag(σ_F²) (g ⋆ g)(m) + s_L σ_L² Σ_dd' A_d(k) (c_d ⋆ c_d')(m) A_d'(k + m)ᵀ

The motion is slow against the kernels, so A is that of the row's time. Covariances vanish beyond a few rows, so the
matrix is banded. The shares s_F and s_L are fitted by restricted maximum likelihood [Patterson & Thompson,
Biometrika 58(3), 1971]: ℓ = −½ [log|V| + log|Xᵀ V⁻¹ X| + (n − k) log(rᵀ V⁻¹ r)].
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.optimize import minimize_scalar

from gough_stewart.harness.identify.hypotheses import Family, families_of
from gough_stewart.harness.identify.regression import RawNoise, Regression
from gough_stewart.harness.identify.row_model import RowFit, RowModel
from gough_stewart.model.vectors import FloatArray

# The shares are fitted from so many windows of so many rows, spread over all parts; more would hardly improve them.
_WINDOWS, _ROWS_A_WINDOW = 4, 80
# Logarithm of how much the ratio of both noises may differ from that of the raw signals.
_LIKELY, _RATIOS = (-1.5, 1.5), (-18.0, 18.0)
_CLOSE = 0.05
# Singular values below this share of the largest are rounding errors.
_DEPENDENT = 1e-9
# Added to the variances, so that what was cut off does not make a covariance indefinite.
_CUT_OFF = 3e-5


class TwoNoises(NamedTuple):
    """Covariances of rows by noise of forces and of lengths with the levels of the raw signals.

    Lower bands (b, 6 n) as in `scipy.linalg.cholesky_banded`; 0 for rows that are not used, which have 1 in `unused`.
    """

    of_force: FloatArray
    of_length: FloatArray
    unused: FloatArray  # (6 n,)

    def factor(self, force: float, length: float) -> FloatArray:
        """The Cholesky factor L of V = s_F V_F + s_L V_L, as lower bands.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is not positive definite.
        """
        V = force * self.of_force + length * self.of_length
        V[0] = V[0] * (1 + _CUT_OFF) + self.unused
        return np.asarray(cholesky_banded(V, lower=True, overwrite_ab=True, check_finite=False))

    def window(self, start: int, end: int) -> "TwoNoises":
        """Those of a range of rows."""
        return TwoNoises(*(bands[..., 6 * start : 6 * end] for bands in self))


def two_noises(raw: RawNoise, by_legs: FloatArray, used: FloatArray) -> TwoNoises:
    """The covariances of n rows by noise of forces, and by noise of lengths.

    Parameters
    ----------
    by_legs
        A (n, 6, d, 6), for each of the d kernels of lengths.
    used
        1 for rows that are used, else 0 (n, 6).
    """
    n, reach = len(by_legs), min(len(raw.correlations.force), len(by_legs)) - 1
    A = raw.length * by_legs
    bands = np.zeros((2, 6 * reach + 11, n, 6))
    for m in range(reach + 1):
        pairs = used[: n - m, :, None] * used[m:, None, :]
        mixed = np.einsum("nidj,de->niej", A[: n - m], raw.correlations.length[m]).reshape(n - m, 6, -1)
        of_length = pairs * (mixed @ A[m:].reshape(n - m, 6, -1).swapaxes(1, 2))
        of_force = pairs * (raw.correlations.force[m] * np.diag(raw.force**2))
        # element (6 (k + m) + b, 6 k + a) of the matrix is in band 6 m + b − a
        for a in range(6):
            for b in range(a if m == 0 else 0, 6):
                bands[:, 6 * m + b - a, : n - m, a] = of_force[:, a, b], of_length[:, a, b]
    of_force, of_length = bands[:, : 6 * reach + 6].reshape(2, 6 * reach + 6, 6 * n)
    return TwoNoises(of_force, of_length, 1 - used.ravel())


class RowNoise(NamedTuple):
    """The fitted covariance of the rows of all parts of a log."""

    factors: tuple[FloatArray, ...]  # lower bands of the Cholesky factor L of each part
    force: FloatArray  # standard deviation of the raw forces (6,) [N]
    length: float  # of the raw lengths [m]
    shares: tuple[float, float]  # s_F, s_L


def whitened_by(factors: Sequence[FloatArray], columns: FloatArray) -> FloatArray:
    """L⁻¹ x of columns (6 n, k), part by part."""
    ends = np.cumsum([factor.shape[1] for factor in factors])[:-1]
    white = [dtbtrs(L, x, uplo="L")[0] for L, x in zip(factors, np.split(columns, ends), strict=True)]
    return np.concatenate(white)


def fitted_noise(
    parts: Sequence[TwoNoises], raw: RawNoise, columns: FloatArray, residual: FloatArray, used: FloatArray
) -> RowNoise:
    """The covariance with the shares of both noises that fit best, by restricted maximum likelihood.

    Parameters
    ----------
    parts
        The noises of each part of the log; n rows in all.
    raw
        Of the first part, whose levels the result states.
    columns
        Everything that may be in the mean of the rows (n, 6, k): it takes no part in the likelihood.
    residual
        Of the rows (n, 6) [N].
    used
        1 for rows that are used, else 0 (n, 6).
    """
    every = sum(len(part.unused) for part in parts) // 6
    chosen, rows, first = [], [], 0
    for part in parts:
        n = len(part.unused) // 6
        for start, end in _windows(n, max(1, round(_WINDOWS * n / every))):
            chosen.append(part.window(start, end))
            rows.append(np.arange(first + start, first + end))
        first += n
    at = np.concatenate(rows)
    kept = used[at]
    n = int(kept.sum())
    X = (kept[..., None] * columns[at]).reshape(6 * len(at), -1)
    U, sigma, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300), full_matrices=False)
    X = U[:, sigma > _DEPENDENT * sigma[0]]
    Y = np.column_stack([X, (kept * residual[at]).ravel()])
    k = X.shape[1]

    def shares(log_ratio: float) -> tuple[float, float]:
        # the larger of both is 1
        return float(np.exp(min(-log_ratio, 0.0))), float(np.exp(min(log_ratio, 0.0)))

    def cost(log_ratio: float) -> tuple[float, float]:
        factors = [part.factor(*shares(log_ratio)) for part in chosen]
        R = np.abs(np.diag(np.linalg.qr(whitened_by(factors, Y), mode="r")))
        variance = max(float(R[k] ** 2) / max(n - k, 1), np.finfo(float).tiny)
        determinants = sum(2 * float(np.log(L[0]).sum()) for L in factors)
        return determinants + 2 * float(np.log(R[:k]).sum()) + (n - k) * np.log(variance), variance

    def best(bounds: tuple[float, float]) -> float:
        return float(minimize_scalar(lambda x: cost(x)[0], bounds=bounds, options={"xatol": _CLOSE}).x)

    # what the raw signals say is near; if not, anything may be
    ratio = best(_LIKELY)
    if not _LIKELY[0] + 2 * _CLOSE < ratio < _LIKELY[1] - 2 * _CLOSE:
        ratio = best(_RATIOS)
    variance = cost(ratio)[1]
    force, length = (variance * share for share in shares(ratio))
    factors = tuple(part.factor(force, length) for part in parts)
    return RowNoise(factors, np.sqrt(force) * raw.force, float(np.sqrt(length)) * raw.length, (force, length))


def _windows(rows: int, number: int) -> list[tuple[int, int]]:
    """The first and the last row (exclusive) of windows that are spread over these rows; all rows if they are few."""
    if rows <= number * _ROWS_A_WINDOW:
        return [(0, rows)]
    share = rows / number
    starts = [int(share * (k + 0.5) - _ROWS_A_WINDOW / 2) for k in range(number)]
    return [(start, start + _ROWS_A_WINDOW) for start in starts]


@dataclass(frozen=True)
class Whitened:
    """The fitted rows with their covariance known: everything the tests and the estimates need."""

    noise: RowNoise
    fit: RowFit
    families: tuple[Family, ...]  # of the fitted rows
    model: RowModel
    raw: RawNoise  # of the first part
    raw_noises: tuple[TwoNoises, ...]  # of each part

    def at(self, fit: RowFit) -> "Whitened":
        """The same rows and noise for another fit."""
        return replace(self, fit=fit)

    def of(self, columns: FloatArray) -> FloatArray:
        """Whitened columns (6 n, k) of rows (n, 6, k)."""
        used = self.fit.used[..., None] * columns
        return whitened_by(self.noise.factors, used.reshape(6 * len(columns), -1))

    @property
    def whitened_families(self) -> dict[str, FloatArray]:
        """Whitened columns of each family, in units of its sizes."""
        return {family.name: self.of(family.columns * family.sizes) for family in self.families}

    def with_noise_of(self, residual: FloatArray, columns: FloatArray) -> "Whitened":
        """The same rows with the noise of another residual (n, 6), of a fit with further columns (n, 6, q)."""
        every = np.concatenate([self.fit.columns, columns, *(family.columns for family in self.families)], axis=2)
        return replace(self, noise=fitted_noise(self.raw_noises, self.raw, every, residual, self.fit.used))


def whitened(model: RowModel, fit: RowFit, not_excited: Sequence[str] = ()) -> Whitened:
    """The covariance of the rows, with the shares of both noises; what extensions describe is not taken for noise."""
    families = tuple(
        family._replace(columns=family.columns[fit.is_fitted]) for family in families_of(model, fit, not_excited)
    )
    raws, parts = noises_of(model.regression, fit.derivatives.by_legs, fit.is_fitted, fit.used)
    every = np.concatenate([fit.columns, *(family.columns for family in families)], axis=2)
    noise = fitted_noise(parts, raws[0], every, model.residual(fit.values)[fit.is_fitted], fit.used)
    return Whitened(noise, fit, families, model, raws[0], tuple(parts))


def noises_of(
    regression: Regression, by_legs: FloatArray, chosen: NDArray[np.bool_], used: FloatArray
) -> tuple[list[RawNoise], list[TwoNoises]]:
    """The raw noise, and both noises of the chosen rows, of each segment that has some.

    Parameters
    ----------
    by_legs
        A of all rows (m, 6, 3, 6).
    chosen
        (m,), n in all.
    used
        1 for chosen rows that are used, else 0 (n, 6).
    """
    ends = np.cumsum(regression.sizes)[:-1]
    of_segments = zip(
        regression.segments,
        np.split(by_legs, ends),
        np.split(chosen, ends),
        np.split(used, np.cumsum([part.sum() for part in np.split(chosen, ends)])[:-1]),
        strict=True,
    )
    with_rows = [(segment.noise, A[rows], kept) for segment, A, rows, kept in of_segments if rows.any()]
    return [raw for raw, _, _ in with_rows], [two_noises(*noise) for noise in with_rows]

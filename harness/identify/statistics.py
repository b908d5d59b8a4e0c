"""Statistics of fits: covariances for autocorrelated residuals, whiteness, identifiability of a regressor."""

import numpy as np
from scipy.stats import chi2

from gough_stewart.model.vectors import FloatArray


def long_run_covariance(scores: FloatArray) -> FloatArray:
    """Covariance (p, p) of the sum of the rows (n, p) of autocorrelated scores.

    S = Γ0 + Σ_l (1 − l/(m + 1)) (Γ_l + Γ_lᵀ), Γ_l = Σ_t s_t s_{t−l}ᵀ, m = ⌊4 (n/100)^(2/9)⌋; positive semidefinite
    [Newey & West, Econometrica 55(3), 1987, eq. (5)].
    """
    n = len(scores)
    lags = int(4 * (n / 100) ** (2 / 9))
    total = scores.T @ scores
    for lag in range(1, min(lags, n - 1) + 1):
        between = scores[lag:].T @ scores[:-lag]
        total = total + (1 - lag / (lags + 1)) * (between + between.T)
    return np.asarray(total)


def uncertainty(
    D: FloatArray, residual: FloatArray, *, white: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular values (p,), their combinations (p, p) as rows, and the covariance (p, p), of a whitened regression.

    A⁻¹ S A⁻¹ n/(n − p) with A = Σ_t D_tᵀ D_t and S the long-run covariance of the scores D_tᵀ e_t. If the residuals are
    white, S = s² A, and the covariance is s² A⁻¹ with s² = |e|²/(n − p).

    Parameters
    ----------
    D
        (n, 6, p), columns of similar scale.
    residual
        e (n, 6).
    """
    n, legs, p = D.shape
    _, sigma, directions = np.linalg.svd(D.reshape(n * legs, p), full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = directions.T / sigma**2 @ directions
        if white:
            used = int((residual != 0).sum())
            return sigma, directions, float((residual**2).sum()) / max(used - p, 1) * inverse
        scores = np.einsum("tip,ti->tp", D, residual)
        covariance = n * legs / max(n * legs - p, 1) * inverse @ long_run_covariance(scores) @ inverse
    return sigma, directions, covariance


def whiteness(residuals: FloatArray, lags: int = 10) -> FloatArray:
    """p-values (k,) that residuals (n, k) are white: Q = n (n + 2) Σ_l ρ_l²/(n − l) is χ² with as many degrees as lags.

    [Ljung & Box, Biometrika 65(2), 1978.]
    """
    n = len(residuals)
    r = residuals - residuals.mean(axis=0)
    power = (r**2).sum(axis=0)
    lags = min(lags, n - 2)
    with np.errstate(all="ignore"):
        rho = np.stack([(r[lag:] * r[:-lag]).sum(axis=0) / power for lag in range(1, lags + 1)])
        Q = n * (n + 2) * (rho**2 / (n - np.arange(1, lags + 1))[:, None]).sum(axis=0)
    return np.asarray(np.where(power > 0, chi2.sf(Q, lags), 1.0))

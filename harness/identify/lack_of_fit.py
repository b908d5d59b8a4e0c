"""Whether the residuals of a fit contain more than noise: F tests of extensions, and whiteness, combined.

Columns X of an extension that the fit did not have are projected on what it could not absorb, X⊥. In whitened rows of
a right model the residual is white, so

    F = (|P_X⊥ r|²/q)/s²,  s² = |r − P_all r|²/ν

has the distribution F(q, ν); s² is that of the model with all extensions, and no error of the model that an extension
describes is taken for noise. The p-values of the families are combined by min_i m p_(i)/i [Simes, Biometrika 73(3),
1986]. Families share columns, so this is compared with its own distribution for white noise, which is simulated: the
share of false alarms is that which is stated.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc

from gough_stewart.model.vectors import FloatArray

# Share of logs that agree with the model and raise a false alarm.
LEVEL = 0.05
_SIMULATED = 4000
# Singular values below this share of the column's own size are rounding errors.
_DEPENDENT = 1e-6
# Effects of a family's size that are below this many standard deviations cannot be seen.
_INVISIBLE = 0.3


class LackOfFit(NamedTuple):
    """The result of all tests."""

    p_values: dict[str, float]  # of each family
    combined: float  # p-value of all together
    # of the sum of squares, what the families explain beyond chance, in variances of noise
    excess: float = 0.0

    @property
    def alarm(self) -> bool:
        """Whether the log contradicts the model."""
        return self.combined < LEVEL


def lack_of_fit(
    D: FloatArray, families: Mapping[str, FloatArray], residual: FloatArray, used: FloatArray
) -> tuple[LackOfFit, FloatArray, FloatArray] | None:
    """The tests of all families and of whiteness, the p-values of whiteness of the legs, and what no family explains.

    None if the rows are too few for these families. D (6 n, p) are whitened columns of the fitted parameters, those of
    each family are times the sizes of what a user would want to know, `used` (n, 6) is 1 for rows that are used.
    """
    Q = basis_of(D, np.linalg.norm(D, axis=0))
    left = residual - Q @ (Q.T @ residual)
    bases = {name: basis_of(X - Q @ (Q.T @ X), np.linalg.norm(X, axis=0), _INVISIBLE) for name, X in families.items()}
    bases = {name: basis for name, basis in bases.items() if basis.shape[1]}
    every = np.concatenate([np.empty((len(left), 0)), *bases.values()], axis=1)
    U = basis_of(every, np.ones(every.shape[1]))
    rank, freedom = U.shape[1], int(used.sum()) - Q.shape[1] - U.shape[1]
    if freedom < max(rank, 1):
        return None
    z = U.T @ left
    rest = left - U @ z
    variance = max(float(rest @ rest) / freedom, np.finfo(float).tiny)
    white = whiteness(left.reshape(-1, 6), used)
    tested = [U.T @ basis for basis in bases.values()]

    def of_families(z: FloatArray, variance: FloatArray | float) -> FloatArray:
        """p-values (n, families) of residuals z (n, k)."""
        F = [fdtrc(B.shape[1], freedom, ((z @ B) ** 2).sum(axis=1) / B.shape[1] / variance) for B in tested]
        return np.stack(F, axis=1) if F else np.empty((len(z), 0))

    p_values = dict(zip(bases, of_families(z[None] / np.sqrt(variance), 1.0)[0].tolist(), strict=True))
    p_values["whiteness"] = float(_simes(white[None])[0])
    rng = np.random.default_rng(0)
    drawn = rng.standard_normal((_SIMULATED, rank))
    variances = rng.chisquare(freedom, _SIMULATED) / freedom
    simulated = _simes(np.column_stack([of_families(drawn, variances), rng.uniform(size=_SIMULATED)]))
    below = int((simulated <= _simes(np.array([list(p_values.values())]))[0]).sum())
    combined = (1 + below) / (1 + _SIMULATED)
    return LackOfFit(p_values, combined, float(z @ z) / variance - rank), white, rest


def basis_of(X: FloatArray, norms: FloatArray, smallest: float = 0.0) -> FloatArray:
    """Orthonormal basis of the columns' span, without directions that are rounding errors, or smaller than that.

    `norms` (q,) are those of the columns before what a fit absorbs was taken away.
    """
    if smallest:
        U, sigma, _ = np.linalg.svd(X, full_matrices=False)
        return np.asarray(U[:, (sigma > smallest) & (sigma > _DEPENDENT * norms.max(initial=0.0))])
    U, sigma, _ = np.linalg.svd(X / np.maximum(norms, 1e-300), full_matrices=False)
    return np.asarray(U[:, sigma > _DEPENDENT])


def _simes(p_values: FloatArray) -> FloatArray:
    """min_i m p_(i)/i of rows of p-values."""
    m = p_values.shape[1]
    return np.asarray((np.sort(p_values, axis=1) * (m / np.arange(1, m + 1))).min(axis=1))


def whiteness(residuals: FloatArray, used: FloatArray, lags: int = 10) -> FloatArray:
    """p-values (k,) that prewhitened residuals (n, k) are white: Σ_l (Σ_t r_t r_{t−l})²/(n_l s⁴) is χ²(lags).

    n_l is the number of pairs of rows that are used (n, k), about n − l [Ljung & Box, Biometrika 65(2), 1978].
    """
    r = residuals * used
    lags = min(lags, len(r) - 2)
    with np.errstate(all="ignore"):
        power = (r**2).sum(axis=0) / used.sum(axis=0)
        Q = np.zeros(r.shape[1])
        for lag in range(1, lags + 1):
            pairs = (used[lag:] * used[:-lag]).sum(axis=0)
            Q += np.where(pairs > 0, ((r[lag:] * r[:-lag]).sum(axis=0) / power) ** 2 / np.maximum(pairs, 1), 0.0)
    return np.asarray(np.where(power > 0, chdtrc(lags, Q), 1.0))

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


class Projection(NamedTuple):
    """Residual and extensions in coordinates of what the fit cannot absorb."""

    residual: FloatArray  # z (k,), of unit variance
    extensions: dict[str, FloatArray]  # coordinates of each family's columns (k, q)
    tested: dict[str, FloatArray]  # an orthonormal basis of each family (k, rank)
    freedom: int  # ν
    rest: FloatArray  # of the whitened residual that no extension describes (m,)


class LackOfFit(NamedTuple):
    """The result of all tests."""

    p_values: dict[str, float]  # of each family
    combined: float  # p-value of all together

    @property
    def alarm(self) -> bool:
        """Whether the log contradicts the model."""
        return self.combined < LEVEL


def projection_of(
    D: FloatArray,
    families: Mapping[str, FloatArray],
    tested: Mapping[str, FloatArray],
    sizes: Mapping[str, float],
    residual: FloatArray,
    rows: int,
) -> Projection | None:
    """Project on what the fit cannot absorb; None if the rows are too few for these families.

    Parameters
    ----------
    D
        Whitened columns of the fitted parameters (m, p).
    families
        Whitened columns of each family (m, q).
    tested
        Combinations of a family's columns that are tested (q, c).
    sizes
        Smallest effects of interest, in units of η; 0 for any.
    residual
        Whitened (m,).
    rows
        Number of rows that are used.
    """
    Q = basis_of(D, np.linalg.norm(D, axis=0))
    left = residual - Q @ (Q.T @ residual)
    free = {name: X - Q @ (Q.T @ X) for name, X in families.items()}
    bases = {}
    for name, X in free.items():
        wanted = X @ tested[name]
        own = np.linalg.norm(families[name] @ tested[name], axis=0)
        bases[name] = basis_of(wanted, own, _INVISIBLE / sizes[name] if sizes[name] else 0.0)
    every = np.concatenate(list(bases.values()), axis=1)
    U = basis_of(every, np.ones(every.shape[1]))
    freedom = rows - Q.shape[1] - U.shape[1]
    if freedom < U.shape[1]:
        return None
    z = U.T @ left
    rest = left - U @ z
    variance = max(float(rest @ rest) / freedom, np.finfo(float).tiny)
    return Projection(
        z / np.sqrt(variance),
        {name: U.T @ X for name, X in free.items()},
        {name: U.T @ B for name, B in bases.items()},
        freedom,
        rest,
    )


def basis_of(X: FloatArray, own: FloatArray, smallest: float = 0.0) -> FloatArray:
    """Orthonormal basis of the columns' span, without directions that are rounding errors, or smaller than that."""
    if smallest:
        U, sigma, _ = np.linalg.svd(X, full_matrices=False)
        return np.asarray(U[:, (sigma > smallest) & (sigma > _DEPENDENT * own.max(initial=0.0))])
    U, sigma, _ = np.linalg.svd(X / np.maximum(own, 1e-300), full_matrices=False)
    return np.asarray(U[:, sigma > _DEPENDENT])


def lack_of_fit(found: Projection, whiteness: float) -> LackOfFit:
    """The F tests of all families, with the p-value of whiteness, combined."""
    names = [name for name, basis in found.tested.items() if basis.shape[1]]
    p_values = {
        name: float(p) for name, p in zip(names, _p_values(found, names, found.residual[None], 1.0)[0], strict=True)
    }
    p_values["whiteness"] = whiteness
    observed = _simes(np.array([list(p_values.values())]))[0]
    rng = np.random.default_rng(0)
    z = rng.standard_normal((_SIMULATED, len(found.residual)))
    variance = rng.chisquare(found.freedom, _SIMULATED) / found.freedom
    simulated = np.column_stack([_p_values(found, names, z, variance), rng.uniform(size=_SIMULATED)])
    return LackOfFit(p_values, float((1 + (_simes(simulated) <= observed).sum()) / (1 + _SIMULATED)))


def _p_values(found: Projection, names: list[str], z: FloatArray, variance: FloatArray | float) -> FloatArray:
    """p-values (n, families) of residuals z (n, k)."""
    columns = []
    for name in names:
        basis = found.tested[name]
        q = basis.shape[1]
        columns.append(fdtrc(q, found.freedom, ((z @ basis) ** 2).sum(axis=1) / q / variance))
    return np.stack(columns, axis=1) if columns else np.empty((len(z), 0))


def _simes(p_values: FloatArray) -> FloatArray:
    """min_i m p_(i)/i of rows of p-values."""
    m = p_values.shape[1]
    return np.asarray((np.sort(p_values, axis=1) * (m / np.arange(1, m + 1))).min(axis=1))


class Explained(NamedTuple):
    """What one extension explains."""

    improvement: float  # of the sum of squares, in units of the noise's variance
    rank: int


def explained(found: Projection, columns: FloatArray) -> Explained:
    """What columns of an extension, in the projection's coordinates (k, q), explain of the residual."""
    B = basis_of(columns, np.linalg.norm(columns, axis=0))
    return Explained(float(((B.T @ found.residual) ** 2).sum()), B.shape[1])


def beyond(found: Projection, columns: FloatArray, known: FloatArray) -> float:
    """The p-value of columns (k, q) when those of another extension (k, r) are known."""
    known = basis_of(known, np.linalg.norm(known, axis=0))
    z = found.residual - known @ (known.T @ found.residual)
    X = columns - known @ (known.T @ columns)
    B = basis_of(X, np.linalg.norm(columns, axis=0))
    q = B.shape[1]
    return float(fdtrc(q, found.freedom, ((B.T @ z) ** 2).sum() / q)) if q else 1.0


def whiteness(residuals: FloatArray, used: FloatArray, lags: int = 10) -> FloatArray:
    """p-values (k,) that prewhitened residuals (n, k) are white: Σ_l (Σ_t r_t r_{t−l})²/(n_l s⁴) is χ²(lags).

    n_l is the number of pairs of rows that are used (n, k), about n − l [Ljung & Box, Biometrika 65(2), 1978].
    """
    r = residuals * used
    n = used.sum(axis=0)
    lags = min(lags, len(r) - 2)
    with np.errstate(all="ignore"):
        power = (r**2).sum(axis=0) / n
        Q = np.zeros(r.shape[1])
        for lag in range(1, lags + 1):
            pairs = (used[lag:] * used[:-lag]).sum(axis=0)
            Q += np.where(pairs > 0, ((r[lag:] * r[:-lag]).sum(axis=0) / power) ** 2 / np.maximum(pairs, 1), 0.0)
    return np.asarray(np.where(power > 0, chdtrc(lags, Q), 1.0))

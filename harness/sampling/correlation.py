"""Correlated inputs: a Gaussian copula, and covariances of a multivariate normal distribution."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from gough_stewart.harness.section import Section
from gough_stewart.model.vectors import FloatArray, real_array

# Relative to the largest eigenvalue; smaller values are rounding errors.
_POSITIVE = 1e-12
_SMALLEST = 2.0**-53
# Most repetitions of a reordering; it ends when one does not improve it.
_ROUNDS = 20


class CorrelatedInputs(Section):
    """`[[ensemble.correlation]]` and `[[ensemble.covariance]]`: inputs and their matrix, in SI units.

    A vector stands for its elements in order.
    """

    of: list[str]
    matrix: list[list[Any]]

    @model_validator(mode="after")
    def _positive(self) -> "CorrelatedInputs":
        if len(set(self.of)) < len(self.of) or not self.of:
            raise ValueError(f"of is {self.of}; expected different names")
        checked_matrix(self.matrix)
        return self

    @property
    def values(self) -> FloatArray:
        """The matrix (n, n)."""
        return checked_matrix(self.matrix)


def checked_matrix(matrix: Any) -> FloatArray:
    """A covariance (n, n): symmetric and positive definite.

    Raises
    ------
    ValueError
        The matrix is not symmetric or not positive definite.
    """
    n = len(matrix)
    try:
        C = real_array(matrix, (n, n))
    except ValueError as error:
        raise ValueError(f"the matrix {error}") from None
    if np.abs(C - C.T).max(initial=0.0) > 1e-9 * np.abs(C).max(initial=0.0):
        raise ValueError("the matrix is not symmetric")
    # scaled to correlations, so that different units do not make it look singular
    diagonal = np.diag(C)
    worst = float(diagonal.min(initial=np.inf))
    if worst > 0:
        worst = float(np.linalg.eigvalsh(correlation_of(C))[0])
    if not worst > _POSITIVE:
        raise ValueError(
            f"the matrix is not positive definite (smallest eigenvalue {worst:.3g}, scaled to correlations); expected "
            "> 0: reduce the correlations, or remove inputs that depend entirely on others"
        )
    return C


def correlation_of(covariance: FloatArray) -> FloatArray:
    """R = D^(−1/2) C D^(−1/2) with the diagonal D of C."""
    scale = 1 / np.sqrt(np.diag(covariance))
    return np.asarray(covariance * scale * scale[:, None])


def correlated(u: FloatArray, correlation: FloatArray) -> FloatArray:
    """Turn independent uniform numbers (n, k) into ones whose normal scores have a correlation (k, k).

    z = L Φ⁻¹(u), R = L Lᵀ, and Φ(z); summed column by column, so that a row does not depend on those beside it.
    """
    from scipy.special import ndtr, ndtri

    L = np.linalg.cholesky(correlation)
    z = ndtri(u)
    out = np.empty_like(u)
    for i in range(u.shape[1]):
        total = z[:, 0] * L[i, 0]
        for j in range(1, i + 1):
            total = total + z[:, j] * L[i, j]
        out[:, i] = total
    return np.clip(ndtr(out), _SMALLEST, 1 - _SMALLEST)


def reordered(u: FloatArray, correlation: FloatArray) -> FloatArray:
    """Reorder the columns of a whole design (N, k) until their normal scores have nearly a correlation (k, k).

    Each column keeps its numbers, so one in each layer of a Latin hypercube. Scores z = Φ⁻¹(u) of correlation T = Q Qᵀ
    become z Q⁻ᵀ Pᵀ with R = P Pᵀ, and each column takes the order of its new scores; repeated with what is left of the
    difference. Iman & Conover, Commun. Statist. – Simul. Comput. 11 (1982) 311.
    """
    from scipy.special import ndtri

    n, k = u.shape
    ordered = np.sort(u, axis=0)
    scores, P = ndtri(ordered), np.linalg.cholesky(correlation)
    # of few members, which have no correlation of their own to correct
    best, least = np.take_along_axis(ordered, _ranks(correlated(u, correlation)), axis=0), np.inf
    z = ndtri(u)
    for _ in range(_ROUNDS if n > k else 0):
        try:
            Q = np.linalg.cholesky(np.corrcoef(z.T))
        except np.linalg.LinAlgError:  # singular up to rounding
            break
        ranks = _ranks(np.linalg.solve(Q, z.T).T @ P.T)
        z = np.take_along_axis(scores, ranks, axis=0)
        gap = float(np.abs(np.corrcoef(z.T) - correlation).max())
        if not gap < least:
            break
        best, least = np.take_along_axis(ordered, ranks, axis=0), gap
    return best


def _ranks(values: FloatArray) -> NDArray[np.intp]:
    return values.argsort(axis=0, kind="stable").argsort(axis=0)

"""Upper bound of the structured singular value μ over frequency."""

import math

import numpy as np
from numpy.typing import NDArray

from gough_stewart.model.vectors import FloatArray

ComplexArray = NDArray[np.complex128]

# Balancing iterations, descent steps, and the largest ln D.
_BALANCES, _DESCENTS, _WIDEST = 5, 40, 30.0
# Matrices whose bounds are lowered together in the search for the largest.
_AT_ONCE = 16


def scaled_norm(M: ComplexArray) -> FloatArray:
    """Upper bound min over D of σ(D M D⁻¹), D > 0 diagonal, of the structured singular value μ of (n, m, m), each (n,).

    For one complex uncertainty per channel: exact for m ≤ 3, rarely a few percent above μ for larger m (Packard & Doyle
    1993, "The complex structured singular value", Automatica 29(1), 71–109). ln σ is convex in ln D; the result is less
    than 1 % above the minimum, and never below it.
    """
    scales = _balance(M)
    here, slope, best, step = scales, np.zeros(scales.shape), np.full(len(M), np.inf), np.full(len(M), 0.5)
    for _ in range(_DESCENTS):
        U, sizes, Vh = np.linalg.svd(_scaled(M, here))
        lower = sizes[:, 0] < best
        best = np.where(lower, sizes[:, 0], best)
        scales = np.where(lower[:, None], here, scales)
        # ∂ ln σ / ∂ ln D_i = |u_i|² − |v_i|²
        slope = np.where(lower[:, None], np.abs(U[:, :, 0]) ** 2 - np.abs(Vh[:, 0, :]) ** 2, slope)
        step = np.where(lower, 1.2 * step, 0.5 * step)
        # where a channel is decoupled, the best scaling is infinite
        here = np.clip(scales - step[:, None] * slope, -_WIDEST, _WIDEST)
    return best


def bounds_of_the_largest(M: ComplexArray) -> FloatArray:
    """Upper bounds of μ of (n, m, m), each (n,), of which the largest is that of `scaled_norm`.

    Others are lowered only until they are below it, in the order of their bounds after balancing.
    """
    bounds: FloatArray = np.linalg.norm(_scaled(M, _balance(M)), 2, axis=(1, 2))
    largest = -np.inf
    for some in np.array_split(np.argsort(-bounds), math.ceil(len(M) / _AT_ONCE)):
        if bounds[some[0]] <= largest:
            break
        bounds[some] = scaled_norm(M[some])
        largest = max(largest, float(bounds[some].max()))
    return bounds


def _balance(M: ComplexArray) -> FloatArray:
    """Scales ln D (n, m) that give row i and column i of D M D⁻¹ about equal norms (Osborne 1960)."""
    squares, scales = np.abs(M) ** 2, np.zeros(M.shape[:2])
    for _ in range(_BALANCES):
        for i in range(M.shape[-1]):
            # the weight is 0 on the diagonal, which scaling does not change
            weight = np.exp(2 * (scales[:, i : i + 1] - scales))
            weight[:, i] = 0.0
            row = (squares[:, i, :] * weight).sum(axis=1)
            column = (squares[:, :, i] / np.where(weight > 0, weight, np.inf)).sum(axis=1)
            both = (row > 0) & (column > 0)
            scales[:, i] -= 0.25 * np.log(np.where(both, row, 1.0) / np.where(both, column, 1.0))
    return scales


def _scaled(M: ComplexArray, scales: FloatArray) -> ComplexArray:
    return np.asarray(M * np.exp(scales[:, :, None] - scales[:, None, :]))

"""Statistics of a whitened regression: singular values, their combinations, and the covariance of its estimates."""

import numpy as np

from gough_stewart.model.vectors import FloatArray


def uncertainty(D: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular values (p,), their combinations (p, p) as rows, and the covariance (p, p), of a whitened regression.

    s² (Σ_t D_tᵀ D_t)⁻¹ with s² = |e|²/(n − p) and n the number of rows that are used, whose residual is not 0.

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
    used = int((residual != 0).sum())
    return sigma, directions, float((residual**2).sum()) / max(used - p, 1) * inverse

"""The covariance of a regression's rows: white noise of forces and of lengths, through the filters of the regression.

A row k is F̃ − W φ at its time. Force noise reaches it through the low-pass g, length noise through the combined kernels
c_d of value, velocity and acceleration (d = 0, 1, 2) and through inverse dynamics, A_d = ∂F/∂L⁽ᵈ⁾ at this motion:

    cov(e_k, e_{k+m}) = s_F diag(σ_F²) (g ⋆ g)(m) + s_L σ_L² Σ_dd' A_d(k) (c_d ⋆ c_d')(m) A_d'(k + m)ᵀ

The motion is slow against the kernels, so A is that of the row's time. Covariances vanish beyond a few rows, so the
matrix is block-banded. The shares s_F and s_L are fitted by restricted maximum likelihood [Patterson & Thompson,
Biometrika 58(3), 1971]: ℓ = −½ [log|V| + log|Xᵀ V⁻¹ X| + (n − k) log(rᵀ V⁻¹ r)].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize_scalar

from gough_stewart.model.vectors import FloatArray

# Correlations below this share of the largest are cut off; the kernels' windows make them vanish.
_NEGLIGIBLE = 1e-5
# Rows from which the shares are fitted; more would hardly improve them.
_ROWS_OF_SHARES = 320
# Logarithm of how much the ratio of both noises may differ from that of the raw signals.
_LIKELY, _RATIOS = (-1.5, 1.5), (-18.0, 18.0)
_CLOSE = 0.05
# Singular values below this share of the largest are rounding errors.
_DEPENDENT = 1e-9
_CUT_OFF = 3e-5


class KernelCorrelations(NamedTuple):
    """Covariances of filtered unit white noise, m rows apart."""

    force: FloatArray  # (g ⋆ g)(m) (M + 1,)
    length: FloatArray  # (c_d ⋆ c_d')(m) (M + 1, 3, 3)


def kernel_correlations(force: FloatArray, length: FloatArray, spacing: int) -> KernelCorrelations:
    """Covariances of the filtered noises, up to the last row that they reach.

    Parameters
    ----------
    force
        Weights of the raw samples in a row of the force (j,).
    length
        Weights in value, velocity and acceleration (3, j), of the same parity.
    spacing
        Raw samples between rows.
    """
    last = max(force.size, length.shape[1]) // spacing
    g = _lagged(force[None], spacing, last)[:, 0, 0]
    c = _lagged(length, spacing, last)
    size = np.sqrt(np.einsum("dd->d", c[0]))
    relative = np.maximum(np.abs(g) / g[0], (np.abs(c) / np.outer(size, size)).max(axis=(1, 2)))
    reach = int(np.flatnonzero(relative > _NEGLIGIBLE)[-1])
    return KernelCorrelations(g[: reach + 1], c[: reach + 1])


def _lagged(kernels: FloatArray, spacing: int, last: int) -> FloatArray:
    """Σ_j k_d(j) k_d'(j + m spacing) for m = 0 … last, (last + 1, d, d)."""
    n = kernels.shape[1]
    found = [kernels[:, : max(n - m * spacing, 0)] @ kernels[:, min(m * spacing, n) :].T for m in range(last + 1)]
    return np.stack(found)


@dataclass(frozen=True)
class Banded:
    """A symmetric matrix of blocks of rows, of which only neighbours are correlated."""

    diagonal: FloatArray  # (b, s, s)
    below: FloatArray  # (b − 1, s, s)


@dataclass(frozen=True)
class Whitening:
    """The inverse Cholesky factor L⁻¹ of a covariance V = L Lᵀ, as an operator."""

    diagonal: FloatArray  # (b, s, s)
    below: FloatArray  # (b − 1, s, s)

    def __call__(self, columns: FloatArray) -> FloatArray:
        """L⁻¹ x of the first rows' columns (6 n, k)."""
        size = self.diagonal.shape[1]
        whole = np.zeros((len(self.diagonal) * size, columns.shape[1]))
        whole[: len(columns)] = columns
        for k, L in enumerate(self.diagonal):
            here = slice(k * size, (k + 1) * size)
            known = whole[here]
            if k:
                known = known - self.below[k - 1] @ whole[here.start - size : here.start]
            whole[here] = solve_triangular(L, known, lower=True, check_finite=False)
        return whole[: len(columns)]

    @property
    def log_determinant(self) -> float:
        """log|V|."""
        return 2 * float(np.log(np.einsum("bii->bi", self.diagonal)).sum())


def whitening_of(matrix: Banded) -> Whitening:
    """The Cholesky factor, block by block.

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is not positive definite.
    """
    L: list[FloatArray] = []
    K: list[FloatArray] = []
    for k, block in enumerate(matrix.diagonal):
        rest = block
        if k:
            K.append(solve_triangular(L[-1], matrix.below[k - 1].T, lower=True, check_finite=False).T)
            rest = block - K[-1] @ K[-1].T
        L.append(cholesky(rest, lower=True, check_finite=False))
    return Whitening(np.array(L), np.array(K))


def banded(blocks: FloatArray, used: FloatArray) -> Banded:
    """The matrix with covariances (M + 1, n, 6, 6) of rows k and k + m; 0 in unused rows.

    Parameters
    ----------
    blocks
        blocks[m, k] = cov(e_k, e_{k+m}).
    used
        1 for rows that are used, else 0 (n, 6).
    """
    reach, n = len(blocks) - 1, blocks.shape[1]
    per = max(reach, 1)
    number = -(-n // per)
    diagonal = np.zeros((number, per, 6, per, 6))
    below = np.zeros((max(number - 1, 0), per, 6, per, 6))
    for m in range(min(reach, n - 1) + 1):
        whole = np.zeros((number * per, 6, 6))
        whole[: n - m] = blocks[m, : n - m] * used[: n - m, :, None] * used[m:, None, :]
        of = whole.reshape(number, per, 6, 6)
        for a in range(per):
            b = a + m
            if b < per:
                diagonal[:, a, :, b, :] = of[:, a]
                diagonal[:, b, :, a, :] = of[:, a].swapaxes(1, 2)
            else:
                below[:, b - per, :, a, :] = of[:-1, a].swapaxes(1, 2)
    return Banded(diagonal.reshape(number, 6 * per, 6 * per), below.reshape(len(below), 6 * per, 6 * per))


@dataclass(frozen=True)
class TwoNoises:
    """The covariances of the rows by noise of forces and of lengths with the levels of the raw signals."""

    of_force: Banded
    of_length: Banded
    unused: FloatArray  # 1 on the diagonal for rows that are not used (b, s)
    force: FloatArray  # standard deviation of the raw forces (6,) [N]
    length: float  # of the raw lengths [m]

    def covariance(self, force: float, length: float, blocks: int | None = None) -> Banded:
        """s_F V_F + s_L V_L, of the first blocks."""
        diagonal = force * self.of_force.diagonal[:blocks] + length * self.of_length.diagonal[:blocks]
        s = np.arange(diagonal.shape[1])
        # what was cut off does not make it indefinite
        diagonal[:, s, s] = diagonal[:, s, s] * (1 + _CUT_OFF) + self.unused[:blocks]
        below = force * self.of_force.below + length * self.of_length.below
        return Banded(diagonal, below[: len(diagonal) - 1])


def two_noises(
    correlations: KernelCorrelations, by_legs: FloatArray, force: FloatArray, length: float, used: FloatArray
) -> TwoNoises:
    """The covariances of the rows by noise of forces, and by noise of lengths.

    Parameters
    ----------
    by_legs
        A (n, 6, d, 6), for each of the d kernels of lengths.
    force, length
        Standard deviations of the raw forces (6,) [N] and lengths [m].
    used
        1 for rows that are used, else 0 (n, 6).
    """
    n, reach = len(by_legs), len(correlations.force) - 1
    A = length * by_legs
    of_force, of_length = np.zeros((2, reach + 1, n, 6, 6))
    for m in range(min(reach + 1, n)):
        of_force[m, : n - m] = correlations.force[m] * np.diag(force**2)
        mixed = np.einsum("nidj,de->niej", A[: n - m], correlations.length[m]).reshape(n - m, 6, -1)
        of_length[m, : n - m] = mixed @ A[m:].reshape(n - m, 6, -1).swapaxes(1, 2)
    parts = banded(of_force, used), banded(of_length, used)
    unused = np.ones(parts[0].diagonal.shape[:2]).ravel()
    unused[: 6 * n] = 1 - used.ravel()
    return TwoNoises(*parts, unused.reshape(parts[0].diagonal.shape[:2]), force, length)


class RowNoise(NamedTuple):
    """The fitted covariance of the rows of all parts of a log."""

    whitenings: tuple[Whitening, ...]
    sizes: tuple[int, ...]  # rows of each part
    force: FloatArray  # standard deviation of the raw forces (6,) [N]
    length: float  # of the raw lengths [m]

    def whitened(self, columns: FloatArray) -> FloatArray:
        """L⁻¹ x of columns (6 n, k)."""
        ends = 6 * np.cumsum(self.sizes)[:-1]
        parts = np.split(columns, ends)
        return np.concatenate([each(part) for each, part in zip(self.whitenings, parts, strict=True)])


def fitted_noise(
    parts: Sequence[TwoNoises], sizes: Sequence[int], columns: FloatArray, residual: FloatArray, used: FloatArray
) -> RowNoise:
    """The covariance with the shares of both noises that fit best, by restricted maximum likelihood.

    Parameters
    ----------
    parts, sizes
        The noises of each part of the log, and its rows; n in all.
    columns
        Everything that may be in the mean of the rows (n, 6, k): it takes no part in the likelihood.
    residual
        Of the rows (n, 6) [N].
    used
        1 for rows that are used, else 0 (n, 6).
    """
    chosen, first, enough = [], 0, 0
    for noises, n in zip(parts, sizes, strict=True):
        size = noises.unused.shape[1]
        blocks = min(len(noises.unused), -(-6 * max(_ROWS_OF_SHARES - enough, 1) // size))
        rows = min(blocks * size // 6, n)
        chosen.append((noises, blocks, slice(first, first + rows)))
        first, enough = first + n, enough + rows
        if enough >= _ROWS_OF_SHARES:
            break

    def of_chosen(values: FloatArray) -> FloatArray:
        return np.concatenate([values[where] for _, _, where in chosen])

    kept = of_chosen(used)
    n = int(kept.sum())
    X = (kept[..., None] * of_chosen(columns)).reshape(6 * len(kept), -1)
    U, sigma, _ = np.linalg.svd(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300), full_matrices=False)
    X = U[:, sigma > _DEPENDENT * sigma[0]]
    Y = np.column_stack([X, (kept * of_chosen(residual)).ravel()])
    k = X.shape[1]
    rows_of = [where.stop - where.start for _, _, where in chosen]
    split = np.split(Y, 6 * np.cumsum(rows_of)[:-1])

    def shares(log_ratio: float) -> tuple[float, float]:
        # the larger of both is 1
        return float(np.exp(min(-log_ratio, 0.0))), float(np.exp(min(log_ratio, 0.0)))

    def cost(log_ratio: float) -> tuple[float, float]:
        whitenings = [whitening_of(noises.covariance(*shares(log_ratio), blocks)) for noises, blocks, _ in chosen]
        white = np.concatenate([each(part) for each, part in zip(whitenings, split, strict=True)])
        R = np.abs(np.diag(np.linalg.qr(white, mode="r")))
        variance = max(float(R[k] ** 2) / max(n - k, 1), np.finfo(float).tiny)
        determinants = sum(each.log_determinant for each in whitenings)
        return determinants + 2 * float(np.log(R[:k]).sum()) + (n - k) * np.log(variance), variance

    def best(bounds: tuple[float, float]) -> float:
        found = minimize_scalar(lambda x: cost(x)[0], bounds=bounds, method="bounded", options={"xatol": _CLOSE})
        return float(found.x)

    # what the raw signals say is near; if not, anything may be
    ratio = best(_LIKELY)
    if not _LIKELY[0] + 2 * _CLOSE < ratio < _LIKELY[1] - 2 * _CLOSE:
        ratio = best(_RATIOS)
    force, length = (cost(ratio)[1] * share for share in shares(ratio))
    return RowNoise(
        tuple(whitening_of(noises.covariance(force, length)) for noises in parts),
        tuple(sizes),
        np.sqrt(force) * parts[0].force,
        float(np.sqrt(length)) * parts[0].length,
    )

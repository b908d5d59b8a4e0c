"""The covariance of a regression's rows: white noise of forces and of lengths, through the filters of the regression.

A row k is F̃ − W φ at its time. Force noise reaches it through the low-pass g, length noise through the combined kernels
c_d of value, velocity and acceleration (d = 0, 1, 2) and through inverse dynamics, A_d = ∂F/∂L⁽ᵈ⁾ at this motion:

    cov(e_k, e_{k+m}) = s_F diag(σ_F²) (g ⋆ g)(m) + s_L Σ_dd' A_d(k) diag(σ_L²) (c_d ⋆ c_d')(m) A_d'(k + m)ᵀ

The motion is slow against the kernels, so A is that of the row's time. Covariances vanish beyond a few rows, so the
matrix is banded. The shares s_F and s_L of each log are fitted by restricted maximum likelihood [Patterson & Thompson,
Biometrika 58(3), 1971]: ℓ = −½ [log|V| + log|Xᵀ V⁻¹ X| + (n − k) log(rᵀ V⁻¹ r)].
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.optimize import minimize_scalar

from gough_stewart.harness.identify.row_model import RawNoise, Regression
from gough_stewart.model.vectors import FloatArray

# The shares are fitted from so many windows of so many rows, spread over a log; more would hardly improve them.
_WINDOWS, _ROWS_A_WINDOW = 4, 80
# A log with fewer readings per column takes the shares of the others.
_ENOUGH = 3
# Logarithm of how much the ratio of both noises may differ from that of the raw signals.
_LIKELY, _RATIOS = (-1.5, 1.5), (-18.0, 18.0)
_CLOSE = 0.05
# Singular values below this share of the largest are rounding errors.
_DEPENDENT = 1e-9
# Effects of an extension's size that are below this many standard deviations cannot be seen.
INVISIBLE = 0.3
# Added to the variances, so that what was cut off does not make a covariance indefinite.
_CUT_OFF = 3e-5


class PartNoise(NamedTuple):
    """Covariances of a part's rows by noise of forces and of lengths with the levels of the raw signals.

    Lower bands (b, 6 n) as in `scipy.linalg.cholesky_banded`; 0 for rows that are not used, which have 1 in `unused`.
    """

    which: int  # the log of the part
    raw: RawNoise
    of_force: FloatArray
    of_length: FloatArray
    unused: FloatArray  # (6 n,)

    def factor(self, force: float, length: float) -> FloatArray:
        """The Cholesky factor L of V = s_F V_F + s_L V_L, as lower bands."""
        V = force * self.of_force + length * self.of_length
        V[0] = V[0] * (1 + _CUT_OFF) + self.unused
        return np.asarray(cholesky_banded(V, lower=True, overwrite_ab=True, check_finite=False))


def part_noise(which: int, raw: RawNoise, by_legs: FloatArray, used: FloatArray) -> PartNoise:
    """The covariances of n rows, `used` (n, 6) or not, by noise of forces, and of lengths by A (n, 6, d, 6)."""
    n, reach = len(by_legs), min(len(raw.of_force), len(by_legs)) - 1
    A = raw.length * by_legs
    bands = np.zeros((2, 6 * reach + 11, n, 6))
    for m in range(reach + 1):
        pairs = used[: n - m, :, None] * used[m:, None, :]
        mixed = np.einsum("nidj,de->niej", A[: n - m], raw.of_length[m]).reshape(n - m, 6, -1)
        of_length = pairs * (mixed @ A[m:].reshape(n - m, 6, -1).swapaxes(1, 2))
        of_force = pairs * (raw.of_force[m] * np.diag(raw.force**2))
        # element (6 (k + m) + b, 6 k + a) of the matrix is in band 6 m + b − a
        for a in range(6):
            for b in range(a if m == 0 else 0, 6):
                bands[:, 6 * m + b - a, : n - m, a] = of_force[:, a, b], of_length[:, a, b]
    of_force, of_length = bands[:, : 6 * reach + 6].reshape(2, 6 * reach + 6, 6 * n)
    return PartNoise(which, raw, of_force, of_length, 1 - used.ravel())


def noises_of(
    regression: Regression, by_legs: FloatArray, chosen: NDArray[np.bool_], used: FloatArray
) -> list[PartNoise]:
    """The noises of the chosen rows of each segment that has some."""
    ends = np.cumsum([len(segment.time) for segment in regression.segments])[:-1]
    chosen_of = np.split(chosen, ends)
    used_of = np.split(used, np.cumsum([rows.sum() for rows in chosen_of])[:-1])
    of_segments = zip(regression.segments, np.split(by_legs, ends), chosen_of, used_of, strict=True)
    return [
        part_noise(segment.part.which, segment.noise, A[rows], kept)
        for segment, A, rows, kept in of_segments
        if rows.any()
    ]


class RowNoise(NamedTuple):
    """The fitted covariance of rows."""

    factors: list[FloatArray]  # lower bands of the Cholesky factor L of each part
    shares: Mapping[int, tuple[float, float]]  # s_F, s_L of each log

    def of(self, which: int) -> tuple[float, float]:
        """The shares of a log; of one that was not fitted, the geometric means of the others."""
        if which in self.shares:
            return self.shares[which]
        force, length = np.exp(np.log(list(self.shares.values())).mean(axis=0)).tolist()
        return force, length


def whitened_by(factors: Sequence[FloatArray], columns: FloatArray) -> FloatArray:
    """L⁻¹ x of columns (6 n, k), part by part."""
    ends = np.cumsum([factor.shape[1] for factor in factors])[:-1]
    white = [dtbtrs(L, x, uplo="L")[0] for L, x in zip(factors, np.split(columns, ends), strict=True)]
    return np.concatenate(white)


def fitted_noise(
    parts: Sequence[PartNoise], columns: FloatArray, extensions: FloatArray, residual: FloatArray, used: FloatArray
) -> RowNoise:
    """The covariance with the shares of both noises that fit each log best, by restricted maximum likelihood.

    The columns of the fit (n, 6, p) and of its extensions (n, 6, k), in units of their sizes, are all that may be in
    the mean of the rows: it takes no part in the likelihood.
    """
    first = np.cumsum([0, *(len(part.unused) // 6 for part in parts)])
    logs = list(dict.fromkeys(part.which for part in parts))
    shares: dict[int, tuple[float, float]] = {}
    for log in logs:
        of_log = [k for k, part in enumerate(parts) if part.which == log]
        every = sum(int(first[k + 1] - first[k]) for k in of_log)
        windows, rows = [], []
        for k in of_log:
            n = int(first[k + 1] - first[k])
            number = max(1, round(_WINDOWS * n / every))
            starts = [int(n / number * (w + 0.5) - _ROWS_A_WINDOW / 2) for w in range(number)]
            is_short = n <= number * _ROWS_A_WINDOW
            for start, end in [(0, n)] if is_short else [(start, start + _ROWS_A_WINDOW) for start in starts]:
                bands = (values[..., 6 * start : 6 * end] for values in parts[k][2:])
                windows.append(PartNoise(log, parts[k].raw, *bands))
                rows.append(np.arange(first[k] + start, first[k] + end))
        at = np.concatenate(rows)
        if len(logs) == 1 or used[at].sum() > _ENOUGH * (columns.shape[2] + extensions.shape[2]):
            shares[log] = _fitted_shares(windows, columns[at], extensions[at], residual[at], used[at])
    if not shares:  # all are short
        shares[logs[0]] = _fitted_shares(parts, columns, extensions, residual, used)
    noise = RowNoise([], shares)
    shares = {log: noise.of(log) for log in logs}
    return RowNoise([part.factor(*shares[part.which]) for part in parts], shares)


def _fitted_shares(
    windows: Sequence[PartNoise], columns: FloatArray, extensions: FloatArray, residual: FloatArray, used: FloatArray
) -> tuple[float, float]:
    """The shares s_F and s_L of both noises in these windows."""
    n = int(used.sum())
    D, X = ((used[..., None] * values).reshape(used.size, -1) for values in (columns, extensions))
    U, sigma, _ = np.linalg.svd(D / np.maximum(np.linalg.norm(D, axis=0), 1e-300), full_matrices=False)
    D = U[:, sigma > _DEPENDENT * sigma[0]]
    # where the motion lacks, columns are noise of the lengths themselves, which must not explain that of the residual
    white = whitened_by([window.factor(1.0, 1.0) for window in windows], np.concatenate([D, X], axis=1))
    Q, rest = np.linalg.qr(white[:, : D.shape[1]])[0], white[:, D.shape[1] :]
    _, sigma, directions = np.linalg.svd(np.linalg.qr(rest - Q @ (Q.T @ rest), mode="r"), full_matrices=False)
    X = X @ directions[sigma > np.maximum(INVISIBLE, _DEPENDENT * sigma[:1])].T
    Y, k = np.column_stack([D, X, (used * residual).ravel()]), D.shape[1] + X.shape[1]

    def shares(log_ratio: float) -> tuple[float, float]:
        # the larger of both is 1
        return float(np.exp(min(-log_ratio, 0.0))), float(np.exp(min(log_ratio, 0.0)))

    def cost(log_ratio: float) -> tuple[float, float]:
        factors = [window.factor(*shares(log_ratio)) for window in windows]
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
    force, length = shares(ratio)
    return variance * force, variance * length

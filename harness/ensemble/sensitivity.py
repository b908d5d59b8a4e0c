"""Sensitivity of a metric to the varied inputs: Sobol' indices, or standardised regression."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from gough_stewart.harness.ensemble.member_table import MemberTable
from gough_stewart.model.vectors import FloatArray

Method = Literal["sobol", "regression", "ranks"]
_REGRESSIONS = {
    "regression": "standardised regression",
    "ranks": "standardised regression of the metric's rank on that of each input's distance from its median",
}
_CONFIDENCE = 0.95
_SCORE = NormalDist().inv_cdf((1 + _CONFIDENCE) / 2)
# That one input matters more than another is said with 99 % confidence.
_BEYOND_DOUBT = NormalDist().inv_cdf(0.995)
_RESAMPLES = 100
# Members are resampled in at most this many groups of equal size, by their sums of products.
_GROUPS = 2000
_SMALLEST_R2 = 0.7
# A smaller standard deviation, of columns with 1, is rounding.
_ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The shares of the inputs in a metric's variance.

    - `sobol`: the share of each input alone (first order), and in total, with all its interactions. Requires only
      independent inputs.
    - `regression`: the standardised regression coefficient β, of y on all inputs, each divided by its standard
      deviation; its square is the share, as far as y is linear in the inputs, which R² measures.
    - `ranks`: the same of the rank of y on the ranks of |x − median|, where that explains more: it sees what grows on
      both sides of the middle, as an error does.
    """

    method: Method
    inputs: tuple[str, ...]
    effects: tuple[tuple[FloatArray, FloatArray], ...]  # alone or β, and in total: (p,), half of the 95 % interval (p,)
    order: list[int]  # inputs, most influential first: by the total share, or the size of the coefficient
    alike: list[int]  # inputs that may matter as much as the first, of those after it
    explains: bool  # whether it explains enough of the metric to name an input for it, by the adjusted R²
    remark: str  # a caption with method and caveats


def sensitivity_of(ensemble: MemberTable, metric: str) -> Sensitivity | None:
    """For one metric: Sobol' indices if the members are Saltelli's design, else regression; with confidence intervals.

    None if too few members have a value, no number varies, or all values are the same.
    """
    merit = np.where(ensemble.is_complete, ensemble.values(metric), np.nan)
    if ensemble.block > 1:
        return _sobol(merit, ensemble.metadata["groups"])

    # the coefficients of the inputs that are numbers and differ; strings and constants have none
    usable = np.isfinite(merit)
    y, columns = merit[usable], {name: ensemble.values(name)[usable] for name in ensemble.varied}
    numeric = {name: x for name, x in columns.items() if len(x) and np.isfinite(x).all() and np.ptp(x) > 0}
    n, p = len(y), len(numeric)
    if not numeric or n < p + 3 or np.ptp(y) == 0:
        return None

    # a straight line through the values, or through ranks where that explains more
    X = np.stack(list(numeric.values()), axis=1)
    method: Method = "regression"
    beta, r2, z, w = _fitted(X, y)
    distance = np.abs(X - np.median(X, axis=0))
    if r2 < _SMALLEST_R2 and (np.ptp(distance, axis=0) > 0).all():
        from scipy.stats import rankdata  # slow to import, and seldom needed

        of_ranks = _fitted(rankdata(distance, axis=0), rankdata(y))
        if of_ranks[1] > r2:
            method, (beta, r2, z, w) = "ranks", of_ranks

    # coefficients of resampled members, by normal equations. Beyond `_GROUPS` members, groups of members drawn at
    # random are resampled: members are independent, so the variance between groups is that of members, and the time
    # does not grow with their number.
    rng = np.random.default_rng(1)
    groups = min(n, _GROUPS)
    rows = np.concatenate([z, w[:, None], np.ones((n, 1))], axis=1)
    rows = rows if groups == n else rows[rng.permutation(n)]
    products = np.stack([part.T @ part for part in np.array_split(rows, groups)]).reshape(groups, -1)
    coefficients = []
    for _ in range(_RESAMPLES):
        counts = np.bincount(rng.integers(0, groups, groups), minlength=groups)
        total = (counts @ products).reshape(p + 2, p + 2)
        mean = total[:-1, -1] / total[-1, -1]
        C = total[:-1, :-1] / total[-1, -1] - np.outer(mean, mean)
        scale = np.sqrt(np.maximum(np.diag(C), 0.0))
        # not of one with an input that is the same for all of its members, or with inputs that depend on each other
        with suppress(np.linalg.LinAlgError):
            if (scale > _ROUNDING).all():
                coefficients.append(np.linalg.solve(C[:p, :p], C[:p, p]) * scale[:p] / scale[p])
    resamples = np.array(coefficients).reshape(-1, p)
    resamples = resamples[np.isfinite(resamples).all(axis=1)]

    half = np.full(p, np.nan)
    if len(resamples):
        low, high = np.quantile(resamples, ((1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2), axis=0)
        half = (high - low) / 2
    without = [name for name in columns if name not in numeric]
    return _ranked(method, tuple(numeric), ((beta, half),), resamples, n, len(merit) - n, r2, without)


def _sobol(merit: FloatArray, groups: Sequence[Sequence[str]]) -> Sensitivity | None:
    """Indices of a design of points, of which those count whose members have all completed.

    Saltelli, Annoni, Azzini, Campolongo, Ratto & Tarantola, Comput. Phys. Commun. 181 (2010) 259: first order by (b) of
    table 2, total by (f).
    """
    block = len(groups) + 2
    points = merit[: len(merit) // block * block].reshape(-1, block)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2 or np.ptp(points) == 0:
        return None
    # the estimators are biased if the mean is far from 0
    points = (points - points.mean()) / points.std()
    S1, ST = _indices(points)
    resamples = np.random.default_rng(1).integers(len(points), size=(len(points), _RESAMPLES))
    again = np.array([_indices(points[rows]) for rows in resamples.T])
    S1_conf, ST_conf = _SCORE * np.std(again, axis=0, ddof=1)
    # columns that vary together have one name: `base_points` for `base_points[1,1]`, `base_points[1,2]` and so on
    names = tuple(
        columns[0] if len(columns) == 1 else " & ".join(dict.fromkeys(name.partition("[")[0] for name in columns))
        for columns in groups
    )
    effects = (S1, S1_conf), (ST, ST_conf)
    return _ranked("sobol", names, effects, again[:, 1], points.size, len(merit) - points.size)


def _indices(points: FloatArray) -> FloatArray:
    """First-order and total indices (2, p) of rows f(A), f(A_B^1) to f(A_B^p), f(B), centred (n, p + 2).

    S_i = ⟨f(B) (f(A_B^i) − f(A))⟩ / V and T_i = ⟨(f(A) − f(A_B^i))²⟩ / 2V, with V the variance of f(A) and f(B); 0 if V
    is 0, which may happen with few members.
    """
    A, AB, B = points[:, :1], points[:, 1:-1], points[:, -1:]
    V = points[:, [0, -1]].var()
    if np.finfo(float).eps >= V:
        return np.zeros((2, AB.shape[1]))
    return np.asarray(np.stack([(B * (AB - A)).mean(axis=0), ((A - AB) ** 2).mean(axis=0) / 2]) / V)


def _ranked(
    method: Method,
    inputs: tuple[str, ...],
    effects: tuple[tuple[FloatArray, FloatArray], ...],
    again: FloatArray,
    n: int,
    left_out: int,
    r2: float | None = None,
    without: Sequence[str] = (),
) -> Sensitivity:
    """The inputs in order of their last effect, of which `again` has resamples (r, p), and what can be said of them.

    The difference to the largest is d; it is beyond doubt if d > z s, with s its standard deviation over the resamples,
    in each of which both effects are of the same members, so that what they share cancels. Of n members; those that are
    left out did not complete or have no value. Inputs that it is `without` are no numbers, or the same for all members.
    """
    size, again = np.abs(effects[-1][0]), np.abs(again)
    order: list[int] = np.argsort(-size, kind="stable").tolist()
    gap, spread = size[order[0]] - size, np.std(again[:, [order[0]]] - again, axis=0, ddof=1)
    alike = [k for k in order[1:] if not gap[k] > _BEYOND_DOUBT * spread[k]]
    explains = r2 is None or 1 - (1 - r2) * (n - 1) / (n - len(inputs) - 1) >= _SMALLEST_R2

    kind = "Sobol' indices" if r2 is None else f"{_REGRESSIONS[method]}, R² = {r2:.2f},"
    parts = [f"{kind} of {n} members"]
    if left_out:
        point = ", or at a point of the design with such a member" if method == "sobol" else ""
        parts.append(f"left out: {left_out} not completed or without a value{point}")
    parts.append("± and whiskers are 95 % confidence")
    if alike:
        parts.append(f"which of the first {len(alike) + 1} matters more cannot be determined")
    if without:
        parts.append(f"not numbers, or the same for all of these members: {', '.join(without)}")
    if not explains:
        parts.append("the metric is far from linear in the inputs: use sampling = 'saltelli' for Sobol' indices")
    return Sensitivity(method, inputs, effects, order, alike, explains, "; ".join(parts))


def _fitted(X: FloatArray, y: FloatArray) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Coefficients β (p,) of a metric (n,) on inputs (n, p), the share R², and both standardised.

    That is with mean 0 and standard deviation 1.
    """
    # by their range first, since squares of tiny numbers vanish
    z, w = ((values - values.mean(axis=0)) / np.ptp(values, axis=0) for values in (X, y))
    z, w = z / z.std(axis=0), w / w.std()
    beta = np.asarray(np.linalg.lstsq(z, w, rcond=None)[0], dtype=float)
    return beta, float(1 - np.mean((w - z @ beta) ** 2)), z, w

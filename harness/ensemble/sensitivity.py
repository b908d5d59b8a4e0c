"""Sensitivity of a metric to the varied inputs: Sobol' indices, or standardised regression."""

from collections.abc import Sequence
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

    - `sobol`: the share `main` of each input alone (first order), and `total`, with all its interactions; each with
      half the width of its confidence interval. Requires only independent inputs.
    - `regression`: `main` is the standardised regression coefficient β, of y on all inputs, each divided by its
      standard deviation; its square is the share, as far as y is linear in the inputs, which `r2` measures.
    - `ranks`: the same of the rank of y on the ranks of |x − median|, where that explains more: it sees what grows on
      both sides of the middle, as an error does.
    """

    metric: str
    method: Method
    inputs: tuple[str, ...]
    main: FloatArray
    main_confidence: FloatArray  # half the width at 95 %
    total: FloatArray | None
    total_confidence: FloatArray | None
    r2: float | None
    used: int  # number of members used
    left_out: int  # number of members that did not complete or have no value, in Sobol' indices with their points
    without: tuple[str, ...] = ()  # inputs that are not numbers, or the same for all members used
    alike: tuple[int, ...] = ()  # inputs that may matter as much as the first, of those after it

    @property
    def size(self) -> FloatArray:
        """By which inputs are ranked: the total share, or the coefficient's size (p,)."""
        return np.abs(self.main) if self.total is None else self.total

    @property
    def effects(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Effects (p,) and half the widths of their intervals: alone, and of Sobol' indices also in total."""
        alone = (self.main, self.main_confidence)
        if self.total is None or self.total_confidence is None:
            return (alone,)
        return alone, (self.total, self.total_confidence)

    @property
    def order(self) -> list[int]:
        """Inputs, most influential first."""
        return [int(k) for k in np.argsort(-self.size, kind="stable")]

    @property
    def explains(self) -> bool:
        """Whether it explains enough of the metric to name an input for it: by the adjusted R²."""
        if self.r2 is None:
            return True
        n, p = self.used, len(self.inputs)
        return 1 - (1 - self.r2) * (n - 1) / (n - p - 1) >= _SMALLEST_R2

    @property
    def remark(self) -> str:
        """A caption with method and caveats."""
        kind = "Sobol' indices" if self.r2 is None else f"{_REGRESSIONS[self.method]}, R² = {self.r2:.2f},"
        parts = [f"{kind} of {self.used} members"]
        if self.left_out:
            why = "not completed or without a value"
            if self.method == "sobol":
                why += ", or at a point of the design with such a member"
            parts.append(f"left out: {self.left_out} {why}")
        parts.append("± and whiskers are 95 % confidence")
        if self.alike:
            parts.append(f"which of the first {len(self.alike) + 1} matters more cannot be determined")
        if self.without:
            parts.append(f"not numbers, or the same for all of these members: {', '.join(self.without)}")
        if not self.explains:
            parts.append("the metric is far from linear in the inputs: use sampling = 'saltelli' for Sobol' indices")
        return "; ".join(parts)


def sensitivity_of(ensemble: MemberTable, metric: str) -> Sensitivity | None:
    """For one metric: Sobol' indices if the members are Saltelli's design, else regression; with confidence intervals.

    None if too few members have a value, no number varies, or all values are the same.
    """
    merit = np.where(ensemble.is_complete, ensemble.values(metric), np.nan)
    if ensemble.block > 1:
        return _sobol(metric, merit, ensemble.metadata["groups"])

    # the coefficients of the inputs that are numbers and differ; strings and constants have none
    usable = np.isfinite(merit)
    y, columns = merit[usable], {name: ensemble.values(name)[usable] for name in ensemble.varied}
    numeric = {name: x for name, x in columns.items() if len(x) and np.isfinite(x).all() and np.ptp(x) > 0}
    n, p = len(y), len(numeric)
    if not numeric or n < p + 3 or np.ptp(y) == 0:
        return None

    # a straight line through the values, or through ranks where that explains more
    X = np.stack(list(numeric.values()), axis=1)
    pairs: dict[Method, tuple[FloatArray, FloatArray]] = {"regression": (_standard(X), _standard(y))}
    fits = {"regression": _fitted(*pairs["regression"])}
    distance = np.abs(X - np.median(X, axis=0))
    if fits["regression"][1] < _SMALLEST_R2 and (np.ptp(distance, axis=0) > 0).all():
        from scipy.stats import rankdata  # slow to import, and seldom needed

        pairs["ranks"] = _standard(rankdata(distance, axis=0)), _standard(rankdata(y))
        fits["ranks"] = _fitted(*pairs["ranks"])
    method: Method = max(pairs, key=lambda name: fits[name][1])
    beta, r2 = fits[method]

    again = _resampled(*pairs[method])
    resamples = again[np.isfinite(again).all(axis=1)]
    half = np.full(p, np.nan)
    if len(resamples):
        low, high = np.quantile(resamples, ((1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2), axis=0)
        half = (high - low) / 2
    alike = _alike(np.abs(beta), np.abs(resamples))
    without = tuple(name for name in columns if name not in numeric)
    left_out = len(merit) - n
    return Sensitivity(metric, method, tuple(numeric), beta, half, None, None, r2, n, left_out, without, alike)


def _sobol(metric: str, merit: FloatArray, groups: Sequence[Sequence[str]]) -> Sensitivity | None:
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
    used, left_out = points.size, len(merit) - points.size
    return Sensitivity(
        metric, "sobol", names, S1, S1_conf, ST, ST_conf, None, used, left_out, alike=_alike(ST, again[:, 1])
    )


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


def _alike(size: FloatArray, again: FloatArray) -> tuple[int, ...]:
    """The inputs whose effect may be as large as the largest, by size (p,) and its resamples (r, p), largest first.

    The difference to the largest is d; it is beyond doubt if d > z s, with s its standard deviation over the resamples,
    in each of which both effects are of the same members, so that what they share cancels.
    """
    first, *following = np.argsort(-size, kind="stable").tolist()
    gap, spread = size[first] - size, np.std(again[:, [first]] - again, axis=0, ddof=1)
    return tuple(k for k in following if not gap[k] > _BEYOND_DOUBT * spread[k])


def _fitted(z: FloatArray, w: FloatArray) -> tuple[FloatArray, float]:
    """Coefficients β (p,) of a standardised metric (n,) on standardised inputs (n, p), and the share R²."""
    beta = np.asarray(np.linalg.lstsq(z, w, rcond=None)[0], dtype=float)
    return beta, float(1 - np.mean((w - z @ beta) ** 2))


def _standard(values: FloatArray) -> FloatArray:
    """Columns (n, …) of mean 0 and standard deviation 1."""
    # by their range first, since squares of tiny numbers vanish
    scaled = (values - values.mean(axis=0)) / np.ptp(values, axis=0)
    return np.asarray(scaled / scaled.std(axis=0))


def _resampled(z: FloatArray, w: FloatArray) -> FloatArray:
    """The coefficients (_RESAMPLES, p) of resampled members, by normal equations; NaN if singular.

    Beyond `_GROUPS` members, groups of members drawn at random are resampled: members are independent, so the
    variance between groups is that of members, and the time does not grow with their number.
    """
    n, p = z.shape
    rng = np.random.default_rng(1)
    groups = min(n, _GROUPS)
    rows = np.concatenate([z, w[:, None], np.ones((n, 1))], axis=1)
    rows = rows if groups == n else rows[rng.permutation(n)]
    products = np.stack([part.T @ part for part in np.array_split(rows, groups)]).reshape(groups, -1)
    coefficients = np.full((_RESAMPLES, p), np.nan)
    for k in range(_RESAMPLES):
        counts = np.bincount(rng.integers(0, groups, groups), minlength=groups)
        total = (counts @ products).reshape(p + 2, p + 2)
        mean = total[:-1, -1] / total[-1, -1]
        C = total[:-1, :-1] / total[-1, -1] - np.outer(mean, mean)
        scale = np.sqrt(np.maximum(np.diag(C), 0.0))
        if not (scale > _ROUNDING).all():  # an input that is the same for all of these
            continue
        try:
            coefficients[k] = np.linalg.solve(C[:p, :p], C[:p, p]) * scale[:p] / scale[p]
        except np.linalg.LinAlgError:
            continue
    return coefficients

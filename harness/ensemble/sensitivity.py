"""Sensitivity of a metric to the varied inputs: Sobol' indices, or standardised regression."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from gough_stewart.harness.ensemble.result import OUTCOME, Ensemble, metric_name
from gough_stewart.harness.errors import RecordError
from gough_stewart.model.vectors import FloatArray

Method = Literal["sobol", "regression"]
_CONFIDENCE = 0.95
_RESAMPLES = 100
# Largest number of members for regression and resampling; more would give the same, slower.
_MOST = 20_000
_SMALLEST_R2 = 0.7


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The shares of the inputs in a metric's variance.

    - `sobol`: the share `main` of each input alone (first order), and `total`, with all its interactions; each with
      half the width of its confidence interval. Requires only independent inputs.
    - `regression`: `main` is the standardised regression coefficient β, of y on all inputs, each divided by its
      standard deviation; its square is the share, as far as y is linear in the inputs, which `r2` measures.
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
    left_out: int  # number of members without a value

    @property
    def order(self) -> list[int]:
        """Inputs, most influential first."""
        size = np.abs(self.main) if self.total is None else self.total
        return [int(k) for k in np.argsort(-size, kind="stable")]

    @property
    def remark(self) -> str:
        """A caption with method and caveats."""
        of = f"of {self.used} members" + (f", {self.left_out} without a value left out" if self.left_out else "")
        if self.r2 is None:
            return f"Sobol' indices {of}; whiskers are 95 % confidence"
        text = f"standardised regression {of}, R² = {self.r2:.2f}; whiskers are 95 % confidence"
        if self.r2 < _SMALLEST_R2:
            text += "; the metric is far from linear in the inputs: use sampling = 'saltelli' for Sobol' indices"
        return text


def sensitivity(ensemble: Ensemble, metric: str) -> Sensitivity:
    """For one metric: Sobol' indices if the members are Saltelli's design, else regression.

    Saltelli, Annoni, Azzini, Campolongo, Ratto & Tarantola, Comput. Phys. Commun. 181 (2010) 259: first order by (b) of
    table 2, total by (f). Confidence intervals come from resampled members.

    Raises
    ------
    RecordError
        Unknown metric, nothing varies, or too few members have a value.
    """
    metric_name(ensemble.members, metric)
    merit = np.where(_completed(ensemble), ensemble.values(metric), np.nan)
    if ensemble.metadata.get("sampling") == "saltelli":
        return _sobol(metric, merit, ensemble.metadata["groups"])
    return _regression(ensemble, metric, merit)


def group_name(columns: Sequence[str]) -> str:
    """The name of columns that vary together: `base_points` for `base_points[1,1]`, `base_points[1,2]` and so on."""
    if len(columns) == 1:
        return columns[0]
    names = dict.fromkeys(column.partition("[")[0] for column in columns)
    return " & ".join(names)


def _completed(ensemble: Ensemble) -> FloatArray:
    return np.asarray((ensemble.members[OUTCOME] == "completed").to_numpy())


def _sobol(metric: str, merit: FloatArray, groups: Sequence[Sequence[str]]) -> Sensitivity:
    names = [group_name(columns) for columns in groups]
    block = len(groups) + 2
    points = merit[: len(merit) // block * block].reshape(-1, block)
    # a point counts only if all its members completed
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        raise RecordError(f"{metric}: {len(points)} points of Saltelli's design are complete; expected at least 2")
    if np.ptp(points) == 0:
        raise RecordError(f"{metric}: is the same for all members; expected one that varies")
    # the estimators are biased if the mean is far from 0
    points = (points - points.mean()) / points.std()
    S1, ST = _indices(points)
    resamples = np.random.default_rng(1).integers(len(points), size=(len(points), _RESAMPLES))
    spread = np.std([_indices(points[rows]) for rows in resamples.T], axis=0, ddof=1)
    S1_conf, ST_conf = NormalDist().inv_cdf((1 + _CONFIDENCE) / 2) * spread
    left_out = len(merit) - points.size
    return Sensitivity(metric, "sobol", tuple(names), S1, S1_conf, ST, ST_conf, None, points.size, left_out)


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


def _regression(ensemble: Ensemble, metric: str, merit: FloatArray) -> Sensitivity:
    columns = {name: ensemble.values(name) for name in ensemble.varied}
    X = np.stack(list(columns.values()), axis=1) if columns else np.zeros((len(merit), 0))
    usable = np.flatnonzero(np.isfinite(merit))
    # strings and constants have no coefficient
    kept = [k for k, x in enumerate(X.T) if len(usable) and np.isfinite(x[usable]).all() and np.ptp(x[usable]) > 0]
    n, p = len(usable), len(kept)
    if not kept:
        raise RecordError(f"{metric}: no number varies; expected an [ensemble] with distributions")
    if n < p + 3:
        raise RecordError(f"{metric}: {n} members have a value; expected at least {p + 3} for {p} inputs")
    if np.ptp(merit[usable]) == 0:
        raise RecordError(f"{metric}: is the same for all members; expected one that varies")
    usable = usable[:_MOST]
    x, y = X[usable][:, kept], merit[usable]
    beta, r2 = _standardised(x, y)
    with np.errstate(all="ignore"):
        again = _resampled((x - x.mean(axis=0)) / x.std(axis=0), (y - y.mean()) / y.std())
    low, high = np.nanquantile(again, ((1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2), axis=0)
    names = tuple(list(columns)[k] for k in kept)
    left_out = len(merit) - len(usable)
    return Sensitivity(metric, "regression", names, beta, (high - low) / 2, None, None, r2, len(usable), left_out)


def _standardised(x: FloatArray, y: FloatArray) -> tuple[FloatArray, float]:
    """Coefficients (p,) of y/σ_y on x/σ_x, and R²."""
    z, w = (x - x.mean(axis=0)) / x.std(axis=0), (y - y.mean()) / y.std()
    beta = np.linalg.lstsq(z, w, rcond=None)[0]
    return beta, float(1 - np.mean((w - z @ beta) ** 2))


def _resampled(z: FloatArray, w: FloatArray) -> FloatArray:
    """The coefficients (_RESAMPLES, p) of resampled members, by normal equations; NaN if singular."""
    n, p = z.shape
    rows = np.concatenate([z, w[:, None]], axis=1)
    rng = np.random.default_rng(1)
    found = np.full((_RESAMPLES, p), np.nan)
    for k in range(_RESAMPLES):
        some = rows[rng.integers(0, n, n)]
        some = some - some.mean(axis=0)
        C = some.T @ some
        scale = np.sqrt(np.diag(C))
        try:
            found[k] = np.linalg.solve(C[:p, :p], C[:p, p]) * scale[:p] / scale[p]
        except np.linalg.LinAlgError:
            continue
    return found

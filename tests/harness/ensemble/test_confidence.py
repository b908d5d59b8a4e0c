"""Confidence intervals, resample by resample: the same members are drawn, and each is evaluated by its definition."""

import math

import numpy as np
import polars
import pytest
from numpy.typing import NDArray

from gough_stewart.harness.ensemble.compare import compare
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import sensitivity
from gough_stewart.harness.report.proportions import quantile_interval
from gough_stewart.harness.sampling.design import Design
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import INPUTS, ensemble_of

PEAK = "tracking.position.norm_peak"


def of_metric(x: FloatArray, y: FloatArray, outcome: list[str] | None = None, sampling: str = "random") -> Ensemble:
    """Members with these inputs (n, 4) and this peak error (n,)."""
    found = ensemble_of(x, outcome, sampling=sampling)
    return Ensemble(found.members.with_columns(polars.Series(PEAK, y)), found.bands, found.metadata)


def bent(x: FloatArray) -> FloatArray:
    """A metric that no line has: R² is some 0.7."""
    return np.asarray(0.02 + 1e-3 * (x @ [2.0, -1.0, 0.5, 0.2] + np.abs(x[:, 1]) * x[:, 0] + x[:, 2] ** 2))


@pytest.mark.parametrize("failed", [0, 9])
def test_whiskers_of_a_regression_are_those_of_its_hundred_resamples(failed: int) -> None:
    """Expected: β of NumPy's least squares on columns of mean 0 and deviation 1 of each resample."""
    n = 70
    x = np.random.default_rng(6).normal(size=(n + failed, 4)) * [1.0, 3.0, 0.2, 7.0] + 5.0
    x[:n, 2] = 4.2
    outcome = ["completed"] * n + ["diverged"] * failed
    y = bent(x)
    found = sensitivity(of_metric(x, y, outcome), PEAK)
    assert (found.used, found.left_out, found.without) == (n, failed, (INPUTS[2],))
    kept = x[:n][:, [0, 1, 3]]

    def beta(rows: NDArray[np.intp]) -> FloatArray:
        z, w = kept[rows], y[:n][rows]
        z, w = (z - z.mean(axis=0)) / z.std(axis=0), (w - w.mean()) / w.std()
        return np.asarray(np.linalg.lstsq(z, w, rcond=None)[0])

    whole = np.arange(n)
    assert found.main == pytest.approx(beta(whole), rel=1e-9)
    rng = np.random.default_rng(1)
    again = np.array([beta(rng.integers(0, n, n)) for _ in range(100)])
    low, high = np.quantile(again, [0.025, 0.975], axis=0)
    assert found.main_confidence == pytest.approx((high - low) / 2, rel=1e-7)
    z = (kept - kept.mean(axis=0)) / kept.std(axis=0)
    w = (y[:n] - y[:n].mean()) / y[:n].std()
    assert found.r2 == pytest.approx(1 - ((w - z @ found.main) ** 2).mean())
    assert found.r2 is not None
    assert found.r2 < 0.95


def test_whiskers_of_indices_are_those_of_their_hundred_resamples() -> None:
    """Expected: the sums of Saltelli's estimators, point by point; 1.96 deviations of resampled points."""
    design = Design("saltelli", 5, 6 * 40, INPUTS, (1, 1, 1, 1), ((0,), (1,), (2,), (3,)))
    x = np.sqrt(12) * (design.points(0, design.members) - 0.5)
    outcome = ["completed"] * len(x)
    outcome[6 * 7 + 2] = "stopped"
    y = bent(x)
    found = sensitivity(of_metric(x, y, outcome, "saltelli"), PEAK)
    assert (found.used, found.left_out) == (6 * 39, 6)
    points = np.delete(y.reshape(40, 6), 7, axis=0)
    points = (points - points.mean()) / points.std()

    def indices(rows: NDArray[np.intp]) -> tuple[list[float], list[float]]:
        first, last = points[rows, 0], points[rows, 5]
        both = np.concatenate([first, last])
        V = (both**2).mean() - both.mean() ** 2
        n = len(rows)
        alone = [sum(last * (points[rows, k] - first)) / n / V for k in range(1, 5)]
        total = [sum((first - points[rows, k]) ** 2) / (2 * n) / V for k in range(1, 5)]
        return alone, total

    assert found.total is not None
    assert found.total_confidence is not None
    alone, total = indices(np.arange(39))
    assert found.main == pytest.approx(alone, rel=1e-9)
    assert found.total == pytest.approx(total, rel=1e-9)
    resamples = np.random.default_rng(1).integers(39, size=(39, 100))
    again = np.array([indices(resamples[:, k]) for k in range(100)])
    spread = 1.959964 * again.std(axis=0, ddof=1)
    assert found.main_confidence == pytest.approx(spread[0], rel=1e-6)
    assert found.total_confidence == pytest.approx(spread[1], rel=1e-6)
    assert found.order == np.argsort(-np.array(total)).tolist()


@pytest.mark.parametrize("n", [9, 60])
def test_the_interval_of_a_median_is_that_of_a_thousand_resamples(n: int) -> None:
    """Expected: quantiles of NumPy's medians of the members drawn, for even and odd numbers."""
    x = np.random.default_rng(3).normal(size=(n, 4))
    a, gap = ensemble_of(x), np.random.default_rng(4).normal(size=n)
    b = Ensemble(a.members.with_columns(polars.Series(PEAK, a.values(PEAK) + gap)), a.bands, a.metadata)
    row = compare(a, b).differences.row(by_predicate=polars.col("metric") == PEAK, named=True)
    rng = np.random.default_rng(1)
    medians = [np.median(np.sort(gap)[rng.integers(0, n, n)]) for _ in range(1000)]
    assert (row["median_low"], row["median_high"]) == pytest.approx(np.quantile(medians, [0.025, 0.975]), abs=1e-12)


def test_design_points_that_vary_in_nothing_have_no_share() -> None:
    """Expected: too few whole points, or a metric that is the same in all, are refused by the name of the metric."""
    x = np.zeros((12, 4))
    with pytest.raises(ValueError, match="1 points of Saltelli's design are complete; expected at least 2"):
        sensitivity(of_metric(x, np.arange(12.0), ["completed"] * 11 + ["stopped"], "saltelli"), PEAK)
    with pytest.raises(ValueError, match=f"{PEAK}: is the same for all members"):
        sensitivity(of_metric(x, np.ones(12), None, "saltelli"), PEAK)
    # only the points between the ends vary
    y = np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 1.0], 2)
    found = sensitivity(of_metric(x, y, None, "saltelli"), PEAK)
    assert found.total is not None
    assert found.main.tolist() == found.total.tolist() == [0.0] * 4


@pytest.mark.parametrize(("n", "level"), [(10, 0.5), (59, 0.95), (100, 0.95), (213, 0.25)])
def test_the_interval_of_a_quantile_is_the_narrowest_of_order_statistics(n: int, level: float) -> None:
    """Expected: exact sums of the binomial distribution; one value further in would leave more than 2.5 % outside."""

    def at_most(k: int) -> float:
        return math.fsum(math.comb(n, j) * level**j * (1 - level) ** (n - j) for j in range(k + 1))

    found = quantile_interval(np.arange(1.0, n + 1)[::-1], level)
    lows = [r for r in range(1, n + 1) if at_most(r - 1) <= 0.025]
    highs = [s for s in range(1, n + 1) if at_most(s - 1) >= 0.975]
    assert found == (max(lows, default=None), min(highs, default=None))

"""Tests of lack of fit, against F tests of two regressions each and sums written out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2, kstest
from scipy.stats import f as f_distribution

from gough_stewart.harness.identify.lack_of_fit import LackOfFit, lack_of_fit, whiteness

RNG = np.random.default_rng(17)
N = 90
USED = np.ones((N // 6, 6))
D = RNG.standard_normal((N, 3)) * np.array([1.0, 50.0, 1e-3])
FAMILIES = {
    "two": RNG.standard_normal((N, 2)),
    "three": 1e4 * RNG.standard_normal((N, 3)),
    "one": D[:, :1] + 0.1 * RNG.standard_normal((N, 1)),
}
# What is there, but not fitted.
RESIDUAL = 2.0 * RNG.standard_normal(N) + FAMILIES["three"] @ np.array([2e-5, 0.0, 8e-5])


def squares_left(*columns: np.ndarray) -> float:
    """The sum of squares that regression on these columns leaves."""
    X = np.concatenate(columns, axis=1)
    size = np.abs(X).max(axis=0)
    return float(((RESIDUAL - X @ (np.linalg.lstsq(X / size, RESIDUAL)[0] / size)) ** 2).sum())


def test_each_family_is_tested_by_what_it_explains_beyond_the_fit() -> None:
    """Expected: F of the regressions with and without it, over the variance that all families leave."""
    # All: min m p_(i)/i against 40,000 draws of independent families, to four errors of 4,000 draws; these, nearly
    # independent, share their variance of 81 degrees. A column below 0.3 standard deviations is left out.
    hidden = {"hidden": RNG.standard_normal((N, 1)) * 0.2 / np.sqrt(N)}
    outcome = lack_of_fit(D, FAMILIES | hidden, RESIDUAL, USED)
    assert outcome is not None
    test, white, rest = outcome
    every, freedom = squares_left(D, *FAMILIES.values()), N - 3 - 6
    assert float(rest @ rest) == pytest.approx(every)
    assert test.excess == pytest.approx((squares_left(D) - every) / (every / freedom) - 6)
    assert list(test.p_values) == ["two", "three", "one", "whiteness"]
    for name, X in FAMILIES.items():
        q = X.shape[1]
        F = (squares_left(D) - squares_left(D, X)) / q / (every / freedom)
        assert test.p_values[name] == pytest.approx(f_distribution.sf(F, q, freedom), rel=1e-9)
    assert test.p_values["whiteness"] == pytest.approx((np.sort(white) * 6 / np.arange(1, 7)).min())
    observed = np.sort(list(test.p_values.values()))
    simes = (observed * 4 / np.arange(1, 5)).min()
    draws = np.sort(np.random.default_rng(5).uniform(size=(40_000, 4)), axis=1)
    expected = ((draws * 4 / np.arange(1, 5)).min(axis=1) <= simes).mean()
    assert test.combined == pytest.approx(expected, abs=4 * np.sqrt(max(expected, 1e-3) / 4000))
    assert [LackOfFit({}, p).alarm for p in (0.0499, 0.0501)] == [True, False]
    several, fewer = {"many": RNG.standard_normal((N, 43))}, USED.copy()
    fewer[0, :2] = 0.0
    assert lack_of_fit(D, several, RESIDUAL, USED) is not None
    assert lack_of_fit(D, several, RESIDUAL, fewer) is None


def test_whiteness_is_that_of_ljung_and_box_over_the_rows_that_are_used() -> None:
    """Expected: the sum over lags written out in loops; rows that are not used take no part."""
    r = RNG.standard_normal((60, 3)) * np.array([1.0, 20.0, 0.3])
    r[1:, 2] += 0.4 * r[:-1, 2]
    used = (RNG.uniform(size=r.shape) > 0.2).astype(float)
    for lags in (10, 4):
        p = whiteness(r, used, lags)
        for k in range(3):
            rows = [t for t in range(60) if used[t, k]]
            power = np.mean([r[t, k] ** 2 for t in rows])
            Q = 0.0
            for lag in range(1, lags + 1):
                pairs = [(t, t - lag) for t in rows if t - lag in rows]
                Q += (sum(r[a, k] * r[b, k] for a, b in pairs) / power) ** 2 / len(pairs)
            assert p[k] == pytest.approx(chi2.sf(Q, lags), rel=1e-9)
    assert_allclose(whiteness(np.zeros((30, 2)), np.ones((30, 2))), 1.0)


def test_p_values_of_white_noise_are_uniform() -> None:
    """Expected: by Kolmogorov and Smirnov, of 150 regressions with families that share columns; 1 in 1000 fails."""
    rng = np.random.default_rng(3)
    p_values = []
    for _ in range(150):
        columns, common = rng.standard_normal((120, 4)), rng.standard_normal((120, 3))
        families = {str(q): np.hstack([common, rng.standard_normal((120, q))]) for q in (1, 4, 12)}
        outcome = lack_of_fit(columns, families, rng.standard_normal(120), np.ones((20, 6)))
        assert outcome is not None
        p_values.append(outcome[0].combined)
    assert kstest(p_values, "uniform").pvalue > 1e-3

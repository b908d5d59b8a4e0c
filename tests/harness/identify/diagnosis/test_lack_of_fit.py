"""Tests of lack of fit, against F tests of two regressions each and sums written out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from gough_stewart.harness.identify.lack_of_fit import (
    LackOfFit,
    Projection,
    beyond,
    explained,
    lack_of_fit,
    projection_of,
    whiteness,
)

RNG = np.random.default_rng(17)
N = 90
D = RNG.standard_normal((N, 3)) * np.array([1.0, 50.0, 1e-3])
FAMILIES = {
    "two": RNG.standard_normal((N, 2)),
    "three": 1e4 * RNG.standard_normal((N, 3)),
    "one": D[:, :1] + 0.1 * RNG.standard_normal((N, 1)),
}
# What is there, but not fitted.
RESIDUAL = 2.0 * RNG.standard_normal(N) + FAMILIES["three"] @ np.array([2e-5, 0.0, 8e-5])


def left(*columns: np.ndarray) -> float:
    """The sum of squares that regression on these columns leaves."""
    X = np.concatenate(columns, axis=1)
    size = np.abs(X).max(axis=0)
    return float(((RESIDUAL - X @ (np.linalg.lstsq(X / size, RESIDUAL)[0] / size)) ** 2).sum())


def found() -> Projection:
    tested = {name: np.eye(X.shape[1]) for name, X in FAMILIES.items()}
    made = projection_of(D, FAMILIES, tested, dict.fromkeys(FAMILIES, 0.0), RESIDUAL, N)
    assert made is not None
    return made


def test_each_family_is_tested_by_what_it_explains_beyond_the_fit() -> None:
    """Expected: F of the regressions with and without it, over the variance that all families leave."""
    projection = found()
    least, freedom = left(D, *FAMILIES.values()), N - 3 - 6
    assert projection.freedom == freedom
    assert float(projection.rest @ projection.rest) == pytest.approx(least)
    test = lack_of_fit(projection, 0.37)
    assert list(test.p_values) == ["two", "three", "one", "whiteness"]
    assert test.p_values["whiteness"] == 0.37
    for name, X in FAMILIES.items():
        q = X.shape[1]
        F = (left(D) - left(D, X)) / q / (least / freedom)
        assert test.p_values[name] == pytest.approx(f_distribution.sf(F, q, freedom), rel=1e-9)
        own = explained(projection, projection.extensions[name])
        assert own.rank == q
        assert own.improvement == pytest.approx((left(D) - left(D, X)) / (least / freedom), rel=1e-9)
    # of one hypothesis beyond another: the regression with both, against that with the other
    F = (left(D, FAMILIES["two"]) - left(D, FAMILIES["two"], FAMILIES["three"])) / 3 / (least / freedom)
    p = beyond(projection, projection.extensions["three"], projection.extensions["two"])
    assert p == pytest.approx(f_distribution.sf(F, 3, freedom), rel=1e-9)
    assert beyond(projection, projection.extensions["two"], projection.extensions["two"]) == 1.0
    # whatever the units of each column
    three, two = projection.extensions["three"] * [1e-11, 1.0, 1e4], projection.extensions["two"] * [1e9, 1e-6]
    assert explained(projection, three).rank == 3
    assert explained(projection, three).improvement == pytest.approx(
        explained(projection, projection.extensions["three"]).improvement, rel=1e-9
    )
    assert beyond(projection, three, two) == pytest.approx(p, rel=1e-9)


def test_all_tests_together_have_the_least_of_simes() -> None:
    """Expected: min m p_(i)/i against 40,000 draws of independent families, to four of the errors of 4,000 draws."""
    rng = np.random.default_rng(5)
    test = lack_of_fit(found(), 0.37)
    observed = np.sort(list(test.p_values.values()))
    m = len(observed)
    simes = (observed * m / np.arange(1, m + 1)).min()
    draws = np.sort(rng.uniform(size=(40_000, m)), axis=1)
    expected = ((draws * m / np.arange(1, m + 1)).min(axis=1) <= simes).mean()
    # the families here are nearly independent, and share their variance of 84 degrees
    assert test.combined == pytest.approx(expected, abs=4 * np.sqrt(max(expected, 1e-3) / 4000))
    assert LackOfFit({}, 0.0499).alarm
    assert not LackOfFit({}, 0.0501).alarm


def test_effects_too_small_to_see_and_too_few_rows_are_not_tested() -> None:
    """Expected: a family of size 1e-3 has an effect of its columns' norm times that: below 0.3 it is left out."""
    one = {"seen": np.ones((N, 1)) * 400 / np.sqrt(N), "hidden": RNG.standard_normal((N, 1)) * 200 / np.sqrt(N)}
    tested = {name: np.eye(1) for name in one}
    made = projection_of(D, one, tested, {"seen": 1e-3, "hidden": 1e-3}, RESIDUAL, N)
    assert made is not None
    assert {name: basis.shape[1] for name, basis in made.tested.items()} == {"seen": 1, "hidden": 0}
    assert list(lack_of_fit(made, 0.5).p_values) == ["seen", "whiteness"]
    several = {"many": RNG.standard_normal((N, 40))}
    assert projection_of(D, several, {"many": np.eye(40)}, {"many": 0.0}, RESIDUAL, 3 + 2 * 40) is not None
    assert projection_of(D, several, {"many": np.eye(40)}, {"many": 0.0}, RESIDUAL, 3 + 2 * 40 - 1) is None


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

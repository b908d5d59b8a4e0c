"""What intervals and gains are made of, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import curve_fit

from gough_stewart.harness.identify.diagnosis.lack_of_fit import whiteness
from gough_stewart.harness.identify.fit import Channels, estimate_of, uncertainty
from gough_stewart.harness.identify.physical import BestFit


def test_residuals_that_remember_are_not_white() -> None:
    noise = np.random.default_rng(3).standard_normal((2000, 2))
    noise[1:, 1] += 0.3 * noise[:-1, 1]
    white, coloured = whiteness(noise, np.ones_like(noise))
    assert white > 0.01
    assert coloured < 1e-10


def test_covariance_of_a_regression_is_that_of_another_least_squares() -> None:
    """Expected: SciPy's `curve_fit` of the same rows; rows that are not used, which are 0, change nothing."""
    rng = np.random.default_rng(5)
    D, truth = rng.standard_normal((40, 6, 3)), np.array([1.0, -2.0, 0.5])
    values = D @ truth + 2.0 * rng.standard_normal((40, 6))
    D[:, 2], values[:, 2] = 0.0, 0.0
    kept = np.arange(6) != 2
    X, y = D[:, kept].reshape(-1, 3), values[:, kept].ravel()
    found, expected = curve_fit(lambda X, *p: X @ np.array(p), X, y, p0=[0.0, 0.0, 0.0])
    assert_allclose(uncertainty(D, values - D @ found)[2], expected, rtol=1e-6)


def test_fitted_and_validating_samples_have_residuals_of_their_own() -> None:
    """Expected: RMS 1 N where the residuals are ±1 N and fitted, 3 N where they are ±3 N and validate the fit."""
    n, fitted = 100, 80
    sign = np.where(np.arange(n)[:, None] % 2, 1.0, -1.0) * np.ones(6)
    residual = sign * np.where(np.arange(n) < fitted, 1.0, 3.0)[:, None]
    measured = 50 + 5 * np.sin(np.arange(n))[:, None] + residual
    is_fitted, time = np.arange(n) < fitted, np.linspace(0, 0.99, n)
    channels = Channels("force of leg", "N", time, measured, residual, measured, is_fitted, [(0.8, 0.99)])
    regression = (np.ones((fitted, 6, 1)), residual[:fitted])
    found = estimate_of(("mass",), np.ones(1), np.ones(1), BestFit(np.ones(1), ("mass",)), regression, channels, ())
    assert found.residuals.rms == pytest.approx(np.ones(6))
    assert found.residuals.validation_rms == pytest.approx(3 * np.ones(6))
    assert found.details["validating"] == [(0.8, 0.99)]
    assert_allclose(found.details["fitted"], measured - residual)
    assert any("mass" in note for note in found.notes)

"""What intervals and gains are made of, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart.harness.identify.course import _gains
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of
from gough_stewart.harness.identify.lack_of_fit import whiteness
from gough_stewart.harness.identify.physical import BestFit


def test_residuals_that_remember_are_not_white() -> None:
    noise = np.random.default_rng(3).standard_normal((2000, 2))
    noise[1:, 1] += 0.3 * noise[:-1, 1]
    white, coloured = whiteness(noise, np.ones_like(noise))
    assert white > 0.01
    assert coloured < 1e-10


@pytest.mark.parametrize("index", [1e-3, 0.1, 2.0])
def test_gains_are_those_of_the_stationary_kalman_filter(index: float) -> None:
    """Expected: Kalata's two relations between α, β and the tracking index λ = β/√(1 − α)."""
    alpha, beta = _gains(index)
    assert beta / np.sqrt(1 - alpha) == pytest.approx(index)
    assert beta == pytest.approx(2 * (2 - alpha) - 4 * np.sqrt(1 - alpha))


def test_fitted_and_validating_samples_have_residuals_of_their_own() -> None:
    """Expected: RMS 1 N where the residuals are ±1 N and fitted, 3 N where they are ±3 N and validate the fit."""
    n, fitted = 100, 80
    sign = np.where(np.arange(n)[:, None] % 2, 1.0, -1.0) * np.ones(6)
    residual = sign * np.where(np.arange(n) < fitted, 1.0, 3.0)[:, None]
    measured = 50 + 5 * np.sin(np.arange(n))[:, None] + residual
    is_fitted, time = np.arange(n) < fitted, np.linspace(0, 0.99, n)
    channels = Channels("force of leg", "N", time, measured, residual, measured, is_fitted, [(0.8, 0.99)])
    regression = (np.ones((fitted, 6, 1)), residual[:fitted])
    found = estimate_of(
        "linear", ("mass",), np.ones(1), np.ones(1), BestFit(np.ones(1), ("mass",)), regression, channels, ()
    )
    assert found.residuals.rms == pytest.approx(np.ones(6))
    assert found.residuals.validation_rms == pytest.approx(3 * np.ones(6))
    assert found.details["validating"] == [(0.8, 0.99)]
    assert_allclose(found.details["fitted"], measured - residual)
    assert any("mass" in note for note in found.notes)

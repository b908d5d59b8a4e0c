"""The low-pass and its derivatives, against polynomials, sines and the gains that are documented."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart.harness.identify.lowpass import cutoff_of, edge, noise_beyond, smoothed

H = 4e-3
T = 7.3 + H * np.arange(400)


@pytest.mark.parametrize("cutoff", [15.0, 40.0, 0.5 / H / 1.5])
@pytest.mark.parametrize("late", [0.0, -2e-3])
def test_lines_and_parabolas_have_their_derivatives_exactly(cutoff: float, late: float) -> None:
    """Expected: closed forms, up to the highest cut-off: 0.15 % of a second derivative is as much of a mass."""
    x = np.stack([0.3 + 0.2 * (T - late) - 1.7 * (T - late) ** 2, 1.1 - 0.9 * (T - late)], axis=1)
    inner = T[edge(H, cutoff) : -edge(H, cutoff)][::3]
    rate = smoothed(x, H, cutoff, 3, 1, late)
    assert_allclose(rate, np.stack([0.2 - 3.4 * inner, np.full(len(inner), -0.9)], axis=1), rtol=1e-4)
    assert_allclose(smoothed(x, H, cutoff, 3, 0, late)[:, 1], 1.1 - 0.9 * inner, rtol=1e-4)
    if late == 0:
        assert_allclose(smoothed(x, H, cutoff, 3, 2), np.tile([-3.4, 0.0], (len(inner), 1)), atol=1e-8)


@pytest.mark.parametrize(
    ("share", "gain", "error"), [(0.1, 1.0, 1e-3), (0.45, 1.0, 2e-3), (1.0, 0.5, 2e-3), (1.5, 0.0, 2e-3)]
)
def test_gains_are_those_that_are_documented(share: float, gain: float, error: float) -> None:
    """Expected: 1 up to half of the cut-off, a half at it, 0 beyond one and a half; no phase, also of derivatives."""
    w = 2 * np.pi * share * 30.0
    x = np.stack([np.sin(w * T), np.cos(w * T)], axis=1)
    inner = w * T[edge(H, 30.0) : -edge(H, 30.0)]
    s, c = np.sin(inner), np.cos(inner)
    assert_allclose(smoothed(x, H, 30.0), gain * np.stack([s, c], 1), atol=error)
    assert_allclose(smoothed(x, H, 30.0, 1, 1) / w, gain * np.stack([c, -s], 1), atol=error)
    assert_allclose(smoothed(x, H, 30.0, 1, 2) / w**2, -gain * np.stack([s, c], 1), atol=error)


@pytest.mark.parametrize("cutoff", [15.0, 40.0])
def test_white_noise_has_the_size_that_its_rejected_part_shows(cutoff: float) -> None:
    """Expected: the standard deviation of each channel beside a slow motion, to three standard errors of 2 %."""
    noise = np.random.default_rng(5).normal(size=(4000, 3)) * [1.0, 3.0, 0.2]
    motion = 50 * np.sin(2 * np.pi * 0.3 * H * np.arange(4000))
    assert_allclose(noise_beyond(motion[:, None] + noise, H, cutoff), [1.0, 3.0, 0.2], rtol=0.06)


@pytest.mark.parametrize(("begin", "seconds"), [(0.0, 10.0), (1.3, 4.4), (1.5, 2.0), (3.1, 2.0)])
def test_the_cut_off_is_that_of_the_motion_wherever_a_log_is_cut(begin: float, seconds: float) -> None:
    """Expected: sixteen times 0.9 Hz and up to three steps of the spectrum more, of a log that begins at full speed."""
    t = begin + np.arange(round(1e3 * seconds)) / 1e3
    lines = np.array([0.15, 0.3, 0.45, 0.6, 0.75, 0.9])
    noise = 1e-6 * np.random.default_rng(2).normal(size=(len(t), 6))
    length = 1.5 + 0.04 * np.sin(2 * np.pi * lines * t[:, None] + np.arange(6)[:, None, None]).sum(axis=2).T + noise
    assert 16 * 0.9 <= cutoff_of(length, 1e-3) <= 16 * (0.9 + 3 / seconds)

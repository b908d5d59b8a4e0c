"""Margins of loops with closed forms, in which no channel is like another; remedies; bounds of μ."""

from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.loop_margins import (
    Margins,
    loop_margins,
    response,
    scaled_norm,
)
from gough_stewart.harness.control.state_space import StateSpace

T = 1e-3


def plain(system: Any) -> StateSpace:
    """A system of python-control as its matrices."""
    return StateSpace(system.A, system.B, system.C, system.D, float(system.dt or 0.0))


def margins_of(*channels: Any) -> Margins:
    """Of transfer functions or systems beside each other."""
    return loop_margins(plain(control.append(*map(control.ss, channels))))


def of_legs(margins: Margins, name: str) -> list[float]:
    return [getattr(leg, name) for leg in margins.legs]


def test_peaks_of_a_double_integrator_under_pd_lie_between_the_frequencies_of_any_grid() -> None:
    """Expected for L = (kp + kd s)/s²: the largest |(S − T)/2| and |T| of 200,000 frequencies."""
    margins = margins_of(*[control.tf([3, 4], [1, 0, 0])] * 6)
    s = 1j * np.geomspace(0.01, 100, 200_000)
    loop = (3 * s + 4) / s**2
    assert margins.disk.alpha == pytest.approx(1 / np.abs((1 - loop) / (1 + loop) / 2).max(), rel=1e-6)
    assert margins.complementary_peak == pytest.approx(np.abs(loop / (1 + loop)).max(), rel=1e-6)


def test_third_order_channels_decades_apart_have_their_closed_forms() -> None:
    """Expected of k/(x + 1)³, x = s/ω or ω/s: stable below k = 8, by Routh's rule; |x| = √(k^(2/3) − 1) at gain 1.

    There x³ leaves a lag of φ = π − 3 atan |x|; to 1/x it is a lead, and what may lead by φ may lag by 2π − φ.
    """
    gains = np.array([1.5, 2.0, 3.0, 4.5, 6.0, 2.5])
    corners = np.array([0.003, 40.0, 0.9, 700.0, 8.0, 0.05])
    lags = np.array([True, False, False, True, False, True])
    s = control.tf("s")
    channels = zip(gains.tolist(), corners.tolist(), lags.tolist(), strict=True)
    unequal = margins_of(*(control.tf(k / ((s / w if is_lag else w / s) + 1) ** 3) for k, w, is_lag in channels))
    assert of_legs(unequal, "gain_up") == pytest.approx(8 / gains, rel=1e-5)
    assert of_legs(unequal, "gain_down") == [0] * 6
    x = np.sqrt(gains ** (2 / 3) - 1)
    crossover, phase = corners * np.where(lags, x, 1 / x), np.pi - 3 * np.arctan(x)
    assert of_legs(unequal, "crossover") == pytest.approx(crossover / (2 * np.pi), rel=1e-6)
    assert of_legs(unequal, "phase") == pytest.approx(phase, rel=1e-6)
    assert of_legs(unequal, "delay") == pytest.approx(np.where(lags, phase, 2 * np.pi - phase) / crossover, rel=1e-6)


def test_each_margin_has_the_frequency_of_its_own_limit() -> None:
    """Expected: by hand, of two gain crossovers the one with the smaller angle, and of two gain limits each its own.

    6/(ω/s + 1)³ leads by φ at |x| = √(6^(2/3) − 1), ω/|x|; at √35 · 8000 rad/s a low-pass has it fall with a large lag.
    2/((s − 1)(0.01 s + 1)²) is −2 at rest, and real again where tan(2 atan 0.01 ω) = ω, ω² = 9800.
    """
    s = control.tf("s")
    leads = margins_of(*[6 / (8 / s + 1) ** 3 / (s / 8000 + 1)] * 2).legs[0]
    x, high = np.sqrt(6 ** (2 / 3) - 1), 8000 * np.sqrt(35)
    assert leads.phase == pytest.approx(np.pi - 3 * np.arctan(x), abs=1e-3)
    assert leads.phase_at == pytest.approx(8 / x / (2 * np.pi), rel=1e-3)
    assert (leads.crossover, leads.delay) == pytest.approx(
        (high / (2 * np.pi), (np.pi - np.arctan(np.sqrt(35))) / high), rel=1e-3
    )
    both = margins_of(*[2 / ((s - 1) * (0.01 * s + 1) ** 2)] * 2).legs[0]
    assert (both.gain_down, both.gain_up) == pytest.approx((0.5, np.sqrt(9801) * 1.98 / 2), rel=1e-5)
    assert both.gain_up_at == pytest.approx(np.sqrt(9800) / (2 * np.pi), rel=1e-5)
    assert both.gain_down_at < 0.01


@pytest.mark.parametrize(
    ("channel", "down", "up"),
    [
        (control.tf([4.0], [1, 3, 3, 1]), 0.0, 2.0),  # 4/(s + 1)³: closed s³ + 3 s² + 3 s + 1 + 4 k by Routh
        (control.tf([2.0], [1, -1]), 0.5, np.inf),  # pole 1 − 2 k
        (control.tf([-0.5], [1]), 0.0, 2.0),  # 1 − k/2 = 0
        (control.tf([1.0], [1, -1], 0.1), 0.0, 2.0),  # pole 1 − k, leaves the circle at −1
        (control.tf([1.0], [1, 0, 0]) * control.tf([1.0, 1.0], [0.01, 1]), 0.0, np.inf),  # Routh: 1 > 0.01
        # factors on either side of a million: poles 1 − k g, and k g < 8 of 1/(s + 1)³
        (control.tf([5e5], [1, -1]), 1 / 5e5, np.inf),
        (control.tf([2e6], [1, -1]), 0.0, np.inf),
        (control.tf([4e-7], [1, 3, 3, 1]), 0.0, np.inf),
        (control.tf([2e-5], [1, 3, 3, 1]), 0.0, 4e5),
        # hardly damped poles on the axis, where the imaginary part changes its sign while it is all but infinite:
        # s² + 10 k s + ω² + k b is stable for 0 < k < ω²/|b|
        (control.tf([10.0, -1e-7], [1, 1e-11, 1.0]), 0.0, np.inf),
        (control.tf([10.0, 2e-7], [1, 1e-11, 9.61]), 0.0, np.inf),
        # (3 s + 4)/(s² (τ s + 1)) ends at zero along −1/ω²; by Routh stable, as 3 > 4 τ
        (control.tf([3, 4], [0.5, 1, 0, 0]), 0.0, np.inf),
        (control.tf([3, 4], [0.02, 1, 0, 0]), 0.0, np.inf),
        # k/(z + 1) − d is infinite at half the sample rate: the pole −1 − g k/(1 − g d) is 1 at g = 2/(2 d − k)
        (control.ss([[-1]], [[1]], [[-1e-4]], [[-0.25]], 0.01), 0.0, 2 / (0.5 + 1e-4)),
        (control.ss([[-1]], [[1]], [[-2e-3]], [[-0.1]], 0.01), 0.0, 2 / (0.2 + 2e-3)),
    ],
)
def test_gain_margins_have_their_closed_form_and_no_others(channel: Any, down: float, up: float) -> None:
    """Expected: by hand, in the comments; also where the loop meets the axis only at frequency 0 or at its highest."""
    margins = margins_of(channel, channel)
    assert of_legs(margins, "gain_down") == pytest.approx([down] * 2, rel=1e-5)
    assert of_legs(margins, "gain_up") == pytest.approx([up] * 2, rel=1e-5)


@pytest.mark.parametrize("cancelled", [0, 9])
def test_a_loop_in_one_direction_has_its_closed_form_with_few_and_with_many_states(cancelled: int) -> None:
    """Expected for L = g b cᵀ, bᵀc = 1, g = 2/(s + 1)³, f on leg k: det(1 + L) = 1 + g (1 + (f − 1) b_k c_k).

    With Routh's limit of 8, f is (8/2 − 1)/(b_k c_k) + 1 at ω = √3. Five eigenvalues of L are 0, to rounding.
    """
    b, c = np.array([1.0, 2, 0.5, 1, 3, 0.25]), np.array([0.1, 0.1, 0.4, 0.2, 0.02, 0.96])
    s = control.tf("s")
    more = control.series(*[control.ss((s + 7) / (s + 7))] * cancelled) if cancelled else 1
    channels = control.append(*[control.series(control.ss(2 / (s + 1) ** 3), more)] * 6)
    loop = plain(control.series(control.ss([], [], [], np.outer(b, c)), channels))
    margins = loop_margins(loop)
    assert len(loop.A) == 18 + 6 * cancelled
    assert of_legs(margins, "gain_up") == pytest.approx(3 / (b * c) + 1, rel=1e-6)
    assert of_legs(margins, "gain_up_at") == pytest.approx([np.sqrt(3) / (2 * np.pi)] * 6, rel=1e-6)
    assert margins.common.gain_up == pytest.approx(4, rel=1e-6)
    assert margins.common.gain_down == 0
    crossover = np.sqrt(4 ** (1 / 3) - 1)
    assert margins.common.phase == pytest.approx(np.pi - 3 * np.arctan(crossover), rel=1e-6)


def test_narrow_resonances_are_not_overlooked() -> None:
    """Expected for 0.05/(s² + 2 ζ s + 1), ζ = 1e-5: |S| peaks where the closed loop does, (1.05 − 1)/(2 ζ √1.05).

    And beyond a quarter of the sample rate, of S = (z² − 2 r₀ cos θ z + r₀²)/(z² − 2 r cos θ z + r²), (1 − r₀)/(1 − r).
    """
    zeta = 1e-5
    margins = margins_of(control.tf([0.05], [1, 2 * zeta, 1]), control.tf([0.05], [1, 2 * zeta, 1]))
    assert margins.sensitivity_peak == pytest.approx(0.05 / (2 * zeta * np.sqrt(1.05)), rel=1e-3)
    # gain 1 at ω² ≈ 1.05 and 0.95, where the phase is −180° or 0° but for 2 ζ ω/0.05
    assert margins.legs[0].phase == pytest.approx(2 * zeta * np.sqrt(1.05) / 0.05, rel=1e-3)
    assert margins.legs[0].delay == pytest.approx(2 * zeta / 0.05, rel=1e-3)
    theta, r, r0 = 2.5, 1 - 1e-6, 1 - 2e-5
    closed, opened = ([1, -2 * p * np.cos(theta), p**2] for p in (r, r0))
    sampled = margins_of(*[control.tf(np.subtract(closed, opened)[1:], opened, 0.01)] * 2)
    assert sampled.sensitivity_peak == pytest.approx((1 - r0) / (1 - r), rel=1e-3)
    assert sampled.disk.frequency == pytest.approx(theta / 0.01 / (2 * np.pi), rel=1e-5)


def test_a_loop_of_numbers_has_their_margins_also_if_it_is_real_but_for_rounding() -> None:
    """Expected for L = 2: S = 1/3, T = 2/3, α = 2/|S − T| = 6; no gain > 0 and no delay makes it unstable.

    For k (s + 1)/(s + 5) · (s + 5)/(s + 1): 1 + f k = 0 for f = −1/k; no lag makes |k| < 1 unstable.
    """
    static = margins_of(control.ss([], [], [], 2 * np.eye(6)))
    assert static.disk.alpha == pytest.approx(6)
    assert static.disk.gain == (0, np.inf)
    assert (static.sensitivity_peak, static.complementary_peak) == pytest.approx((1 / 3, 2 / 3))
    s, numbers = control.tf("s"), (-0.5, 0.75, 0.3, -0.25, 0.5, -0.8)
    lead, lag = control.ss((s + 1) / (s + 5)), control.ss((s + 5) / (s + 1))
    margins = margins_of(*(k * control.series(lead, lag) for k in numbers))
    for found, gain_up in ((static, [np.inf] * 6), (margins, [2, np.inf, np.inf, 4, np.inf, 1.25])):
        assert of_legs(found, "gain_up") == pytest.approx(gain_up, rel=1e-9)
        assert found.common.gain_up == pytest.approx(min(gain_up), rel=1e-9)
        assert {(leg.gain_down, leg.phase, leg.delay) for leg in found.legs} == {(0, np.inf, np.inf)}
    written = static.as_dict()
    assert (written["legs"][0]["gain_up"], written["disk"]["gain"]) == (None, [0, None])


def mode(pole: complex, step: float) -> Any:
    """A mode beside a stable one that no feedback reaches."""
    block = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]]) if np.imag(pole) else np.array([[pole.real]])
    n = len(block)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, n] = block, 0.3 if step else -4.0
    return control.ss(A, np.zeros((n + 1, 1)), np.zeros((1, n + 1)), 0.5, step)


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        (control.tf([1.0], [1, 0, 0]), r"eigenvalue -?0[+-]1j 1/s at 0\.159 Hz, expected left of 0"),
        (mode(1.1 * np.exp(0.5j), 0.02), r"\|z\| = 1\.1 at 4\.05 Hz, expected below 1"),  # √(0.5² + ln² 1.1)/(2 π T)
        (mode(2 + 3j, 0), r"eigenvalue 2[+-]3j 1/s at 0\.574 Hz, expected left of 0"),  # √13/2π
        (mode(1.0, 0.1), r"\|z\| = 1 at 0 Hz, expected below 1\), so .* no gains from"),
        (mode(0.0, 0), r"eigenvalue 0[+-]0j 1/s at 0 Hz, expected left of 0\), so .* no gains from"),
        # (s − 1)(s + 3) + k is stable from k = 3 on, by Routh's rule; s³ + 3 s² + 2 s + k below 6; s² (s + 2) + k never
        (control.tf([0.5], [1, 2, -3]), "stable with all gains × 8: choose a higher bandwidth"),
        (control.tf([2.0], [1, 2, -3]), "stable with all gains × 2: choose a higher bandwidth"),
        (control.tf([7.0], [1, 3, 2, 0]), "stable with all gains × 0.5: choose a lower bandwidth"),
        (control.tf([40.0], [1, 3, 2, 0]), "stable with all gains × 0.125: choose a lower bandwidth"),
        (control.tf([1.0], [1, 2, 0, 0]), r"no gains from × 0\.0625 to × 16 make it stable"),
        # no loops: the condition number of the last 1 + L is 6/(4 ε)
        (control.ss([], [], [], np.ones((6, 5))), "is 6×5; expected as many outputs as inputs"),
        (control.ss([], [], [], np.full((6, 6), np.nan)), "is not finite"),
        (control.ss([], [], [], -np.eye(6)), "expected a delay or a lag"),
        (control.ss([], [], [], np.diag([5, 0, 0, 0, 0, 4 * np.finfo(float).eps - 1])), "expected a delay or a lag"),
    ],
)
def test_loops_without_margins_say_why_and_what_would_help(channel: Any, message: str) -> None:
    """Expected: by hand, in the comments."""
    with pytest.raises(gs.GoughStewartError, match=message):
        margins_of(channel)


def test_what_moved_an_eigenvalue_of_an_experiment_is_named() -> None:
    """Expected: each alone makes the loop stable, as margins of the experiment without it show."""
    lazy = {"controller.bandwidth": 8, "actuators.lag": 0.1, "loop.duration": 1}
    with pytest.raises(gs.UnstableLoopError, match=r"it is stable without the actuators' lag of 0\.1 s") as caught:
        gs.margins("heave_step", lazy)
    assert "delay" not in str(caught.value)
    assert abs(caught.value.eigenvalue) > 1
    assert gs.margins("heave_step", {**lazy, "actuators.lag": 0}).disk.alpha > 0
    with pytest.raises(gs.UnstableLoopError, match=r"it is stable at a sample_time of 0\.01 s"):
        gs.margins("too_slow")


def test_delays_of_too_many_samples_are_refused_before_they_fill_the_memory() -> None:
    """Expected: 12 states of the platform, 6 of the lags, 6 a sample of delay, 6 of the PD; 300 are few enough."""
    with pytest.raises(gs.GoughStewartError, match=r"a delay of 1000 samples of 0\.001 s gives a .* of 60.. states"):
        gs.margins("heave_step", {"loop.delay": 1000, "loop.duration": 3})
    for delay, lag in ((47, 0.02), (48, 0.0)):
        with pytest.raises(gs.GoughStewartError, match=rf"delay of {delay} samples .* of 306 states; expected at most"):
            gs.margins("heave_step", {"loop.delay": delay, "actuators.lag": lag})


@pytest.mark.parametrize("count", [3, 40])
def test_the_response_of_many_states_is_that_of_the_equations(count: int) -> None:
    """Expected: C (z − A)⁻¹ B + D, solved at each frequency as it stands."""
    rng = np.random.default_rng(8)
    A = rng.normal(size=(90, 90))
    A *= 0.95 / np.abs(np.linalg.eigvals(A)).max()
    loop = plain(control.ss(A, *(rng.normal(size=size) for size in ((90, 6), (6, 90), (6, 6))), T))
    omega = np.geomspace(1, 3000, count)
    expected = [loop.C @ np.linalg.solve(np.exp(1j * w * T) * np.eye(90) - A, loop.B) + loop.D for w in omega]
    assert np.abs(response(loop, omega) - expected).max() < 1e-10 * np.abs(expected).max()


def test_the_scaled_norm_is_the_structured_singular_value() -> None:
    """Expected: √|ab| of ((0, a), (b, 0)), a diagonal's largest; no less than ρ(M U), U diagonal and unitary."""
    pairs = np.array([[[0, 100], [0.01, 0]], [[0, 3j], [12, 0]], [[2, 0], [0, -5j]]], dtype=complex)
    assert scaled_norm(pairs) == pytest.approx([1.0, 6.0, 5.0], rel=1e-9)
    upper = np.array([[2, 40, -7], [0, -3j, 90], [0, 0, 1]], dtype=complex)
    assert scaled_norm(np.array([upper, upper.T])) == pytest.approx([3, 3], rel=0.01)
    rng = np.random.default_rng(8)
    M = rng.normal(size=(20, 6, 6)) + 1j * rng.normal(size=(20, 6, 6))
    scales = np.exp(2 * rng.normal(size=(20, 6)))
    badly = np.asarray(scales[:, :, None] * M / scales[:, None, :], dtype=complex)
    bound, phases = scaled_norm(badly), np.exp(2j * np.pi * rng.uniform(size=(3000, 1, 6)))
    lower = np.array([np.abs(np.linalg.eigvals(matrix * phases)).max() for matrix in M[:7]])
    assert (lower <= bound[:7] * (1 + 1e-12)).all()
    assert (bound[:7] < 1.35 * lower).all()
    # what scaling cannot change, by whatever road it comes
    assert bound == pytest.approx(scaled_norm(M), rel=0.01)
    assert (bound < np.linalg.norm(badly, 2, axis=(1, 2)) / 2).sum() > 15

"""Margins of loops in which no channel is like another: of other gains, decades apart, with leads and lags."""

from typing import Any

import control
import numpy as np
import pytest

from gough_stewart.harness.control import margins
from gough_stewart.harness.control.margins import Margins, closed_loop, scaled_norm
from gough_stewart.harness.control.state_space import control_system, matrices_of
from gough_stewart.harness.errors import UnstableLoopError

# k/(s/ω + 1)³ in a channel, or with ω/s in the place of s/ω: passes low frequencies, or high ones
GAINS = np.array([1.5, 2.0, 3.0, 4.5, 6.0, 2.5])
CORNERS = np.array([0.003, 40.0, 0.9, 700.0, 8.0, 0.05])
LAGS = np.array([True, False, False, True, False, True])


def third_order(gain: float, corner: float, lags: bool) -> Any:
    s = control.tf("s")
    x = s / corner if lags else corner / s
    return control.ss(control.tf(gain / (x + 1) ** 3))


def loop_margins(system: Any) -> Margins:
    return margins.loop_margins(matrices_of(system))


@pytest.fixture(scope="module")
def unequal() -> Margins:
    channels = zip(GAINS.tolist(), CORNERS.tolist(), LAGS.tolist(), strict=True)
    return loop_margins(control.append(*(third_order(*each) for each in channels)))


def of_legs(margins: Margins, name: str) -> list[float]:
    return [getattr(leg, name) for leg in margins.legs]


def test_every_channel_has_the_gain_margin_of_its_gain(unequal: Margins) -> None:
    """Expected: x³ + 3 x² + 3 x + 1 + k is stable below k = 8, by Routh's rule; 1/x is stable where x is."""
    assert of_legs(unequal, "gain_up") == pytest.approx(8 / GAINS, rel=1e-5)
    assert of_legs(unequal, "gain_down") == [0] * 6


def test_every_channel_has_the_crossover_and_the_phase_of_its_corner(unequal: Margins) -> None:
    """Expected: |x| = √(k^(2/3) − 1) at gain 1, where x³ leaves a lag of φ = π − 3 atan |x|; to 1/x it is a lead.

    What may lead by φ may lag by 2π − φ.
    """
    x = np.sqrt(GAINS ** (2 / 3) - 1)
    crossover = CORNERS * np.where(LAGS, x, 1 / x)
    phase = np.pi - 3 * np.arctan(x)
    assert of_legs(unequal, "crossover") == pytest.approx(crossover / (2 * np.pi), rel=1e-6)
    assert of_legs(unequal, "phase") == pytest.approx(phase, rel=1e-6)
    assert of_legs(unequal, "delay") == pytest.approx(np.where(LAGS, phase, 2 * np.pi - phase) / crossover, rel=1e-6)


def test_a_gain_that_may_change_a_million_times_is_free() -> None:
    """Expected: closed poles 1 − k of k/(s − 1), and k < 8 of k/(s + 1)³; 1/k and 8/k on either side of a million."""
    gains = np.array([5e5, 2e6, 4e-7, 2e-5])
    first = [control.ss(control.tf([gain], [1, -1])) for gain in gains[:2]]
    third = [control.ss(control.tf([gain], [1, 3, 3, 1])) for gain in gains[2:]]
    margins = loop_margins(control.append(*first, *third))
    assert of_legs(margins, "gain_down") == pytest.approx([1 / gains[0], 0, 0, 0])
    assert of_legs(margins, "gain_up") == pytest.approx([np.inf, np.inf, np.inf, 8 / gains[3]], rel=1e-5)


def test_a_narrow_resonance_beyond_a_quarter_of_the_sample_rate_is_not_overlooked() -> None:
    """Expected: of S = (z² − 2 r₀ cos θ z + r₀²)/(z² − 2 r cos θ z + r²), (1 − r₀)/(1 − r) at θ."""
    theta, r, r0, T = 2.5, 1 - 1e-6, 1 - 2e-5, 0.01
    closed, opened = ([1, -2 * p * np.cos(theta), p**2] for p in (r, r0))
    one = control.ss(control.tf(np.subtract(closed, opened)[1:], opened, T))
    found = loop_margins(control.append(one, one))
    assert found.sensitivity_peak == pytest.approx((1 - r0) / (1 - r), rel=1e-3)
    assert found.disk.frequency == pytest.approx(theta / T / (2 * np.pi), rel=1e-5)


def test_the_closed_loop_is_the_complementary_sensitivity() -> None:
    """Expected: T = L (1 + L)⁻¹ at a frequency, of two channels that feel each other."""
    L = control.ss(
        [[0.5, 0.2], [-0.3, 0.4]], [[1.0, 0.3], [-0.2, 0.7]], [[0.6, -0.1], [0.2, 0.9]], np.diag([0.1, 0]), 0.1
    )
    z = np.exp(0.7j)
    assert control_system(closed_loop(matrices_of(L)))(z) == pytest.approx(L(z) @ np.linalg.inv(np.eye(2) + L(z)))


@pytest.mark.parametrize(
    ("pole", "T", "message"),
    [
        (1.1 * np.exp(0.5j), 0.02, r"\|z\| = 1\.1 at 4\.05 Hz, expected below 1"),  # √(0.5² + ln² 1.1)/(2 π T)
        (2 + 3j, 0, r"eigenvalue 2[+-]3j 1/s at 0\.574 Hz, expected left of 0"),  # √13/2π
        (1.0, 0.1, r"\|z\| = 1 at 0 Hz, expected below 1\), so .* no gains from"),
        (0.0, 0, r"eigenvalue 0[+-]0j 1/s at 0 Hz, expected left of 0\), so .* no gains from"),
    ],
)
def test_the_worst_eigenvalue_is_named_with_its_frequency(pole: complex, T: float, message: str) -> None:
    """Expected: by hand, of a mode beside a stable one that no feedback reaches; on the edge is not stable."""
    mode = np.array([[pole.real, pole.imag], [-pole.imag, pole.real]]) if np.imag(pole) else np.array([[pole.real]])
    n = len(mode)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, n] = mode, 0.3 if T else -4.0
    with pytest.raises(UnstableLoopError, match=message):
        margins.loop_margins(matrices_of(control.ss(A, np.zeros((n + 1, 1)), np.zeros((1, n + 1)), 0.5, T)))


@pytest.mark.parametrize("way", [1, -1])
def test_a_peak_is_refined_between_the_neighbours_of_the_highest_point(way: int) -> None:
    """Expected: of 1/s, |S/T| = ω, so that any function of ω can be had; its highest peak, not a lower one nearby."""

    def two_peaks(S: Any, T: Any) -> Any:
        # the lower one is broad, and lies beyond a neighbour of the highest point
        x = way * np.log(np.abs(S / T)[:, 0, 0])
        return 2 / (1 + ((x - 0.32) / 0.04) ** 2) + 1.2 / (1 + ((x + 0.5) / 0.15) ** 2)

    integrator = matrices_of(control.tf([1], [1, 0]))
    grid = np.sort(np.exp(way * np.array([-2.0, -1.0, 0.0, 0.3, 0.6, 2.0])))
    height, at = margins._peak(two_peaks, integrator, grid, margins.sensitivities(integrator, grid))
    assert height == pytest.approx(2 + 1.2 / (1 + (0.82 / 0.15) ** 2), rel=1e-4)
    assert way * np.log(at) == pytest.approx(0.32, abs=1e-3)


def test_crossings_are_found_wherever_they_lie_on_the_grid() -> None:
    """Expected: the roots; in the first and the last interval, and in three that follow each other."""
    roots, grid = np.array([1.3, 4.1, 5.6, 6.2, 9.9]), np.array([1.0, 2.0, 3.5, 5.0, 6.0, 7.0, 8.0, 10.0])

    def polynomial(omega: Any) -> Any:
        return np.prod(omega[:, None] - roots, axis=1)

    assert margins._crossings(polynomial, np.real, grid, polynomial(grid)) == pytest.approx(roots)


def test_a_pole_on_the_axis_is_no_crossing_of_it() -> None:
    """Expected for (10 s + b)/(s² + ω²), hardly damped: s² + 10 k s + ω² + k b is stable for 0 < k < ω²/|b| > 10⁶.

    At ω the imaginary part changes its sign where it is all but infinite.
    """
    frequencies = np.array([1.0, 1.3, 2.2, 3.1, 4.7, 0.6])
    offsets = np.array([-1e-7, 1e-7, -2e-7, 2e-7, -3e-7, 1e-8])
    pairs = zip(frequencies.tolist(), offsets.tolist(), strict=True)
    found = loop_margins(control.append(*(control.ss(control.tf([10.0, b], [1, 1e-11, w**2])) for w, b in pairs)))
    assert of_legs(found, "gain_up") == [np.inf] * 6
    assert of_legs(found, "gain_down") == [0] * 6


def test_a_response_that_is_infinite_at_half_the_sample_rate_has_no_limit_there() -> None:
    """Expected for k/(z + 1) − d, k < 0: the closed pole −1 − g k/(1 − g d) is 1 at g = 2/(2 d − k)."""
    k, d = np.array([-1e-4, -4e-4, -2e-3]), np.array([0.25, 0.5, 0.1])
    pairs = zip(k.tolist(), d.tolist(), strict=True)
    found = loop_margins(
        control.append(*(control.ss([[-1]], [[1]], [[one]], [[-other]], 0.01) for one, other in pairs))
    )
    assert of_legs(found, "gain_up") == pytest.approx(2 / (2 * d - k), rel=1e-5)
    assert of_legs(found, "gain_down") == [0] * 3


def test_a_response_that_ends_at_zero_has_no_limit_there() -> None:
    """Expected of (3 s + 4)/(s² (τ s + 1)), along −1/ω² in the end: by Routh stable for all k > 0, as 3 > 4 τ."""
    found = loop_margins(control.append(*(control.ss(control.tf([3, 4], [tau, 1, 0, 0])) for tau in (0.5, 0.1, 0.02))))
    assert of_legs(found, "gain_up") == [np.inf] * 3
    assert of_legs(found, "gain_down") == [0] * 3


def test_one_way_couplings_do_not_count() -> None:
    """Expected: μ of a triangle is its largest element of the diagonal, however large the others are."""
    upper = np.array([[2, 40, -7], [0, -3j, 90], [0, 0, 1]], dtype=complex)
    assert scaled_norm(np.array([upper, upper.T])) == pytest.approx([3, 3], rel=0.01)

"""All numbers of `gs.margins` for uneven loops away from home, against a loop written from the documentation."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.documented_loop import DocumentedLoop, linear
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import LOOPS, MACHINE, POSE, experiment_of


class Case:
    """A loop, what `margins` says of it, and its response on a fine grid of frequencies."""

    def __init__(self, name: str) -> None:
        self.name, self.options = name, LOOPS[name]
        self.found = gs.margins(experiment_of(name))
        self.loop = linear(self.options, replace(UNEVEN, **MACHINE), POSE)
        self.omega = np.geomspace(1e-3, np.pi / self.options["sample_time"] * (1 - 1e-9), 6000)
        self.S = _sensitivity(self.loop, self.omega)

    def one_leg(self, k: int) -> tuple[Callable[[float], complex], Any]:
        """L of a leg with the others closed, 1/S_kk − 1, at a frequency, and on the grid."""
        return (
            lambda w: complex(1 / _sensitivity(self.loop, np.array([w]))[0, k, k] - 1),
            1 / self.S[:, k, k] - 1,
        )


def _sensitivity(loop: DocumentedLoop, omega: FloatArray) -> Any:
    return np.linalg.inv(np.eye(6) + loop.response(omega))


@pytest.fixture(scope="module", params=LOOPS)
def case(request: pytest.FixtureRequest) -> Case:
    return Case(request.param)


def crossings(of: Callable[[float], float], values: FloatArray, omega: FloatArray) -> FloatArray:
    after = np.flatnonzero(values[:-1] * values[1:] < 0)
    return np.array([brentq(of, omega[i], omega[i + 1], xtol=1e-12) for i in after])


def test_the_loop_transfer_is_that_of_the_documentation(case: Case) -> None:
    """Expected: every element over the whole band; differences have about eight digits."""
    omega = case.omega[1500::500]
    expected = case.loop.response(omega)
    z = np.exp(1j * omega * case.options["sample_time"])
    for k, each in enumerate(z):
        assert np.abs(case.found.loop(each) - expected[k]).max() < 1e-6 * np.abs(expected[k]).max()


def test_modes_are_those_of_the_closed_recursion(case: Case) -> None:
    """Expected: ln z / T of all eigenvalues, one of each pair, slowest first; frequency |λ|/2π, damping −Re λ/|λ|."""
    s = np.log(case.loop.poles(np.ones(6)).astype(complex)) / case.options["sample_time"]
    one_of_each = s[s.imag > -1e-6]
    expected = one_of_each[np.argsort(np.abs(one_of_each))]
    assert len(case.found.modes) == len(expected)
    found = np.array([mode.eigenvalue for mode in case.found.modes])
    for value in expected:
        nearest = case.found.modes[int(np.abs(found - value).argmin())]
        assert nearest.eigenvalue == pytest.approx(value, rel=1e-6)
        assert nearest.frequency == pytest.approx(abs(value) / (2 * np.pi), rel=1e-6)
        assert nearest.damping_ratio == pytest.approx(-value.real / abs(value), rel=1e-6)
    assert [mode.frequency for mode in case.found.modes] == sorted(mode.frequency for mode in case.found.modes)


def test_gain_margins_of_every_leg_are_where_the_closed_recursion_loses_its_stability(case: Case) -> None:
    """Expected: the largest |z| crosses 1 there, by eigenvalues; and at none of the factors in between."""

    def largest(k: int, factor: float) -> float:
        factors = np.ones(6)
        factors[k] = factor
        return float(np.abs(case.loop.poles(factors)).max())

    for k, leg in enumerate(case.found.legs):
        assert np.isfinite(leg.gain_up)
        assert largest(k, leg.gain_up * (1 - 1e-4)) < 1 < largest(k, leg.gain_up * (1 + 1e-4))
        if leg.gain_down > 0:
            assert largest(k, leg.gain_down * (1 + 1e-4)) < 1 < largest(k, leg.gain_down * (1 - 1e-4))
        between = np.geomspace(max(leg.gain_down, 1e-6) * 1.01, leg.gain_up / 1.01, 12)
        assert max(largest(k, factor) for factor in between) < 1


def test_margins_of_the_same_change_of_all_legs_are_the_edge_of_the_closed_recursion(case: Case) -> None:
    """Expected: by eigenvalues for factors on all six forces; for phase and delay, 1 + e^(−iφ) L is singular there.

    And for no smaller lag. One leg alone bears more, and what all bear independently is less.
    """
    common = case.found.common

    def largest(factor: float) -> float:
        return float(np.abs(case.loop.poles(np.full(6, factor))).max())

    assert largest(common.gain_up * (1 - 1e-4)) < 1 < largest(common.gain_up * (1 + 1e-4))
    assert common.gain_down == 0 or largest(common.gain_down * (1 + 1e-4)) < 1 < largest(common.gain_down * (1 - 1e-4))
    between = np.geomspace(max(common.gain_down, 1e-6) * 1.01, common.gain_up / 1.01, 12)
    assert max(map(largest, between)) < 1

    def edge(omega: float, angle: float) -> float:
        gap = np.eye(6) + np.exp(-1j * angle) * case.loop.response(np.array([omega]))[0]
        return float(np.linalg.svd(gap, compute_uv=False)[-1])

    def late(omega: FloatArray) -> float:
        return edge(omega[0], omega[0] * common.delay)

    critical = minimize(late, np.array([2 * np.pi * common.crossover]), method="Nelder-Mead", tol=1e-10)
    assert critical.fun < 1e-5
    lags = np.linspace(0, 0.98 * common.delay, 15)
    assert min(edge(w, w * lag) for w in case.omega[2000::80] for lag in lags) > 1e-3
    at = 2 * np.pi * common.phase_at
    assert min(edge(at, common.phase), edge(at, -common.phase)) < 1e-5
    assert common.delay < min(leg.delay for leg in case.found.legs)
    assert common.gain_up < min(leg.gain_up for leg in case.found.legs)
    assert common.phase > case.found.disk.phase


def test_margins_are_of_the_machine_and_the_believed_ones_stand_beside_them(case: Case) -> None:
    """Expected: those of an experiment whose machine is the believed platform, which has nothing to add."""
    alone = gs.margins(experiment_of(case.name, plant={}))
    assert alone.believed is None
    assert case.found.believed is not None
    assert case.found.believed.as_dict() == alone.as_dict()["margins"]
    report = case.found.report(charts=False)
    for name in ("disk", "gain", "delay", "leg.phase"):
        believed = report.number(f"margins.believed.{name}").value
        assert believed == alone.report(charts=False).number(f"margins.{name}").value
        assert believed != report.number(f"margins.{name}").value


def test_phase_delay_and_crossover_of_every_leg_are_those_of_its_own_loop(case: Case) -> None:
    """Expected: at |1/S_kk − 1| = 1, the least distance of the phase from 180°, the least lag over frequency."""
    for k, leg in enumerate(case.found.legs):
        at, values = case.one_leg(k)
        omega = crossings(lambda w, at=at: np.log(abs(at(w))), np.log(np.abs(values)), case.omega)  # type: ignore[misc]
        lag = np.mod(np.pi + np.angle([at(w) for w in omega]), 2 * np.pi)
        assert leg.crossover == pytest.approx(omega.max() / (2 * np.pi), rel=1e-6)
        assert leg.phase == pytest.approx(np.minimum(lag, 2 * np.pi - lag).min(), rel=1e-6)
        assert leg.delay == pytest.approx((lag / omega).min(), rel=1e-6)
    for name in ("gain_up", "phase", "delay", "crossover"):
        assert len({round(getattr(leg, name), 6) for leg in case.found.legs}) == 6


def test_peaks_are_the_largest_singular_values_over_frequency(case: Case) -> None:
    T = np.eye(6) - case.S
    for found, matrices in ((case.found.sensitivity_peak, case.S), (case.found.complementary_peak, T)):
        assert found == pytest.approx(np.linalg.svd(matrices, compute_uv=False)[:, 0].max(), rel=1e-4)


def scaled(M: Any) -> float:
    """Min over D of σ(D M D⁻¹), whose logarithm is convex in ln D, by SciPy's minimiser."""

    def size(logarithms: FloatArray) -> float:
        d = np.exp(np.append(0.0, logarithms))
        return float(np.log(np.linalg.norm(d[:, None] * M / d, 2)))

    return float(np.exp(minimize(size, np.zeros(5), method="BFGS").fun))


def test_the_disk_is_the_scaled_singular_value_at_its_peak(case: Case) -> None:
    """Expected: 1/α within 1 % above the minimum there, and not below it at any other frequency; ranges by formula."""
    disk = case.found.disk
    at_peak = scaled((2 * _sensitivity(case.loop, np.array([2 * np.pi * disk.frequency]))[0] - np.eye(6)) / 2)
    assert at_peak * (1 - 1e-6) <= 1 / disk.alpha <= 1.01 * at_peak
    elsewhere = [*case.omega[500::1000], *(2 * np.pi * disk.frequency * np.array([0.9, 0.98, 1.02, 1.1]))]
    for S in _sensitivity(case.loop, np.array(elsewhere)):
        assert scaled((2 * S - np.eye(6)) / 2) < 1 / disk.alpha * (1 + 1e-6)
    half = disk.alpha / 2
    assert disk.gain == pytest.approx(((1 - half) / (1 + half), (1 + half) / (1 - half)))
    assert disk.phase == pytest.approx(2 * np.arctan(half))

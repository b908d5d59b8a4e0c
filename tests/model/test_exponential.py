"""Steps with bristles. Expected: textbook friction of one mass, integrated by SciPy; orders of the scheme; refusals."""

from math import factorial
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough_stewart.model.errors import StepError
from gough_stewart.model.exponential import (
    Bristled,
    coefficients,
    exponential_step,
    integrate_bristles,
    phi_functions,
)
from gough_stewart.model.fixed_steps import fixed_step
from gough_stewart.model.friction import bristle_decay
from gough_stewart.model.vectors import FloatArray
from tests.support.one_mass import FC, FS, S0, S1, S2, VS, gripped_mass, law_of, one_mass, printed_rates

FREQUENCY = 2.0  # of the force [Hz]


def positions(system: Bristled, rows: FloatArray, tolerance: float) -> FloatArray:
    # bristles begin off zero: the scheme must return from any
    x, h, found = np.array([0.0, 0.0, 1e-17, 0.0]), 1e-6, [0.0]
    for span in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
        x, h = integrate_bristles(system, x, span, tolerance, h, lambda *_: None)
        found.append(x[0])
    return np.array(found)


def by_textbook(is_lugre: bool, amplitude: float, rows: FloatArray) -> FloatArray:
    """The equations as printed, case by case, by SciPy's Radau."""
    rates = printed_rates(is_lugre, lambda t: amplitude + amplitude * np.sin(2 * np.pi * FREQUENCY * t))
    atol: Any = [1e-15, 1e-13, 1e-15]
    span = float(rows[0]), float(rows[-1])
    # no rate depends on the position: Radau's difference for its column grows without end
    with np.errstate(over="ignore"):
        return np.asarray(solve_ivp(rates, span, [0, 0, 0], "Radau", rows, rtol=1e-10, atol=atol, max_step=2e-3).y[0])


def oscillating(amplitude: float) -> Any:
    return lambda x: amplitude + amplitude * np.sin(2 * np.pi * FREQUENCY * x[3])


@pytest.mark.parametrize(("is_lugre", "amplitude"), [(False, 0.35), (True, 0.35), (False, 0.6), (True, 0.6)])
def test_an_oscillating_force_moves_a_mass_as_the_textbook_says(is_lugre: bool, amplitude: float) -> None:
    """0.35 N ± 0.35 N stay below the elastic range of 0.8 N: no drift; LuGre creeps 3.7 µm a cycle."""
    rows = np.arange(0, 1.01, 0.5)
    found = positions(one_mass(2.0 if is_lugre else 1.0, oscillating(amplitude)), rows, 1e-9)
    expected = by_textbook(is_lugre, amplitude, rows)
    # where it breaks away, an error grows
    assert found == pytest.approx(expected, abs=5e-11 if amplitude == 0.35 else 1e-9)
    drift = found[-1] - found[1]
    if amplitude == 0.35:
        assert drift == pytest.approx(3.7e-6, abs=0.1e-6) if is_lugre else abs(drift) < 1e-11
    else:
        assert drift > 0.9e-6


@pytest.mark.evidence
@pytest.mark.parametrize("is_lugre", [False, True])
def test_after_a_hundred_cycles_lugre_has_crept_and_elasto_plastic_has_not(is_lugre: bool) -> None:
    """Expected: SciPy's Radau at 1e-10: 366 µm, and 0."""
    rows = np.arange(0, 50.01, 0.5)
    found = positions(one_mass(2.0 if is_lugre else 1.0, oscillating(0.35)), rows, 1e-11)
    drift = found[-1] - found[1]
    if is_lugre:
        expected = by_textbook(True, 0.35, rows)
        assert drift == pytest.approx(366e-6, abs=0.5e-6)
        assert drift == pytest.approx(expected[-1] - expected[1], abs=2e-10)
    else:
        assert abs(drift) <= 1e-12


@pytest.mark.evidence
@pytest.mark.parametrize("is_lugre", [False, True])
def test_a_hundred_cycles_above_breakaway_drift_as_the_textbook_says(is_lugre: bool) -> None:
    """0.6 N ± 0.6 N reach 1.2 N, between F_c and F_s. Expected: SciPy's Radau at 1e-10; asked: within 0.1 %."""
    rows = np.arange(0, 50.01, 0.5)
    found = positions(one_mass(2.0 if is_lugre else 1.0, oscillating(0.6)), rows, 1e-9)
    expected = by_textbook(is_lugre, 0.6, rows)
    assert expected[-1] - expected[1] > 9e-5
    assert found[1:] == pytest.approx(expected[1:], rel=1e-5)


def pulled(x: FloatArray) -> Any:
    """By a spring of 2 N/m whose end moves at 0.1 m/s."""
    return 2.0 * (0.1 * x[3] - x[0])


def stick_slip(states: FloatArray) -> list[float]:
    """Of states (n, 4): first slip and period [s], largest speed [m/s], largest and least force of the spring [N]."""
    v, t, force = states[:, 1], states[:, 3], pulled(states.T)
    (at,) = np.nonzero((v[:-1] < 0.1) & (v[1:] >= 0.1))
    # where the mass becomes faster than the spring's end
    slips = t[at] + (0.1 - v[at]) * (t[at + 1] - t[at]) / (v[at + 1] - v[at])
    assert len(slips) == 2
    return [float(slips[0]), float(slips[1] - slips[0]), v.max(), force.max(), force[at[0] :].min()]


def stick_slip_of_the_paper() -> tuple[FloatArray, list[float]]:
    """Canudas de Wit et al. (1995), fig. 6, case by case as printed, by SciPy's Radau at 1e-10: rows, and features."""

    def textbook(_t: float, x: FloatArray) -> list[float]:
        _, v, z, _ = x
        z_ss = (FC + (FS - FC) * np.exp(-((v / VS) ** 2))) / S0
        dz = v - abs(v) * z / z_ss
        return [v, float(pulled(x)) - S0 * z - S1 * dz - S2 * v, dz, 1.0]

    rows = np.arange(0, 15.6001, 0.02)
    atol: Any = [1e-13, 1e-13, 1e-15, 1e-9]
    solved = solve_ivp(textbook, (0, rows[-1]), [0, 0, 0, 0], "Radau", rows, rtol=1e-10, atol=atol)
    return rows, stick_slip(solved.y.T)


def test_a_mass_that_is_pulled_by_a_spring_sticks_and_slips_as_in_the_paper() -> None:
    """Period, speed and forces within 0.1 % of SciPy's. Closed form: it breaks away a little above F_s = 1.5 N."""
    rows, expected = stick_slip_of_the_paper()
    assert FS < expected[3] < 1.01 * FS
    system, x, h, found = one_mass(2.0, pulled), np.zeros(4), 1e-6, [np.zeros(4)]
    for span in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
        x, h = integrate_bristles(system, x, span, 1e-7, h, lambda *_: None)
        found.append(x)
    assert law_of(2.0).is_lugre.all()
    assert stick_slip(np.array(found)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.evidence
def test_fixed_steps_of_1_ms_stick_and_slip_as_in_the_paper() -> None:
    """As above."""
    system = gripped_mass(2.0, pulled)
    x, found = np.zeros(4), [np.zeros(4)]
    rate = system.derivatives(x)
    for k in range(15_600):
        x, rate = fixed_step(system, x, rate, 1e-3)
        if k % 20 == 19:
            found.append(x)
    assert stick_slip(np.array(found)) == pytest.approx(stick_slip_of_the_paper()[1], rel=1e-3)


def test_phi_functions_are_those_of_their_definition() -> None:
    """Expected: ∫ e^((1−s) z) s^(k−1)/(k−1)! ds over [0, 1], by Gauss's quadrature of 40 points."""
    s, w = np.polynomial.legendre.leggauss(40)
    s, w = (s + 1) / 2, w / 2
    for z in (0.0, -1e-9, -0.3, -0.999, -1.001, -7.0, -33.0):
        found = [float(each[0]) for each in phi_functions(np.array([z]))]
        expected = [float((w * np.exp((1 - s) * z) * s**k / factorial(k)).sum()) for k in range(4)]
        assert found == pytest.approx(expected, rel=3e-13), z


def test_without_decay_it_is_classical_runge_kutta() -> None:
    """Expected: RK4 written out, of a nonlinear system."""

    def f(x: FloatArray) -> FloatArray:
        return np.array([x[1], -np.sin(x[0]), x[0] * x[1]])

    x, h = np.array([0.3, 1.1, -0.4]), 0.2
    k1 = f(x)
    k2 = f(x + h / 2 * k1)
    k3 = f(x + h / 2 * k2)
    expected = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(x + h * k3))
    decay = np.zeros(1)
    assert exponential_step(f, x, decay, slice(2, 3), coefficients(decay, h)) == pytest.approx(expected, rel=1e-14)


def test_it_has_order_4_while_a_leg_slides_and_is_stable_where_explicit_steps_are_not() -> None:
    """Expected: the distance from steps eight times as short falls by 2⁴ and more."""
    system, law = one_mass(1.0, lambda x: 30 * np.cos(40 * x[3])), law_of(1.0)

    def end(n: int) -> FloatArray:
        x = np.array([0.0, 0.9, FC / S0, 0.0])
        for _ in range(n):
            decay = bristle_decay(law, x[1:2], x[2:3])
            x = exponential_step(system.derivatives, x, decay, system.at, coefficients(decay, 0.016 / n))
        return x

    # d = 9e4/s at 0.9 m/s: 2 ms are 180 of its time constants
    exact = end(256)
    gaps = [float(np.abs(end(n) - exact)[:2].max()) for n in (8, 16, 32)]
    assert gaps[0] < 1e-6
    assert min(gaps[0] / gaps[1], gaps[1] / gaps[2]) > 10


def test_what_it_cannot_resolve_is_refused() -> None:
    runaway = Bristled(lambda x: x**2 * np.array([1e9, 0]), lambda _: np.zeros(1), slice(1, 2), np.ones(2))
    with pytest.raises(StepError, match="the tolerance 1e-08 cannot be met"):
        integrate_bristles(runaway, np.array([1.0, 0.0]), (0.0, 1.0), 1e-8, None, lambda *_: None)

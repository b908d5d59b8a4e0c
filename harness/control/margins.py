"""Stability margins of a loop: of one leg, of the same change of all legs, and of independent changes of all.

L is the 6×6 loop transfer cut at the actuators, u = −L u; S = (1 + L)⁻¹, T = L S. Seiler, Packard & Gahinet (2020),
"An introduction to disk margins", IEEE Control Systems 40(5), 78–95.
"""

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from gough_stewart.harness.control.state_space import StateSpace, matrices_of
from gough_stewart.harness.control.structured import ComplexArray, bounds_of_the_largest
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.model.vectors import FloatArray

_GRID = 600
_FINE_GRID = 4000
# Largest number of states for a direct solution; beyond it, a triangular form is solved in blocks of limited size.
_FEW_STATES = 64
_FEW_FREQUENCIES = 16
_MOST_NUMBERS = 4_000_000
# Factors on the gains that are tried for an unstable loop, the nearest first.
_GAINS = tuple(2.0**k for n in range(1, 5) for k in (-n, n))
_FLAT = 0.02  # relative change of a response that has reached its limit, and its distance from the real axis
_BOUNDLESS = 1e6  # a gain margin beyond this factor counts as infinite

# A complex function of frequency: its values on the grid, and itself.
Locus = tuple[ComplexArray, Callable[[FloatArray], ComplexArray]]


@dataclass(frozen=True)
class ClassicalMargins:
    """Exact margins of one change, of a leg or the same of all legs; infinite where there is no limit."""

    gain_up: float
    """Largest factor on the gain."""
    gain_down: float
    """Smallest factor on the gain."""
    phase: float
    """Largest phase lag or lead [rad]."""
    delay: float
    """The phase margin as time, at the critical crossover [s]."""
    crossover: float
    """The highest gain crossover [Hz]; NaN if there is none."""
    phase_at: float = math.nan
    """The crossover with the smallest phase margin [Hz]."""
    gain_up_at: float = math.nan
    """Where the phase is −180° and a higher gain ends [Hz]."""
    gain_down_at: float = math.nan
    """The same for a lower gain [Hz]."""


@dataclass(frozen=True)
class DiskMargin:
    """Variations that all legs may have at the same time, independently of each other."""

    alpha: float
    """1 / max μ((S − T)/2), with the upper bound min σ(D (S − T) D⁻¹)/2 of μ, so never too large."""
    gain: tuple[float, float]
    """(1 − α/2)/(1 + α/2) to its inverse."""
    phase: float
    """2 atan(α/2) [rad]."""
    frequency: float
    """Frequency of the peak of μ [Hz]."""


@dataclass(frozen=True)
class Margins:
    """All margins of a loop."""

    legs: tuple[ClassicalMargins, ...]
    """With the loop open at each leg and closed at the others."""
    common: ClassicalMargins
    """Of the same factor, phase or delay on all legs, from the eigenvalues of L."""
    disk: DiskMargin
    """For all legs at once, independently of each other."""
    sensitivity_peak: float
    """max σ(S)"""
    complementary_peak: float
    """max σ(T)"""

    def as_dict(self) -> dict[str, Any]:
        """As plain types; None for infinite or undefined values."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def loop_margins(L: Any) -> Margins:
    """Margins of a loop transfer (6×6), in continuous or discrete time.

    Peaks and crossings are searched on a grid of frequencies that is dense near the poles, then refined.

    Raises
    ------
    ControllerError
        Not square, not finite, or an algebraic loop without a solution.
    UnstableLoopError
        The closed loop is unstable, and margins are undefined.
    """
    L = matrices_of(L)
    check_stable(L)
    coarse, fine = _frequencies(L, _GRID), _frequencies(L, _FINE_GRID)
    on_grid = sensitivities(L, coarse)
    everything = response(L, fine)

    def leg(k: int) -> Locus:
        return one_leg_open(everything, k), lambda omega: one_leg_open(response(L, omega), k)

    return Margins(
        tuple(_classical_margins(L, fine, [leg(k)]) for k in range(L.noutputs)),
        _classical_margins(L, fine, _eigenvalue_loci(L, fine, everything)),
        _disk_margin(L, coarse, on_grid),
        _peak(lambda S, _T: np.linalg.norm(S, 2, axis=(1, 2)), L, coarse, on_grid)[0],
        _peak(lambda _S, T: np.linalg.norm(T, 2, axis=(1, 2)), L, coarse, on_grid)[0],
    )


def disk_margin(L: Any) -> DiskMargin:
    """The disk margin of a loop transfer that is known to be stable when closed, at a fraction of the cost of all."""
    L = matrices_of(L)
    coarse = _frequencies(L, _GRID)
    return _disk_margin(L, coarse, sensitivities(L, coarse))


def _disk_margin(L: StateSpace, grid: FloatArray, on_grid: tuple[ComplexArray, ComplexArray]) -> DiskMargin:
    disk_peak, at = _peak(lambda S, T: bounds_of_the_largest((S - T) / 2), L, grid, on_grid)
    alpha = 1 / disk_peak
    half = alpha / 2
    gain = ((1 - half) / (1 + half), (1 + half) / (1 - half)) if half < 1 - 1e-9 else (0.0, math.inf)
    return DiskMargin(alpha, gain, 2 * math.atan(half), at / (2 * math.pi))


def closed_loop(L: Any) -> StateSpace:
    """T = L (1 + L)⁻¹ as a state space: with E = (1 + D)⁻¹, ẋ = (A − B E C) x + B E u and y = E C x + D E u.

    Raises
    ------
    ControllerError
        Not square, not finite, or an algebraic loop without a solution.
    """
    L = matrices_of(L)
    if L.ninputs != L.noutputs:
        raise ControllerError(f"the loop transfer is {L.noutputs}×{L.ninputs}; expected as many outputs as inputs")
    if not all(np.isfinite(block).all() for block in (L.A, L.B, L.C, L.D)):
        raise ControllerError("the loop transfer is not finite; expected finite numbers")
    one = np.eye(L.noutputs)
    if not np.linalg.cond(one + L.D) < 1 / np.finfo(float).eps:
        raise ControllerError("1 + L is singular at infinite frequency; expected a delay or a lag in the loop")
    E = np.linalg.inv(one + L.D)
    return StateSpace(L.A - L.B @ E @ L.C, L.B @ E, E @ L.C, L.D @ E, L.dt)


def check_stable(L: Any) -> None:
    """Refuse a loop that is unstable when closed.

    Raises
    ------
    ControllerError
        As `closed_loop`.
    UnstableLoopError
        Names the worst eigenvalue.
    """
    L = matrices_of(L)
    worst, badness = _worst_pole(closed_loop(L))
    if badness < 0:
        return
    if L.isdtime():
        where = f"|z| = {abs(worst):.6g} at {frequency_of(worst, L.dt):.3g} Hz, expected below 1"
    else:
        where = f"{worst:.6g} 1/s at {abs(worst) / (2 * math.pi):.3g} Hz, expected left of 0"
    raise UnstableLoopError(
        f"the closed loop is unstable (worst eigenvalue {where}), so there are no margins; {remedy_of(L)}", worst
    )


def is_stable(L: Any) -> bool:
    """Whether the closed loop is stable."""
    return _worst_pole(closed_loop(L))[1] < 0


def frequency_of(eigenvalue: complex, sample_time: float) -> float:
    """Frequency [Hz] of an eigenvalue z in discrete time, |ln z| / (2π T); 0 for the z = 0 of a pure delay."""
    return abs(cmath.log(eigenvalue)) / sample_time / (2 * math.pi) if eigenvalue else 0.0


def _worst_pole(loop: StateSpace) -> tuple[complex, float]:
    """The eigenvalue nearest to or farthest beyond the stability limit, and by how much: |z| − 1, or Re s [1/s]."""
    poles = loop.poles()
    if not poles.size:
        return 0j, -math.inf
    badness = np.abs(poles) - 1 if loop.isdtime() else poles.real
    worst = int(badness.argmax())
    return complex(poles[worst]), float(badness[worst])


def remedy_of(L: Any) -> str:
    """Gains that would make a loop stable: the nearest power of two."""
    L = matrices_of(L)
    for factor in _GAINS:
        if is_stable(replace(L, C=factor * L.C, D=factor * L.D)):
            way = "lower" if factor < 1 else "higher"
            return f"it is stable with all gains × {factor:g}: choose a {way} bandwidth"
    return f"no gains from × {min(_GAINS):g} to × {max(_GAINS):g} make it stable"


def response(L: Any, omega: FloatArray) -> ComplexArray:
    """L (n, 6, 6) at frequencies (n,) [rad/s]: C (s − A)⁻¹ B + D at s = iω, or at z = e^(iωT)."""
    L = matrices_of(L)
    s = np.exp(1j * omega * L.dt) if L.isdtime() else 1j * omega
    if L.nstates <= _FEW_STATES:
        resolvent = s[:, None, None] * np.eye(L.nstates) - L.A
        return np.asarray(L.C @ np.linalg.solve(resolvent, L.B.astype(complex)[None]) + L.D)
    # delays add many states: a triangular system is solved row by row from below, for all frequencies at once
    T, B, C = _triangular(L)
    parts = np.array_split(s, math.ceil(len(s) * L.nstates * L.ninputs / _MOST_NUMBERS))
    return np.concatenate([C @ _solved(T, B, part) + L.D for part in parts])


@lru_cache(maxsize=2)
def _triangular(L: StateSpace) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """T, Qᴴ B and C Q with A = Q T Qᴴ, T upper triangular (Schur)."""
    from scipy.linalg import schur

    T, Q = schur(np.asarray(L.A, dtype=complex), output="complex")
    return T, Q.conj().T @ L.B, L.C @ Q


def _solved(T: ComplexArray, B: ComplexArray, s: ComplexArray) -> ComplexArray:
    """(s − T)⁻¹ B (len(s), n, m) for an upper triangle T: (s − T_ii) x_i = b_i + ∑_{j>i} T_ij x_j."""
    from scipy.linalg import solve_triangular

    n, m = B.shape
    if len(s) < _FEW_FREQUENCIES:
        return np.array([solve_triangular(each * np.eye(n) - T, B, check_finite=False) for each in s])
    x = np.empty((n, len(s) * m), dtype=complex)
    at = np.repeat(s, m)
    for i in reversed(range(n)):
        x[i] = (np.tile(B[i], len(s)) + T[i, i + 1 :] @ x[i + 1 :]) / (at - T[i, i])
    return np.moveaxis(x.reshape(n, len(s), m), 0, 1)


def one_leg_open(response_of_all: ComplexArray, k: int) -> ComplexArray:
    """The loop transfer at leg k (0-based) with the other legs closed (n,).

    L_kk − L_ko (1 + L_oo)⁻¹ L_ok with o the other legs, whose forces are u_o = −(1 + L_oo)⁻¹ L_ok u_k.
    """
    R, others = response_of_all, [leg for leg in range(response_of_all.shape[-1]) if leg != k]
    L_oo, L_ok, L_ko = R[:, others][:, :, others], R[:, others, k], R[:, k, others]
    answer = np.linalg.solve(np.eye(len(others)) + L_oo, L_ok[..., None])[..., 0]
    return np.asarray(R[:, k, k] - (L_ko * answer).sum(axis=1))


def frequency_range(L: Any) -> tuple[float, float]:
    """The range of frequencies that matters [rad/s]: about the poles, and up to half the sample rate."""
    L = matrices_of(L)
    sizes = np.abs(_poles(L))
    sizes = sizes[sizes > 1e-6]
    slowest, fastest = (float(sizes.min()), float(sizes.max())) if sizes.size else (1.0, 1.0)
    top = math.pi / L.dt if L.isdtime() else 100 * fastest
    return min(slowest / 1000, top / 10), top


def sensitivities(L: Any, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """S and T (n, 6, 6) at frequencies [rad/s]."""
    L = matrices_of(L)
    one = np.eye(L.noutputs)
    S = np.asarray(np.linalg.inv(one + response(L, omega)), dtype=complex)
    return S, np.asarray(one - S)


def _eigenvalue_loci(L: StateSpace, omega: FloatArray, on_grid: ComplexArray) -> list[Locus]:
    """The eigenvalues λ of L over frequency: det(1 + c L) = 0 for a common factor c where 1 + c λ = 0.

    Each goes on, from one frequency of the grid to the next, as the set of eigenvalues that is nearest.
    """
    from scipy.optimize import linear_sum_assignment

    values = np.linalg.eigvals(on_grid)
    for before, after in pairwise(values):
        after[:] = after[linear_sum_assignment(np.abs(before[:, None] - after))[1]]

    def locus(k: int) -> Locus:
        def at(frequencies: FloatArray) -> ComplexArray:
            between = np.interp(frequencies, omega, values[:, k])
            eigenvalues = np.linalg.eigvals(response(L, frequencies))
            nearest = np.abs(eigenvalues - between[:, None]).argmin(axis=1)
            return np.asarray(eigenvalues[np.arange(len(nearest)), nearest])

        return np.asarray(values[:, k]), at

    return [locus(k) for k in range(L.noutputs)]


def _classical_margins(L: StateSpace, omega: FloatArray, loci: Sequence[Locus]) -> ClassicalMargins:
    """Where the factors c of 1 + c λ = 0 are real, or of magnitude 1, for the nearest of some loci λ."""
    # from the frequency response, since polynomials of this order have no correct digits
    real_at, real, crossed_at, crossed = [], [], [], []
    for values, at in loci:
        turns = _crossings(at, np.imag, omega, values)
        on_axis = at(turns)
        is_real = np.abs(on_axis.imag) < _FLAT * np.abs(on_axis.real)
        ends, end_values = _limits(at, L, omega)
        crossing = _crossings(at, lambda value: np.log(np.abs(value)), omega, values)
        real_at += [turns[is_real], ends]
        real += [on_axis[is_real].real, end_values.real]
        crossed_at.append(crossing)
        crossed.append(at(crossing))
    turns, crossings = np.concatenate(real_at), np.concatenate(crossed_at)
    on_axis = np.concatenate(real)
    with np.errstate(divide="ignore"):
        gains = np.where(on_axis < 0, 1 / np.abs(on_axis), 1.0)
    gains[(gains <= 1 / _BOUNDLESS) | (gains >= _BOUNDLESS)] = 1.0
    above, below = np.where(gains > 1, gains, math.inf), np.where(gains < 1, gains, 0.0)
    # delay only adds lag: a lead of φ is a lag of 2π − φ
    lags = np.mod(np.angle(-np.concatenate(crossed)), 2 * math.pi)
    phases = np.minimum(lags, 2 * math.pi - lags)
    up, down = float(above.min(initial=math.inf)), float(below.max(initial=0.0))
    return ClassicalMargins(
        up,
        down,
        float(phases.min(initial=math.inf)),
        float((lags / crossings).min(initial=math.inf)),
        float(crossings.max() / (2 * math.pi)) if crossings.size else math.nan,
        float(crossings[phases.argmin()] / (2 * math.pi)) if crossings.size else math.nan,
        float(turns[above.argmin()] / (2 * math.pi)) if math.isfinite(up) else math.nan,
        float(turns[below.argmax()] / (2 * math.pi)) if down > 0 else math.nan,
    )


def _limits(at: Callable[[FloatArray], ComplexArray], L: Any, omega: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Frequency 0 and the highest, where the response there has converged to the real axis, and the response.

    It may end on the negative real axis there, a stability limit without a change of sign. A response that tends to
    infinity or zero along the axis does not converge.
    """
    low, high = omega[0], omega[-1]
    beyond = high if L.isdtime() else 10 * high
    near, far = at(np.array([low, high])), at(np.array([low / 10, beyond]))
    size = np.abs(near)
    kept = (np.abs(far - near) <= _FLAT * size) & (np.abs(near.imag) < _FLAT * size)
    return np.array([low, high])[kept], near[kept]


def _crossings(
    at: Callable[[FloatArray], ComplexArray],
    part: Callable[[ComplexArray], FloatArray],
    omega: FloatArray,
    values: ComplexArray,
) -> FloatArray:
    """Frequencies [rad/s] at which a part of a function, with these values on the grid, changes its sign."""
    from scipy.optimize import brentq

    after = np.nonzero(np.diff(np.sign(part(values))))[0]
    return np.array([brentq(lambda w: float(part(at(np.array([w])))[0]), omega[i], omega[i + 1]) for i in after])


def _poles(L: StateSpace) -> ComplexArray:
    """Open- and closed-loop poles in continuous time [1/s], without those of pure delays."""
    poles = np.concatenate([each.poles() for each in (L, closed_loop(L))])
    if L.isdtime():
        poles = np.log(poles[np.abs(poles) > 1e-9]) / L.dt
    return poles


def _frequencies(L: Any, n: int) -> FloatArray:
    """Grid [rad/s] over `frequency_range`, dense where a lightly damped pole makes a narrow peak."""
    low, high = frequency_range(L)
    high *= 1 - 1e-9
    poles = _poles(L)
    about = (np.abs(poles.imag)[:, None] + poles.real[:, None] * np.linspace(-3, 3, 13)).ravel()
    return np.unique(np.concatenate([np.geomspace(low, high, n), about[(about > low) & (about < high)]]))


def _peak(
    of: Callable[[ComplexArray, ComplexArray], FloatArray],
    L: Any,
    grid: FloatArray,
    on_grid: tuple[ComplexArray, ComplexArray],
) -> tuple[float, float]:
    """Largest value over frequency of a function of S and T, and its frequency [rad/s]."""
    from scipy.optimize import minimize_scalar

    def size(omega: FloatArray) -> FloatArray:
        return of(*sensitivities(L, omega))

    values = of(*on_grid)
    best = int(values.argmax())
    bracket = (math.log(grid[max(best - 1, 0)]), math.log(grid[min(best + 1, len(grid) - 1)]))
    found = minimize_scalar(
        lambda x: -float(size(np.array([math.exp(x)]))[0]), bounds=bracket, method="bounded", options={"xatol": 1e-9}
    )
    if -found.fun > values[best]:
        return float(-found.fun), math.exp(found.x)
    return float(values[best]), float(grid[best])


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value if math.isfinite(value) else None

"""Stability margins of a loop: of one leg, of the same change of all legs, and of independent changes of all.

L is the 6×6 loop transfer cut at the actuators, u = −L u; S = (1 + L)⁻¹, T = L S. Seiler, Packard & Gahinet (2020),
"An introduction to disk margins", IEEE Control Systems 40(5), 78–95.
"""

import cmath
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.state_space import StateSpace
from gough_stewart.harness.errors import ControllerError, UnstableLoopError
from gough_stewart.harness.section import plain
from gough_stewart.model.vectors import FloatArray

_GRID = 600
_FINE_GRID = 4000
# Frequencies that are solved one by one; more are solved together, in blocks of limited size.
_FEW_FREQUENCIES = 16
_MOST_NUMBERS = 4_000_000
# Factors on the gains that are tried for an unstable loop, the nearest first.
_GAINS = tuple(2.0**k for n in range(1, 5) for k in (-n, n))
_FLAT = 0.02  # relative change of a response that has reached its limit, and its distance from the real axis
_ROUNDING = 1e-12  # relative change of a response by rounding errors
_BOUNDLESS = 1e6  # a gain margin beyond this factor counts as infinite
# Of scaled norms: balancing iterations, descent steps, the largest ln D, and how many matrices are lowered together.
_BALANCES, _DESCENTS, _WIDEST, _AT_ONCE = 5, 40, 30.0, 16

ComplexArray = NDArray[np.complex128]
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
        return dict(plain(asdict(self)))


def loop_margins(L: StateSpace) -> Margins:
    """Margins of a loop transfer (6×6), in continuous or discrete time; an unstable loop has none, which is an error.

    Peaks and crossings are searched on a grid of frequencies that is dense near the poles, then refined.
    """
    worst, badness = _worst_pole(closed_loop(L))
    if badness >= 0:
        if L.isdtime():
            where = f"|z| = {abs(worst):.6g} at {frequency_of(worst, L.dt):.3g} Hz, expected below 1"
        else:
            where = f"{worst:.6g} 1/s at {abs(worst) / (2 * math.pi):.3g} Hz, expected left of 0"
        raise UnstableLoopError(
            f"the closed loop is unstable (worst eigenvalue {where}), so there are no margins; {remedy_of(L)}", worst
        )
    coarse, fine = _frequencies(L, _GRID), _frequencies(L, _FINE_GRID)
    on_grid = sensitivities(L, coarse)
    response_on_grid = response(L, fine)

    def leg(k: int) -> Locus:
        return one_leg_open(response_on_grid, k), lambda omega: one_leg_open(response(L, omega), k)

    return Margins(
        tuple(_classical_margins(L, fine, [leg(k)]) for k in range(len(L.D))),
        _classical_margins(L, fine, _eigenvalue_loci(L, fine, response_on_grid)),
        disk_margin(L, coarse, on_grid),
        _peak(lambda S, _T: np.linalg.norm(S, 2, axis=(1, 2)), L, coarse, on_grid)[0],
        _peak(lambda _S, T: np.linalg.norm(T, 2, axis=(1, 2)), L, coarse, on_grid)[0],
    )


def disk_margin(
    L: StateSpace, grid: FloatArray | None = None, on_grid: tuple[ComplexArray, ComplexArray] | None = None
) -> DiskMargin:
    """The disk margin of a loop that is known to be stable when closed; S and T on a grid of frequencies if known."""
    grid = _frequencies(L, _GRID) if grid is None else grid
    on_grid = sensitivities(L, grid) if on_grid is None else on_grid
    disk_peak, at = _peak(lambda S, T: bounds_of_the_largest((S - T) / 2), L, grid, on_grid)
    alpha = 1 / disk_peak
    half = alpha / 2
    gain = ((1 - half) / (1 + half), (1 + half) / (1 - half)) if half < 1 - 1e-9 else (0.0, math.inf)
    return DiskMargin(alpha, gain, 2 * math.atan(half), at / (2 * math.pi))


def closed_loop(L: StateSpace) -> StateSpace:
    """T = L (1 + L)⁻¹ as a state space: with E = (1 + D)⁻¹, ẋ = (A − B E C) x + B E u and y = E C x + D E u."""
    n_outputs, n_inputs = L.D.shape
    if n_inputs != n_outputs:
        raise ControllerError(f"the loop transfer is {n_outputs}×{n_inputs}; expected as many outputs as inputs")
    if not all(np.isfinite(block).all() for block in L.blocks):
        raise ControllerError("the loop transfer is not finite; expected finite numbers")
    identity = np.eye(n_outputs)
    if not np.linalg.cond(identity + L.D) < 1 / np.finfo(float).eps:
        raise ControllerError("1 + L is singular at infinite frequency; expected a delay or a lag in the loop")
    E = np.linalg.inv(identity + L.D)
    return StateSpace(L.A - L.B @ E @ L.C, L.B @ E, E @ L.C, L.D @ E, L.dt)


def is_stable(L: StateSpace) -> bool:
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


def remedy_of(L: StateSpace) -> str:
    """Gains that would make a loop stable: the nearest power of two."""
    for factor in _GAINS:
        if is_stable(replace(L, C=factor * L.C, D=factor * L.D)):
            return f"it is stable with all gains × {factor:g}: choose a {'lower' if factor < 1 else 'higher'} bandwidth"
    return f"no gains from × {min(_GAINS):g} to × {max(_GAINS):g} make it stable"


def response(L: StateSpace, omega: FloatArray) -> ComplexArray:
    """L (n, 6, 6) at frequencies (n,) [rad/s]: C (s − A)⁻¹ B + D at s = iω, or at z = e^(iωT)."""
    s = np.exp(1j * omega * L.dt) if L.isdtime() else 1j * omega
    # with A = Q T Qᴴ, T an upper triangle, (s − T_ii) x_i = b_i + ∑_{j>i} T_ij x_j is solved row by row from below, for
    # many frequencies at once
    from scipy.linalg import solve_triangular

    T, B, C = _triangular(L)
    (n, m), answers = B.shape, list[ComplexArray]()
    for part in np.array_split(s, math.ceil(max(1, len(s) * n * m) / _MOST_NUMBERS)):
        if len(part) < _FEW_FREQUENCIES:
            solutions = [solve_triangular(point * np.eye(n) - T, B, check_finite=False) for point in part]
            x = np.reshape(solutions, (len(part), n, m))
        else:
            flat, at = np.empty((n, len(part) * m), dtype=complex), np.repeat(part, m)
            for i in reversed(range(n)):
                flat[i] = (np.tile(B[i], len(part)) + T[i, i + 1 :] @ flat[i + 1 :]) / (at - T[i, i])
            x = np.moveaxis(flat.reshape(n, len(part), m), 0, 1)
        answers.append(C @ x + L.D)
    return np.concatenate(answers)


@lru_cache(maxsize=2)
def _triangular(L: StateSpace) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """T, Qᴴ B and C Q with A = Q T Qᴴ, T upper triangular (Schur), in units of the states that balance A."""
    from scipy.linalg import matrix_balance, schur

    A, (units, _) = matrix_balance(L.A, permute=False, separate=True)
    T, Q = schur(A.astype(complex), output="complex")
    return T, Q.conj().T @ (L.B / units[:, None]), (L.C * units) @ Q


def one_leg_open(R: ComplexArray, k: int) -> ComplexArray:
    """The loop transfer at leg k (0-based) with the other legs closed (n,), from that of all legs (n, 6, 6).

    L_kk − L_ko (1 + L_oo)⁻¹ L_ok with o the other legs, whose forces are u_o = −(1 + L_oo)⁻¹ L_ok u_k.
    """
    closed = [leg for leg in range(R.shape[-1]) if leg != k]
    L_oo, L_ok, L_ko = R[:, closed][:, :, closed], R[:, closed, k], R[:, k, closed]
    answer = np.linalg.solve(np.eye(len(closed)) + L_oo, L_ok[..., None])[..., 0]
    return np.asarray(R[:, k, k] - (L_ko * answer).sum(axis=1))


def frequency_range(L: StateSpace) -> tuple[float, float]:
    """The range of frequencies that matters [rad/s]: about the poles, and up to half the sample rate."""
    sizes = np.abs(_poles(L))
    sizes = sizes[sizes > 1e-6]
    slowest, fastest = (float(sizes.min()), float(sizes.max())) if sizes.size else (1.0, 1.0)
    top = math.pi / L.dt if L.isdtime() else 100 * fastest
    return min(slowest / 1000, top / 10), top


def sensitivities(L: StateSpace, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """S and T (n, 6, 6) at frequencies [rad/s]."""
    identity = np.eye(len(L.D))
    S = np.asarray(np.linalg.inv(identity + response(L, omega)), dtype=complex)
    return S, np.asarray(identity - S)


def _eigenvalue_loci(L: StateSpace, omega: FloatArray, on_grid: ComplexArray) -> list[Locus]:
    """The eigenvalues λ of L over frequency: det(1 + c L) = 0 for a common factor c where 1 + c λ = 0.

    Each goes on, from one frequency of the grid to the next, as the set of eigenvalues that is nearest.
    """
    from scipy.optimize import linear_sum_assignment

    values = np.linalg.eigvals(on_grid)
    for before, after in pairwise(values):
        after[:] = after[linear_sum_assignment(np.abs(before[:, None] - after))[1]]

    def at(k: int, frequencies: FloatArray) -> ComplexArray:
        between = np.interp(frequencies, omega, values[:, k])
        eigenvalues = np.linalg.eigvals(response(L, frequencies))
        nearest = np.abs(eigenvalues - between[:, None]).argmin(axis=1)
        return np.asarray(eigenvalues[np.arange(len(nearest)), nearest])

    return [(np.asarray(values[:, k]), partial(at, k)) for k in range(len(L.D))]


def _classical_margins(L: StateSpace, omega: FloatArray, loci: Sequence[Locus]) -> ClassicalMargins:
    """Where the factors c of 1 + c λ = 0 are real, or of magnitude 1, for the nearest of some loci λ."""
    # from the frequency response, since polynomials of this order have no correct digits
    real_at, real, crossed_at, crossed = [], [], [], []
    edges = np.array([omega[0], omega[-1]])
    beyond = np.array([omega[0] / 10, omega[-1] * (1 if L.isdtime() else 10)])
    for values, at in loci:
        turns = _crossings(at, np.imag, omega, values)
        on_axis = at(turns)
        is_real = np.abs(on_axis.imag) < _FLAT * np.abs(on_axis.real)
        # at frequency 0 and the highest the response may have converged to the negative real axis, a stability limit
        # without a change of sign; what tends to infinity or zero along the axis does not converge
        near = at(edges)
        size = np.abs(near)
        is_limit = (np.abs(at(beyond) - near) <= _FLAT * size) & (np.abs(near.imag) < _FLAT * size)
        with np.errstate(divide="ignore"):  # a loop may be 0 to rounding
            crossing = _crossings(at, lambda value: np.log(np.abs(value)), omega, values)
        real_at += [turns[is_real], edges[is_limit]]
        real += [on_axis[is_real].real, near[is_limit].real]
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


def _crossings(
    at: Callable[[FloatArray], ComplexArray],
    part: Callable[[ComplexArray], FloatArray],
    omega: FloatArray,
    values: ComplexArray,
) -> FloatArray:
    """Frequencies [rad/s] at which a part of a function, with these values on the grid, changes its sign."""
    from scipy.optimize import brentq

    crossings, size = [], np.abs(values)
    # what is 0 to rounding changes its sign everywhere, and limits nothing
    seen = np.maximum(size[:-1], size[1:]) > 1 / _BOUNDLESS
    on_grid = part(values)
    is_rounding = np.abs(on_grid) < _ROUNDING * size
    for i in np.nonzero(np.diff(np.sign(on_grid)) * seen)[0]:
        if is_rounding[i] and is_rounding[i + 1]:
            crossings.append(omega[i])
            continue
        at_ends = part(at(omega[i : i + 2]))
        if at_ends[0] * at_ends[1] < 0:
            crossings.append(brentq(lambda w: float(part(at(np.array([w])))[0]), omega[i], omega[i + 1]))
        else:  # the sign of one of them is that of rounding, which differs from that on the whole grid
            crossings.append(omega[i + int(np.abs(at_ends).argmin())])
    return np.array(crossings)


def _poles(L: StateSpace) -> ComplexArray:
    """Open- and closed-loop poles in continuous time [1/s], without those of pure delays."""
    poles = np.concatenate([L.poles(), closed_loop(L).poles()])
    return np.log(poles[np.abs(poles) > 1e-9]) / L.dt if L.isdtime() else poles


def _frequencies(L: StateSpace, n: int) -> FloatArray:
    """Grid [rad/s] over `frequency_range`, dense where a lightly damped pole makes a narrow peak."""
    low, high = frequency_range(L)
    high *= 1 - 1e-9
    poles = _poles(L)
    about = (np.abs(poles.imag)[:, None] + poles.real[:, None] * np.linspace(-3, 3, 13)).ravel()
    return np.unique(np.concatenate([np.geomspace(low, high, n), about[(about > low) & (about < high)]]))


def _peak(
    size: Callable[[ComplexArray, ComplexArray], FloatArray],
    L: StateSpace,
    grid: FloatArray,
    on_grid: tuple[ComplexArray, ComplexArray],
) -> tuple[float, float]:
    """Largest value over frequency of a function of S and T, and its frequency [rad/s]."""
    from scipy.optimize import minimize_scalar

    values = size(*on_grid)
    best = int(values.argmax())
    bracket = (math.log(grid[max(best - 1, 0)]), math.log(grid[min(best + 1, len(grid) - 1)]))
    peak = minimize_scalar(
        lambda logarithm: -float(size(*sensitivities(L, np.array([math.exp(logarithm)])))[0]),
        bounds=bracket,
        method="bounded",
        options={"xatol": 1e-9},
    )
    if -peak.fun > values[best]:
        return float(-peak.fun), math.exp(peak.x)
    return float(values[best]), float(grid[best])


def scaled_norm(M: ComplexArray, scales: FloatArray | None = None) -> FloatArray:
    """Upper bound min over D of σ(D M D⁻¹), D > 0 diagonal, of the structured singular value μ of (n, m, m), each (n,).

    For one complex uncertainty per channel: exact for m ≤ 3, rarely a few percent above μ for larger m (Packard & Doyle
    1993, "The complex structured singular value", Automatica 29(1), 71–109). ln σ is convex in ln D; the result is less
    than 1 % above the minimum, and never below it. The search begins at these ln D (n, m), by default of `_balance`.
    """
    scales = _balance(M) if scales is None else scales
    candidate, slope, best, step = scales, np.zeros(scales.shape), np.full(len(M), np.inf), np.full(len(M), 0.5)
    for _ in range(_DESCENTS):
        U, sizes, Vh = np.linalg.svd(_scaled(M, candidate))
        lower = sizes[:, 0] < best
        best = np.where(lower, sizes[:, 0], best)
        scales = np.where(lower[:, None], candidate, scales)
        # ∂ ln σ / ∂ ln D_i = |u_i|² − |v_i|²
        slope = np.where(lower[:, None], np.abs(U[:, :, 0]) ** 2 - np.abs(Vh[:, 0, :]) ** 2, slope)
        step = np.where(lower, 1.2 * step, 0.5 * step)
        # where a channel is decoupled, the best scaling is infinite
        candidate = np.clip(scales - step[:, None] * slope, -_WIDEST, _WIDEST)
    return best


def bounds_of_the_largest(M: ComplexArray) -> FloatArray:
    """Upper bounds of μ of (n, m, m), each (n,), of which the largest is that of `scaled_norm`.

    Others are lowered only until they are below it, in the order of their bounds after balancing.
    """
    balanced = _balance(M)
    bounds: FloatArray = np.linalg.norm(_scaled(M, balanced), 2, axis=(1, 2))
    largest = -np.inf
    for batch in np.array_split(np.argsort(-bounds), math.ceil(len(M) / _AT_ONCE)):
        if bounds[batch[0]] <= largest:
            break
        bounds[batch] = scaled_norm(M[batch], balanced[batch])
        largest = max(largest, float(bounds[batch].max()))
    return bounds


def _balance(M: ComplexArray) -> FloatArray:
    """Scales ln D (n, m) that give row i and column i of D M D⁻¹ about equal norms (Osborne 1960)."""
    squares, scales = np.abs(M) ** 2, np.zeros(M.shape[:2])
    for _ in range(_BALANCES):
        for i in range(M.shape[-1]):
            # the weight is 0 on the diagonal, which scaling does not change
            weight = np.exp(2 * (scales[:, i : i + 1] - scales))
            weight[:, i] = 0.0
            row = (squares[:, i, :] * weight).sum(axis=1)
            column = (squares[:, :, i] / np.where(weight > 0, weight, np.inf)).sum(axis=1)
            coupled = (row > 0) & (column > 0)
            scales[:, i] -= 0.25 * np.log(np.where(coupled, row, 1.0) / np.where(coupled, column, 1.0))
    return scales


def _scaled(M: ComplexArray, scales: FloatArray) -> ComplexArray:
    return np.asarray(M * np.exp(scales[:, :, None] - scales[:, None, :]))

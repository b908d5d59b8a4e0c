"""How far a loop is from instability: margins per leg, and of all legs at once.

L is the 6×6 loop transfer cut at the actuators, u = −L u; S = (1 + L)⁻¹, T = L S. Seiler, Packard & Gahinet (2020),
"An introduction to disk margins", IEEE Control Systems 40(5), 78–95.
"""

import math
from dataclasses import asdict, dataclass
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from gough_stewart.harness.errors import UnstableLoopError
from gough_stewart.model.vectors import FloatArray

ComplexArray = NDArray[np.complex128]

_GRID = 600
_FINE_GRID = 4000
_REAL = 0.02  # imaginary over real part of a response that has come to the real axis


@dataclass(frozen=True)
class LegMargins:
    """Margins with the loop cut at one leg and closed at the others; infinite where nothing is to be feared."""

    gain_up: float  # factor by which the leg's gain may grow
    gain_down: float  # factor to which it may sink
    phase: float  # [rad], by which the leg may lag
    delay: float  # [s], the same as time at the crossover that allows least
    crossover: float  # of the gain, the fastest [Hz]; NaN if there is none


@dataclass(frozen=True)
class DiskMargin:
    """What all legs may change by at the same time, each in its own way."""

    alpha: float  # 1 / max σ((S − T)/2)
    gain: tuple[float, float]  # (1 − α/2)/(1 + α/2) to its inverse
    phase: float  # 2 atan(α/2) [rad]
    frequency: float  # where σ peaks [Hz]


@dataclass(frozen=True)
class Margins:
    """All margins of a loop."""

    legs: tuple[LegMargins, ...]
    disk: DiskMargin
    sensitivity_peak: float  # max σ(S)
    complementary_peak: float  # max σ(T)

    def as_dict(self) -> dict[str, Any]:
        """In plain types; None for what is infinite or undefined."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def loop_margins(L: Any) -> Margins:
    """Margins of a loop transfer (6×6), in continuous or discrete time.

    Raises
    ------
    UnstableLoopError
        The closed loop is unstable, so that it has no margins.
    """
    L = control.ss(L)
    check_stable(L)
    low, high = frequency_range(L)
    disk_peak, at = _peak(lambda S, T: (S - T) / 2, L, low, high)
    omega = np.geomspace(low, high * (1 - 1e-9), _FINE_GRID)
    everything = response(L, omega)
    alpha = 1 / disk_peak
    half = alpha / 2
    gain = ((1 - half) / (1 + half), (1 + half) / (1 - half)) if half < 1 else (0.0, math.inf)
    return Margins(
        tuple(_leg_margins(one_leg_open(everything, k), omega) for k in range(L.noutputs)),
        DiskMargin(alpha, gain, 2 * math.atan(half), at / (2 * math.pi)),
        _peak(lambda S, _T: S, L, low, high)[0],
        _peak(lambda _S, T: T, L, low, high)[0],
    )


def closed_loop(L: Any) -> control.StateSpace:
    """T = L (1 + L)⁻¹ as a state space."""
    L = control.ss(L)
    return control.feedback(L, control.ss([], [], [], np.eye(L.noutputs), L.dt))


def check_stable(L: Any) -> None:
    """Refuse a loop that is unstable when it is closed.

    Raises
    ------
    UnstableLoopError
        Names the worst eigenvalue.
    """
    closed = closed_loop(L)
    poles = np.asarray(closed.poles(), dtype=complex)
    discrete = closed.isdtime(strict=True)
    badness = np.abs(poles) - 1 if discrete else poles.real
    if badness.size and not badness.max() < 0:
        worst = complex(poles[int(badness.argmax())])
        where = f"|z| = {abs(worst):.6g}, expected below 1" if discrete else f"{worst:.6g} 1/s, expected left of 0"
        raise UnstableLoopError(
            f"the closed loop is unstable (worst eigenvalue {where}), so there are no margins; lower bandwidth or "
            "sample time, or add damping",
            worst,
        )


def response(L: Any, omega: FloatArray) -> ComplexArray:
    """L (n, 6, 6) at frequencies (n,) [rad/s]: C (s − A)⁻¹ B + D at s = iω, or at z = e^(iωT)."""
    s = np.exp(1j * omega * L.dt) if L.isdtime(strict=True) else 1j * omega
    resolvent = s[:, None, None] * np.eye(L.nstates) - L.A
    return np.asarray(L.C @ np.linalg.solve(resolvent, L.B.astype(complex)[None]) + L.D)


def one_leg_open(response_of_all: ComplexArray, k: int) -> ComplexArray:
    """What leg k (0-based) sees when the other legs are closed (n,).

    L_kk − L_ko (1 + L_oo)⁻¹ L_ok with o the other legs: they answer with u_o = −(1 + L_oo)⁻¹ L_ok u_k.
    """
    R, others = response_of_all, [leg for leg in range(response_of_all.shape[-1]) if leg != k]
    L_oo, L_ok, L_ko = R[:, others][:, :, others], R[:, others, k], R[:, k, others]
    answer = np.linalg.solve(np.eye(len(others)) + L_oo, L_ok[..., None])[..., 0]
    return np.asarray(R[:, k, k] - (L_ko * answer).sum(axis=1))


def frequency_range(L: Any) -> tuple[float, float]:
    """Where a loop has something to say [rad/s]: about its poles, and up to half the sample rate."""
    closed, opened = closed_loop(L), control.ss(L)
    sizes = []
    for system in (closed, opened):
        poles = np.asarray(system.poles(), dtype=complex)
        if system.isdtime(strict=True):
            poles = np.log(poles[np.abs(poles) > 1e-9]) / system.dt
        sizes += [s for s in np.abs(poles) if s > 1e-6]
    top = math.pi / opened.dt if opened.isdtime(strict=True) else 100 * max(sizes, default=1.0)
    return min(min(sizes, default=1.0) / 1000, top / 10), top


def sensitivities(L: Any, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """S and T (n, 6, 6) at frequencies [rad/s]."""
    one = np.eye(L.noutputs)
    S = np.asarray(np.linalg.inv(one + response(L, omega)), dtype=complex)
    return S, np.asarray(one - S)


def _leg_margins(loop: ComplexArray, omega: FloatArray) -> LegMargins:
    # from the sampled response, since the polynomials of so many states have no correct digits
    gains, phases, _, _, crossings, _ = control.stability_margins(control.frd(loop, omega, smooth=True), returnall=True)
    gains, phases, crossings = (np.atleast_1d(np.asarray(v, dtype=float)) for v in (gains, phases, crossings))
    # at the lowest and the highest frequency a loop may cross the negative axis without a change of sign
    for end in loop[[0, -1]]:
        if end.real < 0 and abs(end.imag) < _REAL * abs(end.real):
            gains = np.append(gains, 1 / abs(end))
    up, down = gains[gains > 1], gains[(gains < 1) & (gains > 0)]
    # a loop may only lag more: what leads by φ lags by 2π − φ
    lags = np.radians(np.mod(phases, 360.0))
    delays = lags / crossings
    return LegMargins(
        float(up.min(initial=math.inf)),
        float(down.max(initial=0.0)),
        float(np.minimum(lags, 2 * math.pi - lags).min(initial=math.inf)),
        float(delays.min(initial=math.inf)),
        float(crossings.max() / (2 * math.pi)) if crossings.size else math.nan,
    )


def _peak(of: Any, L: Any, low: float, high: float) -> tuple[float, float]:
    """Largest singular value over frequency of a function of S and T, and where [rad/s]."""

    def sigma(omega: FloatArray) -> FloatArray:
        return np.linalg.svd(of(*sensitivities(L, omega)), compute_uv=False)[:, 0]

    grid = np.geomspace(low, high * (1 - 1e-9), _GRID)
    values = sigma(grid)
    best = int(values.argmax())
    bracket = (math.log(grid[max(best - 1, 0)]), math.log(grid[min(best + 1, _GRID - 1)]))
    found = minimize_scalar(
        lambda x: -float(sigma(np.array([math.exp(x)]))[0]), bounds=bracket, method="bounded", options={"xatol": 1e-9}
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

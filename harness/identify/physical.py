"""The parameters that fit best among the physically consistent ones.

A platform is a physical body if its mass is positive and its pseudo-inertia [[Σ, m r_G], [m r_Gᵀ, m]] positive
definite; by Schur's complement that is m > 0 and Σ_G = ½ tr(J) 1 − J ≻ 0, J about the centre of mass [Wensing, Kim &
Slotine, IEEE RA-L 3(1), 2018]. If the best fit is not, Σ_G = L Lᵀ with exponentials of three parameters on L's
diagonal, the log-Cholesky form [Rucker & Wensing, IEEE RA-L 7(2), 2022], enforces it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from gough_stewart.harness.identify.regressor import INERTIA, PAIRS, with_estimated
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.vectors import FloatArray

# Lower limit of elements with the bound "> 0", and of the moments of Σ_G, as a share of their scale.
_SMALLEST = 1e-6
# Magnitudes beyond which a log is not one of these instruments: the filters hardly reach further [s].
_LARGEST = {"delay": 0.02}
Function = Callable[[FloatArray], FloatArray]


class BestFit(NamedTuple):
    """The result of the fit."""

    values: FloatArray  # (p,)
    at_bound: tuple[str, ...]  # elements held by a bound or by physical consistency


def best_fit(
    residual: Function,
    jacobian: Function,
    elements: Mapping[str, float],
    names: Sequence[str],
    scale: FloatArray,
    start: FloatArray,
    tolerance: float = 1e-14,
) -> BestFit:
    """Minimise |r(θ)|² over the named elements θ, within the bounds of the platform's table and physically consistent.

    Only all six elements of the inertia are made those of a body; some of them are not, for lack of the others.

    Parameters
    ----------
    residual, jacobian
        r (k,) of θ (p,), and ∂r/∂θ (k, p).
    elements
        All elements of a platform; those not named stay constant.
    scale, start
        Of θ (p,).
    """
    low = np.array([_SMALLEST * s if _bound(name) == "> 0" else 0.0 for name, s in zip(names, scale, strict=True)])
    low = np.where([_bound(name) is None for name in names], -np.inf, low)
    options: Any = {"x_scale": scale, "xtol": tolerance, "ftol": tolerance, "gtol": tolerance, "max_nfev": 60}
    largest = np.array([_LARGEST.get(name, np.inf) for name in names])
    low = np.maximum(low, -largest)
    inside = np.clip(start, low + _SMALLEST * scale, largest)
    theta = least_squares(residual, inside, jacobian, bounds=(low, largest), **options).x
    held = tuple(name for name, value, b, s in zip(names, theta, low, scale, strict=True) if value < b + 1e-5 * s)
    # with some of the elements only, whether it is a body is for the platform to say
    is_whole = set(INERTIA) <= set(names)
    if not is_whole or np.linalg.eigvalsh(_second_moments(with_estimated(elements, names, theta)))[0] > 0:
        return BestFit(theta, held)
    theta = _as_body(residual, jacobian, elements, names, theta, low, scale)
    return BestFit(theta, (*held, "platform_inertia"))


def _as_body(
    residual: Function,
    jacobian: Function,
    elements: Mapping[str, float],
    names: Sequence[str],
    theta: FloatArray,
    low: FloatArray,
    scale: FloatArray,
) -> FloatArray:
    """The best fit with Σ_G = L Lᵀ instead of the six elements of the inertia."""
    six = np.array([list(names).index(name) for name in INERTIA])
    size = float(scale[six].max())
    moments, axes = np.linalg.eigh(_second_moments(with_estimated(elements, names, theta)))
    L = np.linalg.cholesky(axes @ np.diag(np.maximum(moments, 1e-3 * size)) @ axes.T)
    lower = np.tril_indices(3)
    diagonal = lower[0] == lower[1]
    bound, eta, units = low.copy(), np.maximum(theta, low), scale.copy()
    # large enough to pass the platform's own check
    bound[six] = np.where(diagonal, 0.5 * np.log(_SMALLEST * size), -np.inf)
    eta[six] = np.where(diagonal, np.log(np.abs(L[lower])), L[lower])
    units[six] = np.where(diagonal, 1.0, np.sqrt(size))

    def values(eta: Any) -> Any:
        theta, L = eta.copy(), np.zeros((3, 3), dtype=eta.dtype)
        L[lower] = np.where(diagonal, np.exp(eta[six]), eta[six])
        sigma = L @ L.T
        J = np.trace(sigma) * np.eye(3) - sigma
        theta[six] = [J[a, b] for a, b in PAIRS]
        return theta

    def chained(eta: FloatArray) -> FloatArray:
        # complex steps: exact, since `values` is analytic
        steps = 1e-30j * np.eye(len(eta))
        by_eta = np.stack([values(eta + step).imag / 1e-30 for step in steps], axis=1)
        return np.asarray(jacobian(values(eta)) @ by_eta)

    def of_body(eta: FloatArray) -> FloatArray:
        return residual(values(eta))

    start = np.maximum(eta, bound + 1e-9 * np.abs(units))
    options: Any = {"bounds": (bound, np.inf), "x_scale": units, "max_nfev": 200}
    return np.asarray(values(least_squares(of_body, start, chained, **options).x))


def _bound(name: str) -> str | None:
    # instruments have none
    parameter = TABLE.get(name.partition("[")[0])
    return None if parameter is None else parameter.lower_bound


def _second_moments(elements: Mapping[str, float]) -> FloatArray:
    """Σ_G = ½ tr(J) 1 − J."""
    J = np.zeros((3, 3))
    for (a, b), name in zip(PAIRS, INERTIA, strict=True):
        J[a, b] = J[b, a] = elements[name]
    return np.asarray(np.trace(J) / 2 * np.eye(3) - J)

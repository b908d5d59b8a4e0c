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
    at_bound: tuple[str, ...] = ()  # elements held by a bound or by physical consistency


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

    Only all six elements of the inertia are made those of a body; some of them are not, for lack of the others. The
    `jacobian` (k, p) is ∂r/∂θ; `elements` that are not named stay constant.
    """
    stems = [name.partition("[")[0] for name in names]
    bounds = [TABLE[stem].lower_bound if stem in TABLE else None for stem in stems]  # instruments have none
    smallest = {"> 0": _SMALLEST * scale, None: np.full(len(names), -np.inf)}
    low = np.array([smallest.get(bound, np.zeros(len(names)))[k] for k, bound in enumerate(bounds)])
    high = np.array([_LARGEST.get(stem, np.inf) for stem in stems])
    low = np.maximum(low, -high)
    inside = np.clip(start, low + _SMALLEST * scale, high)
    options: Any = {"x_scale": scale, "xtol": tolerance, "ftol": tolerance, "gtol": tolerance, "max_nfev": 60}
    theta = least_squares(residual, inside, jacobian, bounds=(low, high), **options).x
    held = tuple(name for name, value, b, s in zip(names, theta, low, scale, strict=True) if value < b + 1e-5 * s)
    # with some of the elements only, whether it is a body is for the platform to say
    if not set(INERTIA) <= set(names):
        return BestFit(theta, held)
    fitted, J = with_estimated(elements, names, theta), np.zeros((3, 3))
    for (a, b), name in zip(PAIRS, INERTIA, strict=True):
        J[a, b] = J[b, a] = fitted[name]
    moments, axes = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
    if moments[0] > 0:
        return BestFit(theta, held)

    # once more, with Σ_G = L Lᵀ instead of the six elements of the inertia
    six = np.array([list(names).index(name) for name in INERTIA])
    size = float(scale[six].max())
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
        by_eta = np.stack([values(eta + step).imag / 1e-30 for step in 1e-30j * np.eye(len(eta))], axis=1)
        return np.asarray(jacobian(values(eta)) @ by_eta)

    def of_body(eta: FloatArray) -> FloatArray:
        return residual(values(eta))

    start = np.maximum(eta, bound + 1e-9 * np.abs(units))
    options = {"bounds": (bound, np.inf), "x_scale": units, "max_nfev": 200}
    return BestFit(np.asarray(values(least_squares(of_body, start, chained, **options).x)), (*held, "platform_inertia"))

"""The parameters that fit best among those which a body, and a leg, can have.

A platform is a body if its mass is positive and so is its pseudo-inertia [[Σ, m r_G], [m r_Gᵀ, m]]; by Schur's
complement that is m > 0 and Σ_G = ½ tr(J) 1 − J ≻ 0, J about the centre of mass [Wensing, Kim & Slotine, IEEE RA-L
3(1), 2018]. Where the best fit is none, Σ_G = L Lᵀ with the exponentials of three parameters on L's diagonal, the
log-Cholesky form [Rucker & Wensing, IEEE RA-L 7(2), 2022], keeps it one.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.linear_parameters import (
    INERTIA,
    PAIRS,
    gradient,
    linear_parameters,
    with_estimated,
)
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.vectors import FloatArray

# Of an element with the bound "> 0", and of the moments of Σ_G, which may come near to 0: share of their scale.
_SMALLEST = 1e-6
_Function = Callable[[FloatArray], FloatArray]


class BestFit(NamedTuple):
    """Where the fit ended."""

    values: FloatArray  # (p,)
    at_bound: tuple[str, ...]  # what a bound or physical consistency holds


def best_fit(
    R: FloatArray, z: FloatArray, elements: Mapping[str, float], names: Sequence[str], scale: FloatArray
) -> BestFit:
    """Minimise |z − R φ(θ)|² over the named elements θ, within the bounds of the platform's table.

    Parameters
    ----------
    R, z
        Of the whitened regressor's QR factors (k, SIZE), (k,).
    elements
        All elements of φ, those not named stay.
    scale
        Of the named elements (p,).

    Raises
    ------
    IdentificationError
        The best fit is no body, and not all six elements of the inertia were to be estimated.
    """
    start = np.array([elements.get(name, elements.get(f"{name}[1]", 0.0)) for name in names])
    low = np.array([_SMALLEST * s if _bound(name) == "> 0" else 0.0 for name, s in zip(names, scale, strict=True)])
    low = np.where([_bound(name) is None for name in names], -np.inf, low)

    def residual(theta: FloatArray) -> FloatArray:
        return np.asarray(R @ linear_parameters(with_estimated(elements, names, theta)) - z)

    def jacobian(theta: FloatArray) -> FloatArray:
        return np.asarray(R @ gradient(with_estimated(elements, names, theta), names))

    # free first: where the best fit lies inside of all bounds there is nothing to hold it
    theta = _gauss_newton(residual, jacobian, start, scale)
    held = tuple(name for name, value, bound in zip(names, theta, low, strict=True) if value < bound)
    if held:
        inside = np.maximum(start, low + _SMALLEST * scale)
        theta = least_squares(
            residual, inside, jacobian, bounds=(low, np.inf), x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-14
        ).x
    inertias = [k for k, name in enumerate(names) if name in INERTIA]
    if not inertias or _is_body(with_estimated(elements, names, theta)):
        return BestFit(theta, held)
    if len(inertias) < len(INERTIA):
        raise IdentificationError(
            f"platform_inertia: the best fit is that of no body, and only {', '.join(names[k] for k in inertias)} were "
            "to be estimated; estimate all of platform_inertia, or excite the platform's rotations more",
            [names[k] for k in inertias],
        )
    theta = _as_body(residual, elements, names, theta, low, scale)
    return BestFit(theta, (*held, "platform_inertia"))


def _gauss_newton(residual: _Function, jacobian: _Function, start: FloatArray, scale: FloatArray) -> FloatArray:
    """A few steps are exact: φ is bilinear in mass and centre of mass, and linear in all else."""
    theta = start
    for _ in range(30):
        step, *_ = np.linalg.lstsq(jacobian(theta) * scale, -residual(theta), rcond=None)
        theta = theta + scale * step
        if np.abs(step).max() < 1e-13:
            break
    return np.asarray(theta)


def _as_body(
    residual: _Function,
    elements: Mapping[str, float],
    names: Sequence[str],
    theta: FloatArray,
    low: FloatArray,
    scale: FloatArray,
) -> FloatArray:
    """The best fit with Σ_G = L Lᵀ in the place of the six elements of the inertia."""
    six = np.array([names.index(name) for name in INERTIA])
    size = float(scale[six].max())
    sigma = _second_moments(with_estimated(elements, names, theta))
    moments, axes = np.linalg.eigh(sigma)
    L = np.linalg.cholesky(axes @ np.diag(np.maximum(moments, 1e-3 * size)) @ axes.T)
    lower, diagonal = np.tril_indices(3), np.array([a == b for a, b in zip(*np.tril_indices(3), strict=True)])
    bound = low.copy()
    bound[six] = np.where(diagonal, 0.5 * np.log(_SMALLEST * size), -np.inf)
    eta = np.maximum(theta, low)
    eta[six] = np.where(diagonal, np.log(np.abs(L[lower])), L[lower])

    def values(eta: FloatArray) -> FloatArray:
        theta, L = eta.copy(), np.zeros((3, 3))
        L[lower] = np.where(diagonal, np.exp(np.minimum(eta[six], 300.0)), eta[six])
        sigma = L @ L.T
        J = np.trace(sigma) * np.eye(3) - sigma
        theta[six] = [J[a, b] for a, b in PAIRS]
        return theta

    units = scale.copy()
    units[six] = np.where(diagonal, 1.0, np.sqrt(size))

    def of_body(eta: FloatArray) -> FloatArray:
        return residual(values(eta))

    found = least_squares(
        of_body,
        np.maximum(eta, bound + 1e-9 * np.abs(units)),
        bounds=(bound, np.inf),
        x_scale=units,
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=500,
    )
    return values(found.x)


def _bound(name: str) -> str | None:
    return TABLE[name.partition("[")[0]].lower_bound


def _second_moments(elements: Mapping[str, float]) -> FloatArray:
    """Σ_G = ½ tr(J) 1 − J."""
    J = np.zeros((3, 3))
    for (a, b), name in zip(PAIRS, INERTIA, strict=True):
        J[a, b] = J[b, a] = elements[name]
    return np.asarray(np.trace(J) / 2 * np.eye(3) - J)


def _is_body(elements: Mapping[str, float]) -> bool:
    return bool(np.linalg.eigvalsh(_second_moments(elements))[0] > 0)

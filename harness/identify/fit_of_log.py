"""The estimate from a fit of the samples of a log."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.causes import diagnosis_of
from gough_stewart.harness.identify.estimate import Estimate, Residuals, combination_text
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.physical import BestFit
from gough_stewart.harness.identify.rows.whitened import Whitened
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# A combination whose standard error exceeds this share of its scale is not identifiable.
_UNSEEN = 1.0
# Sizes of delays [s] and tilts [rad].
_DELAY, _TILT = 0.01, 0.1


class Channels(NamedTuple):
    """Signals (n, 6) that a fit explains, of all parts; some samples are fitted, others validate the fit."""

    quantity: str
    unit: str
    time: FloatArray  # (n,) of all parts on one axis [s]
    measured: FloatArray
    residual: FloatArray  # measured − fitted
    before: FloatArray  # what the nominal parameters predict
    is_fitted: NDArray[np.bool_]  # (n,)
    validating: list[tuple[float, float]]  # spans of time that are not fitted [s]


def estimate_of(
    names: tuple[str, ...],
    nominal: FloatArray,
    scale: FloatArray,
    fit: BestFit,
    regression: tuple[FloatArray, FloatArray],
    channels: Channels,
    notes: Sequence[str],
    rows: Whitened | None = None,
) -> Estimate:
    """The estimate of a fit, with its covariance and its residuals.

    Parameters
    ----------
    nominal, scale
        Values before the fit (p,), and sizes (p,) that their changes are measured against [SI].
    regression
        Whitened regressor (m, 6, p) in units of `scale`, and whitened residuals (m, 6), of the fitted samples.
    notes
        Remarks on the fit; one on active bounds is added.
    rows
        Of inverse dynamics at this fit, to test whether the model fits.

    Raises
    ------
    IdentificationError
        The log does not determine all parameters; names those.
    """
    sigma, directions, covariance = uncertainty(*regression)
    _check_identifiable(sigma, directions, names)
    if fit.at_bound:
        notes = [*notes, f"at the bound of what is physical: {', '.join(fit.at_bound)}"]
    covariance = covariance * np.outer(scale, scale)
    found = None if rows is None else diagnosis_of(rows, covariance)
    fitted, validating = channels.residual[channels.is_fitted], channels.residual[~channels.is_fitted]
    return Estimate(
        method="linear",
        names=names,
        values=fit.values,
        nominal=nominal,
        covariance=covariance,
        singular_values=sigma,
        directions=directions,
        scale=scale,
        rank=len(sigma),
        residuals=Residuals(
            channels.quantity,
            channels.unit,
            rms(fitted),
            rms(validating) if len(validating) else None,
            np.std(channels.measured[channels.is_fitted], axis=0),
            None if found is None else found.whiteness,
        ),
        notes=(*notes, *(() if found is None else found.sentences)),
        alarms=() if found is None else found.alarms,
        diagnosis=found,
        # of the inertia all elements, if as a whole it is at the limit of what a body has
        at_bound=tuple(name for name in names if name in fit.at_bound or name.partition("[")[0] in fit.at_bound),
        details={
            "time": channels.time,
            "measured": channels.measured,
            "fitted": channels.measured - channels.residual,
            "before": channels.before,
            "validating": channels.validating,
        },
    )


def with_all(
    estimate: Estimate,
    names: tuple[str, ...],
    nominal: FloatArray,
    scale: FloatArray,
    not_excited: Sequence[str],
    bias: FloatArray,
) -> Estimate:
    """The estimate of all these elements, without a number for those that are not excited, or were not fitted.

    Elements at a bound keep their value, but have no variance: that of the regression ignores the bound.

    Parameters
    ----------
    nominal, scale
        Of all elements (p,) [SI].
    bias
        Expected errors (p,) [SI] by noise in the regressor; their squares are added to the variances.
    """
    at = [names.index(name) for name in estimate.names]
    p = len(names)
    values, covariance, directions = (
        np.full(p, np.nan),
        np.full((p, p), np.nan),
        np.zeros((len(estimate.directions), p)),
    )
    values[at], covariance[np.ix_(at, at)], directions[:, at] = (
        estimate.values,
        estimate.covariance,
        estimate.directions,
    )
    covariance += np.outer(bias, bias)
    unknown = [k for k, name in enumerate(names) if name in not_excited]
    values[unknown] = np.nan
    for k in (*unknown, *(names.index(name) for name in estimate.at_bound)):
        covariance[k] = covariance[:, k] = np.nan
    return replace(
        estimate,
        names=names,
        values=values,
        nominal=nominal,
        covariance=covariance,
        directions=directions,
        scale=scale,
        not_excited=tuple(not_excited),
        at_bound=tuple(name for name in estimate.at_bound if name not in not_excited),
    )


def scales(platform: Platform, names: Sequence[str], force: float, velocity: float) -> FloatArray:
    """Sizes (p,) [SI] that changes of these elements are measured against.

    Parameters
    ----------
    force, velocity
        Typical changes of the actuator forces [N] and typical leg velocities [m/s] of the log.
    """
    mass, rho = platform.platform_mass, platform.characteristic_length
    sizes = {
        "platform_com": rho,
        "platform_inertia": mass * rho**2,
        "leg_armature": mass / 6 + platform.leg_upper_mass,
        "leg_viscous_friction": force / max(velocity, 1e-12),
        "leg_coulomb_friction": force,
        "force_offset": force,
        "delay": _DELAY,
        "base_tilt": _TILT,
    }
    return np.array([sizes.get(name.partition("[")[0]) or abs(value_of(platform, name)) or 1.0 for name in names])


def rms(residual: FloatArray) -> FloatArray:
    """Root mean square of each channel of residuals (n, k)."""
    return np.asarray(np.sqrt((residual**2).mean(axis=0)))


def _check_identifiable(sigma: FloatArray, directions: FloatArray, names: Sequence[str]) -> None:
    """Refuse combinations whose standard error is as large as their scale."""
    unseen = [k for k in range(len(sigma)) if not sigma[k] * _UNSEEN > 1]
    if not unseen:
        return
    involved = [name for j, name in enumerate(names) if any(abs(directions[k][j]) > 0.3 for k in unseen)]
    texts = "; ".join(
        f"{combination_text(directions[k], names)} (± {100 / sigma[k]:.0f} % of its size)" for k in unseen
    )
    raise IdentificationError(
        f"too little excitation for {', '.join(involved)}: this log does not determine {texts}; estimate fewer "
        "parameters, or record a motion designed for them (gough-stewart excite)",
        involved,
    )


def uncertainty(D: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular values (p,), their combinations (p, p) as rows, and the covariance (p, p), of a whitened regression.

    s² (Σ_t D_tᵀ D_t)⁻¹ with s² = |e|²/(n − p) and n the number of rows that are used, whose residual is not 0.

    Parameters
    ----------
    D
        (n, 6, p), columns of similar scale.
    residual
        e (n, 6).
    """
    n, legs, p = D.shape
    _, sigma, directions = np.linalg.svd(D.reshape(n * legs, p), full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = directions.T / sigma**2 @ directions
    used = int((residual != 0).sum())
    return sigma, directions, float((residual**2).sum()) / max(used - p, 1) * inverse

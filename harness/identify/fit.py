"""Linear identification: generalised least squares of inverse dynamics, which is linear in masses and friction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.causes import diagnosis_of
from gough_stewart.harness.identify.estimate import (
    Estimate,
    Residuals,
    Validation,
    combination_text,
    nominal_values,
    rms,
)
from gough_stewart.harness.identify.friction import (
    COULOMB,
    STICTION,
    StickingFriction,
    ideal_of,
    is_of_bristles,
    resolved,
    sticks,
    unit_friction,
)
from gough_stewart.harness.identify.log import Part, on_one_axis
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.noise import Whitened, noises_of, whitened, whitened_by
from gough_stewart.harness.identify.physical import BestFit, best_fit
from gough_stewart.harness.identify.regression import Regression, Rows, segment_of
from gough_stewart.harness.identify.regressor import (
    INERTIAL,
    SIZE,
    ForceDerivatives,
    check_independent,
    elements_of,
    force_derivatives,
    gradient,
    kernel_parameters,
    linear_parameters,
    with_estimated,
)
from gough_stewart.harness.identify.row_model import RowFit, RowModel, is_of_instruments
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Unexplained share of the forces' changes, median over legs, beyond which the log is of another machine; if the fitted
# rows last for less, forces hardly change but by noise and by what is not estimated [s].
_UNEXPLAINED, _TELLING = 0.5, 1.0
# Stribeck velocities of guides, screws and seals, from which the fit of static friction starts [m/s].
_VELOCITIES = np.geomspace(1e-4, 1e-1, 13)
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


def identify_linear(
    parts: Sequence[Part],
    platform: Platform,
    names: tuple[str, ...],
    *,
    cutoff: float | None = None,
    not_excited: Sequence[str] = (),
) -> Estimate:
    """Masses, moments, inertias, armature and friction by weighted least squares on F = W φ.

    Generalised least squares, (F − W φ)ᵀ V⁻¹ (F − W φ): the covariance V of the rows is that of white noise of forces
    and lengths through the filters, with shares that fit the log (`noise`). With Coulomb friction, rows in which the
    leg reverses are left out, since friction models are uncertain there. The covariance of the result is
    (Gᵀ Wᵀ V⁻¹ W G)⁻¹, G = ∂φ/∂θ. Gains and offsets of force sensors, their delay and the tilt of the base are fitted
    too if they are among the names.

    Parameters
    ----------
    parts
        Of logs; each says what of it is fitted.
    names
        Elements of parameters in which inverse dynamics is linear, or bilinear; of static friction; of instruments.
    cutoff
        Cut-off of the filter [Hz]; from the log by default.
    not_excited
        Elements that the motion does not excite, so the residuals tell nothing of them.

    Raises
    ------
    IdentificationError
        Parameters that this log cannot determine; names them.
    LogError
        A log that cannot be evaluated.
    """
    bent = [k for k, name in enumerate(names) if is_of_bristles(name, platform)]
    friction = StickingFriction(platform, tuple(names[k] for k in bent)) if sticks(platform) else None
    nominal = nominal_values(names, resolved(platform))
    # without friction that sticks, which is not linear, and with the legs' stretch in the lengths of both sides
    smooth = ideal_of(platform)
    linear = [k for k, name in enumerate(names) if not is_of_instruments(name) and k not in bent]
    linear_names = tuple(names[k] for k in linear)
    elements = with_estimated(elements_of(smooth), linear_names, nominal[linear].tolist())
    regression = Regression(tuple(segment_of(part.log, platform, cutoff) for part in parts))
    rows, where = regression.rows, parts[0].log.where
    times = [segment.rows.time for segment in regression.segments]
    fitted_times = [part.is_fitted(time) for part, time in zip(parts, times, strict=True)]
    is_fitted = np.concatenate(fitted_times)
    fitted = int(is_fitted.sum())
    if 6 * fitted < 3 * len(names):
        raise LogError(f"{where}: only {fitted} rows after the filter of {rows.cutoff:.3g} Hz; record longer")
    scale = scales_of(rows.regressor, rows.force, platform, names)
    W, F = rows.regressor[is_fitted], rows.force[is_fitted]
    usable = used_rows(rows, platform, names)
    used = usable[is_fitted]

    # ordinary least squares first: the covariance of the rows depends on masses and friction
    values, force = nominal.copy(), rows.force
    if friction:
        columns = rows.regressor @ gradient(elements, linear_names)
        values[bent] = _start_of_friction(regression, platform, friction.names, columns, usable * is_fitted[:, None])
        scale[bent] = values[bent]
        stuck = regression.filtered(lambda v, h: friction.force(values[bent], v, h), 0)
        force = force - stuck.reshape(len(stuck), 6, -1)[:, :, 0]
    if linear:
        check_independent(
            (W @ (gradient(elements, linear_names) * scale[linear])).reshape(-1, len(linear)),
            linear_names,
            "no force in this log depends on {}; remove them",
            "too little excitation: {}; remove one of each, or move the platform in more ways (gough-stewart excite)",
        )
        weights = used / max(float(np.abs(force[is_fitted]).max()), 1e-300)
        weighted = np.concatenate([weights[..., None] * W, (weights * force[is_fitted])[..., None]], axis=2)
        values[linear] = _fit_of(weighted.reshape(-1, SIZE + 1), elements, linear_names, scale[linear]).values
    model = RowModel(regression, smooth, elements, names, friction)
    whole = whitened(model, _fit_at(model, values, is_fitted, used), not_excited)
    if len(linear) == len(names) and not friction:
        fit = _fit_of(whole.of(np.concatenate([W, F[..., None]], axis=2)), elements, names, scale)
    else:
        fit = best_fit(
            lambda theta: whole.of(model.residual(theta)[is_fitted, :, None])[:, 0],
            lambda theta: -whole.of(model.columns(theta)[is_fitted]),
            elements,
            names,
            scale,
            values,
            1e-8 if friction else 1e-10,
        )
    whole = whole.at(_fit_at(model, fit.values, is_fitted, used, whole.fit.derivatives))
    residual = model.residual(fit.values)
    duration = sum(float(np.ptp(time[chosen])) for time, chosen in zip(times, fitted_times, strict=True) if any(chosen))
    _check_explained(residual[is_fitted], F, duration, where)
    D = whole.of(whole.fit.columns * scale)
    white = whole.of(residual[is_fitted, :, None])[:, 0]
    freedom = int(used.sum()) - len(names)
    time, validating = on_one_axis(parts, times)
    estimate = estimate_of(
        names,
        nominal,
        scale,
        fit,
        (D, white, freedom),
        Channels("force of leg", "N", time, rows.force, residual, model.force(nominal), is_fitted, validating),
        [f"{fitted} rows of {rows.cutoff:.3g} Hz fitted, {len(rows.time) - fitted} kept for validation"],
        whole,
    )
    kept = usable * ~is_fitted[:, None]
    if not kept.any():
        return estimate
    columns = model.columns(fit.values) * scale
    return with_validation(estimate, _validated(whole, residual, columns, kept, D, white, freedom))


def _fit_at(
    model: RowModel,
    values: FloatArray,
    is_fitted: NDArray[np.bool_],
    used: FloatArray,
    derivatives: ForceDerivatives | None = None,
) -> RowFit:
    """What diagnosis needs of a fit, at these values; derivatives of a fit nearby do."""
    force = model.force(values)
    if derivatives is None:
        names = [model.names[k] for k in model.linear]
        p, directions = kernel_parameters(model.platform, names)
        p = p + directions @ (values[model.linear] - nominal_values(names, model.platform))
        derivatives = force_derivatives(model.regression.motion, p, model.smooth_force(values))
        if model.friction is not None:
            legs = range(6)
            derivatives.by_legs[:, legs, :2, legs] += model.by_lengths(values).transpose(2, 0, 1)
    columns = model.columns(values)[is_fitted]
    return RowFit(model.names, values, columns, force, model.rate(values), derivatives, is_fitted, used)


def _fit_of(white: FloatArray, elements: Mapping[str, float], names: Sequence[str], scale: FloatArray) -> BestFit:
    """Minimise |F − W φ(θ)|² for [W, F] (n, SIZE + 1): φ is linear, or bilinear in mass and centre of mass."""
    Rz = np.asarray(np.linalg.qr(white, mode="r"))
    R, z = Rz[:SIZE, :SIZE], Rz[:SIZE, SIZE]
    return best_fit(
        lambda theta: np.asarray(R @ linear_parameters(with_estimated(elements, names, theta)) - z),
        lambda theta: np.asarray(R @ gradient(with_estimated(elements, names, theta), names)),
        elements,
        names,
        scale,
        np.array([elements[name] for name in names]),
    )


def _start_of_friction(
    regression: Regression, platform: Platform, names: Sequence[str], linear: FloatArray, used: FloatArray
) -> FloatArray:
    """Values (q,) of these elements of friction that sticks near the best fit, by least squares on a grid.

    In F_c b + (F_s − F_c) b exp(−(v/v_s)²), with b the friction for unit Coulomb friction, two forces are linear. The
    Stribeck velocity v_s is that of the grid if it is estimated. `linear` (n, 6, p) are the columns of all else.
    """
    static, velocity = STICTION
    factor = platform.leg_coulomb_friction_factor
    velocities = _VELOCITIES if velocity in names else np.array([platform.leg_stribeck_velocity])
    measured = used * regression.rows.force
    known = (used[..., None] * linear).reshape(measured.size, -1)
    stiffness = float(StickingFriction(platform, ()).law(np.zeros(0)).stiffness.mean())
    bent = platform.unchecked({static: 0.0, "leg_bristle_stiffness": stiffness, "leg_bristle_damping": 0.0})

    def unit(v: FloatArray, step: float) -> FloatArray:
        b = factor * unit_friction(bent, v, step)
        return np.concatenate([b, *(b * np.exp(-((v / v_s) ** 2)) for v_s in velocities)], axis=1)

    columns = regression.filtered(unit, 0).reshape(len(measured), 1 + len(velocities), 6).swapaxes(1, 2)
    flat = (used[..., None] * columns).reshape(measured.size, -1)
    best, coulomb, more, slow = np.inf, platform.leg_coulomb_friction, 0.0, velocities[0]
    for k, v_s in enumerate(velocities):
        D = np.concatenate([known, flat[:, [0, 1 + k] if static in names else [0]]], axis=1)
        size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
        x = np.linalg.lstsq(D / size, measured.ravel(), rcond=1e-9)[0] / size
        cost = float(((measured.ravel() - D @ x) ** 2).sum())
        if cost < best and x[known.shape[1]] > 0:
            best, coulomb, slow = cost, float(x[known.shape[1]]), float(v_s)
            more = float(x[-1]) if static in names else 0.0
    values = {static: coulomb + max(more, 0.05 * coulomb), velocity: slow, COULOMB: coulomb}
    values |= {f"{COULOMB}[{k + 1}]": coulomb * factor[k] for k in range(6)}
    return np.array([values[name] for name in names])


def scales_of(W: FloatArray, force: FloatArray, platform: Platform, names: Sequence[str]) -> FloatArray:
    """`scales` (p,) for rows with this regressor (n, 6, SIZE) and these forces (n, 6) [N]."""
    velocity = float(np.sqrt((W[:, :, INERTIAL : INERTIAL + 6] ** 2).sum(axis=2).mean()))
    change = max(float(np.std(force, axis=0).mean()), 1e-9 * float(np.abs(force).max()))
    return scales(platform, names, change, velocity)


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


def used_rows(rows: Rows, platform: Platform, names: Sequence[str]) -> FloatArray:
    """1 for rows that a fit of these elements uses, else 0 (n, 6): with Coulomb friction those without a reversal."""
    has_coulomb = platform.leg_coulomb_friction > 0 or any(name.startswith(COULOMB) for name in names)
    return rows.sliding if has_coulomb else np.ones_like(rows.sliding)


def _check_explained(residual: FloatArray, force: FloatArray, duration: float, where: str) -> None:
    """Refuse a fit that leaves most of the forces unexplained: it is of another platform, or too short."""
    share = float(np.median(rms(residual) / np.maximum(np.std(force, axis=0), 1e-300)))
    if share <= _UNEXPLAINED:
        return
    if duration < _TELLING:
        change = float(np.median(np.std(force, axis=0)))
        raise LogError(
            f"{where}: too short: after the filters and without the rows for validation {duration:.2g} s are left to "
            f"fit, in which the forces change by {change:.3g} N only, and the best fit leaves {100 * share:.0f} % of "
            "that unexplained; record some seconds of motion (gough-stewart excite designs it)"
        )
    raise LogError(
        f"{where}: the log contradicts this platform: the best fit leaves {100 * share:.0f} % of the forces' changes "
        "unexplained; check the joints, the order of the legs, the sign of the forces (positive extends a leg), and "
        "that lengths are from joint to joint"
    )


def _validated(
    whole: Whitened,
    residual: FloatArray,
    columns: FloatArray,
    kept: FloatArray,
    D: FloatArray,
    white: FloatArray,
    freedom: int,
) -> Validation:
    """Whether rows that were not fitted are predicted as well as their noise and the estimate's errors allow.

    e = F − W φ has the covariance s² (V + D (Dᵀ V⁻¹ D)⁻¹ Dᵀ), so eᵀ (…)⁻¹ e/n has the distribution F(n, ν). Here e is
    `residual` (m, 6) with ∂(reading)/∂θ `columns` (m, 6, p) in rows that are `kept` (m, 6); D (n, p), `white` (n,) and
    ν, `freedom`, are those of the fit.
    """
    chosen = ~whole.fit.is_fitted
    _, parts = noises_of(whole.model.regression, whole.fit.derivatives.by_legs, chosen, kept[chosen])
    used = kept[chosen][..., None]
    mixed = used * np.concatenate([columns[chosen], residual[chosen][..., None]], axis=2)
    factors = [part.factor(*whole.noise.shares) for part in parts]
    e = whitened_by(factors, mixed.reshape(len(used) * 6, -1))
    X, r, information = e[:, :-1], e[:, -1], D.T @ D
    variance = float(white @ white) / max(freedom, 1)
    left = float(r @ r - (X.T @ r) @ np.linalg.lstsq(information + X.T @ X, X.T @ r, rcond=None)[0])
    n = int(kept.sum())
    force, length = whole.noise.shares
    of_noise = sum(float(force * part.of_force[0].sum() + length * part.of_length[0].sum()) for part in parts)
    flat = mixed.reshape(-1, mixed.shape[2])[:, :-1]
    of_errors = float((flat * np.linalg.lstsq(information, flat.T, rcond=None)[0].T).sum())
    return Validation(
        float(np.sqrt((kept * residual**2).sum() / n)),
        float(np.sqrt(variance * (of_noise + of_errors) / n)),
        float(fdtrc(n, max(freedom, 1), max(left, 0.0) / n / max(variance, np.finfo(float).tiny))),
    )


def with_validation(estimate: Estimate, validation: Validation) -> Estimate:
    """The estimate with the judgement of its validation, as an alarm if it fails and nothing else contradicts it."""
    said = f"{validation.rms:.3g} N where {validation.expected:.3g} N are expected (p = {validation.p_value:.2g})"
    if not validation.alarm or estimate.alarms:
        return replace(
            estimate, validation=validation, notes=(*estimate.notes, f"rows kept for validation are off by {said}")
        )
    alarm = f"the fit does not predict the rows kept for validation, which are off by {said}"
    return replace(estimate, validation=validation, alarms=(*estimate.alarms, alarm))


def estimate_of(
    names: tuple[str, ...],
    nominal: FloatArray,
    scale: FloatArray,
    fit: BestFit,
    regression: tuple[FloatArray, FloatArray, int],
    channels: Channels,
    notes: Sequence[str],
    rows: Whitened | None = None,
) -> Estimate:
    """The estimate of a fit, with its covariance s² (Dᵀ D)⁻¹, s² = |e|²/ν, and its residuals.

    Parameters
    ----------
    nominal, scale
        Values before the fit (p,), and sizes (p,) that their changes are measured against [SI].
    regression
        Whitened regressor D (m, p) in units of `scale`, and whitened residuals e (m,), of the fitted samples; and
        the degrees of freedom ν of the residuals.
    notes
        Remarks on the fit; one on active bounds is added.
    rows
        Of inverse dynamics at this fit, to test whether the model fits.

    Raises
    ------
    IdentificationError
        The log does not determine all parameters; names those.
    """
    D, white, freedom = regression
    _, sigma, directions = np.linalg.svd(D, full_matrices=False)
    _check_identifiable(sigma, directions, names)
    variance = float((white**2).sum()) / max(freedom, 1)
    covariance = variance * (directions.T / sigma**2 @ directions) * np.outer(scale, scale)
    if fit.at_bound:
        notes = [*notes, f"at the bound of what is physical: {', '.join(fit.at_bound)}"]
    diagnosis = None if rows is None else diagnosis_of(rows, covariance)
    fitted, validating = channels.residual[channels.is_fitted], channels.residual[~channels.is_fitted]
    return Estimate(
        method="linear",
        names=names,
        values=fit.values,
        nominal=nominal,
        covariance=covariance,
        freedom=max(freedom, 1),
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
            None if diagnosis is None else diagnosis.whiteness,
        ),
        notes=(*notes, *(() if diagnosis is None else diagnosis.sentences)),
        alarms=() if diagnosis is None else diagnosis.alarms,
        diagnosis=diagnosis,
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
    bias: FloatArray | float = 0.0,
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
    at, p = [names.index(name) for name in estimate.names], len(names)
    values, covariance = np.full(p, np.nan), np.full((p, p), np.nan)
    directions = np.zeros((len(estimate.directions), p))
    values[at], directions[:, at] = estimate.values, estimate.directions
    covariance[np.ix_(at, at)] = estimate.covariance
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

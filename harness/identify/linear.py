"""Linear identification: weighted least squares of inverse dynamics, which is linear in masses and friction."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.estimate import Estimate, nominal_values
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of, rms, scales
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.parts import Part, on_one_axis
from gough_stewart.harness.identify.physical import BestFit, best_fit
from gough_stewart.harness.identify.rows.force_derivatives import (
    ForceDerivatives,
    force_derivatives,
    kernel_parameters,
)
from gough_stewart.harness.identify.rows.linear_parameters import (
    SIZE,
    dependences,
    elements_of,
    gradient,
    linear_parameters,
    with_estimated,
)
from gough_stewart.harness.identify.rows.regression import Regression, Rows, joined, regression_of
from gough_stewart.harness.identify.rows.row_model import RowModel, is_of_instruments
from gough_stewart.harness.identify.rows.sticking import (
    COULOMB,
    STICTION,
    StickingFriction,
    ideal_of,
    is_of_bristles,
    resolved,
    sticks,
    unit_friction,
)
from gough_stewart.harness.identify.rows.whitened import Fit, Whitened, whitened
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Unexplained share of the forces' changes, median over legs, beyond which the log is of another machine; if the fitted
# rows last for less, forces hardly change but by noise and by what is not estimated [s].
_UNEXPLAINED, _TELLING = 0.5, 1.0
# Stribeck velocities of guides, screws and seals, from which the fit of static friction starts [m/s].
_VELOCITIES = np.geomspace(1e-4, 1e-1, 13)


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
    elements = elements_of(smooth)
    of_platform = [k for k, name in enumerate(names) if not is_of_instruments(name) and k not in bent]
    own = tuple(names[k] for k in of_platform)
    elements = with_estimated(elements, own, nominal[of_platform].tolist())
    each = [regression_of(part.log, platform, cutoff) for part in parts]
    regression = joined(each)
    rows = regression.rows
    is_fitted = np.concatenate([part.is_fitted(of_part.rows.time) for part, of_part in zip(parts, each, strict=True)])
    fitted = int(is_fitted.sum())
    if 6 * fitted < 3 * len(names):
        raise LogError(
            f"{parts[0].log.where}: only {fitted} rows after the filter of {rows.cutoff:.3g} Hz; record longer"
        )
    scale = scales_of(rows, platform, names)
    W, F = rows.regressor[is_fitted], rows.force[is_fitted]
    _check_excitation(W, elements, own, scale[of_platform])
    every = _used_rows(rows, platform, names)
    used = every[is_fitted]

    # ordinary least squares first: the covariance of the rows depends on masses and friction
    values, force = nominal.copy(), rows.force
    if friction:
        linear = rows.regressor @ gradient(elements, own)
        values[bent] = _start_of_friction(regression, platform, friction.names, linear, every * is_fitted[:, None])
        scale[bent] = values[bent]
        stuck = regression.filtered(lambda v, h: friction.force(values[bent], v, h), 0)
        force = force - stuck.reshape(len(stuck), 6, -1)[:, :, 0]
    if own:
        weights = used / max(float(np.abs(force[is_fitted]).max()), 1e-300)
        R, z = _compressed(weights[..., None] * W, weights * force[is_fitted])
        values[of_platform] = _fitted(R, z, elements, own, scale[of_platform]).values
    model = RowModel(regression, smooth, elements, names, friction)
    rows_at = whitened(model, _fit_at(model, values, is_fitted, used), not_excited)
    if len(own) == len(names) and not friction:
        wide = rows_at.of(np.concatenate([W, F[..., None]], axis=2))
        R, z = _compressed(wide[:, :SIZE], wide[:, SIZE])
        fit = _fitted(R, z, elements, own, scale)
    else:
        fit = _with_instruments(model, rows_at, values, elements, scale)
    rows_at = rows_at.at(_fit_at(model, fit.values, is_fitted, used, rows_at.fit.derivatives))
    residual = model.residual(fit.values)
    _check_explained(residual[is_fitted], F, _duration(parts, each), parts[0].log.where)
    D = rows_at.of(rows_at.fit.columns * scale).reshape(fitted, 6, -1)
    notes = [f"{fitted} rows of {rows.cutoff:.3g} Hz fitted, {len(rows.time) - fitted} kept for validation"]
    time, validating = on_one_axis(parts, [of_part.rows.time for of_part in each])
    channels = Channels(
        "force of leg", "N", time, regression.rows.force, residual, model.force(nominal), is_fitted, validating
    )
    white = rows_at.of(residual[is_fitted, :, None]).reshape(fitted, 6)
    return estimate_of(names, nominal, scale, fit, (D, white), channels, notes, rows=rows_at)


def _fit_at(
    model: RowModel,
    values: FloatArray,
    is_fitted: NDArray[np.bool_],
    used: FloatArray,
    derivatives: ForceDerivatives | None = None,
) -> Fit:
    """What diagnosis needs of a fit, at these values; derivatives of a fit nearby do."""
    force = model.force(values)
    if derivatives is None:
        p, directions = kernel_parameters(model.platform, [model.names[k] for k in model.own])
        nominal = np.array([value_of(model.platform, model.names[k]) for k in model.own])
        p = p + directions @ (values[model.own] - nominal)
        derivatives = force_derivatives(model.regression.motion, p, model.smooth_force(values))
        if model.friction is not None:
            legs = range(6)
            derivatives.by_legs[:, legs, :2, legs] += model.by_lengths(values).transpose(2, 0, 1)
    columns = model.columns(values)[is_fitted]
    return Fit(model.names, values, columns, force, model.rate(values), derivatives, is_fitted, used)


def _start_of_friction(
    regression: Regression, platform: Platform, names: Sequence[str], linear: FloatArray, used: FloatArray
) -> FloatArray:
    """Values (q,) of these elements of friction that sticks near the best fit, by least squares on a grid.

    In F_c b + (F_s − F_c) b exp(−(v/v_s)²), with b the friction for unit Coulomb friction, two forces are linear. The
    Stribeck velocity v_s is that of the grid if it is estimated.

    Parameters
    ----------
    linear
        Columns of all else that is estimated (n, 6, p).
    used
        1 for fitted rows that are used, else 0 (n, 6).
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
        return np.concatenate([b, *(b * np.exp(-((v / each) ** 2)) for each in velocities)], axis=1)

    columns = regression.filtered(unit, 0).reshape(len(measured), 1 + len(velocities), 6).swapaxes(1, 2)
    flat = (used[..., None] * columns).reshape(measured.size, -1)
    best, coulomb, more, slow = np.inf, platform.leg_coulomb_friction, 0.0, velocities[0]
    for k, each in enumerate(velocities):
        chosen = [0, 1 + k] if static in names else [0]
        D = np.concatenate([known, flat[:, chosen]], axis=1)
        size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
        x = np.linalg.lstsq(D / size, measured.ravel(), rcond=1e-9)[0] / size
        cost = float(((measured.ravel() - D @ x) ** 2).sum())
        if cost < best and x[known.shape[1]] > 0:
            best, coulomb, slow = cost, float(x[known.shape[1]]), float(each)
            more = float(x[-1]) if static in names else 0.0
    values = {static: coulomb + max(more, 0.05 * coulomb), velocity: slow, COULOMB: coulomb}
    values |= {f"{COULOMB}[{k + 1}]": coulomb * factor[k] for k in range(6)}
    return np.array([values[name] for name in names])


def _with_instruments(
    model: RowModel, rows: Whitened, start: FloatArray, elements: Mapping[str, float], scale: FloatArray
) -> BestFit:
    """Minimise the whitened residual over platform and instruments."""
    here = rows.fit.is_fitted

    def residual(values: FloatArray) -> FloatArray:
        return rows.of(model.residual(values)[here, :, None])[:, 0]

    def jacobian(values: FloatArray) -> FloatArray:
        return -rows.of(model.columns(values)[here])

    return best_fit(residual, jacobian, elements, model.names, scale, start, 1e-8 if model.friction else 1e-10)


def _fitted(
    R: FloatArray, z: FloatArray, elements: Mapping[str, float], names: Sequence[str], scale: FloatArray
) -> BestFit:
    """Minimise |z − R φ(θ)|²: φ is linear, or bilinear in mass and centre of mass."""
    start = np.array([elements[name] for name in names])

    def residual(theta: FloatArray) -> FloatArray:
        return np.asarray(R @ linear_parameters(with_estimated(elements, names, theta)) - z)

    def jacobian(theta: FloatArray) -> FloatArray:
        return np.asarray(R @ gradient(with_estimated(elements, names, theta), names))

    return best_fit(residual, jacobian, elements, names, scale, start)


def scales_of(rows: Rows, platform: Platform, names: Sequence[str]) -> FloatArray:
    """Sizes (p,) relative to which changes of these elements are measured."""
    velocity = float(np.sqrt((rows.regressor[:, :, 15:21] ** 2).sum(axis=2).mean()))
    force = max(float(np.std(rows.force, axis=0).mean()), 1e-9 * float(np.abs(rows.force).max()))
    return scales(platform, names, force, velocity)


def _used_rows(rows: Rows, platform: Platform, names: Sequence[str]) -> FloatArray:
    """1 for rows that a fit of these elements uses, else 0 (n, 6): with Coulomb friction those without a reversal."""
    has_coulomb = platform.leg_coulomb_friction > 0 or any(name.startswith(COULOMB) for name in names)
    return rows.sliding if has_coulomb else np.ones_like(rows.sliding)


def _check_excitation(W: FloatArray, elements: dict[str, float], names: Sequence[str], scale: FloatArray) -> None:
    """Refuse combinations that have no effect on forces in this or any motion: rank-revealing QR with pivots."""
    if not names:
        return
    D = (W @ (gradient(elements, names) * scale)).reshape(-1, len(names))
    size = np.linalg.norm(D, axis=0)
    if not size.all():
        dead = [name for name, s in zip(names, size, strict=True) if s == 0]
        raise IdentificationError(f"no force in this log depends on {', '.join(dead)}; remove them", dead)
    dependent, text = dependences(D, names)
    if not dependent:
        return
    raise IdentificationError(
        f"too little excitation: {text}; remove one of each, or move the platform in more ways (gough-stewart excite)",
        dependent,
    )


def _duration(parts: Sequence[Part], each: Sequence[Regression]) -> float:
    """Time for which the fitted rows of all parts last [s]."""
    times = [of_part.rows.time[part.is_fitted(of_part.rows.time)] for part, of_part in zip(parts, each, strict=True)]
    return sum(float(np.ptp(time)) for time in times if time.size)


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


def _compressed(W: FloatArray, F: FloatArray) -> tuple[FloatArray, FloatArray]:
    """R and z with |F − W φ|² = |z − R φ|² + constant."""
    R = np.asarray(np.linalg.qr(np.column_stack([W.reshape(-1, SIZE), F.reshape(-1)]), mode="r"))
    return R[:SIZE, :SIZE], R[:SIZE, SIZE]

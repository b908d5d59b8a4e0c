"""Linear identification: weighted least squares of inverse dynamics, which is linear in masses and friction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.estimate import Estimate, nominal_values
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of, rms, scales
from gough_stewart.harness.identify.instruments import is_of_instruments
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.names import expanded, value_of
from gough_stewart.harness.identify.parts import VALIDATION, Part, on_one_axis, parts_of
from gough_stewart.harness.identify.physical import BestFit, best_fit
from gough_stewart.harness.identify.rows.force_derivatives import ForceDerivatives, force_derivatives
from gough_stewart.harness.identify.rows.linear_parameters import (
    FRICTION,
    SIZE,
    dependences,
    elements_of,
    gradient,
    linear_parameters,
    with_estimated,
)
from gough_stewart.harness.identify.rows.regression import Regression, Rows, joined, regression_of
from gough_stewart.harness.identify.rows.row_model import RowModel
from gough_stewart.harness.identify.rows.sticking import (
    PRESLIDING,
    StickingFriction,
    ideal_of,
    is_of_bristles,
    resolved,
    sticks,
)
from gough_stewart.harness.identify.rows.sticking_start import start_of_friction
from gough_stewart.harness.identify.rows.whitened import Fit, Whitened, whitened
from gough_stewart.harness.identify.simulation import kernel_parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Unexplained share of the forces' changes, median over legs, beyond which the log is of another machine; if the fitted
# rows last for less, forces hardly change but by noise and by what is not estimated [s].
_UNEXPLAINED, _TELLING = 0.5, 1.0
# Bristles that are this much stiffer do not bend; what they explain worse, in variances of the noise.
_STIFF, _TOLD = 100.0, 16.0


def identify_linear(
    log: Log | Sequence[Part],
    platform: Platform,
    names: Sequence[str],
    *,
    cutoff: float | None = None,
    validation: float = VALIDATION,
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
    log
        A log, or parts of logs, each of which says what of it is fitted.
    names
        Parameters or elements of them.
    cutoff
        Cut-off of the filter [Hz]; from the log by default.
    validation
        Share of a log, at its end, reserved for validation.
    not_excited
        Elements that the motion does not excite, so the residuals tell nothing of them.

    Raises
    ------
    IdentificationError
        A parameter that is not linear, or that this log cannot determine; names it.
    LogError
        A log that cannot be evaluated.
    """
    names = expanded(names, platform)
    bent = [k for k, name in enumerate(names) if is_of_bristles(name, platform)]
    friction = StickingFriction(platform, tuple(names[k] for k in bent)) if sticks(platform) else None
    nominal = nominal_values(names, resolved(platform, names))
    # without friction that sticks, which is not linear, and with the legs' stretch in the lengths of both sides
    smooth = ideal_of(platform)
    elements = elements_of(smooth)
    of_platform = [k for k, name in enumerate(names) if not is_of_instruments(name) and k not in bent]
    own = tuple(names[k] for k in of_platform)
    _check_linear(own, elements)
    elements = with_estimated(elements, own, nominal[of_platform].tolist())
    parts = parts_of(log, validation)
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
    every = used_rows(rows, platform, names)
    used = every[is_fitted]

    # ordinary least squares first: the covariance of the rows depends on masses and friction
    values = nominal.copy()
    if friction:
        linear = rows.regressor @ gradient(elements, own)
        values[bent] = start_of_friction(regression, platform, friction.names, linear, every * is_fitted[:, None])
        scale[bent] = values[bent]
        rows = _without_friction(rows, regression, friction, values[bent])
    if own:
        values[of_platform] = ordinary_fit(rows, elements, own, scale[of_platform], is_fitted, every).values
    model = RowModel(regression, smooth, elements, names, friction)
    rows_at = whitened(regression, _fit_at(model, values, is_fitted, used), smooth, not_excited)
    if len(own) == len(names) and not friction:
        wide = rows_at.of(np.concatenate([W, F[..., None]], axis=2))
        R, z = _compressed(wide[:, :SIZE], wide[:, SIZE])
        fit = _fitted(R, z, elements, own, scale)
    else:
        fit = _with_instruments(model, rows_at, values, elements, scale)
    if PRESLIDING[0] in names:
        _check_presliding(model, rows_at, fit.values, elements, scale)
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
    return estimate_of("linear", names, nominal, scale, fit, (D, white), channels, notes, rows=rows_at)


def _check_linear(names: Sequence[str], elements: Mapping[str, float]) -> None:
    for name in names:
        if not is_linear(name, elements):
            raise IdentificationError(
                f"{name}: inverse dynamics is not linear in it; use the method output_error, or geometry for joints "
                "and offsets",
                [name],
            )


def is_linear(name: str, elements: Mapping[str, float]) -> bool:
    """Whether inverse dynamics is linear in an element, or bilinear with others."""
    return name in elements or name.partition("[")[0] in FRICTION


def ordinary_fit(
    rows: Rows,
    elements: Mapping[str, float],
    names: Sequence[str],
    scale: FloatArray,
    is_fitted: NDArray[np.bool_],
    used: FloatArray,
) -> BestFit:
    """Ordinary least squares of the fitted rows that are used (n, 6) over linear elements."""
    F = rows.force[is_fitted]
    weights = used[is_fitted] / max(float(np.abs(F).max()), 1e-300)
    R, z = _compressed(weights[..., None] * rows.regressor[is_fitted], weights * F)
    return _fitted(R, z, elements, names, scale)


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


def _without_friction(rows: Rows, regression: Regression, friction: StickingFriction, values: FloatArray) -> Rows:
    """The rows less friction that sticks, at these values of its parameters."""
    stuck = regression.filtered(lambda v, h: friction.force(values, v, h), 0)
    return replace(rows, force=rows.force - stuck.reshape(len(stuck), 6, -1)[:, :, 0])


def _check_presliding(
    model: RowModel, rows: Whitened, values: FloatArray, elements: Mapping[str, float], scale: FloatArray
) -> None:
    """Refuse a stiffness of bristles that explains the log hardly better than legs that stick without bending.

    Fast reversals last for milliseconds. There a soft bristle, which delays friction, and its damping, which advances
    it, look together like a stiff one: the cost has a second minimum that the interval of the first does not reach.
    """
    here, names = rows.fit.is_fitted, list(model.names)
    rest = [k for k, name in enumerate(names) if name not in PRESLIDING]
    stiff = values.copy()
    stiff[names.index(PRESLIDING[0])] *= _STIFF

    def at(of_rest: FloatArray) -> FloatArray:
        moved = stiff.copy()
        moved[rest] = of_rest
        return moved

    def residual(of_rest: FloatArray) -> FloatArray:
        return rows.of(model.residual(at(of_rest))[here, :, None])[:, 0]

    def jacobian(of_rest: FloatArray) -> FloatArray:
        return -rows.of(model.columns(at(of_rest))[here][:, :, rest])

    kept = [names[k] for k in rest]
    other = best_fit(residual, jacobian, elements, kept, scale[rest], values[rest], 1e-4) if rest else None
    cost = float((rows.of(model.residual(values)[here, :, None]) ** 2).sum())
    unbent = float((residual(values[rest] if other is None else other.values) ** 2).sum())
    freedom = max(int(rows.fit.used.sum()) - len(names), 1)
    if unbent - cost < _TOLD * cost / freedom:
        raise IdentificationError(
            f"{PRESLIDING[0]}: legs that stick without bending explain this log as well; expected slower reversals, of "
            "some mm/s",
            [PRESLIDING[0]],
        )


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


def used_rows(rows: Rows, platform: Platform, names: Sequence[str]) -> FloatArray:
    """1 for rows that a fit of these elements uses, else 0 (n, 6).

    Reversals show how a leg sticks; a fit that does not estimate that leaves them out.
    """
    if not has_coulomb(platform, names):
        return np.ones_like(rows.sliding)
    return rows.known if PRESLIDING[0] in names else rows.sliding


def has_coulomb(platform: Platform, names: Sequence[str]) -> bool:
    """Whether a model with these estimates has Coulomb friction, so that reversals are left out."""
    return platform.leg_coulomb_friction > 0 or any(name.startswith("leg_coulomb_friction") for name in names)


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

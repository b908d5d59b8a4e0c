"""Linear identification: generalised least squares of inverse dynamics, which is linear in masses and friction.

A platform is a physical body if its mass is positive and its pseudo-inertia [[Σ, m r_G], [m r_Gᵀ, m]] positive
definite; by Schur's complement that is m > 0 and Σ_G = ½ tr(J) 1 − J ≻ 0, J about the centre of mass [Wensing, Kim &
Slotine, IEEE RA-L 3(1), 2018]. If the best fit is not, Σ_G = L Lᵀ with exponentials of three parameters on L's
diagonal, the log-Cholesky form [Rucker & Wensing, IEEE RA-L 7(2), 2022], enforces it.
"""

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.linalg._umath_linalg as numpy_library
import scipy.linalg._fblas as scipy_library
from scipy.optimize import least_squares
from scipy.special import fdtrc

from gough_stewart.harness.errors import LogError
from gough_stewart.harness.identify.causes import diagnosis_of
from gough_stewart.harness.identify.estimate import (
    Channels,
    Estimate,
    Validation,
    estimate_of,
    nominal_values,
    on_one_axis,
    rms,
)
from gough_stewart.harness.identify.lack_of_fit import Whitened
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.noise import noises_of, whitened_by
from gough_stewart.harness.identify.regressor import (
    INERTIA,
    INERTIAL,
    PAIRS,
    SIZE,
    gradient,
    linear_parameters,
    value_of,
    with_estimated,
)
from gough_stewart.harness.identify.row_model import Regression, RowModel
from gough_stewart.harness.identify.sticking_friction import (
    COULOMB,
    STICTION,
    StickingFriction,
    resolved,
    unit_friction,
)
from gough_stewart.model.parameters import TABLE
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

# Unexplained share of the forces' changes, median over legs, beyond which the log is of another machine; if the fitted
# rows last for less, forces hardly change but by noise and by what is not estimated [s].
_UNEXPLAINED, _TELLING = 0.5, 1.0
# Stribeck velocities of guides, screws and seals, from which the fit of static friction starts [m/s].
_VELOCITIES = np.geomspace(1e-4, 1e-1, 13)
# Sizes of delays [s] and tilts [rad].
_DELAY, _TILT = 0.01, 0.1
# Lower limit of elements with the bound "> 0", and of the moments of Σ_G, as a share of their scale.
_SMALLEST = 1e-6
# Magnitudes beyond which a log is not one of these instruments: the filters hardly reach further [s].
_LARGEST = {"delay": 0.02}
# Smaller p-values are told as smaller than this: so far out the distribution is not known.
_LEAST_P = 1e-6
# NumPy and SciPy have an OpenBLAS each; other libraries of linear algebra keep their threads.
_PREFIXES, _SUFFIXES = ("scipy_openblas", "openblas"), ("64_", "")
Function = Callable[[FloatArray], FloatArray]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit OpenBLAS to one thread: its matrices are small, and threads that wait for others cost 20 times as much."""
    before = [(set_number, get_number()) for get_number, set_number in _controls()]
    for set_number, _ in before:
        set_number(1)
    try:
        yield
    finally:
        for set_number, number in before:
            set_number(number)


@cache
def _controls() -> tuple[tuple[Any, Any], ...]:
    """Functions that get and set the number of threads, of each OpenBLAS that is loaded."""
    controls = []
    for module in (numpy_library, scipy_library):
        library = ctypes.CDLL(module.__file__)
        for name in (f"{prefix}_{{}}_num_threads{suffix}" for prefix in _PREFIXES for suffix in _SUFFIXES):
            if hasattr(library, name.format("set")) and hasattr(library, name.format("get")):
                controls.append((getattr(library, name.format("get")), getattr(library, name.format("set"))))
    return tuple(controls)


def identify_linear(
    parts: Sequence[Part],
    platform: Platform,
    names: tuple[str, ...],
    *,
    cutoff: float | None = None,
    not_excited: Sequence[str] = (),
) -> tuple[Estimate, Whitened]:
    """Masses, moments, inertias, armature and friction by weighted least squares on F = W φ.

    Generalised least squares, (F − W φ)ᵀ V⁻¹ (F − W φ): the covariance V of the rows is that of white noise of forces
    and lengths through the filters, with shares that fit the log (`noise`). With Coulomb friction, rows in which the
    leg reverses are left out, since friction models are uncertain there. The covariance of the result is
    (Gᵀ Wᵀ V⁻¹ W G)⁻¹, G = ∂φ/∂θ. Gains and offsets of force sensors, their delay and the tilt of the base are fitted
    too if they are among the names. Of elements that are `not_excited` residuals tell nothing.
    """
    regression = Regression.of(parts, platform, cutoff)
    model, nominal = RowModel(regression, names), nominal_values(names, resolved(platform))
    segments, linear, friction = regression.segments, model.linear, model.friction
    highest, where = max(segment.cutoff for segment in segments), parts[0].where
    fitted_of = [segment.part.is_fitted(segment.time) for segment in segments]
    is_fitted = np.concatenate(fitted_of)
    fitted = int(is_fitted.sum())
    if 6 * fitted < 3 * len(names):
        raise LogError(f"{where}: only {fitted} rows after the filter of {highest:.3g} Hz; record longer")
    scale = scales_of(regression.W, regression.force, platform, names)
    W, F = regression.W[is_fitted], regression.force[is_fitted]
    usable = regression.used(names)
    used = usable[is_fitted]

    # ordinary least squares first: the covariance of the rows depends on masses and friction
    values, force = nominal.copy(), regression.force
    if friction:
        columns = regression.W @ gradient(model.elements, model.linear_names)
        values[model.bent] = _start_of_friction(
            regression, platform, friction.names, columns, usable * is_fitted[:, None]
        )
        scale[model.bent] = values[model.bent]
        force = force - regression.filtered(lambda v, h: friction.force(values[model.bent], v, h))[:, :, 0]
    if linear:
        weights = used / max(float(np.abs(force[is_fitted]).max()), 1e-300)
        weighted = np.concatenate([weights[..., None] * W, (weights * force[is_fitted])[..., None]], axis=2)
        rows = weighted.reshape(-1, SIZE + 1)
        values[linear], _ = _linear_fit(rows, model.elements, model.linear_names, scale[linear])
    whole = Whitened.at(model.fit_at(values, is_fitted, used), not_excited)
    if len(linear) == len(names) and not friction:
        white = whole.of(np.concatenate([W, F[..., None]], axis=2))
        best, held = _linear_fit(white, model.elements, names, scale)
    else:
        best, held = _best_fit(
            lambda theta: whole.of(model.residual(theta)[is_fitted]),
            lambda theta: -whole.of(model.columns(theta)[is_fitted]),
            names,
            scale,
            values,
            1e-8 if friction else 1e-10,
        )
    whole = replace(whole, fit=model.fit_at(best, is_fitted, used, whole.fit.derivatives))

    residual, times = whole.fit.all_residuals, [segment.time for segment in segments]
    duration = sum(float(np.ptp(time[chosen])) for time, chosen in zip(times, fitted_of, strict=True) if any(chosen))
    # of another platform, or too short
    change = np.std(F, axis=0)
    share = float(np.median(rms(residual[is_fitted]) / np.maximum(change, 1e-300)))
    if share > _UNEXPLAINED and duration < _TELLING:
        raise LogError(
            f"{where}: too short: after the filters and without the rows for validation {duration:.2g} s are left to "
            f"fit, in which the forces change by {float(np.median(change)):.3g} N only, and the best fit leaves "
            f"{100 * share:.0f} % of that unexplained; record some seconds of motion (gough-stewart excite designs it)"
        )
    if share > _UNEXPLAINED:
        raise LogError(
            f"{where}: the log contradicts this platform: the best fit leaves {100 * share:.0f} % of the forces' "
            "changes unexplained; check the joints, the order of the legs, the sign of the forces (positive extends a "
            "leg), and that lengths are from joint to joint"
        )
    regressed = whole.of(whole.fit.columns * scale), whole.of(residual[is_fitted]), int(used.sum()) - len(names)
    time, validating = on_one_axis(parts, times)
    note = f"{fitted} rows of {highest:.3g} Hz fitted, {len(is_fitted) - fitted} kept for validation"
    channels = Channels(
        "force of leg", "N", time, regression.force, residual, model.force(nominal), is_fitted, validating
    )  # fmt: skip
    return estimate_of(names, nominal, scale, best, held, regressed, channels, note), whole


def judged(estimate: Estimate, whole: Whitened) -> Estimate:
    """The estimate of these rows with what its residuals say of the model, and how it predicts rows not fitted."""
    diagnosis, fit = diagnosis_of(whole, estimate.standard_errors), whole.fit
    estimate = replace(
        estimate,
        diagnosis=diagnosis,
        alarms=diagnosis.alarms,
        notes=(*estimate.notes, *diagnosis.sentences),
        residuals=replace(estimate.residuals, whiteness=diagnosis.whiteness),
    )
    kept = fit.model.regression.used(fit.model.names) * ~fit.is_fitted[:, None]
    if not kept.any():
        return estimate
    validation = _validated(whole, estimate.scale, kept)
    p = f"= {validation.p_value:.2g}" if validation.p_value >= _LEAST_P else f"< {_LEAST_P:g}"
    said = f"{validation.rms:.3g} N where {validation.expected:.3g} N are expected (p {p})"
    if not validation.alarm or estimate.alarms:
        note = f"rows kept for validation are off by {said}"
        return replace(estimate, validation=validation, notes=(*estimate.notes, note))
    alarm = f"the fit does not predict the rows kept for validation, which are off by {said}"
    return replace(estimate, validation=validation, alarms=(alarm,))


def _linear_fit(
    white: FloatArray, elements: Mapping[str, float], names: Sequence[str], scale: FloatArray
) -> tuple[FloatArray, tuple[str, ...]]:
    """Minimise |F − W φ(θ)|² for [W, F] (n, SIZE + 1): φ is linear, or bilinear in mass and centre of mass."""
    Rz = np.asarray(np.linalg.qr(white, mode="r"))
    R, z = Rz[:SIZE, :SIZE], Rz[:SIZE, SIZE]
    return _best_fit(
        lambda theta: np.asarray(R @ linear_parameters(with_estimated(elements, names, theta)) - z),
        lambda theta: np.asarray(R @ gradient(with_estimated(elements, names, theta), names)),
        names,
        scale,
        np.array([elements[name] for name in names]),
    )


def _best_fit(
    residual: Function,
    jacobian: Function,
    names: Sequence[str],
    scale: FloatArray,
    start: FloatArray,
    tolerance: float = 1e-14,
) -> tuple[FloatArray, tuple[str, ...]]:
    """Minimise |r(θ)|² over the named elements θ, within the bounds of the platform's table and physically consistent.

    Only all six elements of the inertia are made those of a body; some of them are not, for lack of the others. The
    `jacobian` (k, p) is ∂r/∂θ.
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
    near = 1e-5 * scale
    held = tuple(name for k, name in enumerate(names) if not low[k] + near[k] <= theta[k] <= high[k] - near[k])
    # with some of the elements only, whether it is a body is for the platform to say
    if not set(INERTIA) <= set(names):
        return theta, held
    six, J = np.array([list(names).index(name) for name in INERTIA]), np.zeros((3, 3))
    for (a, b), value in zip(PAIRS, theta[six], strict=True):
        J[a, b] = J[b, a] = value
    moments, axes = np.linalg.eigh(np.trace(J) / 2 * np.eye(3) - J)
    if moments[0] > 0:
        return theta, held

    # once more, with Σ_G = L Lᵀ instead of the six elements of the inertia
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

    start = np.clip(eta, bound + 1e-9 * np.abs(units), high)
    options = {"bounds": (bound, high), "x_scale": units, "max_nfev": 200}
    best = least_squares(of_body, start, chained, **options)
    return np.asarray(values(best.x)), (*held, "platform_inertia")


def _start_of_friction(
    regression: Regression, platform: Platform, names: Sequence[str], linear: FloatArray, used: FloatArray
) -> FloatArray:
    """Values (q,) of these elements of stiction near the best fit, by least squares on a grid.

    In F_c b + (F_s − F_c) b exp(−(v/v_s)²), with b the friction for unit Coulomb friction, two forces are linear. The
    Stribeck velocity v_s is that of the grid if it is estimated. `linear` (n, 6, p) are the columns of all else.
    """
    static, velocity = STICTION
    factor = platform.leg_coulomb_friction_factor
    velocities = _VELOCITIES if velocity in names else np.array([platform.leg_stribeck_velocity])
    stiffness = float(StickingFriction(platform, ()).law().stiffness.mean())
    bent = platform.unchecked({static: 0.0, "leg_bristle_stiffness": stiffness, "leg_bristle_damping": 0.0})

    def unit(v: FloatArray, step: float) -> FloatArray:
        b = factor * unit_friction(bent, v, step)
        return np.stack([b, *(b * np.exp(-((v / v_s) ** 2)) for v_s in velocities)], axis=-1)

    measured = (used * regression.force).ravel()
    known = (used[..., None] * linear).reshape(measured.size, -1)
    columns = (used[..., None] * regression.filtered(unit)).reshape(measured.size, -1)
    best, coulomb, more, slow = np.inf, platform.leg_coulomb_friction, 0.0, velocities[0]
    for k, v_s in enumerate(velocities):
        D = np.concatenate([known, columns[:, [0, 1 + k] if static in names else [0]]], axis=1)
        size = np.maximum(np.linalg.norm(D, axis=0), 1e-300)
        x = np.linalg.lstsq(D / size, measured, rcond=1e-9)[0] / size
        cost = float(((measured - D @ x) ** 2).sum())
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
    """Sizes (p,) [SI] that changes are measured against, from usual changes of forces [N] and velocities [m/s]."""
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


def _validated(whole: Whitened, scale: FloatArray, kept: FloatArray) -> Validation:
    """Whether rows that were not fitted are predicted as well as their noise and the estimate's errors allow.

    e = F − W φ has the covariance s² (V + D (Dᵀ V⁻¹ D)⁻¹ Dᵀ), so eᵀ (…)⁻¹ e/n has the distribution F(n, ν). Here e are
    the residuals in rows that are `kept` (m, 6), with ∂(reading)/∂θ W; D and ν are those of the fit, θ in units of
    `scale` (p,).
    """
    fit = whole.fit
    chosen, residual, columns = ~fit.is_fitted, fit.all_residuals, fit.model.columns(fit.values) * scale
    D, white, freedom = whole.of(fit.columns * scale), whole.of(fit.residual), int(fit.used.sum()) - len(scale)
    parts = noises_of(fit.model.regression, fit.derivatives.by_legs, chosen, kept[chosen])
    shares = [whole.noise.of(part.which) for part in parts]
    mixed = kept[chosen][..., None] * np.concatenate([columns[chosen], residual[chosen][..., None]], axis=2)
    flat = mixed.reshape(-1, mixed.shape[2])
    e = whitened_by([part.factor(*share) for part, share in zip(parts, shares, strict=True)], flat)
    X, r, information = e[:, :-1], e[:, -1], D.T @ D
    variance = float(white @ white) / max(freedom, 1)
    left = float(r @ r - (X.T @ r) @ np.linalg.lstsq(information + X.T @ X, X.T @ r, rcond=None)[0])
    n = int(kept.sum())
    of_noise = sum(
        float(force * part.of_force[0].sum() + length * part.of_length[0].sum())
        for part, (force, length) in zip(parts, shares, strict=True)
    )
    of_errors = float((flat[:, :-1] * np.linalg.lstsq(information, flat[:, :-1].T, rcond=None)[0].T).sum())
    return Validation(
        float(np.sqrt((kept * residual**2).sum() / n)),
        float(np.sqrt(variance * (of_noise + of_errors) / n)),
        float(fdtrc(n, max(freedom, 1), max(left, 0.0) / n / max(variance, np.finfo(float).tiny))),
    )

"""Output-error identification: simulate the plant under the measured forces and fit its leg lengths."""

import math
from collections.abc import Sequence

import numpy as np

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.checks import check_forces, check_lengths, force_of, sample_time_of
from gough_stewart.harness.identify.estimate import Estimate, nominal_values
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of, scales
from gough_stewart.harness.identify.linear import whitening_of
from gough_stewart.harness.identify.linear_parameters import elements_of
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.movement import motion_of_lengths
from gough_stewart.harness.identify.names import OF_LOGS, PER_LEG, expanded
from gough_stewart.harness.identify.parts import VALIDATION, Part, on_one_axis, parts_of
from gough_stewart.harness.identify.physical import BestFit, best_fit
from gough_stewart.harness.identify.regression import cutoff_of
from gough_stewart.harness.identify.simulation import Course, Innovations, kernel_parameters, simulated
from gough_stewart.harness.identify.smoothing import edge, smoothed
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.vectors import FloatArray

# The filter's cut-off as a multiple of the motion's; a step is this share of its period.
_WIDER = 2.0
_STEPS_A_PERIOD = 4
# RK4 is stable to 2.78 on the real axis; friction may increase during the fit.
_STIFFEST = 1.5
# Manoeuvring index of the α-β filter: the noise of acceleration relative to that of length, and its limits.
_INDICES = (1e-3, 10.0)
# Steps until the filter has forgotten its start.
_SETTLING = 12
_OF_STARTS = 0.15  # share of the log on which additional starts are tried
_SPREAD = 0.3  # of starts, relative to the scale


def identify_output_error(
    log: Log | Sequence[Part],
    platform: Platform,
    names: Sequence[str],
    *,
    cutoff: float | None = None,
    validation: float = VALIDATION,
    starts: int = 3,
    seed: int = 0,
) -> Estimate:
    """Estimate any elements of the physical parameters by a simulation corrected by the log; exact gradients.

    Parameters
    ----------
    log
        A log, or parts of logs, each of which says what of it is fitted.
    names
        Parameters or elements of them.
    cutoff
        Cut-off of the filter for forces and lengths [Hz]; from the log by default.
    validation
        Share of a log, at its end, reserved for validation.
    starts
        Number of starting values: the nominal ones, and random ones about them, tried on part of the log.
    seed
        Seed of the random ones.

    Raises
    ------
    IdentificationError
        Parameters that this log cannot determine; names them.
    LogError
        A log that cannot be evaluated.
    """
    names = expanded(names, platform)
    foreign = [name for name in names if name.partition("[")[0] in OF_LOGS]
    if foreign:
        raise IdentificationError(f"{', '.join(foreign)}: not a parameter of the plant; use method geometry", foreign)
    parts = parts_of(log, validation)
    courses, times = zip(*(course_of(part.log, platform, cutoff) for part in parts), strict=True)
    steps = [int(part.is_fitted(time).sum()) for part, time in zip(parts, times, strict=True)]
    nominal = nominal_values(names, platform)
    p, directions = kernel_parameters(platform, names)
    force = float(np.mean([np.std(course.force, axis=0).mean() for course in courses]))
    velocity = float(np.mean([np.std(np.diff(course.length, axis=0)) / course.step for course in courses]))
    scale = scales(platform, names, force, velocity)
    elements = {**elements_of(platform), **dict(zip(names, nominal.tolist(), strict=True))}

    def run(theta: FloatArray, to: Sequence[int]) -> Innovations:
        """The first steps of every part, after the filter has settled."""
        moved, found = p + directions @ (theta - nominal), []
        for course, n in zip(courses, to, strict=True):
            if n > _SETTLING:
                found.append(simulated(course._replace(length=course.length[:n]), moved, directions))
        return Innovations(
            np.concatenate([each.values[_SETTLING:] for each in found]),
            np.concatenate([each.sensitivity[_SETTLING:] for each in found]),
        )

    def fit(start: FloatArray, to: Sequence[int], whitening: FloatArray, tolerance: float) -> tuple[BestFit, float]:
        last: dict[bytes, Innovations] = {}

        def at(theta: FloatArray) -> Innovations:
            if theta.tobytes() not in last:
                last.clear()
                last[theta.tobytes()] = run(theta, to)
            return last[theta.tobytes()]

        def residual(theta: FloatArray) -> FloatArray:
            return np.asarray(at(theta).values @ whitening.T).ravel()

        def jacobian(theta: FloatArray) -> FloatArray:
            return np.asarray(np.einsum("ij,tjp->tip", whitening, at(theta).sensitivity).reshape(-1, len(names)))

        found = best_fit(residual, jacobian, elements, names, scale, start, tolerance)
        return found, float((residual(found.values) ** 2).sum())

    if max(steps) <= _SETTLING:
        raise LogError(f"{parts[0].log.where}: only {max(steps)} steps after the filter; record longer")
    first = run(nominal, [min(n, _SETTLING + 100) for n in steps])
    whitening = np.eye(6) / max(float(np.abs(first.values).max()), 1e-15)
    short = [max(int(_OF_STARTS * n), min(n, _SETTLING + 50)) for n in steps]
    rng = np.random.default_rng(seed)
    tried = [fit(start, short, whitening, 1e-3) for start in _starts(nominal, scale, starts, rng)]
    best, least = min(tried, key=lambda each: each[1])
    agree = sum(cost < 1.01 * least for _, cost in tried)
    whitening = whitening_of(run(best.values, short).values)
    best, _ = fit(best.values, steps, whitening, 1e-6)
    kept = [time[_SETTLING:] for time in times]
    whole = run(best.values, [len(course.length) for course in courses])
    is_fitted = np.concatenate([part.is_fitted(time) for part, time in zip(parts, kept, strict=True)])
    whitening = whitening_of(whole.values[is_fitted])
    D = np.einsum("ij,tjp->tip", whitening, whole.sensitivity[is_fitted]) * scale
    notes = [
        f"{is_fitted.sum()} steps of {1e3 * courses[0].step:.3g} ms fitted, {(~is_fitted).sum()} kept for validation",
        f"{agree} of {starts} starts converge to the same values",
    ]
    time, validating = on_one_axis(parts, kept)
    measured = np.concatenate([course.length[_SETTLING:] for course in courses])
    before = measured - np.concatenate(
        [simulated(course, p, directions[:, :0]).values[_SETTLING:] for course in courses]
    )
    channels = Channels("predicted length of leg", "m", time, measured, whole.values, before, is_fitted, validating)
    regression = (D, whole.values[is_fitted] @ whitening.T)
    return estimate_of("output_error", names, nominal, scale, best, regression, channels, notes)


def course_of(log: Log, platform: Platform, cutoff: float | None = None) -> tuple[Course, FloatArray]:
    """The inputs of the simulation, and the time at the end of each step (n,) [s]; see `identify_output_error`."""
    h = sample_time_of(log)
    check_lengths(log, platform)
    check_forces(log, platform)
    highest = 0.5 / h / (2 * _WIDER)
    cutoff = min(highest, cutoff_of(log.leg_length, h) if cutoff is None else cutoff)
    wide = _WIDER * cutoff
    every = 2 * max(1, int(1 / (2 * _STEPS_A_PERIOD * cutoff * h)))
    delay = -h / 2 if log.holds_force else 0.0
    force = smoothed(force_of(log), h, wide, every // 2, 0, delay)
    lengths = [smoothed(log.leg_length, h, wide, every, k) for k in range(3)]
    state, _ = motion_of_lengths(platform, *lengths)
    n, step = len(lengths[0]) - 1, every * h
    J = np.asarray(leg_jacobian(platform, state.position, state.orientation))
    mobility = J @ np.linalg.solve(mass_matrix(platform, state.position, state.orientation), np.swapaxes(J, 1, 2))
    # noise that passes the filter, estimated from the rejected part of the raw signals and the share of the band
    lost, passed = slice(edge(h, wide), -edge(h, wide)), math.sqrt(min(1.0, 2 * wide * h))
    of_force = float(np.std(force_of(log)[lost] - smoothed(force_of(log), h, wide, 1, 0, delay))) * passed
    of_length = float(np.std(log.leg_length[lost] - smoothed(log.leg_length, h, wide))) * passed
    accelerated = of_force * float(np.einsum("tii->ti", mobility).mean())
    alpha, beta = _gains(accelerated * step**2 / max(of_length, 1e-12))
    inverse, angles = np.linalg.inv(J), state.orientation
    turned = np.stack([orientation_rate_from_angular_velocity(angles, inverse[:, 3:, k]) for k in range(6)], -1)
    gain = np.concatenate([alpha * inverse[:, :3], alpha * turned, beta / step * inverse], axis=1)
    viscous, coulomb = (getattr(platform, name) * getattr(platform, f"{name}_factor") for name in PER_LEG)
    stiffest = float((viscous + coulomb / platform.leg_friction_velocity).max())
    rate = stiffest * float(np.linalg.eigvalsh(mobility).max())
    course = Course(
        start=state.to_vector()[0],
        force=force[: 2 * n + 1],
        length=lengths[0][1 : n + 1],
        gain=gain[1 : n + 1],
        step=step,
        substeps=max(1, math.ceil(rate * step / _STIFFEST)),
    )
    assert log.time is not None  # checked by sample_time_of
    return course, log.time[edge(h, wide) + every * np.arange(1, n + 1)]


def _gains(index: float) -> tuple[float, float]:
    """α and β of the stationary filter with manoeuvring index λ: α = 1 − r², β = 2 (1 − r)², r = (4+λ−√(8λ+λ²))/4."""
    lam = float(np.clip(index, *_INDICES))
    r = (4 + lam - math.sqrt(8 * lam + lam**2)) / 4
    return 1 - r * r, 2 * (1 - r) ** 2


def _starts(nominal: FloatArray, scale: FloatArray, number: int, rng: np.random.Generator) -> list[FloatArray]:
    """The nominal values, and random ones about them; positive values stay positive."""
    found = [nominal]
    for _ in range(max(number, 1) - 1):
        z = _SPREAD * rng.standard_normal(len(nominal))
        found.append(np.where(nominal > 0, nominal * np.exp(z), nominal + 0.1 * z * scale))
    return found

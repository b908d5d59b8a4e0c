"""Legs that give in logs: lengths at the motors' side and at the platform's, and the springs between them.

A log has the lengths of one side, or of both. The other side follows from the force on a leg's platform end, N, by the
inverse dynamics of the platform's side [model.dynamics]:

    k (s − L) + c (ṡ − L̇) = N,    so    s − L = N/k − (c/k²) Ṅ + (c²/k³) N̈ − …

with terms that fall by ω c/k, some thousandths. With both sides measured the springs follow by least squares; zeros of
the encoders do not matter. One side alone hardly shows them, near resonances only, so they get no number from it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.checks import sample_time_of
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.fit_of_log import Channels, estimate_of
from gough_stewart.harness.identify.log import Log
from gough_stewart.harness.identify.movement import motion_of_lengths
from gough_stewart.harness.identify.parts import Part, on_one_axis
from gough_stewart.harness.identify.physical import BestFit
from gough_stewart.harness.identify.rows.regression import cutoff_of
from gough_stewart.harness.identify.smoothing import edge, smoothed
from gough_stewart.model.dynamics import inverse_dynamics, leg_damping, platform_side
from gough_stewart.model.interface import Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

SPRINGS = ("leg_stiffness", "leg_damping")
FAST = "Fast motions show the damping of a spring: it delays the stretch behind the force by c/k"
# Rows of the motion per period of the filter; splines of fifth degree between them are exact to 1e-5.
_ROWS_A_PERIOD = 8
# Standard error of the damping beyond which it is not shown, as a share of its value; rows per period of the cut-off.
_LARGEST_ERROR, _PER_PERIOD = 0.25, 2
# Of the least squares, for its third term.
_ITERATIONS = 4
# The cut-off of rows is 16 times the frequency of the motion, which this share of it still passes. Noise of the lengths
# grows with the square of frequency on its way to forces, and with the fourth power to the other side's accelerations.
_OF_MOTION = 1 / 4
# Encoders that differ by no more than this are two readings of one side [m].
_NO_STRETCH = 1e-9


def with_both_sides(parts: Sequence[Part], platform: Platform, cutoff: float | None) -> list[Part]:
    """The parts with lengths of the legs and of the motors, computed for the side that was not measured.

    Of a platform with rigid legs nothing changes: both sides are one.
    """
    if not Variant.of(platform).springs:
        return list(parts)
    return [part._replace(log=_on_both_sides(part.log, platform, cutoff)) for part in parts]


def _on_both_sides(log: Log, platform: Platform, cutoff: float | None) -> Log:
    if log.motor_position is not None:
        return log
    force, reached = _leg_force(log, platform, _cutoff(log, cutoff))
    inner = log.rows(reached)
    assert inner.time is not None  # checked by sample_time_of
    k, c = platform.leg_stiffness, float(np.asarray(leg_damping(platform))[0])
    stretch = stretch_of(k, c, *(force(inner.time, d) for d in range(3)))
    if log.side == "motor":
        return replace(inner, leg_length=inner.leg_length - stretch, motor_position=inner.leg_length, side="leg")
    return replace(inner, motor_position=inner.leg_length + stretch)


def _leg_force(log: Log, platform: Platform, cutoff: float) -> tuple[BSpline, slice]:
    """N through a low-pass as a spline of six over time, and the rows that it reaches."""
    h = sample_time_of(log)
    every, first = max(1, int(1 / (_ROWS_A_PERIOD * cutoff * h))), edge(h, cutoff)
    state, acceleration = motion_of_lengths(
        platform, *(smoothed(log.leg_length, h, cutoff, every, k) for k in range(3))
    )
    force = inverse_dynamics(platform_side(Variant(springs=True), platform), state, acceleration)
    assert log.time is not None  # checked by sample_time_of
    reached = slice(first, first + every * (len(force) - 1) + 1)
    return make_interp_spline(log.time[reached][::every], np.asarray(force), k=5), reached


def _cutoff(log: Log, cutoff: float | None) -> float:
    """A cut-off just above the motion, within what the sample time allows."""
    h = sample_time_of(log)
    return min(_OF_MOTION * (cutoff_of(log.leg_length, h) if cutoff is None else cutoff), 0.25 / h)


def springs_of(
    parts: Sequence[Part], platform: Platform, names: Sequence[str], nominal: FloatArray, cutoff: float | None
) -> tuple[Estimate, tuple[str, ...]]:
    """The springs' estimate from logs with both sides, and those of these names that the logs do not show.

    Parameters
    ----------
    platform
        With the masses that were found: they make N.
    nominal
        Values before the fit (p,).

    Raises
    ------
    IdentificationError
        Lengths of one side only, or legs whose stretch does not change.
    """
    lacking = [part.log.where for part in parts if part.log.motor_position is None]
    if lacking:
        raise IdentificationError(
            f"{', '.join(names)}: not shown by {lacking[0]}, which has lengths on one side of the legs only; expected "
            "motor_position[1..6] beside leg_length[1..6]",
            names,
        )
    rows = [_rows(part, platform, cutoff) for part in parts]
    stretch, *terms = (np.concatenate([each[k] for each in rows]) for k in range(1, 5))
    is_fitted = np.concatenate([part.is_fitted(each[0]) for part, each in zip(parts, rows, strict=True)])
    # zeros of the encoders, of each leg and log
    which = np.concatenate([np.full(len(each[0]), part.which) for part, each in zip(parts, rows, strict=True)])
    for of in (stretch, *terms):
        for log in np.unique(which):
            of[which == log] -= of[(which == log) & is_fitted].mean(axis=0)
    S, *fitted = (each[is_fitted] for each in (stretch, *terms))
    if float(np.abs(S).max()) < _NO_STRETCH:
        raise IdentificationError(
            f"{', '.join(names)}: motor_position and leg_length of this log do not differ; expected readings of both "
            "sides of the legs",
            names,
        )
    a, b, errors, sigma = _least_squares(S, fitted, True)
    shown = b < 0 and errors[1] < _LARGEST_ERROR * abs(b)
    if not shown:
        a, b, errors, sigma = _least_squares(S, fitted, False)
    if not errors[0] < _LARGEST_ERROR * a:
        raise IdentificationError(
            f"{', '.join(names)}: not shown by this log: the legs' stretch does not follow their force; record a "
            "motion that changes the forces more, with finer encoders",
            names,
        )
    k, c = 1 / a, -b / a**2
    values = {"leg_stiffness": k, "leg_damping": c}
    # the first two terms, differentiated
    N, dN, _ = fitted
    columns = {"leg_stiffness": -N / k**2 + 2 * c / k**3 * dN, "leg_damping": -dN / k**2}
    kept = tuple(name for name in names if name != "leg_damping" or shown)
    if not kept:
        raise IdentificationError(f"{', '.join(names)}: not shown by this log; record faster motions", names)
    scale = np.array([values[name] for name in kept])
    D = np.stack([columns[name] * values[name] for name in kept], axis=-1) / sigma
    residual = stretch - stretch_of(k, c, *terms)
    at, spans = on_one_axis(parts, [each[0] for each in rows])
    k0, c0 = nominal_springs(platform)
    before = stretch_of(k0, c0, *terms) if k0 > 0 else 0.0 * stretch
    channels = Channels("stretch of leg", "m", at, stretch, residual, before, is_fitted, spans)
    found = estimate_of(
        kept,
        nominal[[list(names).index(name) for name in kept]],
        scale,
        BestFit(scale, ()),
        (D, residual[is_fitted] / sigma),
        channels,
        (),
    )
    return found, tuple(name for name in names if name not in kept)


def nominal_springs(platform: Platform) -> tuple[float, float]:
    """K and c of a platform, 0 of a rigid one."""
    if not platform.leg_stiffness > 0:
        return 0.0, 0.0
    return platform.leg_stiffness, float(np.asarray(leg_damping(platform))[0])


def stretch_of(k: float, c: float, force: FloatArray, rate: FloatArray, curvature: FloatArray) -> FloatArray:
    """The stretch s − L [m] under a leg force with these derivatives."""
    return np.asarray(force / k - c / k**2 * rate + c**2 / k**3 * curvature)


def _least_squares(
    stretch: FloatArray, terms: Sequence[FloatArray], has_damping: bool
) -> tuple[float, float, FloatArray, float]:
    """1/k, −c/k², their standard errors, and the standard deviation of the residual."""
    force, rate, curvature = (each.ravel() for each in terms)
    D = np.stack([force, rate][: 1 + has_damping], axis=1)
    size = np.linalg.norm(D, axis=0)
    small = np.zeros_like(force)
    for _ in range(_ITERATIONS):
        x = np.linalg.lstsq(D / size, stretch.ravel() - small, rcond=None)[0] / size
        if has_damping:
            small = x[1] ** 2 / x[0] * curvature
    left = stretch.ravel() - small - D @ x
    variance = float(left @ left) / max(len(left) - D.shape[1] - 6, 1)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(D.T @ D / np.outer(size, size)))) / size
    return float(x[0]), float(x[1]) if has_damping else 0.0, errors, max(float(np.sqrt(variance)), 1e-15)


def _rows(part: Part, platform: Platform, cutoff: float | None) -> tuple[FloatArray, ...]:
    """Time (n,), stretch, leg force and its derivatives (n, 6), at rows whose filtered noise is hardly correlated."""
    log, h = part.log, sample_time_of(part.log)
    own = _cutoff(log, cutoff)
    force, reached = _leg_force(log, platform, own)
    assert log.time is not None  # checked by sample_time_of
    assert log.motor_position is not None  # checked by springs_of
    # the same low-pass for the stretch and for the force that makes it
    thin = max(1, int(1 / (_PER_PERIOD * own * h)))
    stretch = smoothed(log.motor_position - log.leg_length, h, own)[: reached.stop - reached.start : thin]
    time = log.time[reached][::thin]
    return time, stretch, *(force(time, d) for d in range(3))


def merged(estimate: Estimate, springs: Estimate, names: tuple[str, ...]) -> Estimate:
    """The estimate with the springs' values, which are not correlated with the others, in the order of `names`.

    Parameters
    ----------
    estimate
        Of all names, without numbers for the springs.
    """
    values, covariance = estimate.values.copy(), estimate.covariance.copy()
    at = [names.index(name) for name in springs.names]
    values[at] = springs.values
    covariance[at] = covariance[:, at] = 0.0
    # N is nearly in proportion to the mass, and so are the springs
    mass = names.index("platform_mass") if "platform_mass" in names else None
    share = 0.0 if mass is None or np.isnan(covariance[mass, mass]) else covariance[mass, mass] / values[mass] ** 2
    covariance[np.ix_(at, at)] = springs.covariance + share * np.outer(springs.values, springs.values)
    scale = estimate.scale.copy()
    scale[at] = springs.scale
    none = np.zeros((len(springs.names), len(names)))
    none[:, at] = springs.directions
    sigma = np.concatenate([estimate.singular_values, springs.singular_values])
    order = np.argsort(-sigma)
    note = f"the legs' stretch is explained to {1e6 * float(springs.residuals.rms.max()):.2g} µm RMS"
    return replace(
        estimate,
        values=values,
        covariance=covariance,
        scale=scale,
        singular_values=sigma[order],
        directions=np.concatenate([estimate.directions, none])[order],
        rank=estimate.rank + springs.rank,
        notes=(*estimate.notes, note),
    )

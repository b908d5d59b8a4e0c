"""Elastic legs in logs: lengths at the motors' side and at the platform's, and the springs between them.

A log has the lengths of one side, or of both. The other side follows from the force on a leg's platform end, N, by the
inverse dynamics of the platform's side [model.dynamics]:

    k (s − L) + c (ṡ − L̇) = N,    so    s − L = N/k − (c/k²) Ṅ + (c²/k³) N̈ − …

with terms that fall by ω c/k, some thousandths. With both sides measured the springs follow by least squares; zeros of
the encoders do not matter. One side alone hardly shows them, near resonances only, so they get no number from it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.linalg import block_diag

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import (
    Channels,
    Estimate,
    estimate_of,
    expand_to_requested,
    nominal_values,
    on_one_axis,
)
from gough_stewart.harness.identify.log import Part
from gough_stewart.harness.identify.lowpass import cutoff_of, edge, smoothed
from gough_stewart.harness.identify.regressor import PER_LEG, smooth_motion, states_of, with_values
from gough_stewart.harness.identify.sticking_friction import resolved
from gough_stewart.model.dynamics import inverse_dynamics, leg_damping, platform_side
from gough_stewart.model.interface import Variant
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

SPRINGS = ("leg_stiffness", "leg_damping")
_FAST = "Fast motions show the damping of a spring: it delays the stretch behind the force by c/k"
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


@dataclass(frozen=True, eq=False)
class LegForces:
    """The motion of a part's platform, from which the forces on the ends of its legs follow."""

    motion: FloatArray  # pose, twist, acceleration (j, 18)
    knots: FloatArray  # their times [s]
    reached: slice  # rows of the part within their reach
    cutoff: float  # of the low-pass on the lengths [Hz]

    @classmethod
    def along(cls, part: Part, platform: Platform, cutoff: float | None) -> "LegForces":
        """The motion of a part, low-passed just above it, in a platform with these joints."""
        h = part.step
        cutoff = min(_OF_MOTION * (cutoff_of(part.length, h) if cutoff is None else cutoff), 0.25 / h)
        every, first = max(1, int(1 / (_ROWS_A_PERIOD * cutoff * h))), edge(h, cutoff)
        _, motion = smooth_motion(part, platform, cutoff, every)
        reached = slice(first, first + every * (len(motion) - 1) + 1)
        return cls(motion, part.time[reached][::every], reached, cutoff)

    def terms(self, platform: Platform, time: FloatArray) -> FloatArray:
        """N, Ṅ and N̈ (3, n, 6) at these times (n,) [s]."""
        force = inverse_dynamics(platform_side(Variant(springs=True), platform), *states_of(self.motion))
        spline = make_interp_spline(self.knots, np.asarray(force), k=5)
        return np.stack([spline(time, d) for d in range(3)])


def with_both_sides(parts: Sequence[Part], platform: Platform, cutoff: float | None) -> list[Part]:
    """The parts with lengths of the legs and of the motors, computed for the side that was not measured.

    Of a platform with rigid legs nothing changes: both sides are one.
    """
    if not Variant.of(platform).springs:
        return list(parts)
    completed = []
    for part in parts:
        if part.motor is None:
            forces = LegForces.along(part, platform, cutoff)
            part = part.rows(forces.reached)  # noqa: PLW2901 - the same part, as far as its forces reach
            stretch = _stretch_of(*_nominal_springs(platform), forces.terms(platform, part.time))
            if part.side == "motor":
                part = replace(part, length=part.length - stretch, motor=part.length, side="leg")  # noqa: PLW2901
            else:
                part = replace(part, motor=part.length + stretch)  # noqa: PLW2901
        completed.append(part)
    return completed


def _nominal_springs(platform: Platform) -> tuple[float, float]:
    """K and c of a platform, 0 of a rigid one."""
    if not platform.leg_stiffness > 0:
        return 0.0, 0.0
    return platform.leg_stiffness, float(np.asarray(leg_damping(platform))[0])


def _stretch_of(k: float, c: float, terms: FloatArray) -> FloatArray:
    """The stretch s − L [m] under leg forces with these derivatives; none of rigid legs."""
    return np.tensordot((1 / k, -c / k**2, c**2 / k**3), terms, 1) if k > 0 else 0.0 * terms[0]


def with_springs(
    masses: Estimate | None,
    parts: Sequence[Part],
    platform: Platform,
    names: tuple[str, ...],
    cutoff: float | None,
) -> Estimate:
    """The estimate of all names with the springs of the legs, under the forces of the platform that was found.

    `masses` is the estimate of all other names; without them the masses are the platform's.
    """
    wanted = tuple(name for name in names if name in SPRINGS)
    known = dict(zip(SPRINGS, _nominal_springs(platform), strict=True))
    others = nominal_values(names, resolved(platform))
    nominal = np.array([known.get(name, value) for name, value in zip(names, others, strict=True)])
    scale = nominal.copy()
    if masses is not None:
        sizes = dict(zip(masses.names, masses.scale.tolist(), strict=True))
        scale = np.array([sizes.get(name, 1.0) for name in names])
    try:
        springs, slopes = _springs_of(parts, platform, wanted, cutoff, masses)
    except IdentificationError as error:
        if masses is None:
            raise
        whole = expand_to_requested(masses, names, nominal, scale, (*masses.not_excited, *wanted))
        return replace(whole, notes=(*whole.notes, str(error)))
    whole, hidden = springs, [name for name in wanted if name not in springs.names]
    not_excited, notes = tuple(hidden), springs.notes
    if masses is not None:
        scale[[names.index(name) for name in springs.names]] = springs.scale
        # with their covariance with the masses, which make N
        C = np.nan_to_num(masses.covariance)
        mixed = slopes @ C
        sigma = np.concatenate([masses.singular_values, springs.singular_values])
        order = np.argsort(-sigma)
        not_excited = (*masses.not_excited, *hidden)
        notes = (
            *masses.notes,
            f"the legs' stretch is explained to {1e6 * float(springs.residuals.rms.max()):.2g} µm RMS",
        )
        whole = replace(
            masses,
            names=(*masses.names, *springs.names),
            values=np.concatenate([masses.values, springs.values]),
            covariance=np.block([[C, mixed.T], [mixed, springs.covariance + mixed @ slopes.T]]),
            freedom=min(masses.freedom, springs.freedom),
            singular_values=sigma[order],
            directions=block_diag(masses.directions, springs.directions)[order],
            rank=masses.rank + springs.rank,
        )
    if hidden:
        notes = (*notes, f"not shown by this log, so without a number: {', '.join(hidden)}. {_FAST}")
    return replace(expand_to_requested(whole, names, nominal, scale, not_excited), notes=notes)


def _springs_of(
    parts: Sequence[Part],
    nominal_platform: Platform,
    names: tuple[str, ...],
    cutoff: float | None,
    masses: Estimate | None,
) -> tuple[Estimate, FloatArray]:
    """The springs' estimate from logs with both sides, of those of these names that the logs show; and its slopes.

    The slopes (q, p) are derivatives by the other parameters, `masses`, whose values make N.
    """
    what = ", ".join(names)
    lacking = [part.where for part in parts if part.motor is None]
    if lacking:
        raise IdentificationError(
            f"{what}: not shown by {lacking[0]}, which has lengths on one side of the legs only; expected "
            "motor_position[1..6] beside leg_length[1..6]",
            names,
        )
    platform = nominal_platform if masses is None else masses.platform(nominal_platform)
    forces = [LegForces.along(part, platform, cutoff) for part in parts]
    times, readings = [], []
    for part, of_part in zip(parts, forces, strict=True):
        # the same low-pass for the stretch and for the force that makes it, at rows whose noise is hardly correlated
        h, reached = part.step, of_part.reached
        thin = max(1, int(1 / (_PER_PERIOD * of_part.cutoff * h)))
        low = smoothed(np.asarray(part.motor) - part.length, h, of_part.cutoff)
        readings.append(low[: reached.stop - reached.start : thin])
        times.append(part.time[reached][::thin])
    is_fitted = np.concatenate([part.is_fitted(time) for part, time in zip(parts, times, strict=True)])
    which = np.concatenate([np.full(len(time), part.which) for part, time in zip(parts, times, strict=True)])
    fitted_logs = np.unique(which[is_fitted])

    def about_zeros(signals: FloatArray) -> FloatArray:
        # the encoders of each leg count from a zero of their own in each log
        for log in np.unique(which):
            chosen = (which == log) & (is_fitted if log in fitted_logs else True)
            signals[..., which == log, :] -= signals[..., chosen, :].mean(axis=-2, keepdims=True)
        return signals

    def terms_of(machine: Platform) -> FloatArray:
        every = [of_part.terms(machine, time) for of_part, time in zip(forces, times, strict=True)]
        return about_zeros(np.concatenate(every, axis=1))

    stretch, terms = about_zeros(np.concatenate(readings)), terms_of(platform)
    S, fitted = stretch[is_fitted], terms[:, is_fitted]
    if float(np.abs(S).max()) < _NO_STRETCH:
        raise IdentificationError(
            f"{what}: motor_position and leg_length of this log do not differ; expected readings of both sides of the "
            "legs",
            names,
        )
    freedom = S.size - 6 * len(fitted_logs)
    a, b, errors, sigma = _least_squares(S, fitted, True, freedom)
    shown = b < 0 and errors[1] < _LARGEST_ERROR * abs(b)
    if not shown:
        a, b, errors, sigma = _least_squares(S, fitted, False, freedom)
    if not errors[0] < _LARGEST_ERROR * a:
        raise IdentificationError(
            f"{what}: not shown by this log: the legs' stretch does not follow their force; record a motion that "
            "changes the forces more, with finer encoders",
            names,
        )
    kept = tuple(name for name in names if name != "leg_damping" or shown)
    if not kept:
        raise IdentificationError(f"{what}: not shown by this log; record faster motions", names)

    def springs(a: float, b: float) -> FloatArray:
        return np.array([{"leg_stiffness": 1 / a, "leg_damping": -b / a**2}[name] for name in kept])

    k, c, scale = 1 / a, -b / a**2, springs(a, b)
    # the first two terms, differentiated
    N, dN, _ = fitted
    columns = {"leg_stiffness": -N / k**2 + 2 * c / k**3 * dN, "leg_damping": -dN / k**2}
    D = np.stack([(columns[name] * value).ravel() for name, value in zip(kept, scale, strict=True)], axis=1) / sigma
    residual, before = stretch - _stretch_of(k, c, terms), _stretch_of(*_nominal_springs(platform), terms)
    time, spans = on_one_axis(parts, times)
    estimate = estimate_of(
        kept,
        nominal_values(kept, platform),
        scale,
        scale,
        (),
        (D, residual[is_fitted].ravel() / sigma, freedom - len(kept)),
        Channels("stretch of leg", "m", time, stretch, residual, before, is_fitted, spans),
    )
    if masses is None:
        return estimate, np.zeros((len(kept), 0))
    slopes = np.zeros((len(kept), len(masses.names)))
    for j, (name, value, step) in enumerate(zip(masses.names, masses.values, masses.standard_errors, strict=True)):
        # friction and armature are on the motors' side, and make no N
        if step > 0 and name.partition("[")[0] not in (*PER_LEG, "leg_armature"):
            moved = terms_of(with_values(platform, {name: float(value + step)}))[:, is_fitted]
            slopes[:, j] = (springs(*_least_squares(S, moved, shown, freedom)[:2]) - scale) / step
    return estimate, slopes


def _least_squares(
    stretch: FloatArray, terms: FloatArray, has_damping: bool, freedom: int
) -> tuple[float, float, FloatArray, float]:
    """1/k, −c/k², their standard errors, and the standard deviation of the residual.

    `freedom` is the number of readings less zeros that were subtracted.
    """
    force, rate, curvature = terms.reshape(3, -1)
    D = np.stack([force, rate][: 1 + has_damping], axis=1)
    size = np.linalg.norm(D, axis=0)
    small = np.zeros_like(force)
    for _ in range(_ITERATIONS):
        x = np.linalg.lstsq(D / size, stretch.ravel() - small, rcond=None)[0] / size
        if has_damping:
            small = x[1] ** 2 / x[0] * curvature
    left = stretch.ravel() - small - D @ x
    variance = float(left @ left) / max(freedom - D.shape[1], 1)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(D.T @ D / np.outer(size, size)))) / size
    return float(x[0]), float(x[1]) if has_damping else 0.0, errors, max(float(np.sqrt(variance)), 1e-15)

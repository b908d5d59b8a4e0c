"""Identify parameters from a log by any method."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gough_stewart.harness.errors import IdentificationError, LogError
from gough_stewart.harness.identify.estimate import Estimate, nominal_values
from gough_stewart.harness.identify.fit_of_log import scales, with_all
from gough_stewart.harness.identify.geometry.joints import GEOMETRY, identify_geometry
from gough_stewart.harness.identify.linear import identify_linear
from gough_stewart.harness.identify.log import Log, log_of, read_log
from gough_stewart.harness.identify.names import expanded
from gough_stewart.harness.identify.not_shown import NOT_SHOWN, SHOWS, fit_of_shown
from gough_stewart.harness.identify.output_error import identify_output_error
from gough_stewart.harness.identify.parts import VALIDATION
from gough_stewart.harness.identify.rows.hypotheses import MASSES
from gough_stewart.harness.identify.rows.regression import cutoff_within_noise
from gough_stewart.harness.identify.rows.sticking import PRESLIDING, STICTION, ideal_of, resolved, sticks
from gough_stewart.harness.identify.screening.leg_order import check_order_of_forces
from gough_stewart.harness.identify.screening.observability import (
    MotionRows,
    check_separable,
    identifiability,
    is_linear,
    motion_rows,
)
from gough_stewart.harness.identify.screening.screening import Screened, screened
from gough_stewart.harness.identify.springs import FAST, SPRINGS, merged, nominal_springs, springs_of, with_both_sides
from gough_stewart.harness.results.record import Record
from gough_stewart.model.platform import Platform
from gough_stewart.model.variant import refuse_parts
from gough_stewart.model.vectors import FloatArray

AnyLog = Log | Record | Path | str
Method = Literal["linear", "output_error", "geometry"]
_METHODS: Mapping[str, Callable[..., Estimate]] = {
    "linear": identify_linear,
    "output_error": identify_output_error,
    "geometry": identify_geometry,
}


def identify(
    log: AnyLog | Sequence[AnyLog],
    platform: Platform,
    estimate: Sequence[str] | str,
    method: Method = "linear",
    *,
    validation: float | AnyLog | Sequence[AnyLog] = VALIDATION,
    **options: Any,
) -> Estimate:
    """Estimate parameters of a platform from a log, with confidence intervals.

    Parameters
    ----------
    log
        A file that `read_log` can read, a `Log`, or a `Record`; or several of one machine, which are fitted together.
    platform
        The nominal one: the source of all other parameters, and of starting values.
    estimate
        Parameters, or elements of them: a list, or a string with commas. `leg_viscous_friction` is one value for all
        legs, `leg_viscous_friction[1..6]` six. Also what the instruments do: `force_gain` and `force_offset` of each
        leg, reading = gain · force + offset [N]; `delay` of the forces [s], positive if they are late; `base_tilt`
        about X and Y [rad].
    method
        "linear" is least squares of inverse dynamics: masses, centres of mass, inertias, armature, friction;
        "output_error" simulates the plant and accepts any physical parameter, also `leg_friction_velocity`;
        "geometry" calibrates `base_points`, `platform_points` and `leg_length_offset` from measured poses at rest;
        it is chosen if only these are estimated.
    validation
        The share of each log, at its end, that is not fitted but validates the fit; or another log, or several, of
        which nothing is fitted.
    options
        Of the method: `cutoff` [Hz] of the filter; for "output_error" also `starts` and `seed`. For "geometry":
        `pose_frame` ("world", or "own" for a tracker with its own frame), `accuracy`, standard errors of leg length
        [m], position [m] and orientation [rad], and `nominal_error` [m], the uncertainty of the nominal geometry.

    Returns
    -------
    Estimate
        Values with standard errors, intervals and correlation, residuals, and reasons not to trust them.

    Raises
    ------
    LogError
        A log that cannot be evaluated, or that does not match this platform.
    IdentificationError
        Parameters that this method, or this log, cannot determine; names them.

    Examples
    --------
    >>> nominal, record = gs.load_preset("liu2000"), gs.run("circle_computed_torque", {"loop.duration": 4})
    >>> found = gs.identify(record, nominal, "platform_mass,leg_viscous_friction")
    >>> found.values, found.interval, found.platform(nominal).platform_mass
    """
    if method not in _METHODS:
        raise IdentificationError(f"method is {method!r}; expected one of {', '.join(_METHODS)}")
    names = estimate.split(",") if isinstance(estimate, str) else list(estimate)
    if method == "linear" and all(name.strip().partition("[")[0] in GEOMETRY for name in names):
        method = "geometry"
    if "pose_frame" in options and method != "geometry":
        raise IdentificationError(f"pose_frame is an option of method geometry only; this one is {method}")
    if method != "geometry":
        _check_parts(platform, method, [name.strip() for name in names])
    logs = _logs(log)
    if method == "geometry":
        if len(logs) != 1 or validation != VALIDATION:
            raise IdentificationError(
                f"method geometry takes one log of poses and no validation; found {len(logs)} logs, validation "
                f"{'of a log' if not isinstance(validation, float) else validation}"
            )
        return identify_geometry(logs[0], platform, names, **options)
    share, aside = (validation, []) if isinstance(validation, float | int) else (0.0, _logs(validation))
    # what is screened is the motion, and the forces that it needs but for friction
    smooth = ideal_of(platform)
    cutoff = options.pop("cutoff", None)
    if cutoff is None and sticks(platform):
        cutoff = min(cutoff_within_noise(each, smooth) for each in logs)
    found = screened(logs, smooth, share, aside, cutoff)
    check_order_of_forces(found.parts, smooth, found.cutoff)
    wanted = expanded(names, platform)
    stiffness, damping = PRESLIDING
    if stiffness in wanted and damping not in wanted:
        # a damping that is not known would pass for stiffness
        wanted = (*wanted, damping)
    springs = tuple(name for name in wanted if name in SPRINGS)
    others = tuple(name for name in wanted if name not in SPRINGS)
    measured = found.parts
    found = found._replace(parts=with_both_sides(measured, platform, found.cutoff))
    fit = _of_determined(_METHODS[method], found, platform, others, options) if others else None
    if fit is not None and found.parts != measured and all(part.log.motor_position is None for part in measured):
        # the other side once more, by the masses that were found
        found = found._replace(parts=with_both_sides(measured, fit.platform(platform), found.cutoff))
        fit = _of_determined(_METHODS[method], found, platform, others, options)
    if springs or fit is None:
        fit = _with_springs(fit, found._replace(parts=measured), platform, wanted, springs)
    return replace(fit, notes=(*found.notes, *fit.notes), alarms=(*found.alarms, *fit.alarms))


def _check_parts(platform: Platform, method: Method, names: Sequence[str]) -> None:
    """Refuse what a platform does not have, or a method cannot estimate."""
    lacking = [name for name in names if name.partition("[")[0] in (*STICTION, *PRESLIDING)]
    if lacking and not sticks(platform):
        raise IdentificationError(
            f"{lacking[0]}: friction of this platform does not stick; set its leg_friction_model = 'elasto_plastic' or "
            "'lugre'",
            lacking,
        )
    if method == "output_error":
        refuse_parts(platform, "method output_error", "use method linear")
    springs = [name for name in names if name in SPRINGS]
    if springs and not platform.leg_armature > 0 and "leg_armature" not in names:
        raise IdentificationError(
            f"{springs[0]}: leg_armature is 0, and legs that give need the mass of their motors; set it, or "
            "estimate it, too",
            springs,
        )


def _of_determined(
    method: Callable[..., Estimate],
    found: Screened,
    platform: Platform,
    names: tuple[str, ...],
    options: Mapping[str, Any],
) -> Estimate:
    """The fit of what the motion determines; the other elements get no number."""
    linear = [name for name in names if is_linear(name, platform)]
    smooth = ideal_of(platform)
    if linear:
        check_separable(smooth, linear)
    rows = motion_rows(found.parts, smooth, found.cutoff) if linear else None
    nominal = nominal_values(names, resolved(platform, names))
    if rows is None:
        fit, untold = fit_of_shown(
            lambda kept: method(found.parts, platform, kept, cutoff=found.cutoff, **options), names
        )
        size = scales(platform, names, 1.0, 1.0)
        return _with_note(with_all(fit, names, nominal, size, untold, np.zeros(len(names))), untold)
    scale = scales(platform, names, rows.force, rows.velocity)
    at = [names.index(name) for name in linear]
    values = nominal.copy()
    untold = _not_told(rows, smooth, names, scale)
    now = identifiability(rows, smooth, linear, values[at], scale[at])
    held: set[str] = set()
    unknown: set[str] = set()
    while True:
        held |= set(now.held)
        unknown |= {*now.held, *now.not_excited}
        kept = tuple(name for name in names if name not in held)
        if not kept:
            raise _not_excited(names)
        fit, not_shown = fit_of_shown(
            lambda kept: method(found.parts, platform, kept, cutoff=found.cutoff, not_excited=untold, **options), kept
        )
        held |= set(not_shown)
        values[[names.index(name) for name in fit.names]] = fit.values
        # what a motion determines of centres of mass and inertias depends on their values
        now = identifiability(rows, smooth, linear, values[at], scale[at])
        unknown |= set(now.not_excited)
        if set(now.held) <= held:
            break
    bias = np.zeros(len(names))
    bias[at] = now.bias * scale[at]
    hidden = [name for name in names if name in held and not is_linear(name, platform)]
    lacking = [name for name in names if name in unknown]
    if len(lacking) + len(hidden) == len(names):
        raise _not_excited(names)
    fit = _with_note(with_all(fit, names, nominal, scale, (*lacking, *hidden), bias), hidden)
    if lacking:
        note = (
            f"not excited by this motion, so without a number: {', '.join(lacking)}. A motion that excites them is "
            f"designed by gough-stewart excite --estimate {','.join(linear)}"
        )
        fit = replace(fit, notes=(*fit.notes, note))
    return fit


def _with_springs(
    fit: Estimate | None, found: Screened, platform: Platform, names: tuple[str, ...], springs: tuple[str, ...]
) -> Estimate:
    """The estimate of all names with the springs of the legs, under the forces of the platform that was found."""
    nominal = nominal_values(names, resolved(platform, names))
    known = dict(zip(SPRINGS, nominal_springs(platform), strict=True))
    nominal = np.array([known.get(name, value) for name, value in zip(names, nominal.tolist(), strict=True)])
    of_springs = nominal[[names.index(name) for name in springs]]
    if fit is None:
        own, hidden = springs_of(found.parts, platform, springs, of_springs, found.cutoff)
        return _with_note(with_all(own, names, nominal, nominal, hidden, np.zeros(len(names))), hidden, FAST)
    scale = np.array([dict(zip(fit.names, fit.scale.tolist(), strict=True)).get(name, 1.0) for name in names])
    try:
        own, hidden = springs_of(found.parts, fit.platform(platform), springs, of_springs, found.cutoff)
    except IdentificationError as error:
        every = with_all(fit, names, nominal, scale, (*fit.not_excited, *springs), np.zeros(len(names)))
        return replace(every, notes=(*every.notes, str(error)))
    every = with_all(fit, names, nominal, scale, (*fit.not_excited, *hidden), np.zeros(len(names)))
    return _with_note(merged(every, own, names), hidden, FAST)


def _with_note(fit: Estimate, hidden: Sequence[str], shows: str = SHOWS) -> Estimate:
    """The estimate with a remark on what of friction, or of springs, its log does not show, and which would."""
    return replace(fit, notes=(*fit.notes, f"{NOT_SHOWN}: {', '.join(hidden)}. {shows}")) if hidden else fit


def _not_told(rows: MotionRows, platform: Platform, names: Sequence[str], scale: FloatArray) -> tuple[str, ...]:
    """What of the platform's masses the motion does not excite, estimated or not."""
    others = [name for name in expanded(MASSES, platform) if name not in names]
    every = [*(name for name in names if is_linear(name, platform)), *others]
    sizes = dict(zip(names, scale.tolist(), strict=True))
    sizes |= dict(zip(others, scales(platform, others, rows.force, rows.velocity).tolist(), strict=True))
    of_every = np.array([sizes[name] for name in every])
    return identifiability(rows, platform, every, nominal_values(every, platform), of_every).not_excited


def _not_excited(names: Sequence[str]) -> IdentificationError:
    return IdentificationError(
        f"too little excitation: this motion determines none of {', '.join(names)}; record a motion designed for them "
        "(gough-stewart excite)",
        names,
    )


def _logs(given: AnyLog | Sequence[AnyLog]) -> list[Log]:
    """The logs of files and records; those of equal origin are told apart by a number."""
    each = [given] if isinstance(given, Log | Record | Path | str) else list(given)
    if not each:
        raise LogError("no logs; expected one or several")
    logs = [log_of(log) if isinstance(log, Record) else log if isinstance(log, Log) else read_log(log) for log in each]
    origins = [log.where for log in logs]
    return [
        replace(log, where=f"{log.where} {k + 1}") if origins.count(log.where) > 1 else log
        for k, log in enumerate(logs)
    ]

"""Identify parameters from a log by any method."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gough_stewart.harness.errors import IdentificationError, IdentificationWarning, LogError
from gough_stewart.harness.identify.estimate import Estimate, expand_to_requested, nominal_values
from gough_stewart.harness.identify.fit import identify_linear, judged, one_blas_thread, scales
from gough_stewart.harness.identify.geometry import GEOMETRY, PoseFrame, identify_geometry
from gough_stewart.harness.identify.lack_of_fit import MASSES, Whitened
from gough_stewart.harness.identify.log import VALIDATION, Log, check_poses, log_of, read_log
from gough_stewart.harness.identify.observability import Identifiability, check_separable, identifiability, motion_rows
from gough_stewart.harness.identify.regressor import expanded, is_linear
from gough_stewart.harness.identify.screen import Screened, compared_forces, cutoff_within_noise, screened
from gough_stewart.harness.identify.springs import SPRINGS, with_both_sides, with_springs
from gough_stewart.harness.identify.sticking_friction import COULOMB, STICTION, ideal_of, resolved, sticks
from gough_stewart.harness.results.record import Record
from gough_stewart.model.platform import Platform

AnyLog = Log | Record | Path | str
Method = Literal["linear", "geometry"]
_PRESLIDING = "presliding is set in the platform; of stiction, " + ", ".join((COULOMB, *STICTION)) + " are estimated"
# Parameters of the platform that a log of forces does not determine, and what serves instead.
_ELSEWHERE = {
    "gravity": "it is set in the platform; of a base that is out of level, estimate base_tilt",
    "leg_friction_velocity": "it is a constant that smooths the sign of Coulomb friction; set it in the platform",
    **dict.fromkeys(("leg_bristle_stiffness", "leg_bristle_damping", "leg_breakaway_share"), _PRESLIDING),
    **dict.fromkeys(
        GEOMETRY, f"{', '.join(GEOMETRY)} need measured poses: estimate them alone, from a log with position[1..3]"
    ),
}
# Static friction shows if its standard error, and that of its velocity, is at most this share of their values, and if
# it is above Coulomb friction by so many standard errors.
_LARGEST_ERROR, _SIGNIFICANT = 0.25, 4.0
_NOT_SHOWN = "not shown by this log, so without a number"
_SLOW = "Slow motions show static friction: some mm/s, and forces and lengths at 500 Hz or more"


@one_blas_thread()
def identify(
    log: AnyLog | Sequence[AnyLog],
    platform: Platform,
    estimate: Sequence[str] | str,
    method: Method = "linear",
    *,
    validation: float | AnyLog | Sequence[AnyLog] = VALIDATION,
    cutoff: float | None = None,
    pose_frame: PoseFrame | None = None,
    accuracy: tuple[float, float, float | None] | None = None,
    nominal_error: float | None = None,
) -> Estimate:
    """Estimate parameters of a platform from a log, with confidence intervals.

    Its `alarms` list reasons not to trust the result; each is also issued as an `IdentificationWarning`.

    Parameters
    ----------
    log
        A file that `read_log` can read, a `Log`, or a `Record`; or several of one machine, which are fitted together.
    platform
        The nominal one: the source of all other parameters, and of starting values.
    estimate
        Parameters, or elements of them: a list, or a string with commas. `leg_viscous_friction` is one value for all
        legs, `leg_viscous_friction[1..6]` six. Also instrument parameters: `force_gain` and `force_offset` of each
        leg, reading = gain · force + offset [N]; `delay` of the forces [s], positive if they are late; `base_tilt`
        about X and Y [rad].
    method
        "linear" is least squares of inverse dynamics: masses, centres of mass, inertias, armature, friction;
        "geometry" calibrates `base_points`, `platform_points` and `leg_length_offset` from measured poses at rest;
        it is chosen if only these are estimated.
    validation
        The share of each log, at its end, that is not fitted but validates the fit; or another log, or several, of
        which nothing is fitted.
    cutoff
        Of the filter [Hz], for "linear"; from the log by default.
    pose_frame
        For "geometry": "world", the default, or "own" for a tracker with its own frame.
    accuracy
        For "geometry": standard errors of leg length [m], position [m] and orientation [rad].
    nominal_error
        For "geometry": the uncertainty of the nominal geometry [m].

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

    See Also
    --------
    read_log, excite, before_and_after, Estimate

    Examples
    --------
    >>> nominal, record = gs.load_preset("liu2000"), gs.run("circle_computed_torque", {"loop.duration": 4})
    >>> estimate = gs.identify(record, nominal, "platform_mass,leg_viscous_friction")
    >>> estimate.values, estimate.interval, estimate.platform(nominal).platform_mass
    """
    if method not in ("linear", "geometry"):
        raise IdentificationError(
            f"method is {method!r}; expected linear, for masses, friction and instruments, or geometry, for joints and "
            "offsets of lengths"
        )
    names = [name.strip() for name in (estimate.split(",") if isinstance(estimate, str) else estimate)]
    if all(name.partition("[")[0] in GEOMETRY for name in names):
        method = "geometry"
    options: dict[str, Any] = {"pose_frame": pose_frame, "accuracy": accuracy, "nominal_error": nominal_error}
    foreign = {"cutoff": cutoff} if method == "geometry" else options
    for name, value in foreign.items():
        if value is not None:
            other = "linear" if method == "geometry" else "geometry"
            raise IdentificationError(f"{name} is an option of method {other} only; this one is {method}")
    if method == "linear":
        result = _identified_from_forces(log, platform, names, validation, cutoff)
    else:
        logs = _logs(log)
        if len(logs) != 1 or validation != VALIDATION:
            raise IdentificationError(
                f"method geometry takes one log of poses and no validation; found {len(logs)} logs, validation "
                f"{'of a log' if not isinstance(validation, float) else validation}"
            )
        if pose_frame != "own":
            check_poses(logs[0], platform)
        result = identify_geometry(
            logs[0], platform, names, **{name: value for name, value in options.items() if value is not None}
        )
    for alarm in result.alarms:
        warnings.warn(f"values and intervals are not to be trusted: {alarm}", IdentificationWarning, stacklevel=3)
    return result


def _logs(logs: AnyLog | Sequence[AnyLog]) -> list[Log]:
    """The logs of files and records; those of equal origin are told apart by a number."""
    sources = [logs] if isinstance(logs, Log | Record | Path | str) else logs
    read = [log_of(s) if isinstance(s, Record) else s if isinstance(s, Log) else read_log(s) for s in sources]
    if not read:
        raise LogError("no logs; expected one or several")
    origins = [log.where for log in read]
    return [
        replace(log, where=f"{log.where} {k + 1}") if origins.count(log.where) > 1 else log
        for k, log in enumerate(read)
    ]


def _identified_from_forces(
    log: AnyLog | Sequence[AnyLog],
    platform: Platform,
    estimate: Sequence[str],
    validation: float | AnyLog | Sequence[AnyLog],
    cutoff: float | None,
) -> Estimate:
    """The estimate by the linear method: the logs are screened, brought to both sides of elastic legs, and fitted."""
    names = expanded(estimate)
    for name in names:
        stem = name.partition("[")[0]
        if stem in _ELSEWHERE:
            raise IdentificationError(f"{name} is not estimated from forces: {_ELSEWHERE[stem]}", [name])
    lacking = [name for name in names if name in STICTION]
    if lacking and not sticks(platform):
        raise IdentificationError(
            f"{lacking[0]}: friction of this platform does not stick; set its leg_friction_model = 'elasto_plastic' or "
            "'lugre'",
            lacking,
        )
    springs = [name for name in names if name in SPRINGS]
    if springs and not platform.leg_armature > 0 and "leg_armature" not in names:
        raise IdentificationError(
            f"{springs[0]}: leg_armature is 0, and elastic legs need the mass of their motors; set it, or "
            "estimate it, too",
            springs,
        )
    logs = _logs(log)
    share, aside = (validation, []) if isinstance(validation, float | int) else (0.0, _logs(validation))
    # what is screened is the motion, and the forces that it needs but for friction
    smooth = ideal_of(platform)
    if cutoff is None and sticks(platform):
        cutoff = min(cutoff_within_noise(recorded, smooth) for recorded in logs)
    usable = screened(logs, smooth, share, aside, cutoff)
    alarms = [*usable.alarms, *compared_forces(usable.parts, smooth, usable.cutoff)]
    without_springs = tuple(name for name in names if name not in SPRINGS)
    fit = None
    if without_springs:
        sides = usable._replace(parts=with_both_sides(usable.parts, platform, usable.cutoff))
        is_first = sides.parts != usable.parts and all(part.motor is None for part in usable.parts)
        fit = _fit_of_determined(sides, platform, without_springs, is_judged=not is_first)
        if is_first:
            # the other side once more, by the masses that were found
            sides = usable._replace(parts=with_both_sides(usable.parts, fit.platform(platform), usable.cutoff))
            fit = _fit_of_determined(sides, platform, without_springs)
    if fit is None or len(without_springs) < len(names):
        fit = with_springs(fit, usable.parts, platform, names, usable.cutoff)
    return replace(fit, notes=(*usable.notes, *fit.notes), alarms=(*alarms, *fit.alarms))


def _fit_of_determined(
    usable: Screened, platform: Platform, names: tuple[str, ...], *, is_judged: bool = True
) -> Estimate:
    """The fit of what the motion determines; the other elements get no number."""
    linear = [name for name in names if is_linear(name, platform)]
    smooth = ideal_of(platform)
    if linear:
        check_separable(smooth, linear)
    rows = motion_rows(usable.parts, smooth, usable.cutoff) if linear else None
    nominal, at = nominal_values(names, resolved(platform)), [names.index(name) for name in linear]
    changes = (rows.force, rows.velocity) if rows else (1.0, 1.0)
    scale, not_excited = scales(platform, names, *changes), tuple[str, ...]()
    if rows:
        # what of the platform's masses the motion does not excite, estimated or not
        masses = [name for name in expanded(MASSES) if name not in names]
        elements, sizes = [*linear, *masses], np.concatenate([scale[at], scales(platform, masses, *changes)])
        not_excited = identifiability(rows, smooth, elements, nominal_values(elements, smooth), sizes).not_excited

    found: tuple[Estimate, Whitened] | None = None
    values, held, unknown = nominal.copy(), set[str](), set[str]()
    now = Identifiability(np.zeros(len(linear)), (), ())
    while True:
        if rows:
            # what a motion determines of centres of mass and inertias depends on their values
            now = identifiability(rows, smooth, linear, values[at], scale[at])
        unknown |= {*now.held, *now.not_excited}
        if found is not None and set(now.held) <= held:
            break
        held |= set(now.held)
        remaining = tuple(name for name in names if name not in held)
        if not remaining:
            found = None
            break
        found, hidden = _fit_of_shown(usable, platform, remaining, not_excited)
        held |= set(hidden)
        values[[names.index(name) for name in found[0].names]] = found[0].values
    hidden = tuple(name for name in names if name in held and not is_linear(name, platform))
    lacking = [name for name in names if name in unknown]
    if found is None or len(lacking) + len(hidden) == len(names):
        raise IdentificationError(
            f"too little excitation: this motion determines none of {', '.join(names)}; record a motion designed for "
            "them (gough-stewart excite)",
            names,
        )
    bias = np.zeros(len(names))
    bias[at] = now.bias * scale[at]
    fit = judged(*found) if is_judged else found[0]
    fit = expand_to_requested(fit, names, nominal, scale, (*lacking, *hidden), bias)
    notes = [f"{_NOT_SHOWN}: {', '.join(hidden)}. {_SLOW}"] if hidden else []
    if lacking:
        notes.append(
            f"not excited by this motion, so without a number: {', '.join(lacking)}. A motion that excites them is "
            f"designed by gough-stewart excite --estimate {','.join(linear)}"
        )
    return replace(fit, notes=(*fit.notes, *notes))


def _fit_of_shown(
    usable: Screened, platform: Platform, names: tuple[str, ...], not_excited: Sequence[str] = ()
) -> tuple[tuple[Estimate, Whitened], tuple[str, ...]]:
    """The fit and its rows, without static friction if the log does not show it; and elements that so have no number.

    Inverse dynamics is not linear in it, so that only a fit says what its log determines. Refuses if nothing is left.
    """
    options: dict[str, Any] = {"cutoff": usable.cutoff, "not_excited": not_excited}
    try:
        fit, rows = identify_linear(usable.parts, platform, names, **options)
        # static friction needs the velocity over which it falls, and is significantly above Coulomb friction
        of_static = [k for k, name in enumerate(names) if name in STICTION]
        is_shown = bool((fit.standard_errors[of_static] <= _LARGEST_ERROR * fit.values[of_static]).all())
        coulomb = [k for k, name in enumerate(names) if name.partition("[")[0] == COULOMB]
        if STICTION[0] in names and coulomb:
            difference = np.zeros(len(names))
            difference[coulomb] = -1 / len(coulomb)
            difference[names.index(STICTION[0])] = 1.0
            spread = float(np.sqrt(difference @ fit.covariance @ difference))
            is_shown &= bool(difference @ fit.values > _SIGNIFICANT * spread)
        hidden = () if is_shown else tuple(names[k] for k in of_static)
    except IdentificationError as error:
        if not set(error.names) & set(STICTION):
            raise
        hidden = tuple(name for name in names if name in STICTION)
    if not hidden:
        return (fit, rows), ()
    remaining = tuple(name for name in names if name not in hidden)
    if not remaining:
        raise IdentificationError(f"{_NOT_SHOWN}: {', '.join(names)}. {_SLOW}", names)
    return identify_linear(usable.parts, platform, remaining, **options), hidden

"""Identify parameters from a log by any method."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.geometry import GEOMETRY, identify_geometry
from gough_stewart.harness.identify.linear import identify_linear
from gough_stewart.harness.identify.log import Log, log_of, read_log
from gough_stewart.harness.identify.output_error import identify_output_error
from gough_stewart.harness.results.record import Record
from gough_stewart.model.platform import Platform

Method = Literal["linear", "output_error", "geometry"]
_METHODS: Mapping[str, Callable[..., Estimate]] = {
    "linear": identify_linear,
    "output_error": identify_output_error,
    "geometry": identify_geometry,
}


def identify(
    log: Log | Record | Path | str,
    platform: Platform,
    estimate: Sequence[str] | str,
    method: Method = "linear",
    **options: Any,
) -> Estimate:
    """Estimate parameters of a platform from a log, with confidence intervals.

    Parameters
    ----------
    log
        A file that `read_log` can read, a `Log`, or a `Record`.
    platform
        The nominal one: the source of all other parameters, and of starting values.
    estimate
        Parameters, or elements of them: a list, or a string with commas. `leg_viscous_friction` is one value for all
        legs, `leg_viscous_friction[1..6]` six.
    method
        "linear" is least squares of inverse dynamics: masses, centres of mass, inertias, armature, friction;
        "output_error" simulates the plant and accepts any physical parameter, also `leg_friction_velocity`;
        "geometry" calibrates `base_points`, `platform_points` and `leg_length_offset` from measured poses at rest;
        it is chosen if only these are estimated.
    options
        Of the method: `cutoff` [Hz] of the filter, `validation`, the share of the log for validation; for
        "output_error" also `starts` and `seed`. For "geometry": `pose_frame` ("world", or "own" for a tracker with its
        own frame), `accuracy`, standard errors of leg length [m], position [m] and orientation [rad], and
        `nominal_error` [m], the uncertainty of the nominal geometry.

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
    if isinstance(log, Record):
        log = log_of(log)
    elif not isinstance(log, Log):
        log = read_log(log)
    return _METHODS[method](log, platform, names, **options)

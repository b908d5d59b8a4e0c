"""A motion that excites parameters: Fourier coefficients for the best-conditioned regressor within all limits."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from gough_stewart.harness.errors import IdentificationError, ReachError
from gough_stewart.harness.identify.fit import scales_of
from gough_stewart.harness.identify.names import expanded, value_of
from gough_stewart.harness.identify.regression import Rows
from gough_stewart.harness.identify.regressor import (
    FRICTION,
    elements_of,
    gradient,
    linear_parameters,
    regressor,
    with_estimated,
)
from gough_stewart.harness.motion.excitation import Excitation
from gough_stewart.harness.motion.limits.reach import check_reach
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.errors import ArgumentError
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import StepProgress
from gough_stewart.model.process.toml import toml_item
from gough_stewart.model.state import State
from gough_stewart.model.vectors import FloatArray

Criterion = Literal["condition", "determinant"]
ESTIMATE = ("platform_mass", "platform_com", "platform_inertia", *FRICTION)
# The motion uses at most this share of every limit; the controller needs the rest.
_SHARE = 0.9
# Initial amplitudes: shares of the platform's size, and of a radian.
_LARGEST = (0.3, 0.3)
# Rows per period of the highest harmonic: for the regressor, and for the final check of limits.
_COARSE, _FINE = 6, 40
_BISECTIONS = 7
_FIRST = 0.3  # share of the trials that are independent; the others vary the best one
# Bandwidth of the tracking loop: a few times the highest frequency of the motion.
_ABOVE = 6.0


class Excited(NamedTuple):
    """The best motion found."""

    reference: Excitation
    condition_number: float  # of the regressor with scaled columns
    log_determinant: float  # of the information matrix per row, likewise


def excite(
    platform: Platform,
    estimate: Sequence[str] | str = ESTIMATE,
    *,
    duration: float = 20.0,
    frequency: float = 0.1,
    harmonics: int = 5,
    fade: float = 1.0,
    criterion: Criterion = "condition",
    trials: int = 150,
    seed: int = 0,
    status: StepProgress | None = None,
) -> Excited:
    """Find Fourier coefficients whose motion excites these parameters best, within all limits of the platform.

    Every trial is scaled to the limits of stroke, joint angles, velocity, force, power and condition number, less a
    reserve of a tenth; the best trial is then varied at random in decreasing steps. Equal seeds give equal motions.

    Parameters
    ----------
    estimate
        Parameters, or elements of them, in which inverse dynamics is linear.
    duration, fade
        [s]
    frequency, harmonics
        Frequency of the first harmonic [Hz], and number of harmonics.
    criterion
        "condition", the regressor's condition number; or "determinant", that of its information matrix (D-optimal).
    trials
        Number of motions tried.
    status
        Called with the best result so far.

    Returns
    -------
    Excited
        `reference`, the motion as an `Excitation`; `condition_number` of the regressor with scaled columns, and
        `log_determinant` of its information matrix per row.

    Raises
    ------
    IdentificationError
        A nonlinear parameter, by name; or no motion was found that excites these parameters.

    Examples
    --------
    >>> found = gs.excite(gs.load_preset("liu2000"), "platform_mass,platform_com", duration=6, trials=4)
    >>> found.reference.duration, found.condition_number < 100
    """
    if trials < 1:
        raise ArgumentError(f"trials is {trials}; expected at least 1 motion to try")
    names = expanded(estimate.split(",") if isinstance(estimate, str) else estimate, platform)
    rng = np.random.default_rng(seed)
    size = np.repeat([_LARGEST[0] * platform.characteristic_length, _LARGEST[1]], 3)
    steps = int(np.ceil(_COARSE * duration * frequency * harmonics)) + 1
    time = np.linspace(0.0, duration, steps)

    def reference_of(coefficients: FloatArray) -> Excitation:
        a, b = coefficients
        return Excitation(
            frequency=frequency,
            duration=duration,
            fade=fade,
            position_sine=a[:, :3].tolist(),
            position_cosine=b[:, :3].tolist(),
            orientation_sine=a[:, 3:].tolist(),
            orientation_cosine=b[:, 3:].tolist(),
        )

    def keeps(scale: float, coefficients: FloatArray, at: FloatArray) -> bool:
        return within_limits(platform, at, reference_of(scale / _SHARE * coefficients).about(platform)(at))

    best: tuple[float, FloatArray, float, float] | None = None
    independent = max(1, int(_FIRST * trials))
    for k in range(trials):
        drawn = rng.standard_normal((2, harmonics, 6)) * size / np.sqrt(2 * harmonics)
        if best is not None and k >= independent:
            spread = 0.5 * 0.02 ** ((k - independent) / max(1, trials - independent))
            drawn = best[1] + spread * np.sqrt((best[1] ** 2).mean(axis=(0, 1))) * rng.standard_normal(drawn.shape)
        scale = _largest(lambda s, c=drawn: keeps(s, c, time))  # type: ignore[misc]
        if scale == 0:
            continue
        coefficients = scale * drawn
        motion = reference_of(coefficients).about(platform)(time)
        number, determinant = criteria(platform, names, time, motion)
        cost = number if criterion == "condition" else -determinant
        if best is None or cost < best[0]:
            best = (cost, coefficients, number, determinant)
            if status is not None:
                status(f"condition number {number:.3g}")
    if best is None or not np.isfinite(best[2]):
        raise IdentificationError(
            f"no motion was found within the limits of {platform.name} that excites {', '.join(names)}; estimate fewer "
            "parameters, or try more motions or harmonics",
            names,
        )
    fine = np.linspace(0.0, duration, int(np.ceil(_FINE * duration * frequency * harmonics)) + 1)
    coefficients = best[1] * _largest(lambda s: keeps(s, best[1], fine))
    reference = reference_of(np.round(coefficients, 6))
    return Excited(reference, *criteria(platform, names, time, reference.about(platform)(time)))


def criteria(platform: Platform, names: Sequence[str], time: FloatArray, motion: Motion) -> tuple[float, float]:
    """Condition number of a motion's regressor, and log det(Dᵀ D/n), with scaled columns."""
    state, acceleration = State(*motion[:4]), Acceleration(*motion[4:])
    W = regressor(platform, state, acceleration)
    elements = with_estimated(elements_of(platform), names, [value_of(platform, name) for name in names])
    rows = Rows(time, W @ linear_parameters(elements), W, 0.0, np.ones((len(time), 6)))
    D = (W @ (gradient(elements, names) * scales_of(rows, platform, names))).reshape(-1, len(names))
    sigma = np.linalg.svd(D / np.sqrt(len(time)), compute_uv=False)
    force = float(np.sqrt((rows.force**2).mean()))
    with np.errstate(divide="ignore"):
        number = float(sigma[0] / sigma[-1]) if sigma[-1] > 1e-12 * sigma[0] else float("inf")
        return number, float(2 * np.log(sigma / force).sum())


def within_limits(platform: Platform, time: FloatArray, motion: Motion) -> bool:
    """Whether a motion keeps all limits, including that of force."""
    try:
        check_reach(platform, time, motion)
    except ReachError:
        return False
    if platform.actuator_force_max is None:
        return True
    force = inverse_dynamics(platform, State(*motion[:4]), Acceleration(*motion[4:]))
    return bool(np.abs(force).max() <= platform.actuator_force_max)


def _largest(keeps: Callable[[float], bool]) -> float:
    """The largest factor on the amplitudes, up to 1, that keeps the limits; 0 if none was found."""
    if keeps(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low


_TEXT = """\
# Written by `gough-stewart excite` with --seed {seed}: finite Fourier series in six coordinates that excite
#   {names}
# Condition number of their regressor: {number:.3g}.

title = {title}
description = "motion for identification, computed torque"

[platform]
{platform}

[reference]
type = "excitation"
frequency = "{frequency!r} Hz"
duration = "{duration!r} s"
fade = "{fade!r} s"
# a row for each harmonic: x, y, z [m]; roll, pitch, yaw [rad]
{coefficients}

[controller]
type = "pd"
bandwidth = "{bandwidth:g} Hz"
damping_ratio = 0.8
feedforward = "computed_torque"

[loop]
duration = "{duration!r} s"
sample_time = "1 ms"

[sensors]
quantisation = {{ leg_length = "1 um" }}
"""


def experiment_text(found: Excited, platform: Platform, chosen: str, names: str, seed: int) -> str:
    """The TOML text; `chosen` is the line that names the platform."""
    reference = found.reference
    sine, cosine = reference.coefficients
    parts = {"position_sine": sine[:, :3], "position_cosine": cosine[:, :3]}
    parts |= {"orientation_sine": sine[:, 3:], "orientation_cosine": cosine[:, 3:]}
    title = "excitation of " + platform.name
    return _TEXT.format(
        seed=seed,
        names=names,
        number=found.condition_number,
        title=toml_item(title).as_string(),
        platform=chosen,
        frequency=float(reference.frequency),
        duration=float(reference.duration),
        fade=float(reference.fade),
        coefficients="\n".join(f"{name} = {toml_item(values).as_string()}" for name, values in parts.items()),
        bandwidth=max(1.0, _ABOVE * reference.highest_frequency),
    )

"""Gains of PD and PID from bandwidth and damping, by the linear model of the platform."""

import math
from typing import Any

import numpy as np

from gough_stewart.harness.control.laws import Space
from gough_stewart.harness.control.linear import leg_space_mass
from gough_stewart.harness.control.pid import Gains
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray

DAMPING_RATIO = 0.7


def gains_from_bandwidth(
    platform: Platform,
    bandwidth: float,
    damping_ratio: float = DAMPING_RATIO,
    space: Space = "leg",
    integral_time: float | None = None,
    derivative_filter: float | None = None,
    anti_windup_time: float | None = None,
) -> Gains:
    """Gains for equal behaviour in all channels: kp = m ωn², kd = 2 ζ m ωn, and with an integral time ki = kp / Ti.

    ωn = 2π · bandwidth. In leg space m is the largest eigenvalue of J⁻ᵀ M J⁻¹, the mass at the legs in the heaviest
    mode at home. Mode k then has ωn √(m/m_k) and ζ √(m/m_k): lighter modes are better damped, and where that exceeds 1
    their slow pole tends to ωn/(2 ζ). In task space each axis has its own m, the diagonal of M, and all behave alike.

    Parameters
    ----------
    bandwidth
        Undamped natural frequency of the heaviest mode [Hz].
    damping_ratio
        ζ of that mode.
    space
        "leg", or "task" for control of the pose.
    integral_time
        Ti [s]; the loop is stable for Ti > 1 / (2 ζ ωn). None: no integral action.
    derivative_filter, anti_windup_time
        As in `Gains` [s].

    Returns
    -------
    Gains
        Each (6,): kp [N/m], kd [N s/m] and ki [N/(m s)], equal for all legs; in task space of x, y, z and, per rad, of
        the rotations.

    Raises
    ------
    ControllerError
        Not positive, or an integral time that makes the loop unstable.

    Examples
    --------
    >>> gains = gs.gains_from_bandwidth(gs.load_preset("motion_base"), bandwidth=2.0, damping_ratio=0.8)
    >>> gains.proportional[0], gains.derivative[0]
    """
    for name, value in (("bandwidth", bandwidth), ("damping_ratio", damping_ratio)):
        if not (math.isfinite(value) and value > 0):
            raise ControllerError(f"{name} is {value!r}; expected a number > 0")
    omega = 2 * math.pi * bandwidth
    shortest = 1 / (2 * damping_ratio * omega)
    if integral_time is not None and not integral_time > shortest:
        raise ControllerError(
            f"integral_time is {integral_time:g} s; expected more than {shortest:.3g} s = 1/(2 ζ ωn), below which the "
            f"loop is unstable, say {10 * shortest:.2g} s"
        )
    m = modal_masses(platform, space)
    kp, kd, ki = gains_of_masses(m, bandwidth, damping_ratio, math.inf if integral_time is None else integral_time)
    return Gains(kp, kd, ki, derivative_filter, anti_windup_time)


def modal_masses(platform: Platform, space: Space) -> FloatArray:
    """The mass m of each channel (6,) [kg], or of task space [kg, kg m²], see `gains_from_bandwidth`."""
    if space == "task":
        return np.diag(mass_matrix(platform, platform.home_position, platform.home_orientation))
    return np.full(6, np.linalg.eigvalsh(leg_space_mass(platform)).max())


def gains_of_masses(m: Any, bandwidth: Any, damping_ratio: Any, integral_time: Any) -> tuple[Any, Any, Any]:
    """Gains kp = m ωn², kd = 2 ζ m ωn, ki = kp/Ti, of numbers or symbols; an infinite Ti is no integral action."""
    omega = 2 * math.pi * bandwidth
    kp = m * omega**2
    return kp, 2 * damping_ratio * m * omega, kp / integral_time

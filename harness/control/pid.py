"""PD and PID in six channels: their gains, also from bandwidth and damping, and their systems, continuous and sampled.

Channel i of a leg-space controller, with e = r − y [m], F [N]:

    F = kp e + kd s/(Tf s + 1) (e or −y) + x,   ẋ = ki e + (1/Tt) (F_limited − F)

kp, kd, ki in N/m, N s/m, N/(m s); the last term (back-calculation) keeps x from winding up while a limit is active.
Åström & Hägglund, Advanced PID Control (2006), §3.3 to §3.5. A task-space controller has the same form, with the pose
error as e [m, rad] and a wrench [N, N m] instead of F.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.control.linear_controller import Space
from gough_stewart.harness.control.state_space import Method, StateSpace, discretised, is_control_system, state_space_of
from gough_stewart.harness.errors import ControllerError
from gough_stewart.model import interface
from gough_stewart.model.dynamics import mass_matrix, solve_leg_forces
from gough_stewart.model.kinematics import leg_jacobian
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import Array, FloatArray, greater, less, minimum, where

if TYPE_CHECKING:
    import control

DerivativeOn = Literal["error", "measurement"]
N_CHANNELS = 6
# By this factor the derivative filter is faster than the derivative itself (N in textbooks).
FILTER_RATIO = 20.0
DAMPING_RATIO = 0.7


@dataclass(frozen=True)
class Gains:
    """Gains of six channels, each one number or six numbers; no integral action by default.

    Raises
    ------
    ControllerError
        Gains that are negative or not finite, a proportional gain of 0, or a time constant that is not positive.

    Examples
    --------
    >>> gains = gs.Gains(proportional=2e5, derivative=[2e4, 2e4, 2e4, 1e4, 1e4, 1e4])
    """

    proportional: ArrayLike
    """kp, a number or (6,) [N/m]; in task space [N/m, N m/rad]."""
    derivative: ArrayLike
    """kd, a number or (6,) [N s/m]; in task space [N s/m, N m s/rad]."""
    integral: ArrayLike = 0.0
    """ki, a number or (6,) [N/(m s)]; in task space [N/(m s), N m/(rad s)]."""
    derivative_filter: float | None = None
    """Tf [s]; kd / (20 kp) of the fastest channel by default."""
    anti_windup_time: float | None = None
    """Tt [s]; √(Ti Td) by default, Ti = kp/ki, Td = kd/kp."""
    filter_time: float = field(init=False, repr=False)
    """Tf, also by default [s]."""
    tracking_time: FloatArray = field(init=False, repr=False)
    """Tt of each channel, also by default (6,) [s]."""
    channels: tuple[FloatArray, ...] = field(init=False, repr=False)
    """kp [N/m], kd [N s/m], ki [N/(m s)], Tf [s] and Tt [s] of each channel, each (6,)."""

    def __post_init__(self) -> None:
        for name in ("proportional", "derivative", "integral"):
            value = getattr(self, name)
            try:
                array = np.array(value, dtype=float)
            except (TypeError, ValueError):
                raise ControllerError(f"{name} gain is {value!r}; expected a number, or six of them") from None
            if array.shape not in ((), (N_CHANNELS,)):
                raise ControllerError(f"{name} gain has shape {array.shape}; expected a number, or six of them")
            is_proportional = name == "proportional"
            if not np.isfinite(array).all() or (array < 0).any() or (is_proportional and not array.all()):
                least = "> 0" if is_proportional else ">= 0"
                raise ControllerError(f"{name} gain is {value!r}; expected finite numbers {least}")
            object.__setattr__(self, name, np.broadcast_to(array, N_CHANNELS).copy())
        gains = tuple(np.asarray(value) for value in (self.proportional, self.derivative, self.integral))
        times = []
        names = ("derivative_filter", "anti_windup_time")
        for name, default in zip(names, default_times(*gains), strict=True):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ControllerError(f"{name} is {value!r}; expected a time > 0 s")
            times.append(np.full(N_CHANNELS, default if value is None else value))
        object.__setattr__(self, "filter_time", float(times[0][0]))
        object.__setattr__(self, "tracking_time", times[1])
        object.__setattr__(self, "channels", (*gains, *times))


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
    Pole placement as in Åström & Hägglund, Advanced PID Control (2006), chapter 6.

    Parameters
    ----------
    platform
        The nominal platform, whose mass matrix at home the gains use.
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
        A value that is not positive, or an integral time that makes the loop unstable.

    See Also
    --------
    pid, Gains, PD, PID

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


@lru_cache(4)  # members that differ in their bandwidth have the same platform
def modal_masses(platform: Platform, space: Space) -> FloatArray:
    """The mass m of each channel (6,) [kg], or of task space [kg, kg m²], see `gains_from_bandwidth`; read-only."""
    home = platform.home_position, platform.home_orientation
    M = mass_matrix(platform, *home)
    if space == "task":
        return np.diag(M)  # a view that cannot be written to
    # row k of the solution is J⁻ᵀ e_k, so the rows form J⁻¹; at rest and without gravity (J⁻ᵀ M J⁻¹) L̈ = F
    J_inverse = solve_leg_forces(leg_jacobian(platform, *home).T, np.eye(6))
    return np.broadcast_to(np.linalg.eigvalsh(J_inverse.T @ M @ J_inverse).max(), 6)


def gains_of_masses(m: Any, bandwidth: Any, damping_ratio: Any, integral_time: Any) -> tuple[Any, Any, Any]:
    """Gains kp = m ωn², kd = 2 ζ m ωn, ki = kp/Ti, of numbers or symbols; an infinite Ti is no integral action."""
    omega = 2 * math.pi * bandwidth
    kp = m * omega**2
    return kp, 2 * damping_ratio * m * omega, kp / integral_time


def default_times(kp: Array, kd: Array, ki: Array) -> tuple[Array, Array]:
    """Tf (1,) and Tt of each channel (6,) [s] by default, of numbers or of symbols.

    Tf is a share of the fastest channel's kd/kp, Tt is √(Ti Td), or Ti without derivative action.
    """
    times = where(greater(kd, 0.0), kd / kp, np.inf)
    shortest = times[:1]
    for k in range(1, N_CHANNELS):
        shortest = minimum(shortest, times[k : k + 1])
    # any value if there is no derivative
    filter_time = where(less(shortest, np.inf), shortest / FILTER_RATIO, 1.0)
    integral_time = kp / where(greater(ki, 0.0), ki, 1.0)
    return filter_time, where(greater(kd, 0.0), np.sqrt(integral_time * kd / kp), integral_time)


def pid(gains: Gains, derivative_on: DerivativeOn = "error") -> "control.StateSpace":
    """Six channels of PD, or of PID with anti-windup where an integral gain is set; continuous.

    With e = r − y [m], F = kp e + kd s/(Tf s + 1) (e or −y) + x, ẋ = ki e + (F_limited − F)/Tt [N]. Inputs:
    reference_leg_length[1..6], leg_length[1..6], and of PID limit_excess[1..6] (force after the limits minus force
    before them). Outputs: actuator_force[1..6]. Åström & Hägglund, Advanced PID Control (2006), sections 3.3 to 3.5.

    Parameters
    ----------
    gains
        From `gains_from_bandwidth`, or chosen by hand.
    derivative_on
        "error" follows moving references without lag; "measurement" avoids the derivative kick at a step.

    Returns
    -------
    control.StateSpace
        A state for the derivative filter and one for the integrator of each channel that has them.

    Raises
    ------
    ControllerError
        `derivative_on` is neither "error" nor "measurement".

    See Also
    --------
    gains_from_bandwidth, sampled, Gains

    Examples
    --------
    >>> continuous = gs.pid(gs.Gains(proportional=2e5, derivative=2e4), "measurement")
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=gs.sampled(continuous, 1e-3))
    """
    from control import ss

    system = channel_matrices(gains.channels, derivative_on)
    kinds = ["reference_leg_length", "leg_length", "limit_excess"][: system.D.shape[1] // N_CHANNELS]
    return ss(
        *system.blocks,
        inputs=[f"{kind}[{k + 1}]" for kind in kinds for k in range(N_CHANNELS)],
        outputs=list(interface.BY_NAME["actuator_force"].scalar_names),
        name="controller",
    )


def channel_matrices(
    channels: Sequence[Array],  # kp, kd, ki, Tf and Tt, each (n,)
    derivative_on: DerivativeOn,
    acts: Sequence[Any] | None = None,  # which channels differentiate, and which integrate; those with gains by default
) -> StateSpace:
    """`pid` of any number of channels, of numbers or of CasADi symbols in object arrays.

    A channel's states are the filter's, ż = v − z/Tf with v = e or −y, whose derivative kd s/(Tf s + 1) v is
    kd/Tf (v − z/Tf); and x. A channel has only the states of its actions.
    """
    if derivative_on not in get_args(DerivativeOn):
        raise ControllerError(f"derivative_on is {derivative_on!r}; expected 'error' or 'measurement'")
    differentiates, integrates = acts or [np.asarray(gain) > 0 for gain in channels[1:3]]
    size, n_kinds = len(channels[0]), 3 if integrates.any() else 2
    # inputs (r, y, excess) of a channel; the derivative acts on v = d · (r, y, excess)
    error = np.array([1.0, -1.0, 0.0])[:n_kinds]
    d = error if derivative_on == "error" else np.array([0.0, -1.0, 0.0])[:n_kinds]
    identity = np.eye(size)
    kind = channels[0].dtype
    poles, B, C, D = [], [], [], np.zeros((size, n_kinds, size), dtype=kind)
    for k in range(size):
        # (1,) each: a bare symbol would treat an array as a matrix
        kp, kd, ki, filter_time, tracking_time = (values[k : k + 1] for values in channels)
        D[k, :, k] = kp * error
        if differentiates[k]:
            high, pole = kd / filter_time, -1 / filter_time
            D[k, :, k] += high * d
            poles.append(pole)
            B.append(np.outer(d, identity[k]))
            C.append(high * pole * identity[k])
        if integrates[k]:
            poles.append(0 * kp)
            B.append(np.outer(np.concatenate([ki, -ki, 1 / tracking_time]), identity[k]))
            C.append(identity[k])
    n, m = len(poles), n_kinds * size
    return StateSpace(
        np.diag(np.concatenate([np.zeros(0, dtype=kind), *poles])),
        # order: all references, all measurements, all excesses
        np.reshape(np.array(B, dtype=kind), (n, m)),
        np.reshape(np.array(C, dtype=kind), (n, size)).T,
        D.reshape(size, m),
    )


def sampled(system: Any, sample_time: float, method: Method = "tustin") -> "control.StateSpace":
    """Discretise a continuous system at a sample time [s] by python-control's `sample_system`; names are kept.

    Parameters
    ----------
    system
        A continuous linear python-control system.
    sample_time
        [s]
    method
        "tustin", "backward_diff" or "zoh".

    Returns
    -------
    control.StateSpace
        In discrete time, with the sample time as `dt` [s].

    Raises
    ------
    ControllerError
        Not a continuous linear system, or a sample time that is not positive.

    See Also
    --------
    pid, LinearController

    Examples
    --------
    >>> continuous = gs.pid(gs.Gains(proportional=2e5, derivative=2e4))
    >>> gs.sampled(continuous, 1e-3).dt
    0.001
    """
    from control import ss

    named = system if is_control_system(system) else ss(system)
    discrete = discretised(state_space_of(named, "the system"), sample_time, method)
    labels = {"inputs": named.input_labels, "outputs": named.output_labels, "name": named.name}
    return ss(*discrete.blocks, sample_time, **labels)

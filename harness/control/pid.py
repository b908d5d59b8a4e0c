"""Controllers as python-control systems: continuous PD and PID in six channels, then sampled.

Channel i of a leg-space controller, with e = r − y [m], F [N]:

    F = kp e + kd s/(Tf s + 1) (e or −y) + x,   ẋ = ki e + (1/Tt) (F_limited − F)

kp, kd, ki in N/m, N s/m, N/(m s); the last term (back-calculation) keeps x from winding up while a limit acts.
Åström & Hägglund, Advanced PID Control (2006), §3.3 to §3.5. A task-space controller has the same form, with the pose
error as e [m, rad] and a wrench [N, N m] in the place of F.
"""

from dataclasses import dataclass
from typing import Any, Literal

import control
import numpy as np
from numpy.typing import ArrayLike

from gough_stewart.harness.errors import ControllerError
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

DerivativeOn = Literal["error", "measurement"]
Method = Literal["tustin", "backward_diff", "zoh"]
METHODS: tuple[Method, ...] = ("tustin", "backward_diff", "zoh")
N_CHANNELS = 6
# A filter of the derivative this much faster than the derivative itself (N of the textbooks).
FILTER_RATIO = 20.0


@dataclass(frozen=True)
class Gains:
    """Gains of six channels; numbers, or six of them. Without integral action by default."""

    proportional: ArrayLike  # kp [N/m]; in task space [N/m, N m/rad]
    derivative: ArrayLike  # kd [N s/m]
    integral: ArrayLike = 0.0  # ki [N/(m s)]
    derivative_filter: float | None = None  # Tf [s]; kd / (20 kp) of the fastest channel by default
    anti_windup_time: float | None = None  # Tt [s]; √(Ti Td) by default, Ti = kp/ki, Td = kd/kp

    def __post_init__(self) -> None:
        for name in ("proportional", "derivative", "integral"):
            object.__setattr__(self, name, _channels(name, getattr(self, name)))
        for name in ("derivative_filter", "anti_windup_time"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ControllerError(f"{name} is {value!r}; expected a time > 0 s")

    @property
    def filter_time(self) -> float:
        """Tf [s]."""
        if self.derivative_filter is not None:
            return self.derivative_filter
        active = np.asarray(self.derivative)[np.asarray(self.derivative) > 0]
        if not active.size:
            return 1.0  # of a derivative that is not there
        return (
            float((np.asarray(self.derivative) / self.proportional)[np.asarray(self.derivative) > 0].min())
            / FILTER_RATIO
        )

    @property
    def tracking_time(self) -> FloatArray:
        """Tt of each channel [s]."""
        if self.anti_windup_time is not None:
            return np.full(N_CHANNELS, self.anti_windup_time)
        kp, kd, ki = (np.asarray(v) for v in (self.proportional, self.derivative, self.integral))
        integral_time = kp / np.where(ki > 0, ki, 1.0)
        return np.where(kd > 0, np.sqrt(integral_time * kd / kp), integral_time)


def pid(gains: Gains, derivative_on: DerivativeOn = "error") -> control.StateSpace:
    """Six channels of PD, or of PID with anti-windup where a gain is integral; continuous.

    Inputs: reference_leg_length[1..6], leg_length[1..6], and of PID limit_excess[1..6] (force after the limits minus
    force before them). Outputs: actuator_force[1..6]. Source: the module's formula.

    Raises
    ------
    ControllerError
        `derivative_on` is neither "error" nor "measurement".
    """
    if derivative_on not in ("error", "measurement"):
        raise ControllerError(f"derivative_on is {derivative_on!r}; expected 'error' or 'measurement'")
    with_integral = bool(np.any(np.asarray(gains.integral) > 0))
    channels = [_channel(gains, k, derivative_on, with_integral) for k in range(N_CHANNELS)]
    together = control.append(*channels)
    # append has the inputs channel by channel; wanted are all references, then all measurements, …
    n = channels[0].ninputs
    order = np.arange(n * N_CHANNELS).reshape(N_CHANNELS, n).T.ravel()
    kinds = ["reference_leg_length", "leg_length", "limit_excess"][:n]
    return control.ss(
        together.A,
        together.B[:, order],
        together.C,
        together.D[:, order],
        inputs=[f"{kind}[{k + 1}]" for kind in kinds for k in range(N_CHANNELS)],
        outputs=list(interface.BY_NAME["actuator_force"].scalar_names),
        name="controller",
    )


def sampled(system: Any, sample_time: float, method: Method = "tustin") -> control.StateSpace:
    """The continuous system at a sample time [s], by python-control's `sample_system`; names are kept.

    Raises
    ------
    ControllerError
        The sample time is not > 0, the method is unknown, or a pole of the system is faster than the samples can tell:
        by Tustin's rule it would ring from sample to sample.
    """
    if not (np.isfinite(sample_time) and sample_time > 0):
        raise ControllerError(f"sample_time is {sample_time!r}; expected a time > 0 s")
    if method not in METHODS:
        raise ControllerError(f"discretisation is {method!r}; expected one of {', '.join(METHODS)}")
    system = control.ss(system)
    poles = system.poles()
    fastest = float(np.abs(poles).max(initial=0.0))
    if method == "tustin" and fastest * sample_time > 2:
        raise ControllerError(
            f"the controller has a time constant of {1 / fastest:.3g} s, shorter than half its sample time of "
            f"{sample_time:g} s; expected a derivative_filter of at least {sample_time / 2:.3g} s, a shorter "
            "sample_time, or discretisation = 'backward_diff'"
        )
    discrete = control.sample_system(system, sample_time, method=method)
    return control.ss(
        discrete.A,
        discrete.B,
        discrete.C,
        discrete.D,
        sample_time,
        inputs=system.input_labels,
        outputs=system.output_labels,
        name=system.name,
    )


def _channel(gains: Gains, k: int, derivative_on: DerivativeOn, with_integral: bool) -> Any:
    kp, kd, ki = (np.asarray(v)[k] for v in (gains.proportional, gains.derivative, gains.integral))
    # inputs (r, y); the derivative acts on v = d · (r, y)
    error, d = np.array([[1.0, -1.0]]), np.array([[1.0, -1.0]] if derivative_on == "error" else [[0.0, -1.0]])
    rate = control.ss(control.tf([kd, 0], [gains.filter_time, 1]))
    system = control.ss([], [], [], kp * error)
    if kd > 0:
        system = system + control.ss(rate.A, rate.B @ d, rate.C, rate.D @ d)
    if not with_integral:
        return system
    # inputs (r, y, excess)
    padded = control.ss(system.A, np.pad(system.B, ((0, 0), (0, 1))), system.C, np.pad(system.D, ((0, 0), (0, 1))))
    if not ki > 0:
        return padded
    return padded + control.ss([[0.0]], [[ki, -ki, 1 / gains.tracking_time[k]]], [[1.0]], [[0.0, 0.0, 0.0]])


def _channels(name: str, value: Any) -> FloatArray:
    """A gain of each channel."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ControllerError(f"{name} gain is {value!r}; expected a number, or six of them") from None
    if array.shape not in ((), (N_CHANNELS,)):
        raise ControllerError(f"{name} gain has shape {array.shape}; expected a number, or six of them")
    smallest = ">= 0" if name != "proportional" else "> 0"
    if not np.isfinite(array).all() or (array < 0).any() or (name == "proportional" and not (array > 0).all()):
        raise ControllerError(f"{name} gain is {value!r}; expected finite numbers {smallest}")
    return np.broadcast_to(array, N_CHANNELS).copy()

"""Controllers at work: from what is wanted and measured at a sample to six forces."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.state_space import Solve, is_control_system, state_space_of
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface
from gough_stewart.model.vectors import FloatArray

N_LEGS = 6
# (1 − z)² of a pole that integrates: by 1e-6 of itself at most, it leaks in a sample.
_INTEGRATES = 1e-12
Space = Literal["leg", "task"]


class Sample(NamedTuple):
    """What a controller that is a function gets at a sample; signals by name, in SI units.

    Names are position, orientation, velocity, angular_velocity, leg_length, leg_velocity.

    Examples
    --------
    >>> def law(sample: gs.Sample):
    ...     error = sample.reference["leg_length"] - sample.measured["leg_length"]
    ...     return 8e4 * error - 9e3 * sample.measured["leg_velocity"]
    >>> record = gs.run("heave_step", {"loop.duration": 0.1}, controller=law)
    """

    time: float
    """[s]"""
    reference: Mapping[str, FloatArray]
    """What is wanted, with acceleration and angular_acceleration beside the signals."""
    measured: Mapping[str, FloatArray]
    """What the sensors say."""


_ACCELERATIONS = (interface.BY_NAME["acceleration"], interface.BY_NAME["angular_acceleration"])
ControlFunction = Callable[[Sample], Any]


@dataclass(frozen=True)
class LinearController:
    """A discrete python-control system as controller.

    In leg space its inputs are, for n the size of the signals together: the errors reference − measured (n), or
    references and measurements (2 n), or these and the excess of the limits at the last sample (2 n + 6; force after
    the limits minus force before them, for anti-windup). Its outputs are the six actuator forces.

    In task space measurements are displacements as far as legs tell, y = Σ J⁻¹ ΔL over the samples since the start, [m]
    and [rad] about the world's axes, whose rate is the twist J⁻¹ L̇; references are y + J⁻¹ (L_reference − L), so that
    errors are J⁻¹ (L_reference − L). The outputs are a wrench w [N, N m], from which F = J⁻ᵀ w. J is the leg Jacobian
    in the reference pose at each sample.

    Raises
    ------
    ControllerError
        Not a linear python-control system, not of these sizes, or not discrete.
    """

    system: Any
    signals: tuple[str, ...] = ("leg_length",)
    space: Space = "leg"

    def __post_init__(self) -> None:
        object.__setattr__(self, "system", state_space_of(self.system))
        object.__setattr__(self, "signals", tuple([self.signals] if isinstance(self.signals, str) else self.signals))
        if self.space not in ("leg", "task"):
            raise ControllerError(f"space is {self.space!r}; expected 'leg' or 'task'")
        if self.space == "task" and self.signals != ("leg_length",):
            raise ControllerError("a controller in task space takes the signal leg_length, from which it has the pose")
        n = len(signals.positions(self.signals))
        sizes = (n, 2 * n, 2 * n + N_LEGS)
        if self.system.ninputs not in sizes or self.system.noutputs != N_LEGS:
            raise ControllerError(
                f"controller has {self.system.ninputs} inputs and {self.system.noutputs} outputs; expected for the "
                f"signals {', '.join(self.signals)} {sizes[0]} inputs (errors), {sizes[1]} (references, measurements) "
                f"or {sizes[2]} (and what the limits cut off), and {N_LEGS} outputs (forces)"
            )
        for name in "ABCD":
            if not np.isfinite(getattr(self.system, name)).all():
                raise ControllerError(f"the controller's matrix {name} has elements that are not finite")
        if self.system.nstates and not self.system.dt:
            raise ControllerError(
                "controller is in continuous time; expected discrete time: sample it, for instance by "
                "control.sample_system(controller, 1e-3, method='tustin')"
            )

    @property
    def sample_time(self) -> float | None:
        """Of the system [s]; None where it names none (a static gain)."""
        return None if self.system.dt in (None, True, 0) else float(self.system.dt)

    def check_sample_time(self, sample_time: float) -> None:
        """Refuse a loop of another sample time [s] than the controller was made for.

        Raises
        ------
        ControllerError
            Names both.
        """
        own = self.sample_time
        if own is not None and abs(own - sample_time) > 1e-9 * sample_time:
            raise ControllerError(
                f"the controller's sample time is {own:g} s, the loop's {sample_time:g} s; sample the controller anew, "
                "or set the loop's sample_time"
            )


Controller = LinearController | UnitController | ControlFunction


class Law(Protocol):
    """A controller in a run, with its memory."""

    @property
    def used(self) -> tuple[str, ...]:
        """The signals it looks at."""

    @property
    def state(self) -> FloatArray:
        """Its memory (n_states,)."""

    @property
    def limited(self) -> "NDArray[np.bool_] | None":
        """Which forces (6,) it has limited itself; None where it leaves that to the actuators."""

    def force(self, k: int, time: float, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        """Forces (6,) [N] at sample k, from references (30,), measurements (24,) and the last excess (6,) [N].

        References are all signals and then the accelerations [m/s², rad/s²]; the excess is what limits cut off.
        """


def controller_of(given: Any) -> Controller:
    """A controller from what a user has: itself, a function, the path of an FMU, or a python-control system.

    Such a system is fed with leg lengths.

    Raises
    ------
    ControllerError
        As `LinearController`.
    """
    if isinstance(given, LinearController | UnitController):
        return given
    if isinstance(given, Path | str):
        return UnitController(Path(given))
    # python-control's systems can be called, too: with a frequency
    if callable(given) and not is_control_system(given):
        return given  # type: ignore[no-any-return]
    return LinearController(given)


def signals_of(controller: Controller) -> tuple[str, ...]:
    """The signals that a controller looks at; a function may look at all."""
    return controller.signals if isinstance(controller, LinearController) else signals.NAMES


def law_of(
    controller: Controller, sample_time: float, jacobians: FloatArray, wanted: FloatArray, measured: FloatArray
) -> Law:
    """A controller made ready for a run; one that is a unit is opened instead.

    Parameters
    ----------
    sample_time
        Of the run [s].
    jacobians
        Leg Jacobians (n, 6, 6) in the reference poses of all samples.
    wanted, measured
        References and measurements at the first sample (24,): the controller's memory starts as if both had stood
        there for ever, its integrators at zero. So a start off the reference gives no kick of the derivative.

    Raises
    ------
    ControllerError
        The controller was made for another sample time.
    """
    if isinstance(controller, UnitController):
        raise ControllerError("a controller that is a unit has to be opened, and closed after the run")
    if not isinstance(controller, LinearController):
        return _FunctionLaw(controller)
    controller.check_sample_time(sample_time)
    return (_TaskLaw if controller.space == "task" else _LegLaw)(controller, jacobians, wanted, measured)


class _LinearLaw:
    """x⁺ = A x + B u, w = C x + D u; both at once, as one product with (x, u)."""

    limited = None

    def __init__(self, controller: LinearController) -> None:
        system = controller.system
        n = system.nstates
        self._matrix = np.ascontiguousarray(np.block([[system.A, system.B], [system.C, system.D]]))
        self._xu = np.zeros(n + system.ninputs)
        self._x, self._u = self._xu[:n], self._xu[n:]  # views
        self.used = signals_of(controller)
        self._at = _as_slice(signals.positions(controller.signals))
        self._form = system.ninputs

    def _start(self, wanted: FloatArray, measured: FloatArray) -> None:
        """Memory at rest under constant inputs."""
        self._feed(wanted, measured, np.zeros(N_LEGS))
        n = len(self._x)
        A = self._matrix[:n, :n]
        self._x[:] = rest(A, integrating_modes(A), self._matrix[:n, n:] @ self._u)

    @property
    def state(self) -> FloatArray:
        return self._x.copy()

    def _feed(self, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> None:
        n = len(wanted)
        if self._form == n:
            np.subtract(wanted, measured, out=self._u)
            return
        self._u[:n], self._u[n : 2 * n] = wanted, measured
        if self._form > 2 * n:
            self._u[2 * n :] = excess

    def _advance(self) -> FloatArray:
        n = len(self._x)
        both: FloatArray = self._matrix @ self._xu
        self._x[:] = both[:n]
        return both[n:]


class _LegLaw(_LinearLaw):
    def __init__(
        self, controller: LinearController, _jacobians: FloatArray, wanted: FloatArray, measured: FloatArray
    ) -> None:
        super().__init__(controller)
        self._start(wanted[self._at], measured[self._at])

    def force(self, _k: int, _time: float, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        self._feed(wanted[self._at], measured[self._at], excess)
        return self._advance()


class _TaskLaw(_LinearLaw):
    def __init__(
        self, controller: LinearController, jacobians: FloatArray, wanted: FloatArray, measured: FloatArray
    ) -> None:
        super().__init__(controller)
        self._J = jacobians
        self._J_inverse = np.linalg.inv(jacobians)
        self._lengths = measured[self._at].copy()
        self._pose = np.zeros(N_LEGS)
        self._start(self._J_inverse[0] @ (wanted[self._at] - self._lengths), self._pose)

    def force(self, k: int, _time: float, wanted: FloatArray, measured: FloatArray, excess: FloatArray) -> FloatArray:
        lengths = measured[self._at]
        # J⁻¹ dL summed up: its rate is the twist J⁻¹ L̇, which that of J⁻¹ (L − L₀) is not where J changes
        self._pose = self._pose + self._J_inverse[k] @ (lengths - self._lengths)
        self._lengths = lengths.copy()
        # w = Jᵀ F also for what the limits cut off
        self._feed(self._pose + self._J_inverse[k] @ (wanted[self._at] - lengths), self._pose, self._J[k].T @ excess)
        return np.asarray(self._J_inverse[k].T @ self._advance())


class _FunctionLaw:
    limited = None

    def __init__(self, function: ControlFunction) -> None:
        self._function = function
        self.used = signals_of(function)

    @property
    def state(self) -> FloatArray:
        return np.zeros(0)

    def force(self, _k: int, time: float, wanted: FloatArray, measured: FloatArray, _excess: FloatArray) -> FloatArray:
        reference = interface.unpack((*signals.VARIABLES, *_ACCELERATIONS), wanted.copy())
        try:
            given = self._function(Sample(time, reference, interface.unpack(signals.VARIABLES, measured.copy())))
        except (Exception, SystemExit) as error:  # a user's code may fail in any way
            raise ControllerError(
                f"the control function failed at time {time:g} s with {type(error).__name__}: {error}"
            ) from error
        try:
            force = np.array(given)
        except ValueError:  # ragged
            force = np.zeros(0)
        if force.dtype.kind not in "iuf" or force.shape != (N_LEGS,):
            raise ControllerError(f"the control function gave {given!r} at time {time:g} s; expected {N_LEGS} forces")
        return force.astype(float)


def rest(A: Any, integrating: FloatArray, forcing: Any, solve: Solve = np.linalg.solve) -> Any:
    """State x = A x + forcing in the modes that have one; zero in integrators, on which `integrating` projects."""
    P = integrating
    return solve(np.eye(len(A)) - A + P, forcing - P @ forcing)


def integrating_modes(A: FloatArray) -> FloatArray:
    """Projection (n, n) on the modes whose eigenvalue is 1, along the others."""
    N = np.eye(len(A)) - A
    # on the null space of N² (N alone misses double integrators) along its range
    U, sizes, Vt = np.linalg.svd(N @ N)
    null = sizes < _INTEGRATES
    R, L = Vt[null].T, U[:, null]
    return np.asarray(R @ np.linalg.solve(L.T @ R, L.T))


def _as_slice(positions: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """A slice where positions follow each other, which NumPy takes out faster."""
    first, last = int(positions[0]), int(positions[-1])
    return slice(first, last + 1) if positions.tolist() == list(range(first, last + 1)) else positions

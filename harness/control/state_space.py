"""Linear systems as plain matrices, all that a controller needs in a run.

python-control designs and analyses systems; importing it takes as long as a run of ten seconds.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.errors import ControllerError
from gough_stewart.model.vectors import FloatArray

Method = Literal["tustin", "backward_diff", "zoh"]
METHODS: tuple[Method, ...] = get_args(Method)
Solve = Callable[[Any, Any], Any]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """ẋ = A x + B u or, at a sample time dt > 0 [s], x⁺ = A x + B u; y = C x + D u. Named as in python-control."""

    A: FloatArray  # (n, n)
    B: FloatArray  # (n, inputs)
    C: FloatArray  # (outputs, n)
    D: FloatArray  # (outputs, inputs)
    dt: float = 0.0

    @property
    def blocks(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A, B, C and D."""
        return self.A, self.B, self.C, self.D

    def poles(self) -> NDArray[np.complex128]:
        """The eigenvalues of A (n,)."""
        return np.asarray(np.linalg.eigvals(self.A), dtype=complex)

    def isdtime(self, strict: bool = True) -> bool:  # noqa: ARG002 - python-control's, whose systems may be in either
        """Whether it is in discrete time."""
        return self.dt > 0


def stacked_blocks(system: Any) -> FloatArray:
    """[C D; A B] (outputs + n, n + inputs)."""
    upper, lower = (np.concatenate(blocks, axis=1) for blocks in ((system.C, system.D), (system.A, system.B)))
    return np.concatenate([upper, lower])


def is_control_system(value: Any) -> bool:
    """Whether it is a python-control system."""
    # such a system exists only if the package is imported; do not import it otherwise
    package = sys.modules.get("control")
    return package is not None and isinstance(value, package.InputOutputSystem)


def state_space_of(system: Any, role: str = "controller") -> Any:
    """The state space of a linear system: itself, ours or python-control's, or that of a transfer function."""
    if isinstance(system, StateSpace):
        return system
    if is_control_system(system):
        import control

        if isinstance(system, control.StateSpace):
            return system
        if isinstance(system, control.TransferFunction):
            # element by element: of a matrix python-control would need slycot
            elements = []
            for i, j in np.ndindex(system.noutputs, system.ninputs):
                above, below = len(system.num[i][j]) - 1, len(system.den[i][j]) - 1
                if above > below:
                    raise ControllerError(
                        f"{role} has an improper transfer function, of degree {above} over {below}, which needs the "
                        "future; expected at most the denominator's: of a PD kp + kd s use gs.PD, or give it a filter "
                        "and sample it: gs.sampled(control.tf([kd + kp * Tf, kp], [Tf, 1]), sample_time)"
                    )
                elements.append(control.ss(control.tf(system.num[i][j], system.den[i][j], system.dt)))
            # element (i, j) is driven by input j and adds to output i
            drives = np.tile(np.eye(system.ninputs), (system.noutputs, 1))
            adds = np.repeat(np.eye(system.noutputs), system.ninputs, axis=1)
            diagonal = control.append(*elements)
            A, B, C, D = diagonal.A, diagonal.B @ drives, adds @ diagonal.C, adds @ diagonal.D @ drives
            return control.ss(A, B, C, D, system.dt)
    raise ControllerError(
        f"{role} is {type(system).__name__}; expected a control.StateSpace or TransferFunction in discrete time, "
        "or a function of a Sample"
        + ("; settings take it: {'controller': …}" if hasattr(system, "feedforward") else "")
    )


def discretised(system: StateSpace, sample_time: float, method: Method = "tustin") -> StateSpace:
    """The continuous system at a sample time T [s].

    tustin: s = 2/T (z − 1)/(z + 1); backward_diff: s = (z − 1)/(T z); zoh: exact for held inputs. The states are those
    of python-control's `sample_system`.
    """
    if system.dt:
        raise ControllerError(f"the system is already discrete (dt = {system.dt:g} s); expected a continuous one")
    if not (np.isfinite(sample_time) and sample_time > 0):
        raise ControllerError(f"sample_time is {sample_time!r}; expected a time > 0 s")
    if method not in METHODS:
        raise ControllerError(f"discretisation is {method!r}; expected one of {', '.join(METHODS)}")
    fastest = float(np.abs(np.linalg.eigvals(system.A)).max(initial=0.0))
    if method == "tustin" and fastest * sample_time > 2:
        raise ControllerError(
            f"the controller has a time constant of {1 / fastest:.3g} s, shorter than half its sample time of "
            f"{sample_time:g} s; expected a derivative_filter of at least {sample_time / 2:.3g} s, a shorter "
            "sample_time, or discretisation = 'backward_diff'"
        )
    return matrices_at(system, sample_time, method)


def matrices_at(system: StateSpace, sample_time: Any, method: Method, solve: Solve = np.linalg.solve) -> StateSpace:
    """`discretised` without its checks, for numbers or for CasADi symbols in arrays with their own `solve`."""
    T, poles, (n, m) = sample_time, np.diag(system.A), system.B.shape
    if method != "zoh":
        # x⁺ = x + T ((1 − α) ẋ + α ẋ⁺), in the state w = (1 − α T A) x − α T B u, which makes it explicit
        alpha = 0.5 if method == "tustin" else 1.0
        identity = np.eye(n)
        implicit = identity - alpha * T * system.A
        A: Any = solve(implicit, identity + (1 - alpha) * T * system.A)
        B: Any = solve(implicit, T * system.B)
        C: Any = solve(implicit.T, system.C.T)
        return StateSpace(A, B, C.T, system.D + alpha * (system.C @ B), T)
    # [A_d B_d; 0 1] = exp([A B; 0 0] T)
    if not np.any(system.A[~np.eye(n, dtype=bool)]):
        # element by element: (e^(pT) − 1)/p without cancellation near 1, and T for p = 0
        half = poles * T / 2
        grown = 2 * np.exp(half) * np.sinh(half)
        is_zero = [p.is_zero() if hasattr(p, "is_zero") else p == 0 for p in poles]  # no symbol is
        columns = zip(is_zero, poles, grown, T + 0 * poles, strict=True)
        phi = np.array([t if zero else g / p for zero, p, g, t in columns], dtype=poles.dtype)
        return StateSpace(np.diag(np.exp(poles * T)), phi[:, None] * system.B, system.C, system.D, T)
    # exp(M) = exp(M/2ˢ)^(2ˢ) by the series of a norm below ½: without SciPy, which every run would have to import
    M = np.block([[system.A, system.B], [np.zeros((m, n + m))]]) * T
    halvings = max(0, math.frexp(float(np.linalg.norm(M, 1)))[1] + 1)
    term = total = np.eye(n + m)
    for k in range(1, 19):
        term = term @ M / (k * 2.0**halvings)
        total = total + term
    held = np.linalg.matrix_power(total, 2**halvings)
    return StateSpace(held[:n, :n], held[:n, n:], system.C, system.D, T)


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """The output of one system as the input of another; states of the first come first. For numbers or symbols."""
    none = np.zeros((len(first.A), len(second.A)))
    return StateSpace(
        np.block([[first.A, none], [second.B @ first.C, second.A]]),
        np.concatenate([first.B, second.B @ first.D]),
        np.concatenate([second.D @ first.C, second.C], axis=1),
        second.D @ first.D,
        first.dt,
    )

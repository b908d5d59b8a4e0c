"""Linear controllers in a run, in leg and in task space; their initial state."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.state_space import Solve
from gough_stewart.harness.plants import signals
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.control.laws import LinearController

N_LEGS = 6
# Limit on (1 − z)² of a pole that counts as an integrator: it leaks at most 1e-6 of itself per sample.
_INTEGRATES = 1e-12


class LinearLaw:
    """x⁺ = A x + B u, w = C x + D u, computed as one product with (x, u)."""

    limited = None

    def __init__(self, controller: "LinearController") -> None:
        system = controller.system
        n = system.nstates
        self._matrix = np.ascontiguousarray(np.block([[system.A, system.B], [system.C, system.D]]))
        self._xu = np.zeros(n + system.ninputs)
        self._x, self._u = self._xu[:n], self._xu[n:]  # views
        self.used = controller.signals
        self._at = as_slice(signals.positions(controller.signals))
        self._form = system.ninputs

    def _start(self, reference: FloatArray, measured: FloatArray) -> None:
        """Set the steady state under constant inputs."""
        self._feed(reference, measured, np.zeros(N_LEGS))
        n = len(self._x)
        A = self._matrix[:n, :n]
        self._x[:] = rest(A, integrating_modes(A), self._matrix[:n, n:] @ self._u)

    @property
    def state(self) -> FloatArray:
        """A copy of x (n,)."""
        return self._x.copy()

    def _feed(self, reference: FloatArray, measured: FloatArray, excess: FloatArray) -> None:
        n = len(reference)
        if self._form == n:
            np.subtract(reference, measured, out=self._u)
            return
        self._u[:n], self._u[n : 2 * n] = reference, measured
        if self._form > 2 * n:
            self._u[2 * n :] = excess

    def _advance(self) -> FloatArray:
        n = len(self._x)
        both: FloatArray = self._matrix.dot(self._xu)  # faster than @
        self._x[:] = both[:n]
        return both[n:]


class LegLaw(LinearLaw):
    """From the signals of the legs, or of the pose, to leg forces."""

    def __init__(
        self, controller: "LinearController", _jacobians: FloatArray, reference: FloatArray, measured: FloatArray
    ) -> None:
        super().__init__(controller)
        self._start(reference[self._at], measured[self._at])

    def force(
        self, _k: int, _time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray
    ) -> FloatArray:
        """As `Law`."""
        self._feed(reference[self._at], measured[self._at], excess)
        return self._advance()


class TaskLaw(LinearLaw):
    """From leg lengths to displacements of the platform, and from a wrench to leg forces."""

    def __init__(
        self, controller: "LinearController", jacobians: FloatArray, reference: FloatArray, measured: FloatArray
    ) -> None:
        super().__init__(controller)
        self._J = jacobians
        self._J_inverse = np.linalg.inv(jacobians)
        self._lengths = measured[self._at].copy()
        self._pose = np.zeros(N_LEGS)
        self._start(self._J_inverse[0] @ (reference[self._at] - self._lengths), self._pose)

    def force(
        self, k: int, _time: float, reference: FloatArray, measured: FloatArray, excess: FloatArray
    ) -> FloatArray:
        """As `Law`."""
        lengths = measured[self._at]
        # the sum of J⁻¹ dL: its rate is the twist J⁻¹ L̇; the rate of J⁻¹ (L − L₀) is not, where J changes
        self._pose = self._pose + self._J_inverse[k] @ (lengths - self._lengths)
        self._lengths = lengths.copy()
        # w = Jᵀ F also for the force that the limits cut off
        self._feed(self._pose + self._J_inverse[k] @ (reference[self._at] - lengths), self._pose, self._J[k].T @ excess)
        return np.asarray(self._J_inverse[k].T @ self._advance())


def rest(A: Any, integrating: FloatArray, forcing: Any, solve: Solve = np.linalg.solve) -> Any:
    """Steady state x = A x + forcing; zero in integrators, on which `integrating` projects."""
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


def integrates(poles: FloatArray) -> NDArray[np.bool_]:
    """Which eigenvalues are 1 within the tolerance of `integrating_modes`."""
    return (1 - poles) ** 2 < _INTEGRATES


def as_slice(positions: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """A slice for consecutive positions, which NumPy reads faster."""
    first, last = int(positions[0]), int(positions[-1])
    return slice(first, last + 1) if positions.tolist() == list(range(first, last + 1)) else positions

"""Linear controllers in a run of N members: x⁺ = A x + B u, w = C x + D u, in leg and in task space.

What a controller gets, `inputs_of`, and what task space makes of the legs, `displacements`, are stated here once, for
the arrays of a run, for CasADi symbols and for small signals.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gough_stewart.harness.control.state_space import Solve
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.plant import BoolArray
from gough_stewart.harness.plants.signals import N_LEGS
from gough_stewart.model.rotations import nearest_angle
from gough_stewart.model.vectors import FloatArray

if TYPE_CHECKING:
    from gough_stewart.harness.control.laws import LinearController

# Limit on (1 − z)² of a pole that counts as an integrator: it leaks at most 1e-6 of itself per sample.
_INTEGRATES = 1e-12
# Above what rounding leaves of a 0 in a projection.
_TAKES = 1e-9


def inputs_of(kinds: int, reference: Any, measured: Any, excess: Any) -> tuple[Any, ...]:
    """The parts of u by `LinearController.kinds`: errors, or references and measurements, or these and the excess."""
    return (reference - measured,) if kinds == 1 else (reference, measured, excess)[:kinds]


class LegMaps(Protocol):
    """The leg Jacobian J of one pose as maps of columns."""

    def to_pose(self, change: Any) -> Any:
        """J⁻¹ v: from legs [m] to the platform [m, rad]."""

    def to_wrench(self, force: Any) -> Any:
        """Jᵀ F: from leg forces [N] to a wrench [N, N m]."""

    def to_force(self, wrench: Any) -> Any:
        """J⁻ᵀ w: from a wrench to leg forces."""


def displacements(maps: LegMaps, pose: Any, before: Any, wanted: Any, lengths: Any) -> tuple[Any, Any]:
    """References and measurements in task space [m, rad], from those at the last sample and the leg lengths [m].

    The measured displacement is y = Σ J⁻¹ ΔL. Its rate is the twist J⁻¹ L̇; the rate of J⁻¹ (L − L₀) is not, where J
    changes. References are y + J⁻¹ (L_reference − L).
    """
    now = pose + maps.to_pose(lengths - before)
    return now + maps.to_pose(wanted - lengths), now


class MapsOfPose:
    """The leg maps of one pose for columns (6, n), from its Jacobian (6, 6)."""

    def __init__(self, jacobian: FloatArray) -> None:
        self._J, self._J_inverse = jacobian, np.linalg.inv(jacobian)

    def to_pose(self, change: FloatArray) -> FloatArray:
        """As `LegMaps`."""
        return np.asarray(self._J_inverse @ change)

    def to_wrench(self, force: FloatArray) -> FloatArray:
        """As `LegMaps`."""
        return np.asarray(self._J.T @ force)

    def to_force(self, wrench: FloatArray) -> FloatArray:
        """As `LegMaps`."""
        return np.asarray(self._J_inverse.T @ wrench)


def product_of_members(columns_first: FloatArray, vectors: FloatArray) -> FloatArray:
    """M v (rows, N), a new array, of matrices (columns, rows, N) or (columns, rows, 1) and vectors (columns, N).

    Column by column in ascending order, so that a member's bits do not depend on the others: BLAS sums in an order that
    depends on the sizes, and so does NumPy but along the first axis of arrays with several elements in the others.
    """
    with np.errstate(invalid="ignore"):  # infinity times 0: the host names what is no number
        terms = np.multiply(columns_first, vectors[:, np.newaxis], order="C")
        return np.asarray(np.add.reduce(terms, axis=0))


class _ProductInPlace:
    """`product_of_members` of one matrix and an array of vectors that changes, at half its cost for one member.

    Views and results are made in advance, and warnings are suppressed only where there may be any.
    """

    def __init__(self, columns_first: FloatArray, vectors: FloatArray) -> None:
        self._matrices, self._vectors = columns_first, vectors
        self._squares, self._factors = vectors.reshape(-1), vectors[:, np.newaxis]
        self._terms = np.zeros(np.broadcast_shapes(columns_first.shape, self._factors.shape))
        self._product = np.zeros(self._terms.shape[1:])

    def __call__(self) -> FloatArray:
        """M v (rows, N), valid until the next call."""
        if self._squares.dot(self._squares) < np.inf:
            np.multiply(self._matrices, self._factors, self._terms)
            return np.asarray(np.add.reduce(self._terms, axis=0, out=self._product))
        return product_of_members(self._matrices, self._vectors)


class LinearParts(NamedTuple):
    """Everything that a `LinearLaw` computes with."""

    matrices: FloatArray  # [C D; A B], (N, 6 + n, n + size of u), or (1, ...) common to all
    kinds: int  # see `inputs_of`
    positions: NDArray[np.intp]  # of its signals among all
    state: FloatArray  # x (N, n)
    lengths: FloatArray  # at the last sample (6, N), in task space
    jacobians: FloatArray | None  # by sample (m, 6, 6, N), or (m, 6, 6, 1), in task space
    inverses: FloatArray | None


class LinearLaw:
    """The linear controllers of N members, of one structure; (x, u) of all members are columns.

    Parameters
    ----------
    jacobians
        Leg Jacobians in the reference poses of all samples, (n, 6, 6) or (n, N, 6, 6), for task space.
    reference, measured
        References (30,) or (N, 30) and measurements (N, 24) at the first sample: the memory starts in steady state for
        these constant inputs, integrators at zero, so that a start off the reference gives no derivative kick.
    """

    limited = None
    may_overrun = True
    failures: Mapping[int, ControllerError] = {}

    def __init__(
        self,
        controllers: Sequence["LinearController"],
        jacobians: FloatArray,
        reference: FloatArray,
        measured: FloatArray,
    ) -> None:
        first, n_members = controllers[0], len(controllers)
        # if all members have the same system, one matrix serves all
        same = all(each.system is first.system for each in controllers)
        systems = [each.system for each in (controllers[:1] if same else controllers)]
        A, B, C, D = (np.stack([getattr(system, name) for system in systems]) for name in "ABCD")
        n = first.system.nstates
        self._A, self._positions = A, signals.positions(first.signals)
        matrices = np.concatenate([np.concatenate([C, D], axis=2), np.concatenate([A, B], axis=2)], axis=1)
        self._matrices = matrices
        xu = np.zeros((n + first.system.ninputs, n_members))
        self._product = _ProductInPlace(np.ascontiguousarray(np.moveaxis(matrices, 0, -1).swapaxes(0, 1)), xu)
        self._x, size = xu[:n], len(self._positions)
        # views, see `inputs_of`: making one takes Python as long as the arithmetic
        self._inputs = tuple(np.split(xu[n:], [size, 2 * size])[: first.kinds])
        self.used = first.signals
        self._kinds = first.kinds
        self._at = as_slice(self._positions)
        self._angles = np.flatnonzero(np.isin(self._positions, signals.positions(["orientation"])))
        self._maps = _MapsOfSamples(jacobians) if first.space == "task" else None
        self._lengths = measured.T[self._at].copy()
        self._pose = np.zeros_like(self._lengths)
        self._start(reference, measured)

    def force(
        self,
        k: int,
        _time: float,
        reference: FloatArray,
        measured: FloatArray,
        excess: FloatArray,
        due: BoolArray | None = None,
    ) -> FloatArray:
        """As `Law`."""
        self._feed(k, reference, measured, excess.T, due)
        force_and_state = self._product()
        if due is None:
            self._x[...] = force_and_state[N_LEGS:]
        else:
            np.copyto(self._x, force_and_state[N_LEGS:], where=due)
        force = force_and_state[:N_LEGS]
        return (force if self._maps is None else self._maps.to_force(force)).T

    @property
    def parts(self) -> LinearParts:
        """Everything it computes with, at the present sample."""
        J, inverses = (None, None) if self._maps is None else self._maps.arrays
        return LinearParts(self._matrices, self._kinds, self._positions, self.state, self._lengths, J, inverses)

    @property
    def state(self) -> FloatArray:
        """A copy of x (N, n)."""
        return self._x.copy().T

    def _feed(
        self, k: int, reference: FloatArray, measured: FloatArray, excess: FloatArray, due: BoolArray | None
    ) -> None:
        """Set u at sample k."""
        r, y = columns(reference)[self._at], measured.T[self._at]
        if self._maps is not None:
            self._maps.k, lengths = k, y
            r, y = displacements(self._maps, self._pose, self._lengths, r, lengths)
            excess = self._maps.to_wrench(excess) if self._kinds == 3 else excess
            everyone = True if due is None else due
            np.copyto(self._pose, y, where=everyone)
            np.copyto(self._lengths, lengths, where=everyone)
        elif self._angles.size:  # in the turns of their references
            y = y.copy()
            y[self._angles] = nearest_angle(y[self._angles], r[self._angles])
        for place, part in zip(self._inputs, inputs_of(self._kinds, r, y, excess), strict=True):
            place[...] = part

    def _start(self, reference: FloatArray, measured: FloatArray) -> None:
        """Set the steady state under constant inputs."""
        n = len(self._x)
        self._feed(0, reference, measured, np.zeros((N_LEGS, 1)), None)
        forcing = self._product()[N_LEGS:].T  # (N, n)
        A = np.broadcast_to(self._A, (len(forcing), n, n))
        poles = np.diagonal(A, axis1=1, axis2=2)
        free = integrates(poles)
        x = np.where(free, 0.0, forcing / np.where(free, 1.0, 1 - poles))
        for member in np.flatnonzero((A - poles[:, None] * np.eye(n)).any(axis=(1, 2))).tolist():
            x[member] = rest(A[member], integrators(integrating_modes(A[member])), forcing[member])
        self._x[...] = x.T


class _MapsOfSamples:
    """The leg maps of N members in the reference pose of sample `k`; a `LegMaps`."""

    def __init__(self, jacobians: FloatArray) -> None:
        # (n, 6, 6, N), or (n, 6, 6, 1) if common to all members
        each = jacobians if jacobians.ndim == 4 else jacobians[:, None]
        self._J = np.ascontiguousarray(np.moveaxis(each, 1, -1))
        self._J_inverse = np.ascontiguousarray(np.moveaxis(np.linalg.inv(each), 1, -1))
        self.k = 0

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """J and its inverse by sample (m, 6, 6, N), or (m, 6, 6, 1)."""
        return self._J, self._J_inverse

    def to_pose(self, change: FloatArray) -> FloatArray:
        return product_of_members(self._J_inverse[self.k].swapaxes(0, 1), change)

    def to_wrench(self, force: FloatArray) -> FloatArray:
        return product_of_members(self._J[self.k], force)

    def to_force(self, wrench: FloatArray) -> FloatArray:
        return product_of_members(self._J_inverse[self.k], wrench)


def rest(A: Any, integrating: FloatArray, forcing: Any, solve: Solve = np.linalg.solve) -> Any:
    """Steady state x = A x + forcing; zero in integrators, on which `integrating` projects."""
    P = integrating
    return solve(np.eye(len(A)) - A + P, forcing - P @ forcing)


def integrating_modes(A: FloatArray) -> FloatArray:
    """Projection (n, n) on the modes whose eigenvalue is 1, along the others.

    With the ordered Schur form A = Q [T₁ T₁₂; 0 T₂] Qᵀ it is Q [1 Y; 0 0] Qᵀ, T₁ Y − Y T₂ = T₁₂ (Golub & Van Loan,
    Matrix Computations, 4th ed. 2013, §7.6.3). Singular values would not do: those of a stable matrix may be smaller
    than the distance of its eigenvalues from 1 by orders of magnitude.
    """
    from scipy.linalg import (
        schur,
        solve_sylvester,
    )  # slow to import, and rarely needed: poles are often on the diagonal

    T, Q, k = schur(A, sort=lambda re, im: abs(1 - complex(re, im)) ** 2 < _INTEGRATES)
    Y = solve_sylvester(T[:k, :k], -T[k:, k:], T[:k, k:]) if 0 < k < len(A) else np.zeros((k, len(A) - k))
    projection = np.zeros_like(A)
    projection[:k] = np.concatenate([np.eye(k), Y], axis=1)
    return np.asarray(Q @ projection @ Q.T)


def integrators(modes: FloatArray) -> FloatArray:
    """Projection (n, n) on the states that integrate, from P, that on their modes, which has the states behind them.

    For a start: a filter behind an integral that is 0 rests in its first output; in the mode it lags behind a ramp. P
    takes nothing of such a state j: Σ |P_ij P_ji| = 0 over i, in whatever units the states are.
    """
    takes = np.abs(modes * modes.T).sum(axis=0) > _TAKES
    return np.asarray(takes[:, None] * modes)


def integrates(poles: FloatArray) -> NDArray[np.bool_]:
    """Which eigenvalues are 1 within the tolerance of `integrating_modes`."""
    return (1 - poles) ** 2 < _INTEGRATES


def as_slice(positions: NDArray[np.intp]) -> slice | NDArray[np.intp]:
    """A slice for consecutive positions, which NumPy reads faster."""
    first, last = int(positions[0]), int(positions[-1])
    return slice(first, last + 1) if positions.tolist() == list(range(first, last + 1)) else positions


def columns(values: FloatArray) -> FloatArray:
    """(size, N) of values of the members (N, size), or (size, 1) of values common to all (size,)."""
    return values.T if values.ndim == 2 else values[:, None]

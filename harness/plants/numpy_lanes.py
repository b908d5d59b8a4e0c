"""The lane kernel in NumPy: the functions of `model` over many platforms at once."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.lanes import CONTROLLED, Failure
from gough_stewart.harness.plants.lane_batch import Batch
from gough_stewart.model import dynamics, energy, interface, kinematics, machine_dynamics
from gough_stewart.model.exponential import phi_functions
from gough_stewart.model.machine_dynamics import MachineState
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.pose_limits import LARGEST_PITCH, SHORTEST_LEG, SINGULAR_CONDITION_NUMBER
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.variant import Variant
from gough_stewart.model.vectors import Array, FloatArray

# Cash–Karp 5(4): J. R. Cash, A. H. Karp, ACM Trans. Math. Softw. 16 (1990), 201–222.
_A = (
    (),
    (1 / 5,),
    (3 / 40, 9 / 40),
    (3 / 10, -9 / 10, 6 / 5),
    (-11 / 54, 5 / 2, -70 / 27, 35 / 27),
    (1631 / 55296, 175 / 512, 575 / 13824, 44275 / 110592, 253 / 4096),
)
_B = np.array([37 / 378, 0, 250 / 621, 125 / 594, 0, 512 / 1771])
_LOWER = np.array([2825 / 27648, 0, 18575 / 48384, 13525 / 55296, 277 / 14336, 1 / 4])


class _Members(NamedTuple):
    """The equations of all members of a batch."""

    variant: Variant
    parameters: Parameters

    @classmethod
    def of(cls, batch: Batch) -> Self:
        return cls(batch.variant, batch.parameters_of())

    def derivatives(self, x: FloatArray, u: FloatArray) -> FloatArray:
        """ẋ (n, M)."""
        inputs = Inputs.from_vector(u.T)
        if self.variant.parts:
            whole = MachineState.from_vector(self.variant, x.T)
            rates = machine_dynamics.machine_rates(self.variant, self.parameters, whole, inputs, _solve)
            return machine_dynamics.machine_derivatives(whole, rates).T
        state = State.from_vector(x.T)
        a = dynamics.forward_dynamics(self.parameters, state, inputs, _solve)
        rate = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
        return np.concatenate([state.velocity.T, rate.T, a.linear.T, a.angular.T])

    def decays(self, x: FloatArray) -> FloatArray:
        """Rates (6, M) [1/s] of the bristles."""
        state = MachineState.from_vector(self.variant, x.T)
        return machine_dynamics.decay_of_bristles(self.variant, self.parameters, state).T

    def results(self, x: FloatArray, u: FloatArray) -> Mapping[str, Array]:
        """Those of a variant with parts, by name."""
        state = MachineState.from_vector(self.variant, x.T)
        rates = machine_dynamics.machine_rates(self.variant, self.parameters, state, Inputs.from_vector(u.T), _solve)
        return machine_dynamics.machine_results(self.variant, self.parameters, state, rates)


class NumpyLanes:
    """The functions of `model` over the members; the same interface without a compiler, slower."""

    features = "NumPy"

    def check(self, batch: Batch) -> int:
        """See `LaneKernel`."""
        return _check(batch, batch.states, batch.running != 0, 0.0)

    @np.errstate(all="ignore")
    def step(self, batch: Batch, size: float, substeps: int, signals: FloatArray | None = None) -> int:
        """See `LaneKernel`."""
        members, running = _Members.of(batch), batch.running != 0
        x, failed, error = batch.states, 0, np.zeros(batch.states.shape[1])
        for k in range(1, substeps + 1):
            begin, x = x, _rk4(members, x, batch.inputs, size)
            better, _ = _pair(members, begin, batch.inputs, np.full(error.shape, size))
            error += (np.abs(better - x) / (1 + np.abs(x))).max(axis=0)
            failed += _check(batch, x, running, k * size)
            running &= batch.failure == Failure.GOES_ON
        batch.states[:] = np.where(running, x, batch.states)
        _keep_errors(batch, running, error)
        if signals is not None:
            self.signals(batch, signals)
        return failed

    @np.errstate(all="ignore")
    def advance(self, batch: Batch, duration: float, tolerance: float, signals: FloatArray | None = None) -> int:
        """See `LaneKernel`; as `advance` of c/lanes/lanes.c."""
        members, running = _Members.of(batch), batch.running != 0
        x, failed = batch.states.copy(), 0
        left, total, taken = np.full(running.shape, duration), np.zeros(running.shape), np.zeros(running.shape)
        proposed = np.where(batch.proposed == 0, left, batch.proposed)
        first = members.derivatives(x, batch.inputs)
        controlled = _exponential if batch.variant.bristles else _controlled
        while (active := running & (left > 0)).any():
            size = np.where(proposed >= left, left, np.where(2 * proposed > left, left / 2, proposed))
            end, error, rate = controlled(members, x, first, batch.inputs, np.where(active, size, 0.0))
            following = size * _factor_of(error / tolerance)
            passes = active & (error / tolerance <= 1)
            x, total = np.where(passes, end, x), np.where(passes, total + error, total)
            first = np.where(passes, rate, first)
            taken[active] += 1
            is_kept = passes & (size < proposed) & (following < proposed)
            proposed = np.where(active & ~is_kept, following, proposed)
            left = np.where(passes, np.where(size == left, 0.0, left - size), left)
            failed += _check(batch, x, running & passes, duration - left)
            too_small = ~passes & (proposed < CONTROLLED["SMALLEST_SHARE"] * duration)
            goes_on = running & (left > 0) & (batch.failure == Failure.GOES_ON)
            ends = goes_on & ((taken >= CONTROLLED["MOST_LANE_STEPS"]) | too_small)
            why = np.where(np.isnan(error), Failure.NOT_FINITE, Failure.TOO_MANY_STEPS)
            _fail(batch, ends, why, duration - left, end)
            failed += int(ends.sum())
            running &= batch.failure == Failure.GOES_ON
        batch.states[:] = np.where(running, x, batch.states)
        batch.proposed[running] = proposed[running]
        batch.internal_steps[running] += taken[running]
        _keep_errors(batch, running, total)
        if signals is not None:
            self.signals(batch, signals)
        return failed

    def signals(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        state = State.from_vector(batch.states[: interface.N_STATES].T)
        legs = kinematics.leg_geometry(batch.parameters_of(), state.position, state.orientation)
        values = (*state, legs.length, kinematics.rates_of_legs(legs, state).length_rate)
        out[:] = np.concatenate(values, axis=-1).T

    def results(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        if batch.variant.parts:
            found = _Members.of(batch).results(batch.states, batch.inputs)
            out[:] = np.concatenate([found[v.name].reshape(out.shape[1], -1).T for v in batch.variant.results])
            return
        parameters, state = batch.parameters_of(), State.from_vector(batch.states.T)
        inputs = Inputs.from_vector(batch.inputs.T)
        signals = np.empty((interface.RESULT_COLUMNS.index("acceleration[1]"), out.shape[1]))
        self.signals(batch, signals)
        a = dynamics.forward_dynamics(parameters, state, inputs, _solve)
        force = dynamics.joint_forces(parameters, state, inputs.actuator_force, a)
        kinetic = energy.kinetic_energy(parameters, state)
        potential = energy.potential_energy(parameters, state.position, state.orientation)
        out[:] = np.concatenate([signals, a.linear.T, a.angular.T, force.reshape(-1, 18).T, [kinetic], [potential]])


def _keep_errors(batch: Batch, running: NDArray[np.bool_], error: FloatArray) -> None:
    known = np.where(np.isnan(error), np.inf, error)
    batch.error[running] = np.maximum(batch.error, known)[running]


def _rk4(members: _Members, x: FloatArray, u: FloatArray, size: float) -> FloatArray:
    """States (n, M) after one step of classical RK4."""
    k1 = members.derivatives(x, u)
    k2 = members.derivatives(x + size / 2 * k1, u)
    k3 = members.derivatives(x + size / 2 * k2, u)
    k4 = members.derivatives(x + size * k3, u)
    return np.asarray(x + size / 6 * (k1 + 2 * k2 + 2 * k3 + k4))


def _pair(members: _Members, x: FloatArray, u: FloatArray, size: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (n, M) of order 5 after a step of sizes (M), and its errors (M); as `pair` of c/lanes/lanes.c."""
    rates: list[FloatArray] = []
    for row in _A:
        weighted = sum((a * rate for a, rate in zip(row, rates, strict=True)), np.zeros_like(x))
        rates.append(members.derivatives(x + size * weighted, u))
    end = x + size * np.tensordot(_B, rates, axes=1)
    gap = size * np.abs(np.tensordot(_B - _LOWER, rates, axes=1)) / (1 + np.abs(x))
    return end, np.where(np.isfinite(end).all(axis=0), gap.max(axis=0), np.nan)


def _controlled(
    members: _Members, x: FloatArray, first: FloatArray, u: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States (n, M) after an internal step of sizes (M) from known derivatives, its errors (M), the derivatives there.

    As `controlled_step` of c/lanes/lanes.c.
    """
    k2 = members.derivatives(x + size / 3 * first, u)
    k3 = members.derivatives(x + size * (k2 - first / 3), u)
    k4 = members.derivatives(x + size * (first - k2 + k3), u)
    end = x + size / 8 * (first + 3 * k2 + 3 * k3 + k4)
    k5 = members.derivatives(end, u)
    e3, smallest = np.abs(first - 3 * k2 + 3 * k3 + 3 * k4 - 4 * k5) / 24, CONTROLLED["SMALLEST_RATE"]
    e2, e1 = np.abs(first - 2 * k2 + k3), np.abs(k2 - first)
    quotients = e3 * e3 / (e3 + e2 / 40 + smallest), e2 * (e2 / (e1 + e2 + smallest)) ** 2 / 15
    error = size * np.maximum(*quotients) / (1 + np.abs(x))
    return end, np.where(np.isfinite(end + k5).all(axis=0), error.max(axis=0), np.nan), k5


def _exponential(
    members: _Members, x: FloatArray, first: FloatArray, u: FloatArray, size: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `_controlled`, of a variant with bristles: `controlled_step` of c/lanes/exponential_step.h."""
    at, decay, z = slice(12, 18), members.decays(x), x[12:18]
    (half, inner, *_), (whole, one, two, three, _) = (
        (np.exp(y), *phi_functions(y)) for y in (-size / 2 * decay, -size * decay)
    )

    def stage(weight: FloatArray, rate: FloatArray, bristle: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The state there, its derivatives, and those of the bristles without −d z."""
        found = x + weight * rate
        found[at] = bristle
        rates = members.derivatives(found, u)
        return found, rates, rates[at] + decay * bristle

    n1 = first[at] + decay * z
    za = half * z + size / 2 * inner * n1
    _, k2, n2 = stage(size / 2, first, za)
    _, k3, n3 = stage(size / 2, k2, half * z + size / 2 * inner * n2)
    _, k4, n4 = stage(size, k3, half * za + size / 2 * inner * (2 * n3 - n1))
    last, middle = size * (4 * three - two), size * (2 * two - 4 * three)
    bristle = whole * z + size * (one - 3 * two + 4 * three) * n1 + middle * (n2 + n3) + last * n4
    end, k5, n5 = stage(size / 6, first + 2 * (k2 + k3) + k4, bristle)
    error = _error_of((first, k2, k3, k4, k5), size / 10, size)
    error[at] = _error_of((n1, n2, n3, n4, n5), 0.6 * last, size * one)
    error /= np.array(members.variant.scales)[:, None] + np.abs(x)
    return end, np.where(np.isfinite(end + k5).all(axis=0), error.max(axis=0), np.nan), k5


def _error_of(n: Sequence[FloatArray], last: FloatArray, whole: FloatArray) -> FloatArray:
    """As `error_of` of c/lanes/exponential_step.h."""
    e2, e1 = np.abs((n[0] - n[1]) + (n[3] - n[2])), np.abs(n[3] - n[0])
    other = whole * e2 * (e2 / (e1 + e2 + CONTROLLED["SMALLEST_RATE"])) ** 2 / 20
    return np.maximum(np.abs(last * (n[3] - n[4])), other)


def _factor_of(ratio: FloatArray) -> FloatArray:
    """As `factor_of` of c/lanes/lanes.c: about 0.9 r^(−1/5), from 0.2 to 5."""
    known = np.maximum(np.where(ratio <= 2000, ratio, 2000.0), 1e-4)
    logarithm = known.view(np.int64) * 2.0**-52 - 1023
    factor = 0.9 * ((1023 - 0.2 * logarithm) * 2.0**52).astype(np.int64).view(float)
    return np.clip(factor, 0.2, 5.0)


def _fail(batch: Batch, stops: NDArray[np.bool_], failure: Any, after: FloatArray | float, reached: FloatArray) -> None:
    batch.failure[stops] = np.broadcast_to(failure, stops.shape)[stops]
    batch.failed_after[stops] = np.broadcast_to(after, stops.shape)[stops]
    batch.reached[:, stops] = reached[:, stops]


def _solve(matrix: Array, vector: Array) -> Array:
    """LDLᵀ without pivoting of positive definite (M, 6, 6), all members at once; NaN in one affects no other."""
    n = vector.shape[-1]
    A = [[matrix[..., i, j] for j in range(i + 1)] for i in range(n)]
    y = [vector[..., i] for i in range(n)]
    for j in range(n):
        pivot = 1 / A[j][j]
        for i in range(j + 1, n):
            factor = A[i][j] * pivot
            for k in range(j + 1, i + 1):
                A[i][k] = A[i][k] - factor * A[k][j]
            y[i] = y[i] - factor * y[j]
    for j in reversed(range(n)):
        for i in range(j + 1, n):
            y[j] = y[j] - A[i][j] * y[i]
        y[j] = y[j] / A[j][j]
    return np.stack(y, axis=-1)


@np.errstate(all="ignore")
def _check(batch: Batch, x: FloatArray, running: NDArray[np.bool_], after: FloatArray | float) -> int:
    """As `check` of c/lanes/lanes.c: which running members cannot continue from their state, with the reason."""
    legs = kinematics.leg_geometry(batch.parameters_of(), x[:3].T, x[3:6].T)
    jacobian, rho = kinematics.scaled_jacobian_of_legs(legs)
    determinant = np.linalg.det(jacobian)
    here = np.where(determinant > 0, 1.0, -1.0)
    singular = np.zeros(len(rho), dtype=bool)
    # κ ≤ 2/|det J| (|J|/√n)ⁿ with |J|² ≤ 2 n
    for k in np.flatnonzero(running & ~(np.abs(determinant) > 16 / SINGULAR_CONDITION_NUMBER)):
        singular[k] = not kinematics.condition_number_bound(jacobian[k]) < SINGULAR_CONDITION_NUMBER
    shortest = legs.length.argmin(axis=-1)
    # the first true condition
    failure = np.select(
        [
            ~np.isfinite(x).all(axis=0),
            ~(np.abs(x[4]) < LARGEST_PITCH),
            ~(legs.length.min(axis=-1) > SHORTEST_LEG * rho),
            (batch.side != 0) & (batch.side != here),
            singular,
        ],
        [Failure.NOT_FINITE, Failure.PITCHED, Failure.COLLAPSED + shortest, Failure.PASSED_SINGULAR, Failure.SINGULAR],
        Failure.GOES_ON,
    )
    stops = running & (failure != Failure.GOES_ON)
    _fail(batch, stops, failure, after, x)
    goes_on = running & ~stops
    batch.side[goes_on] = here[goes_on]
    return int(stops.sum())

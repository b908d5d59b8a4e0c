"""The lane kernel in NumPy: the functions of `model` over many platforms at once."""

import numpy as np
from numpy.typing import NDArray

from gough_stewart.fmu_build.lanes import REPEATED, Failure
from gough_stewart.harness.plants.lane_batch import Batch
from gough_stewart.model import dynamics, energy, interface, kinematics
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.pose_limits import LARGEST_PITCH, SHORTEST_LEG, SINGULAR_CONDITION_NUMBER
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, FloatArray


class NumpyLanes:
    """The functions of `model` over the members; the same interface without a compiler, slower."""

    features = "NumPy"

    def check(self, batch: Batch) -> int:
        """See `LaneKernel`."""
        return _check(batch, batch.states, batch.running != 0, 0)

    def step(
        self, batch: Batch, size: float, substeps: int, signals: FloatArray | None = None, *, plain: bool = False
    ) -> int:
        """See `LaneKernel`."""
        parameters, running = batch.parameters_of(), batch.running != 0
        x, failed, difference = batch.states.copy(), 0, np.zeros(batch.states.shape[1])
        start = x
        for k in range(1, substeps + 1):
            x, found = _rk4(parameters, x, batch.inputs, size)
            difference = np.fmax(difference, found)
            if not plain:
                failed += _check(batch, x, running, k)
                running &= batch.failure == Failure.GOES_ON
        if not plain:
            _watch(batch, np.flatnonzero(running), start, x, difference, size, substeps)
        batch.states[:] = np.where(running, x, batch.states)
        if signals is not None:
            self.signals(batch, signals)
        return failed

    def signals(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        state = State.from_vector(batch.states.T)
        legs = kinematics.leg_geometry(batch.parameters_of(), state.position, state.orientation)
        values = (*state, legs.length, kinematics.rates_of_legs(legs, state).length_rate)
        out[:] = np.concatenate(values, axis=-1).T

    def results(self, batch: Batch, out: FloatArray) -> None:
        """See `LaneKernel`."""
        parameters, state = batch.parameters_of(), State.from_vector(batch.states.T)
        inputs = Inputs.from_vector(batch.inputs.T)
        signals = np.empty((interface.RESULT_COLUMNS.index("acceleration[1]"), out.shape[1]))
        self.signals(batch, signals)
        a = dynamics.forward_dynamics(parameters, state, inputs, _solve)
        force = dynamics.joint_forces(parameters, state, inputs.actuator_force, a)
        kinetic = energy.kinetic_energy(parameters, state)
        potential = energy.potential_energy(parameters, state.position, state.orientation)
        out[:] = np.concatenate([signals, a.linear.T, a.angular.T, force.reshape(-1, 18).T, [kinetic], [potential]])


@np.errstate(all="ignore")
def _watch(
    batch: Batch,
    members: NDArray[np.intp],
    start: FloatArray,
    end: FloatArray,
    difference: FloatArray,
    size: float,
    substeps: int,
) -> None:
    """As in c/lanes/lanes.c: estimate the error of a step that may have the largest one."""
    now, largest, error = difference[members], batch.difference[members], batch.error[members]
    allowed = np.minimum(batch.allowed[members] + REPEATED["REPEATED_SHARE"], REPEATED["REPEATED_FIRST"])
    is_small = (now <= REPEATED["SMALLEST_DIFFERENCE"]) & (largest != 0)
    is_below = (now <= REPEATED["RECORD"] * largest) & ((allowed < 1) | (now * allowed <= largest))
    is_chosen = ~(is_small | (REPEATED["ERROR_OF_DIFFERENCE"] * now <= error) | is_below)
    batch.allowed[members] = np.where(is_chosen, np.maximum(allowed - 1, 0), allowed)
    chosen = members[is_chosen]
    if not len(chosen):
        return
    batch.difference[chosen] = np.maximum(batch.difference[chosen], difference[chosen])
    parameters, x = batch.parameters_of(chosen), start[:, chosen]
    for _ in range(2 * substeps):
        x, _ = _rk4(parameters, x, batch.inputs[:, chosen], size / 2)
    found = (np.abs(end[:, chosen] - x) / (1 + np.abs(end[:, chosen]))).max(axis=0)
    batch.error[chosen] = np.maximum(batch.error[chosen], np.where(np.isnan(found), np.inf, found))


@np.errstate(all="ignore")
def _rk4(parameters: Parameters, x: FloatArray, u: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """States (12, M) after one step of classical RK4, and the largest differences of its stages (M)."""
    inputs = Inputs.from_vector(u.T)

    def derivatives(x: FloatArray) -> FloatArray:
        state = State.from_vector(x.T)
        a = dynamics.forward_dynamics(parameters, state, inputs, _solve)
        rate = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
        return np.concatenate([state.velocity.T, rate.T, a.linear.T, a.angular.T])

    k1 = derivatives(x)
    k2 = derivatives(x + size / 2 * k1)
    k3 = derivatives(x + size / 2 * k2)
    k4 = derivatives(x + size * k3)
    difference = size * np.maximum(np.abs(k2 - k3), np.abs(k1 - k2 - k3 + k4)) / (1 + np.abs(x))
    return np.asarray(x + size / 6 * (k1 + 2 * k2 + 2 * k3 + k4)), difference.max(axis=0)


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
def _check(batch: Batch, x: FloatArray, running: NDArray[np.bool_], substep: int) -> int:
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
    batch.failure[stops], batch.failed_at[stops] = failure[stops], substep
    batch.reached[:, stops] = x[:, stops]
    goes_on = running & ~stops
    batch.side[goes_on] = here[goes_on]
    return int(stops.sum())

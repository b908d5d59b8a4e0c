"""Forces of inverse dynamics differentiated by the legs' motion and by the platform's parameters.

Inverse dynamics from a log takes lengths, not poses: G(m, p) = Jᵀ F with m the platform's motion (pose, twist,
acceleration), which follows from ℓ = (L, L̇, L̈) = h(m, p). So

    ∂F/∂ℓ = J⁻ᵀ G_m h_m⁻¹,   ∂F/∂p at fixed ℓ = J⁻ᵀ (G_p − G_m h_m⁻¹ h_p)
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.identify.names import PER_LEG, place_of
from gough_stewart.model import interface
from gough_stewart.model.dynamics import Acceleration, inverse_dynamics
from gough_stewart.model.interface import N_PARAMETERS
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.kinematics import jacobian_of_legs, leg_accelerations, leg_geometry, rates_of_legs
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.state import State
from gough_stewart.model.vectors import Array, FloatArray, apply, transpose

_JOINTS = 36
assert [v.name for v in interface.PLATFORM_PARAMETERS[:2]] == ["base_points", "platform_points"]


class ForceDerivatives(NamedTuple):
    """Derivatives of the actuator forces at n motions."""

    by_legs: FloatArray  # ∂F/∂(L, L̇, L̈) (n, 6, 3, 6) [N/m], [N s/m], [kg]; the third axis is the order
    by_parameters: FloatArray  # ∂F/∂p at fixed lengths (n, 6, N_PARAMETERS)


def force_derivatives(motion: FloatArray, parameters: FloatArray, force: FloatArray) -> ForceDerivatives:
    """Derivatives of inverse dynamics at n motions; exact.

    Parameters
    ----------
    motion
        Position, orientation, velocity, angular velocity, acceleration, angular acceleration (n, 18).
    parameters
        The kernel's p (N_PARAMETERS,).
    force
        The forces there (n, 6) [N].
    """
    n = len(motion)
    J, G_m, G_p, h_m, h_p = _evaluated(_equations(), n, (motion, np.tile(parameters, (n, 1)), force))
    per_leg = np.linalg.solve(np.swapaxes(h_m, 1, 2), np.swapaxes(G_m, 1, 2)).swapaxes(1, 2)
    Jt = np.swapaxes(J, 1, 2)
    by_legs = np.asarray(np.linalg.solve(Jt, per_leg), dtype=float)
    by_parameters = np.asarray(np.linalg.solve(Jt, G_p), dtype=float)
    by_parameters[:, :, : h_p.shape[2]] -= by_legs @ h_p
    return ForceDerivatives(by_legs.reshape(n, 6, 3, 6), by_parameters)


def kernel_parameters(platform: Platform, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """The kernel's p (N_PARAMETERS,), and ∂p/∂θ (N_PARAMETERS, k) by elements of a platform.

    p has friction as a common value times six factors; if a leg's own friction is an element, as 1 times six values.
    """
    own: dict[str, Any] = {}
    for stem in PER_LEG:
        if any(name.startswith(f"{stem}[") for name in names):
            own |= {stem: 1.0, f"{stem}_factor": getattr(platform, stem) * getattr(platform, f"{stem}_factor")}
    p = parameter_vector(platform.with_parameters(own))
    return p, parameter_columns(names)


def parameter_columns(names: Sequence[str]) -> FloatArray:
    """∂p/∂θ (N_PARAMETERS, k) of the kernel's p by elements of a platform."""
    places: dict[str, Any] = {}
    at = 0
    for variable in interface.PLATFORM_PARAMETERS:
        places[variable.name] = np.arange(variable.size).reshape(variable.shape) + at
        at += variable.size
    columns = np.zeros((N_PARAMETERS, len(names)))
    for j, name in enumerate(names):
        stem, index = place_of(name)
        if index and stem in PER_LEG:
            stem = f"{stem}_factor"
        where = places[stem]
        columns[where[index] if index else where, j] = 1.0
        if stem == "platform_inertia":
            columns[where[index[::-1]], j] = 1.0
    return columns


def _evaluated(function: casadi.Function, n: int, arguments: tuple[FloatArray, ...]) -> list[FloatArray]:
    """Results (n, rows, columns) for n rows of arguments, through buffers, which copy nothing."""
    mapped = function.map(n)
    buffer: Any  # its type stubs do not accept NumPy arrays
    buffer, call = mapped.buffer()
    kept = [np.ascontiguousarray(each, dtype=float).ravel() for each in arguments]
    results = [np.empty((n, *function.size_out(k)[::-1])) for k in range(function.n_out())]
    for k, each in enumerate(kept):
        buffer.set_arg(k, each.data)
    for k, result in enumerate(results):
        buffer.set_res(k, result.reshape(-1).data)
    call()
    return [result.swapaxes(1, 2) for result in results]


@cache
@interrupts_held_back()
def _equations() -> casadi.Function:
    """CasADi Function: (m (18), p, F (6)) -> J, ∂G/∂m, ∂G/∂p, ∂h/∂m, ∂h/∂joints with G = inverse dynamics − Jᵀ F."""
    m, p, F = casadi.SX.sym("m", 18), casadi.SX.sym("p", N_PARAMETERS), casadi.SX.sym("F", 6)
    numbers = _symbols(m)
    state, acceleration = State.from_vector(numbers[:, :12]), Acceleration(numbers[:, 12:15], numbers[:, 15:])
    parameters = Parameters(**interface.unpack(interface.PLATFORM_PARAMETERS, _symbols(p)))
    legs = leg_geometry(parameters, state.position, state.orientation)
    needed = inverse_dynamics(parameters, state, acceleration, solve=lambda _matrix, vector: vector)
    G = _column(needed - apply(transpose(jacobian_of_legs(legs)), _symbols(F)))
    of_legs = (legs.length, rates_of_legs(legs, state).length_rate, leg_accelerations(legs, state, *acceleration))
    h = casadi.vertcat(*(_column(part) for part in of_legs))
    J = casadi.vertcat(*(casadi.horzcat(*row) for row in jacobian_of_legs(legs)[0]))
    # of all parameters lengths depend on the joints only, which are the first
    by_p = casadi.jacobian(h, p)[:, :_JOINTS]
    blocks = [J, casadi.jacobian(G, m), casadi.jacobian(G, p), casadi.jacobian(h, m), by_p]
    # without common subexpressions: finding them takes longer than they save
    return casadi.Function("equations", [m, p, F], [casadi.densify(block) for block in blocks])


def _symbols(vector: casadi.SX) -> Array:
    return np.array([casadi.vertsplit(vector)], dtype=object)


def _column(array: Array) -> Any:
    return casadi.vertcat(*array.reshape(-1))

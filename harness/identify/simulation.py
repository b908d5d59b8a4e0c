"""The plant simulated under measured forces and corrected by measured lengths, with exact sensitivities of the kernel.

x̂⁻ = RK4 of ẋ = f(x, F, p) over a step;  ε = L − L(x̂⁻);  x̂ = x̂⁻ + K ε

An open-loop simulation would drift away from the log, since force noise integrates twice. So lengths correct it with
the gain of an α-β filter, the stationary Kalman filter of a mass under force noise [Kalata, IEEE Trans. AES 20(2),
1984]. The innovations ε are then nearly white, and their least squares is the prediction-error method [Ljung, System
Identification, 1999, ch. 7]; multiple shooting would need twelve initial values per segment and weight noise worse.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import casadi
import numpy as np

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.names import PER_LEG, place_of
from gough_stewart.model import interface
from gough_stewart.model.interface import N_INPUTS, N_PARAMETERS, N_STATES
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.platform import Platform
from gough_stewart.model.process.interrupts import interrupts_held_back
from gough_stewart.model.traced import derivatives_function, legs_function
from gough_stewart.model.vectors import FloatArray


class PredictorInputs(NamedTuple):
    """What a predictor of n steps gets."""

    start: FloatArray  # x̂ at the first sample (12,)
    force: FloatArray  # at the start, middle and end of each step (2 n + 1, 6) [N]
    length: FloatArray  # measured at the end of each step (n, 6) [m]
    gain: FloatArray  # K at the end of each step (n, 12, 6)
    step: float  # [s]
    substeps: int  # RK4 steps per step
    by_force: FloatArray | None = None  # ∂force/∂θ at the same times (2 n + 1, 6, k), if forces depend on parameters


class Innovations(NamedTuple):
    """The prediction errors of the simulation."""

    values: FloatArray  # ε (n, 6) [m]
    sensitivity: FloatArray  # ∂ε/∂θ (n, 6, k)


def simulated(inputs: PredictorInputs, parameters: FloatArray, directions: FloatArray) -> Innovations:
    """Innovations at the end of every step, with exact derivatives.

    Parameters
    ----------
    parameters
        The kernel's p.
    directions
        The estimated elements as directions in p (N_PARAMETERS, k).

    Raises
    ------
    IdentificationError
        The simulation diverges with these parameters.
    """
    n, k = len(inputs.length), directions.shape[1]
    rates, lengths = _Bound(_rates(k), parameters, directions), _Bound(_lengths(k), parameters, directions)
    if inputs.by_force is None:
        forces = inputs.force[:, :, None]
    else:
        rates = _Bound(_rates(k, True), parameters, directions)
        forces = np.concatenate([inputs.force[:, :, None], inputs.by_force], axis=2)
    X = np.zeros((N_STATES, 1 + k), order="F")
    X[:, 0] = inputs.start
    h, innovations = inputs.step / inputs.substeps, np.empty((n, 6, 1 + k))
    with np.errstate(all="ignore"):
        for step in range(n):
            start, middle, end = forces[2 * step : 2 * step + 3]
            for part in range(inputs.substeps):
                f0, fm, f1 = (_between(start, middle, end, (part + s) / inputs.substeps) for s in (0.0, 0.5, 1.0))
                k1 = rates(X, f0).copy()
                k2 = rates(X + h / 2 * k1, fm).copy()
                k3 = rates(X + h / 2 * k2, fm).copy()
                X = X + h / 6 * (k1 + 2 * (k2 + k3) + rates(X + h * k3, f1))
            innovation = -lengths(X)
            innovation[:, 0] += inputs.length[step]
            innovations[step] = innovation
            X = X + inputs.gain[step] @ innovation
    if not np.isfinite(innovations).all():
        raise IdentificationError("the simulation diverges with parameters that were tried; start nearer, or by linear")
    return Innovations(innovations[:, :, 0], innovations[:, :, 1:])


def _between(start: FloatArray, middle: FloatArray, end: FloatArray, s: float) -> FloatArray:
    """A parabola through three forces, at a share of the step."""
    return start * ((1 - s) * (1 - 2 * s)) + middle * (4 * s * (1 - s)) + end * (s * (2 * s - 1))


class _Bound:
    """A CasADi Function with buffers, and parameters and directions as its last arguments."""

    def __init__(self, function: casadi.Function, parameters: FloatArray, directions: FloatArray) -> None:
        buffer: Any  # its type stubs do not accept NumPy arrays
        buffer, self._call = function.buffer()
        self._X = np.zeros(function.size_in(0), order="F")
        self._force = np.zeros(function.size_in(1), order="F")
        self._result = np.zeros(function.size_out(0), order="F")
        self._kept = (buffer, np.array(parameters), np.asfortranarray(directions))
        arguments = (self._X, self._force, *self._kept[1:])
        for i, argument in enumerate(arguments):
            buffer.set_arg(i, argument.reshape(-1, order="F").data)
        buffer.set_res(0, self._result.reshape(-1, order="F").data)

    def __call__(self, X: FloatArray, force: FloatArray | float = 0.0) -> FloatArray:
        """The result, a view that the next call overwrites."""
        self._X[:], self._force[...] = X, force
        self._call()
        return self._result


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


@cache
@interrupts_held_back()
def _rates(k: int, moving: bool = False) -> casadi.Function:
    """CasADi Function: (X (12, 1+k), force, p, directions) -> Ẋ, with X = [x, S]: ẋ = f and Ṡ = ∂f/∂x S + ∂f/∂p P.

    If forces are moving with the parameters, force is [F, ∂F/∂θ] (6, 1+k), and Ṡ has ∂f/∂F ∂F/∂θ in addition.
    """
    X, force, p, P = _symbols(k)
    inputs = casadi.SX.sym("inputs", 6, 1 + k) if moving else force
    force = inputs[:, 0]
    x, S, u = X[:, 0], X[:, 1:], casadi.vertcat(force, casadi.SX(N_INPUTS - 6, 1))
    free = casadi.SX.sym("x", N_STATES)
    rate = derivatives_function()(free, u, p)
    by_x = casadi.Function("by_x", [free, force, p], [casadi.jacobian(rate, free)])(x, force, p)
    by_p = casadi.Function("by_p", [free, force, p, P], [casadi.jtimes(rate, p, P)])(x, force, p, P)
    S_rate = by_x @ S + by_p
    if moving:
        u_free = casadi.SX.sym("u", N_INPUTS)
        by_u = casadi.jacobian(derivatives_function()(free, u_free, p), u_free[:6])
        S_rate += casadi.Function("by_u", [free, u_free, p], [by_u])(x, u, p) @ inputs[:, 1:]
    columns = casadi.horzcat(derivatives_function()(x, u, p), S_rate)
    return casadi.Function("rates", [X, inputs, p, P], [casadi.densify(casadi.cse(columns))])


@cache
@interrupts_held_back()
def _lengths(k: int) -> casadi.Function:
    """CasADi Function: (X (12, 1+k), unused, p, directions) -> [L, ∂L/∂θ] (6, 1+k)."""
    X, force, p, P = _symbols(k)
    free = casadi.SX.sym("x", N_STATES)
    L = legs_function()(free, p)[0]
    parts = [L, casadi.jacobian(L, free), casadi.jtimes(L, p, P)]
    L, by_x, by_p = casadi.Function("parts", [free, p, P], parts)(X[:, 0], p, P)
    columns = casadi.horzcat(L, by_x @ X[:, 1:] + by_p)
    return casadi.Function("lengths", [X, force, p, P], [casadi.densify(casadi.cse(columns))])


def _symbols(k: int) -> tuple[casadi.SX, casadi.SX, casadi.SX, casadi.SX]:
    return (
        casadi.SX.sym("X", N_STATES, 1 + k),
        casadi.SX.sym("F", 6),
        casadi.SX.sym("p", N_PARAMETERS),
        casadi.SX.sym("P", N_PARAMETERS, k),
    )

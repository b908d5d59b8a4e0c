"""The task-space dynamics traced once into CasADi Functions, parameters as run-time inputs.

    ẋ = f(x, u, p),  y = g(x, u, p),  and the exact Jacobians A, B, C, D of (ẋ, y) with respect to (x, u)

x (12): position, orientation, velocity, angular_velocity. u (12): the inputs of the interface table. p: its
platform parameters. y: its outputs and locals. Every vector in table order (`gough_stewart.model.interface`).

The Functions are traced by calling the functions of `machine_dynamics` and `kinematics` with object arrays of
`casadi.SX` scalars. They keep a leading axis of length 1, since NumPy turns 0-d object arrays into scalars.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations
from typing import Any

import casadi
import numpy as np

from gough_stewart.model import dynamics, interface, kinematics, machine_dynamics
from gough_stewart.model.friction import Grip
from gough_stewart.model.interface import IDEAL, N_INPUTS, N_STATES, Variant
from gough_stewart.model.machine_dynamics import MachineState
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import Array, cross, dot


@cache
@interrupts_held_back()
def derivatives_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `derivatives`: (x, u, p) -> xdot."""
    x, u, p = _arguments(variant)
    xdot, _ = _trace(x, u, p, variant)
    return _function("derivatives", [x, u, p], [xdot], ["xdot"])


@cache
@interrupts_held_back()
def outputs_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `outputs`: (x, u, p) -> y, all outputs and locals of the interface."""
    x, u, p = _arguments(variant)
    _, y = _trace(x, u, p, variant)
    return _function("outputs", [x, u, p], [y], ["y"])


@cache
@interrupts_held_back()
def jacobians_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `jacobians`: (x, u, p) -> A, B, C, D, dense."""
    x, u, p = _arguments(variant)
    xdot, y = _trace(x, u, p, variant)
    blocks = [casadi.densify(casadi.jacobian(f, z)) for f in (xdot, y) for z in (x, u)]
    return _function("jacobians", [x, u, p], blocks, ["A", "B", "C", "D"])


@cache
@interrupts_held_back()
def decays_function(variant: Variant) -> casadi.Function:
    """CasADi Function `decays`: (x, p) -> decay (6) [1/s], of the bristles of a variant: ż = v − decay · z."""
    x, p, grip = _traced_grip(variant)
    return _function("decays", [x, p], [_column(grip.decay)], ["decay"])


@cache
@interrupts_held_back()
def grip_function(variant: Variant) -> casadi.Function:
    """CasADi Function `grip`: (x, p) -> the parts of `friction.Grip`, the gain (36) column by column."""
    x, p, grip = _traced_grip(variant)
    results = [_column(part) for part in grip._replace(gain=grip.gain.swapaxes(-1, -2))]
    return _function("grip", [x, p], results, [*Grip._fields])


@cache
@interrupts_held_back()
def sliding_function(variant: Variant) -> casadi.Function:
    """CasADi Function `sliding`: (x, p) -> sliding (6) [m/s], the velocities at which friction acts."""
    x, p, grip = _traced_grip(variant)
    return _function("sliding", [x, p], [_column(grip.sliding)], ["sliding"])


@cache
@interrupts_held_back()
def tangent_function() -> casadi.Function:
    """CasADi Function `tangent`: (x, u, p, dx, du) -> dxdot, dy; a column of the Jacobians for a unit direction."""
    x, u, p = _arguments()
    dx, du = casadi.SX.sym("dx", N_STATES), casadi.SX.sym("du", N_INPUTS)
    directions = [casadi.jtimes(f, casadi.vertcat(x, u), casadi.vertcat(dx, du)) for f in _trace(x, u, p)]
    return _function("tangent", [x, u, p, dx, du], directions, ["dxdot", "dy"])


@cache
@interrupts_held_back()
def forward_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `forward`: (x, u, p, dx, du, dp) -> dxdot, dy; the derivative of (ẋ, y) in one direction.

    δẋ = ∂ẋ/∂x δx + ∂ẋ/∂u δu + ∂ẋ/∂p δp, and likewise δy; exact.
    """
    z = _arguments(variant)
    dz = [casadi.SX.sym(f"d{name}", v.numel()) for name, v in zip("xup", z, strict=True)]
    directions = [casadi.jtimes(f, casadi.vertcat(*z), casadi.vertcat(*dz)) for f in _trace(*z, variant)]
    return _function("forward", [*z, *dz], directions, ["dxdot", "dy"])


@cache
@interrupts_held_back()
def reverse_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `reverse`: (x, u, p, wxdot, wy) -> gx, gu, gp; the gradient of wẋ·ẋ + wy·y, exact."""
    z = _arguments(variant)
    f = _trace(*z, variant)
    w = [casadi.SX.sym(f"w{name}", v.numel()) for name, v in zip(("xdot", "y"), f, strict=True)]
    gradient = casadi.jtimes(casadi.vertcat(*f), casadi.vertcat(*z), casadi.vertcat(*w), True)
    return _function(
        "reverse", [*z, *w], casadi.vertsplit(gradient, [0, *np.cumsum([v.numel() for v in z])]), ["gx", "gu", "gp"]
    )


@cache
@interrupts_held_back()
def legs_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `legs`: (x, p) -> length (6), length_rate (6), jacobian (36, row by row), rho.

    For checks of the pose limits, at a fifth of the cost of the derivatives. Row i of the Jacobian is
    (u_i, c_i × u_i / ρ), with ρ the platform's characteristic length.
    """
    x, p, _, state, legs = _traced_legs(variant)
    rates = kinematics.rates_of_legs(legs, state).length_rate
    scaled, rho = kinematics.scaled_jacobian_of_legs(legs)
    results = [_column(v) for v in (legs.length, rates, scaled, rho)]
    return _function("legs", [x, p], results, ["length", "length_rate", "jacobian", "rho"])


@cache
@interrupts_held_back()
def signals_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `signals`: (x, p) -> y, the `interface.SIGNALS`: outputs without direct feedthrough."""
    x, u, p = _arguments(variant)
    _, y = _trace(x, u, p, variant)
    return _function("signals", [x, p], [y[: interface.N_SIGNALS]], ["y"])


@cache
@interrupts_held_back()
def margins_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `margins`: (x, p) -> square (6), determinant, size; distances to the pose limits.

    L_i², det K and ρ². K has the rows (l_i, c_i × l_i), so det K = det J L_1 ⋯ L_6. Without roots and quotients, for a
    fast check after every integration step.
    """
    x, p, parameters, _, legs = _traced_legs(variant)
    halves = [
        [[part[0, i, k] for k in range(3)] for i in range(6)] for part in (legs.vector, cross(legs.arm, legs.vector))
    ]
    size = dot(parameters.platform_points, parameters.platform_points).sum(axis=-1) / 6
    results = [_column(dot(legs.vector, legs.vector)), _determinant(*halves), _column(size)]
    return _function("margins", [x, p], results, ["square", "determinant", "size"])


@cache
@interrupts_held_back()
def posed_function(variant: Variant = IDEAL) -> casadi.Function:
    """CasADi Function `posed`: (x, p) -> y, square, determinant, size, s: all that depends on the state alone.

    y are the signals, the next three as of `margins`; from s and the inputs, `motion` gives the derivatives. So a state
    that is looked at, checked, and driven by one input after the other is evaluated once. Of a variant with parts there
    is no s; with bristles, there are their rates instead, as `decay`.
    """
    x, u, p = _arguments(variant)
    _, y = _trace(x, u, p, variant)
    results, names = (
        [y[: interface.N_SIGNALS], *margins_function(variant)(x, p)],
        ["y", "square", "determinant", "size"],
    )
    if variant == IDEAL:
        results, names = [*results, _split(x, u, p)[0]], [*names, "s"]
    if variant.bristles:
        results, names = [*results, decays_function(variant)(x, p)], [*names, "decay"]
    return _function("posed", [x, p], results, names)


@cache
@interrupts_held_back()
def motion_function() -> casadi.Function:
    """CasADi Function `motion`: (s, x, u) -> xdot, with s of `posed`: a wrench, and the solution of factors."""
    x, u, p = _arguments()
    shared, solved = _split(x, u, p)
    s = casadi.SX.sym("s", shared.numel())
    return casadi.Function("motion", [s, x, u], casadi.cse([solved(s)]), ["s", "x", "u"], ["xdot"])


def _arguments(variant: Variant = IDEAL) -> tuple[casadi.SX, casadi.SX, casadi.SX]:
    n, q = interface.size_of(variant.states), interface.size_of(variant.parameters)
    return casadi.SX.sym("x", n), casadi.SX.sym("u", N_INPUTS), casadi.SX.sym("p", q)


def _traced_legs(variant: Variant) -> tuple[casadi.SX, casadi.SX, Parameters, State, kinematics.LegGeometry]:
    """X and p of a function of the pose, and the parameters, state of the platform and legs in them."""
    x, _, p = _arguments(variant)
    state, parameters = State.from_vector(_symbols(x)[..., :N_STATES]), _parameters(p, variant)
    return x, p, parameters, state, kinematics.leg_geometry(parameters, state.position, state.orientation)


def _traced_grip(variant: Variant) -> tuple[casadi.SX, casadi.SX, Grip]:
    x, _, p = _arguments(variant)
    state, parameters = MachineState.from_vector(variant, _symbols(x)), _parameters(p, variant)
    return x, p, machine_dynamics.grip_of_legs(variant, parameters, state, _solve_symbolically)


def _function(name: str, arguments: list[casadi.SX], results: list[Any], names: list[str]) -> casadi.Function:
    return casadi.Function(name, arguments, casadi.cse(results), [v[0].name()[:-2] for v in arguments], names)


def _trace(x: casadi.SX, u: casadi.SX, p: casadi.SX, variant: Variant = IDEAL) -> tuple[casadi.SX, casadi.SX]:
    """The equations with symbols instead of numbers: (ẋ, y)."""
    state, parameters = MachineState.from_vector(variant, _symbols(x)), _parameters(p, variant)
    inputs = Inputs.from_vector(_symbols(u))
    rates = machine_dynamics.machine_rates(variant, parameters, state, inputs, _solve_symbolically)
    results = machine_dynamics.machine_results(variant, parameters, state, rates)
    xdot = machine_dynamics.machine_derivatives(state, rates)
    return _column(xdot), casadi.vertcat(*(_column(results[v.name]) for v in variant.results))


def _split(x: casadi.SX, u: casadi.SX, p: casadi.SX) -> tuple[casadi.SX, Callable[[casadi.SX], casadi.SX]]:
    """What the derivatives need of (x, p), s, and the derivatives as a function of s.

    M [v̇; ω̇] = b + B u with M = L D Lᵀ: s has the orientation's rates, D, Lᵀ, b and B.
    """
    state, inputs = State.from_vector(_symbols(x)), Inputs.from_vector(_symbols(u))
    systems = list[tuple[Array, Array]]()

    def keep(matrix: Array, vector: Array) -> Array:
        systems.append((matrix, vector))
        return vector

    dynamics.forward_dynamics(_parameters(p), state, inputs, solve=keep)
    ((M, vector),) = systems
    wrench = _column(vector)
    D, LT, order = casadi.ldl(casadi.vertcat(*(casadi.horzcat(*row) for row in M[0])))
    rate = _column(orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity))
    B, b = casadi.jacobian(wrench, u), casadi.substitute(wrench, u, casadi.SX.zeros(u.numel()))
    parts = [rate, casadi.vec(D), LT.nz[:], b, B.nz[:]]
    ends = np.cumsum([0, *(part.numel() for part in parts)]).tolist()

    def solved(s: casadi.SX) -> casadi.SX:
        rate, d, factors, b, gains = casadi.vertsplit(s, ends)
        of_wrench = b + casadi.SX(B.sparsity(), gains) @ u
        a = casadi.ldl_solve(of_wrench, d.reshape(D.shape), casadi.SX(LT.sparsity(), factors), order)
        return casadi.vertcat(x[6:9], rate, a)

    return casadi.vertcat(*parts), solved


def _parameters(p: casadi.SX, variant: Variant = IDEAL) -> Parameters:
    return Parameters(**interface.unpack(variant.parameters, _symbols(p)))


def _symbols(vector: casadi.SX) -> Array:
    """(1, n) object array of the elements."""
    return np.array([[vector[i] for i in range(vector.numel())]], dtype=object)


def _column(array: Array) -> Any:
    """casadi.SX (n, 1) of an object array's elements, row by row."""
    return casadi.vertcat(*array.reshape(-1))


def _determinant(left: list[list[Any]], right: list[list[Any]]) -> Any:
    """Determinant of [left, right], each (6, 3), by Laplace: Σ ± (minor of three rows of left) (rest of right).

    A minor is taken from 2×2 minors of its first two columns, which several minors share.
    """

    def minor(m: list[list[Any]]) -> Any:
        second = {(i, k): m[i][0] * m[k][1] - m[k][0] * m[i][1] for i, k in ((1, 2), (0, 2), (0, 1))}
        return m[0][2] * second[1, 2] - m[1][2] * second[0, 2] + m[2][2] * second[0, 1]

    terms = []
    for rows in combinations(range(6), 3):
        rest = [i for i in range(6) if i not in rows]
        sign = (-1) ** (sum(rows) - 3)
        terms.append(sign * minor([left[i] for i in rows]) * minor([right[i] for i in rest]))
    return sum(terms)


def _solve_symbolically(matrix: Array, vector: Array) -> Array:
    """LDLᵀ without pivoting: the mass matrix is symmetric and positive definite."""
    M = casadi.vertcat(*(casadi.horzcat(*row) for row in matrix[0]))
    D, LT, order = casadi.ldl(M)
    return _symbols(casadi.ldl_solve(_column(vector), D, LT, order))

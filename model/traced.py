"""The task-space dynamics traced once into CasADi Functions, parameters as run-time inputs.

x (12, or more of a variant with parts): position, orientation, velocity, angular_velocity, states of parts. u (12): the
inputs of the interface table. p: its platform parameters. y: its outputs and locals. Every vector in table order
(`gough_stewart.model.interface`).

| function | of | gives |
| --- | --- | --- |
| derivatives | x, u, p | xdot = f(x, u, p) |
| outputs | x, u, p | y = g(x, u, p) |
| jacobians | x, u, p | A, B, C, D, dense: those of (ẋ, y) with respect to (x, u), exact |
| tangent | x, u, p, dx, du | dxdot, dy: the change of (ẋ, y) in one direction |
| forward | x, u, p, dx, du, dp | dxdot, dy: δẋ = ∂ẋ/∂x δx + ∂ẋ/∂u δu + ∂ẋ/∂p δp, and likewise δy |
| reverse | x, u, p, wxdot, wy | gx, gu, gp: the gradient of wẋ·ẋ + wy·y |
| decays | x, p | decay (6) [1/s], of the bristles: ż = v − decay · z |
| grip | x, p | the parts of `friction.StickTerms`, the gain (36) column by column |
| sliding | x, p | sliding (6) [m/s], the velocities at which friction acts |
| legs | x, p | length (6), length_rate (6), jacobian (36), rho: for checks of poses, at a fifth of the cost |
| posed | x, p | y, square, determinant, size, s: all that depends on the state alone |
| motion | s, x, u | xdot, with s of `posed`: a wrench, and the solution of factors |

Row i of the Jacobian of `legs` is (u_i, c_i × u_i / ρ), with ρ the platform's characteristic length. In `posed`, y are
the signals; L_i², det K and ρ² are distances to the pose limits. K has the rows (l_i, c_i × l_i), so det K = det J
L_1 ⋯ L_6: no roots and quotients, for a fast check after every integration step. From s and the inputs, `motion` gives
the derivatives. So a state that is looked at, checked, and driven by one input after the other is evaluated once. Of a
variant with parts there is no s; with bristles, there are their rates instead, as `decay`.

The Functions are traced by calling `plant_equations` and functions of `kinematics` with object arrays of `casadi.SX`
scalars. They keep a leading axis of length 1, since NumPy turns 0-d object arrays into scalars.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations
from typing import Any

import casadi
import numpy as np

from gough_stewart.model import interface
from gough_stewart.model.dynamics import equations_of_motion, grip_of_legs, plant_equations
from gough_stewart.model.interface import IDEAL, N_INPUTS, N_STATES, Inputs, State, Variant
from gough_stewart.model.kinematics import LegGeometry, jacobian_of_legs, leg_geometry, rates_of_legs
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.process.progress import interrupts_held_back
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.vectors import Array, cross, dot


@cache
@interrupts_held_back()
def traced_function(name: str, variant: Variant = IDEAL) -> casadi.Function:  # noqa: PLR0911
    """The Function of a name in the table above, made at the first call for a variant, without interrupts."""
    x, _, p = _symbols_of(variant)
    match name:
        case "derivatives" | "outputs" | "jacobians":
            z, xdot, y = _equations(variant)
            if name == "jacobians":
                blocks = [casadi.densify(casadi.jacobian(f, v)) for f in (xdot, y) for v in z[:2]]
                return _function(name, z, **dict(zip("ABCD", blocks, strict=True)))
            return _function(name, z, xdot=xdot) if name == "derivatives" else _function(name, z, y=y)
        case "tangent" | "forward":
            z, *f = _equations(variant)
            directions = z[:2] if name == "tangent" else z
            dz = [casadi.SX.sym(f"d{letter}", v.numel()) for letter, v in zip("xup", directions, strict=False)]
            dxdot, dy = (casadi.jtimes(part, casadi.vertcat(*directions), casadi.vertcat(*dz)) for part in f)
            return _function(name, (*z, *dz), dxdot=dxdot, dy=dy)
        case "reverse":
            z, *f = _equations(variant)
            w = [casadi.SX.sym(f"w{result}", v.numel()) for result, v in zip(("xdot", "y"), f, strict=True)]
            gradient = casadi.jtimes(casadi.vertcat(*f), casadi.vertcat(*z), casadi.vertcat(*w), True)
            parts = casadi.vertsplit(gradient, [0, *np.cumsum([v.numel() for v in z])])
            return _function(name, (*z, *w), **dict(zip(("gx", "gu", "gp"), parts, strict=True)))
        case "decays" | "grip" | "sliding":
            grip = grip_of_legs(variant, _parameters(p, variant), _symbols(x), _solve_symbolically)
            if name == "grip":
                by_columns = grip._replace(gain=grip.gain.swapaxes(-1, -2))
                return _function(name, (x, p), **{key: _column(part) for key, part in by_columns._asdict().items()})
            key = "decay" if name == "decays" else "sliding"
            return _function(name, (x, p), **{key: _column(getattr(grip, key))})
        case "legs":
            _, state, legs = _legs(variant)
            scaled, rho = jacobian_of_legs(legs, scaled=True), np.sqrt(dot(legs.arm, legs.arm).sum(axis=-1) / 6)
            length, rates = _column(legs.length), _column(rates_of_legs(legs, state).length_rate)
            results = {"length": length, "length_rate": rates, "jacobian": _column(scaled), "rho": _column(rho)}
            return _function(name, (x, p), **results)
        case "posed":
            _, _, y = _equations(variant)
            parameters, _, legs = _legs(variant)
            vectors = (legs.vector, cross(legs.arm, legs.vector))
            points = parameters.platform_points
            results = {
                "y": y[: interface.N_SIGNALS],
                "square": _column(dot(legs.vector, legs.vector)),
                "determinant": _determinant(
                    *([[part[0, i, k] for k in range(3)] for i in range(6)] for part in vectors)
                ),
                "size": _column(dot(points, points).sum(axis=-1) / 6),
            }
            if variant == IDEAL:
                results["s"], _ = _split()
            if variant.bristles:
                results["decay"] = traced_function("decays", variant)(x, p)
            return _function(name, (x, p), **results)
        case _:  # motion
            x, u, _ = _symbols_of(IDEAL)
            shared, solved = _split()
            s = casadi.SX.sym("s", shared.numel())
            return _function(name, (s, x, u), xdot=solved(s))


@cache
def _symbols_of(variant: Variant) -> tuple[casadi.SX, casadi.SX, casadi.SX]:
    """The symbols x, u, p of a variant."""
    n, q = variant.n_states, variant.n_parameters
    return casadi.SX.sym("x", n), casadi.SX.sym("u", N_INPUTS), casadi.SX.sym("p", q)


@cache
def _equations(variant: Variant) -> tuple[tuple[casadi.SX, ...], casadi.SX, casadi.SX]:
    """The equations with symbols instead of numbers: (x, u, p), ẋ, y."""
    x, u, p = _symbols_of(variant)
    inputs = Inputs.from_vector(_symbols(u))
    xdot, results = plant_equations(variant, _parameters(p, variant), _symbols(x), inputs, _solve_symbolically)
    return (x, u, p), _column(xdot), casadi.vertcat(*(_column(results[v.name]) for v in variant.results))


def _legs(variant: Variant) -> tuple[Parameters, State, LegGeometry]:
    """The parameters, the platform's state and the legs in the symbols x and p."""
    x, _, p = _symbols_of(variant)
    state, parameters = State.from_vector(_symbols(x)[..., :N_STATES]), _parameters(p, variant)
    return parameters, state, leg_geometry(parameters, state.position, state.orientation)


def _function(name: str, arguments: Sequence[casadi.SX], **results: casadi.SX) -> casadi.Function:
    """A Function whose arguments have the names of their symbols; common subexpressions are evaluated once."""
    names = [v[0].name().removesuffix("_0") for v in arguments]
    return casadi.Function(name, [*arguments], casadi.cse([*results.values()]), names, [*results])


def _split() -> tuple[casadi.SX, Callable[[casadi.SX], casadi.SX]]:
    """What the derivatives need of (x, p), s, and the derivatives as a function of s, both of the ideal plant.

    M [v̇; ω̇] = b + B u with M = L D Lᵀ: s has the orientation's rates, D, Lᵀ, b and B.
    """
    x, u, _ = _symbols_of(IDEAL)
    parameters, state, legs = _legs(IDEAL)
    M, n, *_ = equations_of_motion(parameters, state, legs)
    D, LT, order = casadi.ldl(casadi.vertcat(*(casadi.horzcat(*row) for row in M[0])))
    rate = _column(orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity))
    J = casadi.vertcat(*(casadi.horzcat(*row) for row in jacobian_of_legs(legs)[0]))
    B, b = casadi.horzcat(J.T, casadi.SX.eye(6)), -_column(n)
    parts = [rate, casadi.vec(D), LT.nz[:], b, B.nz[:]]
    ends = np.cumsum([0, *(part.numel() for part in parts)]).tolist()

    def solved(s: casadi.SX) -> casadi.SX:
        rate, d, factors, b, gains = casadi.vertsplit(s, ends)
        of_wrench = b + casadi.SX(B.sparsity(), gains) @ u
        a = casadi.ldl_solve(of_wrench, d.reshape(D.shape), casadi.SX(LT.sparsity(), factors), order)
        return casadi.vertcat(x[6:9], rate, a)

    return casadi.vertcat(*parts), solved


def _parameters(p: casadi.SX, variant: Variant) -> Parameters:
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
    D, LT, order = casadi.ldl(casadi.vertcat(*(casadi.horzcat(*row) for row in matrix[0])))
    return _symbols(casadi.ldl_solve(_column(vector), D, LT, order))

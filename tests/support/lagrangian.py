"""Inverse dynamics by a Lagrangian, for logs of machines: independent of the physics and of every fit.

Only places and energies of the bodies are written down; d/dt ∂T/∂q̇ − ∂T/∂q + ∂V/∂q = (∂L/∂q)ᵀ F follows by automatic
differentiation in q: position, roll, pitch, yaw. One rigid body is the platform, two are each leg, of which the lower
one turns about its base joint, and the rotor's inertia acts along the leg.
"""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import NDArray

from gough_stewart import Platform

FloatArray = NDArray[np.float64]


class Pose(NamedTuple):
    """A motion of the pose, each (n, 6): position [m], roll, pitch, yaw [rad], and derivatives."""

    q: FloatArray
    rate: FloatArray
    acceleration: FloatArray


def legs_along(machine: Platform, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Lengths [m] and velocities [m/s] of the legs along a motion, each (n, 6)."""
    length, velocity = _evaluated(0, np.concatenate(pose[:2], axis=1), machine)
    return length, velocity


def forces_along(machine: Platform, pose: Pose) -> FloatArray:
    """Actuator forces (n, 6) that a motion needs without friction [N]."""
    generalized, jacobian = _evaluated(1, np.concatenate(pose, axis=1), machine)
    # column by column, of each row the transposed matrix
    transposed = jacobian.reshape(-1, 6, 6)
    return np.asarray(np.linalg.solve(transposed, generalized[..., None])[..., 0], dtype=float)


def equations_at(machine: Platform, q: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """M (6, 6), h (6,) and ∂L/∂q (6, 6) of a frictionless machine: M q̈ + h = (∂L/∂q)ᵀ F."""
    M, h, by_angles = _evaluated(2, np.concatenate([q, rate])[None], machine)
    # column by column
    return M.reshape(6, 6), h[0], by_angles.reshape(6, 6).T


def _evaluated(which: int, rows: FloatArray, machine: Platform) -> list[FloatArray]:
    """The outputs of a function for each row of its first input, (n, size)."""
    inputs, outputs, (_, call) = _memory(which, len(rows))
    inputs[0][:], inputs[1][:] = rows, _numbers(machine)
    call()
    return [output.copy() for output in outputs]


@lru_cache(maxsize=64)
def _numbers(machine: Platform) -> FloatArray:
    values = {name: getattr(machine, name) * getattr(machine, f"{name}_factor", 1.0) for name in _SIZES}
    return np.concatenate([np.ravel(value) for value in values.values()])


@lru_cache(16)
def _memory(which: int, n: int) -> tuple[list[Any], list[Any], tuple[Any, Any]]:
    """Arrays of inputs and outputs for n rows, and what evaluates them without the conversions of a call."""
    function = _functions()[which]
    mapped: Any = function.map("rows", "serial", n, [1], [])
    buffer, call = mapped.buffer()
    inputs: list[Any] = [np.zeros((n, function.numel_in(0))), np.zeros(function.numel_in(1))]
    outputs: list[Any] = [np.zeros((n, function.numel_out(k))) for k in range(function.n_out())]
    for k, array in enumerate(inputs):
        buffer.set_arg(k, memoryview(array))
    for k, array in enumerate(outputs):
        buffer.set_res(k, memoryview(array))
    return inputs, outputs, (buffer, call)


_SIZES = {
    "base_points": 18,
    "platform_points": 18,
    "platform_mass": 1,
    "platform_com": 3,
    "platform_inertia": 9,
    **{f"leg_{part}_{name}": 6 for name in ("mass", "com", "inertia") for part in ("lower", "upper")},
    "leg_armature": 6,
    "gravity": 3,
}


@cache
def _functions() -> tuple[casadi.Function, casadi.Function, casadi.Function]:
    """((q, q̇), p) -> L, L̇; ((q, q̇, q̈), p) -> generalized forces M q̈ + h, ∂L/∂q; ((q, q̇), p) -> M, h, ∂L/∂q."""
    q, rate, acceleration = (casadi.SX.sym(name, 6) for name in ("q", "rate", "acceleration"))
    parameters = casadi.SX.sym("p", sum(_SIZES.values()))
    ends = np.cumsum([0, *_SIZES.values()])
    p = {name: parameters[int(a) : int(b)] for name, a, b in zip(_SIZES, ends[:-1], ends[1:], strict=True)}

    def moving(x: casadi.SX) -> casadi.SX:
        return casadi.jtimes(x, q, rate)

    position = q[:3]
    R = _turn(2, q[5]) @ _turn(1, q[4]) @ _turn(0, q[3])
    spin = R.T @ casadi.reshape(moving(casadi.vec(R)), 3, 3)
    omega = casadi.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
    centre = position + R @ p["platform_com"]
    kinetic = p["platform_mass"] * casadi.sumsqr(moving(centre)) / 2
    kinetic += omega.T @ casadi.reshape(p["platform_inertia"], 3, 3) @ omega / 2
    potential = -p["platform_mass"] * casadi.dot(p["gravity"], centre)
    lengths = []
    for i in range(6):
        B = p["base_points"][3 * i : 3 * i + 3]
        P = position + R @ p["platform_points"][3 * i : 3 * i + 3]
        length = casadi.norm_2(P - B)
        u = (P - B) / length
        lower, upper = B + p["leg_lower_com"][i] * u, P - p["leg_upper_com"][i] * u
        for name, body in (("lower", lower), ("upper", upper)):
            kinetic += p[f"leg_{name}_mass"][i] * casadi.sumsqr(moving(body)) / 2
            kinetic += p[f"leg_{name}_inertia"][i] * casadi.sumsqr(moving(u)) / 2
            potential -= p[f"leg_{name}_mass"][i] * casadi.dot(p["gravity"], body)
        kinetic += p["leg_armature"][i] * moving(length) ** 2 / 2
        lengths.append(length)
    L = casadi.vertcat(*lengths)
    momentum = casadi.gradient(kinetic, rate)
    both, its_rate = casadi.vertcat(q, rate), casadi.vertcat(rate, acceleration)
    generalized = casadi.jtimes(momentum, both, its_rate) - casadi.gradient(kinetic - potential, q)
    lengths_of = casadi.Function("lengths", [both, parameters], casadi.cse([L, moving(L)]))
    outputs = casadi.cse([generalized, casadi.jacobian(L, q)])
    forces = casadi.Function("forces", [casadi.vertcat(both, acceleration), parameters], outputs)
    bias = casadi.substitute(generalized, acceleration, casadi.SX.zeros(6))
    outputs = casadi.cse([casadi.jacobian(momentum, rate), bias, casadi.jacobian(L, q)])
    return lengths_of, forces, casadi.Function("equations", [both, parameters], outputs)


def _turn(axis: int, angle: casadi.SX) -> casadi.SX:
    """A rotation about a fixed axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = casadi.SX.eye(3)
    R[j, j] = R[k, k] = casadi.cos(angle)
    R[k, j] = casadi.sin(angle)
    R[j, k] = -casadi.sin(angle)
    return R

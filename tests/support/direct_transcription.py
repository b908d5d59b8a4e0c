"""The least time along a path by another road: direct transcription in time, solved by IPOPT; forces by Newton–Euler.

Unknown are x = ṡ² and s̈ at all points of a grid at once, with s̈ linear between them. Friction and power are in it as
they are. Shared with what it checks are the path alone.
"""

from dataclasses import replace
from typing import Any

import casadi
import numpy as np

from gough_stewart import Platform, leg_geometry
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.arrays import FloatArray

# Keeps √x away from 0, where it has no slope.
_ROUNDING = 1e-10


def least_time(platform: Platform, path: GeometricPath, n: int) -> float:
    """Duration [s] of the fastest motion with s̈ linear in s on each of n intervals."""
    even = np.linspace(0, 1, n + 1)
    s = (even + (1 - np.cos(np.pi * even)) / 2) / 2  # denser where ṡ is small
    l, k, a, b, c = _along(platform, path, s)
    # unknowns about 1
    size = float(1 / np.abs(l).max() ** 2)
    unknown = casadi.SX.sym("x", n + 1), casadi.SX.sym("u", n + 1)
    x, u = (size * each for each in unknown)
    rate = casadi.sqrt(x + _ROUNDING * size)
    time = sum(2 * (s[i + 1] - s[i]) / (rate[i] + rate[i + 1]) for i in range(n))
    grown = [(x[i + 1] - x[i] - (s[i + 1] - s[i]) * (u[i] + u[i + 1])) / size for i in range(n)]
    used = []
    for leg in range(6):
        speed = l[:, leg] * rate
        friction = platform.leg_viscous_friction * speed + platform.leg_coulomb_friction * casadi.tanh(
            speed / platform.leg_friction_velocity
        )
        force = a[:, leg] * u + b[:, leg] * x + c[:, leg] + friction
        asked = {
            "leg_velocity_max": speed,
            "leg_acceleration_max": l[:, leg] * u + k[:, leg] * x,
            "actuator_force_max": force,
            "actuator_power_max": force * speed,
        }
        used += [each / getattr(platform, name) for name, each in asked.items() if getattr(platform, name) is not None]
    shares = casadi.vertcat(*used)
    problem: dict[str, Any] = {"x": casadi.vertcat(*unknown), "f": time, "g": casadi.vertcat(*grown, shares)}
    options: dict[str, Any] = {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 500, "tol": 1e-9},
    }
    solver = casadi.nlpsol("fastest", "ipopt", problem, options)
    at_rest = np.concatenate([[0.0], np.full(n - 1, np.inf), [0.0]])
    free = np.full(n + 1, np.inf)
    m = shares.numel()
    found = solver(
        x0=np.concatenate([0.01 * np.sin(np.pi * s), np.zeros(n + 1)]),
        lbx=np.concatenate([np.zeros(n + 1), -free]),
        ubx=np.concatenate([at_rest, free]),
        lbg=np.concatenate([np.zeros(n), -np.ones(m)]),
        ubg=np.concatenate([np.zeros(n), np.ones(m)]),
    )
    if not solver.stats()["success"]:
        raise AssertionError(f"IPOPT: {solver.stats()['return_status']}")
    return float(found["f"])


def _along(platform: Platform, path: GeometricPath, s: FloatArray) -> tuple[FloatArray, ...]:
    """L̇ = l ṡ, L̈ = l s̈ + k ṡ² by differences of leg lengths, F = a s̈ + b ṡ² + c without friction; each (n, 6)."""
    h = 1e-4
    near = np.clip(s, h, 1 - h)
    before, now, after = (
        np.asarray(leg_geometry(platform, point.position, point.orientation).length)
        for point in (path(near - h), path(near), path(near + h))
    )
    l, k = (after - before) / (2 * h), (after - 2 * now + before) / h**2
    smooth = replace(platform, leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    zero, one = np.zeros_like(s), np.ones_like(s)
    point = path(s)
    at_rest = point.motion(zero, zero)
    weight = accelerations(smooth, at_rest, np.zeros(6))
    gain = np.stack([accelerations(smooth, at_rest, force) - weight for force in np.eye(6)], axis=2)

    def forces(motion: Motion) -> FloatArray:
        """Those whose accelerations by Newton–Euler, affine in them, are the motion's."""
        wanted = np.concatenate([motion.acceleration, motion.angular_acceleration], axis=1)
        missing = wanted - accelerations(smooth, motion, np.zeros(6))
        return np.asarray(np.linalg.solve(gain, missing[:, :, None])[:, :, 0])

    c = forces(at_rest)
    return l, k, forces(point.motion(zero, one)) - c, forces(point.motion(one, zero)) - c, c


def accelerations(platform: Platform, motion: Motion, force: FloatArray) -> FloatArray:
    """Linear and angular (n, 6) under six actuator forces."""
    n = len(motion.position)
    rates = (motion.velocity, motion.angular_velocity)
    pose = (motion.position, matrix_from_orientation(motion.orientation))
    nothing = np.zeros((n, 3))
    found = newton_euler.solve(platform, *pose, *rates, np.broadcast_to(force, (n, 6)), nothing, nothing)
    return np.concatenate([found.linear, found.angular], axis=1)

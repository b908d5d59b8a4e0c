"""The least time along a path by another road: direct transcription in time, solved by IPOPT; forces by a Lagrangian.

Unknown are x = ṡ² and s̈ at all points of a grid at once, with s̈ linear between them. Friction and power are in it as
they are. Shared with what it checks are the path alone.
"""

from typing import Any

import casadi
import numpy as np

from gough_stewart import Platform
from tests.support.arrays import FloatArray
from tests.support.lagrangian import Pose, forces_along, legs_along

# Keeps √x away from 0, where it has no slope.
_ROUNDING = 1e-10


def least_time(platform: Platform, path: Any, n: int) -> float:
    """Duration [s] of the fastest motion with s̈ linear in s on each of n intervals; the path has poses for s (m,)."""
    even = np.linspace(0, 1, n + 1)
    s = (even + (1 - np.cos(np.pi * even)) / 2) / 2  # denser where ṡ is small
    l, k, a, b, c = _along(platform, path, s)
    # unknowns about 1
    size = float(1 / np.abs(l).max() ** 2)
    unknown = casadi.SX.sym("x", n + 1), casadi.SX.sym("u", n + 1)
    x, u = (size * symbol for symbol in unknown)
    rate = casadi.sqrt(x + _ROUNDING * size)
    time = sum(2 * (s[i + 1] - s[i]) / (rate[i] + rate[i + 1]) for i in range(n))
    grown = [(x[i + 1] - x[i] - (s[i + 1] - s[i]) * (u[i] + u[i + 1])) / size for i in range(n)]
    viscous = platform.leg_viscous_friction * platform.leg_viscous_friction_factor
    coulomb = platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor
    used = []
    for leg in range(6):
        speed = l[:, leg] * rate
        friction = viscous[leg] * speed + coulomb[leg] * casadi.tanh(speed / platform.leg_friction_velocity)
        force = a[:, leg] * u + b[:, leg] * x + c[:, leg] + friction
        asked = {
            "leg_velocity_max": speed,
            "leg_acceleration_max": l[:, leg] * u + k[:, leg] * x,
            "actuator_force_max": force,
            "actuator_power_max": force * speed,
        }
        stated = {name: getattr(platform, name) for name in asked}
        used += [values / stated[name] for name, values in asked.items() if stated[name] is not None]
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


def _along(platform: Platform, path: Any, s: FloatArray) -> tuple[FloatArray, ...]:
    """L̇ = l ṡ, L̈ = l s̈ + k ṡ², F = a s̈ + b ṡ² + c without friction; each (n, 6), by differences along the path."""
    h = 1e-4
    near = np.clip(s, h, 1 - h)
    before, now, after = (np.hstack(path(near + step)[:2]) for step in (-h, 0, h))
    first, second, none = (after - before) / (2 * h), (after - 2 * now + before) / h**2, np.zeros_like(now)
    lengths = [legs_along(platform, Pose(q, none, none))[0] for q in (before, now, after)]
    l, k = (lengths[2] - lengths[0]) / (2 * h), (lengths[2] - 2 * lengths[1] + lengths[0]) / h**2
    c = forces_along(platform, Pose(now, none, none))
    a, b = (forces_along(platform, pose) - c for pose in (Pose(now, none, first), Pose(now, first, second)))
    return l, k, a, b, c

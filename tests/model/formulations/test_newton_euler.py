"""Newton–Euler: balances of the whole mechanism, which no single free body knows."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.random_platforms import random_inputs, random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN


def at_rest(platform: Platform, position: np.ndarray, orientation: np.ndarray) -> newton_euler.NewtonEulerSolution:
    zero = np.zeros(3)
    F = static_leg_forces(platform, position, orientation)
    R = matrix_from_orientation(orientation)
    return newton_euler.solve(platform, position, R, zero, zero, F, zero, zero)


@given(st.integers(0, 2**32 - 1))
def test_at_rest_the_base_carries_the_whole_weight(seed: int) -> None:
    """Expected: Σ forces and Σ moments about the world origin of the whole mechanism vanish."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    position, orientation = random_state(platform, rng)[:2]
    solution = at_rest(platform, position, orientation)
    legs = leg_geometry(platform, position, orientation)
    g, m1, m2 = platform.gravity, platform.leg_lower_mass, platform.leg_upper_mass
    G = position + matrix_from_orientation(orientation) @ platform.platform_com
    G1 = platform.base_points + platform.leg_lower_com * legs.direction
    G2 = platform.base_points + (legs.length - platform.leg_upper_com)[:, None] * legs.direction
    weight = (platform.platform_mass + 6 * (m1 + m2)) * g
    size = np.abs(weight).max() + np.abs(solution.base_force).max()
    assert np.allclose(solution.base_force.sum(axis=0), -weight, atol=1e-10 * size)
    moment = np.cross(platform.base_points, solution.base_force).sum(axis=0)
    moment += (
        np.cross(G, platform.platform_mass * g) + np.cross(G1, m1 * g).sum(axis=0) + np.cross(G2, m2 * g).sum(axis=0)
    )
    moment += (solution.spin_torque[:, None] * legs.direction).sum(axis=0)
    assert np.allclose(moment, 0, atol=1e-9 * size * np.abs(position).max())


@given(st.integers(0, 2**32 - 1))
def test_the_momentum_of_the_whole_mechanism_changes_by_base_forces_weight_and_load(seed: int) -> None:
    """Expected: Newton's law of the whole; the momentum's rate by central differences along the motion."""
    rng = np.random.default_rng(seed)
    platform = replace(random_platform(rng), leg_coulomb_friction=0.0)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    R = matrix_from_orientation(state.orientation)
    solution = newton_euler.solve(platform, state.position, R, state.velocity, state.angular_velocity, *inputs)

    def momentum(h: float) -> np.ndarray:
        turn = Rotation.from_rotvec(h * state.angular_velocity + 0.5 * h * h * solution.angular).as_matrix()
        R_h = turn @ R
        omega = state.angular_velocity + h * solution.angular
        velocity = state.velocity + h * solution.linear
        position = state.position + h * state.velocity + 0.5 * h * h * solution.linear
        arm = platform.platform_points @ R_h.T
        l = position + arm - platform.base_points
        L = np.linalg.norm(l, axis=1, keepdims=True)
        u = l / L
        v_P = velocity + np.cross(omega, arm)
        slide = (u * v_P).sum(axis=1, keepdims=True)
        du = (v_P - slide * u) / L
        v1 = platform.leg_lower_com * du
        v2 = (L - platform.leg_upper_com) * du + slide * u
        v_G = velocity + np.cross(omega, R_h @ platform.platform_com)
        of_legs = (platform.leg_lower_mass * v1 + platform.leg_upper_mass * v2).sum(axis=0)
        return np.asarray(platform.platform_mass * v_G + of_legs)

    h = 1e-6
    rate = (momentum(h) - momentum(-h)) / (2 * h)
    mass = platform.platform_mass + 6 * (platform.leg_lower_mass + platform.leg_upper_mass)
    total = solution.base_force.sum(axis=0) + inputs.external_force + mass * platform.gravity
    assert np.allclose(rate, total, atol=1e-5 * np.abs(total).max() + 1e-6 * np.abs(solution.base_force).max())


def test_every_constraint_force_balances_both_parts_of_every_leg() -> None:
    """Expected: Newton's and Euler's laws of each part, with the accelerations by differences along the motion.

    Rotor and screw take m_a L̈ of the push. The axial moment of inertia is none, so that only α across the leg counts.
    """
    R = Rotation.from_euler("xyz", STATE.orientation)
    found = newton_euler.solve(UNEVEN, STATE.position, R.as_matrix(), STATE.velocity, STATE.angular_velocity, *INPUTS)

    def legs(t: float) -> tuple[np.ndarray, ...]:
        """Axes, rates of length, angular velocities, velocities of both centres of mass."""
        turn = Rotation.from_rotvec(t * STATE.angular_velocity + 0.5 * t * t * found.angular) * R
        omega, velocity = STATE.angular_velocity + t * found.angular, STATE.velocity + t * found.linear
        arm = turn.apply(UNEVEN.platform_points.copy())
        l = STATE.position + t * STATE.velocity + 0.5 * t * t * found.linear + arm - UNEVEN.base_points
        L = np.linalg.norm(l, axis=1)[:, None]
        u, v = l / L, velocity + np.cross(omega, arm)
        rate = (u * v).sum(axis=1)[:, None]
        turning = np.cross(u, v) / L
        return u, rate, turning, 0.47 * np.cross(turning, u), (L - 0.58) * np.cross(turning, u) + rate * u, L

    h = 1e-5
    u, rate, _, _, _, L = legs(0.0)
    ahead, behind = legs(h), legs(-h)
    stretching, alpha, a1, a2 = ((ahead[k] - behind[k]) / (2 * h) for k in (1, 2, 3, 4))
    coulomb = 1.9 * UNEVEN.leg_coulomb_friction_factor * np.tanh(rate[:, 0] / 0.06)
    friction = 7.0 * UNEVEN.leg_viscous_friction_factor * rate[:, 0] + coulomb
    push = (INPUTS.actuator_force - friction)[:, None] * u - 1.7 * stretching * u
    g, N, f_B, f_P, M = UNEVEN.gravity, found.guide_force, found.base_force, found.joint_force, found.guide_moment
    across = alpha - (alpha * u).sum(axis=1)[:, None] * u
    scale = np.abs(f_P).max()
    assert np.abs(2.3 * a1 - (f_B - N - push + 2.3 * g)).max() < 1e-6 * scale
    assert np.abs(1.2 * a2 - (N + push - f_P + 1.2 * g)).max() < 1e-6 * scale
    torque = found.spin_torque[:, None] * u
    lower = -np.cross(0.47 * u, f_B) + torque - M - np.cross((L - 0.58 - 0.47) * u, N)
    assert np.abs(0.13 * across - lower).max() < 1e-6 * scale
    assert np.abs(0.061 * across - (M - np.cross(0.58 * u, f_P))).max() < 1e-6 * scale

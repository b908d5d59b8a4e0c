"""Rotor and screw reflected along the leg: an inertia against the change of its length, without weight."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gough_stewart.model import dynamics
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_geometry, leg_rates
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import orientation_rate_from_angular_velocity
from gough_stewart.model.state import Inputs, State
from tests.support.random_platforms import random_inputs, random_platform, random_state

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_kinetic_energy_gains_half_the_armature_times_the_square_of_each_rate(seed: int) -> None:
    """Expected: ½ m_a Σ L̇², with L̇ by differences of the leg lengths."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state, without = random_state(platform, rng), replace(platform, leg_armature=0.0)
    gain = dynamics.kinetic_energy(platform, state) - dynamics.kinetic_energy(without, state)
    turning = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
    h, rate = 1e-6, np.concatenate([state.velocity, turning])
    ahead, behind = (leg_geometry(platform, *np.split(np.concatenate(state[:2]) + s * rate, 2)).length for s in (h, -h))
    rates = (ahead - behind) / (2 * h)
    assert float(gain) == pytest.approx(0.5 * platform.leg_armature * (rates**2).sum(), rel=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_energy_of_a_motion_is_the_work_of_the_forces(seed: int) -> None:
    """Expected: frictionless, constant forces work W = Σ F_i (L_i(t) − L_i(0)) and f·(t(t) − t(0)); at rtol 1e-11."""
    rng = np.random.default_rng(seed)
    platform = replace(random_platform(rng), leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    weight, size = 10 * platform.platform_mass, platform.characteristic_length
    push = Inputs(0.3 * weight * rng.uniform(0.5, 1, 6), 0.2 * weight * rng.normal(size=3), np.zeros(3))
    start = State(
        platform.home_position, platform.home_orientation, 0.2 * size * rng.normal(size=3), rng.normal(size=3)
    )
    kernel, p, u = Kernel(), parameter_vector(platform), push.to_vector()
    run = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        (0, 0.2),
        start.to_vector(),
        method="DOP853",
        rtol=1e-11,
        atol=1e-11,
    )
    x = run.y.T
    lengths = leg_geometry(platform, x[:, :3], x[:, 3:6]).length
    work = (lengths - lengths[0]) @ push.actuator_force + (x[:, :3] - x[0, :3]) @ push.external_force
    states = State.from_vector(x)
    E = dynamics.kinetic_energy(platform, states) + dynamics.potential_energy(
        platform, states.position, states.orientation
    )
    assert np.abs(E - E[0] - work).max() <= 1e-9 * np.abs(work).max()


@given(seeds)
def test_holding_the_platform_takes_the_same_forces(seed: int) -> None:
    """Expected: what only turns has no weight."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    pose = random_state(platform, rng)[:2]
    heavier = replace(platform, leg_armature=100 * platform.platform_mass)
    expected = dynamics.static_leg_forces(platform, *pose)
    assert np.allclose(dynamics.static_leg_forces(heavier, *pose), expected, rtol=1e-12)


def test_heave_on_massless_legs_is_that_of_one_degree_of_freedom(paper: Platform) -> None:
    """Expected: Lagrange, L² = z² + a²: (m + 6 m_a z²/L²) z̈ + 6 m_a (z/L² − z³/L⁴) ż² = 6 F z/L − m g."""
    platform = replace(
        paper, leg_armature=7.0, leg_lower_mass=1e-14, leg_upper_mass=1e-14, leg_lower_inertia=0, leg_upper_inertia=0
    )
    z, rate, force, m, m_a = 2.7, 1.3, 40.0, 10.0, 7.0
    L = float(np.hypot(z, np.linalg.norm(paper.base_points[0] - paper.platform_points[0])))
    state = State(np.array([0, 0, z]), np.zeros(3), np.array([0, 0, rate]), np.zeros(3))
    found = dynamics.forward_dynamics(platform, state, Inputs.from_actuators(np.full(6, force)))
    expected = 6 * force * z / L - m * 9.81 - 6 * m_a * (z / L**2 - z**3 / L**4) * rate**2
    assert found.linear[2] == pytest.approx(expected / (m + 6 * m_a * z**2 / L**2), rel=1e-12)


@given(seeds)
def test_the_platform_feels_the_actuator_less_what_turns_the_rotor(seed: int) -> None:
    """Expected: at equal motion, joint forces lose m_a L̈ along each leg; L̈ by differences of L̇ along the motion."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    a = dynamics.forward_dynamics(platform, state, inputs)
    turning = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
    h, x, xdot = 1e-5, state.to_vector(), np.concatenate([state.velocity, turning, *a])
    ahead, behind = (leg_rates(platform, State.from_vector(x + s * xdot)).length_rate for s in (h, -h))
    reflected = platform.leg_armature * (ahead - behind) / (2 * h)
    u = leg_geometry(platform, state.position, state.orientation).direction
    found = dynamics.joint_forces(platform, state, inputs.actuator_force, a)
    free = dynamics.joint_forces(replace(platform, leg_armature=0.0), state, inputs.actuator_force, a)
    assert np.allclose(found, free - reflected[:, None] * u, atol=1e-6 * np.abs(free).max())

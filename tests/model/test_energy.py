"""Energy over whole motions: what comes in is what is there."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gough_stewart.model import dynamics
from gough_stewart.model.dynamics import static_leg_forces
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.kinematics import leg_geometry, leg_rates
from gough_stewart.model.platform import Platform
from gough_stewart.model.state import Inputs, State
from tests.support.uneven import INPUTS, STATE, UNEVEN

PAPER_START = State(np.array([0, 0, 3.0]), np.array([0, 0, -0.1]), np.array([0, 0.2, 0]), np.array([0, 0.1, 0]))


def total_energy(platform: Platform, x: np.ndarray) -> np.ndarray:
    state = State.from_vector(x)
    kinetic = dynamics.kinetic_energy(platform, state)
    return np.asarray(kinetic + dynamics.potential_energy(platform, state.position, state.orientation))


def test_energy_of_the_published_second_is_the_work_of_the_forces(paper: Platform) -> None:
    """Expected: constant forces work W = Σ F_i (L_i(t) − L_i(0)); relative to the largest W, at rtol 1e-10."""
    force = np.array([55.0, 49.5] * 3)
    kernel, p, u = Kernel(), parameter_vector(paper), Inputs.from_actuators(force).to_vector()
    run = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        (0, 1),
        PAPER_START.to_vector(),
        method="DOP853",
        rtol=1e-10,
        atol=1e-10,
    )
    x = run.y.T
    lengths = leg_geometry(paper, x[:, :3], x[:, 3:6]).length
    work = (lengths - lengths[0]) @ force
    E = total_energy(paper, x)
    assert np.abs(E - E[0] - work).max() <= 1e-9 * np.abs(work).max()


def test_energy_of_an_uneven_platform_is_the_work_of_all_forces_less_what_friction_takes() -> None:
    """Expected: the power of actuators, external wrench and friction, summed along the way by the integrator."""
    kernel, p, u = Kernel(), parameter_vector(UNEVEN), INPUTS.to_vector()

    def derivative(_t: float, x: np.ndarray) -> np.ndarray:
        state = State.from_vector(x[:12])
        rate = leg_rates(UNEVEN, state).length_rate
        friction = UNEVEN.leg_viscous_friction * UNEVEN.leg_viscous_friction_factor * rate
        coulomb = UNEVEN.leg_coulomb_friction * UNEVEN.leg_coulomb_friction_factor
        friction = friction + coulomb * np.tanh(rate / UNEVEN.leg_friction_velocity)
        power = (INPUTS.actuator_force - friction) @ rate
        power += INPUTS.external_force @ state.velocity + INPUTS.external_torque @ state.angular_velocity
        return np.append(kernel.derivatives(x[:12], u, p), power)

    start = np.append(STATE.to_vector(), 0.0)
    run = solve_ivp(derivative, (0, 0.8), start, method="DOP853", rtol=1e-11, atol=1e-11)
    x, work = run.y[:12].T, run.y[12]
    E = total_energy(UNEVEN, x)
    assert np.abs(work).max() > 10
    assert np.abs(E - E[0] - work).max() <= 1e-9 * np.abs(work).max()


def spring_energy_error(platform: Platform, start: State, stiffness: float, duration: float) -> tuple[float, float]:
    """Largest relative change of the total energy with legs as springs F = F0 + k (L0 − L), and the largest travel.

    The springs store V = Σ ½ k (L0 − L)² − F0 L; relative to the largest kinetic energy. rtol 1e-12.
    """
    home = platform.home_position, platform.home_orientation
    F0, L0 = static_leg_forces(platform, *home), leg_geometry(platform, *home).length
    kernel, p, u = Kernel(), parameter_vector(platform), np.zeros(12)

    def derivative(_t: float, x: np.ndarray) -> np.ndarray:
        L = leg_geometry(platform, x[:3], x[3:6]).length
        u[:6] = F0 + stiffness * (L0 - L)
        return kernel.derivatives(x, u, p).copy()

    run = solve_ivp(derivative, (0, duration), start.to_vector(), method="DOP853", rtol=1e-12, atol=1e-12)
    x = run.y.T
    L = leg_geometry(platform, x[:, :3], x[:, 3:6]).length
    springs = (0.5 * stiffness * (L0 - L) ** 2 - F0 * L).sum(axis=1)
    E = total_energy(platform, x) + springs
    kinetic = dynamics.kinetic_energy(platform, State.from_vector(x)).max()
    return float(np.abs(E - E[0]).max() / kinetic), float(np.abs(L - L0).max())


def test_energy_on_springs_is_constant_over_60_seconds(paper: Platform) -> None:
    """Expected: a conservative system; bounded motion from the paper's start."""
    error, travel = spring_energy_error(paper, PAPER_START, stiffness=1000.0, duration=60.0)
    assert travel < 0.5
    assert error <= 1e-9


def test_potential_energy_is_zero_with_everything_at_the_world_plane(paper: Platform) -> None:
    """Expected: mass at z = 0 only. With every P_i and B_i in the plane z = 0, so are all centres of mass."""
    flat = dynamics.potential_energy(paper, np.array([0.3, 0.1, 0.0]), np.array([0, 0, 0.4]))
    assert flat == pytest.approx(0.0, abs=1e-12)

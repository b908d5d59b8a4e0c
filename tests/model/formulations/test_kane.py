"""Kane's equations: the paper's relations between velocities, constraints and multipliers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from gough_stewart.model import interface
from gough_stewart.model.formulations import kane
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs, State
from gough_stewart.model.vectors import skew
from tests.support.random_platforms import Sample, random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN

seeds = st.integers(0, 2**32 - 1)
PAPER_START = State(np.array([0, 0, 3.0]), np.array([0, 0, -0.1]), np.array([0, 0.2, 0]), np.array([0, 0.1, 0]))
PAPER_INPUTS = Inputs.from_actuators(np.array([55.0, 49.5] * 3))


def start_of(platform: Platform, state: State) -> tuple[kane.Configuration, np.ndarray]:
    R = matrix_from_orientation(state.orientation)
    return kane.consistent_start(platform, state.position, R, state.velocity, state.angular_velocity)


def moved(configuration: kane.Configuration, y: np.ndarray, h: float) -> kane.Configuration:
    """The configuration after h seconds at speeds y, to first order; d(R)/dt = ω~ R, eq. (3)."""
    omega, slide_rate = kane.leg_speeds(y)
    omega_p, v = kane.platform_speeds(y)
    return kane.Configuration(
        configuration.leg_rotation + h * skew(omega) @ configuration.leg_rotation,
        configuration.slide + h * slide_rate,
        configuration.position + h * v,
        configuration.rotation + h * skew(omega_p) @ configuration.rotation,
    )


def test_skew_matrix_is_the_papers() -> None:
    """Expected: eq. (4)."""
    assert np.array_equal(skew(np.array([1.0, 2.0, 3.0])), [[0, -3, 2], [3, 0, -1], [-2, 1, 0]])


def test_consistent_start_satisfies_all_constraints(thousand: Sample) -> None:
    """Expected: Φ = 0 and Φ_q y = 0, eq. (27)."""
    configuration, y = start_of(thousand.parameters, thousand.state)  # type: ignore[arg-type]
    assert np.abs(kane.constraint_residual(thousand.parameters, configuration)).max() < 1e-14
    slip = (kane.constraint_jacobian(thousand.parameters, configuration) @ y[..., None])[..., 0]
    assert np.abs(slip).max() < 1e-12


@given(seeds)
def test_partial_velocities_give_the_velocities_of_the_mass_centres(seed: int) -> None:
    """Expected: central differences of R r1 and R (s + r2); eqs. (9) to (12)."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    configuration, y = start_of(platform, random_state(platform, rng))
    h, y_legs = 1e-6, y[:24].reshape(6, 4)

    def centres(c: kane.Configuration) -> tuple[np.ndarray, np.ndarray]:
        u = c.leg_rotation[..., :, 0]
        return platform.leg_lower_com * u, (c.slide - platform.leg_upper_com)[..., None] * u

    u = configuration.leg_rotation[..., :, 0]
    G1, G2 = centres(configuration)
    ahead, behind = centres(moved(configuration, y, h)), centres(moved(configuration, y, -h))
    for G, direction, a, b in zip((G1, G2), (None, u), ahead, behind, strict=True):
        v = kane.partial_velocity(G, direction)
        assert np.allclose((v @ y_legs[..., None])[..., 0], (a - b) / (2 * h), atol=1e-8)


@given(seeds)
def test_jacobian_is_the_rate_of_the_closure_gaps(seed: int) -> None:
    """Expected: central differences of Φ along any speeds, also inconsistent ones; eqs. (24), (28)."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    configuration, _ = start_of(platform, random_state(platform, rng))
    y, h = rng.normal(size=30), 1e-6
    ahead, behind = (kane.constraint_residual(platform, moved(configuration, y, step)) for step in (h, -h))
    rate = kane.constraint_jacobian(platform, configuration) @ y
    assert np.allclose(rate[:18], ((ahead - behind) / (2 * h))[:18], atol=1e-8)


@given(seeds)
def test_jacobian_rate_is_the_derivative_of_the_jacobian(seed: int) -> None:
    """Expected: central differences of Φ_q; eqs. (20), (23), (26), (29)."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    configuration, y = start_of(platform, random_state(platform, rng))
    h = 1e-6
    ahead, behind = (kane.constraint_jacobian(platform, moved(configuration, y, step)) for step in (h, -h))
    rate = kane.constraint_jacobian_rate(platform, configuration, y)
    assert np.allclose(rate, (ahead - behind) / (2 * h), atol=1e-7 * (1 + np.abs(rate).max()))


def test_leg_mass_matrices_are_symmetric(thousand: Sample) -> None:
    configuration, y = start_of(thousand.parameters, thousand.state)  # type: ignore[arg-type]
    A, _ = kane.leg_equations(thousand.parameters, configuration, y, thousand.inputs.actuator_force)
    assert np.allclose(A, np.swapaxes(A, -1, -2), atol=1e-12)


def test_spin_rows_carry_no_force(paper: Platform) -> None:
    """Expected: without axial inertia nothing turns a leg about its axis."""
    solution = kane.solve(paper, *start_of(paper, PAPER_START), PAPER_INPUTS.actuator_force)
    assert np.abs(solution.spin_torque).max() < 1e-12


def test_baumgarte_lets_a_gap_decay_as_the_damped_oscillator_does(paper: Platform) -> None:
    """Expected: Φ¨ + 2αΦ˙ + β²Φ = 0 with α = β and Φ˙(0) = 0 has Φ(t) = Φ(0) (1 + αt) exp(−αt)."""
    alpha, gap = 8.0, 1e-4
    configuration, y = start_of(paper, PAPER_START)
    # legs too long by the gap; speeds that satisfy the constraints of this configuration
    stretched = configuration._replace(slide=configuration.slide + gap)
    Phi_q = kane.constraint_jacobian(paper, stretched)
    y = y - np.linalg.pinv(Phi_q) @ (Phi_q @ y)

    times = np.array([0.0, 0.1, 0.3])
    run = kane.integrate(paper, stretched, y, PAPER_INPUTS, times, (alpha, alpha))
    left = kane.constraint_residual(paper, run.configuration)
    assert np.linalg.norm(left[0, :18].reshape(6, 3), axis=1) == pytest.approx(np.full(6, gap), rel=1e-9)
    expected = left[0] * ((1 + alpha * times) * np.exp(-alpha * times))[:, None]
    assert np.allclose(left, expected, atol=1e-9)


def test_baumgarte_reduces_the_drift_of_a_coarse_integration(paper: Platform) -> None:
    time = np.array([0.0, 1.0])
    free, damped = (
        kane.simulate(paper, PAPER_START, PAPER_INPUTS, time, (ab, ab), rtol=1e-3, own_steps=True) for ab in (0.0, 10.0)
    )
    assert damped.position_violation[-1] < 0.2 * free.position_violation[-1]


def test_the_dae_takes_an_uneven_platform_where_the_kernel_does() -> None:
    """Expected: the task-space kernel under DOP853; joint forces by its outputs; no drift to speak of."""
    reached: list[float] = []
    times = np.array([0.0, 0.1, 0.25])
    run = kane.simulate(UNEVEN, STATE, INPUTS, times, rtol=1e-9, progress=reached.append)
    kernel, p, u = Kernel(), parameter_vector(UNEVEN), INPUTS.to_vector()
    path = solve_ivp(
        lambda _t, x: kernel.derivatives(x, u, p).copy(),
        (0.0, 0.25),
        STATE.to_vector(),
        method="DOP853",
        t_eval=times,
        rtol=1e-11,
        atol=1e-11,
    ).y.T
    assert run.time.tolist() == times.tolist()
    assert np.abs(run.platform.to_vector() - path).max() < 1e-7
    for k, x in enumerate(path):
        expected = interface.unpack(interface.RESULTS, kernel.outputs(x, u, p))["joint_force"]
        assert np.abs(run.joint_force[k] - expected).max() < 1e-5
    assert run.position_violation.max() < 1e-8
    assert run.velocity_violation.max() < 1e-7
    assert reached[0] == 0.0
    assert reached[-1] == pytest.approx(0.25)
    assert len(reached) == run.evaluations


def test_both_terms_of_baumgarte_have_their_own_number() -> None:
    """Expected: Φ¨ + 2αΦ˙ + β²Φ = 0 with α ≠ β from a gap and from a slip, by the exponential of its matrix.

    Legs too long by six different gaps, with speeds that satisfy no constraint of the closures.
    """
    alpha, beta, times = 9.0, 3.5, np.array([0.0, 0.05, 0.2])
    configuration, y = start_of(UNEVEN, STATE)
    stretched = configuration._replace(slide=configuration.slide + 1e-5 * np.arange(1, 7))
    faster = y + 1e-5 * np.append(np.tile([0.0, 0.0, 0.0, 3.0], 6), np.zeros(6))
    run = kane.integrate(UNEVEN, stretched, faster, INPUTS, times, (alpha, beta))
    gap = kane.constraint_residual(UNEVEN, run.configuration)[:, :18]
    slip = np.einsum("nab,nb->na", kane.constraint_jacobian(UNEVEN, run.configuration), run.speeds)
    assert np.abs(gap[0]).max() > 3e-5
    assert np.abs(slip[0, :18]).max() > 1e-5
    for k, t in enumerate(times):
        decay = expm(np.array([[0.0, 1.0], [-(beta**2), -2 * alpha]]) * t)
        assert gap[k] == pytest.approx(decay[0, 0] * gap[0] + decay[0, 1] * slip[0, :18], abs=1e-9)
        # the gaps turn with the legs: their rate is the slip up to the product of two small numbers
        assert slip[k, :18] == pytest.approx(decay[1, 0] * gap[0] + decay[1, 1] * slip[0, :18], abs=1e-8)
    assert run.position_violation == pytest.approx(np.abs(gap).max(axis=1), rel=1e-9)
    assert run.velocity_violation == pytest.approx(np.abs(slip).max(axis=1), rel=1e-9)


def test_a_simulation_has_the_asked_times_or_its_own_steps() -> None:
    """Expected: the paper's default of α = β = 10; between asked times no longer steps than these."""
    times = np.array([0.0, 0.004, 0.01])
    asked = kane.simulate(UNEVEN, STATE, INPUTS, times, rtol=1e-6)
    own = kane.simulate(UNEVEN, STATE, INPUTS, times, rtol=1e-6, own_steps=True)
    assert asked.time.tolist() == times.tolist()
    assert (own.time[0], own.time[-1]) == (0.0, 0.01)
    assert own.time.tolist() != times.tolist()
    assert asked.evaluations >= 2 + 6 * 2
    # own steps are as long as the tolerance allows, whatever times are named
    many = kane.simulate(UNEVEN, STATE, INPUTS, np.linspace(0, 0.04, 41), rtol=1e-3, own_steps=True)
    assert len(many.time) < 20
    same = kane.simulate(UNEVEN, STATE, INPUTS, times, (10.0, 10.0), 1e-6)
    assert np.array_equal(same.speeds, asked.speeds)
    first, last = asked.platform, own.platform
    assert first.to_vector()[0] == pytest.approx(STATE.to_vector(), abs=1e-12)
    assert first.to_vector()[-1] == pytest.approx(last.to_vector()[-1], abs=1e-6)
    assert asked.joint_force.shape == (3, 6, 3)
    # to first order in 4 ms, and what is half of the second
    moved = STATE.position + 0.004 * STATE.velocity
    assert first.position[1] == pytest.approx(moved, abs=2e-4)

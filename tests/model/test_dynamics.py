"""Task-space dynamics and energies: a Lagrangian by automatic differentiation, sums over bodies, invariants."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, Platform, State
from gough_stewart.model import dynamics, interface, kinematics, rotations
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.state import Inputs
from tests.support.lagrangian import Pose, forces_along, legs_along
from tests.support.random_platforms import (
    Sample,
    random_inputs,
    random_platform,
    random_sample,
    random_state,
    relative_difference,
)
from tests.support.uneven import INPUTS, STATE, UNEVEN

PAPER_START = State(np.array([0, 0, 3.0]), np.array([0, 0, -0.1]), np.array([0, 0.2, 0]), np.array([0, 0.1, 0]))


def friction_of(platform: Platform, rate: np.ndarray) -> np.ndarray:
    """As documented: c_i L̇ + C_i tanh(L̇/v_s)."""
    viscous = platform.leg_viscous_friction * platform.leg_viscous_friction_factor * rate
    coulomb = platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor
    return np.asarray(viscous + coulomb * np.tanh(rate / platform.leg_friction_velocity))


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_forces_of_any_motion_are_those_of_a_lagrangian_and_of_friction(seed: int, is_at_rest: bool) -> None:
    """Expected: Lagrange's equations from the places of thirteen bodies and their energies; friction as documented."""
    rng = np.random.default_rng(seed)
    platform = UNEVEN if seed % 4 == 0 else random_platform(rng)
    state = random_state(platform, rng)
    turning = rng.normal(size=3) * (not is_at_rest)
    omega = rotations.angular_velocity_from_orientation_rate(state.orientation, turning)
    state = state._replace(velocity=state.velocity * (not is_at_rest), angular_velocity=omega)
    linear, angular = platform.characteristic_length * rng.normal(size=3), rng.normal(size=3)
    if is_at_rest:
        linear, angular = np.zeros(3), np.zeros(3)
    pose = Pose(
        np.concatenate(state[:2])[None],
        np.concatenate([state.velocity, turning])[None],
        np.concatenate([linear, angular])[None],
    )
    alpha = rotations.angular_acceleration_from_orientation_rates(state.orientation, turning, angular)
    expected = forces_along(platform, pose)[0] + friction_of(platform, legs_along(platform, pose)[1][0])
    found = dynamics.inverse_dynamics(platform, state, dynamics.Acceleration(linear, alpha))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    if is_at_rest:
        assert np.array_equal(dynamics.static_leg_forces(platform, *state[:2]), found)


def test_mass_matrix_is_symmetric_positive_definite_and_that_of_the_kinetic_energy(thousand: Sample) -> None:
    """Expected: T = ½ [v; ω]ᵀ M [v; ω]; the energy sums over the bodies instead."""
    state = thousand.state
    M = dynamics.mass_matrix(thousand.parameters, state.position, state.orientation)
    assert np.allclose(M, np.swapaxes(M, -1, -2), atol=1e-12 * np.abs(M).max())
    assert np.linalg.eigvalsh(M).min() > 0
    twist = np.concatenate([state.velocity, state.angular_velocity], axis=-1)
    expected = 0.5 * np.einsum("na,nab,nb->n", twist, M, twist)
    assert np.allclose(dynamics.kinetic_energy(thousand.parameters, state), expected, rtol=1e-12)


def test_inverse_dynamics_undoes_forward_dynamics(thousand: Sample) -> None:
    """Expected: the forces, under external wrenches; the bias wrench is what holds the acceleration at zero."""
    p, state, wrench = thousand.parameters, thousand.state, np.concatenate(thousand.inputs[1:], axis=-1)
    a = dynamics.forward_dynamics(p, state, thousand.inputs)
    F = dynamics.inverse_dynamics(p, state, a, wrench)
    assert relative_difference(F, thousand.inputs.actuator_force) <= 1e-10
    none = dynamics.Acceleration(0 * state.velocity, 0 * state.velocity)
    F = dynamics.inverse_dynamics(p, state, none)
    bias = kinematics.wrench_from_leg_forces(kinematics.leg_geometry(p, state.position, state.orientation), F)
    assert relative_difference(bias, dynamics.bias_wrench(p, state)) <= 1e-10
    rest = State(*state[:2], *none)
    F = dynamics.static_leg_forces(p, *state[:2], wrench)
    a = dynamics.forward_dynamics(p, rest, thousand.inputs._replace(actuator_force=F))
    scale = np.abs(F).max() / np.min(p.platform_mass)
    assert max(np.abs(a.linear).max(), np.abs(a.angular).max()) <= 1e-10 * scale


def test_published_platform_at_zero_yaw_is_held_by_equal_forces(paper: Platform) -> None:
    """Expected: vertical balance by hand, with cos θ = 3/L the legs' inclination.

    Each leg rests on P with m2 g cos θ along u and (h/L) g sin θ across u, and carries a sixth of the platform.
    """
    L = np.sqrt(14 - 2 * np.sqrt(3))
    cos = 3 / L
    h = 2 * 0.4144 + 1 * (L - 0.4144)
    vertical = 10 * 9.81 / 6 + 1 * 9.81 * cos**2 + h / L * 9.81 * (1 - cos**2)
    F = dynamics.static_leg_forces(paper, paper.home_position, paper.home_orientation)
    assert np.allclose(F, vertical / cos, rtol=1e-14)


def test_energies_of_an_uneven_platform_are_sums_over_its_bodies() -> None:
    """Expected: ½ m v² and ½ ωᵀ J ω of thirteen bodies and rotors, −m g·r of each; the power of friction leg by leg."""
    R = Rotation.from_euler("xyz", STATE.orientation).as_matrix()
    w, g = STATE.angular_velocity, UNEVEN.gravity
    J = R @ UNEVEN.platform_inertia @ R.T
    r = R @ UNEVEN.platform_com
    kinetic = 0.5 * 11.5 * np.sum((STATE.velocity + np.cross(w, r)) ** 2) + 0.5 * w @ J @ w
    potential, friction = -11.5 * g @ (STATE.position + r), 0.0
    for k in range(6):
        arm = R @ UNEVEN.platform_points[k]
        l = STATE.position + arm - UNEVEN.base_points[k]
        L, v = np.linalg.norm(l), STATE.velocity + np.cross(w, arm)
        u = l / L
        slide, turning = u @ v, np.cross(u, v) / L
        # centres of mass 0.47 m from the base joint, 0.58 m before the platform joint
        lower, upper = 0.47 * np.cross(turning, u), (L - 0.58) * np.cross(turning, u) + slide * u
        kinetic += 0.5 * 2.3 * lower @ lower + 0.5 * 1.2 * upper @ upper + 0.5 * (0.13 + 0.061) * turning @ turning
        kinetic += 0.5 * 1.7 * slide**2
        potential -= 2.3 * g @ (UNEVEN.base_points[k] + 0.47 * u) + 1.2 * g @ (UNEVEN.base_points[k] + (L - 0.58) * u)
        viscous, coulomb = 7.0 * [0.7, 1.4, 0.9, 1.6, 0.5, 1.1][k], 1.9 * [1.3, 0.6, 1.5, 0.8, 1.2, 0.4][k]
        friction += (viscous * slide + coulomb * np.tanh(slide / 0.06)) * slide
    assert dynamics.kinetic_energy(UNEVEN, STATE) == pytest.approx(kinetic, rel=1e-12)
    assert dynamics.potential_energy(UNEVEN, STATE.position, STATE.orientation) == pytest.approx(potential, rel=1e-12)
    assert dynamics.friction_power(UNEVEN, STATE) == pytest.approx(friction, rel=1e-12)


def energy_less_work(platform: Platform, start: State, inputs: Inputs, duration: float) -> float:
    """Largest |E(t) − E(0) − W(t)| over the largest |W| of a motion; the integrator sums the power on its way."""
    kernel, p, u = Kernel(), parameter_vector(platform), inputs.to_vector()

    def derivative(_t: float, x: np.ndarray) -> np.ndarray:
        state = State.from_vector(x[:12])
        rate = kinematics.leg_rates(platform, state).length_rate
        power = (inputs.actuator_force - friction_of(platform, rate)) @ rate
        power += inputs.external_force @ state.velocity + inputs.external_torque @ state.angular_velocity
        return np.append(kernel.derivatives(x[:12], u, p), power)

    x0 = np.append(start.to_vector(), 0.0)
    run = solve_ivp(derivative, (0, duration), x0, method="DOP853", rtol=1e-11, atol=1e-11)
    state, work = State.from_vector(run.y[:12].T), run.y[12]
    E = dynamics.kinetic_energy(platform, state) + dynamics.potential_energy(platform, *state[:2])
    return float(np.abs(E - E[0] - work).max() / np.abs(work).max())


def test_energy_of_the_published_second_is_the_work_of_the_forces(paper: Platform) -> None:
    forces = Inputs.from_actuators(np.array([55.0, 49.5] * 3))
    assert energy_less_work(paper, PAPER_START, forces, 1.0) <= 1e-9


def test_energy_of_an_uneven_platform_is_the_work_of_all_forces_less_what_friction_takes() -> None:
    assert energy_less_work(UNEVEN, STATE, INPUTS, 0.8) <= 1e-9


def spring_energy_error(platform: Platform, start: State, stiffness: float, duration: float) -> tuple[float, float]:
    """Largest relative change of the total energy with legs as springs F = F0 + k (L0 − L), and the largest travel.

    The springs store V = Σ ½ k (L0 − L)² − F0 L; relative to the largest kinetic energy. rtol 1e-12.
    """
    home = platform.home_position, platform.home_orientation
    F0, L0 = dynamics.static_leg_forces(platform, *home), kinematics.leg_geometry(platform, *home).length
    kernel, p, u = Kernel(), parameter_vector(platform), np.zeros(12)

    def derivative(_t: float, x: np.ndarray) -> np.ndarray:
        u[:6] = F0 + stiffness * (L0 - kinematics.leg_geometry(platform, x[:3], x[3:6]).length)
        return kernel.derivatives(x, u, p).copy()

    run = solve_ivp(derivative, (0, duration), start.to_vector(), method="DOP853", rtol=1e-12, atol=1e-12)
    state = State.from_vector(run.y.T)
    L = kinematics.leg_geometry(platform, *state[:2]).length
    kinetic = dynamics.kinetic_energy(platform, state)
    springs = (0.5 * stiffness * (L0 - L) ** 2 - F0 * L).sum(axis=1)
    E = kinetic + dynamics.potential_energy(platform, *state[:2]) + springs
    return float(np.abs(E - E[0]).max() / kinetic.max()), float(np.abs(L - L0).max())


def test_energy_on_springs_is_constant_over_60_seconds(paper: Platform) -> None:
    """Expected: a conservative system; bounded motion from the paper's start."""
    error, travel = spring_energy_error(paper, PAPER_START, stiffness=1000.0, duration=60.0)
    assert travel < 0.5
    assert error <= 1e-9


def all_results(p: Parameters | Platform, state: State, inputs: Inputs, a: np.ndarray) -> list[np.ndarray]:
    acceleration = dynamics.Acceleration(a[..., :3], a[..., 3:])
    legs = kinematics.leg_geometry(p, *state[:2])
    return [
        *dynamics.forward_dynamics(p, state, inputs),
        dynamics.inverse_dynamics(p, state, acceleration),
        dynamics.static_leg_forces(p, *state[:2]),
        dynamics.mass_matrix(p, *state[:2]),
        dynamics.bias_wrench(p, state),
        dynamics.joint_forces(p, state, inputs.actuator_force, acceleration),
        dynamics.kinetic_energy(p, state),
        dynamics.potential_energy(p, *state[:2]),
        dynamics.friction_power(p, state),
        kinematics.wrench_from_leg_forces(legs, inputs.actuator_force),
        state.to_vector(),
        inputs.to_vector(),
    ]


@pytest.mark.parametrize("batched", range(8))
def test_any_one_argument_may_be_a_batch(batched: int) -> None:
    """Expected: leading axes broadcast, so a batch of one argument is a batch of the whole."""
    rng = np.random.default_rng(3)
    parts = [*random_state(UNEVEN, rng), *random_inputs(UNEVEN, rng), rng.normal(size=6)]
    many = [np.stack([part] * 5) if k == batched else part for k, part in enumerate(parts)]
    alone, batch = (all_results(UNEVEN, State(*x[:4]), Inputs(*x[4:7]), x[7]) for x in (parts, many))
    for one, of_many in zip(alone, batch, strict=True):
        assert of_many.shape in (one.shape, (5, *one.shape))
        np.testing.assert_allclose(of_many, np.broadcast_to(one, of_many.shape), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", [v.name for v in interface.PLATFORM_PARAMETERS])
def test_any_one_parameter_may_be_a_batch(name: str) -> None:
    """Expected: the same as one platform at a time."""
    rng = np.random.default_rng(4)
    state, inputs = random_state(UNEVEN, rng), random_inputs(UNEVEN, rng)
    values = {v.name: getattr(UNEVEN, v.name) for v in interface.PLATFORM_PARAMETERS}
    many = [1.01 * np.asarray(values[name]), np.asarray(values[name])]
    batch = dynamics.forward_dynamics(Parameters(**{**values, name: np.stack(many)}), state, inputs)
    for k, value in enumerate(many):
        one = dynamics.forward_dynamics(Parameters(**{**values, name: value}), state, inputs)
        for a, b in zip(one, batch, strict=True):
            assert np.allclose(np.broadcast_to(b, (2, 3))[k], a, rtol=1e-11)


def test_each_platform_of_a_batch_has_its_own_results() -> None:
    """Expected: platform by platform."""
    sample, a = random_sample(5, 31), np.random.default_rng(5).normal(size=(5, 6))
    batch = all_results(sample.parameters, sample.state, sample.inputs, a)
    for k, platform in enumerate(sample.platforms):
        state, inputs = State(*(x[k] for x in sample.state)), Inputs(*(u[k] for u in sample.inputs))
        for many, alone in zip(batch, all_results(platform, state, inputs, a[k]), strict=True):
            np.testing.assert_allclose(many[k], alone, rtol=1e-9, atol=1e-9 * float(np.abs(alone).max()))


def test_leg_forces_that_would_have_no_digits_are_refused_with_the_condition_number(paper: Platform) -> None:
    """Expected: Fichter's singularity at 90° of yaw; NumPy's condition number of the worst pose, from 1e12 on."""
    with pytest.raises(GoughStewartError, match="condition number") as caught:
        dynamics.static_leg_forces(paper, np.array([0, 0, 3.0]), np.array([0, 0, np.pi / 2]))
    assert caught.value.condition_number > 1e12

    home = UNEVEN.home_position

    def jacobian(yaw: float) -> np.ndarray:
        return np.asarray(kinematics.leg_jacobian(UNEVEN, home, np.array([0.0, 0.0, yaw])))

    singular = brentq(lambda yaw: np.linalg.det(jacobian(yaw)), 1.0, 2.5, xtol=1e-15)
    beside = np.zeros((1000, 3))
    beside[:, 2] = singular + np.geomspace(1e-13, 1e-9, 1000)
    numbers = np.linalg.cond(kinematics.leg_jacobian(UNEVEN, home, beside))
    fine, bad = (beside[np.abs(np.log(numbers / number)).argmin()] for number in (6e11, 2e12))
    dynamics.static_leg_forces(UNEVEN, home, np.stack([UNEVEN.home_orientation, fine]))
    for orientation in (bad, np.stack([UNEVEN.home_orientation, bad, fine])):
        worst = float(np.linalg.cond(kinematics.leg_jacobian(UNEVEN, home, bad)))
        with pytest.raises(GoughStewartError) as caught:
            dynamics.static_leg_forces(UNEVEN, home, orientation)
        assert caught.value.condition_number == pytest.approx(worst, rel=0.05)
        assert str(caught.value) == (
            f"leg Jacobian has condition number {caught.value.condition_number:.3g}, expected below 1e+12: the leg "
            "forces cannot hold this pose; choose a pose away from the singularity"
        )


def test_inputs_and_states_are_cut_from_their_vectors_in_order() -> None:
    """Expected: the numbers of the vector, over leading axes; forces alone have no wrench."""
    x = np.arange(24.0).reshape(2, 12)
    state, inputs = State.from_vector(x), Inputs.from_vector(x)
    assert [part.tolist() for part in state] == [x[:, k : k + 3].tolist() for k in (0, 3, 6, 9)]
    assert [part.tolist() for part in inputs] == [x[:, :6].tolist(), x[:, 6:9].tolist(), x[:, 9:].tolist()]
    assert np.array_equal(state.to_vector(), x)
    assert np.array_equal(inputs.to_vector(), x)
    forces = Inputs.from_actuators(x[:, 2:8])
    assert np.array_equal(forces.to_vector(), np.hstack([x[:, 2:8], np.zeros((2, 6))]))

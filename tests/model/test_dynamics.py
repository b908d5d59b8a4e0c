"""Task-space dynamics: invariants, closed forms, and a Lagrangian by automatic differentiation."""

from dataclasses import replace
from functools import cache

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from gough_stewart.model import dynamics, interface, kinematics
from gough_stewart.model.errors import SingularPoseError
from gough_stewart.model.friction import friction_force
from gough_stewart.model.interface import N_PARAMETERS
from gough_stewart.model.kernel import parameter_vector
from gough_stewart.model.parameters import Parameters
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import (
    angular_velocity_from_orientation_rate,
    matrix_from_orientation,
    orientation_from_matrix,
    orientation_rate_from_angular_velocity,
)
from gough_stewart.model.state import Inputs, State
from tests.support.random_platforms import (
    Sample,
    random_inputs,
    random_platform,
    random_sample,
    random_state,
    relative_difference,
)
from tests.support.uneven import STATE, UNEVEN

seeds = st.integers(0, 2**32 - 1)


def test_mass_matrix_is_symmetric_and_positive_definite(thousand: Sample) -> None:
    M = dynamics.mass_matrix(thousand.parameters, thousand.state.position, thousand.state.orientation)
    assert np.allclose(M, np.swapaxes(M, -1, -2), atol=1e-12 * np.abs(M).max())
    assert np.linalg.eigvalsh(M).min() > 0


def test_kinetic_energy_is_the_quadratic_form_of_the_mass_matrix(thousand: Sample) -> None:
    """Expected: T = ½ [v; ω]ᵀ M [v; ω]; `energy` sums over the bodies instead."""
    state = thousand.state
    M = dynamics.mass_matrix(thousand.parameters, state.position, state.orientation)
    twist = np.concatenate([state.velocity, state.angular_velocity], axis=-1)
    expected = 0.5 * np.einsum("na,nab,nb->n", twist, M, twist)
    assert np.allclose(dynamics.kinetic_energy(thousand.parameters, state), expected, rtol=1e-12)


def test_inverse_dynamics_undoes_forward_dynamics(thousand: Sample) -> None:
    a = dynamics.forward_dynamics(thousand.parameters, thousand.state, thousand.inputs)
    wrench = np.concatenate(thousand.inputs[1:], axis=-1)
    F = dynamics.inverse_dynamics(thousand.parameters, thousand.state, a, wrench)
    assert relative_difference(F, thousand.inputs.actuator_force) <= 1e-10


def test_bias_wrench_is_what_holds_the_acceleration_at_zero(thousand: Sample) -> None:
    """Expected: inverse dynamics for no acceleration, its forces as a wrench."""
    p, state = thousand.parameters, thousand.state
    none = dynamics.Acceleration(0 * state.velocity, 0 * state.velocity)
    F = dynamics.inverse_dynamics(p, state, none)
    wrench = kinematics.wrench_from_leg_forces(kinematics.leg_geometry(p, state.position, state.orientation), F)
    assert relative_difference(wrench, dynamics.bias_wrench(p, state)) <= 1e-10


def test_static_forces_keep_the_platform_at_rest(thousand: Sample) -> None:
    p, state, wrench = thousand.parameters, thousand.state, np.concatenate(thousand.inputs[1:], axis=-1)
    F = dynamics.static_leg_forces(p, state.position, state.orientation, wrench)
    rest = State(state.position, state.orientation, 0 * state.velocity, 0 * state.velocity)
    a = dynamics.forward_dynamics(p, rest, thousand.inputs._replace(actuator_force=F))
    scale = np.abs(F).max() / np.min(p.platform_mass)
    assert max(np.abs(a.linear).max(), np.abs(a.angular).max()) <= 1e-10 * scale


@given(seeds)
def test_static_forces_are_the_gradient_of_the_potential_energy(seed: int) -> None:
    """Expected: virtual work, δV = Σ F δL, by central differences of V along each degree of freedom."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    position, orientation = random_state(platform, rng)[:2]
    F = dynamics.static_leg_forces(platform, position, orientation)
    wrench = kinematics.leg_jacobian(platform, position, orientation).T @ F
    h = 1e-5
    R = Rotation.from_matrix(matrix_from_orientation(orientation))

    def potential(shift: np.ndarray) -> float:
        turned = orientation_from_matrix((Rotation.from_rotvec(shift[3:]) * R).as_matrix())
        return float(dynamics.potential_energy(platform, position + shift[:3], turned))

    gradient = [(potential(h * e) - potential(-h * e)) / (2 * h) for e in np.eye(6)]
    assert np.allclose(wrench, gradient, atol=1e-6 * np.abs(gradient).max())


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


def test_without_legs_the_platform_is_a_rigid_body() -> None:
    """Expected: Newton–Euler of one rigid body about its centre of mass, written out here."""
    rng = np.random.default_rng(7)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    inputs = inputs._replace(actuator_force=np.zeros(6))
    massless = Parameters(
        **{v.name: getattr(platform, v.name) for v in interface.PLATFORM_PARAMETERS if not v.name.startswith("leg_")},
        leg_lower_mass=0.0,
        leg_upper_mass=0.0,
        leg_lower_com=0.0,
        leg_upper_com=0.0,
        leg_lower_inertia=0.0,
        leg_upper_inertia=0.0,
        leg_viscous_friction=0.0,
        leg_coulomb_friction=0.0,
        leg_friction_velocity=1.0,
    )
    a = dynamics.forward_dynamics(massless, state, inputs)
    R = Rotation.from_euler("xyz", state.orientation).as_matrix()
    r, J, w = R @ platform.platform_com, R @ platform.platform_inertia @ R.T, state.angular_velocity
    a_G = platform.gravity + inputs.external_force / platform.platform_mass
    alpha = np.linalg.solve(J, inputs.external_torque - np.cross(r, inputs.external_force) - np.cross(w, J @ w))
    assert np.allclose(a.angular, alpha, rtol=1e-10)
    assert np.allclose(a.linear, a_G - np.cross(alpha, r) - np.cross(w, np.cross(w, r)), rtol=1e-10)


@cache
def lagrangian_residual() -> casadi.Function:
    """d/dt ∂(T−V)/∂q̇ − ∂(T−V)/∂q for q = (position, orientation), by CasADi from the energies alone."""
    q, dq, ddq = (casadi.SX.sym(name, 6) for name in ("q", "dq", "ddq"))
    p = casadi.SX.sym("p", N_PARAMETERS)

    def symbols(vector: casadi.SX) -> np.ndarray:
        return np.array([[vector[i] for i in range(vector.numel())]], dtype=object)

    qs, dqs = symbols(q), symbols(dq)
    parameters = Parameters(**interface.unpack(interface.PLATFORM_PARAMETERS, symbols(p)))
    omega = angular_velocity_from_orientation_rate(qs[:, 3:], dqs[:, 3:])
    state = State(qs[:, :3], qs[:, 3:], dqs[:, :3], omega)
    L = dynamics.kinetic_energy(parameters, state)[0] - dynamics.potential_energy(parameters, qs[:, :3], qs[:, 3:])[0]
    momentum = casadi.gradient(L, dq)
    rate = casadi.jtimes(momentum, q, dq) + casadi.jtimes(momentum, dq, ddq)
    return casadi.Function("residual", [q, dq, ddq, p], [rate - casadi.gradient(L, q)])


@given(seeds)
def test_accelerations_satisfy_lagranges_equations(seed: int) -> None:
    """Expected: generalized forces Q = Σ ∂v/∂q̇ · force, from a Lagrangian that knows no accelerations."""
    rng = np.random.default_rng(seed)
    platform = replace(random_platform(rng), leg_viscous_friction=0.0, leg_coulomb_friction=0.0)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    a = dynamics.forward_dynamics(platform, state, inputs)
    rate = orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity)
    # α = E(o) ö + Ė(o) ȯ, with Ė ȯ by central differences along ȯ
    E = np.stack([angular_velocity_from_orientation_rate(state.orientation, e) for e in np.eye(3)], axis=1)
    h = 1e-6
    turning = [angular_velocity_from_orientation_rate(state.orientation + s * h * rate, rate) for s in (1, -1)]
    angle_acceleration = np.linalg.solve(E, a.angular - (turning[0] - turning[1]) / (2 * h))
    residual = lagrangian_residual()(
        np.concatenate([state.position, state.orientation]),
        np.concatenate([state.velocity, rate]),
        np.concatenate([a.linear, angle_acceleration]),
        parameter_vector(platform),
    )
    legs = kinematics.leg_geometry(platform, state.position, state.orientation)
    wrench = kinematics.wrench_from_leg_forces(legs, inputs.actuator_force)
    wrench = wrench + np.concatenate(inputs[1:])
    Q = np.concatenate([wrench[:3], E.T @ wrench[3:]])
    assert np.allclose(np.array(residual).ravel(), Q, atol=1e-7 * np.abs(Q).max())


@given(seeds)
def test_energy_changes_by_the_power_of_forces_less_friction(seed: int) -> None:
    """Expected: power balance; dE/dt by central differences along the motion."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    a = dynamics.forward_dynamics(platform, state, inputs)
    rate = State(
        state.velocity,
        orientation_rate_from_angular_velocity(state.orientation, state.angular_velocity),
        a.linear,
        a.angular,
    )

    def total(h: float) -> float:
        s = State(*(x + h * dx for x, dx in zip(state, rate, strict=True)))
        kinetic = dynamics.kinetic_energy(platform, s)
        return float(kinetic + dynamics.potential_energy(platform, s.position, s.orientation))

    # h such that the motion of step h stays small also under large accelerations
    h = 1e-6
    power = (
        inputs.actuator_force @ kinematics.leg_rates(platform, state).length_rate
        + inputs.external_force @ state.velocity
        + inputs.external_torque @ state.angular_velocity
    )
    lost = dynamics.friction_power(platform, state)
    scale = abs(float(power)) + float(lost) + abs(total(0.0))
    assert (total(h) - total(-h)) / (2 * h) == pytest.approx(float(power - lost), abs=1e-6 * scale)


@given(seeds)
def test_joint_forces_move_the_platform(seed: int) -> None:
    """Expected: Newton's and Euler's laws of the platform body alone, under joint forces, weight, external wrench."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    a = dynamics.forward_dynamics(platform, state, inputs)
    forces = dynamics.joint_forces(platform, state, inputs.actuator_force, a)
    R = Rotation.from_euler("xyz", state.orientation).as_matrix()
    r, J, w = R @ platform.platform_com, R @ platform.platform_inertia @ R.T, state.angular_velocity
    a_G = a.linear + np.cross(a.angular, r) + np.cross(w, np.cross(w, r))
    force = forces.sum(axis=0) + inputs.external_force + platform.platform_mass * platform.gravity
    assert np.allclose(platform.platform_mass * a_G, force, atol=1e-9 * np.abs(forces).max())
    arms = platform.platform_points @ R.T - r
    moment = np.cross(arms, forces).sum(axis=0) + inputs.external_torque - np.cross(r, inputs.external_force)
    euler = J @ a.angular + np.cross(w, J @ w)
    assert np.allclose(euler, moment, atol=1e-9 * np.abs(forces).max() * platform.characteristic_length)


@given(seeds, st.floats(-np.pi, np.pi))
def test_dynamics_do_not_depend_on_the_choice_of_the_world_frame(seed: int, azimuth: float) -> None:
    """Expected: everything turned about Z gives the same accelerations, turned."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state, inputs = random_state(platform, rng), random_inputs(platform, rng)
    a = dynamics.forward_dynamics(platform, state, inputs)
    Z = Rotation.from_euler("z", azimuth).as_matrix()
    turned_platform = replace(
        platform,
        base_points=platform.base_points @ Z.T,
        gravity=Z @ platform.gravity,
        home_position=Z @ platform.home_position,
        home_orientation=platform.home_orientation + np.array([0, 0, azimuth]),
    )
    turned_state = State(
        Z @ state.position,
        state.orientation + np.array([0, 0, azimuth]),
        Z @ state.velocity,
        Z @ state.angular_velocity,
    )
    turned_inputs = Inputs(inputs.actuator_force, Z @ inputs.external_force, Z @ inputs.external_torque)
    b = dynamics.forward_dynamics(turned_platform, turned_state, turned_inputs)
    assert np.allclose(b.linear, Z @ a.linear, atol=1e-9 * np.abs(a.linear).max())
    assert np.allclose(b.angular, Z @ a.angular, atol=1e-9 * np.abs(a.angular).max())


def test_single_states_and_batches_give_the_same(thousand: Sample) -> None:
    batch = dynamics.forward_dynamics(thousand.parameters, thousand.state, thousand.inputs)
    for k in (0, 499, 999):
        state = State(*(x[k] for x in thousand.state))
        one = dynamics.forward_dynamics(thousand.platforms[k], state, Inputs(*(u[k] for u in thousand.inputs)))
        assert np.allclose(one.linear, batch.linear[k], rtol=1e-12)
        assert np.allclose(one.angular, batch.angular[k], rtol=1e-12)


@pytest.mark.parametrize("batched", range(8))
def test_any_one_argument_may_be_a_batch(batched: int) -> None:
    """Expected: leading axes broadcast, so a batch of one argument is a batch of the whole."""
    rng = np.random.default_rng(3)
    state, inputs, a = random_state(UNEVEN, rng), random_inputs(UNEVEN, rng), rng.normal(size=6)
    parts = [*state, *inputs, a]
    many = [np.stack([part] * 5) if k == batched else part for k, part in enumerate(parts)]

    def results(parts: list[np.ndarray]) -> list[np.ndarray]:
        state, inputs, a = (
            State(*parts[:4]),
            Inputs(*parts[4:7]),
            dynamics.Acceleration(parts[7][..., :3], parts[7][..., 3:]),
        )
        wrench = np.concatenate(inputs[1:], axis=-1) if batched not in (5, 6) else 0.0
        legs = kinematics.leg_geometry(UNEVEN, state.position, state.orientation)
        return [
            *dynamics.forward_dynamics(UNEVEN, state, inputs),
            dynamics.inverse_dynamics(UNEVEN, state, a, wrench),
            dynamics.inverse_dynamics(UNEVEN, state, dynamics.Acceleration(a.linear, a.angular[..., :3])),
            dynamics.static_leg_forces(UNEVEN, state.position, state.orientation),
            dynamics.mass_matrix(UNEVEN, state.position, state.orientation),
            dynamics.bias_wrench(UNEVEN, state),
            dynamics.joint_forces(UNEVEN, state, inputs.actuator_force, a),
            dynamics.kinetic_energy(UNEVEN, state),
            dynamics.friction_power(UNEVEN, state),
            kinematics.wrench_from_leg_forces(legs, inputs.actuator_force),
            state.to_vector(),
            inputs.to_vector(),
        ]

    for one, batch in zip(results(parts), results(many), strict=True):
        assert batch.shape in (one.shape, (5, *one.shape))
        assert np.allclose(batch, one, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", [v.name for v in interface.PLATFORM_PARAMETERS])
def test_any_one_parameter_may_be_a_batch(name: str) -> None:
    """Expected: the same as one platform at a time."""
    rng = np.random.default_rng(4)
    state, inputs = random_state(UNEVEN, rng), random_inputs(UNEVEN, rng)
    values = {v.name: getattr(UNEVEN, v.name) for v in interface.PLATFORM_PARAMETERS}
    many = [1.01 * np.asarray(values[name]), np.asarray(values[name])]
    each = [Parameters(**{**values, name: value}) for value in many]
    batch = dynamics.forward_dynamics(Parameters(**{**values, name: np.stack(many)}), state, inputs)
    for k, parameters in enumerate(each):
        one = dynamics.forward_dynamics(parameters, state, inputs)
        for a, b in zip(one, batch, strict=True):
            assert np.allclose(np.broadcast_to(b, (2, 3))[k], a, rtol=1e-11)


def test_friction_is_viscous_plus_smoothed_coulomb(paper: Platform) -> None:
    """Expected: limits: slope c + C/v_s at rest, ±C beyond v_s, odd."""
    p = replace(paper, leg_viscous_friction=3.0, leg_coulomb_friction=5.0, leg_friction_velocity=0.01)
    v = np.array([1e-9, -1e-9, 1.0, -1.0, 0.0, 0.01])
    expected = [1e-9 * (3 + 500), -1e-9 * (3 + 500), 8.0, -8.0, 0.0, 0.03 + 5 * np.tanh(1.0)]
    assert np.allclose(friction_force(p, v), expected, rtol=1e-9)


@given(seeds)
def test_friction_never_feeds_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    assert dynamics.friction_power(platform, random_state(platform, rng)) >= 0


def test_leg_forces_at_a_singular_pose_are_refused(paper: Platform) -> None:
    """Expected: Fichter's singularity at 90° of yaw."""
    with pytest.raises(SingularPoseError, match="condition number") as caught:
        dynamics.static_leg_forces(paper, np.array([0, 0, 3.0]), np.array([0, 0, np.pi / 2]))
    assert caught.value.condition_number > 1e12


def yaw_of_condition_number(wanted: float) -> np.ndarray:
    """An orientation of the uneven platform at home at which the leg Jacobian has about this condition number."""

    def jacobian(yaw: float) -> np.ndarray:
        return np.asarray(kinematics.leg_jacobian(UNEVEN, UNEVEN.home_position, np.array([0.0, 0.0, yaw])))

    singular = brentq(lambda yaw: np.linalg.det(jacobian(yaw)), 1.0, 2.5, xtol=1e-15)
    beside = singular + np.geomspace(1e-13, 1e-9, 1000)
    turned = np.stack([0 * beside, 0 * beside, beside], axis=-1)
    numbers = np.linalg.cond(kinematics.leg_jacobian(UNEVEN, UNEVEN.home_position, turned))
    return np.array([0.0, 0.0, beside[np.abs(np.log(numbers / wanted)).argmin()]])


def test_one_pose_of_many_whose_forces_would_have_no_digits_is_refused_with_its_number() -> None:
    """Expected: NumPy's condition number of the worst pose, from 1e12 on; the limit from both sides."""
    fine, bad = yaw_of_condition_number(6e11), yaw_of_condition_number(2e12)
    home = UNEVEN.home_position
    dynamics.static_leg_forces(UNEVEN, home, np.stack([UNEVEN.home_orientation, fine]))
    for orientation in (bad, np.stack([UNEVEN.home_orientation, bad, fine])):
        worst = float(np.linalg.cond(kinematics.leg_jacobian(UNEVEN, home, bad)))
        with pytest.raises(SingularPoseError) as caught:
            dynamics.static_leg_forces(UNEVEN, home, orientation)
        assert caught.value.condition_number == pytest.approx(worst, rel=0.05)
        assert str(caught.value) == (
            f"leg Jacobian has condition number {caught.value.condition_number:.3g}, expected below 1e+12: the leg "
            "forces cannot hold this pose; choose a pose away from the singularity"
        )


def test_each_platform_of_a_batch_has_its_own_results() -> None:
    """Expected: platform by platform; in energies, static forces and friction as in the accelerations."""
    sample = random_sample(5, 31)
    p, state = sample.parameters, sample.state
    many = [
        dynamics.kinetic_energy(p, state),
        dynamics.potential_energy(p, state.position, state.orientation),
        dynamics.friction_power(p, state),
        dynamics.static_leg_forces(p, state.position, state.orientation),
        dynamics.bias_wrench(p, state),
    ]
    for k, platform in enumerate(sample.platforms):
        own = State(*(part[k] for part in state))
        each = [
            dynamics.kinetic_energy(platform, own),
            dynamics.potential_energy(platform, own.position, own.orientation),
            dynamics.friction_power(platform, own),
            dynamics.static_leg_forces(platform, own.position, own.orientation),
            dynamics.bias_wrench(platform, own),
        ]
        for found, expected in zip(many, each, strict=True):
            np.testing.assert_allclose(found[k], expected, rtol=1e-9, atol=1e-9 * float(np.abs(expected).max()))


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

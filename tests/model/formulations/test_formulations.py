"""Task space, Kane, Newton–Euler and kernel: one set of accelerations and joint forces; the paper's relations."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from gough_stewart import load_preset
from gough_stewart.model import interface, kinematics
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations import kane, newton_euler
from gough_stewart.model.formulations.cases import paper_case
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.random_platforms import Sample, relative_difference
from tests.support.uneven import INPUTS, STATE, UNEVEN


def by_kane(sample: Sample, axial_inertia: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (n, 6) and joint forces (n, 6, 3)."""
    p, state, inputs = sample.parameters, sample.state, sample.inputs
    start = kane.consistent_start(p, state)
    wrench = np.concatenate(inputs[1:], axis=-1)
    solution = kane.solve(p, *start, inputs.actuator_force, wrench, axial_inertia=axial_inertia)
    return solution.platform_acceleration, solution.joint_force


def by_newton_euler(sample: Sample, axial_inertia: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    state, R = sample.state, matrix_from_orientation(sample.state.orientation)
    solution = newton_euler.solve(
        sample.parameters, state.position, R, *state[2:], *sample.inputs, axial_inertia=axial_inertia
    )
    return np.concatenate([solution.linear, solution.angular], axis=-1), solution.joint_force


@pytest.mark.parametrize("formulation", [by_kane, by_newton_euler])
def test_accelerations_and_joint_forces_agree_with_task_space(thousand: Sample, formulation: object) -> None:
    """The multipliers λ of eq. (30) are the forces that Newton and Euler find in the platform joints."""
    assert callable(formulation)
    p, state, inputs = thousand.parameters, thousand.state, thousand.inputs
    rates, results = plant_equations(IDEAL, p, state.to_vector(), inputs)
    acceleration, joint_force = formulation(thousand)
    assert relative_difference(acceleration, rates[:, 6:]) <= 1e-10
    assert relative_difference(joint_force, results["joint_force"]) <= 1e-10


@pytest.mark.parametrize("formulation", [by_kane, by_newton_euler])
def test_axial_inertia_of_the_legs_plays_no_part(thousand: Sample, formulation: object) -> None:
    """Expected: eq. (25): legs do not spin, so the moment of inertia about u never works."""
    assert callable(formulation)
    for spun, free in zip(formulation(thousand, axial_inertia=0.7), formulation(thousand), strict=True):
        assert relative_difference(spun, free) <= 1e-10


def test_the_kernel_gives_derivatives_and_outputs_of_the_numpy_functions(thousand: Sample) -> None:
    """Expected: accelerations and joint forces of Newton–Euler, energies and kinematics of the NumPy functions."""
    p, state = thousand.parameters, thousand.state
    kernel, x, u = Kernel(), state.to_vector(), thousand.inputs.to_vector()
    of_platforms = [parameter_vector(platform) for platform in thousand.platforms]
    rates = np.array([kernel.derivatives(x[k], u[k], of_platforms[k]).copy() for k in range(1000)])
    outputs = np.array([kernel.outputs(x[k], u[k], of_platforms[k]).copy() for k in range(1000)])
    acceleration, joint_force = by_newton_euler(thousand)
    _, by_numpy = plant_equations(IDEAL, p, x, thousand.inputs)
    assert relative_difference(rates[:, 6:], acceleration) <= 1e-10
    expected = {
        **state._asdict(),
        "leg_length": kinematics.leg_geometry(p, state.position, state.orientation).length,
        "leg_velocity": kinematics.leg_rates(p, state).length_rate,
        "acceleration": acceleration[:, :3],
        "angular_acceleration": acceleration[:, 3:],
        "joint_force": joint_force,
        **{name: by_numpy[name] for name in ("kinetic_energy", "potential_energy")},
    }
    found = interface.unpack(interface.RESULTS, outputs)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert relative_difference(found[name], value) <= 1e-10, name


def test_the_dae_takes_an_uneven_platform_where_the_kernel_does() -> None:
    """Expected: the task-space kernel under DOP853; joint forces by its outputs; no drift to speak of."""
    reached: list[float] = []
    times = np.array([0.0, 0.1, 0.25])
    start = kane.consistent_start(UNEVEN, STATE)
    run = kane.integrate(UNEVEN, *start, INPUTS, times, rtol=1e-9, progress=reached.append)
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


def test_both_terms_of_baumgarte_have_their_own_number() -> None:
    """Expected: Φ¨ + 2αΦ˙ + β²Φ = 0 with α ≠ β from a gap and from a slip, by the exponential of its matrix.

    Legs too long by six different gaps, with speeds that satisfy no constraint of the closures.
    """
    alpha, beta, times = 9.0, 3.5, np.array([0.0, 0.05, 0.2])
    configuration, y = kane.consistent_start(UNEVEN, STATE)
    stretched = configuration._replace(slide=configuration.slide + 1e-5 * np.arange(1, 7))
    faster = y + 1e-5 * np.append(np.tile([0.0, 0.0, 0.0, 3.0], 6), np.zeros(6))
    run = kane.integrate(UNEVEN, stretched, faster, INPUTS, times, (alpha, beta))
    constraints = kane.constraints(UNEVEN, run.configuration, run.speeds)
    gap, slip = constraints.residual[:, :18], np.einsum("nab,nb->na", constraints.jacobian, run.speeds)
    assert np.abs(gap[0]).max() > 3e-5
    assert np.abs(slip[0, :18]).max() > 1e-5
    for k, t in enumerate(times):
        decay = expm(np.array([[0.0, 1.0], [-(beta**2), -2 * alpha]]) * t)
        assert gap[k] == pytest.approx(decay[0, 0] * gap[0] + decay[0, 1] * slip[0, :18], abs=1e-9)
        # the gaps turn with the legs: their rate is the slip up to the product of two small numbers
        assert slip[k, :18] == pytest.approx(decay[1, 0] * gap[0] + decay[1, 1] * slip[0, :18], abs=1e-8)
    assert run.position_violation == pytest.approx(np.abs(gap).max(axis=1), rel=1e-9)
    assert run.velocity_violation == pytest.approx(np.abs(slip).max(axis=1), rel=1e-9)


def test_the_case_is_that_of_section_iv() -> None:
    """Expected: the numbers of the paper."""
    case = paper_case()
    assert np.concatenate(case.start).tolist() == [0, 0, 3, 0, 0, -0.1, 0, 0.2, 0, 0, 0.1, 0]
    assert case.actuator_force.tolist() == [55, 49.5, 55, 49.5, 55, 49.5]
    assert np.concatenate(case.inputs).tolist() == [55, 49.5, 55, 49.5, 55, 49.5, 0, 0, 0, 0, 0, 0]
    assert case.time == pytest.approx(np.arange(101) / 100)
    assert case.is_published
    assert not case.minus_first
    assert case.platform == load_preset("liu2000")

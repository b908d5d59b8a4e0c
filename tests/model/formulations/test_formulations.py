"""Task space, Kane, Newton–Euler and kernel on 1,000 random platforms and states: one set of accelerations."""

import numpy as np
import pytest

from gough_stewart.model import dynamics, interface
from gough_stewart.model.formulations import kane, newton_euler
from gough_stewart.model.kernel import Kernel, parameter_vector
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.random_platforms import Sample, relative_difference


@pytest.fixture(scope="module")
def task_space(thousand: Sample) -> dynamics.Acceleration:
    return dynamics.forward_dynamics(thousand.parameters, thousand.state, thousand.inputs)


@pytest.fixture(scope="module")
def by_kane(thousand: Sample) -> kane.KaneSolution:
    return solve_by_kane(thousand)


@pytest.fixture(scope="module")
def by_newton_euler(thousand: Sample) -> newton_euler.NewtonEulerSolution:
    return solve_by_newton_euler(thousand)


def solve_by_kane(sample: Sample, axial_inertia: float = 0.0) -> kane.KaneSolution:
    state, inputs = sample.state, sample.inputs
    start = kane.consistent_start(
        sample.parameters,
        state.position,
        matrix_from_orientation(state.orientation),
        state.velocity,
        state.angular_velocity,
    )
    wrench = np.concatenate([inputs.external_force, inputs.external_torque], axis=-1)
    return kane.solve(sample.parameters, *start, inputs.actuator_force, wrench, axial_inertia=axial_inertia)


def solve_by_newton_euler(sample: Sample, axial_inertia: float = 0.0) -> newton_euler.NewtonEulerSolution:
    state = sample.state
    return newton_euler.solve(
        sample.parameters,
        state.position,
        matrix_from_orientation(state.orientation),
        state.velocity,
        state.angular_velocity,
        *sample.inputs,
        axial_inertia=axial_inertia,
    )


def stacked(acceleration: dynamics.Acceleration) -> np.ndarray:
    return np.concatenate(acceleration, axis=-1)


def test_kane_agrees_with_task_space(task_space: dynamics.Acceleration, by_kane: kane.KaneSolution) -> None:
    assert relative_difference(by_kane.platform_acceleration, stacked(task_space)) <= 1e-10


def test_newton_euler_agrees_with_task_space(
    task_space: dynamics.Acceleration, by_newton_euler: newton_euler.NewtonEulerSolution
) -> None:
    newton = np.concatenate([by_newton_euler.linear, by_newton_euler.angular], axis=-1)
    assert relative_difference(newton, stacked(task_space)) <= 1e-10


def test_kernel_agrees_with_task_space(thousand: Sample, task_space: dynamics.Acceleration) -> None:
    kernel = Kernel()
    x, u = thousand.state.to_vector(), thousand.inputs.to_vector()
    traced = np.array(
        [
            kernel.derivatives(x[k], u[k], parameter_vector(platform))[6:].copy()
            for k, platform in enumerate(thousand.platforms)
        ]
    )
    assert relative_difference(traced, stacked(task_space)) <= 1e-10


def test_kernel_outputs_agree_with_the_numpy_functions(
    thousand: Sample, task_space: dynamics.Acceleration, by_newton_euler: newton_euler.NewtonEulerSolution
) -> None:
    """Expected: joint forces of Newton–Euler, energies and kinematics of the NumPy functions."""
    from gough_stewart.model import dynamics, kinematics

    p, state = thousand.parameters, thousand.state
    kernel, x, u = Kernel(), state.to_vector(), thousand.inputs.to_vector()
    y = np.array(
        [kernel.outputs(x[k], u[k], parameter_vector(each)).copy() for k, each in enumerate(thousand.platforms)]
    )
    values = interface.unpack(interface.RESULTS, y)
    expected = {
        **state._asdict(),
        "leg_length": kinematics.leg_geometry(p, state.position, state.orientation).length,
        "leg_velocity": kinematics.leg_rates(p, state).length_rate,
        "acceleration": task_space.linear,
        "angular_acceleration": task_space.angular,
        "joint_force": by_newton_euler.joint_force,
        "kinetic_energy": dynamics.kinetic_energy(p, state),
        "potential_energy": dynamics.potential_energy(p, state.position, state.orientation),
    }
    assert values.keys() == expected.keys()
    for name, value in expected.items():
        assert relative_difference(values[name], value) <= 1e-10, name


def test_joint_forces_agree(
    thousand: Sample,
    task_space: dynamics.Acceleration,
    by_kane: kane.KaneSolution,
    by_newton_euler: newton_euler.NewtonEulerSolution,
) -> None:
    """The multipliers λ of eq. (30) are the forces that Newton–Euler finds in the platform joints."""
    forces = dynamics.joint_forces(thousand.parameters, thousand.state, thousand.inputs.actuator_force, task_space)
    assert relative_difference(by_kane.joint_force, forces) <= 1e-10
    assert relative_difference(by_newton_euler.joint_force, forces) <= 1e-10


def test_axial_inertia_of_the_legs_plays_no_part(
    thousand: Sample, by_kane: kane.KaneSolution, by_newton_euler: newton_euler.NewtonEulerSolution
) -> None:
    """Expected: eq. (25): legs do not spin, so the moment of inertia about u never works."""
    spun = solve_by_kane(thousand, axial_inertia=0.7)
    assert relative_difference(spun.platform_acceleration, by_kane.platform_acceleration) <= 1e-10
    free = solve_by_newton_euler(thousand, axial_inertia=0.7)
    assert relative_difference(free.linear, by_newton_euler.linear) <= 1e-10
    assert relative_difference(free.joint_force, by_newton_euler.joint_force) <= 1e-10


def test_guide_forces_are_across_the_legs(thousand: Sample, by_newton_euler: newton_euler.NewtonEulerSolution) -> None:
    """Expected: what acts along the leg is the actuator, not the guide."""
    from gough_stewart.model.kinematics import leg_geometry

    u = leg_geometry(thousand.parameters, thousand.state.position, thousand.state.orientation).direction
    along = (by_newton_euler.guide_force * u).sum(axis=-1)
    assert np.abs(along).max() <= 1e-12 * np.abs(by_newton_euler.guide_force).max()

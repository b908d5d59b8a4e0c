"""The machine whose logs test identification: its motion and sensors against closed forms and inverse dynamics."""

from dataclasses import replace

import numpy as np

from gough_stewart import Acceleration, Platform, State, identify, inverse_dynamics
from tests.support.machine_logs import (
    MACHINE,
    NAMES,
    NOMINAL,
    Course,
    Sensing,
    Swing,
    force_of,
    machine_log,
    random_machine,
    tilted,
)
from tests.support.uneven import UNEVEN

NOISELESS = Sensing(force_noise=0.0, length_noise=0.0, encoder=0.0)


def test_a_noiseless_log_has_the_forces_of_the_project_s_physics() -> None:
    """Expected: inverse dynamics of the same motion, friction of each leg included, to 1e-8 of the forces."""
    course = Course(Swing(seed=8, axes=(1.0, 1.0, 1.0, 0.0, 0.0, 1.0)), duration=4.0)
    machines: tuple[Platform, ...] = (UNEVEN, random_machine(5, equal_friction=False)[0])
    for machine in (replace(m, home_orientation=np.zeros(3)) for m in machines):
        log = machine_log(machine, course, NOISELESS)
        pose = course.swing.along(machine, np.asarray(log.time), course.duration)
        # about the vertical alone, rates of angles are angular velocities
        state = State(pose.q[:, :3], pose.q[:, 3:], pose.rate[:, :3], pose.rate[:, 3:])
        acceleration = Acceleration(pose.acceleration[:, :3], pose.acceleration[:, 3:])
        expected = np.asarray(inverse_dynamics(machine, state, acceleration))
        np.testing.assert_allclose(force_of(log), expected, atol=1e-8 * np.abs(expected).max())


def test_a_perfect_log_leaves_its_noise_and_a_noiseless_one_next_to_nothing() -> None:
    """Expected: 1 % noise within the filter's band, 10 to 11 N; without noise and reversals of legs, 1e-6 of forces."""
    estimate = identify(machine_log(), NOMINAL, NAMES)
    assert 9.0 < estimate.residuals.rms.mean() < 12.0
    sliding = replace(MACHINE, leg_coulomb_friction=0.0)
    names = [name for name in NAMES if name != "leg_coulomb_friction"]
    exact = identify(machine_log(sliding, sensing=NOISELESS), replace(NOMINAL, leg_coulomb_friction=0.0), names)
    assert exact.residuals.rms.max() < 0.01
    np.testing.assert_allclose(exact["platform_mass"], MACHINE.platform_mass, rtol=1e-6)
    np.testing.assert_allclose(exact["platform_inertia"][[0, 1, 4]], [380.0, 12.0, 8.0], atol=0.02)


def test_a_late_force_is_the_earlier_one_and_a_tilted_base_weighs_sideways() -> None:
    """Expected: the column of forces, three rows up; turned about X, gravity pulls to −Y of the base, about Y to +X."""
    at, late = (machine_log(UNEVEN, Course(duration=3.0), replace(NOISELESS, delay=d)) for d in (0.0, 3e-3))
    np.testing.assert_allclose(force_of(late)[3:], force_of(at)[:-3], rtol=1e-9)
    np.testing.assert_array_equal(late.leg_length, at.leg_length)
    g, s, c = np.array([0.0, 0.0, -9.81]), 9.81 * np.sin(0.01), 9.81 * np.cos(0.01)
    np.testing.assert_allclose([tilted(g, 0.01, 0.0), tilted(g, 0.0, 0.01)], [[0, -s, -c], [s, 0, -c]], rtol=1e-12)

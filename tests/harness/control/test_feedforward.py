"""Feedforward against virtual work and against Newton and Euler's equations, on the uneven platform in motion."""

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.controllers import feedforward
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.model.dynamics import plant_equations
from gough_stewart.model.formulations import newton_euler
from gough_stewart.model.interface import IDEAL
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.rotations import matrix_from_orientation
from gough_stewart.model.state import Inputs
from gough_stewart.model.vectors import FloatArray
from tests.support.uneven import UNEVEN


@pytest.fixture(scope="module")
def motion() -> Motion:
    """Five moments of a lively motion, none like another."""
    rng = np.random.default_rng(3)
    position = UNEVEN.home_position + rng.uniform(-0.2, 0.2, (5, 3))
    orientation = UNEVEN.home_orientation + rng.uniform(-0.2, 0.2, (5, 3))
    return Motion(position, orientation, *rng.normal(size=(4, 5, 3)))


def test_gravity_holds_every_pose_at_rest(motion: Motion) -> None:
    """Expected: virtual work, Σ F δL = δV for small changes of every coordinate of the pose."""
    force = feedforward("gravity", UNEVEN, motion)
    none = Inputs.from_vector(np.zeros(12))

    def weight_of(pose: FloatArray) -> float:
        return float(plant_equations(IDEAL, UNEVEN, np.append(pose, np.zeros(6)), none)[1]["potential_energy"])

    h = 1e-6
    for k in range(5):
        pose = np.concatenate([motion.position[k], motion.orientation[k]])
        for step in h * np.eye(6):
            ends = [np.split(pose + sign * step, 2) for sign in (1, -1)]
            work = force[k] @ np.subtract(*(leg_geometry(UNEVEN, *end).length for end in ends))
            potential = [weight_of(np.concatenate(end)) for end in ends]
            assert work == pytest.approx(potential[0] - potential[1], abs=1e-9)


def test_computed_torque_makes_the_motion(motion: Motion) -> None:
    """Expected: under these forces Newton and Euler's equations have the accelerations of the motion."""
    force = feedforward("computed_torque", UNEVEN, motion)
    solved = newton_euler.solve(
        UNEVEN,
        motion.position,
        matrix_from_orientation(motion.orientation),
        motion.velocity,
        motion.angular_velocity,
        force,
        np.zeros((5, 3)),
        np.zeros((5, 3)),
    )
    assert solved.linear == pytest.approx(motion.acceleration, abs=1e-9)
    assert solved.angular == pytest.approx(motion.angular_acceleration, abs=1e-9)


def test_feedforward_for_legs_that_stick_is_coulomb_friction_along_the_reference_at_most() -> None:
    """Expected: the forces of smooth friction, F_c tanh(L'/v) along its velocity; static friction adds none."""
    moving = {"controller.feedforward": "computed_torque", "loop.duration": 0.2}
    friction = {"platform.parameters.leg_coulomb_friction": 80.0}
    sticks = {
        "platform.parameters.leg_friction_model": "elasto_plastic",
        "platform.parameters.leg_static_friction": 150.0,
    }
    forces = [
        prepare(gs.load_experiment("pitch_sine", {**moving, **each})).loop.feedforward
        for each in ({"platform.parameters.leg_coulomb_friction": 0.0}, friction, {**friction, **sticks})
    ]
    np.testing.assert_array_equal(forces[2], forces[1])
    share = np.abs(forces[2] - forces[0]).max(axis=1)
    assert share.max() <= 80.0
    assert share.max() > 79.0

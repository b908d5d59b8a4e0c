"""Legs without mass: a rigid body under six forces along its legs, in the model and in units."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.fmu_plants import Fmu, plant
from tests.support.uneven import INPUT_VALUES, MOVING, STATE, UNEVEN

_MASSLESS = ("leg_lower_mass", "leg_upper_mass", "leg_lower_inertia", "leg_upper_inertia", "leg_armature")
_WITHOUT_FRICTION = ("leg_viscous_friction", "leg_coulomb_friction")
PLATFORM = UNEVEN.with_parameters(dict.fromkeys((*_MASSLESS, *_WITHOUT_FRICTION), 0.0))


def test_a_platform_on_massless_legs_is_a_rigid_body_under_forces_along_them(fmu: Fmu) -> None:
    """Expected: Newton and Euler for one body about its centre of mass; joints carry the actuators' forces alone."""
    R = Rotation.from_euler("xyz", STATE.orientation).as_matrix()
    arms, com = PLATFORM.platform_points @ R.T, R @ PLATFORM.platform_com
    u = STATE.position + arms - PLATFORM.base_points
    forces = INPUT_VALUES["actuator_force"][:, None] * u / np.linalg.norm(u, axis=1, keepdims=True)
    total, omega = forces.sum(axis=0) + INPUT_VALUES["external_force"], STATE.angular_velocity
    moment = np.cross(arms - com, forces).sum(axis=0) + INPUT_VALUES["external_torque"]
    moment = moment - np.cross(com, INPUT_VALUES["external_force"])
    inertia = R @ PLATFORM.platform_inertia @ R.T
    turning = np.linalg.solve(inertia, moment - np.cross(omega, inertia @ omega))
    of_com = total / PLATFORM.platform_mass + PLATFORM.gravity
    expected = {
        "acceleration": of_com - np.cross(turning, com) - np.cross(omega, np.cross(omega, com)),
        "angular_acceleration": turning,
        "joint_force": forces,
    }
    model = gs.SteppingModel(PLATFORM)
    model.set_many(MOVING)
    with plant(fmu) as p:
        p.start(MOVING, platform=PLATFORM)
        for name, value in expected.items():
            assert np.asarray(model.get(name)) == pytest.approx(value, rel=1e-9, abs=1e-9), name
            assert p.get(name) == pytest.approx(value, rel=1e-9, abs=1e-9), name


def test_forces_that_hold_a_massless_leg_are_those_of_the_load_alone() -> None:
    """Expected: six forces along the legs that balance the weight at the centre of mass, by a linear system."""
    R = Rotation.from_euler("xyz", STATE.orientation).as_matrix()
    arms, com = PLATFORM.platform_points @ R.T, R @ PLATFORM.platform_com
    u = STATE.position + arms - PLATFORM.base_points
    u = u / np.linalg.norm(u, axis=1, keepdims=True)
    weight = PLATFORM.platform_mass * PLATFORM.gravity
    held = np.linalg.solve(np.vstack([u.T, np.cross(arms, u).T]), -np.concatenate([weight, np.cross(com, weight)]))
    assert gs.static_leg_forces(PLATFORM, STATE.position, STATE.orientation) == pytest.approx(held, rel=1e-10)


def test_a_negative_mass_of_a_leg_is_refused() -> None:
    with pytest.raises(gs.GoughStewartError, match=r"leg_lower_mass: is -0\.1 kg; expected >= 0"):
        UNEVEN.with_parameters({"leg_lower_mass": -0.1})


def test_mujoco_is_told_to_need_a_mass_and_nothing_is_written(tmp_path: Path) -> None:
    """Expected: the name, and a thousandth of the platform's 11.5 kg."""
    with pytest.raises(gs.GoughStewartError, match=r"leg_lower_mass: is 0 kg; MuJoCo needs a mass .* to 0\.0115 kg or"):
        gs.build(tmp_path, forms=["mjcf"], platform=PLATFORM)
    assert not list(tmp_path.iterdir())

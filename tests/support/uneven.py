"""Platform, state, inputs and gains of which no two numbers are alike, so that a wrong index or transpose shows."""

import numpy as np

from gough_stewart import Platform, State
from gough_stewart.model.interface import Inputs
from tests.support.records import plain

UNEVEN = Platform(
    name="uneven",
    source="made up for tests",
    base_points=np.array(
        [
            *([0.52, 1.93, 0.04], [-0.61, 1.88, -0.03], [1.47, -1.32, 0.07]),
            *([1.98, -0.49, -0.08], [-2.04, -0.58, 0.02], [-1.36, -1.51, -0.05]),
        ]
    ),
    platform_points=np.array(
        [
            *([0.74, 0.66, -0.06], [-0.69, 0.75, 0.03], [0.31, -0.98, 0.05]),
            *([1.02, 0.24, -0.02], [-0.93, 0.29, 0.07], [-0.22, -1.04, -0.04]),
        ]
    ),
    platform_mass=11.5,
    platform_com=np.array([0.06, -0.11, 0.17]),
    platform_inertia=np.array([[4.6, 0.35, -0.28], [0.35, 5.7, 0.41], [-0.28, 0.41, 8.1]]),
    leg_lower_mass=2.3,
    leg_upper_mass=1.2,
    leg_lower_com=0.47,
    leg_upper_com=0.58,
    leg_lower_inertia=0.13,
    leg_upper_inertia=0.061,
    leg_armature=1.7,
    leg_viscous_friction=7.0,
    leg_coulomb_friction=1.9,
    leg_viscous_friction_factor=np.array([0.7, 1.4, 0.9, 1.6, 0.5, 1.1]),
    leg_coulomb_friction_factor=np.array([1.3, 0.6, 1.5, 0.8, 1.2, 0.4]),
    leg_friction_velocity=0.06,
    gravity=np.array([0.9, -1.3, -9.4]),
    home_position=np.array([0.08, -0.05, 2.9]),
    home_orientation=np.array([0.04, -0.07, 0.11]),
    leg_length_min=2.3,
    leg_length_max=3.9,
    actuator_force_max=640.0,
    joint_angle_max=0.7,
)
# Its parameters in plain types, as in a file.
PARAMETERS = {name: value for name, value in plain(UNEVEN).items() if name not in ("name", "source")}
# In motion about every axis, with every input.
STATE = State(
    position=np.array([0.12, -0.09, 2.97]),
    orientation=np.array([0.09, -0.14, 0.21]),
    velocity=np.array([0.21, -0.13, 0.08]),
    angular_velocity=np.array([-0.11, 0.17, 0.26]),
)
INPUT_VALUES = {
    "actuator_force": np.array([52.0, 38.0, 47.0, 44.0, 58.0, 41.0]),
    "external_force": np.array([3.0, -5.0, 8.0]),
    "external_torque": np.array([-4.0, 2.0, 6.0]),
}
INPUTS = Inputs(**INPUT_VALUES)
# Start values of a unit, or values of a stepping model.
MOVING = {**STATE._asdict(), **INPUT_VALUES}
# Of a controller of the legs [N/m].
GAINS = np.array([800.0, 650.0, 900.0, 720.0, 1000.0, 850.0])

"""The stepping model beside Kane and Newton–Euler, on one platform in a random state."""

import numpy as np
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart.model.formulations import kane, newton_euler
from tests.support.random_platforms import random_inputs, random_state


def largest_difference(platform: gs.Platform, rng: np.random.Generator, axial_inertia: float = 0.0) -> float:
    """Of accelerations, and of joint forces, from those of each formulation, relative to their length."""
    state, u = random_state(platform, rng), random_inputs(platform, rng)
    model = gs.SteppingModel(platform)
    model.set_many(state._asdict())
    model.set_inputs(u)
    found = model.results()
    acceleration = np.concatenate([found["acceleration"], found["angular_acceleration"]])
    R = Rotation.from_euler("xyz", state.orientation).as_matrix()
    newton = newton_euler.solve(
        platform, state.position, R, *state[2:], u[:6], u[6:9], u[9:], axial_inertia=axial_inertia
    )
    start = kane.consistent_start(platform, state)
    by_kane = kane.solve(platform, *start, u[:6], u[6:], axial_inertia=axial_inertia)
    pairs = (
        (acceleration, by_kane.platform_acceleration),
        (acceleration, np.concatenate([newton.linear, newton.angular])),
        (found["joint_force"], by_kane.joint_force),
        (found["joint_force"], newton.joint_force),
    )
    return max(float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs)) for ours, theirs in pairs)

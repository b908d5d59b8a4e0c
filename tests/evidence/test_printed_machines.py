"""Slow evidence: machines with stiction and elastic legs against what was printed, and against other integration."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gough_stewart as gs
from gough_stewart import Platform, SteppingModel, evaluate_poses
from tests.support.lagrangian import FloatArray, Pose, forces_along, legs_along
from tests.support.real_platforms import printed_law, real_platform
from tests.support.uneven import UNEVEN

pytestmark = pytest.mark.evidence


def motion_by_radau(
    platform: Platform, start: FloatArray, force: FloatArray, end: float, tolerance: float
) -> FloatArray:
    """State at a time [s]: pose, its rates, bristles, and of elastic legs positions and velocities of motors.

    The start (n,) is the same at time 0; elastic legs have a stiffness and a damping, and forces (6,) [N] are constant.
    The tolerance is relative; of bristles it is absolute in units of 10 µm, of others in SI units.
    """
    springs = len(start) == 30
    bare = UNEVEN.with_parameters({"leg_armature": 0.0 if springs else platform.leg_armature})
    no_and_each = np.vstack([np.zeros(6), np.eye(6)])

    def rates(_t: float, x: FloatArray) -> FloatArray:
        q, dq, z = x[:6], x[6:12], x[12:18]
        length, speed = (each[0] for each in legs_along(bare, Pose(q[None], dq[None], dq[None])))
        sliding = x[24:] if springs else speed
        friction, bent = np.transpose([printed_law(platform, sliding[k], z[k], k) for k in range(6)])
        of_leg, motors = force - friction, np.zeros(0)
        if springs:
            of_leg = platform.leg_stiffness * (x[18:24] - length) + platform.leg_damping * (sliding - speed)
            motors = np.concatenate([sliding, (force - friction - of_leg) / platform.leg_armature])
        # forces are linear in the accelerations
        needed = forces_along(bare, Pose(np.tile(q, (7, 1)), np.tile(dq, (7, 1)), no_and_each))
        accelerations = np.linalg.solve((needed[1:] - needed[0]).T, of_leg - needed[0])
        return np.concatenate([dq, accelerations, bent, motors])

    atol: Any = np.full(len(start), tolerance)
    atol[12:18] *= 1e-5
    found = solve_ivp(rates, (0, end), start, "Radau", rtol=tolerance, atol=atol)
    assert found.success
    return np.asarray(found.y[:, -1])


RIGID_LEGS = {"leg_armature": 0.0, "leg_stiffness": 0.0, "leg_damping": 0.0}
# T. Dehaeze, stewart-simscape (github.com/tdehaeze/stewart-simscape), org/identification.org: modes that it prints, and
# its default platform: joints on circles of 115 and 90 mm, 15 mm inside plates 90 mm apart, pairs ± 10 deg; a plate of
# 1 kg, radius 100 mm, thickness 10 mm below its frame; leg parts of 0.1 kg, rods of 50 mm, radius 5 mm, at the joints;
# 20 N/µm and 20 N s/m a leg, perfect joints.
PRINTED = [780.6, 780.6, 903.9, 1061.4, 1061.4, 1269.6]
PLATE, ROD = (3 * 0.1**2 + 0.01**2) / 12, 0.1 * (3 * 0.005**2 + 0.05**2) / 12
DEHAEZE = f"""
name = "dehaeze"
base_points = {{base}}
platform_points = {{top}}
platform_mass = 1.0
platform_com = [0.0, 0.0, -0.005]
platform_inertia = [[{PLATE}, 0.0, 0.0], [0.0, {PLATE}, 0.0], [0.0, 0.0, 0.005]]
leg_lower_mass = 0.1
leg_upper_mass = 0.1
leg_lower_com = 0.025
leg_upper_com = 0.025
leg_lower_inertia = {ROD}
leg_upper_inertia = {ROD}
leg_armature = 0.3
leg_stiffness = 20e6
leg_damping = 20.0
home_position = [0.0, 0.0, 0.09]
home_orientation = [0.0, 0.0, 0.0]
"""


def circle(radius: float, degrees: list[float], z: float) -> list[list[float]]:
    return [[radius * math.cos(a), radius * math.sin(a), z] for a in map(math.radians, degrees)]


def test_modes_of_a_published_platform_are_those_that_it_prints(tmp_path: Path) -> None:
    """Its springs stand on the ground, so motors are held. Printed with one decimal: 6e-5; asked: 0.1 %."""
    file = tmp_path / "dehaeze.toml"
    base = circle(0.115, [-10, 10, 110, 130, 230, 250], 0.015)
    top = circle(0.09, [-50, 50, 70, 170, 190, -70], -0.015)
    file.write_text(DEHAEZE.format(base=base, top=top), encoding="utf-8")
    platform = gs.load_platform(file)
    home = platform.home_position, platform.home_orientation
    assert evaluate_poses(platform, *home).first_mode == pytest.approx(PRINTED[0], rel=1e-4)
    # the linear model with the motors' rows and columns left out: with damping, and gravity
    found = gs.linearise(platform)
    poles = np.linalg.eigvals(found.A[:12, :12])
    held = np.sort(np.abs(poles[poles.imag > 0])) / (2 * np.pi)
    assert held == pytest.approx(PRINTED, rel=1e-4)
    # with free motors of 0.3 kg: of the relative motion, k (J M⁻¹ Jᵀ + 1/m_a)
    J = gs.leg_jacobian(platform, *home)
    M = gs.mass_matrix(platform.with_parameters(RIGID_LEGS), *home)
    free = np.sqrt(20e6 * np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T) + np.eye(6) / 0.3)) / (2 * np.pi)
    everything = np.linalg.eigvals(found.A)
    fast = np.sort(np.abs(everything[everything.imag > 2 * np.pi * 100])) / (2 * np.pi)
    assert fast == pytest.approx(free, rel=1e-4)


@pytest.mark.parametrize("friction", ["elasto_plastic", "lugre"])
@pytest.mark.parametrize("springs", [False, True])
def test_a_platform_moves_as_a_lagrangian_with_printed_laws_under_radau(friction: str, springs: bool) -> None:
    """Legs slide, four of them reverse. Expected: equations and integration that share nothing with the model's."""
    tolerance = 1e-8
    platform = real_platform(friction, springs)
    model = SteppingModel(platform, tolerance=1e-11)
    model.set("velocity", [0.03, -0.02, 0.05])
    force = platform.home_actuator_force + np.array([-90, 15, -70, -110, 12, -60])
    model.set("actuator_force", force)
    start = model.state
    expected = motion_by_radau(platform, start, force, 8e-3, tolerance)
    model.do_step(0.0, 8e-3)
    # Radau's accuracy: of velocities the tolerance, poses and bristles are better
    bounds = np.full(len(start), 2 * tolerance)
    bounds[:6], bounds[12:18] = 0.01 * tolerance, 1e-4 * tolerance
    # the rates of roll, pitch and yaw are not the angular velocity
    gap = np.delete(np.abs(model.state - expected) / bounds, slice(9, 12))
    assert gap.max() < 1
    assert np.ptp(np.sign(model.state[12:18])) == 2

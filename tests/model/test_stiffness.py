"""Stiffness on legs that give. Expected: second differences of the springs' energy, a published platform's modes."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from gough_stewart.harness.control.linear import linear_matrices
from gough_stewart.model.dynamics import mass_matrix
from gough_stewart.model.errors import PlatformError
from gough_stewart.model.vectors import FloatArray
from gough_stewart.model.workspace import compliance, held_frequencies, pose_stiffness
from tests.support.real_platforms import real_platform
from tests.support.uneven import UNEVEN

SOFT = real_platform("smooth", True)
RIGID = {"leg_armature": 0.0, "leg_stiffness": 0.0, "leg_damping": 0.0}
POSES = np.array([[0.10, -0.05, 2.92, 0.07, -0.09, 0.14], [0.31, -0.22, 3.05, -0.10, 0.08, 0.25]])
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
    assert held_frequencies(platform, *home) == pytest.approx(PRINTED, rel=1e-4)
    # the linear model with the motors' rows and columns left out: with damping, and gravity
    found = linear_matrices(platform)
    poles = np.linalg.eigvals(found.A[:12, :12])
    held = np.sort(np.abs(poles[poles.imag > 0])) / (2 * np.pi)
    assert held == pytest.approx(PRINTED, rel=1e-4)
    # with free motors of 0.3 kg: of the relative motion, k (J M⁻¹ Jᵀ + 1/m_a)
    J = gs.leg_jacobian(platform, *home)
    M = gs.mass_matrix(platform.with_parameters(RIGID), *home)
    free = np.sqrt(20e6 * np.linalg.eigvalsh(J @ np.linalg.solve(M, J.T) + np.eye(6) / 0.3)) / (2 * np.pi)
    everything = np.linalg.eigvals(found.A)
    fast = np.sort(np.abs(everything[everything.imag > 2 * np.pi * 100])) / (2 * np.pi)
    assert fast == pytest.approx(free, rel=1e-4)


def spring_energy(pose: FloatArray, twist: FloatArray) -> float:
    """½ k Σ (L − L0)² [J] of legs that are not stretched at the pose, after a small rotation vector and translation."""
    before = Rotation.from_euler("xyz", pose[3:])

    def lengths(t: FloatArray, R: Rotation) -> FloatArray:
        ends = R.apply(UNEVEN.platform_points.copy()) + t
        return np.asarray(np.linalg.norm(ends - UNEVEN.base_points, axis=1))

    stretch = lengths(pose[:3] + twist[:3], Rotation.from_rotvec(twist[3:]) * before) - lengths(pose[:3], before)
    return float(0.5 * SOFT.leg_stiffness * (stretch**2).sum())


def stiffness_of(pose: FloatArray) -> FloatArray:
    """Second differences (6, 6) of the energy."""
    h, e = 1e-4, np.eye(6)
    K = np.empty((6, 6))
    for i in range(6):
        for j in range(6):
            corners = [(a * b, spring_energy(pose, h * (a * e[i] + b * e[j]))) for a in (1, -1) for b in (1, -1)]
            K[i, j] = sum(sign * energy for sign, energy in corners) / (4 * h * h)
    return K


def test_stiffness_and_modes_at_poses_are_those_of_the_springs_energy() -> None:
    """Expected: K by differences; softest and stiffest by eigenvalues of blocks of K⁻¹; modes by K x = ω² M x."""
    found = pose_stiffness(SOFT, POSES[:, :3], POSES[:, 3:])
    rigid_motor = SOFT.with_parameters(RIGID)
    for k, pose in enumerate(POSES):
        K = stiffness_of(pose)
        C = np.linalg.inv(K)
        assert compliance(SOFT, pose[:3], pose[3:]) == pytest.approx(C, rel=1e-5, abs=1e-6 * np.abs(C).max())
        linear, angular = (1 / np.linalg.eigvalsh(block) for block in (C[:3, :3], C[3:, 3:]))
        omega = np.sqrt(eigh(K, mass_matrix(rigid_motor, pose[:3], pose[3:]), eigvals_only=True))
        expected = [linear[-1], linear[0], angular[-1], angular[0], omega[0] / (2 * np.pi)]
        assert [float(part[k]) for part in found] == pytest.approx(expected, rel=1e-5)
        assert held_frequencies(SOFT, pose[:3], pose[3:]) == pytest.approx(omega / (2 * np.pi), rel=1e-5)


def test_at_a_singular_pose_there_is_no_stiffness() -> None:
    """Where P₁ is at B₁, leg 1 has no direction."""
    # without rounding, so that the leg has no length at all
    base, top = (np.round(64 * points) / 64 for points in (SOFT.base_points, SOFT.platform_points))
    soft = replace(SOFT, base_points=base, platform_points=top)
    found = pose_stiffness(soft, np.stack([base[0] - top[0], SOFT.home_position]), np.zeros(3))
    assert [float(part[0]) for part in found] == [0.0] * 5
    assert all(part[1] > 0 for part in found)


def test_rigid_legs_have_no_compliance() -> None:
    with pytest.raises(PlatformError, match="leg_stiffness: is 0, rigid legs, which have no stiffness"):
        compliance(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation)

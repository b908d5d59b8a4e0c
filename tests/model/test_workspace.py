"""Reach, conditioning, static strength and stiffness at poses, against closed forms and other methods."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from gough_stewart import (
    GoughStewartError,
    compliance,
    evaluate_poses,
    leg_geometry,
    leg_jacobian,
    load_preset,
    mass_matrix,
    static_leg_forces,
)
from tests.support.lagrangian import FloatArray
from tests.support.uneven import UNEVEN

MOTION_BASE, DESKTOP, PAPER = (load_preset(name) for name in ("motion_base", "desktop_hexapod", "liu2000"))

LEVEL = np.zeros(3)


# Why a pose is out of reach, in the order of the documentation; 0 if it is not.
PITCH, SINGULAR, LEG_TOO_SHORT, LEG_TOO_LONG, BASE_JOINT, PLATFORM_JOINT = range(1, 7)


def test_limits_that_are_not_stated_keep_from_nothing() -> None:
    q = evaluate_poses(PAPER, PAPER.home_position, LEVEL)
    assert (q.leg_length_margin, q.joint_angle_margin, q.payload, q.force_margin, q.largest_speed) == (None,) * 5
    assert q[8:] == (None,) * 5
    weightless = evaluate_poses(replace(MOTION_BASE, gravity=np.zeros(3)), MOTION_BASE.home_position, LEVEL)
    assert weightless.payload == np.inf  # no leg feels it
    assert weightless.force_margin is not None
    assert np.isfinite(weightless.force_margin)
    one_sided = evaluate_poses(replace(PAPER, leg_length_max=3.3), np.array([0, 0, 3.5]), LEVEL)
    assert one_sided.limit == LEG_TOO_LONG
    for position, orientation in (([0, np.nan, 2], LEVEL), ([0, 0, 2], [0, np.nan, 0])):
        with pytest.raises(GoughStewartError, match=r"pose 2 is \[0\.0, .*nan, .*0\.0\]; expected finite"):
            evaluate_poses(MOTION_BASE, np.array([[0, 0, 2], position]), np.array([LEVEL, orientation]))


# Six different poses about and beyond the limits of the uneven platform.
POSES = np.array(
    [
        [0.10, -0.05, 2.92, 0.07, -0.09, 0.14],
        [0.31, -0.22, 3.05, -0.10, 0.08, 0.25],
        [-0.60, 0.45, 2.60, 0.15, 0.12, -0.20],
        [0.90, 0.10, 3.40, 0.02, -0.30, 0.05],
        [0.05, 0.02, 1.60, 0.00, 0.05, 0.10],
        [0.10, -0.10, 2.95, 0.30, -0.20, 0.90],
    ]
)


def test_every_quality_of_a_pose_is_that_of_an_independent_calculation() -> None:
    """Expected: NumPy and SciPy, pose by pose, from legs, statics and masses that have tests; a batch of a batch."""
    V, F = np.array([0.8, 0.7, 0.9, 0.75, 0.85, 0.65]), np.array([75.0, 82.0, 71.0, 78.0, 85.0, 73.0])
    low, high = np.array([2.3, 2.2, 2.35, 2.25, 2.4, 2.1]), np.array([3.9, 3.8, 3.7, 3.95, 3.85, 3.75])
    k = 1e6 * np.array([2.7, 3.1, 2.2, 2.9, 3.3, 2.5])
    six = {"leg_velocity_max": V, "actuator_force_max": F, "leg_length_min": low, "leg_length_max": high}
    platform = UNEVEN.with_parameters({**six, "leg_stiffness": k})
    rigid = replace(platform, leg_stiffness=0.0, leg_armature=0.0)  # motors hold
    found = evaluate_poses(platform, POSES[:, :3].reshape(2, 3, 3), POSES[:, 3:].reshape(2, 3, 3))
    home = Rotation.from_euler("xyz", UNEVEN.home_orientation)
    rho = np.sqrt((UNEVEN.platform_points**2).sum() / 6)

    def angle(a: FloatArray, b: FloatArray) -> float:
        return float(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)).max())

    u0 = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).direction
    for n, pose in enumerate(POSES):
        R = Rotation.from_euler("xyz", pose[3:])
        _, _, L, u = leg_geometry(UNEVEN, pose[:3], pose[3:])
        J = leg_jacobian(UNEVEN, pose[:3], pose[3:])
        scaled = J / np.repeat([1.0, rho], 3)
        sigma = np.linalg.svd(scaled, compute_uv=False)
        of_base = 0.7 - angle(u, u0)
        of_platform = 0.7 - angle(R.inv().apply(u), home.inv().apply(u0))
        f0 = static_leg_forces(UNEVEN, pose[:3], pose[3:])
        # a mass of 1 kg, and a force of 1 N in any direction, at Op
        f1 = np.linalg.solve(J.T, np.concatenate([-UNEVEN.gravity, np.zeros(3)]))
        A = np.linalg.inv(J.T)[:, :3]
        K = J.T @ np.diag(k) @ J
        C = np.linalg.inv(K)
        M = mass_matrix(rigid, pose[:3], pose[3:])
        assert compliance(platform, pose[:3], pose[3:]) == pytest.approx(C, rel=1e-9, abs=1e-12 * np.abs(C).max())
        holds = bool((np.abs(f0) <= F).all())
        expected = {
            "leg_length_margin": min((L - low).min(), (high - L).min()),
            "joint_angle_margin": min(of_base, of_platform),
            "singular_margin": sigma[5],
            "condition_number": sigma[0] / sigma[5],
            "payload": ((F - np.sign(f1) * f0) / np.abs(f1)).min() if holds else 0.0,
            "force_margin": ((F - np.abs(f0)) / np.linalg.norm(A, axis=1)).min() if holds else 0.0,
            "largest_speed": (V / np.linalg.norm(scaled, axis=1)).min(),
            "translational_stiffness": 1 / np.linalg.eigvalsh(C[:3, :3]).max(),
            "translational_stiffness_max": 1 / np.linalg.eigvalsh(C[:3, :3]).min(),
            "rotational_stiffness": 1 / np.linalg.eigvalsh(C[3:, 3:]).max(),
            "rotational_stiffness_max": 1 / np.linalg.eigvalsh(C[3:, 3:]).min(),
            "first_mode": np.sqrt(eigh(K, M, eigvals_only=True)[0]) / (2 * np.pi),
        }
        for name, value in expected.items():
            own = getattr(found, name)
            assert own.shape == (2, 3)
            assert own.reshape(6)[n] == pytest.approx(value, rel=1e-8, abs=1e-8), (name, n)
        first = [(low > L).any(), (high < L).any(), of_base < 0, of_platform < 0]
        kinds = [LEG_TOO_SHORT, LEG_TOO_LONG, BASE_JOINT, PLATFORM_JOINT]
        limit = next((kind for is_beyond, kind in zip(first, kinds, strict=True) if is_beyond), 0)
        assert found.limit.reshape(6)[n] == limit
        assert found.reachable.reshape(6)[n] == (limit == 0)
    assert len(set(found.limit.ravel().tolist())) >= 3
    assert found.payload is not None
    assert 0 < np.count_nonzero(found.payload) < 6
    # where it hangs instead of standing all forces reverse, and legs that are pulled hold as much
    hanging = evaluate_poses(
        replace(platform, gravity=-UNEVEN.gravity), POSES[:, :3].reshape(2, 3, 3), POSES[:, 3:].reshape(2, 3, 3)
    )
    assert hanging.payload == pytest.approx(found.payload, rel=1e-8, abs=1e-8)
    assert hanging.force_margin == pytest.approx(found.force_margin, rel=1e-8, abs=1e-8)


def test_a_pose_beyond_several_limits_is_out_of_reach_by_the_first() -> None:
    """Expected: the documentation's order."""
    narrow = replace(UNEVEN, joint_angle_max=1e-6, leg_length_min=2.9, leg_length_max=3.3)
    home, level = UNEVEN.home_position, UNEVEN.home_orientation
    poses = [
        (home, np.array([0.0, np.pi / 2 - 0.9e-3, 2.5]), PITCH),
        (home, np.array([0.0, -np.pi / 2 + 0.9e-3, 2.5]), PITCH),
        (home, np.array([0.0, 0.0, 2.5]), SINGULAR),
        (home + np.array([1.5, 0.0, -0.3]), level, LEG_TOO_SHORT),
        (home + np.array([0.0, 0.0, 0.4]), level, LEG_TOO_LONG),
        (home + np.array([0.01, 0.0, 0.0]), level, BASE_JOINT),
    ]
    lengths = leg_geometry(narrow, poses[3][0], level).length
    assert lengths.min() < 2.9
    assert lengths.max() > 3.3
    position, orientation = (np.array([pose[k] for pose in poses]) for k in (0, 1))
    assert evaluate_poses(narrow, position, orientation).limit.tolist() == [pose[2] for pose in poses]
    turned = replace(narrow, joint_angle_max=0.02)
    tilted = evaluate_poses(turned, home, level + np.array([0.05, 0.0, 0.0]))
    assert tilted.limit == PLATFORM_JOINT


def test_rigid_legs_have_no_compliance() -> None:
    with pytest.raises(GoughStewartError, match="leg_stiffness: is 0, rigid legs, which have no stiffness"):
        compliance(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation)

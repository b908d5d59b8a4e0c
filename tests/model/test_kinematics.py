"""Leg kinematics against closed forms, finite differences and known singular poses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, Platform, State
from gough_stewart.model import dynamics, kinematics, pose_limits
from tests.support.random_platforms import random_platform, random_state
from tests.support.uneven import INPUTS, STATE, UNEVEN

seeds = st.integers(0, 2**32 - 1)


def test_the_legs_of_a_pose_are_those_of_elementary_geometry(paper: Platform) -> None:
    """Expected: written out with SciPy's rotation; of the paper's platform the cosine rule; Fichter's singularity.

    Conditioning by singular values of [u, c × u / ρ], ρ the joints' root mean square distance.
    """
    arm = Rotation.from_euler("xyz", STATE.orientation).apply(UNEVEN.platform_points.copy())
    l = STATE.position + arm - UNEVEN.base_points
    L = np.linalg.norm(l, axis=1)
    u = l / L[:, None]
    legs = kinematics.leg_geometry(UNEVEN, STATE.position, STATE.orientation)
    for part, expected in zip(legs, (arm, l, L, u), strict=True):
        assert part == pytest.approx(expected, abs=1e-14)
    J = np.hstack([u, np.cross(arm, u)])
    assert kinematics.leg_jacobian(UNEVEN, STATE.position, STATE.orientation) == pytest.approx(J, abs=1e-13)
    forces = INPUTS.actuator_force[:, None] * u
    wrench = [*forces.sum(axis=0), *np.cross(arm, forces).sum(axis=0)]
    assert kinematics.wrench_from_leg_forces(legs, INPUTS.actuator_force) == pytest.approx(wrench, rel=1e-12)
    rho = np.sqrt((UNEVEN.platform_points**2).sum() / 6)
    sigma = np.linalg.svd(np.hstack([u, np.cross(arm, u) / rho]), compute_uv=False)
    expected_conditioning = [sigma[0] / sigma[5], sigma[5], rho]
    found = kinematics.conditioning(UNEVEN, STATE.position, STATE.orientation)
    assert list(found) == pytest.approx(expected_conditioning, rel=1e-10)
    assert UNEVEN.characteristic_length == pytest.approx(rho, rel=1e-12)
    length = kinematics.leg_geometry(paper, paper.home_position, paper.home_orientation).length
    assert length == pytest.approx(np.full(6, np.sqrt(14 - 2 * np.sqrt(3))), rel=1e-15)
    for yaw in (np.pi / 2, -np.pi / 2):
        singular = kinematics.conditioning(paper, np.array([0, 0, 3.0]), np.array([0, 0, yaw]))
        assert singular.smallest_singular_value < 1e-15
        assert singular.condition_number > 1e15


@given(seeds)
def test_rates_and_accelerations_are_the_derivatives_along_a_motion(seed: int) -> None:
    """Expected: central differences along t + v t + v̇ t²/2 and exp(ω t + ω̇ t²/2) R, of lengths, directions, rates."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    state = random_state(platform, rng)
    linear, angular = rng.normal(size=(2, 3))
    h = 1e-5

    def at(t: float) -> tuple[kinematics.LegGeometry, kinematics.LegRates]:
        turn = Rotation.from_rotvec(t * state.angular_velocity + 0.5 * t * t * angular)
        o = (turn * Rotation.from_euler("xyz", state.orientation)).as_euler("xyz")
        p = state.position + t * state.velocity + 0.5 * t * t * linear
        moving = State(p, o, state.velocity + t * linear, state.angular_velocity + t * angular)
        return kinematics.leg_geometry(platform, p, o), kinematics.leg_rates(platform, moving)

    (ahead, fast), (legs, rates), (behind, slow) = at(h), at(0.0), at(-h)

    def agrees(found: np.ndarray, one: np.ndarray, other: np.ndarray) -> None:
        expected = (one - other) / (2 * h)
        assert found == pytest.approx(expected, abs=1e-5 * (1 + np.abs(expected).max()))

    agrees(rates.length_rate, ahead.length, behind.length)
    agrees(rates.direction_rate, ahead.direction, behind.direction)
    agrees(rates.joint_velocity, ahead.vector, behind.vector)
    agrees(kinematics.leg_accelerations(legs, state, linear, angular), fast.length_rate, slow.length_rate)
    joints = kinematics.joint_accelerations(legs, state.angular_velocity, linear, angular)
    agrees(joints, fast.joint_velocity, slow.joint_velocity)
    J = kinematics.leg_jacobian(platform, *state[:2])
    assert rates.length_rate == pytest.approx(J @ np.concatenate(state[2:]), rel=1e-11, abs=1e-11)


def test_joint_angles_are_those_between_directions_in_world_and_in_platform_axes() -> None:
    """Expected: arccos of SciPy's rotated vectors, leg by leg; 0 at home, where arccos is blind."""
    home = UNEVEN.home_position, UNEVEN.home_orientation

    def directions(position: np.ndarray, orientation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turn = Rotation.from_euler("xyz", orientation)
        l = position + turn.apply(UNEVEN.platform_points.copy()) - UNEVEN.base_points
        u = l / np.linalg.norm(l, axis=1)[:, None]
        return u, turn.inv().apply(u)

    at_base, at_platform = kinematics.joint_angles(UNEVEN, STATE.position, STATE.orientation, *home)
    here, there = directions(STATE.position, STATE.orientation), directions(*home)
    assert at_base == pytest.approx(np.arccos((here[0] * there[0]).sum(axis=1)), rel=1e-9)
    assert at_platform == pytest.approx(np.arccos((here[1] * there[1]).sum(axis=1)), rel=1e-9)
    assert np.abs(kinematics.joint_angles(UNEVEN, *home, *home)).max() < 1e-15
    # 1e-9 m aside turns a leg by 1e-9 m across it over its length
    aside = 1e-9 * np.array([1.0, 0.0, 0.0])
    turned, _ = kinematics.joint_angles(UNEVEN, home[0] + aside, home[1], *home)
    across = np.linalg.norm(aside - there[0] * (there[0] @ aside)[:, None], axis=1)
    length = kinematics.leg_geometry(UNEVEN, *home).length
    assert turned == pytest.approx(across / length, rel=1e-5)


def test_poses_and_motions_may_be_lists(paper: Platform) -> None:
    """Expected: what the same numbers give as arrays."""
    pose: Any = ([0.1, -0.2, 2.9], [0.05, -0.1, 0.2])
    twist: Any = ([0.3, 0.1, -0.2], [0.1, 0.4, -0.3])
    arrays: Any = tuple(np.array(each) for each in pose)
    assert (kinematics.leg_geometry(paper, *pose).length == kinematics.leg_geometry(paper, *arrays).length).all()
    assert (kinematics.leg_jacobian(paper, *pose) == kinematics.leg_jacobian(paper, *arrays)).all()
    assert (dynamics.mass_matrix(paper, *pose) == dynamics.mass_matrix(paper, *arrays)).all()
    wrench: Any = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert (
        dynamics.static_leg_forces(paper, pose[0], pose[1], wrench)
        == dynamics.static_leg_forces(paper, arrays[0], arrays[1], np.array(wrench))
    ).all()
    given, same = State(*pose, *twist), State(*arrays, *map(np.array, twist))
    acceleration: Any = ([0.5, 0.0, 1.0], [0.0, 2.0, 0.0])
    assert (
        dynamics.inverse_dynamics(paper, given, dynamics.Acceleration(*acceleration))
        == dynamics.inverse_dynamics(paper, same, dynamics.Acceleration(*map(np.array, acceleration)))
    ).all()


def test_the_bound_of_the_condition_number_is_above_it_and_not_by_much() -> None:
    """Expected: κ ≤ ‖A‖ ‖A⁻¹‖ ≤ n κ in Frobenius norms, with κ by singular values; no bound where a matrix has none."""
    rng = np.random.default_rng(4)
    matrices = rng.normal(size=(50, 6, 6)) * np.geomspace(1e-3, 1e3, 6)
    exact, bound = np.linalg.cond(matrices), kinematics.condition_number_bound(matrices)
    assert (exact <= bound).all()
    assert (bound <= 6 * exact).all()
    matrices[7, 3] = matrices[7, 2]
    assert kinematics.condition_number_bound(matrices)[7] > 1e12
    assert kinematics.condition_number_bound(np.zeros((2, 6, 6))).tolist() == [np.inf, np.inf]


def test_a_leg_of_length_zero_is_a_singular_pose_and_no_warning(paper: Platform) -> None:
    """Expected: joints of leg 1 that meet to the last bit at the origin; a warning would fail the test."""
    base, points = paper.base_points.copy(), paper.platform_points.copy()
    base[0] = points[0] = [0.5, 1.0, 0.0]
    met = replace(paper, base_points=base, platform_points=points, home_orientation=np.zeros(3))
    o = np.zeros(3)
    assert kinematics.leg_geometry(met, o, o).length[0] == 0
    assert kinematics.conditioning(met, o, o).condition_number == np.inf
    assert np.isnan(dynamics.mass_matrix(met, o, o)).any()
    with pytest.raises(GoughStewartError, match="condition number inf"):
        dynamics.static_leg_forces(met, o, o)
    with pytest.raises(GoughStewartError, match="condition number inf"):
        dynamics.inverse_dynamics(met, State(o, o, o, o), dynamics.Acceleration(o, o))


def test_poses_of_a_batch_know_nothing_of_each_other() -> None:
    """Expected: each function of one pose at a time, also beside a pose in which a leg has no direction."""
    rng = np.random.default_rng(11)
    base, top = UNEVEN.base_points.copy(), UNEVEN.platform_points.copy()
    base[3] = top[3] = [0.5, 1.0, 0.0]
    met = replace(UNEVEN, base_points=base, platform_points=top, home_orientation=np.zeros(3))
    position = met.home_position + 0.2 * rng.normal(size=(4, 3))
    orientation = met.home_orientation + 0.1 * rng.normal(size=(4, 3))
    position[2] = orientation[2] = 0.0
    home = met.home_position, met.home_orientation

    def results(position: np.ndarray, orientation: np.ndarray) -> list[np.ndarray]:
        legs = kinematics.leg_geometry(met, position, orientation)
        scaled, rho = kinematics.scaled_jacobian_of_legs(legs)
        angles = kinematics.joint_angles(met, position, orientation, *home)
        return [
            *legs,
            *kinematics.conditioning_of_legs(legs),
            kinematics.handedness_of_legs(legs),
            scaled,
            rho,
            *angles,
            pose_limits.side_of_singular_poses(met, legs),
        ]

    with np.errstate(invalid="ignore"):
        many, each = results(position, orientation), [results(p, o) for p, o in zip(position, orientation, strict=True)]
    for k in range(4):
        for found, expected in zip(many, each[k], strict=True):
            np.testing.assert_allclose(found[k], expected, rtol=1e-11, atol=1e-13)
    numbers = many[4]
    assert numbers[2] == np.inf
    assert np.isfinite(numbers[[0, 1, 3]]).all()
    assert many[-1][[0, 1, 3]].tolist() == [1, 1, 1]


def test_the_side_of_singular_poses_is_the_sign_of_the_determinant_against_home() -> None:
    """Expected: a platform mirrored in its base has the other sign; so do yaws on either side of the singular one."""
    mirrored = np.array([0.08, -0.05, -2.9]), np.array([-0.04, 0.07, 0.11])
    flat = replace(
        UNEVEN, base_points=UNEVEN.base_points * [1, 1, 0], platform_points=UNEVEN.platform_points * [1, 1, 0]
    )
    poses = [(flat.home_position, flat.home_orientation), mirrored, (flat.home_position, np.array([0.0, 0.0, 2.8]))]
    for position, orientation in poses:
        legs = kinematics.leg_geometry(flat, position, orientation)
        dets = [np.linalg.det(kinematics.leg_jacobian(flat, *pose)) for pose in ((position, orientation), poses[0])]
        assert pose_limits.side_of_singular_poses(flat, legs) == np.sign(dets[0] * dets[1])
        assert kinematics.handedness_of_legs(legs) == np.sign(dets[0])
    assert pose_limits.side_of_singular_poses(flat, kinematics.leg_geometry(flat, *mirrored)) == -1

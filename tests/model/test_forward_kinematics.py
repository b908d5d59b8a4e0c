"""Forward kinematics: finds the pose near the guess, or says that there is none."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, forward_kinematics, leg_geometry, leg_jacobian, load_preset
from tests.support.random_platforms import random_platform, random_state
from tests.support.uneven import STATE, UNEVEN

PAPER = load_preset("liu2000")


@given(st.integers(0, 2**32 - 1))
def test_finds_the_pose_that_the_lengths_came_from(seed: int) -> None:
    """Expected: the pose itself, reached from a nearby guess."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    pose = random_state(platform, rng)
    size = platform.characteristic_length
    guess = pose.position + 0.02 * size * rng.normal(size=3), pose.orientation + 0.02 * rng.normal(size=3)
    lengths = leg_geometry(platform, pose.position, pose.orientation).length
    found = forward_kinematics(platform, lengths, *guess, conditioning=True)
    J = leg_jacobian(platform, *pose[:2]) / np.repeat([1, size], 3)
    assert found.condition_number == pytest.approx(np.linalg.cond(J), rel=1e-6)
    assert found.converged
    assert np.allclose(found.position, pose.position, atol=1e-9 * size)
    assert np.allclose(found.orientation, pose.orientation, atol=1e-9)
    assert found.residual == pytest.approx(
        np.abs(leg_geometry(platform, found.position, found.orientation).length - lengths).max(), abs=1e-14
    )


def test_residuals_are_relative_to_the_longest_leg_and_stop_at_the_tolerance() -> None:
    """Expected: the first residual at or below tolerance × the longest leg ends the iteration; none before is."""
    lengths = leg_geometry(UNEVEN, STATE.position, STATE.orientation).length
    whole = forward_kinematics(UNEVEN, lengths, tolerance=1e-3).residual_history
    at_home = leg_geometry(UNEVEN, UNEVEN.home_position, UNEVEN.home_orientation).length
    assert whole[0] == pytest.approx(np.abs(lengths - at_home).max(), rel=1e-12)
    fine = forward_kinematics(UNEVEN, lengths, tolerance=1e-12)
    r = np.array(fine.residual_history) / lengths.max()
    for tolerance in (1e-3, 1.02 * r[2], 0.98 * r[2], 1e-9):
        found = forward_kinematics(UNEVEN, lengths, tolerance=float(tolerance))
        assert found.iterations == int(np.flatnonzero(r <= tolerance)[0])
        assert len(found.residual_history) == found.iterations + 1
        assert found.residual == found.residual_history[-1]
    # as many iterations as are needed, and not one less
    forward_kinematics(UNEVEN, lengths, max_iterations=int(fine.iterations))
    n, error = int(fine.iterations) - 1, fine.residual_history[-2]
    text = rf"no convergence after {n} iterations; .* is {error:.3g} m at position \[0\.1\d+, -.* rad after {n} iter"
    with pytest.raises(GoughStewartError, match=text):
        forward_kinematics(UNEVEN, lengths, max_iterations=n)


@pytest.mark.parametrize(
    ("guess", "text"),
    [
        ({"orientation": [0.0, np.pi / 2, 0.0]}, "±90°"),
        ({"platform": PAPER, "position": [0, 0, 3.0], "orientation": [0, 0, np.pi / 2]}, "singular"),
        ({"tolerance": 1.1e-3}, r"^tolerance: is 0.0011; expected in \(0, 1e-3\], for example 1e-12$"),
        *(({"tolerance": bad}, r"^tolerance: is .*; expected in") for bad in (np.nan, np.inf, -1.0, 0.0)),
        ({"max_iterations": -1}, r"^max_iterations: is -1; expected at least 0$"),
        (
            {"leg_length": [3.0] * 5 + [0.0]},
            r"^leg_length: is \[3.0, 3.0, 3.0, 3.0, 3.0, 0.0\] m; expected lengths > 0$",
        ),
    ],
)
def test_wrong_arguments_are_told_by_name(guess: dict[str, object], text: str) -> None:
    arguments: dict[str, object] = {"platform": UNEVEN, "leg_length": np.full(6, 3.0), **guess}
    with pytest.raises(GoughStewartError, match=text):
        forward_kinematics(**arguments)  # type: ignore[arg-type]


def test_angles_are_counted_in_the_turns_of_the_guess() -> None:
    """Expected: the pose whose legs these are, of a platform that stands turned by 4 rad, and not 4 rad − 2π."""
    turn = Rotation.from_euler("z", 4.0).as_matrix()
    platform = load_preset("motion_base")
    turned = {"platform_points": platform.platform_points @ turn, "home_orientation": [0, 0, 4.0]}
    platform = platform.with_parameters(turned)
    pose = platform.home_position + 0.02, np.array([0.01, -0.02, 4.03])
    found = forward_kinematics(platform, leg_geometry(platform, *pose).length)
    assert found.orientation == pytest.approx(pose[1], abs=1e-9)


def a_log(n: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, orientations and the distances between joints, written out, of two logs (2, n, …)."""
    t = np.linspace(0, 4, n) + np.array([[0.0], [0.3]])
    position = UNEVEN.home_position + 0.1 * np.stack([np.sin(3 * t), np.cos(2 * t), np.sin(t)], axis=-1)
    orientation = UNEVEN.home_orientation + 0.15 * np.stack([np.cos(t), np.sin(2 * t), np.sin(3 * t)], axis=-1)
    rotation = np.stack([Rotation.from_euler("xyz", angles).as_matrix() for angles in orientation])
    joints = position[..., None, :] + np.einsum("bnij,lj->bnli", rotation, UNEVEN.platform_points)
    return position, orientation, np.linalg.norm(joints - UNEVEN.base_points, axis=-1)


def test_rows_of_logs_have_the_poses_that_their_lengths_came_from() -> None:
    """Expected: the poses; NaN where a length is, and the row after it is found; residuals by the distances."""
    position, orientation, lengths = a_log()
    lengths[1, 7, 2] = np.nan
    found = forward_kinematics(UNEVEN, lengths, conditioning=True)
    known = np.ones((2, 400), dtype=bool)
    known[1, 7] = False
    assert (np.asarray(found.converged) == known).all()
    assert found.position[known] == pytest.approx(position[known], abs=1e-10)
    assert found.orientation[known] == pytest.approx(orientation[known], abs=1e-10)
    assert np.isnan(found.position[1, 7]).all()
    # the compiled search itself finds them: extrapolated by rows 10 ms apart, two steps reach the rounding, where the
    # pose of the row before, from which others search, takes three
    assert np.asarray(found.iterations)[0, 2:].max() == 2
    again = leg_geometry(UNEVEN, found.position, found.orientation).length
    assert found.residual == pytest.approx(np.abs(again - lengths).max(axis=-1), abs=1e-14, nan_ok=True)
    rho = np.sqrt((UNEVEN.platform_points**2).sum(axis=1).mean())
    jacobian = leg_jacobian(UNEVEN, position[0], orientation[0]) / [1, 1, 1, rho, rho, rho]
    assert found.condition_number is not None
    assert np.asarray(found.condition_number)[0] == pytest.approx(np.linalg.cond(jacobian), rel=1e-9)


def test_rows_start_from_the_guess_and_stay_in_its_turns_and_assembly_mode() -> None:
    """Expected: the same lengths from a guess below the base, mirrored; from one a turn further, a turn further."""
    level = np.linspace([0, 0, 3.0], [0.1, 0, 2.9], 50)
    lengths = leg_geometry(PAPER, level, np.zeros((50, 3))).length
    below = forward_kinematics(PAPER, lengths, np.array([0.1, 0, -2.8]))
    assert below.position == pytest.approx(level * [1, 1, -1], abs=1e-9)
    further = forward_kinematics(PAPER, lengths, orientation=np.array([0, 0, 2 * np.pi + 0.02]))
    assert further.orientation == pytest.approx(np.tile([0, 0, 2 * np.pi], (50, 1)), abs=1e-9)


def test_a_row_far_from_the_one_before_is_found_and_one_that_no_pose_has_is_named() -> None:
    """Expected: across a jump the pose; of lengths that no pose has the row, counted from 0 in each leading axis."""
    position, _, lengths = a_log()
    jump = np.stack([lengths[0, 0], lengths[0, 200], lengths[1, 90]])
    found = forward_kinematics(UNEVEN, jump)
    expected = np.stack([position[0, 0], position[0, 200], position[1, 90]])
    assert found.position == pytest.approx(expected, abs=1e-10)
    lengths[1, 12, 0] *= 4
    with pytest.raises(GoughStewartError, match=r"^row 1, 12, lengths \[.*\] m: no pose near this guess"):
        forward_kinematics(UNEVEN, lengths)
    lengths[1, 12, 0] = 0.0
    with pytest.raises(GoughStewartError, match=r"^leg_length: is 0.0 m in row 1, 12; expected lengths > 0, or NaN$"):
        forward_kinematics(UNEVEN, lengths)


def test_each_of_several_far_rows_is_searched_from_the_one_before() -> None:
    """Expected: the poses; each is 40 of the longest steps from the one before, where 50 are tried."""
    heights = PAPER.home_position[2] + 20 * PAPER.characteristic_length * np.arange(3)
    position = np.column_stack([np.full(3, 0.1), np.zeros(3), heights])
    found = forward_kinematics(PAPER, leg_geometry(PAPER, position, np.zeros((3, 3))).length)
    assert found.position == pytest.approx(position, abs=1e-9)


def test_a_row_far_from_its_guess_stays_on_the_side_of_the_guess() -> None:
    """Expected: the sign of det J of the guess, or an error, of far guesses near singular poses; most are found."""
    number = 0
    for seed in range(140):
        rng = np.random.default_rng(seed)
        pose = np.array([0, 0, 3.0]) + rng.uniform(-1, 1, 3), rng.uniform(-0.5, 0.5, 3)
        lengths = leg_geometry(UNEVEN, *pose).length
        guess = np.array([0, 0, 1.2]) + rng.uniform(-1, 1, 3), rng.uniform(-1.2, 1.2, 3)
        try:
            found = forward_kinematics(UNEVEN, lengths[None], *guess)
        except GoughStewartError:
            continue
        number += 1
        ends = (guess, (found.position[0], found.orientation[0]))
        at_guess, at_end = (np.linalg.det(leg_jacobian(UNEVEN, *end)) for end in ends)
        assert at_guess * at_end > 0
    assert number > 80

"""Paths through poses: the curve against SciPy's splines, keys, files, scales, what is refused, and the polynomials."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.harness.motion.forces import pose_along
from tests.support.arrays import FloatArray
from tests.support.motions import by_differences, experiment, write_table
from tests.support.uneven import UNEVEN

POSES: Any = [[0.1, -0.1, 2.9, 0.05, -0.02, 0.1], [0.15, 0.1, 2.95, -0.05, 0.1, -0.1], [-0.1, 0.0, 2.8, 0.1, 0.0, 0.2]]
FREE = replace(UNEVEN, joint_angle_max=None, leg_length_min=None, leg_length_max=None, actuator_force_max=None)
HOME = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])


def along(share: FloatArray) -> FloatArray:
    """S of the quintic time law."""
    tau = np.clip(share, 0, 1)
    return np.asarray(10 * tau**3 - 15 * tau**4 + 6 * tau**5)


def rotations(angles: Any) -> Any:
    return Rotation.from_euler("xyz", angles)


@pytest.mark.parametrize("interpolation", ["cubic", "quintic"])
def test_a_path_is_the_documented_spline_through_its_poses(interpolation: Any) -> None:
    """Expected: SciPy's natural cubic and quintic splines over s that grows with √(|Δp|² + ℓ² |Δρ|²)."""
    poses = np.array([*POSES, [0.0, 0.15, 2.9, -0.1, 0.05, -0.15]])
    poses[:, 3:] += [[-0.3, 0.2, -0.4], [0.35, -0.25, 0.5], [-0.2, -0.35, 0.1], [0.3, 0.3, -0.3]]  # large turns
    path = gs.ViaPath(poses=poses, interpolation=interpolation, timing=2).about(FREE)
    first = rotations(poses[0, 3:])
    rho = (rotations(poses[:, 3:]) * first.inv()).as_rotvec()
    both = np.hstack([poses[:, :3], rho])
    ell = np.sqrt((UNEVEN.platform_points**2).sum(axis=1).mean())
    steps = np.linalg.norm(np.diff(both * np.repeat([1, ell], 3), axis=0), axis=1)
    at = np.append(0, np.cumsum(steps)) / steps.sum()
    flat: Any = [(2, np.zeros(6)), (4, np.zeros(6))]
    spline = (
        CubicSpline(at, both, bc_type="natural")
        if interpolation == "cubic"
        else make_interp_spline(at, both, 5, bc_type=(flat, flat))
    )
    time = np.linspace(0, 2, 161)
    expected, motion = spline(along(time / 2)), path(time)
    assert_allclose(motion.position, expected[:, :3], atol=1e-8)
    apart = rotations(motion.orientation).inv() * Rotation.from_rotvec(expected[:, 3:]) * first
    assert apart.magnitude().max() < 1e-8
    near = np.linspace(0.011, 1.989, 60)
    for part, differences in zip(path(near)[2:], by_differences(path, near), strict=True):
        assert_allclose(part, differences, atol=2e-5)


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.0099, 0.0101, 0.4])
def test_two_poses_are_joined_by_a_straight_line_and_one_axis(angle: float) -> None:
    """Expected: both in proportion to s; small turns and large ones alike, with their rates."""
    axis = np.array([2.0, -3.0, 6.0]) / 7
    first = rotations(POSES[0][3:])
    end = (Rotation.from_rotvec(angle * axis) * first).as_euler("xyz")
    path = gs.ViaPath(poses=[POSES[0], [*POSES[1][:3], *end]], timing=1.5).about(UNEVEN)
    time = np.linspace(0, 1.5, 50)
    motion, s = path(time), along(time / 1.5)
    start, moved = np.array(POSES[0][:3]), np.subtract(POSES[1][:3], POSES[0][:3])
    assert_allclose(motion.position, start + np.outer(s, moved), atol=1e-10)
    turned = (rotations(motion.orientation) * first.inv()).as_rotvec()
    assert_allclose(turned, np.outer(s, angle * axis), atol=1e-10)
    rate = 30 * (time / 1.5) ** 2 * (1 - time / 1.5) ** 2 / 1.5
    assert_allclose(motion.angular_velocity, np.outer(rate, angle * axis), atol=1e-8)


def test_poses_close_together_do_not_turn_a_path_out_of_their_plane() -> None:
    """Expected: all points in the plane of the poses, to 1e-7 m; two poses are 1e-8 m apart, as near as is allowed."""
    normal = np.array([2.0, -3.0, 6.0]) / 7
    across = np.array([3.0, 2.0, 0.0]) / np.sqrt(13)
    along_it = np.cross(normal, across)
    plane = np.array([[0.0, 0.0], [0.1, 0.05], [0.1, 0.05 + 1e-8], [0.25, -0.05]])
    position = UNEVEN.home_position + plane @ np.stack([across, along_it])
    kinds: Any = ("cubic", "quintic")
    for interpolation in kinds:
        poses = np.hstack([position, np.zeros((4, 3))])
        path = gs.ViaPath(poses=poses, timing=1, interpolation=interpolation).about(UNEVEN)
        assert np.abs((path(np.linspace(0, 1, 401)).position - position[0]) @ normal).max() < 1e-7


def test_a_path_rests_in_its_first_pose_until_it_begins_and_in_its_last_afterwards() -> None:
    motion = gs.ViaPath(poses=POSES, timing="2 s", at=0.3, margin=0).about(UNEVEN)
    at = motion(np.array([0.0, 0.3, 2.3, 9.0]))
    assert_allclose(np.hstack(at[:2]), [POSES[0], POSES[0], POSES[2], POSES[2]], atol=1e-12)
    for rate in at[2:]:
        assert_allclose(rate, 0, atol=1e-9)
    assert motion.end == pytest.approx(2.3)


def test_poses_are_displacements_from_home_where_they_are_said_to_be() -> None:
    poses: Any = [[0] * 6, ["2 cm", "-10 mm", 0, "3 deg", "-2 deg", 0.1]]
    at = gs.ViaPath(poses=poses, relative_to="home", timing=1).about(UNEVEN)(np.array([0.0, 5.0]))
    assert_allclose(at.position, UNEVEN.home_position + np.array([[0, 0, 0], [0.02, -0.01, 0]]), atol=1e-12)
    turned = rotations([np.radians(3), np.radians(-2), 0.1]) * rotations(UNEVEN.home_orientation)
    assert_allclose(rotations(at.orientation[1]).as_matrix(), turned.as_matrix(), atol=1e-12)
    assert_allclose(at.orientation[0], UNEVEN.home_orientation, atol=1e-12)


def test_poses_may_be_lists_arrays_quantities_or_in_a_file(tmp_path: Path) -> None:
    """Expected: the same path of all, the file's with units and without times."""
    expected = gs.ViaPath(poses=POSES, timing=2).about(UNEVEN)(np.linspace(0, 2, 7))
    units = [(f"{axis} [mm]", 1e3) for axis in "xyz"]
    units += [(f"{name} [deg]", 180 / np.pi) for name in ("roll", "pitch", "yaw")]
    write_table(tmp_path / "poses.csv", {name: np.array(POSES)[:, k] * size for k, (name, size) in enumerate(units)})
    first: Any = ["100 mm", "-10 cm", 2.9, "50 mrad", -0.02, 0.1]
    rows = list(map(np.array, POSES)), list(map(tuple, POSES))
    given: list[Any] = [np.array(POSES), *rows, [first, *POSES[1:]]]
    paths = [gs.ViaPath(poses=poses, timing=2) for poses in given] + [gs.ViaPath(file="poses.csv", timing=2)]
    for path in paths:
        for one, other in zip(path.about(UNEVEN, tmp_path)(np.linspace(0, 2, 7)), expected, strict=True):
            assert_allclose(one, other, atol=1e-8)


def test_a_path_takes_longer_and_is_smaller_where_its_scales_say_so() -> None:
    """Expected: the first pose and a times the deviations from it, s times later, from time 0 on; as pieces, too."""
    path = gs.ViaPath(poses=POSES, timing=1.2, at=0.3)
    scaled = path.model_copy(update={"time_scale": 1.7, "amplitude_scale": 0.6}).about(UNEVEN)
    time, first = np.linspace(0.0, 1.49, 33), np.array(POSES[0])
    pose, found = pose_along(path.about(UNEVEN), time), pose_along(scaled, 1.7 * time)
    assert_allclose(found.q, first + 0.6 * (pose.q - first), atol=1e-8)
    assert_allclose(found.rate, 0.6 / 1.7 * pose.rate, atol=1e-6)
    assert_allclose(found.acceleration, 0.6 / 1.7**2 * pose.acceleration, atol=1e-3)
    assert_allclose(np.hstack(scaled(1.7 * time)[:2]), found.q, atol=1e-13)


def test_a_path_that_is_too_fast_fits_about_its_first_pose() -> None:
    """Expected: smaller about the pose in which it begins, all of the limit used and not more."""
    slow = UNEVEN.with_parameters({"leg_velocity_max": 0.3})
    table = {"type": "path", "poses": POSES, "timing": 0.9}
    fitted = gs.check(experiment(slow, table)).fitted("amplitude")
    assert 1 - 1e-6 <= fitted.shares.peak("leg_velocity_max").share <= 1
    assert fitted.experiment.reference is not None
    motion: Any = fitted.experiment.reference.about(slow)
    assert_allclose(np.hstack(motion(np.zeros(1))[:2])[0], POSES[0], atol=1e-12)


NEAR = [*POSES[:2], [*POSES[1][:5], POSES[1][5] + 1e-9]]
TURNED = [POSES[0], [*POSES[1][:5], 1.1], [*POSES[2][:5], 3.3]]
FAR, TILTED = [*HOME[:2], 4.3, *HOME[3:]], [*HOME[:5], 1.4]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"timing": 1}, "expected poses, or a file of them"),
        ({"timing": 1, "poses": POSES, "file": "poses.csv"}, "expected poses, or a file of them"),
        ({"timing": 1, "poses": [[0] * 5]}, r"pose 1 is \[0, 0, 0, 0, 0\]; expected x, y, z, roll, pitch, yaw"),
        ({"timing": 1, "poses": [POSES[0], ["2 kg", 0, 0, 0, 0, 0]]}, "pose 2: value 1 of 3.*found the unit 'kg'"),
        ({"timing": 1, "poses": 7}, "expected a list of poses"),
        ({"timing": "slowest", "poses": POSES}, "or 'fastest'"),
        ({"timing": "0 s", "poses": POSES}, "expected > 0 s, or 'fastest'"),
        ({"timing": 1, "poses": POSES, "margin": 0.1}, "margin and ramp need timing = 'fastest'"),
        ({"timing": 1, "poses": POSES, "ramp": 0.1}, "margin and ramp need timing = 'fastest'"),
        ({"timing": "fastest", "poses": POSES, "margin": "100 %"}, "from '0 %' to below '100 %'"),
        ({"timing": "fastest", "poses": POSES, "margin": "ten"}, "a string such as '10 %'"),
        ({"timing": 1, "poses": POSES[:1]}, "a path of 1 poses; expected at least 2"),
        ({"timing": 1, "poses": [*POSES[:2], POSES[1]]}, "poses 2 and 3 of the path are the same"),
        ({"timing": 1, "poses": NEAR}, r"poses 2 and 3 of the path are the same, or 1e-09 m apart; remove one"),
        ({"timing": 1, "poses": TURNED}, "pose 3 of the path is rotated by half a turn"),
        ({"timing": 1, "poses": [HOME, FAR, TILTED]},
         r"pose 2 of the path cannot be reached: the length of leg \d is 4"),
        ({"timing": 1, "poses": [HOME, TILTED, FAR]}, "pose 2 of the path cannot be reached: the (angle|cond|length)"),
    ],
)  # fmt: skip
def test_what_makes_no_path_is_refused_with_its_reason(values: dict[str, Any], message: str) -> None:
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.ViaPath(**values).about(UNEVEN)

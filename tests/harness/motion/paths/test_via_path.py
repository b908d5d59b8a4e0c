"""Paths in experiments: keys, units, poses from files, what is refused, and how they leave as polynomials."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from numpy.testing import assert_allclose

from gough_stewart import (
    Acceleration,
    GoughStewartError,
    State,
    ViaPath,
    inverse_dynamics,
    load_experiment,
    load_preset,
    run,
)
from gough_stewart.harness.errors import MotionError
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.motion.motion import coordinates_of
from gough_stewart.harness.motion.paths.fastest import fastest
from gough_stewart.harness.motion.paths.path import GeometricPath
from gough_stewart.harness.motion.paths.polynomials import polynomials_of
from gough_stewart.harness.motion.paths.time_law import Quintic, TimedPath, TimeLaw
from gough_stewart.model.rotations import matrix_from_orientation
from tests.support.experiments import experiment_from
from tests.support.uneven import UNEVEN

POSES: Any = [[0.1, -0.1, 2.9, 0.05, -0.02, 0.1], [0.15, 0.1, 2.95, -0.05, 0.1, -0.1], [-0.1, 0.0, 2.8, 0.1, 0.0, 0.2]]


def test_a_path_rests_in_its_first_pose_until_it_begins_and_in_its_last_afterwards() -> None:
    motion = ViaPath(poses=POSES, timing="2 s", at=0.3).about(UNEVEN)
    at = motion(np.array([0.0, 0.3, 2.3, 9.0]))
    assert_allclose(np.hstack([at.position, at.orientation])[[0, 1]], [POSES[0], POSES[0]], atol=1e-12)
    assert_allclose(np.hstack([at.position, at.orientation])[[2, 3]], [POSES[2], POSES[2]], atol=1e-12)
    for rate in at[2:]:
        assert_allclose(rate, 0, atol=1e-9)
    assert motion.end == pytest.approx(2.3)


def test_poses_are_displacements_from_home_where_they_are_said_to_be() -> None:
    motion = ViaPath(poses=[[0] * 6, ["2 cm", "-10 mm", 0, "3 deg", "-2 deg", 0.1]], relative_to="home", timing=1)
    at = motion.about(UNEVEN)(np.array([0.0, 5.0]))
    assert_allclose(at.position, UNEVEN.home_position + np.array([[0, 0, 0], [0.02, -0.01, 0]]), atol=1e-12)
    turned = matrix_from_orientation(np.array([np.radians(3), np.radians(-2), 0.1]))
    home = matrix_from_orientation(UNEVEN.home_orientation)
    assert_allclose(matrix_from_orientation(at.orientation), [home, turned @ home], atol=1e-12)


def test_poses_come_from_a_file_with_units_and_without_times(tmp_path: Path) -> None:
    scale = {"x [mm]": 1e3, "y [mm]": 1e3, "z [mm]": 1e3} | dict.fromkeys(
        ("roll [deg]", "pitch [deg]", "yaw [deg]"), 180 / np.pi
    )
    columns = {name: np.array(POSES)[:, k] * factor for k, (name, factor) in enumerate(scale.items())}
    polars.DataFrame(columns).write_csv(tmp_path / "poses.csv")
    motions = [
        ViaPath(file="poses.csv", timing=2).about(UNEVEN, tmp_path),
        ViaPath(poses=POSES, timing=2).about(UNEVEN),
    ]
    time = np.linspace(0, 2, 7)
    for one, other in zip(*(motion(time) for motion in motions), strict=True):
        assert_allclose(one, other, atol=1e-8)


@pytest.mark.parametrize("law", ["quintic", "fastest", "averaged"])
def test_polynomials_are_the_motion_along_the_path(law: str) -> None:
    """Expected: pose, rates and accelerations of the path itself at 5,000 times, jumps and short pieces among them."""
    poses = np.array(POSES)
    path = GeometricPath(poses[:, :3], poses[:, 3:], 0.7)
    laws: dict[str, Callable[[], TimeLaw]] = {
        "quintic": lambda: Quintic(1.7),
        "fastest": lambda: fastest(UNEVEN, path),
        "averaged": lambda: fastest(UNEVEN, path, ramp=0.031),
    }
    motion = TimedPath(path, laws[law](), 0.2, 0.8)
    polynomials = polynomials_of(motion)
    time = np.linspace(0.0, motion.end + 0.1, 5001)
    for one, other, tolerance in zip(
        polynomials(time), motion(time), (1e-9, 1e-9, 1e-7, 1e-7, 1e-4, 1e-4), strict=True
    ):
        assert_allclose(one, other, atol=tolerance * max(1, np.abs(other).max()))


def test_polynomials_are_what_is_exported() -> None:
    polynomials = ViaPath(poses=POSES, timing=1.3, at=0.2).about(UNEVEN)
    begins, pieces = polynomials.pieces
    time = np.linspace(0.0, polynomials.end, 301)[:-1]
    at = np.searchsorted(begins, time, side="right") - 1
    powers = (time - begins[at])[:, None] ** np.arange(5, -1, -1)
    wanted = coordinates_of(polynomials(time))
    assert_allclose(np.einsum("nkp,np->nk", pieces[at], powers), wanted[0], atol=1e-13)


def test_a_fastest_path_is_followed_without_reaching_a_limit() -> None:
    """Expected: forces of inverse dynamics keep the margin of 10 %; the rest is the controller's."""
    record = run("fastest_path", {"loop.duration": 2.6, "loop.sample_time": "2 ms"})
    platform = load_preset("motion_base")
    assert record.metadata["outcome"]["status"] == "completed"
    assert not record["flag.force_limited"].any()
    used = np.abs(record["actuator_force"]).max() / platform.actuator_force_max
    assert 0.85 < used < 0.95
    assert np.abs(record["error.position"]).max() < 1e-5


def test_a_fastest_path_is_planned_for_the_forces_that_the_actuators_have() -> None:
    """Expected: the experiment's own limit less the margin, not the platform's, by inverse dynamics of the motion."""
    prepared = prepare(load_experiment("fastest_path", {"actuators.force_limit": "9 kN"}))
    motion = prepared.motion
    assert motion is not None
    forces = inverse_dynamics(prepared.platform, State(*motion[:4]), Acceleration(*motion[4:]))
    assert np.abs(forces).max() == pytest.approx(8100, rel=0.02)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"timing": 1}, "expected poses, or a file of them"),
        ({"timing": 1, "poses": POSES, "file": "poses.csv"}, "expected poses, or a file of them"),
        ({"timing": 1, "poses": [[0] * 5]}, r"pose 1 is \[0, 0, 0, 0, 0\]; expected x, y, z, roll, pitch, yaw"),
        ({"timing": 1, "poses": [POSES[0], ["2 kg", 0, 0, 0, 0, 0]]}, "pose 2: value 1 of 3.*found the unit 'kg'"),
        ({"timing": 1, "poses": 7}, "expected a list of poses"),
        ({"timing": "slowest", "poses": POSES}, "or 'fastest'"),
        ({"timing": "0 s", "poses": POSES}, "expected > 0 s, or 'fastest'"),
        ({"timing": 1, "poses": POSES, "margin": 0.1}, "margin and ramp need timing = 'fastest'"),
        ({"timing": "fastest", "poses": POSES, "margin": "100 %"}, "from '0 %' to below '100 %'"),
        ({"timing": "fastest", "poses": POSES, "margin": "ten"}, "a string such as '10 %'"),
    ],
)
def test_what_makes_no_path_is_refused_with_its_reason(values: dict[str, Any], complaint: str) -> None:
    with pytest.raises(GoughStewartError, match=complaint):
        ViaPath(**values)


def test_a_pose_out_of_reach_is_named_with_leg_and_length() -> None:
    far = [*POSES[:2], [0.1, 0.0, 4.4, 0, 0, 0]]
    with pytest.raises(
        MotionError, match=r"pose 3 of the path cannot be reached: the length of leg \d is 4\.\d+ m; exp"
    ):
        ViaPath(poses=far, timing="fastest").about(UNEVEN)


def test_an_experiment_says_where_its_path_is_wrong() -> None:
    values = {
        "title": "path",
        "reference": {"type": "path", "poses": [[0, 0]], "timing": 1},
        "controller": {"type": "pd", "bandwidth": 2},
        "loop": {"duration": 1},
    }
    with pytest.raises(GoughStewartError, match=r"reference\.poses.*pose 1 is \[0, 0\]"):
        experiment_from(values)


def test_a_path_takes_longer_and_is_smaller_where_its_scales_say_so() -> None:
    """Expected: the first pose and a times the deviations from it, s times later, from time 0 on."""
    path = ViaPath(poses=POSES, timing=1.2, at=0.3)
    scaled = path.model_copy(update={"time_scale": 1.7, "amplitude_scale": 0.6}).about(UNEVEN)
    time = np.linspace(0.0, 1.6, 33)
    pose, rate, acceleration = coordinates_of(path.about(UNEVEN)(time))
    found = coordinates_of(scaled(1.7 * time))
    first = np.array(POSES[0])
    assert_allclose(found[0], first + 0.6 * (pose - first), atol=1e-8)
    assert_allclose(found[1], 0.6 / 1.7 * rate, atol=1e-6)
    assert_allclose(found[2], 0.6 / 1.7**2 * acceleration, atol=1e-3)

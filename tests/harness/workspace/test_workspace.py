"""The command `workspace` as a user meets it: files, tables, pictures, a page, and clear errors."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.spatial.transform import Rotation
from typer.testing import Result

from gough_stewart import evaluate_poses, leg_geometry, load_preset, sweep
from gough_stewart.harness.errors import ReachError
from gough_stewart.harness.motion.limits.reach import check_reach
from gough_stewart.harness.motion.motion import Motion
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.workspace.isosurface import Isosurface, clearance, isosurface, surface_of
from gough_stewart.harness.workspace.workspace_report import workspace_report
from tests.support.commands import invoke
from tests.support.random_platforms import random_platform

MOTION_BASE, DESKTOP, PAPER = (load_preset(name) for name in ("motion_base", "desktop_hexapod", "liu2000"))
FILES = {"workspace.csv", "report.json"}


def run(*arguments: str) -> Result:
    return invoke("workspace", *arguments, columns=120)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_what_can_be_reached_is_what_reach_lets_pass(seed: int) -> None:
    """Expected: the verdict of `check_reach` on a motion of that pose alone, any condition number allowed."""
    rng = np.random.default_rng(seed)
    platform = random_platform(rng)
    length = leg_geometry(platform, platform.home_position, platform.home_orientation).length
    some = {
        "leg_length_min": 0.8 * length.min(),
        "leg_length_max": 1.2 * length.max(),
        "joint_angle_max": 0.4,
    }
    platform = replace(platform, **{name: value for name, value in some.items() if rng.random() < 0.8})
    position = platform.home_position + 0.3 * platform.characteristic_length * rng.normal(size=(12, 3))
    orientation = platform.home_orientation + 0.3 * rng.normal(size=(12, 3))
    reachable = evaluate_poses(platform, position, orientation).reachable
    none = np.zeros((1, 3))
    for k in range(12):
        try:
            check_reach(
                platform, np.zeros(1), Motion(position[[k]], orientation[[k]], none, none, none, none), float("inf")
            )
        except ReachError:
            assert not reachable[k]
        else:
            assert reachable[k]


def test_a_name_cannot_break_out_of_the_page() -> None:
    workspace = sweep(replace(DESKTOP, name="</script><b>$x", source="<i>"), points=3)
    page = page_of(workspace_report(workspace)).decode()
    assert "&lt;/script&gt;&lt;b&gt;$x" in page
    assert "<i>" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def test_clearance_is_positive_exactly_where_poses_can_be_reached() -> None:
    for over in (("x", "z"), ("roll", "yaw"), ("pitch", "z")):
        workspace = sweep(
            MOTION_BASE, {name: (-1.5, 1.5) if name in ("pitch", "yaw") else None for name in over}, points=41
        )
        field = clearance(MOTION_BASE, workspace.qualities, workspace.coordinates()[..., 4])
        assert np.array_equal(field > 0, workspace.qualities.reachable)


def enclosed(surface: Isosurface) -> float:
    """By Gauss's theorem; negative if normals point inward."""
    a, b, c = (surface.vertices[surface.triangles[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("n", [25, 45])
def test_the_surface_of_a_ball_is_closed_and_encloses_its_volume(n: int) -> None:
    """Expected: 4/3 π r³ less what chords cut off, in second order of the step; every edge in two triangles."""
    axes = [np.linspace(-1, 1, n), np.linspace(-1.2, 1.2, n), np.linspace(-1, 1.1, n)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    surface = isosurface(axes, 0.9 - np.sqrt(x**2 + y**2 + z**2), x)
    assert enclosed(surface) == pytest.approx(4 / 3 * np.pi * 0.9**3, rel=8 / n**2)
    edges = np.sort(np.concatenate([surface.triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert np.allclose(surface.colour, surface.vertices[:, 0], atol=1e-12)


@pytest.mark.parametrize("normal", [(0.5, -0.8, 0.4), (-0.3, 0.2, 0.9), (0.7, 0.7, -0.1)])
def test_a_box_that_a_plane_cuts_is_exact(normal: tuple[float, float, float]) -> None:
    """Expected: SciPy's intersection of half spaces; corners in the plane or on faces; normals all outward.

    Coordinates have uneven steps and ranges; colours are interpolated, exactly for a linear function.
    """
    axes = [np.array([-1.0, -0.6, 0.1, 0.9]), np.array([2.0, 2.3, 3.1, 3.3, 3.9]), np.array([-7.0, -5.5, -5.0])]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    middle = np.array([0.03, 2.9, -5.8])
    field = normal[0] * (x - middle[0]) + normal[1] * (y - middle[1]) + normal[2] * (z - middle[2])
    surface = isosurface(axes, field, 3 * x - y + 2 * z)
    low, high = np.array([(axis[0], axis[-1]) for axis in axes]).T
    faces = [*np.column_stack([-np.eye(3), low]), *np.column_stack([np.eye(3), -high])]
    faces.append(np.append(-np.array(normal), np.dot(normal, middle)))
    inside = middle + 0.05 * np.array(normal)
    hull = ConvexHull(HalfspaceIntersection(np.array(faces), inside).intersections)
    assert enclosed(surface) == pytest.approx(hull.volume, rel=1e-9)
    v = surface.vertices
    on_plane = abs((v - middle) @ normal) < 1e-9
    assert (on_plane | (abs(v - low) < 1e-12).any(axis=1) | (abs(v - high) < 1e-12).any(axis=1)).all()
    assert ((v - middle) @ normal > -1e-9).all()
    assert on_plane.sum() > 5
    a, b, c = (v[surface.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a) / 2
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(hull.area, rel=1e-9)
    # seen from inside, each triangle turns the other way
    assert ((area * (a - inside)).sum(axis=1) > -1e-12).all()
    assert surface.colour[on_plane] == pytest.approx((v @ [3, -1, 2])[on_plane])


def test_a_volume_that_goes_on_beyond_the_grid_is_cut_at_its_end() -> None:
    """Expected: 2 · 4 · 3 of the whole box, 0.7 · 4 · 3 of the part with x > 0.3."""
    axes = [np.linspace(-1, 1, 11), np.linspace(-2, 2, 13), np.linspace(-1.5, 1.5, 9)]
    x = np.meshgrid(*axes, indexing="ij")[0]
    assert enclosed(isosurface(axes, 1 + 0 * x, x)) == pytest.approx(24)
    assert enclosed(isosurface(axes, x - 0.3, x)) == pytest.approx(8.4)


def test_an_angle_may_have_the_sign_of_degrees(tmp_path: Path) -> None:
    """Expected: the same poses as with "deg"."""
    tables = []
    for unit in ("deg", "°"):
        few = ("--over", "x,z", "--points", "5", "--at", f"yaw=5{unit}", "--out", str(tmp_path / unit))
        assert run("--preset", "motion_base", *few).exit_code == 0
        tables.append((tmp_path / unit / "workspace.csv").read_text())
    assert tables[0] == tables[1]


def test_nothing_reached_is_a_warning(tmp_path: Path) -> None:
    done = run("--preset", "motion_base", "--at", "z=5", "--points", "5", "--out", str(tmp_path))
    assert done.exit_code == 0
    assert "No pose of this grid can be reached" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == FILES


ERRORS = [
    (["--over", "x,q"], "--over x,q: unknown coordinate 'q'; expected one of x, y, z, roll, pitch, yaw"),
    (["--over", "x"], "1 swept coordinates; expected two for maps, or three for a volume"),
    (["--over", "x,x"], "x appears twice; expected each coordinate once"),
    (["--over", "x=1,y"], "found the range '1' for x; expected LOW:HIGH"),
    (["--over", "x=1:-1,y"], "x goes from 1 m to -1 m; expected a range from low to high"),
    (["--over", "x=-1deg:1,y"], "x is '-1deg'; expected a number of m, or a string with one of the units m, cm"),
    (["--over", "x=:1,y"], "x is ''; expected a number of m"),
    (["--over", "z,y", "--at", "z=2"], "z is both swept and fixed; expected one of them"),
    (["--at", "z"], "--at z: found no value; expected NAME=VALUE"),
    (["--at", "height=2"], "--at height=2: unknown coordinate 'height'"),
    (["--at", "z=2", "--at", "z=3"], "z is fixed twice; expected one value"),
    (
        ["--at", "yaw=high"],
        "yaw is 'high'; expected a number of rad, or a string with one of the units rad, mrad, urad",
    ),
    (["--over", "x,y", "--at", "pitch=100deg"], "pitch is 1.74533 rad, 100°; expected from −90° to 90°"),
    (["--at", "z=1e400"], "expected a number of at most 1e+12"),
    (["--points", "501"], "501 points per coordinate, in all 251,001 poses, for 2 swept coordinates"),
    (["--points", "0"], "0 points per coordinate for 2 swept coordinates; expected from 2 to 500"),
]


@pytest.mark.parametrize(("arguments", "text"), ERRORS, ids=[" ".join(arguments) for arguments, _ in ERRORS])
def test_what_cannot_be_is_one_clear_line_and_no_file(arguments: list[str], text: str, tmp_path: Path) -> None:
    done = run(*arguments, "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert text in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_refined_surface_lies_where_a_leg_reaches_its_limit() -> None:
    """Expected: inside the box, |p + R b − B| of some leg is its limit: to 20 µm, at edges to a fine cell of 2 mm."""
    platform = replace(DESKTOP, joint_angle_max=None)
    over = {"x": (-0.06, 0.06), "z": (0.1, 0.2), "pitch": (-0.3, 0.3)}
    workspace = sweep(platform, over, {"y": 0.004, "roll": 0.02, "yaw": -0.05}, points=7)
    surface = surface_of(workspace)
    assert surface is not None
    low, high = np.array(list(over.values())).T
    inside = surface.vertices[((surface.vertices > low + 1e-9) & (surface.vertices < high - 1e-9)).all(axis=1)]
    assert len(inside) > 1000
    angles = np.column_stack([np.full(len(inside), 0.02), inside[:, 2], np.full(len(inside), -0.05)])
    turned = Rotation.from_euler("xyz", angles)
    position = np.column_stack([inside[:, 0], np.full(len(inside), 0.004), inside[:, 1]])
    arms = np.einsum("nij,kj->nki", turned.as_matrix(), platform.platform_points)
    length = np.linalg.norm(position[:, None] + arms - platform.base_points, axis=2)
    assert platform.leg_length_min is not None
    assert platform.leg_length_max is not None
    margin = np.minimum(length - platform.leg_length_min, platform.leg_length_max - length).min(axis=1)
    assert np.quantile(np.abs(margin), 0.9) < 2e-5
    assert np.abs(margin).max() < 2e-3

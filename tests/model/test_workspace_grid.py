"""Grids of poses: their ranges, order and limits, against what can be reached."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart import GoughStewartError, Platform, evaluate_poses, load_preset, sweep
from tests.support.lagrangian import FloatArray
from tests.support.uneven import UNEVEN

MOTION_BASE, DESKTOP, PAPER = (load_preset(name) for name in ("motion_base", "desktop_hexapod", "liu2000"))

ANGLES = ("roll", "pitch", "yaw")
COORDINATES = ("x", "y", "z", *ANGLES)


def reached(platform: Platform, poses: FloatArray) -> FloatArray:
    """Those of (n, 6) that can be reached."""
    return poses[evaluate_poses(platform, poses[:, :3], poses[:, 3:]).reachable]


@pytest.mark.parametrize(
    ("home", "ends"), [(0.1, (-1.470796, np.pi / 2)), (1.2, (-0.370796, np.pi / 2)), (-1.2, (-np.pi / 2, 0.370796))]
)
def test_a_pitch_without_limits_goes_90_degrees_about_home_but_not_beyond_90(
    home: float, ends: tuple[float, float]
) -> None:
    """Expected: home ± π/2 = 1.570796, cut at ± π/2."""
    tilted = replace(PAPER, home_orientation=np.array([0.0, home, 0.0]))
    w = sweep(tilted, {"pitch": None, "x": (-0.1, 0.1)}, points=2)
    assert w.swept["pitch"] == pytest.approx(ends, abs=1e-6)


def test_a_map_has_101_points_per_coordinate_unless_told_otherwise() -> None:
    """Expected: as documented."""
    assert sweep(PAPER, {"x": (-0.1, 0.1), "yaw": (0.0, 0.1)}).shape == (101, 101)
    assert sweep(PAPER, {"x": (-0.1, 0.1), "y": (-0.1, 0.1), "yaw": (0.0, 0.1)}).shape == (31, 31, 31)


def test_a_sweep_over_an_uneven_platform_says_what_it_did() -> None:
    """Expected: the grid's poses by hand, what was found and assumed, defaults of what is fixed; progress."""
    done: list[int] = []
    w = sweep(UNEVEN, {"roll": (-0.1, 0.3), "y": (0.2, 0.4)}, {"z": 3}, points=3, progress=done.append)
    assert done == [9]
    assert list(w.swept) == ["roll", "y"]
    assert w.swept["roll"] == pytest.approx([-0.1, 0.1, 0.3])
    assert w.swept["y"] == pytest.approx([0.2, 0.3, 0.4])
    assert w.fixed == {"x": 0.08, "z": 3.0, "pitch": -0.07, "yaw": 0.11}
    assert (w.found, w.assumed) == ((), ())
    assert w.coordinates()[2, 0] == pytest.approx([0.08, 0.2, 3.0, 0.3, -0.07, 0.11])
    assert w.coordinates()[0, 2] == pytest.approx([0.08, 0.4, 3.0, -0.1, -0.07, 0.11])
    for (i, j), number in np.ndenumerate(w.qualities.condition_number):
        pose = w.coordinates()[i, j]
        assert number == pytest.approx(float(evaluate_poses(UNEVEN, pose[:3], pose[3:]).condition_number), rel=1e-12)
    half = replace(UNEVEN, leg_length_max=None)
    w = sweep(half, {"x": None, "yaw": None, "pitch": (-0.1, 0.1)}, points=2)
    assert (w.found, w.assumed, w.shape) == (("yaw",), ("x",), (2, 2, 2))
    rho = UNEVEN.characteristic_length
    assert w.swept["x"] == pytest.approx([0.08 - rho, 0.08 + rho])
    assert tuple(sweep(UNEVEN, points=2).swept) == ("x", "y")
    free = sweep(replace(half, joint_angle_max=None), points=2)
    assert tuple(free.swept) == free.assumed == ("roll", "pitch")
    assert free.swept["roll"] == pytest.approx([0.04 - np.pi / 2, 0.04 + np.pi / 2])
    assert free.swept["pitch"] == pytest.approx([-np.pi / 2, -0.07 + np.pi / 2])


# Platform, coordinates whose ranges are looked for, given ranges, fixed values.
RANGES: list[tuple[Platform, tuple[str, ...], dict[str, Any], dict[str, float]]] = [
    (UNEVEN, ("z", "pitch"), {}, {"x": 0.4, "yaw": -0.2}),
    (UNEVEN, ("y", "roll"), {"z": (2.7, 3.2)}, {}),
    (replace(UNEVEN, joint_angle_max=0.05), ("x", "roll"), {}, {}),
    (replace(UNEVEN, joint_angle_max=None, leg_length_min=None), ("x", "yaw"), {}, {"z": 3.4}),
    (replace(DESKTOP, joint_angle_max=0.02), ("z", "x", "pitch"), {}, {}),
    # regions on either side of home, which cannot be reached
    (replace(UNEVEN, joint_angle_max=0.25), ("x", "roll"), {}, {"pitch": 0.23, "z": 2.85}),
]


@pytest.mark.parametrize(("platform", "looked_for", "given", "fixed"), RANGES)
def test_a_range_is_that_of_what_can_be_reached_rounded_outward(
    platform: Platform, looked_for: tuple[str, ...], given: dict[str, Any], fixed: dict[str, float]
) -> None:
    """Expected: what a random search reaches, and little more; ends are multiples of 1, 2 or 5 times 10ⁿ, or box's."""
    over = {**dict.fromkeys(looked_for), **given}
    w = sweep(platform, over, fixed, points=2)
    home = dict(zip(COORDINATES, [*platform.home_position, *platform.home_orientation], strict=True)) | fixed
    assert w.found == looked_for
    rng, axes = np.random.default_rng(5), [COORDINATES.index(name) for name in over]
    low, high = (np.array([w.swept[name][k] for name in over]) for k in (0, -1))
    is_given = np.array([name in given for name in over])
    assert [(a, b) for a, b, known in zip(low, high, is_given, strict=True) if known] == list(given.values())
    wide = np.array([1.6 * low - 0.6 * high, 1.6 * high - 0.6 * low])
    wide[:, is_given] = np.array([low, high])[:, is_given]
    poses = np.repeat([list(home.values())], 1500, axis=0)
    poses[:, axes] = rng.uniform(wide[0], wide[1], (1500, len(axes)))
    poses = reached(platform, np.concatenate([poses, [list(home.values())]]))
    for size in (0.5, 0.3, 0.2, 0.1, 0.1, 0.05, 0.05, 0.03, 0.02, 0.02, 0.01, 0.01):
        # the outermost so far, and some others, are moved on
        outer = [f(poses[:, axis]) for axis in axes for f in (np.argmin, np.argmax)]
        some = poses[np.concatenate([np.tile(outer, 40), rng.integers(0, len(poses), 600)])]
        some[:, axes] += size * (wide[1] - wide[0]) * rng.normal(size=(len(some), len(axes)))
        some[:, axes] = np.clip(some[:, axes], *wide)
        poses = np.concatenate([poses, reached(platform, some)])
    for name, a, b in zip(over, low, high, strict=True):
        if name in given:
            continue
        values, middle = poses[:, COORDINATES.index(name)], home[name]
        first, last = float(values.min()), float(values.max())
        assert a <= first <= last <= b, name
        below, above = middle - first, last - middle
        ratio, allowed = min(below, above) / max(below, above), 0.16 * (last - first)
        if ratio >= 0.85 and (a, b) != pytest.approx((-np.pi, np.pi)):
            assert middle - a == pytest.approx(b - middle, abs=0.4 * allowed), name
        if not 0.65 < ratio < 0.85:  # with its margins it is perhaps nearly symmetric
            first, last = (middle - max(below, above), middle + max(below, above)) if ratio >= 0.85 else (first, last)
            assert first - a < allowed, (name, first, a)
            assert b - last < allowed, (name, last, b)
        unit = np.pi / 180 if name in ANGLES else 1.0
        steps = [k * 10.0**e * unit for e in range(-7, 3) for k in (1, 2, 5)]
        fine = [step for step in steps if step <= (b - a) / 24.9][-3:]
        box = _box(platform, name, looked_for, fixed)
        ends = [end for end, of_box in zip((a, b), box, strict=True) if end != pytest.approx(of_box, abs=1e-9)]
        assert any(all(end / step == pytest.approx(round(end / step), abs=1e-6) for end in ends) for step in fine), name


def _box(platform: Platform, name: str, looked_for: tuple[str, ...], fixed: dict[str, float]) -> tuple[float, float]:
    """Where no leg is longer than allowed from its base joint, whatever the other coordinates; half turns."""
    if name in ANGLES:
        return (-np.pi / 2, np.pi / 2) if name == "pitch" else (-np.pi, np.pi)
    assert platform.leg_length_max is not None
    angles = [fixed.get(angle, home) for angle, home in zip(ANGLES, platform.home_orientation, strict=True)]
    arm = Rotation.from_euler("xyz", angles).apply(platform.platform_points.copy())
    reach = np.full(6, platform.leg_length_max)
    if {*ANGLES} & set(looked_for):
        arm, reach = np.zeros((6, 3)), reach + np.linalg.norm(platform.platform_points, axis=1)
    centre = (platform.base_points - arm)[:, "xyz".index(name)]
    return float((centre - reach).max()), float((centre + reach).min())


def test_errors_of_a_grid_are_whole_sentences() -> None:
    """Expected: name, value in its unit and in degrees, range; bounds of angles from both sides."""
    x_and = {"x": (0.0, 0.1)}
    for asked, text in (
        ({"over": {**x_and, "yaw": (-1.0, 3.2)}}, "yaw is 3.2 rad, 183.346°; expected from −180° to 180°; numbers w"),
        ({"over": {**x_and, "roll": (0.5, 0.5)}}, "roll goes from 0.5 rad to 0.5 rad; expected a range from low to hi"),
        ({"over": {**x_and, "pitch": (-1.6, 0.0)}}, "pitch is -1.6 rad, -91.6732°; expected from −90° to 90°; numbers"),
        ({"over": {**x_and, "y": (np.nan, 1.0)}}, "over['y'] is nan; expected a number of m"),
        ({"over": {**x_and, "z": (0.0, np.inf)}}, "over['z'] is inf; expected a number of m"),
        ({"over": {**x_and, "roll": (-np.inf, 0.0)}}, "over['roll'] is -inf; expected a number of rad"),
        ({"over": dict.fromkeys("xyz") | {"yaw": None}}, "4 swept coordinates; expected two for maps, or three"),
        ({"over": dict.fromkeys("xyz"), "points": 63}, "63 points per coordinate, in all 250,047 poses, for 3 swept"),
        ({"over": dict.fromkeys("xyz"), "points": 1}, "1 points per coordinate for 3 swept coordinates; expected"),
    ):
        with pytest.raises(GoughStewartError, match=f"^{re.escape(text)}"):
            sweep(UNEVEN, **asked)
    for name, largest in (("roll", np.pi), ("pitch", np.pi / 2), ("yaw", np.pi)):
        for sign in (1, -1):
            sweep(UNEVEN, {"x": (0.0, 0.1), "y": (0.0, 0.1)}, {name: sign * largest}, points=2)
            with pytest.raises(GoughStewartError, match=f"^{name} is "):
                sweep(UNEVEN, {"x": (0.0, 0.1), "y": (0.0, 0.1)}, {name: sign * (largest + 1e-9)}, points=2)


def test_a_frame_that_is_turned_at_home_is_swept_about_it() -> None:
    """Expected: a quarter turn to either side of a yaw of 2 rad, also a turn further."""
    Q, home = Rotation.from_euler("z", 2.0).as_matrix(), np.array([0.0, 0.0, 2.0])
    turned = replace(MOTION_BASE, platform_points=MOTION_BASE.platform_points @ Q, home_orientation=home)
    for yaw in (2.0, 2.0 - 2 * np.pi):
        w = sweep(turned, {"x": (-0.1, 0.1), "yaw": (yaw - np.pi / 2, yaw + np.pi / 2)}, points=3)
        assert w.home["yaw"] == pytest.approx(yaw)


def test_where_nothing_can_be_reached_given_ranges_stay_and_others_are_the_box() -> None:
    """Expected: of the box of the legs, by hand, the next multiples; about home by a radius where there is no box."""
    fixed = {"z": 5.0, "roll": 0.0, "pitch": 0.0, "yaw": 0.0}
    found = sweep(MOTION_BASE, {"x": None, "y": (0.123, 0.456)}, fixed, points=2).swept
    assert found["y"].tolist() == [0.123, 0.456]
    low, high = _box(MOTION_BASE, "x", ("x",), fixed)
    assert 0 <= low - found["x"][0] < (high - low) / 10
    assert 0 <= found["x"][1] - high < (high - low) / 10
    parts = ["platform_mass", "platform_inertia"]
    parts += [f"leg_{part}_{name}" for part in ("lower", "upper") for name in ("mass", "com", "inertia")]
    others = {name: getattr(PAPER, name) for name in parts}
    flat = Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=1.5, leg_length_max=1.6, **others)
    turned = sweep(flat, {"x": None, "y": None}, {"z": 0.8, "roll": 0.0, "pitch": 0.0, "yaw": np.pi}, points=2).swept
    assert [turned["x"].tolist(), turned["y"].tolist()] == [[-1.0, 1.0]] * 2

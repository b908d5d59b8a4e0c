"""Joints on two circles, against the published platforms and elementary geometry."""

import math
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

import gough_stewart as gs
from gough_stewart.model.errors import PlatformError, PlatformFileError
from gough_stewart.model.joint_circles import joints_on_circles
from gough_stewart.model.joint_order import segment_distances
from gough_stewart.model.platform_toml import platform_from_toml, platform_to_toml

_JOINTS = ("base_points", "platform_points", "home_position", "home_orientation")


def _others(platform: gs.Platform) -> dict[str, Any]:
    return {name: value for name, value in platform.as_dict().items() if name not in _JOINTS}


def test_the_desktop_hexapod_comes_out_of_its_source_s_radii_and_angles() -> None:
    """The preset's joints were entered from its source: circles of 150 and 100 mm, pairs of ± 15°, height 150 mm."""
    preset = gs.load_preset("desktop_hexapod")
    made = gs.Platform.from_radii(
        0.15, 0.10, math.radians(30), math.radians(30), home_leg_length=0.170350, **_others(preset)
    )
    # the preset lists the same joints from the same azimuth on, in the same direction; the source rounds to 1e-6 m
    np.testing.assert_allclose(made.base_points[0], preset.base_points[0], atol=1e-8)
    for leg in zip(made.base_points, made.platform_points, strict=True):
        distances = [
            np.abs(np.concatenate([leg[0] - base, leg[1] - platform])).max()
            for base, platform in zip(preset.base_points, preset.platform_points, strict=True)
        ]
        assert min(distances) < 1e-8
    assert made.home_position[2] == pytest.approx(0.15, abs=2e-6)


@pytest.mark.parametrize(("pairing", "turn"), [("near", 30), ("far", 60)])
def test_the_paper_s_legs_turn_by_30_degrees_or_by_60(pairing: Any, turn: float) -> None:
    """Base pairs ± 15° about 0°, platform pairs ± 15° about 60°: 15° and 45° are near, 15° and 75° far."""
    joints = joints_on_circles(2.0, 1.0, math.radians(30), math.radians(30), 3.2459, pairing)
    azimuths = [np.degrees(np.arctan2(joints[name][:, 1], joints[name][:, 0])) for name in _JOINTS[:2]]
    turns = (azimuths[1] - azimuths[0] + 180) % 360 - 180
    np.testing.assert_allclose(turns, [turn, -turn] * 3, atol=1e-9)
    np.testing.assert_allclose(azimuths[0] % 360, [15, 105, 135, 225, 255, 345], atol=1e-9)


@given(
    st.floats(0.05, 5),
    st.floats(0.05, 5),
    st.floats(1, 118),
    st.floats(1, 118),
    st.sampled_from(["near", "far"]),
    st.floats(1.02, 4),
)
def test_every_leg_has_the_home_length_and_every_pair_its_angle(
    R: float, r: float, a: float, b: float, pairing: Any, stretch: float
) -> None:
    """Lengths and angles measured in the joints; each is used once: six different base and platform joints."""
    L = stretch * (R + r)
    joints = joints_on_circles(R, r, math.radians(a), math.radians(b), L, pairing)
    base, platform = joints["base_points"], joints["platform_points"]
    np.testing.assert_allclose(np.linalg.norm(joints["home_position"] + platform - base, axis=-1), L, rtol=1e-12)
    for points, radius, angle in ((base, R, a), (platform, r, b)):
        np.testing.assert_allclose(np.linalg.norm(points, axis=-1), radius, rtol=1e-12)
        azimuth = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360)
        gaps = np.sort(np.diff([*azimuth, azimuth[0] + 360]))
        np.testing.assert_allclose(gaps, np.sort([angle] * 3 + [120 - angle] * 3), atol=1e-6)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("base_radius", -1.0, "above 0"),
        ("platform_angle", 30.0, "in radians"),
        ("base_angle", 0.0, "below 2.0944"),
        ("home_leg_length", 0.5, "more than the 1.239"),
        ("pairing", "cross", "'near' or 'far'"),
        ("platform_radius", "1 m", "expected"),
        ("base_points", np.zeros((6, 3)), "leave it out"),
    ],
)
def test_impossible_circles_are_refused_by_name(key: str, value: Any, says: str) -> None:
    """1.239 m is √(4 + 1 − 4 cos 30°)."""
    values: dict[str, Any] = {
        **_others(gs.load_preset("liu2000")),
        "base_radius": 2.0,
        "platform_radius": 1.0,
        "base_angle": math.radians(30),
        "platform_angle": math.radians(30),
        "home_leg_length": 3.2459,
        key: value,
    }
    with pytest.raises(PlatformError, match=says) as refused:
        gs.Platform.from_radii(**values)
    assert refused.value.field == key


def test_a_platform_file_may_state_circles_instead_of_joints() -> None:
    """The same platform as from Python; written out it has its joints."""
    preset = gs.load_preset("liu2000")
    circles = {
        "base_radius": 2.0,
        "platform_radius": 1.0,
        "base_angle": 0.5,
        "platform_angle": 0.4,
        "home_leg_length": 3.3,
    }
    document = tomlkit.parse(platform_to_toml(replace(preset, name="mine")))
    for name in _JOINTS:
        del document[name]
    rest = tomlkit.dumps(document)
    text = rest + "\npairing = 'far'\n" + "\n".join(f"{key} = {value}" for key, value in circles.items())
    made = platform_from_toml(text)
    expected = gs.Platform.from_radii(**circles, pairing="far", **_others(replace(preset, name="mine")))
    assert made == expected
    assert platform_from_toml(platform_to_toml(made)) == made
    with pytest.raises(PlatformFileError, match=r"base_radius: needs platform_radius"):
        platform_from_toml(rest + "\nbase_radius = 2.0")
    with pytest.raises(PlatformFileError, match=r"base_points: is also determined by base_radius"):
        platform_from_toml(text + "\nbase_points = [[0, 0, 0]]")


def test_an_experiment_may_state_circles_with_units() -> None:
    """Geometry in millimetres and degrees: the record's platform has legs of the stated length."""
    keys = {
        "platform.base_radius": "2100 mm",
        "platform.platform_radius": "0.9 m",
        "platform.base_angle": "24deg",
        "platform.platform_angle": "33deg",
        "platform.home_leg_length": "3.1 m",
        "platform.parameters.home_orientation": [0, 0, 0.1],
        "loop.duration": 0.01,
    }
    record = gs.run("paper_open_loop", keys)
    # parameters are changed last
    assert record.metadata["platform"]["home_orientation"] == [0, 0, 0.1]
    points = np.array(record.metadata["platform"]["base_points"])
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), 2.1, rtol=1e-12)
    np.testing.assert_allclose(points[0], 2.1 * np.array([math.cos(math.radians(12)), math.sin(math.radians(12)), 0]))
    home, tips = (np.array(record.metadata["platform"][name]) for name in ("home_position", "platform_points"))
    np.testing.assert_allclose(np.linalg.norm(home + tips - points, axis=-1), 3.1, rtol=1e-12)


def test_presets_have_no_hints() -> None:
    """Their joints are in the order of their sources."""
    for name in ("liu2000", "desktop_hexapod", "motion_base"):
        assert gs.load_preset(name).hints == ()


def test_nearly_all_exchanged_joints_that_assemble_are_hinted_at() -> None:
    """All orders of a preset's platform joints that assemble, its own aside: most cross, the others condition worse."""
    preset = gs.load_preset("motion_base")
    hinted = 0
    for order in list(permutations(range(6)))[1:]:
        try:
            exchanged = replace(preset, platform_points=preset.platform_points[list(order)])
        except PlatformError:
            continue
        hinted += bool(exchanged.hints)
    assert hinted >= 70


def test_the_hint_s_better_order_has_the_condition_number_that_it_states() -> None:
    """Against NumPy's condition number of the Jacobian of the named order, with angles scaled by the joints' radius."""
    preset = gs.load_preset("liu2000")
    for order in permutations(range(6)):
        try:
            exchanged = replace(preset, platform_points=preset.platform_points[list(order)])
        except PlatformError:
            continue
        hint = next((each for each in exchanged.hints if "in the order" in each), None)
        if hint is None:
            continue
        named = [int(k) - 1 for k in hint.split("in the order ")[1].split(";")[0].split(", ")]
        stated = [float(part.split()[0].rstrip(",")) for part in hint.split(" of ")[1:3]]
        for joints, number in ((exchanged.platform_points, stated[0]), (exchanged.platform_points[named], stated[1])):
            legs = exchanged.home_position + joints - exchanged.base_points
            u = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
            J = np.hstack([u, np.cross(joints, u) / np.sqrt((joints**2).sum(axis=1).mean())])
            assert float(np.linalg.cond(J)) == pytest.approx(number, rel=6e-3)
        mended = replace(exchanged, platform_points=exchanged.platform_points[named])
        assert mended.hints == ()
        return
    pytest.fail("no order of the joints of liu2000 has a hint at a better one")


@given(st.lists(st.floats(-1, 1), min_size=36, max_size=36))
def test_distances_of_legs_are_those_of_a_search(numbers: list[float]) -> None:
    """The least distance over a grid of both parameters, which is never smaller and close to it."""
    ends = np.array(numbers).reshape(2, 6, 3)
    base, tip = ends[0], ends[0] + ends[1] + np.array([0.0, 0.0, 2.5])
    found = segment_distances(base, tip)
    share = np.linspace(0, 1, 61)[:, None]
    points = base[:, None] + share * (tip - base)[:, None]
    k = 0
    for i in range(6):
        for j in range(i + 1, 6):
            searched = np.linalg.norm(points[i][:, None] - points[j][None], axis=-1).min()
            step = max(np.linalg.norm(tip[i] - base[i]), np.linalg.norm(tip[j] - base[j])) / 60
            assert found[k] <= searched + 1e-12
            assert found[k] >= searched - step
            k += 1

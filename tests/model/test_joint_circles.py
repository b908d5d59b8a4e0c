"""Joints on two circles, against the published platforms and elementary geometry."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tomlkit

import gough_stewart as gs
from gough_stewart import GoughStewartError
from gough_stewart.model.joint_circles import joints_of_keys, joints_on_circles
from gough_stewart.model.platform_toml import platform_from_toml, platform_to_toml

_JOINTS = ("base_points", "platform_points", "home_position", "home_orientation")


def _others(platform: gs.Platform) -> dict[str, Any]:
    return {name: value for name, value in platform.as_dict().items() if name not in _JOINTS}


def test_parameters_that_radii_and_angles_leave_open_are_asked_for_by_name() -> None:
    """Expected: all that have no default, in the order of the file; for an unknown name the nearest one."""
    others = _others(gs.load_preset("liu2000"))
    del others["platform_inertia"], others["leg_upper_com"]
    with pytest.raises(GoughStewartError) as caught:
        gs.Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=3.0, **others)
    assert str(caught.value) == (
        "platform_inertia: missing; expected platform_inertia, leg_upper_com beside the radii and angles"
    )
    with pytest.raises(GoughStewartError, match="platform_mas: no such parameter; did you mean 'platform_mass'"):
        gs.Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=3.0, platform_mas=10.0)


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
    with pytest.raises(GoughStewartError, match=r"base_radius: needs platform_radius"):
        platform_from_toml(rest + "\nbase_radius = 2.0")
    with pytest.raises(GoughStewartError, match=r"base_points: is also determined by base_radius"):
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


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("base_radius", 0.0, "is 0 m; expected a number above 0"),
        ("home_leg_length", -2, "is -2 m; expected a number above 0"),
        ("base_angle", 2.1, "is 2.1 rad; expected a number in radians, above 0 and below 2.0944 (120°)"),
        ("platform_angle", -0.1, "is -0.1 rad; expected a number in radians, above 0 and below 2.0944 (120°)"),
        ("platform_angle", [1.0], "has shape (1,); expected one number"),
        (
            "home_leg_length",
            1.2,
            "is 1.2 m; expected more than the 1.23931 m between a base joint and the platform joint above it, seen "
            "from above",
        ),
        ("platform_radius", "1 m", "is '1 m'; expected one number"),
        ("base_points", np.zeros((6, 3)), "is determined by the radii and angles; leave it out"),
        ("pairing", "cross", "is 'cross'; expected 'near' or 'far'"),
        ("home_position", np.zeros(3), "is determined by the radii and angles; leave it out"),
        ("home_orientation", np.zeros(3), "is determined by the radii and angles; leave it out"),
        ("platform_points", np.zeros(3), "is determined by the radii and angles; leave it out"),
    ],
)
def test_impossible_circles_are_told_in_whole_sentences(key: str, value: Any, text: str) -> None:
    """Expected: name, value with its unit, and what is possible; 1.23931 m is √(4 + 1 − 4 cos 30°)."""
    angle = math.radians(30)
    values = {"base_radius": 2.0, "platform_radius": 1.0, "base_angle": angle, "platform_angle": angle}
    with pytest.raises(GoughStewartError) as refused:
        gs.Platform.from_radii(
            **{**_others(gs.load_preset("liu2000")), **values, "home_leg_length": 3.2459, key: value}
        )
    assert str(refused.value) == f"{key}: {text}"


def test_angles_up_to_120_degrees_and_legs_that_just_reach() -> None:
    """Expected: the bounds from both sides; a leg of nearly no height stands nearly level."""
    third = 2 * np.pi / 3
    for names in ((third - 1e-9, 0.4), (0.4, third - 1e-9)):
        joints_on_circles(2.0, 1.0, *names, 3.3)
    for names in ((third, 0.4), (0.4, third)):
        with pytest.raises(GoughStewartError, match=r"below 2\.0944"):
            joints_on_circles(2.0, 1.0, *names, 3.3)
    across = float(np.sqrt(5 - 4 * np.cos(np.pi / 3 - 0.5)))
    joints = joints_on_circles(2.0, 1.0, 0.7, 0.3, across * (1 + 1e-9))
    assert joints["home_position"][2] == pytest.approx(across * np.sqrt(2e-9), rel=1e-3)
    with pytest.raises(GoughStewartError, match="expected more than"):
        joints_on_circles(2.0, 1.0, 0.7, 0.3, across * (1 - 1e-9))


def test_each_joint_of_circles_is_where_the_documentation_puts_it() -> None:
    """Expected: azimuths by hand, in degrees: base a = 20°, platform b = 50°; legs in order of their base joints."""
    near = joints_on_circles(2.0, 1.5, math.radians(20), math.radians(50), 3.0)
    far = joints_on_circles(2.0, 1.5, math.radians(20), math.radians(50), 3.0, "far")
    base = np.radians([10, 110, 130, 230, 250, 350])
    # platform pairs at 60° ± 25°, 180° ± 25°, 300° ± 25°
    expected = {"near": np.radians([35, 85, 155, 205, 275, 325]), "far": np.radians([85, 35, 205, 155, 325, 275])}
    for joints, pairing in ((near, "near"), (far, "far")):
        assert list(joints) == list(_JOINTS)
        for points, radius, azimuth in (
            (joints["base_points"], 2.0, base),
            (joints["platform_points"], 1.5, expected[pairing]),
        ):
            on_circle = radius * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
            np.testing.assert_allclose(points, on_circle, atol=1e-12)
        turn = math.radians(25 if pairing == "near" else 75)
        z = math.sqrt(9 - 4 - 2.25 + 6 * math.cos(turn))
        np.testing.assert_allclose(joints["home_position"], [0, 0, z], rtol=1e-12)
        assert joints["home_orientation"].tolist() == [0, 0, 0]


def test_keys_of_circles_in_a_file_are_all_needed_but_the_pairing() -> None:
    """Expected: what is missing in the order of the keys; a key that comes twice, each by its own name."""
    values: dict[str, Any] = {"gravity": [0, 0, -9], "name": "a"}
    assert joints_of_keys(values) == values
    assert joints_of_keys(values) is not values
    needed = "expected all of base_radius, platform_radius, home_leg_length, base_angle, platform_angle"
    for some, text in (
        ({"platform_radius": 1.0, "home_leg_length": 3.0}, "base_radius, base_angle, platform_angle"),
        ({"pairing": "far"}, "base_radius, platform_radius, base_angle, platform_angle, home_leg_length"),
    ):
        with pytest.raises(GoughStewartError) as refused:
            joints_of_keys({**values, **some})
        assert str(refused.value) == f"{next(iter(some))}: needs {text} beside it; {needed}"
    circles: dict[str, Any] = {"base_radius": 2.0, "platform_radius": 1.5, "base_angle": 0.3, "platform_angle": 0.5}
    circles["home_leg_length"] = 3.0
    for name in _JOINTS:
        with pytest.raises(GoughStewartError) as refused:
            joints_of_keys({**circles, name: 0})
        assert str(refused.value) == f"{name}: is also determined by base_radius; expected only one of the two"
    with pytest.raises(GoughStewartError, match=r"^base_points: is also"):
        joints_of_keys({**circles, **dict.fromkeys(_JOINTS, 0)})
    found = joints_of_keys({**values, **circles})
    assert set(found) == {"gravity", "name", *_JOINTS}
    np.testing.assert_array_equal(found["base_points"], joints_on_circles(**circles)["base_points"])

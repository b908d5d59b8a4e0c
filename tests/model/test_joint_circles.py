"""Joints on two circles, against the published platforms and elementary geometry."""

import math
import re
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.platform_files import loaded, written

_JOINTS = ("base_points", "platform_points", "home_position", "home_orientation")
_ANGLES = "in radians, from 0 (one joint for both) to below 2.0944 (120°)"
_SEEN = "a base joint and the platform joint above it, seen from above"
CIRCLES = {"base_radius": 2.0, "platform_radius": 1.5, "base_angle": 0.3, "platform_angle": 0.5, "home_leg_length": 3.0}


def others() -> dict[str, Any]:
    """What circles leave open."""
    return {name: value for name, value in gs.load_preset("liu2000").as_dict().items() if name not in _JOINTS}


def test_parameters_that_radii_and_angles_leave_open_are_asked_for_by_name() -> None:
    """Expected: all that have no default, in the order of the file; for an unknown name the nearest one."""
    left = others()
    del left["platform_inertia"], left["leg_upper_com"]
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=3.0, **left)
    assert str(caught.value) == (
        "platform_inertia: missing; expected platform_inertia, leg_upper_com beside the radii and angles"
    )
    with pytest.raises(gs.GoughStewartError, match="platform_mas: no such parameter; did you mean 'platform_mass'"):
        gs.Platform.from_radii(2.0, 1.0, 0.5, 0.5, home_leg_length=3.0, platform_mas=10.0)
    with pytest.raises(gs.GoughStewartError, match=r"platform_mas: no such parameter.*platform_mass"):
        gs.load_preset("liu2000").with_parameters({"platform_mas": 3.0})


def test_a_platform_file_may_state_circles_instead_of_joints() -> None:
    """Expected: the same platform as from Python, written out with its joints; all keys are needed but the pairing."""
    rest = "\n".join(line for line in written(gs.load_preset("liu2000")).splitlines() if not line.startswith("source"))
    for name in _JOINTS:
        rest = re.sub(rf"^{name} = \[.*?\] #[^\n]*(\n|$)", "", rest, flags=re.S | re.M)
    text = "\n".join([rest, "pairing = 'far'", *(f"{key} = {value}" for key, value in CIRCLES.items())])
    made = loaded(text)
    assert made == gs.Platform.from_radii(**CIRCLES, pairing="far", **{**others(), "source": ""})
    assert loaded(written(made)) == made
    needed = "expected all of base_radius, platform_radius, home_leg_length, base_angle, platform_angle"
    for lines, says in (
        (
            "platform_radius = 1\nhome_leg_length = 3",
            "platform_radius: needs base_radius, base_angle, platform_angle b",
        ),
        ("pairing = 'far'", f"pairing: needs {', '.join(CIRCLES)} beside it; {needed}"),
    ):
        with pytest.raises(gs.GoughStewartError, match=re.escape(says)):
            loaded(f"{rest}\n{lines}")
    for name in _JOINTS:
        with pytest.raises(gs.GoughStewartError, match=f"{name}: is also determined by base_radius; expected only one"):
            loaded(f"{text}\n{name} = [0, 0, 0]")


def test_an_experiment_may_state_circles_with_units() -> None:
    """Expected: the first joint by hand, legs of the stated length."""
    stated: dict[str, Any] = {"base_radius": "2100 mm", "platform_radius": "0.9 m", "home_leg_length": "3.1 m"}
    stated |= {"base_angle": "24deg", "platform_angle": "33deg", "parameters.home_orientation": [0, 0, 0.1]}
    settings = {f"platform.{name}": value for name, value in stated.items()}
    platform = gs.run("paper_open_loop", settings | {"loop.duration": 0.01}).metadata["platform"]
    # parameters are changed last
    assert platform["home_orientation"] == [0, 0, 0.1]
    points = np.array(platform["base_points"])
    azimuth = math.radians(12)
    np.testing.assert_allclose(points[0], 2.1 * np.array([math.cos(azimuth), math.sin(azimuth), 0]))
    tips = np.array(platform["home_position"]) + platform["platform_points"]
    np.testing.assert_allclose(np.linalg.norm(tips - points, axis=-1), 3.1, rtol=1e-12)


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("base_radius", 0.0, "is 0 m; expected a number above 0"),
        ("base_angle", 2 * np.pi / 3, f"is 2.0944 rad; expected a number {_ANGLES}"),
        ("platform_angle", -0.1, f"is -0.1 rad; expected a number {_ANGLES}"),
        ("platform_angle", [1.0], "has shape (1,); expected one number"),
        ("home_leg_length", 1.2, f"is 1.2 m; expected more than the 1.23931 m between {_SEEN}"),
        ("platform_radius", "1 m", "is '1 m'; expected one number"),
        ("base_points", np.zeros((6, 3)), "is determined by the radii and angles; leave it out"),
        ("pairing", "cross", "is 'cross'; expected 'near' or 'far'"),
    ],
)
def test_impossible_circles_are_told_in_whole_sentences(key: str, value: Any, text: str) -> None:
    """Expected: name, value with its unit, and what is possible; 1.23931 m is √(4 + 1 − 4 cos 30°)."""
    angle = math.radians(30)
    values = {"base_radius": 2.0, "platform_radius": 1.0, "base_angle": angle, "platform_angle": angle}
    with pytest.raises(gs.GoughStewartError) as refused:
        gs.Platform.from_radii(**{**others(), **values, "home_leg_length": 3.2459, key: value})
    assert str(refused.value) == f"{key}: {text}"


@pytest.mark.parametrize(
    ("pairing", "azimuths", "turn"),
    [("near", [35, 85, 155, 205, 275, 325], 25), ("far", [85, 35, 205, 155, 325, 275], 75)],
)
def test_each_joint_of_circles_is_where_the_documentation_puts_it(
    pairing: str, azimuths: list[float], turn: float
) -> None:
    """Expected: by hand, in degrees: base a = 20°, platform b = 50°, pairs at 60° ± 25°; legs in order of the base."""
    angles: Any = {"base_angle": math.radians(20), "platform_angle": math.radians(50), "pairing": pairing}
    platform = gs.Platform.from_radii(**{**CIRCLES, **angles}, **others())
    for points, radius, degrees in (
        (platform.base_points, 2.0, [10, 110, 130, 230, 250, 350]),
        (platform.platform_points, 1.5, azimuths),
    ):
        azimuth = np.radians(degrees)
        on_circle = radius * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
        np.testing.assert_allclose(points, on_circle, atol=1e-12)
    z = math.sqrt(9 - 4 - 2.25 + 6 * math.cos(math.radians(turn)))
    np.testing.assert_allclose(platform.home_position, [0, 0, z], rtol=1e-12)
    assert platform.home_orientation.tolist() == [0, 0, 0]

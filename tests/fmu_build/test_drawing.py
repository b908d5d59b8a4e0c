"""Pictures for the FMU: well-formed, sized, alike in SVG and PNG, for any platform."""

import io
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from gough_stewart.fmu_build.plant.drawing import DRAWING_SIZE, ICON_SIZE, drawing_svg, icon_png, icon_svg
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from tests.support.random_platforms import random_platform
from tests.support.uneven import UNEVEN

SVG = "{http://www.w3.org/2000/svg}"
FREE = replace(UNEVEN, leg_length_min=None, leg_length_max=None, joint_angle_max=None, actuator_force_max=None)
DRAWN = {
    **{name: load_preset(name) for name in preset_names()},
    **{f"random {seed}": random_platform(np.random.default_rng(seed)) for seed in range(3)},
    "uneven": UNEVEN,
    # its z axis points at the viewer, so that an arrow has no length
    "facing": replace(FREE, home_orientation=np.radians([66.0, 0, 35])),
}


@pytest.fixture(params=DRAWN)
def platform(request: pytest.FixtureRequest) -> Platform:
    return DRAWN[request.param]


def points_of(element: ET.Element) -> NDArray[np.float64]:
    return np.array([[float(number) for number in place.split(",")] for place in element.attrib["points"].split()])


def all_points(svg: str | bytes) -> NDArray[np.float64]:
    """Points (n, 2) of lines, areas, dots and labels."""
    elements = list(ET.fromstring(svg).iter())
    drawn = [points_of(element) for element in elements if "points" in element.attrib]
    texts = [[[float(element.attrib[key]) for key in "xy"]] for element in elements if "x" in element.attrib]
    return np.concatenate([*drawn, *texts])


def dots_of(svg: str | bytes) -> list[tuple[NDArray[np.float64], float, str]]:
    """Centre, radius and colour of the lines without a length."""
    lines = [(points_of(line), line.attrib) for line in ET.fromstring(svg).iter(f"{SVG}polyline")]
    return [
        (points[0], float(look["stroke-width"]) / 2, look["stroke"])
        for points, look in lines
        if (points[0] == points[-1]).all()
    ]


def test_the_drawing_names_frames_and_the_quantities_of_a_leg(platform: Platform) -> None:
    """Expected: the names of docs/notation.md and of the interface, on the paper."""
    svg = drawing_svg(platform)
    texts = {"".join(text.itertext()) for text in ET.fromstring(svg).iter(f"{SVG}text")}
    assert texts >= {"X0", "Y0", "Z0", "xp", "yp", "zp", "Op", "Bi", "Pi", "ui", "leg_length", "actuator_force > 0"}
    for picture, size in ((svg, DRAWING_SIZE), (icon_svg(platform), (ICON_SIZE, ICON_SIZE))):
        places = all_points(picture)
        assert ((places >= 0) & (places <= size)).all()


def test_joints_and_axes_are_where_rotations_have_them(platform: Platform) -> None:
    """Expected: the world in a view from 24° above the ground at an azimuth of −55°, by SciPy's rotations."""
    view = Rotation.from_euler("zx", [-35.0, -66.0], degrees=True)
    turn = Rotation.from_euler("xyz", platform.home_orientation)
    joints = np.concatenate(
        [platform.base_points, platform.home_position + turn.apply(np.array(platform.platform_points))]
    )
    seen = view.apply(joints)[:, :2] * [1, -1]
    for svg in (drawing_svg(platform), icon_svg(platform)):
        dots = np.array([centre for centre, _, _ in dots_of(svg)])
        assert dots.shape == (12, 2)
        scale = np.ptp(dots[:, 0]) / np.ptp(seen[:, 0])
        np.testing.assert_allclose(dots - dots[0], scale * (seen - seen[0]), atol=0.02)
    arrows = [points_of(area) for area in ET.fromstring(drawing_svg(platform)).iter(f"{SVG}polygon")][2:]
    tips = np.array([tip for tip, *_ in arrows])
    assert len(tips) == 11 - (platform is DRAWN["facing"])
    # the tip of z_p lies from Op along the third column of R
    if platform is UNEVEN:
        origin, axis = (
            view.apply(vector)[:2] * [1, -1] for vector in (np.array(platform.home_position), turn.apply([0, 0, 1]))
        )
        base, dots = seen[0], np.array([centre for centre, _, _ in dots_of(drawing_svg(platform))])
        scale = np.ptp(dots[:, 0]) / np.ptp(seen[:, 0])
        from_origin = tips - (dots[0] + scale * (origin - base))
        across = np.abs(from_origin[:, 0] * axis[1] - from_origin[:, 1] * axis[0]) / np.hypot(*axis)
        assert (across < 0.03).sum() == 1


def test_nearer_legs_cover_those_behind(platform: Platform) -> None:
    """Expected: the order of depths of points at 54 % of the legs; the base is behind all, the platform before all."""
    root = ET.fromstring(icon_svg(platform))
    kinds = [element.tag.removeprefix(SVG) for element in root][1:]
    assert kinds == ["polygon", *["polyline"] * 12, "polygon", *["polyline"] * 12]
    view = Rotation.from_euler("zx", [-35.0, -66.0], degrees=True)
    turn = Rotation.from_euler("xyz", platform.home_orientation)
    top = platform.home_position + turn.apply(np.array(platform.platform_points))
    middle = platform.base_points + 0.54 * (top - platform.base_points)
    depth = view.apply(middle)[:, 2]
    feet = np.array([points_of(line)[0] for line in root.findall(f"{SVG}polyline")[1:12:2]])
    dots = np.array([centre for centre, _, _ in dots_of(icon_svg(platform))])[:6]
    order = [int(np.abs(dots - foot).sum(axis=1).argmin()) for foot in feet]
    assert (np.diff(depth[order]) > -1e-9).all()


def test_svg_and_png_show_the_same(platform: Platform) -> None:
    """Expected: a square on a transparent ground; at each dot that no later one covers, the dot's colour."""
    image = np.asarray(Image.open(io.BytesIO(icon_png(platform))).convert("RGBA"))
    assert image.shape == (ICON_SIZE, ICON_SIZE, 4)
    assert (image[[0, 0, -1, -1], [0, -1, 0, -1], 3] == 0).all()
    extent = [np.ptp(np.flatnonzero(image[..., 3].any(axis=axis))) for axis in (0, 1)]
    assert max(extent) > 0.85 * ICON_SIZE
    dots, checked = dots_of(icon_svg(platform)), 0
    for k, (centre, radius, colour) in enumerate(dots):
        if all(np.hypot(*(centre - other)) > radius + 1 for other, _, _ in dots[k + 1 :]):
            x, y = centre.astype(int)
            assert "#{:02X}{:02X}{:02X}".format(*image[y, x, :3]) == colour
            checked += 1
    assert checked >= 4
    for stroke in ET.fromstring(icon_svg(platform)).iter(f"{SVG}polyline"):
        x, y = points_of(stroke).mean(axis=0).astype(int)
        assert image[y, x, 3] == 255


def test_size_plays_no_part_and_the_same_platform_gives_the_same_bytes() -> None:
    """Expected: similar figures have the same picture, without a date."""
    lengths = ("base_points", "platform_points", "home_position")
    tenfold = replace(FREE, **{name: 10 * getattr(FREE, name) for name in lengths})
    np.testing.assert_allclose(all_points(drawing_svg(tenfold)), all_points(drawing_svg(FREE)), atol=0.011)
    png = icon_png(FREE)
    assert icon_png(FREE) == png
    assert not any(part in png for part in (b"tEXt", b"tIME"))

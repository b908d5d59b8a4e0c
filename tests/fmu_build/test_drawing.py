"""Pictures for the FMU: well-formed, sized, alike in SVG and PNG, for any platform."""

import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from gough_stewart.fmu_build.plant.drawing import DRAWING_SIZE, ICON_SIZE, drawing_svg, icon_png, icon_svg
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from tests.support.random_platforms import random_platform

SVG = "{http://www.w3.org/2000/svg}"
PRESETS = preset_names()


@pytest.fixture(params=PRESETS)
def platform(request: pytest.FixtureRequest) -> Platform:
    return load_preset(request.param)


def pixels(png: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))


def coordinates(svg: bytes) -> NDArray[np.float64]:
    """All points (n, 2) of lines, areas, dots and labels."""
    found: list[list[float]] = []
    for element in ET.fromstring(svg).iter():
        found += [[float(c) for c in p.split(",")] for p in element.get("points", "").split()]
        for x, y in (("cx", "cy"), ("x", "y")):
            if x in element.attrib:
                found.append([float(element.attrib[x]), float(element.attrib[y])])
    return np.array(found)


def test_the_drawing_names_frames_and_the_quantities_of_a_leg(platform: Platform) -> None:
    """Expected: the names of docs/notation.md and of the interface."""
    texts = {"".join(text.itertext()) for text in ET.fromstring(drawing_svg(platform)).iter(f"{SVG}text")}
    assert texts >= {"X0", "Y0", "Z0", "xp", "yp", "zp", "Op", "Bi", "Pi", "ui", "leg_length", "actuator_force > 0"}


@pytest.mark.parametrize(("draw", "size"), [(drawing_svg, DRAWING_SIZE), (icon_svg, (ICON_SIZE, ICON_SIZE))])
def test_everything_lies_on_the_paper(platform: Platform, draw, size) -> None:  # type: ignore[no-untyped-def]
    points = coordinates(draw(platform))
    assert len(points) > 30
    assert (points >= 0).all()
    assert (points <= size).all()


def test_a_drawing_of_another_scale_is_the_same(platform: Platform) -> None:
    """Expected: similar figures have the same picture; the size in metres plays no part."""
    tenfold = replace(
        platform,
        base_points=10 * platform.base_points,
        platform_points=10 * platform.platform_points,
        home_position=10 * platform.home_position,
        leg_length_min=None,
        leg_length_max=None,
    )
    for draw in (drawing_svg, icon_svg):
        np.testing.assert_allclose(coordinates(draw(tenfold)), coordinates(draw(platform)), atol=0.011)


def test_the_icon_has_six_legs_of_two_parts_and_twelve_joints(platform: Platform) -> None:
    root = ET.fromstring(icon_svg(platform))
    assert len(root.findall(f"{SVG}polyline")) == 12
    assert len(root.findall(f"{SVG}circle")) == 12
    assert len(root.findall(f"{SVG}polygon")) == 2
    assert root.findall(f"{SVG}text") == []


def test_the_png_is_square_with_a_transparent_background(platform: Platform) -> None:
    image = pixels(icon_png(platform))
    assert image.shape == (ICON_SIZE, ICON_SIZE, 4)
    alpha = image[..., 3]
    assert (alpha[[0, 0, -1, -1], [0, -1, 0, -1]] == 0).all()
    assert 0.1 < (alpha == 255).mean() < 0.9
    # fills the square in one direction at least
    extent = [np.ptp(np.flatnonzero(alpha.any(axis=axis))) for axis in (0, 1)]
    assert max(extent) > 0.85 * ICON_SIZE


def test_svg_and_png_show_the_same(platform: Platform) -> None:
    """Expected: at the centre of every dot of the SVG that no later one covers, the PNG has the dot's colour."""
    image = pixels(icon_png(platform))
    dots = [
        (np.array([float(e.attrib["cx"]), float(e.attrib["cy"])]), float(e.attrib["r"]), e.attrib["fill"])
        for e in ET.fromstring(icon_svg(platform)).iter(f"{SVG}circle")
    ]
    checked = 0
    for k, (centre, radius, colour) in enumerate(dots):
        if all(np.hypot(*(centre - other)) > radius + 1 for other, _, _ in dots[k + 1 :]):
            x, y = centre.astype(int)
            assert "#{:02X}{:02X}{:02X}".format(*image[y, x, :3]) == colour
            checked += 1
    assert checked >= 6


@pytest.mark.parametrize("draw", [drawing_svg, icon_svg, icon_png])
def test_the_same_platform_gives_the_same_bytes_without_a_date(draw, platform: Platform) -> None:  # type: ignore[no-untyped-def]
    data: bytes = draw(platform)
    assert draw(platform) == data
    assert b"tEXt" not in data
    assert b"tIME" not in data
    assert not re.search(rb"\b20\d\d-", data)


@pytest.mark.parametrize("seed", range(5))
def test_any_platform_can_be_drawn(seed: int) -> None:
    """Joints off their planes, tilted home poses, sizes from centimetres to metres."""
    platform = random_platform(np.random.default_rng(seed))
    assert np.isfinite(coordinates(drawing_svg(platform))).all()
    points = coordinates(icon_svg(platform))
    assert ((points >= 0) & (points <= ICON_SIZE)).all()
    assert pixels(icon_png(platform))[..., 3].any()

"""Pictures for the FMU: well-formed, sized, alike in SVG and PNG, for any platform."""

import io
import math
import re
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


# --- places on paper, for a platform of six different legs and a tilted home pose ------------------------------------

SLEEVE = 0.54  # share of a leg that its lower part covers


def seen(world: NDArray[np.float64]) -> NDArray[np.float64]:
    """World (n, 3) to right and down (n, 2), seen from an azimuth of −55° and 24° above the ground."""
    a, e = math.radians(-55), math.radians(24)
    right = [-math.sin(a), math.cos(a), 0]
    down = [math.sin(e) * math.cos(a), math.sin(e) * math.sin(a), -math.cos(e)]
    return np.asarray(world @ np.transpose([right, down]))


def joints(platform: Platform) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Base and platform joints in the world at home, by rotations about the fixed axes x, y, z."""
    turned = Rotation.from_euler("xyz", platform.home_orientation).apply(platform.platform_points.copy())
    return platform.base_points, platform.home_position + turned


def points_of(element: ET.Element) -> NDArray[np.float64]:
    return np.array([[float(c) for c in pair.split(",")] for pair in element.attrib["points"].split()])


def centres(root: ET.Element) -> NDArray[np.float64]:
    return np.array([[float(e.attrib["cx"]), float(e.attrib["cy"])] for e in root.iter(f"{SVG}circle")])


def scale_and_shift(root: ET.Element, platform: Platform) -> tuple[float, NDArray[np.float64]]:
    """From the dots of a picture: paper = scale · seen + shift."""
    expected, found = seen(np.concatenate(joints(platform))), centres(root)
    scale = float(np.ptp(found, axis=0).max() / np.ptp(expected, axis=0)[np.ptp(found, axis=0).argmax()])
    return scale, (found - scale * expected).mean(axis=0)


@pytest.mark.parametrize("seed", range(3))
def test_joints_legs_and_bodies_are_where_an_orthographic_view_has_them(seed: int) -> None:
    """Expected: joints by SciPy's rotations and a view written out by angles; legs divided at 0.54, far ones first."""
    platform = random_platform(np.random.default_rng(seed))
    root = ET.fromstring(icon_svg(platform))
    B, P = joints(platform)
    scale, shift = scale_and_shift(root, platform)

    def paper(world: NDArray[np.float64]) -> NDArray[np.float64]:
        return scale * seen(world) + shift

    np.testing.assert_allclose(centres(root), paper(np.concatenate([B, P])), atol=0.02)
    # they fill the square between 9 and 119, and are in its middle
    low, high = centres(root).min(axis=0), centres(root).max(axis=0)
    assert (high - low).max() == pytest.approx(110, abs=0.02)
    np.testing.assert_allclose((low + high) / 2, [64, 64], atol=0.02)
    middle = B + SLEEVE * (P - B)
    toward = [math.cos(math.radians(24)) * f(math.radians(-55)) for f in (math.cos, math.sin)]
    order = np.argsort(middle @ [*toward, math.sin(math.radians(24))])
    lines = root.findall(f"{SVG}polyline")
    for k, i in enumerate(order):
        np.testing.assert_allclose(points_of(lines[2 * k]), paper(np.stack([middle[i], P[i]])), atol=0.02)
        np.testing.assert_allclose(points_of(lines[2 * k + 1]), paper(np.stack([B[i], middle[i]])), atol=0.02)
    for polygon, corners in zip(root.findall(f"{SVG}polygon"), (B, P), strict=True):
        found = points_of(polygon)
        angles = np.arctan2(*(corners - corners.mean(axis=0)).T[[1, 0]])
        np.testing.assert_allclose(found, paper(corners[np.argsort(angles)]), atol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_the_arrows_of_both_frames_point_along_their_axes(seed: int) -> None:
    """Expected: tips at half the base's radius or the gap, and at 3/4 of the platform's radius; names 13 beyond."""
    platform = random_platform(np.random.default_rng(seed))
    root = ET.fromstring(drawing_svg(platform))
    B, P = joints(platform)
    scale, shift = scale_and_shift(root, platform)
    radius = [math.sqrt(sum(np.sum((p - each.mean(axis=0)) ** 2) for p in each) / 6) for each in (B, P)]
    gap = max(abs(P.mean(axis=0) - B.mean(axis=0)))
    frames = (
        (np.zeros(3), np.eye(3), 0.5 * min(radius[0], gap), ("X0", "Y0", "Z0")),
        (
            platform.home_position,
            Rotation.from_euler("xyz", platform.home_orientation).as_matrix().T,
            0.75 * radius[1],
            ("xp", "yp", "zp"),
        ),
    )
    heads = [points_of(each) for each in root.iter(f"{SVG}polygon")]
    tips = np.array([head[0] for head in heads if len(head) == 3])
    texts = {"".join(t.itertext()): [float(t.attrib[c]) for c in "xy"] for t in root.iter(f"{SVG}text")}
    checked = 0
    for origin, axes, length, names in frames:
        start = scale * seen(origin[None])[0] + shift
        for axis, name in zip(axes, names, strict=True):
            tip = scale * seen((origin + length * axis)[None])[0] + shift
            along = (tip - start) / np.hypot(*(tip - start))
            np.testing.assert_allclose(texts[name], tip + 13 * along + [0, 5], atol=0.03)
            if np.hypot(*(tip - start)) > 10.1:
                assert np.hypot(*(tips - tip).T).min() < 0.03
                checked += 1
    assert checked >= 4


def test_the_leg_with_names_is_the_rightmost_one_and_its_signs_are_beside_it() -> None:
    """Expected: by the coordinates of its two joints; forces apart, the direction from base to platform."""
    platform = random_platform(np.random.default_rng(4))
    root = ET.fromstring(drawing_svg(platform))
    dots = centres(root)
    B, P = max(zip(dots[:6], dots[6:], strict=True), key=lambda ends: float(ends[0][0] + ends[1][0]))
    texts = {"".join(t.itertext()): t for t in root.iter(f"{SVG}text")}
    place = {name: np.array([float(t.attrib["x"]), float(t.attrib["y"]) - 5]) for name, t in texts.items()}
    np.testing.assert_allclose(place["Bi"], B + np.array([4, 17]), atol=0.03)
    np.testing.assert_allclose(place["Pi"], P + np.array([11, -12]), atol=0.03)
    length = np.hypot(*(P - B))
    along = (P - B) / length
    across = np.array([-along[1], along[0]]) * (1 if along[1] < 0 else -1)
    beside = 54 + 14 * abs(along[0])
    np.testing.assert_allclose(place["leg_length"], B + 0.8 * length * along + beside * across, atol=0.03)
    np.testing.assert_allclose(
        place["actuator_force > 0"], B + SLEEVE * length * along + beside * across - [0, 8], atol=0.03
    )
    np.testing.assert_allclose(place["pushes both parts apart"], place["actuator_force > 0"] + [0, 16], atol=0.03)
    heads = [points_of(each)[0] for each in root.iter(f"{SVG}polygon") if len(points_of(each)) == 3][-5:]
    reach = min(0.2 * length, 50)
    expected = [
        (SLEEVE + 0.02) * length + reach,
        (SLEEVE - 0.02) * length - reach,
        0.06 * length + reach,
        length,
        0.0,
    ]
    for head, way, aside in zip(heads, expected, (15, 15, 15, 44, 44), strict=True):
        np.testing.assert_allclose(head, B + way * along + aside * across, atol=0.03)
    assert texts["actuator_force > 0"].attrib["fill"] == "#C0392B"

"""Pictures for the FMU: well-formed, sized, alike in SVG and PNG, for any platform."""

import io
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from matplotlib.path import Path as PathOfPlaces
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

from gough_stewart.fmu_build.plant.drawing import DRAWING_SIZE, ICON_SIZE, drawing_svg, icon_png, icon_svg
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, preset_names
from tests.support.random_platforms import random_platform
from tests.support.uneven import UNEVEN

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


# --- every element, by an account of its own -----------------------------------------------------------------------

INK, BASE, TOP, FORCE = "#222222", "#55606C", "#0072B2", "#C0392B"
SLEEVE = 0.54  # share of a leg that its lower part covers


class Mark(NamedTuple):
    """An element of a picture: places as complex numbers, right + i·down."""

    tag: str
    places: list[complex]
    look: dict[str, str]


def marks_in(svg: bytes) -> list[Mark]:
    """All elements but the title, with two decimals and no negative zero in any place."""
    root = ET.fromstring(svg)
    found = []
    for element in root[1:]:
        look = dict(element.attrib)
        texts = [look.pop(name) for name in ("points", "cx", "cy", "x", "y") if name in look]
        numbers = " ".join(texts).replace(",", " ").split()
        assert all(re.fullmatch(r"-?\d+(\.\d\d?)?", each) and each != "-0" for each in numbers)
        flat = [float(each) for each in numbers]
        if element.tag == f"{SVG}text":
            look["text"] = (element.text or "") + "".join(
                f"[{each.text}|{' '.join(f'{k}={v}' for k, v in sorted(each.attrib.items()))}]" for each in element
            )
        places = [complex(x, y) for x, y in zip(flat[::2], flat[1::2], strict=True)]
        found.append(Mark(element.tag.removeprefix(SVG), places, look))
    return found


def line(places: Iterable[complex], colour: str, width: str) -> Mark:
    return Mark("polyline", list(places), {"fill": "none", "stroke": colour, "stroke-width": width})


def polygon(places: Iterable[complex], fill: str, colour: str, width: str) -> Mark:
    return Mark("polygon", list(places), {"fill": fill, "stroke": colour, "stroke-width": width})


def arrow(start: complex, end: complex, colour: str, width: str = "1.8") -> list[Mark]:
    """A line that ends where the head of 9 × 7 begins; nothing below a length of 10."""
    if abs(end - start) < 10:
        return []
    along = (end - start) / abs(end - start)
    head = [end, end + (-9 + 3.5j) * along, end + (-9 - 3.5j) * along]
    return [line([start, end - 9 * along], colour, width), polygon(head, colour, colour, "0.5")]


def label(at: complex, text: str, colour: str, anchor: str = "middle") -> list[Mark]:
    """Letters on a white edge; a symbol is italic and its index is small and lower."""
    if anchor == "middle":
        symbol, index = text.split("_")
        text = f"[{symbol}|font-style=italic][{index}|dy=4 font-size=10]"
    edge = {"fill": "#FFFFFF", "stroke": "#FFFFFF", "stroke-width": "4", "aria-hidden": "true"}
    own = {"text-anchor": anchor, "text": text}
    return [Mark("text", [at + 5j], edge | own), Mark("text", [at + 5j], {"fill": colour} | own)]


def projected(world: NDArray[np.float64]) -> NDArray[np.complex128]:
    """World (n, 3) to right + i·down, seen from an azimuth of −55° and 24° above the ground."""
    turned = Rotation.from_euler("zx", [-35, 114], degrees=True).apply(np.array(world))
    return np.asarray(turned[:, 0] + 1j * turned[:, 1])


def joints(platform: Platform) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Base and platform joints in the world at home, by rotations about the fixed axes x, y, z."""
    turned = Rotation.from_euler("xyz", platform.home_orientation).apply(platform.platform_points.copy())
    return platform.base_points.copy(), platform.home_position + turned


def around(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sorted by the angle about their mean, from −π."""
    x, y = (points - points.mean(axis=0))[:, :2].T
    return points[np.argsort(np.angle(x + 1j * y))]


class Paper:
    """Places on paper: the view with these points in a box, centred, as large as possible."""

    def __init__(self, points: NDArray[np.float64], corner: complex, opposite: complex) -> None:
        view = projected(points)
        sides = (np.ptp(view.real), np.ptp(view.imag))
        size = opposite - corner
        self._scale = min(size.real / sides[0], size.imag / sides[1])
        self._middle = complex(view.real.min() + sides[0] / 2, view.imag.min() + sides[1] / 2)
        self._centre = (corner + opposite) / 2

    def __call__(self, points: NDArray[np.float64]) -> list[complex]:
        return list(self._centre + self._scale * (projected(np.atleast_2d(points)) - self._middle))


def base_and_legs(platform: Platform, paper: Paper, outline: str, lower: str, upper: str) -> list[Mark]:
    """The base, then the legs, of which nearer ones cover others: with depths by the view's third axis."""
    B, P = joints(platform)
    middle = B + SLEEVE * (P - B)
    depth = Rotation.from_euler("zx", [-35, 114], degrees=True).apply(middle)[:, 2]
    found = [polygon(paper(around(B)), "#DDE3E8", BASE, outline)]
    for i in np.argsort(-depth):
        found.append(line(paper(np.array([middle[i], P[i]])), "#D9A441", upper))
        found.append(line(paper(np.array([B[i], middle[i]])), "#8A6D3B", lower))
    return found


def top_and_joints(platform: Platform, paper: Paper, outline: str, radius: str) -> list[Mark]:
    B, P = joints(platform)
    found = [polygon(paper(around(P)), "#A9CFE8", TOP, outline)]
    for points, colour in ((B, BASE), (P, TOP)):
        found += [Mark("circle", [centre], {"r": radius, "fill": colour}) for centre in paper(points)]
    return found


def icon_marks(platform: Platform) -> list[Mark]:
    paper = Paper(np.concatenate(joints(platform)), 9 + 9j, 119 + 119j)
    return [*base_and_legs(platform, paper, "4", "7", "4"), *top_and_joints(platform, paper, "4", "4.5")]


def frame(tips: list[complex], names: str) -> list[Mark]:
    found: list[Mark] = []
    for tip, name in zip(tips[1:], names.split(), strict=True):
        away = tip - tips[0]
        found += arrow(tips[0], tip, INK)
        found += label(tip + 13 * (away / abs(away) if away else -1j), name, INK)
    return found


def leg_marks(B: complex, P: complex) -> list[Mark]:
    """Signs to the right of a leg, whose places are along the leg and across it."""
    length, along = abs(P - B), (P - B) / abs(P - B)
    across = 1j * along if (1j * along).real > 0 else -1j * along
    reach = min(0.2 * length, 50.0)

    def at(way: float, aside: float) -> complex:
        return B + way * along + aside * across

    beside = 54 + 14 * abs(along.real)
    sleeve, gap = SLEEVE * length, 0.02 * length
    words = at(sleeve, beside)
    return [
        *arrow(at(sleeve + gap, 15), at(sleeve + gap + reach, 15), FORCE),
        *arrow(at(sleeve - gap, 15), at(sleeve - gap - reach, 15), FORCE),
        *arrow(at(0.06 * length, 15), at(0.06 * length + reach, 15), INK),
        *label(at(0.06 * length + reach / 2, 27), "u_i", INK),
        *(line([at(end, 8), at(end, 50)], BASE, "0.8") for end in (0, length)),
        *arrow(at(length / 2, 44), at(length, 44), BASE, "1"),
        *arrow(at(length / 2, 44), at(0, 44), BASE, "1"),
        *label(at(0.8 * length, beside), "leg_length", BASE, "start"),
        *label(words - 8j, "actuator_force > 0", FORCE, "start"),
        *label(words + 8j, "pushes both parts apart", FORCE, "start"),
        *label(B + (4 + 17j), "B_i", BASE),
        *label(P + (11 - 12j), "P_i", TOP),
    ]


def drawing_marks(platform: Platform) -> list[Mark]:
    B, P = joints(platform)
    radii = [float(np.linalg.norm(each - each.mean(axis=0)) / math.sqrt(6)) for each in (B, P)]
    gap = max(abs(P.mean(axis=0) - B.mean(axis=0)))
    world = np.concatenate([np.zeros((1, 3)), 0.5 * min(radii[0], gap) * np.eye(3)])
    turn = Rotation.from_euler("xyz", platform.home_orientation)
    own = platform.home_position + np.concatenate([np.zeros((1, 3)), turn.apply(0.75 * radii[1] * np.eye(3))])
    paper = Paper(np.concatenate([B, P, world, own]), 60 + 40j, 520 + 440j)
    leg = max(zip(paper(B), paper(P), strict=True), key=lambda ends: float((ends[0] + ends[1]).real))
    return [
        *base_and_legs(platform, paper, "1.5", "7", "3.5"),
        *frame(paper(world), "X_0 Y_0 Z_0"),
        *top_and_joints(platform, paper, "1.5", "4"),
        *frame(paper(own), "x_p y_p z_p"),
        *label(paper(platform.home_position)[0] + (-13 + 11j), "O_p", INK),
        *leg_marks(*leg),
    ]


def hanging(platform: Platform) -> Platform:
    """Below its base."""
    turned = np.array([1, 1, -1])
    return replace(
        platform,
        base_points=platform.base_points * turned,
        platform_points=platform.platform_points * turned,
        platform_com=platform.platform_com * turned,
        platform_inertia=platform.platform_inertia * np.outer(turned, turned),
        home_position=platform.home_position * turned,
        home_orientation=platform.home_orientation * [-1, -1, 1],
    )


def elsewhere(**changes: NDArray[np.float64]) -> Platform:
    """The uneven platform with other joints or another home, and without limits."""
    free = replace(UNEVEN, leg_length_min=None, leg_length_max=None, joint_angle_max=None, actuator_force_max=None)
    return replace(free, **changes)  # type: ignore[arg-type]


def facing() -> Platform:
    """Its z axis points at the viewer, so its arrow is a point."""
    return elsewhere(home_orientation=np.radians([66.0, 0, 35]))


def in_the_middle_of_the_base() -> Platform:
    """Both rings of joints have one centre, so that the world's arrows have no length."""
    base = np.array([[4, 0, 1], [2, 3, -1], [-2, 3, 1], [-4, 0, -1], [-2, -3, 1], [2, -3, -1]], dtype=float)
    top = np.array([[1, 1, 0.5], [0.5, 1, -0.5], [-1, 0.5, 0.5], [-1, -1, -0.5], [-0.5, -1, 0.5], [1, -0.5, -0.5]])
    zero = np.zeros(3)
    return elsewhere(base_points=base, platform_points=top, home_position=zero, home_orientation=zero)


def low() -> Platform:
    """Nearer to its base than the base's radius, which is away from the origin."""
    aside = np.array([0.5, -0.4, 0.3])
    return elsewhere(base_points=UNEVEN.base_points + aside, home_position=np.array([0.9, -0.2, 1.3]))


def random(seed: int) -> Platform:
    return random_platform(np.random.default_rng(seed))


DRAWN: dict[str, Callable[[], Platform]] = {
    "uneven": lambda: UNEVEN,
    "low": low,
    "hanging": lambda: hanging(UNEVEN),
    "facing": facing,
    "in the middle": in_the_middle_of_the_base,
    "random 1": lambda: random(1),
    "random 4": lambda: random(4),
}


@pytest.mark.parametrize(
    ("draw", "account", "size", "title"),
    [
        (icon_svg, icon_marks, (128, 128), "Gough–Stewart platform"),
        (drawing_svg, drawing_marks, (760, 480), "Gough–Stewart platform with its frames and the signs of a leg"),
    ],
    ids=["icon", "drawing"],
)
@pytest.mark.parametrize("name", DRAWN)
def test_each_element_is_where_an_account_by_rotations_has_it(
    name: str,
    draw: Callable[[Platform], bytes],
    account: Callable[[Platform], list[Mark]],
    size: tuple[int, int],
    title: str,
) -> None:
    """Expected: places by SciPy's rotations and complex numbers; what is painted later covers what is earlier."""
    platform = DRAWN[name]()
    svg = draw(platform)
    found, expected = marks_in(svg), account(platform)
    assert [(each.tag, each.look) for each in found] == [(each.tag, each.look) for each in expected]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.places, other.places, atol=0.0075, err_msg=str(one.look))
    root = ET.fromstring(svg)
    assert dict(root.attrib) == {
        "width": str(size[0]),
        "height": str(size[1]),
        "viewBox": f"0 0 {size[0]} {size[1]}",
        "font-family": "Helvetica, Arial, sans-serif",
        "font-size": "14",
        "stroke-linecap": "round",
        "stroke-linejoin": "round",
        "role": "img",
    }
    assert (root[0].tag, root[0].text) == (f"{SVG}title", title)


def test_the_cases_of_the_pictures_differ_where_they_should() -> None:
    """Expected: arrows without a length, short ones, legs that are long and short on paper, upward and downward."""
    arrows = {name: sum(len(m.places) == 3 for m in drawing_marks(make())) for name, make in DRAWN.items()}
    assert arrows["uneven"] == 11
    assert arrows["facing"] == 10
    assert arrows["in the middle"] == 8


def rasterised(svg: bytes, side: int, oversampling: int = 4) -> NDArray[np.float64]:
    """Colours (side, side, 4) from 0 to 255, means over subpixels: distances to lines, points inside polygons."""
    at = (np.arange(side * oversampling) + 0.5) / oversampling
    x, y = np.meshgrid(at, at)
    grid = x + 1j * y
    paint = np.zeros((*grid.shape, 4))

    def cover(is_in: NDArray[np.bool_], colour: str) -> None:
        paint[is_in] = [*bytes.fromhex(colour[1:]), 255]

    def stroke(places: list[complex], look: dict[str, str]) -> None:
        for a, b in pairwise(places):
            share = np.clip(((grid - a) * np.conj(b - a)).real / abs(b - a) ** 2, 0, 1)
            cover(abs(grid - a - share * (b - a)) <= float(look["stroke-width"]) / 2, look["stroke"])

    for tag, places, look in marks_in(svg):
        if tag == "circle":
            cover(abs(grid - places[0]) <= float(look["r"]), look["fill"])
            continue
        if tag == "polygon":
            corners = [(each.real, each.imag) for each in places]
            inside = PathOfPlaces(corners).contains_points(np.stack([x.ravel(), y.ravel()], axis=1))
            cover(inside.reshape(grid.shape), look["fill"])
        stroke([*places, *places[:1]] if tag == "polygon" else places, look)
    whole = paint.reshape(side, oversampling, side, oversampling, 4).astype(float)
    alpha = whole[..., 3:].mean(axis=(1, 3))
    colour = (whole[..., :3] * whole[..., 3:]).mean(axis=(1, 3)) / np.maximum(alpha, 1)
    return np.concatenate([colour, alpha], axis=-1)


def test_the_png_is_the_svg_in_pixels() -> None:
    """Expected: the shapes of the SVG in pixels by distances; their rims differ by a fraction of a pixel."""
    found, expected = pixels(icon_png(UNEVEN)).astype(float), rasterised(icon_svg(UNEVEN), ICON_SIZE)
    # colours count as far as they are opaque
    apart = abs(found * found[..., 3:] - expected * expected[..., 3:]).max(axis=-1) / 255
    assert apart.mean() < 1.6
    assert apart.max() < 110

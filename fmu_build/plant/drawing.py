"""Pictures of a platform for the FMU: a labelled drawing for its documentation, and an icon without text.

Pure functions of the platform: they create a list of shapes on paper and write it as SVG or PNG.
"""

import io
from collections.abc import Callable, Iterable
from html import escape
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation

Points = NDArray[np.float64]

ICON_SIZE = 128
DRAWING_SIZE = (760, 480)

_INK, _BASE, _TOP, _FORCE = "#222222", "#55606C", "#0072B2", "#C0392B"
_BASE_FILL, _TOP_FILL, _LOWER, _UPPER = "#DDE3E8", "#A9CFE8", "#8A6D3B", "#D9A441"
# left, top, right, bottom of the mechanism on paper; the rest is for labels
_DRAWING_BOX = (60.0, 40.0, 520.0, 440.0)
_ICON_BOX = (9.0, 9.0, 119.0, 119.0)
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(24.0)
# length of the lower part of a leg, as a fraction of the leg length
_SLEEVE = 0.54
_OVERSAMPLING = 8


class Line(NamedTuple):
    """An open line with round ends."""

    points: Points  # (n, 2) on paper, y down
    colour: str
    width: float


class Area(NamedTuple):
    """A filled polygon with an outline."""

    points: Points  # (n, 2)
    fill: str
    colour: str
    width: float


class Dot(NamedTuple):
    """A filled circle."""

    centre: Points  # (2,)
    radius: float
    colour: str


class Label(NamedTuple):
    """A short text, vertically centred; the part of a symbol after the first `_` is a subscript."""

    at: Points  # (2,)
    text: str
    colour: str
    anchor: str = "middle"
    is_symbol: bool = True


Shape = Line | Area | Dot | Label
ToPaper = Callable[[Points], Points]


class _Home(NamedTuple):
    """The joints and the platform frame in the home pose, world components."""

    B: Points  # (6, 3)
    P: Points  # (6, 3)
    t: Points  # (3,)
    R: Points  # (3, 3)


def drawing_svg(platform: Platform) -> bytes:
    """The platform in its home pose with its frames, and names and signs at one leg, as an `svg` element."""
    home = _home(platform)
    # short enough not to reach the platform
    gap = float(np.abs(home.P.mean(axis=0) - home.B.mean(axis=0)).max())
    world = _tips(np.zeros(3), np.eye(3), 0.5 * min(_radius(home.B), gap))
    own = _tips(home.t, home.R, 0.75 * _radius(home.P))
    to_paper = _fitted(np.concatenate([home.B, home.P, world, own]), _DRAWING_BOX)
    shapes = [
        *_base_and_legs(home, to_paper, 1.5, 7, 3.5),
        *_frame(to_paper(world), ("X_0", "Y_0", "Z_0")),
        *_top(home, to_paper, 1.5),
        *_joints(home, to_paper, 4),
        *_frame(to_paper(own), ("x_p", "y_p", "z_p")),
        Label(_moved(to_paper(home.t), -13, 11), "O_p", _INK),
        *_one_leg(home, to_paper),
    ]
    return _svg(shapes, *DRAWING_SIZE, "Gough–Stewart platform with its frames and the signs of a leg")


def icon_svg(platform: Platform) -> bytes:
    """The icon as an `svg` element."""
    return _svg(_icon(platform), ICON_SIZE, ICON_SIZE, "Gough–Stewart platform")


def icon_png(platform: Platform) -> bytes:
    """The icon as PNG with a transparent background, `ICON_SIZE` pixels square."""
    image = Image.new("RGBA", (_OVERSAMPLING * ICON_SIZE, _OVERSAMPLING * ICON_SIZE))
    pen = ImageDraw.Draw(image)
    for shape in _icon(platform):
        _paint(pen, shape)
    stream = io.BytesIO()
    image.reduce(_OVERSAMPLING).save(stream, "PNG", compress_level=9)
    return stream.getvalue()


# --- content -------------------------------------------------------------------------------------------------------


def _home(platform: Platform) -> _Home:
    t = platform.home_position
    legs = leg_geometry(platform, t, platform.home_orientation)
    return _Home(platform.base_points, t + legs.arm, t, matrix_from_orientation(platform.home_orientation))


def _icon(platform: Platform) -> list[Shape]:
    home = _home(platform)
    to_paper = _fitted(np.concatenate([home.B, home.P]), _ICON_BOX)
    return [*_base_and_legs(home, to_paper, 4, 7, 4), *_top(home, to_paper, 4), *_joints(home, to_paper, 4.5)]


def _base_and_legs(home: _Home, to_paper: ToPaper, outline: float, lower: float, upper: float) -> list[Line | Area]:
    """The base, then the legs from back to front."""
    shapes: list[Line | Area] = [Area(to_paper(_around(home.B)), _BASE_FILL, _BASE, outline)]
    middle = home.B + _SLEEVE * (home.P - home.B)
    for i in np.argsort(middle @ _toward_viewer(), kind="stable"):
        B, M, P = to_paper(np.stack([home.B[i], middle[i], home.P[i]]))
        shapes += [Line(np.stack([M, P]), _UPPER, upper), Line(np.stack([B, M]), _LOWER, lower)]
    return shapes


def _top(home: _Home, to_paper: ToPaper, outline: float) -> list[Area]:
    return [Area(to_paper(_around(home.P)), _TOP_FILL, _TOP, outline)]


def _joints(home: _Home, to_paper: ToPaper, radius: float) -> list[Dot]:
    dots = [Dot(centre, radius, _BASE) for centre in to_paper(home.B)]
    return dots + [Dot(centre, radius, _TOP) for centre in to_paper(home.P)]


def _frame(points: Points, names: tuple[str, str, str]) -> list[Shape]:
    """Axes from the first point to the others; an axis toward the viewer has no arrow."""
    shapes: list[Shape] = []
    for tip, name in zip(points[1:], names, strict=True):
        shapes += _arrow(points[0], tip, _INK)
        shapes.append(Label(tip + 13 * _unit(tip - points[0]), name, _INK))
    return shapes


def _one_leg(home: _Home, to_paper: ToPaper) -> list[Shape]:
    """Names and signs beside the leg at the right edge of the picture."""
    i = int(np.argmax(to_paper(home.B)[:, 0] + to_paper(home.P)[:, 0]))
    B, P = to_paper(np.stack([home.B[i], home.P[i]]))
    along, length = _unit(P - B), float(np.hypot(*(P - B)))
    across = np.array([-along[1], along[0]])
    if across[0] < 0:
        across = -across

    def at(share: float, distance: float) -> Points:
        return np.asarray(B + share * length * along + distance * across)

    reach = min(0.2 * length, 50.0) / length
    beside = 54 + 14 * abs(float(along[0]))  # keep texts clear of an inclined line
    shapes: list[Shape] = [
        *_arrow(at(_SLEEVE + 0.02, 15), at(_SLEEVE + 0.02 + reach, 15), _FORCE),
        *_arrow(at(_SLEEVE - 0.02, 15), at(_SLEEVE - 0.02 - reach, 15), _FORCE),
        *_arrow(at(0.06, 15), at(0.06 + reach, 15), _INK),
        Label(at(0.06 + reach / 2, 27), "u_i", _INK),
        *(Line(np.stack([at(end, 8), at(end, 50)]), _BASE, 0.8) for end in (0.0, 1.0)),
        *_arrow(at(0.5, 44), at(1, 44), _BASE, 1),
        *_arrow(at(0.5, 44), at(0, 44), _BASE, 1),
        Label(at(0.8, beside), "leg_length", _BASE, "start", is_symbol=False),
        Label(_moved(at(_SLEEVE, beside), 0, -8), "actuator_force > 0", _FORCE, "start", is_symbol=False),
        Label(_moved(at(_SLEEVE, beside), 0, 8), "pushes both parts apart", _FORCE, "start", is_symbol=False),
        Label(_moved(B, 4, 17), "B_i", _BASE),
        Label(_moved(P, 11, -12), "P_i", _TOP),
    ]
    return shapes


def _arrow(start: Points, end: Points, colour: str, width: float = 1.8) -> list[Line | Area]:
    length = float(np.hypot(*(end - start)))
    if length < 10:
        return []
    along = (end - start) / length
    across, neck = np.array([-along[1], along[0]]), end - 9 * along
    head = np.stack([end, neck + 3.5 * across, neck - 3.5 * across])
    return [Line(np.stack([start, neck]), colour, width), Area(head, colour, colour, 0.5)]


# --- from world to paper -------------------------------------------------------------------------------------------


def _toward_viewer() -> Points:
    return np.array([np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH), np.sin(_ELEVATION)])


def _projected(points: Points) -> Points:
    """Orthographic view: world (..., 3) to right and down (..., 2), in m."""
    right = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
    up = np.cross(_toward_viewer(), right)
    return np.stack([points @ right, -(points @ up)], axis=-1)


def _fitted(points: Points, box: tuple[float, float, float, float]) -> ToPaper:
    """The view, scaled and shifted so that the points fill a box on paper."""
    seen = _projected(points)
    low, high = seen.min(axis=0), seen.max(axis=0)
    corner, opposite = np.array(box[:2]), np.array(box[2:])
    scale = float(((opposite - corner) / (high - low)).min())
    middle, centre = (low + high) / 2, (corner + opposite) / 2
    return lambda world: centre + scale * (_projected(world) - middle)


def _tips(origin: Points, axes: Points, length: float) -> Points:
    """Origin and ends of the axes of a frame, whose axes are the columns, (4, 3)."""
    return np.concatenate([origin[None], origin + length * axes.T])


def _around(points: Points) -> Points:
    """Points sorted by their angle around the centre, in plan view."""
    x, y, _ = (points - points.mean(axis=0)).T
    return points[np.argsort(np.arctan2(y, x), kind="stable")]


def _radius(points: Points) -> float:
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _moved(point: Points, right: float, down: float) -> Points:
    return np.asarray(point + np.array([right, down]))


def _unit(vector: Points) -> Points:
    length = float(np.hypot(*vector))
    return vector / length if length > 0 else np.array([0.0, -1.0])


# --- SVG -----------------------------------------------------------------------------------------------------------


def _svg(shapes: Iterable[Shape], width: int, height: int, title: str) -> bytes:
    body = "\n".join(_element(shape) for shape in shapes)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    head += ' font-family="Helvetica, Arial, sans-serif" font-size="14" stroke-linecap="round" stroke-linejoin="round"'
    return f'{head} role="img">\n<title>{escape(title)}</title>\n{body}\n</svg>\n'.encode()


def _element(shape: Shape) -> str:
    match shape:
        case Line(points, colour, width):
            return (
                f'<polyline points="{_points(points)}" fill="none" stroke="{colour}" stroke-width="{_number(width)}"/>'
            )
        case Area(points, fill, colour, width):
            look = f'fill="{fill}" stroke="{colour}" stroke-width="{_number(width)}"'
            return f'<polygon points="{_points(points)}" {look}/>'
        case Dot(centre, radius, colour):
            x, y = centre
            return f'<circle cx="{_number(x)}" cy="{_number(y)}" r="{_number(radius)}" fill="{colour}"/>'
        case Label():
            return _text(shape)


def _text(label: Label) -> str:
    """The text twice: a white outline that keeps it readable on lines, then the letters."""
    text, (x, y) = escape(label.text), label.at
    if label.is_symbol:
        symbol, index = text.split("_")
        text = f'<tspan font-style="italic">{symbol}</tspan><tspan dy="4" font-size="10">{index}</tspan>'
    place = f'x="{_number(x)}" y="{_number(y + 5)}" text-anchor="{label.anchor}"'
    edge = f'<text {place} fill="#FFFFFF" stroke="#FFFFFF" stroke-width="4" aria-hidden="true">{text}</text>'
    return f'{edge}\n<text {place} fill="{label.colour}">{text}</text>'


def _points(points: Points) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in points)


def _number(value: float) -> str:
    """At most two decimals, and no negative zero."""
    return f"{round(float(value), 2) + 0.0:g}"


# --- PNG -----------------------------------------------------------------------------------------------------------


def _paint(pen: ImageDraw.ImageDraw, shape: Shape) -> None:
    match shape:
        case Line(points, colour, width):
            _stroke(pen, points, colour, width)
        case Area(points, fill, colour, width):
            pen.polygon(_pixels(points), fill=fill)
            _stroke(pen, np.concatenate([points, points[:1]]), colour, width)
        case Dot(centre, radius, colour):
            _disc(pen, centre, radius, colour)
        case Label():
            raise NotImplementedError("icons carry no text")


def _stroke(pen: ImageDraw.ImageDraw, points: Points, colour: str, width: float) -> None:
    pen.line(_pixels(points), fill=colour, width=round(_OVERSAMPLING * width))
    for point in points:
        _disc(pen, point, width / 2, colour)


def _disc(pen: ImageDraw.ImageDraw, centre: Points, radius: float, colour: str) -> None:
    (x0, y0), (x1, y1) = _pixels(np.stack([centre - radius, centre + radius]))
    pen.ellipse((x0, y0, x1, y1), fill=colour)


def _pixels(points: Points) -> list[tuple[float, float]]:
    return [(round(_OVERSAMPLING * float(x)), round(_OVERSAMPLING * float(y))) for x, y in points]

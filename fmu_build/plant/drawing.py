"""Pictures of a platform for the FMU: a labelled drawing for its documentation, and an icon without text."""

import io
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gough_stewart.fmu_build.component import Icon
from gough_stewart.fmu_build.documents import rendered
from gough_stewart.model.kinematics import leg_geometry
from gough_stewart.model.platform import Platform
from gough_stewart.model.rotations import matrix_from_orientation

Points = NDArray[np.float64]
View = Callable[[Points], Points]

ICON_SIZE = 128
DRAWING_SIZE = (760, 480)

_INK, _BASE, _TOP, _FORCE = "#222222", "#55606C", "#0072B2", "#C0392B"
_BASE_FILL, _TOP_FILL, _LOWER, _UPPER = "#DDE3E8", "#A9CFE8", "#8A6D3B", "#D9A441"
# left, top, right, bottom of the mechanism on paper; the rest is for labels
_DRAWING_BOX = (60.0, 40.0, 520.0, 440.0)
_ICON_BOX = (9.0, 9.0, 119.0, 119.0)
_AZIMUTH, _ELEVATION = np.radians(-55.0), np.radians(24.0)
_RIGHT = np.array([-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0])
_TO_VIEWER = np.array(
    [np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH), np.sin(_ELEVATION)]
)
# world to paper: right and down, in m
_VIEW = np.stack([_RIGHT, -np.cross(_TO_VIEWER, _RIGHT)], axis=-1)
# length of the lower part of a leg, as a fraction of the leg length
_SLEEVE = 0.54
_OVERSAMPLING = 8


class PenStroke(NamedTuple):
    """A line with round ends, on paper with y down; closed and filled if it has a fill; one point is a dot."""

    points: Points  # (n, 2)
    colour: str
    width: float
    fill: str = ""


class Label(NamedTuple):
    """A short text, vertically centred; a centred one is a symbol, italic, with what follows its `_` as subscript."""

    at: Points  # (2,)
    text: str
    colour: str
    anchor: str = "middle"


def drawing_svg(platform: Platform) -> str:
    """The platform in its home pose with its frames, and names and signs at one leg, as an `svg` element."""
    B, P, t, R = _home(platform)
    # root mean squares of the distances from the middle
    radii = [float(np.sqrt(((ring - ring.mean(axis=0)) ** 2).sum(axis=1).mean())) for ring in (B, P)]
    # short enough not to reach the platform
    gap = float(np.abs(P.mean(axis=0) - B.mean(axis=0)).max())
    # origin and tips of the axes, (4, 3)
    world_frame = np.vstack([np.zeros(3), np.eye(3)]) * 0.5 * min(radii[0], gap)
    platform_frame = t + 0.75 * radii[1] * np.vstack([np.zeros(3), R.T])
    on_paper = _fit(np.concatenate([B, P, world_frame, platform_frame]), _DRAWING_BOX)
    strokes = _mechanism(B, P, on_paper, (1.5, 7.0, 3.5, 8.0))
    labels = [Label(on_paper(platform_frame)[0] + np.array([-13.0, 11.0]), "O_p", _INK)]
    for points, names in ((world_frame, ("X_0", "Y_0", "Z_0")), (platform_frame, ("x_p", "y_p", "z_p"))):
        frame = on_paper(points)
        for tip, name in zip(frame[1:], names, strict=True):
            strokes += _arrow(frame[0], tip, _INK)
            labels.append(Label(tip + 13 * _direction(tip - frame[0]), name, _INK))

    # arrows and names beside the leg at the right edge of the picture
    feet, tips = on_paper(B), on_paper(P)
    i = int(np.argmax(feet[:, 0] + tips[:, 0]))
    along, length = _direction(tips[i] - feet[i]), float(np.hypot(*(tips[i] - feet[i])))
    across = np.array([-along[1], along[0]])
    if across[0] < 0:
        across = -across

    def at(share: float, distance: float) -> Points:
        return np.asarray(feet[i] + share * length * along + distance * across)

    reach = min(0.2 * length, 50.0) / length
    beside = 54 + 14 * abs(float(along[0]))  # keep texts clear of an inclined line
    strokes += [
        *_arrow(at(_SLEEVE + 0.02, 15), at(_SLEEVE + 0.02 + reach, 15), _FORCE),
        *_arrow(at(_SLEEVE - 0.02, 15), at(_SLEEVE - 0.02 - reach, 15), _FORCE),
        *_arrow(at(0.06, 15), at(0.06 + reach, 15), _INK),
        *(PenStroke(np.stack([at(end, 8), at(end, 50)]), _BASE, 0.8) for end in (0.0, 1.0)),
        *_arrow(at(0.5, 44), at(1, 44), _BASE, 1),
        *_arrow(at(0.5, 44), at(0, 44), _BASE, 1),
    ]
    labels += [
        Label(at(0.06 + reach / 2, 27), "u_i", _INK),
        Label(at(0.8, beside), "leg_length", _BASE, "start"),
        Label(at(_SLEEVE, beside) - np.array([0.0, 8.0]), "actuator_force > 0", _FORCE, "start"),
        Label(at(_SLEEVE, beside) + np.array([0.0, 8.0]), "pushes both parts apart", _FORCE, "start"),
        Label(feet[i] + np.array([4.0, 17.0]), "B_i", _BASE),
        Label(tips[i] + np.array([11.0, -12.0]), "P_i", _TOP),
    ]

    title = "Gough–Stewart platform with its frames and the signs of a leg"
    width, height = DRAWING_SIZE
    return rendered("picture.svg", title=title, width=width, height=height, strokes=strokes, labels=labels).decode()


@lru_cache(maxsize=8)
def icon_of(platform: Platform) -> Icon:
    """The icon, `ICON_SIZE` pixels square, with a transparent background."""
    B, P, _, _ = _home(platform)
    strokes = _mechanism(B, P, _fit(np.concatenate([B, P]), _ICON_BOX), (4.0, 7.0, 4.0, 9.0))
    size, title = ICON_SIZE, "Gough–Stewart platform"
    svg = rendered("picture.svg", title=title, width=size, height=size, strokes=strokes, labels=())
    image = Image.new("RGBA", (_OVERSAMPLING * ICON_SIZE, _OVERSAMPLING * ICON_SIZE))
    pen = ImageDraw.Draw(image)
    for stroke in strokes:
        points = np.round(_OVERSAMPLING * stroke.points)
        line = [(float(x), float(y)) for x, y in points]
        if stroke.fill:
            pen.polygon(line, fill=stroke.fill)
            line.append(line[0])
        pen.line(line, fill=stroke.colour, width=round(_OVERSAMPLING * stroke.width))
        radius = _OVERSAMPLING * stroke.width / 2
        for x, y in line:
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=stroke.colour)
    stream = io.BytesIO()
    image.reduce(_OVERSAMPLING).save(stream, "PNG", compress_level=9)
    return Icon(stream.getvalue(), svg)


def _home(platform: Platform) -> tuple[Points, Points, Points, Points]:
    """Joints of base and platform (6, 3), origin (3,) and axes (3, 3) of the platform's frame at home, in world."""
    t, R = platform.home_position, matrix_from_orientation(platform.home_orientation)
    return platform.base_points, t + leg_geometry(platform, t, platform.home_orientation).arm, t, R


def _fit(points: Points, box: tuple[float, float, float, float]) -> View:
    """The orthographic view, of points (n, 3) in world as (n, 2) on paper, with which these points fill a box."""
    seen = points @ _VIEW
    low, high = seen.min(axis=0), seen.max(axis=0)
    corner, opposite = np.array(box[:2]), np.array(box[2:])
    scale = float(((opposite - corner) / (high - low)).min())
    shift = (corner + opposite) / 2 - scale * (low + high) / 2
    return lambda points: np.asarray(points @ _VIEW * scale + shift)


def _mechanism(B: Points, P: Points, on_paper: View, widths: tuple[float, float, float, float]) -> list[PenStroke]:
    """The base, the legs from back to front, the platform, the joints; widths of outlines, leg's parts and joints."""
    outline, lower, upper, joint = widths
    middle = B + _SLEEVE * (P - B)

    def plate(points: Points) -> Points:
        x, y, _ = (points - points.mean(axis=0)).T
        return on_paper(points[np.argsort(np.arctan2(y, x), kind="stable")])

    strokes = [PenStroke(plate(B), _BASE, outline, _BASE_FILL)]
    for i in np.argsort(middle @ _TO_VIEWER, kind="stable"):
        strokes.append(PenStroke(on_paper(np.stack([middle[i], P[i]])), _UPPER, upper))
        strokes.append(PenStroke(on_paper(np.stack([B[i], middle[i]])), _LOWER, lower))
    strokes.append(PenStroke(plate(P), _TOP, outline, _TOP_FILL))
    return strokes + [
        PenStroke(on_paper(point[None]), colour, joint) for ring, colour in ((B, _BASE), (P, _TOP)) for point in ring
    ]


def _arrow(start: Points, end: Points, colour: str, width: float = 1.8) -> list[PenStroke]:
    """A line with a head; nothing where it points at the viewer."""
    if np.hypot(*(end - start)) < 10:
        return []
    along = _direction(end - start)
    across, neck = np.array([-along[1], along[0]]), end - 9 * along
    head = np.stack([end, neck + 3.5 * across, neck - 3.5 * across])
    return [PenStroke(np.stack([start, neck]), colour, width), PenStroke(head, colour, 0.5, colour)]


def _direction(vector: Points) -> Points:
    length = float(np.hypot(*vector))
    return vector / length if length > 0 else np.array([0.0, -1.0])

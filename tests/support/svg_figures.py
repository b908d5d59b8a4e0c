"""What a figure shows, read back from its SVG: panels, lines in the units of their ticks, labels, legend."""

import re
from dataclasses import dataclass, field

import numpy as np
from lxml import etree

from gough_stewart.model.vectors import FloatArray

_SVG = "{http://www.w3.org/2000/svg}"


@dataclass
class Strip:
    """A marked span of time at the top of a panel, from and to a share of its height."""

    colour: str
    start: float
    end: float
    low: float
    high: float


@dataclass
class Panel:
    """One of the axes of a figure, top left first."""

    title: str
    lines: list[FloatArray]  # each (n, 2): time and value, by the ticks; NaN where a line has a gap
    styles: list[str]  # of the lines: colour and dashes
    legend: dict[str, str]  # style by text
    x_ticks: dict[float, str] = field(default_factory=dict)  # label by value
    y_ticks: dict[float, str] = field(default_factory=dict)
    strips: list["Strip"] = field(default_factory=list)
    box: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # left, top, right, bottom [pt]
    x_view: tuple[float, float] = (0.0, 0.0)
    y_view: tuple[float, float] = (0.0, 0.0)


def panels_of(svg: bytes, time: tuple[float, float]) -> tuple[list[Panel], list[str], dict[str, str]]:
    """Panels, texts, and legend of a figure of this project whose panels all show this span of time [s].

    Vertical coordinates come from the labels of the grid lines alone; panels without labels have those of their row.
    """
    root = etree.fromstring(svg)
    figure = root.find(f"{_SVG}g[@id='figure_1']")
    assert figure is not None
    made: list[Panel] = []
    for axes in figure.iterfind(f"{_SVG}g"):
        if str(axes.get("id")).startswith("axes_"):
            made.append(_panel(axes, made, time))
    texts = [_text(each) for each in figure.iterfind(f"{_SVG}g") if str(each.get("id")).startswith("text_")]
    legends = [each for each in figure.iterfind(f"{_SVG}g") if str(each.get("id")).startswith("legend_")]
    return made, texts, _legend(legends[0]) if legends else {}


def _panel(axes: etree._Element, before: list[Panel], time: tuple[float, float]) -> Panel:
    def parts(kind: str) -> list[etree._Element]:
        return [each for each in axes.iterfind(f"{_SVG}g") if str(each.get("id")).startswith(kind)]

    patch = _points(parts("patch_")[0])
    left, right, top, bottom = patch[:, 0].min(), patch[:, 0].max(), patch[:, 1].min(), patch[:, 1].max()
    grids = parts("LineCollection_")
    across, up = ([_points_of(path) for path in grid.iterfind(f"{_SVG}path")] for grid in grids[:2])
    texts = [(_text(each), _place(each)) for each in parts("text_")]
    title = texts[-1][0]
    numbers = texts[:-1]
    xs, ys = [float(line[0, 0]) for line in across], [float(line[0, 1]) for line in up]
    # labels of times are below the panel, those of values at its left
    below = [text for text, (_, y) in numbers if y > bottom + 5]
    beside = [text for text, (_, y) in numbers if y <= bottom + 5]
    assert len(below) in (0, len(xs))
    assert len(beside) in (0, len(ys))
    if beside:
        values = [_number(text) for text in beside]
        slope, start = np.polyfit(ys, values, 1) if len(ys) > 1 else (np.nan, np.nan)
        # labels are numbers at their lines
        assert np.allclose(np.polyval([slope, start], ys), values, atol=2e-3 * abs(slope * (bottom - top)))
        y_view = (slope * bottom + start, slope * top + start)
    else:
        y_view = before[-1].y_view
    slope = (y_view[1] - y_view[0]) / (top - bottom)

    def to_data(points: FloatArray) -> FloatArray:
        t = time[0] + (points[:, 0] - left) / (right - left) * (time[1] - time[0])
        return np.stack([t, y_view[0] + slope * (points[:, 1] - bottom)], axis=1)

    legend = parts("legend_")
    return Panel(
        title,
        [to_data(_points(each)) for each in parts("line2d_")],
        [_style(each) for each in parts("line2d_")],
        _legend(legend[0]) if legend else {},
        {float(to_data(line)[0, 0]): text for line, text in zip(across, below, strict=False)},
        {float(to_data(line)[0, 1]): text for line, text in zip(up, beside, strict=False)},
        [
            Strip(_colour(path), *_ends(to_data(span)[:, 0]), *_ends((bottom - span[:, 1]) / (bottom - top)))
            for grid in parts("PolyCollection_")
            for path in grid.iterfind(f".//{_SVG}path")
            for span in [_placed(path)]
        ],
        (float(left), float(top), float(right), float(bottom)),
        time,
        (float(y_view[0]), float(y_view[1])),
    )


def _ends(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def _text(group: etree._Element) -> str:
    """The comments of a text hold its characters."""
    return "\n".join(str(each.text).strip() for each in group.iter(etree.Comment))


def _place(group: etree._Element) -> tuple[float, float]:
    found = re.search(r"translate\(([-\d.]+) ([-\d.]+)\)", etree.tostring(group).decode())
    assert found is not None
    return float(found[1]), float(found[2])


def _points(group: etree._Element) -> FloatArray:
    path = group.find(f"{_SVG}path")
    assert path is not None
    return _points_of(path)


def _points_of(path: etree._Element) -> FloatArray:
    """Corners of a path; a new start after a gap is a row of NaN."""
    found: list[tuple[float, float]] = []
    for kind, x, y in re.findall(r"([ML]) ([-\d.e]+) ([-\d.e]+)", str(path.get("d"))):
        if kind == "M" and found:
            found.append((np.nan, np.nan))
        found.append((float(x), float(y)))
    return np.array(found)


def _placed(path: etree._Element) -> FloatArray:
    """Of a path that is defined once and used elsewhere: matplotlib defines it from the lower edge up."""
    points = _points_of(path)
    height = float(str(path.getroottree().getroot().get("height")).removesuffix("pt"))
    return points if (points[:, 1] >= 0).all() else points + np.array([0.0, height])


def _style(group: etree._Element) -> str:
    """Colour and dashes of a line."""
    path = group.find(f"{_SVG}path")
    assert path is not None
    dashes = re.search(r"stroke-dasharray: ([\d.,]+)", str(path.get("style")))
    return f"{_colour(path)} {dashes[1] if dashes else '-'}"


def _colour(path: etree._Element) -> str:
    found = re.search(r"stroke: (#\w+)", str(path.get("style")))
    return found[1] if found else "#000000"


def _legend(group: etree._Element) -> dict[str, str]:
    found, style = {}, ""
    for each in group.iterfind(f"{_SVG}g"):
        name = str(each.get("id"))
        if name.startswith("line2d_"):
            style = _style(each)
        elif name.startswith("patch_"):
            path = each.find(f"{_SVG}path")
            assert path is not None
            style = _colour(path)
        elif name.startswith("text_"):
            found[_text(each)] = style
    return found

"""What the figures of a workspace draw, read from matplotlib's own objects."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from gough_stewart.harness.workspace import figures
from gough_stewart.harness.workspace.display import clearance, fixed_text, limits_text
from gough_stewart.harness.workspace.figures import workspace_figures
from gough_stewart.harness.workspace.maps import LIMIT_COLOURS
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.workspace import Limit
from gough_stewart.model.workspace_grid import Workspace, sweep
from tests.support.uneven import UNEVEN

DESKTOP = load_preset("desktop_hexapod")


class Drawn:
    """The figure of a workspace, with its size [inch]."""

    def __init__(self, workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
        kept: list[Any] = []

        def pictures(name: str, draw: Callable[[Figure], None], width: float, height: float) -> dict[str, bytes]:
            figure = Figure(figsize=(width, height))
            draw(figure)
            kept.append((name, figure))
            return {}

        monkeypatch.setattr(figures, "pictures", pictures)
        workspace_figures(workspace)
        ((self.name, figure),) = kept
        self.figure: Any = figure
        self.width, self.height = figure.get_size_inches()
        self.texts = [text.get_text() for text in figure.texts[1:]]  # after the title
        self.legend = [text.get_text() for text in figure.legends[0].get_texts()]

    def box(self, axes: Any) -> tuple[float, float, float, float]:
        """Left, top, width, height [inch], from the upper left corner."""
        place = axes.get_position()
        return (
            place.x0 * self.width,
            (1 - place.y1) * self.height,
            place.width * self.width,
            place.height * self.height,
        )


@pytest.fixture(scope="module")
def maps(space: Workspace) -> Iterator[Drawn]:
    """Of `space`, drawn once."""
    with pytest.MonkeyPatch.context() as patch:
        yield Drawn(space, patch)


@pytest.fixture(scope="module")
def space() -> Workspace:
    """Uneven, aside of home; all kinds of limits but the pitch."""
    return sweep(UNEVEN, {"y": (-1.9, 1.3), "x": (-1.0, 1.5)}, {"roll": 0.2, "yaw": -0.3}, points=31)


def test_maps_show_the_values_of_the_grid_where_they_belong(space: Workspace, maps: Drawn) -> None:
    """Expected: cells centred on the grid's points, the first coordinate to the right, inside ranges; colours by value.

    Contour lines of the stroke lie above 0 and below its largest value; the border is where the clearance is 0.
    """
    drawn = maps
    y, x = space.swept.values()
    step_y, step_x = y[1] - y[0], x[1] - x[0]
    bars = [axes for axes in drawn.figure.axes if axes.get_label() == "<colorbar>" or not axes.images]
    shown = [axes for axes in drawn.figure.axes if axes not in bars]
    titles = ["reachable, with stroke left [m]", "condition number", "largest payload [kg]", "force margin [N]"]
    assert [axes.get_title() or axes.get_title(loc="left") for axes in shown] == titles
    q = space.qualities
    inside = q.reachable
    for axes, values in zip(shown, (None, q.condition_number, q.payload, q.force_margin), strict=True):
        assert axes.get_xlim() == pytest.approx((y[0], y[-1]))
        assert axes.get_ylim() == pytest.approx((x[0], x[-1]))
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("y [m]", "x [m]")
        image = axes.images[0]
        ends = (y[0] - step_y / 2, y[-1] + step_y / 2, x[0] - step_x / 2, x[-1] + step_x / 2)
        assert image.get_extent() == pytest.approx(ends)
        assert image.origin == "lower"
        assert not axes.lines  # no cross, as home is in another plane
        if values is None:
            continue
        shown_values = np.asarray(image.get_array()).T
        assert shown_values[inside] == pytest.approx(values[inside])
        assert (image.norm.vmin, image.norm.vmax) == pytest.approx((values[inside].min(), values[inside].max()))
    codes = np.asarray(shown[0].images[0].get_array()).T
    assert (codes[~inside] == q.limit[~inside]).all()
    colours = shown[0].images[0].cmap(shown[0].images[0].norm(np.arange(7)))
    assert [to_hex(colour).upper() for colour in colours] == [LIMIT_COLOURS[limit] for limit in Limit]
    assert q.leg_length_margin is not None
    contours = [list(getattr(each, "levels", [])) for each in shown[0].collections]
    levels = [float(level) for each in contours if each not in ([0], [0, np.inf]) for level in each]
    assert len(levels) >= 3
    assert min(levels) > 0
    assert max(levels) < q.leg_length_margin[inside].max()
    assert np.ptp(np.diff(sorted(set(levels)))) < 1e-9
    _check_border(shown, space)
    limits = sorted({int(code) for code in q.limit.ravel()})
    assert drawn.legend == [Limit(code).text for code in limits]
    patches = drawn.figure.legends[0].legend_handles
    assert [to_hex(p.get_facecolor()).upper() for p in patches] == [LIMIT_COLOURS[Limit(code)] for code in limits]
    assert [p.get_edgecolor()[3] > 0 for p in patches] == [code == 0 for code in limits]


def _check_border(shown: list[Any], space: Workspace) -> None:
    """On the lines at level 0, the clearance between points of the grid is 0, linearly interpolated."""
    y, x = space.swept.values()
    field = clearance(space)
    for axes in shown:
        (border,) = [c for c in axes.collections if list(getattr(c, "levels", [])) == [0]]
        assert to_hex(border.get_edgecolor()[0]) == "#222222"
        points = np.concatenate([path.vertices for path in border.get_paths()])
        row = np.clip(((points[:, 0] - y[0]) / (y[1] - y[0])).astype(int), 0, len(y) - 2)
        column = np.clip(((points[:, 1] - x[0]) / (x[1] - x[0])).astype(int), 0, len(x) - 2)
        corners = np.stack([field[row + i, column + k] for i in (0, 1) for k in (0, 1)])
        assert len(points) > 20
        assert (corners.min(axis=0) < 1e-9).all()
        assert (corners.max(axis=0) > -1e-9).all()
    # what lies beyond is hidden by a path along the border
    assert all(axes.images[0].get_clip_path() is not None for axes in shown[1:])


def test_the_title_and_the_limits_are_those_of_the_workspace(space: Workspace, maps: Drawn) -> None:
    assert maps.name == "workspace"
    assert maps.texts == [limits_text(space)]
    assert maps.figure._suptitle.get_text() == f"Workspace of uneven at {fixed_text(space)}"


@pytest.mark.parametrize(
    ("over", "ratio", "across"),
    [
        ({"x": (-0.1, 0.1), "y": (-0.1, 0.02)}, 0.6, 3.3 / 0.9**0.5),
        ({"x": (-0.1, 0.1), "y": (-1.0, 0.0)}, 4.0, 1.65),
        ({"x": (-1.0, 1.0), "y": (-0.1, 0.1)}, 0.25, 3.3 / 0.9**0.5),
        ({"x": (-0.1, 0.1), "yaw": (-0.1, 0.1)}, 0.85, 3.3 / 0.9**0.5),
        ({"roll": (-0.1, 0.1), "yaw": (-0.1, 0.2)}, 1.5, 3.3 / 1.5**0.5),
    ],
)
def test_coordinates_of_one_unit_have_equal_scales(
    over: dict[str, tuple[float, float]], ratio: float, across: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: height over width as the ranges, from a quarter to four; lengths beside angles have a ratio of 0.85."""
    drawn = Drawn(sweep(UNEVEN, over, points=5), monkeypatch)
    _, _, width, height = drawn.box(drawn.figure.axes[0])
    assert height / width == pytest.approx(ratio)
    # the area of a square of 3.3 inches, but for flat maps, and thin ones of half its width
    assert width == pytest.approx(across)
    assert drawn.width >= 5.5


def test_home_is_a_cross_in_its_plane(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: at home's own coordinates in the units of the axes, named in the legend."""
    drawn = Drawn(sweep(UNEVEN, {"yaw": (-0.2, 0.3), "y": (-0.3, 0.2)}, points=9), monkeypatch)
    maps = [axes for axes in drawn.figure.axes if axes.get_xlabel()]
    assert len(maps) == 4
    for axes in maps:
        (cross,) = axes.lines
        assert cross.get_xydata()[0] == pytest.approx([np.degrees(0.11), -0.05])
        assert (cross.get_marker(), cross.get_linestyle()) == ("+", "None")
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("yaw [°]", "y [m]")
    assert drawn.legend[-1] == "home"


def test_slices_of_a_volume_are_named_and_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: four slices where something is reached, none of them at an end; in mm on a small platform.

    Every row has the same scales; only the last row and the first column have labels, and one bar stands at the right.
    """
    over = {"x": (-0.05, 0.07), "y": (-0.06, 0.06), "z": None}
    space = sweep(DESKTOP, over, points=17)
    drawn = Drawn(space, monkeypatch)
    reached = np.flatnonzero(space.qualities.reachable.any(axis=(0, 1)))
    low, high = reached[0], reached[-1]
    chosen = sorted({round(low + share * (high - low)) for share in (0.125, 0.375, 0.625, 0.875)})
    maps = [axes for axes in drawn.figure.axes if drawn.box(axes)[2] > 0.5]
    assert len(maps) == 4 * len(chosen) == 16
    z = space.swept["z"]
    for row, values in enumerate((None, space.qualities.condition_number, space.qualities.payload)):
        for column, k in enumerate(chosen):
            axes = maps[row * 4 + column]
            texts = [text.get_text() for text in axes.texts if text.get_visible()]
            assert (f"z {1e3 * z[k]:.3g} mm" in texts) == (row == 0)
            inside = space.qualities.reachable[..., k]
            image = np.asarray(axes.images[0].get_array()).T
            if values is None:
                assert (image[~inside] == space.qualities.limit[..., k][~inside]).all()
            else:
                assert image[inside] == pytest.approx(values[..., k][inside])
                everywhere = values[space.qualities.reachable]
                norm = axes.images[0].norm
                assert (norm.vmin, norm.vmax) == pytest.approx((everywhere.min(), everywhere.max()))
    for number, axes in enumerate(maps):
        row, column = divmod(number, 4)
        assert (axes.get_xlabel() == "x [mm]") == (row == 3)
        assert (axes.get_ylabel() == "y [mm]") == (column == 0)
        assert drawn.box(axes)[:2] == pytest.approx((drawn.box(maps[column])[0], drawn.box(maps[4 * row])[1]))
        titles = ("reachable, with stroke left [mm]", "condition number", "largest payload [kg]", "force margin [N]")
        assert (titles[row] in [text.get_text() for text in axes.texts]) == (column == 0)
    _check_axes_of_slices(maps)
    bars = [drawn.box(axes) for axes in drawn.figure.axes if drawn.box(axes)[2] <= 0.5]
    assert len(bars) == 3
    last = drawn.box(maps[3])
    assert {round(bar[0] - last[0] - last[2], 6) for bar in bars} == {0.08}
    assert [bar[1] for bar in bars] == pytest.approx([drawn.box(maps[4 * row])[1] for row in (1, 2, 3)])


def test_bars_show_where_colours_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: an arrow where values go on beyond the scale, beside a singular pose; round ticks."""
    wide = replace(UNEVEN, joint_angle_max=None, leg_length_min=None, leg_length_max=None)
    drawn = Drawn(sweep(wide, {"roll": (-1.2, 1.2), "yaw": (-1.5, 1.5)}, points=33), monkeypatch)
    bars = [axes for axes in drawn.figure.axes if drawn.box(axes)[2] <= 0.5]
    extends = [axes._colorbar.extend for axes in bars]
    numbers = sweep(wide, {"roll": (-1.2, 1.2), "yaw": (-1.5, 1.5)}, points=33).qualities
    assert extends == [
        "max" if numbers.condition_number[numbers.reachable].max() > 1000 else "neither",
        "neither",
        "neither",
    ]
    assert not any(axes._colorbar.outline.get_visible() for axes in bars)
    ticks = [text.get_text() for text in bars[0].get_yticklabels()]
    assert {"2", "5", "10", "20", "50", "100"} <= set(ticks)
    assert not any(
        "e" in tick or "{" in tick for axes in bars for tick in (t.get_text() for t in axes.get_yticklabels())
    )


def test_an_empty_region_has_one_map_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: its notice below the limits, in lines that fit, and no bar; a title without a stroke."""
    space = sweep(UNEVEN, {"x": (-0.1, 0.1), "y": (0.0, 0.1)}, {"z": 1.0}, points=5)
    drawn = Drawn(space, monkeypatch)
    (axes,) = drawn.figure.axes
    assert (axes.get_title() or axes.get_title(loc="left")) == "reachable"
    assert " ".join(drawn.texts[1:]).startswith("No pose of this grid can be reached. The one nearest to the limits is")
    assert max(map(len, drawn.texts[1:])) <= 15.5 * (drawn.width - 0.2)
    tops = [text.get_position()[1] for text in drawn.figure.texts[1:]]
    assert np.diff(tops) * drawn.height == pytest.approx([-0.21, *[-0.17] * (len(tops) - 2)])
    assert (1 - tops[-1]) * drawn.height + 0.1 < drawn.box(axes)[1]
    assert to_rgba(drawn.figure.texts[-1].get_color()) == (0, 0, 0, 1)
    assert drawn.legend == ["a leg too short"]


# --- layout, by inches -----------------------------------------------------------------------------------------------


def boxes(drawn: Drawn) -> tuple[list[Any], list[Any]]:
    """Maps and bars in the order of their creation."""
    found = [drawn.box(axes) for axes in drawn.figure.axes]
    return [box for box in found if box[2] > 0.2], [box for box in found if box[2] <= 0.2]


@pytest.mark.parametrize("kind", ["maps", "one map", "slices", "empty slices"])
def test_everything_has_its_place_on_the_figure(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: inches by hand: margins 0.65, 0.62, 0.98 and 0.62, maps of equal areas, lines of notices of 0.17.

    Maps stand in two columns, 1.32 apart, with 0.8 between rows; slices 0.12 apart, with 0.36 between rows.
    """
    free = replace(UNEVEN, leg_length_min=None, leg_length_max=None, joint_angle_max=None)
    make: dict[str, tuple[Workspace, int, int, float]] = {
        "maps": (sweep(free, {"x": (-0.2, 0.2), "y": (-0.15, 0.1)}, points=5), 3, 2, 0.625),
        "one map": (sweep(UNEVEN, {"x": (-0.1, 0.1), "y": (0.0, 0.4)}, {"z": 1.0}, points=5), 1, 1, 2.0),
        "slices": (sweep(UNEVEN, {"x": (-0.2, 0.2), "y": (-0.6, 0.6), "yaw": (0, 0.3)}, points=7), 4, 4, 3.0),
        "empty slices": (sweep(UNEVEN, {"x": (-0.2, 0.2), "yaw": (0, 0.1), "z": (0.5, 0.9)}, points=9), 1, 4, 0.85),
    }
    space, panels, columns, ratio = make[kind]
    if kind == "maps":  # three panels: no payload
        space = replace(space, qualities=space.qualities._replace(payload=None))
    drawn = Drawn(space, monkeypatch)
    maps, bars = boxes(drawn)
    is_volume = "slices" in kind
    width = (2.0 if is_volume else 3.3) / max(ratio, 0.9) ** 0.5
    height = width * ratio
    gap, between = (0.12, 0.36) if is_volume else (1.32, 0.8)
    rows = panels if is_volume else -(-panels // columns)
    count = len(drawn.texts) - 1
    assert (count > 0) == (kind != "slices")
    above = 0.62 + (0.5 if is_volume else 0.3) + 0.17 * count
    across = 0.65 + columns * width + (columns - 1) * gap + 0.62
    assert drawn.width == pytest.approx(across if is_volume else max(across, 5.5))
    assert drawn.height == pytest.approx(above + rows * height + (rows - 1) * between + 0.98)
    places = [divmod(k, columns) for k in range(panels * columns if is_volume else panels)]
    for (row, column), box in zip(places, maps, strict=True):
        expected = (0.65 + column * (width + gap), above + row * (height + between), width, height)
        assert box == pytest.approx(expected)
    with_bars = [k for k, (row, column) in enumerate(places) if (row > 0 and column == 3 if is_volume else k > 0)]
    assert len(bars) == len(with_bars)
    for k, bar in zip(with_bars, bars, strict=True):
        assert bar == pytest.approx((maps[k][0] + width + 0.08, maps[k][1], 0.11, height))
    if kind == "empty slices":  # of the whole range
        texts = [text.get_text() for axes in drawn.figure.axes for text in axes.texts]
        z = space.swept["z"]
        assert texts == ["z 0.55 m", "reachable", "z 0.65 m", "z 0.75 m", "z 0.85 m"]
        assert [z[k] for k in (1, 3, 5, 7)] == pytest.approx([0.55, 0.65, 0.75, 0.85])


def test_words_on_a_figure_have_their_places_and_styles(maps: Drawn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: by hand: inches from the top, sizes in points; titles bold, limits grey, notices black."""
    space = sweep(replace(UNEVEN, name="$x_1$"), {"x": (-0.1, 0.1), "y": (0.0, 0.1)}, {"z": 1.0}, points=5)
    drawn = Drawn(space, monkeypatch)
    title, limits, *notices = drawn.figure.texts
    assert title.get_text().startswith("Workspace of $x_1$ at z 1 m, roll ")
    for text, down, size, colour in (
        (title, 0.1, 10.5, None),
        (limits, 0.34, 8.5, "#555555"),
        *((each, 0.38 + 0.17 * k, 8.5, "#000000") for k, each in enumerate(notices, start=1)),
    ):
        assert text.get_position() == pytest.approx((0.01, 1 - down / drawn.height))
        assert (text.get_fontsize(), text.get_va(), text.get_ha()) == (size, "top", "left")
        assert text.get_parse_math() is False
        assert colour is None or to_hex(text.get_color()) == colour
    assert title.get_fontweight() == "bold"
    (legend,) = maps.figure.legends
    assert (legend._ncols, legend._loc, legend.borderaxespad) == (4, 3, 0.3)
    assert {text.get_fontsize() for text in legend.get_texts()} == {8.5}
    assert maps.figure.transFigure.inverted().transform(legend.get_bbox_to_anchor().p0) == pytest.approx([0, 0])


def _check_axes_of_slices(maps: list[Any]) -> None:
    """Grey frames without a grid; only the last row and the first column have numbers; heads above first ones."""
    for number, axes in enumerate(maps):
        row, column = divmod(number, 4)
        ticks = axes.xaxis.get_tick_params(), axes.yaxis.get_tick_params()
        assert (ticks[0]["labelbottom"], ticks[1]["labelleft"]) == (row == 3, column == 0)
        assert {to_hex(side.get_edgecolor()) for side in axes.spines.values()} == {"#bbbbbb"}
        assert all(side.get_visible() and side.get_linewidth() == 0.8 for side in axes.spines.values())
        assert not any(line.get_visible() for line in axes.get_xgridlines() + axes.get_ygridlines())
        assert to_hex(axes.get_facecolor()) == "#f0f0f0" or row == 0
        heads = [each for each in axes.texts if hasattr(each, "xy")]
        of_row = [(each.xyann, each.get_fontsize()) for each in heads if each.xy == (0, 1)]
        assert of_row == ([((0, 20 if row == 0 else 5), 10)] if column == 0 else [])
        of_map = [(each.xyann, each.get_ha()) for each in heads if each.xy == (0.5, 1)]
        assert of_map == ([((0, 4), "center")] if row == 0 else [])


# --- contour lines and bars ------------------------------------------------------------------------------------------


def near_reached(space: Workspace) -> Any:
    """Poses at most two steps from a reachable one, step by step along the axes."""
    reached = space.qualities.reachable
    near = np.zeros_like(reached)
    for i, k in np.argwhere(reached):
        for di in range(-2, 3):
            for dk in range(-(2 - abs(di)), 3 - abs(di)):
                if 0 <= i + di < near.shape[0] and 0 <= k + dk < near.shape[1]:
                    near[i + di, k + dk] = True
    return near


def lines_of(axes: Any, colour: str) -> list[float]:
    found = [c for c in axes.collections if c.get_edgecolor().size and to_hex(c.get_edgecolor()[0]) == colour]
    levels = [float(level) for each in found for level in getattr(each, "levels", [])]
    assert all(width == 0.7 for each in found for width in each.get_linewidths())
    return levels


ROUND = [1.2, 1.5, 2, 2.5, 3, 4, 5, 7, 10, 15, 20, 30, 50, 70, 100, 200, 500]


@pytest.mark.parametrize(
    ("least", "largest", "ticks"),
    [
        (2.0, 15.0, [2, 3, 5, 7, 10]),  # both ends are round numbers, and not lines
        (2.05, 2.9, [2.1, 2.25, 2.4, 2.55, 2.7, 2.85]),
        (1.1, 40.0, [2, 3, 5, 7, 10, 20, 30]),
        (1.1, 900.0, [2, 5, 10, 20, 50, 100, 200, 500]),
        (3.0, 5e4, [5, 10, 20, 50, 100, 200, 500, 1000]),
    ],
)
def test_condition_numbers_have_lines_and_ticks_at_round_numbers(
    least: float, largest: float, ticks: list[float], space: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: by hand: round numbers between the ends, at most seven; between close ends, even steps."""
    inside = space.qualities.reachable
    numbers = np.full(inside.shape, 0.6 * least)
    numbers[~inside & near_reached(space)] = 0.9 * least
    numbers[inside] = np.geomspace(least, largest, inside.sum())
    qualities = space.qualities._replace(condition_number=numbers, payload=None, force_margin=None)
    qualities = qualities._replace(leg_length_margin=None)
    drawn = Drawn(replace(space, qualities=qualities), monkeypatch)
    axes = next(each for each in drawn.figure.axes if "condition" in each.get_title() + each.get_title(loc="left"))
    end = min(largest, 1000.0)
    chosen = [level for level in ROUND if least < level < end]
    if len(chosen) < 3:
        chosen = [2.0, 2.2, 2.4, 2.6, 2.8, 3.0]  # five or six even steps
    chosen = chosen[:: -(-len(chosen) // 7)]
    near = numbers[near_reached(space)]
    chosen = [level for level in chosen if near.min() < level < near.max()]
    assert lines_of(axes, "#ffffff") == pytest.approx(chosen)
    bar = next(each for each in drawn.figure.axes if drawn.box(each)[2] <= 0.2)
    found = [tick for tick in bar.get_yticks() if least * (1 - 1e-9) <= tick <= end * (1 + 1e-9)]
    assert found == pytest.approx(ticks)
    norm = axes.images[0].norm
    assert (norm.vmin, norm.vmax) == pytest.approx((least, end))
    assert bar._colorbar.extend == ("max" if largest > end else "neither")


def test_results_and_stroke_have_lines_at_even_steps_with_their_numbers(
    space: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: by hand, within what is near the region; numbers stand two steps inside it or are hidden."""
    inside = space.qualities.reachable
    payload = np.full(inside.shape, 3.0)
    payload[inside] = np.linspace(10.0, 24.0, inside.sum())
    margin = np.full(inside.shape, -0.3)
    margin[inside] = np.linspace(0.0, 0.45, inside.sum())
    qualities = space.qualities._replace(payload=payload, leg_length_margin=margin, force_margin=None)
    drawn = Drawn(replace(space, qualities=qualities), monkeypatch)
    maps = {each.get_title() or each.get_title(loc="left"): each for each in drawn.figure.axes}
    lines = lines_of(maps["largest payload [kg]"], "#ffffff")
    assert lines == pytest.approx([10, 12, 14, 16, 18, 20, 22])
    stroke = lines_of(maps["reachable, with stroke left [m]"], "#8a8a8a")
    assert stroke == pytest.approx([0.1, 0.2, 0.3, 0.4])
    y, x = space.swept.values()
    shown = hidden = 0
    for axes, levels in ((maps["largest payload [kg]"], lines), (maps["reachable, with stroke left [m]"], stroke)):
        assert axes.texts
        for text in axes.texts:
            assert float(text.get_text()) in [float(f"{level:.3g}") for level in levels]
            assert text.get_fontsize() == 7
            place = text.get_position()
            at = abs(y - place[0]).argmin(), abs(x - place[1]).argmin()
            around = [(at[0] + i, at[1] + k) for i in range(-2, 3) for k in range(-2, 3) if abs(i) + abs(k) <= 2]
            is_well_inside = all(
                0 <= i < inside.shape[0] and 0 <= k < inside.shape[1] and inside[i, k] for i, k in around
            )
            assert text.get_visible() == is_well_inside
            shown, hidden = shown + is_well_inside, hidden + (not is_well_inside)
    assert shown
    assert hidden
    border = [c for c in maps["largest payload [kg]"].collections if list(getattr(c, "levels", [])) == [0]]
    assert [each.get_linewidths() for each in border] == [pytest.approx([1.1])]


def test_values_that_are_all_equal_or_missing_have_a_scale(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a scale that begins at the value; values that are not finite do not count and are drawn at its end."""
    inside = space.qualities.reachable
    payload = np.where(inside, 5.0, np.nan)
    force = np.where(inside, np.inf, 1.0)
    force[inside] = [7.0, *[np.inf] * (inside.sum() - 2), 9.0]
    qualities = space.qualities._replace(payload=payload, force_margin=force)
    qualities = qualities._replace(condition_number=np.full(inside.shape, 4.0))
    drawn = Drawn(replace(space, qualities=qualities), monkeypatch)
    maps = {each.get_title() or each.get_title(loc="left"): each for each in drawn.figure.axes}
    norms = {title: (each.images[0].norm.vmin, each.images[0].norm.vmax) for title, each in maps.items() if title}
    assert norms["largest payload [kg]"] == (5.0, 6.0)
    assert norms["condition number"] == pytest.approx((4.0, 4.04))
    assert norms["force margin [N]"] == (7.0, 9.0)
    image = np.asarray(maps["force margin [N]"].images[0].get_array()).T
    assert sorted(set(image[inside])) == [7.0, 9.0]
    assert set(np.asarray(maps["largest payload [kg]"].images[0].get_array()).T[~inside]) == {6.0}

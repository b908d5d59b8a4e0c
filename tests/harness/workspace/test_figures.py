"""What the figures of a workspace draw, read from matplotlib's own objects."""

from collections.abc import Callable
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
def space() -> Workspace:
    """Uneven, aside of home; all kinds of limits but the pitch."""
    return sweep(UNEVEN, {"y": (-1.9, 1.3), "x": (-1.0, 1.5)}, {"roll": 0.2, "yaw": -0.3}, points=31)


def test_maps_show_the_values_of_the_grid_where_they_belong(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: cells centred on the grid's points, the first coordinate to the right, inside ranges; colours by value.

    Contour lines of the stroke lie above 0 and below its largest value; the border is where the clearance is 0.
    """
    drawn = Drawn(space, monkeypatch)
    y, x = space.swept.values()
    step_y, step_x = y[1] - y[0], x[1] - x[0]
    maps = drawn.figure.axes
    bars = [axes for axes in maps if axes.get_label() == "<colorbar>" or not axes.images]
    shown = [axes for axes in maps if axes not in bars]
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


def test_maps_and_bars_line_up(space: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: two columns of equal maps with equal scales, a bar at the right of each map of values, and gaps.

    2.5 m over 3.2 m are 0.78 of the width.
    """
    drawn = Drawn(space, monkeypatch)
    boxes = [drawn.box(axes) for axes in drawn.figure.axes]
    maps = [box for box in boxes if box[2] > 1]
    bars = [box for box in boxes if box[2] <= 1]
    assert (drawn.name, len(maps), len(bars)) == ("workspace", 4, 3)
    for box in maps:
        assert box[2:] == pytest.approx(maps[0][2:])
        assert box[3] / box[2] == pytest.approx(2.5 / 3.2)
    assert maps[0][0] == pytest.approx(maps[2][0])
    assert maps[1][0] == pytest.approx(maps[3][0])
    assert maps[0][1] == pytest.approx(maps[1][1])
    assert maps[2][1] == pytest.approx(maps[3][1])
    assert maps[1][0] - maps[0][0] - maps[0][2] > 1
    assert maps[2][1] - maps[0][1] - maps[0][3] > 0.5
    for bar, box in zip(bars, maps[1:], strict=True):
        assert bar[0] - box[0] - box[2] == pytest.approx(0.08)
        assert (bar[1], bar[3]) == pytest.approx((box[1], box[3]))
        assert bar[2] == pytest.approx(0.11)
    assert min(box[0] for box in boxes) > 0.5
    assert max(box[0] + box[2] for box in boxes) < drawn.width - 0.3
    assert max(box[1] + box[3] for box in boxes) < drawn.height - 0.8
    assert drawn.texts[0] == limits_text(space)
    assert drawn.figure._suptitle.get_text() == f"Workspace of uneven at {fixed_text(space)}"
    assert drawn.figure._suptitle.get_parse_math() is False


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

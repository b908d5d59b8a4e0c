"""Maps in figures: what is drawn, read back from matplotlib's axes."""

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import LogNorm, to_hex

from gough_stewart.harness.report.chart import Axis, Chart, Map, Series
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.palette import KINDS
from gough_stewart.harness.report.quantities import ANGLE, FORCE, LENGTH, NUMBER, Quantity
from tests.support.figures import figures_drawn

_X, _Y = np.linspace(-0.3, 0.5, 17), np.linspace(0.1, 0.5, 9)
# a circle of 0.15 m about (0.1, 0.3)
_INSIDE = 0.15 - np.hypot(_X[None, :] - 0.1, _Y[:, None] - 0.3)
_VALUES = 10 ** (3 * _X[None, :] + 0 * _Y[:, None])


def _chart(values: Any, of: Map, quantity: Quantity = FORCE, y: Axis | None = None) -> Chart:
    rows = Axis("y", LENGTH, _Y) if y is None else y
    return Chart("force", Axis("x", LENGTH, _X), (Series("force", quantity, values),), "heat", rows, group="m", map=of)


def _figure(*charts: Chart) -> Any:
    with figures_drawn(is_rendered=False) as made:
        figures(Report("r", Verdict("v", "told"), (Section("s", charts),)), ("png",))
    (figure,) = made
    return figure


def _maps(figure: Any) -> list[Any]:
    return [axes for part in figure.subfigs for axes in part.axes if axes.get_label() != "<colorbar>" and axes.axison]


def test_colours_and_lines_end_at_the_border_and_the_scale_is_of_the_values_inside() -> None:
    """Expected: by hand: the circle; inside it x from -0.05 to 0.25 m, and 10 to the power of 3 x there."""
    figure = _figure(_chart(_VALUES, Map(_INSIDE, "log", point=(0.2, 0.35), point_name="home")))
    (axes,) = _maps(figure)
    mesh = next(each for each in axes.collections if each.get_array() is not None and np.size(each.get_array()) == 153)
    seen = _VALUES[_INSIDE > 0]
    assert isinstance(mesh.norm, LogNorm)
    assert (mesh.norm.vmin, mesh.norm.vmax) == pytest.approx((seen.min(), seen.max()))
    border = next(each for each in axes.collections if list(getattr(each, "levels", [])) == [0])
    points = np.concatenate([path.vertices for path in border.get_paths()])
    # millimetres; the border is linear between the points of the grid, 50 mm apart
    assert np.hypot(points[:, 0] - 100, points[:, 1] - 300) == pytest.approx(150, abs=4)
    clip, _ = mesh.get_clip_path().get_transformed_path_and_affine()
    corners = clip.vertices[np.isfinite(clip.vertices).all(axis=1)]
    assert np.hypot(corners[:, 0] - 100, corners[:, 1] - 300).max() < 160
    (cross,) = axes.lines
    assert cross.get_xydata()[0] == pytest.approx([200, 350])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "y [mm]")
    assert axes.get_aspect() == 1.0


def test_a_scale_of_three_decades_is_open_at_its_end() -> None:
    """Expected: of values from 1 to 10^6 the colours end at 1000, with an arrow."""
    values = 10.0 ** np.linspace(0, 6, _X.size) * np.ones((_Y.size, 1))
    figure = _figure(_chart(values, Map(np.ones_like(values), "log"), NUMBER, Axis("roll", ANGLE, _Y)))
    (axes,) = _maps(figure)
    (bar,) = [each for part in figure.subfigs for each in part.axes if each.get_label() == "<colorbar>"]
    assert bar._colorbar.norm.vmax == pytest.approx(1000)
    assert bar._colorbar.extend == "max"
    # lengths and angles have no common scale
    assert axes.get_aspect() == "auto"


def test_kinds_have_their_colours_and_names_and_reach_under_the_border() -> None:
    """Expected: beyond the circle kind 2 at the left and 1 at the right; no cell that the border crosses stays free."""
    codes = np.where(_INSIDE > 0, 0.0, np.where(_X[None, :] < 0.1, 2.0, 1.0))
    figure = _figure(_chart(codes, Map(_INSIDE, classes=("free", "right", "left", "never")), NUMBER))
    (axes,) = _maps(figure)
    mesh = next(each for each in axes.collections if np.size(each.get_array()) == 153)
    shown = np.asarray(mesh.get_array()).reshape(codes.shape)
    assert (shown[_INSIDE <= 0] == codes[_INSIDE <= 0]).all()
    crossed = (_INSIDE > 0) & (_INSIDE < 0.049)
    assert (shown[crossed] > 0).all()
    colours = [to_hex(mesh.cmap(mesh.norm(k))) for k in range(4)]
    assert colours == list(KINDS["light"][:4])
    (legend,) = [part.legends[0] for part in figure.subfigs]
    assert [text.get_text() for text in legend.get_texts()] == ["free", "right", "left"]


def test_slices_are_four_within_the_region_with_one_scale_and_one_bar() -> None:
    """Expected: of slices 2 to 9 with something inside, those at an eighth, three eighths and so on between them."""
    z = np.linspace(1, 2.1, 12)
    inside = np.stack([_INSIDE if 2 <= k <= 9 else -1 - abs(_INSIDE) for k in range(12)])
    values = np.stack([_VALUES + k for k in range(12)])
    of = Map(inside, slices=Axis("z", LENGTH, z), first=5, point=(0.1, 0.3), point_name="home")
    figure = _figure(_chart(values, of))
    maps = _maps(figure)
    chosen = [round(2 + share * 7) for share in (0.125, 0.375, 0.625, 0.875)]
    titles = [axes.get_title(loc="left") or axes.get_title() for axes in maps]
    assert [float(title.split()[1]) for title in titles] == pytest.approx([1e3 * z[k] for k in chosen], rel=5e-3)
    meshes = [next(e for e in axes.collections if np.size(e.get_array()) == 153) for axes in maps]
    seen = values[inside > 0]
    assert {(m.norm.vmin, m.norm.vmax) for m in meshes} == {(seen.min(), seen.max())}
    for mesh, k in zip(meshes, chosen, strict=True):
        assert np.asarray(mesh.get_array()).reshape(_INSIDE.shape)[_INSIDE > 0] == pytest.approx(values[k][_INSIDE > 0])
    assert len([each for part in figure.subfigs for each in part.axes if each.get_label() == "<colorbar>"]) == 1
    assert [len(axes.lines) for axes in maps] == [int(k == 5) for k in chosen]

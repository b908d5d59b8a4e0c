"""Figures of a report's charts: what is drawn, read back from matplotlib's axes."""

import math
import signal
import warnings
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from lxml import etree
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.colors import LogNorm, to_hex
from matplotlib.figure import Figure
from PIL import Image

import gough_stewart as gs
from gough_stewart.harness.report.chart import Axis, Chart, Map, Mark, Series, Span, Strip, strip_of, time_axis
from gough_stewart.harness.report.document import Report, Section, Setting, Verdict
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.palette import KINDS, Role, colour_of
from gough_stewart.harness.report.plotting import entitle
from gough_stewart.harness.report.quantities import ANGLE, COUNT, DECIBEL, FORCE, FREQUENCY, LENGTH, NUMBER, SHARE
from tests.support.figures import figures_drawn

_TIME = np.linspace(7.3, 9.3, 51)


def _series(name: str, values: Any, role: Any = "actual", **more: Any) -> Series:
    return Series(name, more.pop("quantity", LENGTH), np.asarray(values, dtype=float), role, **more)


def _chart(title: str, *series: Series, kind: Any = "line", **more: Any) -> Chart:
    return Chart(title, time_axis(_TIME), series, kind, **more)


def _report(*charts: Chart, status: Any = "told", text: str = "v") -> Report:
    hidden = _chart("hidden", _series("x", _TIME), detail=True)
    sections = (Section("a", (*charts, hidden)), Section("b", charts, detail=True))
    return Report("heave $1 台 $\\frac{c$", Verdict(text, status), sections)


def _figures(*charts: Chart) -> list[Any]:
    """The figures as they are saved."""
    with figures_drawn() as made:
        figures(_report(*charts), ("png",))
    return list(made)


def _drawn(*charts: Chart) -> list[Any]:
    """The axes of all figures."""
    return [axes for figure in _figures(*charts) for axes in figure.axes]


def _figure(*charts: Chart) -> Any:
    (figure,) = _figures(*charts)
    return figure


# --- files -----------------------------------------------------------------------------------------------------------


def test_each_group_is_a_figure_in_every_format_and_the_same_each_time() -> None:
    """Expected: 8 inches of 72 points in the SVG, of 150 pixels in the PNG; no date; letters that the font lacks."""
    one = _chart("Position, x", _series("x", np.sin(_TIME)), group="pose")
    other = _chart("Position, y", _series("y", np.cos(_TIME)), group="pose")
    alone = _chart("Forces of all", _series("x", _TIME, quantity=FORCE))
    found = figures(_report(alone, one, other, alone))
    names = ("forces-of-all", "pose", "forces-of-all-2")
    assert list(found) == [f"{name}.{kind}" for name in names for kind in ("pdf", "png", "svg")]
    for kind, start in (("pdf", b"%PDF"), ("png", b"\x89PNG"), ("svg", b"<?xml")):
        assert found[f"pose.{kind}"].startswith(start)
    with warnings.catch_warnings():  # a missing glyph is worth none
        warnings.simplefilter("error")
        again = figures(_report(one, other))
    assert again == {name: each for name, each in found.items() if name.startswith("pose")}
    root: Any = etree.fromstring(found["pose.svg"])
    assert (root.tag.rpartition("}")[2], root.get("width")) == ("svg", "576pt")
    assert b"dc:date" not in found["pose.svg"]
    with Image.open(BytesIO(found["pose.png"])) as picture:
        assert (picture.format, picture.width) == ("PNG", 1200)


def test_a_long_title_is_on_the_paper_as_a_whole_and_says_what_did_not_go_well() -> None:
    """Expected: within the width by matplotlib's own measure of its letters, and every word of it."""
    figure = Figure(figsize=(8, 3))
    title = "heave step on a thousand machines: position error, peak [mm] against what varies; 12 of 42 inputs"
    entitle(figure, title)
    (text,) = figure.texts
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    box = text.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert text.get_text().split() == title.split()
    for status, is_said in (("good", False), ("bad", True), ("marginal", True), ("told", False)):
        report = _report(_chart("x", _series("x", _TIME)), status=status, text="Diverged: leg 3 costs $5")
        report = replace(report, settings=(Setting("loop.delay", ("2",), "1"),))
        drawn = figures(report, ("svg",))["x.svg"]
        assert (b"Diverged: leg 3 costs $5" in drawn, b"(loop.delay = 2)" in drawn) == (is_said, True)


def test_ctrl_c_while_matplotlib_writes_comes_at_the_end_of_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the interrupt, and Matplotlib's C++, which would make another error of it, was not broken off."""
    ended, real = list[str](), Figure.savefig

    def interrupted(figure: Figure, *arguments: Any, **options: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        ended.append(options["format"])
        real(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            figures(_report(_chart("x", _series("x", _TIME))), ("png", "svg"))
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == ["png"]


# --- lines and bars --------------------------------------------------------------------------------------------------


def test_values_are_in_the_unit_that_the_title_names() -> None:
    """Expected: by hand, also of marks near enough; values with names have these on the axis, and no title."""
    limits = (Mark(2e-3, "limit"), Mark(-1.5e-3, "limit"), Mark(9.0, "far"), Mark(8.0, "worst", "vertical", "bad"))
    (axes,) = _drawn(_chart("error", _series("x", 1e-3 * np.sin(_TIME), "error"), marks=limits))
    assert (axes.get_title(loc="left"), axes.get_xlabel()) == ("error [mm]", "time [s]")
    line, *marks = axes.lines
    assert np.allclose(line.get_xdata(), _TIME)
    assert np.allclose(line.get_ydata(), np.sin(_TIME))
    ends = [*(float(each.get_ydata()[0]) for each in marks[:2]), *(float(each.get_xdata()[0]) for each in marks[2:])]
    assert ends == [2.0, -1.5, 8.0]
    assert to_hex(line.get_color()) == colour_of("error")
    flag = _series("leg 1", np.asarray(_TIME > 8, dtype=float), quantity=NUMBER)
    (axes,) = _drawn(_chart("limit", flag, kind="step", y=Axis("", labels=("no", "yes"))))
    ticks = zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)
    assert [(at, text.get_text()) for at, text in ticks] == [(0, "no"), (1, "yes")]
    assert axes.get_ylabel() == ""


def test_components_with_a_reference_get_a_panel_each() -> None:
    parts = {"x": np.sin(_TIME), "y": 1e-5 * np.cos(_TIME), "z": np.cos(_TIME)}
    series = [
        each
        for name, values in parts.items()
        for each in (
            _series(name, values, component=name),
            _series(f"{name}, reference", values + 1e-3, "reference", component=name),
        )
    ]
    axes_of = _drawn(_chart("position", *series))
    assert [axes.get_title(loc="left") for axes in axes_of] == [f"position, {name} [mm]" for name in parts]
    for axes, values in zip(axes_of, parts.values(), strict=True):
        actual, reference = axes.lines
        assert np.allclose(actual.get_ydata(), 1e3 * values)
        assert np.allclose(reference.get_ydata(), 1e3 * values + 1)
        assert reference.get_zorder() > actual.get_zorder()
        assert reference.get_linestyle() != actual.get_linestyle()
    # the axis of y, which hardly moves, spans a fiftieth of that of z, whose reference is 1 mm above it
    low, high = axes_of[1].get_ylim()
    assert high - low == pytest.approx((1e3 * np.ptp(np.cos(_TIME)) + 1) / 50, rel=1e-3)


def test_lines_that_hide_each_other_are_one_with_all_names() -> None:
    """Expected: of six legs, those that stay together; on a logarithmic axis by their ratio, a thousandth apart."""
    shape = 1e3 * np.sin(_TIME)
    values = [shape, shape + 1, shape + 500, shape + 1e-9, np.where(_TIME > 9, 0, shape), shape]
    series = [_series(f"leg {k + 1}", each, quantity=FORCE, leg=k + 1) for k, each in enumerate(values)]
    (axes,) = _drawn(_chart("force", *series, kind="step"))
    assert [line.get_label() for line in axes.lines] == ["leg 1, leg 2, leg 4, leg 6", "leg 3", "leg 5"]
    assert {line.get_drawstyle() for line in axes.lines} == {"steps-post"}
    same = [_series(f"leg {k + 1}", shape, quantity=FORCE, leg=k + 1) for k in range(6)]
    (axes,) = _drawn(_chart("force", *same))
    assert [line.get_label() for line in axes.lines] == ["legs 1–6"]
    gain = np.geomspace(1e-6, 1, 51)
    parts = {"a": gain, "b": 1.001 * gain, "c": np.where(gain < 1e-4, 1.5 * gain, gain)}
    log = Axis("gain", LENGTH, scale="log")
    (axes,) = _drawn(_chart("gain", *(_series(name, each) for name, each in parts.items()), y=log))
    assert [line.get_label() for line in axes.lines] == ["a, b", "c"]


def test_no_two_lines_look_the_same() -> None:
    """Expected: a colour or dashes of its own for each of eleven limits, and of two runs, three axes and references."""
    roles: tuple[Role, ...] = ("actual", "reference")
    cases = [(run, axis, role) for run in (0, 1) for axis in "xyz" for role in roles]
    of_runs = [
        _series(f"{k}", _TIME * (k + 1.3), role, run=run, component=axis) for k, (run, axis, role) in enumerate(cases)
    ]
    for series in ([_series(f"limit {k}", _TIME + k) for k in range(11)], of_runs):
        (axes,) = _drawn(_chart("shares", *series))
        looks = {(line.get_color(), str(line._unscaled_dash_pattern)) for line in axes.lines}
        assert len(looks) == len(axes.lines) == len(series)
    (axes,) = _drawn(_chart("states", *(_series(f"{k}", _TIME + k) for k in range(8))))
    of_eight = [(line.get_color(), str(line._unscaled_dash_pattern)) for line in axes.lines]
    assert of_eight[6:] == [
        (of_eight[k][0], of_eight[k + 1][1]) for k in range(2)
    ]  # six colours, then with the next dashes


def test_bars_have_labels_intervals_and_the_first_on_top() -> None:
    alone = _series("alone", [0.6, 0.3], quantity=SHARE, low=[0.5, 0.25], high=[0.9, 0.4])
    total = _series("total", [0.7, 0.4], quantity=SHARE)
    (axes,) = _drawn(Chart("why", Axis("", labels=("mass", "gain")), (alone, total), "bars"))
    assert [text.get_text() for text in axes.get_yticklabels()] == ["mass", "gain"]
    assert axes.yaxis.get_inverted()
    assert [round(bar.get_width(), 9) for bar in axes.patches] == [60, 30, 70, 40]
    (ends,) = [each for each in axes.collections if hasattr(each, "get_segments")]
    assert np.allclose([each[:, 0] for each in ends.get_segments()], [[50, 90], [25, 40]])
    assert axes.get_xlabel() == "share [%]"


def test_a_band_is_between_its_ends_in_the_unit_of_its_axes() -> None:
    """Expected: by hand, on a logarithmic abscissa, and by the factor of each unit."""
    frequency = np.geomspace(0.1, 100, 9)
    values = -20 * np.log10(frequency)
    response = _series("L", values, "measured", quantity=DECIBEL, low=values - 3, high=values + 2)
    chart = Chart("Bode", Axis("frequency", FREQUENCY, frequency, scale="log"), (response,), y=Axis("|L|", DECIBEL))
    (axes,) = _drawn(chart)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert (axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()) == ("Bode", "frequency [Hz]", "|L| [dB]")
    corners = axes.collections[0].get_paths()[0].vertices
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((-43, 22))
    for quantity, factor in ((LENGTH, 1e3), (ANGLE, 180 / math.pi), (SHARE, 100.0)):
        line, low, high = (scale * np.arange(1.0, 4.0) for scale in (0.02, 0.015, 0.03))
        series = _series("x", line, "measured", quantity=quantity, low=low, high=high)
        (axes,) = _drawn(Chart("x", time_axis([0.0, 1.0, 2.0]), (series,)))
        corners = axes.collections[0].get_paths()[0].vertices
        assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((0.015 * factor, 0.09 * factor))
        assert axes.lines[0].get_ydata() == pytest.approx(factor * line)


def test_a_histogram_has_its_counts_between_its_edges_and_points_their_own_abscissae() -> None:
    edges = Axis("peak", LENGTH, np.array([0, 1e-3, 3e-3]))
    chart = Chart("peak", edges, (_series("n", [4, 7], quantity=COUNT),), "histogram")
    points = Chart("peak", Axis("mass", COUNT), (_series("a", [1e-3, 2e-3], "good", x=np.array([5.0, 3.0])),), "points")
    histogram, scatter = _drawn(chart, points)
    values, ends, _ = histogram.patches[0].get_data()
    assert (values.tolist(), ends.tolist()) == ([4, 7], [0, 1, 3])
    assert np.allclose(scatter.lines[0].get_xydata(), [[5, 1], [3, 2]])


@pytest.mark.parametrize("values", [[math.nan], [1e305, -1e305, 0], []])
def test_odd_values_are_drawn(values: list[float]) -> None:
    time = time_axis([7.3 + k for k in range(len(values))])
    assert figures(_report(Chart("odd", time, (_series("x", values), _series("y", values)))), ("svg",))


def test_small_panels_are_named_by_their_charts_and_have_one_legend_for_each_kind() -> None:
    """Expected: four panels in two columns with the names of their series; another kind below has its own legend."""
    pairs = [
        _chart(f"leg {k}", _series("run", _TIME), _series("model", k * _TIME, "nominal"), group="g")
        for k in range(1, 5)
    ]
    above, below = _figure(*pairs, _chart("rest", _series("x", _TIME), group="g")).subfigs
    assert [axes.get_title(loc="left") for axes in above.axes] == [f"leg {k} [mm]" for k in range(1, 5)]
    grid = above.axes[0].get_gridspec()
    assert (grid.nrows, grid.ncols) == (2, 2)
    (legend,) = above.legends
    assert [text.get_text() for text in legend.get_texts()] == ["run", "model"]
    assert [axes.get_xlabel() for axes in above.axes] == ["", "", "time [s]", "time [s]"]
    assert ([axes.get_title(loc="left") for axes in below.axes], below.legends) == (["rest [mm]"], [])


# --- margins, and when limits act ------------------------------------------------------------------------------------

_ROWS = np.array([7.0, 7.5, 8.5, 9.0, 10.0, 11.0])


def test_a_strip_has_the_time_from_each_row_to_the_next() -> None:
    """Expected: by hand; the last row has no next one, so what holds there alone takes no time."""
    found = strip_of("force", _ROWS, [0, 1, 1, 0, 1, 1])
    assert found == Strip("force", ((7.5, 9.0), (10.0, 11.0)), "limit", 2.5 / 4.0)
    assert strip_of("force", _ROWS, [0, 0, 0, 0, 0, 1]) is None
    assert strip_of("force", _ROWS, np.ones(6)) == Strip("force", ((7.0, 11.0),), "limit", 1.0)
    time = np.arange(6001) + 0.2 * np.isin(np.arange(6001) % 6, (2,))
    many = strip_of("force", time, np.arange(6001) % 2 == 0)
    assert many is not None
    assert (len(many.intervals), many.intervals[0][0], many.intervals[-1][1]) == (1000, 0.0, 5999.0)
    assert many.share == pytest.approx((3000 - 0.2 * 1000) / 6000)
    gaps = [b[0] - a[1] for a, b in zip(many.intervals, many.intervals[1:], strict=False)]
    assert gaps == pytest.approx(np.full(999, 1.2))


def test_margins_and_strips_are_drawn_in_the_units_of_their_axes() -> None:
    """Expected: bars and a line at the given places, below all curves."""
    strip, span = strip_of("force at its limit", _ROWS, [0, 1, 1, 0, 1, 1], "bad"), Span(9.5, 1e-3, 4e-3, "3 mm left")
    assert strip is not None
    error = Series("x", LENGTH, np.array([1.0, 2, 3, 2, 1, 5]) * 1e-3)
    plain = Chart("error", time_axis(_ROWS), (error,))
    chart = Chart("error", time_axis(_ROWS), (error,), strips=(strip,), spans=(span,), marks=(Mark(1.0, "a"),))
    (without,), (axes,) = _drawn(plain), _drawn(chart)
    (bars,) = axes.collections
    ends = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bars.get_paths()]
    assert ends == [(7.5, 9.0), (10.0, 11.0)]
    assert to_hex(bars.get_facecolor()[0]) == colour_of("bad")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["x", "force at its limit, 62 %"]
    line = axes.lines[1]
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([9.5, 9.5], [1.0, 4.0])
    assert [text.get_horizontalalignment() for text in axes.texts if text.get_text() == "3 mm left"] == ["right"]
    assert (axes.get_xlim(), axes.get_ylim()[1]) == (without.get_xlim(), without.get_ylim()[1])
    top = max(path.vertices[:, 1].max() for path in bars.get_paths())
    (low, high), (lowest, _) = axes.get_ylim(), without.get_ylim()
    assert low + top * (high - low) <= lowest + 1e-9 * high


def test_the_margins_of_a_loop_are_drawn_where_they_are() -> None:
    """Expected: the least phase margin of the legs from half a turn on, and the frequency of the disk margin."""
    found = gs.margins("heave_step", {"controller.bandwidth": 6})
    _, phase, both = (chart for chart in found.report().charts if chart.group == "bode")
    (left,), least = phase.spans, min(leg.phase for leg in found.legs)
    assert (left.low, left.high) == pytest.approx((-math.pi, least - math.pi), abs=1e-3)  # read from the curve
    assert left.text == f"phase margin {math.degrees(least):.1f} deg at {left.at:.1f} Hz, any leg"
    assert [mark.value for mark in both.marks] == [1.0, found.disk.frequency]


# --- maps ------------------------------------------------------------------------------------------------------------

_X, _Y = np.linspace(-0.3, 0.5, 17), np.linspace(0.1, 0.5, 9)
# a circle of 0.15 m about (0.1, 0.3)
_INSIDE = 0.15 - np.hypot(_X[None, :] - 0.1, _Y[:, None] - 0.3)
_VALUES = 10 ** (3 * _X[None, :] + 0 * _Y[:, None])


def _map(values: Any, over: Map, quantity: Any = FORCE, y: Axis | None = None) -> Chart:
    rows = Axis("y", LENGTH, _Y) if y is None else y
    return Chart("force", Axis("x", LENGTH, _X), (Series("force", quantity, values),), "heat", rows, map=over)


def _maps(figure: Any) -> tuple[list[Any], list[Any]]:
    """Axes of maps, and of bars of colours."""
    axes = [axes for part in figure.subfigs for axes in part.axes if axes.axison]
    return [a for a in axes if a.get_label() != "<colorbar>"], [a for a in axes if a.get_label() == "<colorbar>"]


def _mesh(axes: Any) -> Any:
    return next(each for each in axes.collections if each.get_array() is not None and np.size(each.get_array()) == 153)


def test_colours_and_lines_end_at_the_border_and_the_scale_is_of_the_values_inside() -> None:
    """Expected: by hand: the circle; inside it x from -0.05 to 0.25 m, and 10 to the power of 3 x there."""
    (axes,), _ = _maps(_figure(_map(_VALUES, Map(_INSIDE, "log", point=(0.2, 0.35), point_name="home"))))
    mesh, seen = _mesh(axes), _VALUES[_INSIDE > 0]
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
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [mm]", "y [mm]", 1.0)


def test_a_scale_of_three_decades_is_open_at_its_end() -> None:
    """Expected: of values from 1 to 10^6 the colours end at 1000, with an arrow; no common scale of mm and degrees."""
    values = 10.0 ** np.linspace(0, 6, _X.size) * np.ones((_Y.size, 1))
    figure = _figure(_map(values, Map(np.ones_like(values), "log"), NUMBER, Axis("roll", ANGLE, _Y)))
    (axes,), (bar,) = _maps(figure)
    assert (bar._colorbar.norm.vmax, bar._colorbar.extend, axes.get_aspect()) == (pytest.approx(1000), "max", "auto")


def test_kinds_have_their_colours_and_names_and_reach_under_the_border() -> None:
    """Expected: beyond the circle kind 2 at the left and 1 at the right; no cell that the border crosses stays free."""
    codes = np.where(_INSIDE > 0, 0.0, np.where(_X[None, :] < 0.1, 2.0, 1.0))
    figure = _figure(_map(codes, Map(_INSIDE, classes=("free", "right", "left", "never")), NUMBER))
    (axes,), _ = _maps(figure)
    mesh = _mesh(axes)
    shown = np.asarray(mesh.get_array()).reshape(codes.shape)
    assert (shown[_INSIDE <= 0] == codes[_INSIDE <= 0]).all()
    assert (shown[(_INSIDE > 0) & (_INSIDE < 0.049)] > 0).all()
    assert [to_hex(mesh.cmap(mesh.norm(k))) for k in range(4)] == list(KINDS["light"][:4])
    (legend,) = (part.legends[0] for part in figure.subfigs)
    assert [text.get_text() for text in legend.get_texts()] == ["free", "right", "left"]


def test_slices_are_four_within_the_region_with_one_scale_and_one_bar() -> None:
    """Expected: of slices 2 to 9 with something inside, those at an eighth, three eighths and so on between them."""
    z = np.linspace(1, 2.1, 12)
    inside = np.stack([_INSIDE if 2 <= k <= 9 else -1 - abs(_INSIDE) for k in range(12)])
    values = np.stack([_VALUES + k for k in range(12)])
    over = Map(inside, slices=Axis("z", LENGTH, z), first=5, point=(0.1, 0.3), point_name="home")
    maps, bars = _maps(_figure(_map(values, over)))
    chosen: Sequence[int] = [round(2 + share * 7) for share in (0.125, 0.375, 0.625, 0.875)]
    titles = [axes.get_title(loc="left") for axes in maps]
    assert [float(title.split()[1]) for title in titles] == pytest.approx([1e3 * z[k] for k in chosen], rel=5e-3)
    meshes, seen = list(map(_mesh, maps)), values[inside > 0]
    assert {(mesh.norm.vmin, mesh.norm.vmax) for mesh in meshes} == {(seen.min(), seen.max())}
    for mesh, k in zip(meshes, chosen, strict=True):
        assert np.asarray(mesh.get_array()).reshape(_INSIDE.shape)[_INSIDE > 0] == pytest.approx(values[k][_INSIDE > 0])
    assert ([len(axes.lines) for axes in maps], len(bars)) == ([int(k == 5) for k in chosen], 1)


def test_a_heat_map_leaves_gaps_where_there_is_no_value_and_has_labels_on_both_axes() -> None:
    """Expected: by hand; names stand at the left with the first on top, and upright below if they are long."""
    values = np.array([[0.1, np.nan, 0.3], [0.4, 0.5, 0.6]])
    x, y = Axis("x", LENGTH, np.array([0, 1e-3, 2e-3])), Axis("y", LENGTH, np.array([5e-3, 6e-3]))
    axes, bar = _drawn(Chart("reach", x, (_series("volume", values, quantity=SHARE),), "heat", y))
    (mesh,) = (each for each in axes.collections if isinstance(each, QuadMesh))
    shown: Any = mesh.get_array()
    assert np.ma.getmaskarray(shown).tolist() == np.isnan(values).tolist()
    assert np.ma.filled(shown, 0).ravel()[5] == pytest.approx(60)
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("x [mm]", "y [mm]", "volume [%]")
    named = Axis("parameter", COUNT, np.arange(2.0), ("mass", "gain"))
    correlation = _series("r", [[1, -0.5], [-0.5, 1]], quantity=COUNT)
    axes, _ = _drawn(Chart("correlation", named, (correlation,), "heat", y=named))
    for ticks in (axes.get_xticklabels(), axes.get_yticklabels()):
        assert [each.get_text() for each in ticks] == ["mass", "gain"]
    assert (axes.yaxis.get_inverted(), axes.get_xticklabels()[0].get_rotation()) == (True, 90)

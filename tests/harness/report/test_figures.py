"""Figures of a report's charts: what is drawn, read back from matplotlib's axes."""

import math
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex

from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, time_axis
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.palette import Role, colour_of
from gough_stewart.harness.report.quantities import (
    ANGLE,
    COUNT,
    DECIBEL,
    FORCE,
    FREQUENCY,
    LENGTH,
    NUMBER,
    SHARE,
    Quantity,
)
from tests.support.drawn_figures import drawn
from tests.support.figures import figures_drawn

_TIME = np.linspace(7.3, 9.3, 51)


def _series(name: str, values: Any, role: Any = "actual", **more: Any) -> Series:
    return Series(name, more.pop("quantity", LENGTH), np.asarray(values, dtype=float), role, **more)


def _report(*charts: Chart) -> Report:
    hidden = Chart("hidden", time_axis(_TIME), (_series("x", _TIME),), detail=True)
    return Report(
        "heave $1", Verdict("v", "told"), (Section("a", (*charts, hidden)), Section("b", charts, detail=True))
    )


def _drawn(*charts: Chart) -> list[Any]:
    """The axes of all figures."""
    return [axes for figure in drawn(_report(*charts)).values() for axes in figure]


def test_each_group_is_a_figure_in_every_format_and_the_same_each_time() -> None:
    one = Chart("Position, x", time_axis(_TIME), (_series("x", np.sin(_TIME)),), group="pose")
    other = Chart("Position, y", time_axis(_TIME), (_series("y", np.cos(_TIME)),), group="pose")
    alone = Chart("Forces of all", time_axis(_TIME), (_series("x", _TIME, quantity=FORCE),))
    found = figures(_report(alone, one, other, alone))
    names = ("forces-of-all", "pose", "forces-of-all-2")
    assert list(found) == [f"{name}.{kind}" for name in names for kind in ("pdf", "png", "svg")]
    assert found["pose.pdf"].startswith(b"%PDF")
    assert found["pose.png"].startswith(b"\x89PNG")
    assert b"<svg" in found["pose.svg"]
    assert figures(_report(one, other)) == {name: each for name, each in found.items() if name.startswith("pose")}


def test_values_are_in_the_unit_that_the_title_names() -> None:
    limits = (Mark(2e-3, "limit"), Mark(-1.5e-3, "limit"), Mark(9.0, "far"), Mark(8.0, "worst", "vertical", "bad"))
    chart = Chart("error", time_axis(_TIME), (_series("x", 1e-3 * np.sin(_TIME), "error"),), marks=limits)
    (axes,) = _drawn(chart)
    assert (axes.get_title(loc="left") or axes.get_title(), axes.get_xlabel()) == ("error [mm]", "time [s]")
    line, *marks = axes.lines
    assert np.allclose(line.get_xdata(), _TIME)
    assert np.allclose(line.get_ydata(), np.sin(_TIME))
    assert [float(each.get_ydata()[0]) for each in marks[:2]] == [2.0, -1.5]
    assert float(marks[2].get_xdata()[0]) == 8.0
    assert len(marks) == 3
    assert to_hex(line.get_color()) == colour_of("error")


def test_values_with_names_have_them_on_the_axis() -> None:
    """Expected: 0 is no and 1 is yes, and no title says number."""
    values = np.asarray(_TIME > 8, dtype=float)
    step = _series("leg 1", values, quantity=NUMBER)
    (axes,) = _drawn(Chart("limit", time_axis(_TIME), (step,), "step", y=Axis("", labels=("no", "yes"))))
    assert [(at, text.get_text()) for at, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)] == [
        (0, "no"),
        (1, "yes"),
    ]
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
    panels = _drawn(Chart("position", time_axis(_TIME), tuple(series)))
    assert [axes.get_title() for axes in panels] == [f"position, {name} [mm]" for name in parts]
    for axes, values in zip(panels, parts.values(), strict=True):
        actual, reference = axes.lines
        assert np.allclose(actual.get_ydata(), 1e3 * values)
        assert np.allclose(reference.get_ydata(), 1e3 * values + 1)
        assert reference.get_zorder() > actual.get_zorder()
        assert reference.get_linestyle() != actual.get_linestyle()
    # the axis of y, which hardly moves, spans a fiftieth of that of z, whose reference is 1 mm above it
    low, high = panels[1].get_ylim()
    assert high - low == pytest.approx((1e3 * np.ptp(np.cos(_TIME)) + 1) / 50, rel=1e-3)


def test_lines_that_hide_each_other_are_one_with_all_names() -> None:
    shape = 1e3 * np.sin(_TIME)
    values = [shape, shape + 1, shape + 500, shape + 1e-9, np.where(_TIME > 9, 0, shape), shape]
    series = [_series(f"leg {k + 1}", each, quantity=FORCE, leg=k + 1) for k, each in enumerate(values)]
    (axes,) = _drawn(Chart("force", time_axis(_TIME), tuple(series), "step"))
    assert [line.get_label() for line in axes.lines] == ["leg 1, leg 2, leg 4, leg 6", "leg 3", "leg 5"]
    assert {line.get_drawstyle() for line in axes.lines} == {"steps-post"}
    same = [_series(f"leg {k + 1}", shape, quantity=FORCE, leg=k + 1) for k in range(6)]
    (axes,) = _drawn(Chart("force", time_axis(_TIME), tuple(same)))
    assert [line.get_label() for line in axes.lines] == ["legs 1–6"]


def test_bars_have_labels_intervals_and_the_first_on_top() -> None:
    alone = _series("alone", [0.6, 0.3], quantity=SHARE, low=[0.5, 0.25], high=[0.9, 0.4])
    total = _series("total", [0.7, 0.4], quantity=SHARE)
    chart = Chart("why", Axis("", labels=("mass", "gain")), (alone, total), "bars")
    (axes,) = _drawn(chart)
    assert [text.get_text() for text in axes.get_yticklabels()] == ["mass", "gain"]
    assert axes.yaxis.get_inverted()
    assert [round(bar.get_width(), 9) for bar in axes.patches] == [60, 30, 70, 40]
    (ends,) = [each for each in axes.collections if hasattr(each, "get_segments")]
    assert np.allclose([each[:, 0] for each in ends.get_segments()], [[50, 90], [25, 40]])
    assert axes.get_xlabel() == "share [%]"


def test_a_band_is_between_its_ends_on_logarithmic_axes() -> None:
    frequency = np.geomspace(0.1, 100, 9)
    values = -20 * np.log10(frequency)
    response = _series("L", values, "measured", quantity=DECIBEL, low=values - 3, high=values + 2)
    chart = Chart("Bode", Axis("frequency", FREQUENCY, frequency, scale="log"), (response,), y=Axis("|L|", DECIBEL))
    (axes,) = _drawn(chart)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == ("Bode", "frequency [Hz]", "|L| [dB]")
    corners = axes.collections[0].get_paths()[0].vertices
    assert corners[:, 1].max() == pytest.approx(22)
    assert corners[:, 1].min() == pytest.approx(-43)


@pytest.mark.parametrize(("quantity", "factor"), [(LENGTH, 1e3), (ANGLE, 180 / math.pi), (SHARE, 100.0)])
def test_a_band_and_its_line_are_in_the_unit_of_the_axis(quantity: Quantity, factor: float) -> None:
    values, low, high = ([scale * each for each in (1.0, 2.0, 3.0)] for scale in (0.02, 0.015, 0.03))
    series = _series("x", values, "measured", quantity=quantity, low=low, high=high)
    (axes,) = _drawn(Chart("x", time_axis([0.0, 1.0, 2.0]), (series,)))
    corners = axes.collections[0].get_paths()[0].vertices
    assert (corners[:, 1].min(), corners[:, 1].max()) == pytest.approx((0.015 * factor, 0.09 * factor))
    assert axes.lines[0].get_ydata() == pytest.approx([0.02 * factor, 0.04 * factor, 0.06 * factor])


def test_a_histogram_has_its_counts_between_its_edges_and_points_their_own_abscissae() -> None:
    chart = Chart(
        "peak", Axis("peak", LENGTH, np.array([0, 1e-3, 3e-3])), (_series("n", [4, 7], quantity=COUNT),), "histogram"
    )
    points = Chart("peak", Axis("mass", COUNT), (_series("a", [1e-3, 2e-3], "good", x=np.array([5.0, 3.0])),), "points")
    histogram, scatter = _drawn(chart, points)
    values, edges, _ = histogram.patches[0].get_data()
    assert (values.tolist(), edges.tolist()) == ([4, 7], [0, 1, 3])
    assert np.allclose(scatter.lines[0].get_xydata(), [[5, 1], [3, 2]])


def test_a_heat_map_leaves_gaps_where_there_is_no_value() -> None:
    values = np.array([[0.1, np.nan, 0.3], [0.4, 0.5, 0.6]])
    chart = Chart(
        "reach", Axis("x", LENGTH, np.array([0, 1e-3, 2e-3])), (_series("volume", values, quantity=SHARE),), "heat",
        Axis("y", LENGTH, np.array([5e-3, 6e-3])),
    )  # fmt: skip
    axes, bar = _drawn(chart)
    (mesh,) = [each for each in axes.collections if isinstance(each, QuadMesh)]
    shown = mesh.get_array()
    assert shown is not None
    assert np.ma.getmaskarray(shown).tolist() == np.isnan(values).tolist()
    assert np.ma.filled(shown, 0).ravel()[5] == pytest.approx(60)
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("x [mm]", "y [mm]", "volume [%]")


@pytest.mark.parametrize("values", [[math.nan], [1e305, -1e305, 0], [1e-300, 0, 2e-300], [3.0, 3.0, 3.0], []])
def test_odd_values_are_drawn(values: list[float]) -> None:
    time = time_axis([7.3 + k for k in range(len(values))])
    assert figures(_report(Chart("odd", time, (_series("x", values), _series("y", values)))), ("svg",))


def test_what_did_not_go_well_is_in_the_title() -> None:
    chart = Chart("x", time_axis(_TIME), (_series("x", _TIME),))
    for status, is_said in (("good", False), ("bad", True), ("marginal", True), ("told", False)):
        verdict: Any = Verdict("Diverged: leg 3 costs $5", status)  # type: ignore[arg-type]
        drawing = figures(Report("a run", verdict, (Section("a", (chart,)),)), ("svg",))["x.svg"]
        assert (b"Diverged: leg 3 costs $5" in drawing) == is_said


def test_on_a_logarithmic_axis_lines_hide_each_other_by_their_ratio() -> None:
    """Expected: lines a thousandth apart are one, small ones that differ by a half are two."""
    values = np.geomspace(1e-6, 1, 51)
    parts = {"a": values, "b": 1.001 * values, "c": np.where(values < 1e-4, 1.5 * values, values)}
    series = tuple(_series(name, each) for name, each in parts.items())
    (axes,) = _drawn(Chart("gain", time_axis(_TIME), series, y=Axis("gain", LENGTH, scale="log")))
    assert [line.get_label() for line in axes.lines] == ["a, b", "c"]


def test_more_than_six_lines_differ_in_colour_or_dashes() -> None:
    series = tuple(_series(f"limit {k}", _TIME + k) for k in range(11))
    (axes,) = _drawn(Chart("shares", time_axis(_TIME), series))
    assert len({(line.get_color(), str(line._unscaled_dash_pattern)) for line in axes.lines}) == 11


def test_no_two_lines_of_runs_and_references_look_the_same() -> None:
    """Expected: of two runs, three axes and their references, twelve lines with a colour or dashes of their own."""
    roles: tuple[Role, ...] = ("actual", "reference")
    cases = [(run, axis, role) for run in (0, 1) for axis in "xyz" for role in roles]
    series = tuple(
        Series(f"{case}", LENGTH, _TIME * (k + 1.3), role, run=run, component=axis)
        for k, case in enumerate(cases)
        for run, axis, role in [case]
    )
    (axes,) = _drawn(Chart("pose", time_axis(_TIME), series))
    looks = {(line.get_color(), str(line._unscaled_dash_pattern)) for line in axes.lines}
    assert len(looks) == len(axes.lines) == 12


def test_labels_of_a_heat_map_stand_on_both_axes_the_first_row_on_top() -> None:
    names = ("mass", "gain")
    axis = Axis("parameter", COUNT, np.arange(2.0), names)
    chart = Chart("correlation", axis, (_series("r", [[1, -0.5], [-0.5, 1]], quantity=COUNT),), "heat", y=axis)
    axes, _ = _drawn(chart)
    for ticks in (axes.get_xticklabels(), axes.get_yticklabels()):
        assert [each.get_text() for each in ticks] == list(names)
    assert axes.yaxis.get_inverted()
    assert axes.get_xticklabels()[0].get_rotation() == 90


def test_small_panels_are_named_by_their_charts_and_have_one_legend_for_each_kind() -> None:
    """Expected: four panels in two columns with the names of their series; another kind below has its own legend."""
    pairs = [
        Chart(f"leg {k}", time_axis(_TIME), (_series("run", _TIME), _series("model", k * _TIME, "nominal")), group="g")
        for k in range(1, 5)
    ]
    alone = Chart("rest", time_axis(_TIME), (_series("x", _TIME),), group="g")
    with figures_drawn(is_rendered=False) as made:
        figures(_report(*pairs, alone), ("png",))
    (figure,) = made
    above, below = figure.subfigs
    assert [axes.get_title(loc="left") for axes in above.axes] == [f"leg {k} [mm]" for k in range(1, 5)]
    grid = above.axes[0].get_gridspec()
    assert grid is not None
    assert (grid.nrows, grid.ncols) == (2, 2)
    (legend,) = above.legends
    assert [text.get_text() for text in legend.get_texts()] == ["run", "model"]
    assert [axes.get_xlabel() for axes in above.axes] == ["", "", "time [s]", "time [s]"]
    assert [axes.get_title(loc="left") for axes in below.axes] == ["rest [mm]"]
    assert not below.legends

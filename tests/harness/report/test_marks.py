"""Margins and strips of charts: as data, in figures, and what studies draw with them."""

import math

import numpy as np
import pytest
from matplotlib.colors import to_hex

import gough_stewart as gs
from gough_stewart.harness.report.chart import Axis, Chart, Mark, Series, Span, Strip, strip_of, time_axis
from gough_stewart.harness.report.codec import from_json, to_json
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.packing import Arrays
from gough_stewart.harness.report.page import chart_data
from gough_stewart.harness.report.palette import colour_of
from gough_stewart.harness.report.quantities import ANGLE, FREQUENCY, LENGTH
from tests.support.drawn_figures import drawn

_TIME = np.array([7.0, 7.5, 8.5, 9.0, 10.0, 11.0])


def _report(chart: Chart) -> Report:
    return Report("sway", Verdict("v", "told"), (Section("a", (chart,)),))


def test_a_strip_has_the_time_from_each_row_to_the_next() -> None:
    """Expected: by hand; the last row has no next one, so what holds there alone takes no time."""
    found = strip_of("force", _TIME, [0, 1, 1, 0, 1, 1])
    assert found == Strip("force", ((7.5, 9.0), (10.0, 11.0)), "limit", 2.5 / 4.0)
    assert strip_of("force", _TIME, [0, 0, 0, 0, 0, 1]) is None
    assert strip_of("force", _TIME, np.ones(6)) == Strip("force", ((7.0, 11.0),), "limit", 1.0)


def test_many_intervals_are_joined_over_the_shortest_gaps() -> None:
    """Expected: 1,000 of 3,000 intervals are left, with all wide gaps, both ends, and the true share."""
    time = np.arange(6001) + 0.2 * np.isin(np.arange(6001) % 6, (2,))
    found = strip_of("force", time, np.arange(6001) % 2 == 0)
    assert found is not None
    assert len(found.intervals) == 1000
    assert (found.intervals[0][0], found.intervals[-1][1]) == (0.0, 5999.0)
    assert found.share == pytest.approx((3000 - 0.2 * 1000) / 6000)
    gaps = [b[0] - a[1] for a, b in zip(found.intervals, found.intervals[1:], strict=False)]
    assert gaps == pytest.approx(np.full(999, 1.2))


def test_they_are_kept_as_data() -> None:
    span, strip = (
        Span(2.0, -math.pi, -2.5, "phase margin", "marginal"),
        Strip("force", ((1.0, 2.0), (3.0, 4.0)), "bad", 0.5),
    )
    axis = Axis("f", FREQUENCY, np.array([1.0, 2.0, 5.0]), scale="log")
    chart = Chart("phase", axis, (Series("leg 1", ANGLE, np.zeros(3)),), spans=(span,), strips=(strip,),
                  marks=(Mark(1.0, "limit", tells=False),))  # fmt: skip
    (again,) = from_json(to_json(_report(chart))).charts
    assert (again.spans, again.strips, again.marks[0].tells) == ((span,), (strip,), False)
    with pytest.raises(ValueError, match="finite number"):
        Span(math.nan, 0, 1, "gain")
    found = chart_data(chart, Arrays())
    assert found["spans"] == [{"at": 2.0, "low": -math.pi, "high": -2.5, "text": "phase margin", "role": "marginal"}]
    assert found["strips"][0]["share"] == "50 %"


def test_figures_draw_them_in_the_units_of_their_axes() -> None:
    strip = strip_of("force at its limit", _TIME, [0, 1, 1, 0, 1, 1], "bad")
    assert strip is not None
    span = Span(9.5, 1e-3, 4e-3, "3 mm left")
    error = Series("x", LENGTH, np.array([1.0, 2, 3, 2, 1, 5]) * 1e-3)
    plain, chart = (
        Chart("error", time_axis(_TIME), (error,), strips=each, spans=spans)
        for each, spans in (((), ()), ((strip,), (span,)))
    )
    ((without,),), ((axes,),) = (drawn(_report(each)).values() for each in (plain, chart))
    (bars,) = axes.collections
    ends = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bars.get_paths()]
    assert ends == [(7.5, 9.0), (10.0, 11.0)]
    assert to_hex(bars.get_facecolor()[0]) == colour_of("bad")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["x", "force at its limit, 62 %"]
    line = axes.lines[1]
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([9.5, 9.5], [1.0, 4.0])
    assert "3 mm left" in [text.get_text() for text in axes.texts]
    # the strip is below the curve
    assert (axes.get_xlim(), axes.get_ylim()[1]) == (without.get_xlim(), without.get_ylim()[1])
    top = max(path.vertices[:, 1].max() for path in bars.get_paths())
    (low, high), (lowest, _) = axes.get_ylim(), without.get_ylim()
    assert low + top * (high - low) <= lowest + 1e-9 * high


def test_the_margins_of_a_loop_are_drawn_where_they_are() -> None:
    """Expected: python-control's response of one leg's loop, the others closed, at both ends of each margin."""
    found = gs.margins("heave_step", {"controller.bandwidth": 6})
    gain, phase, both = (chart for chart in found.report().charts if chart.group == "bode")
    everything = found.loop

    def of_one(frequency: float, k: int) -> complex:
        R = everything(np.exp(2j * np.pi * frequency * found.sample_time))
        o = [leg for leg in range(6) if leg != k]
        return complex(R[k, k] - R[k, o] @ np.linalg.solve(np.eye(5) + R[np.ix_(o, o)], R[o, k]))

    (up,) = gain.spans
    at = of_one(up.at, int(np.argmin([leg.gain_up for leg in found.legs])))
    assert up.low == pytest.approx(-at.real, rel=1e-6)
    assert up.high == 1.0
    assert abs(at.imag) < 1e-6 * abs(at)
    (left,) = phase.spans
    at = of_one(left.at, int(np.argmin([leg.phase for leg in found.legs])))
    assert abs(at) == pytest.approx(1, rel=1e-9)
    assert left.low == pytest.approx(-math.pi)
    assert left.high == pytest.approx(np.angle(at), abs=1e-3)  # read from the curve
    assert left.text == "phase margin 61.9 deg at 15.2 Hz, any leg"
    assert [mark.value for mark in both.marks] == [1.0, found.disk.frequency]


def test_a_run_shows_when_its_forces_are_limited() -> None:
    """Expected: the share of the rows with the flag, but the last, as the metric has it."""
    record = gs.run("heave_step", {"actuators.force_limit": 4300.0, "loop.duration": 1.0})
    charts = record.report().charts
    (strip,) = charts[0].strips
    assert strip.name == "force at its limit"
    assert strip.share == pytest.approx(gs.metrics(record)["saturation"]["force_limited"]["any"])
    assert strip.intervals[0][0] == pytest.approx(0.2, abs=2e-3)  # the step
    assert all(chart.strips == charts[0].strips for chart in charts)

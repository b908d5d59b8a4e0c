"""Data for other programs have fewer points, and every peak at its time."""

from typing import Any

import numpy as np

from gough_stewart.harness.report.chart import Axis, Chart, Flag, Samples, Scene, Series, time_axis
from gough_stewart.harness.report.codec import FRAMES, thinned
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.quantities import COUNT, LENGTH
from gough_stewart.model.vectors import FloatArray


def _with(*parts: Any) -> Report:
    return Report("r", Verdict("v", "told"), (Section("a", parts),))


def test_peaks_stay_at_their_times() -> None:
    time: FloatArray = np.asarray(7.3 + np.arange(5001) * 1e-3)
    first, second = np.sin(time), np.cos(3 * time)
    first[1234], second[4321] = 9.0, -7.0
    band: dict[str, Any] = {"low": first - 1, "high": first + 2}
    chart = Chart("c", time_axis(time), (Series("a", LENGTH, first, **band), Series("b", LENGTH, second)), "step")
    (found,) = thinned(_with(chart), 100).charts
    for series, values in zip(found.series, (first, second), strict=True):
        assert len(series.values) <= 100
        assert series.of == 5001
        assert series.x is not None
        rows = np.searchsorted(time, series.x)
        assert np.array_equal(time[rows], series.x)
        assert np.array_equal(values[rows], series.values)
        assert (series.values.min(), series.values.max()) == (values.min(), values.max())
        assert {0, 5000} <= set(rows.tolist())
    assert found.series[0].high is not None
    assert np.array_equal(found.series[0].high, found.series[0].values + 2)


def test_short_lines_and_other_charts_stay_as_they_are() -> None:
    short = Chart("c", time_axis([0, 1]), (Series("a", LENGTH, np.array([1.0, 2.0])),))
    points = Chart("p", Axis("x", COUNT, np.arange(2000.0)), (Series("a", LENGTH, np.arange(2000.0)),), "points")
    found = thinned(_with(short, points), 100).charts
    assert found[0] is short
    assert found[1] is points


def test_a_flag_between_frames_stays_on_if_it_was_on_in_any_part() -> None:
    n = 2001
    flags = "".join("1" if k in (777, 1999) else "0" for k in range(n - 1))
    scene = Scene(
        "s", np.zeros((6, 3)), np.ones((6, 3)), 0.3, 0.4, np.linspace(0, 20, n), np.outer(np.arange(n), np.ones(7)),
        np.ones((n, 6)), flags=(Flag("force limited", flags),), rows=n,
    )  # fmt: skip
    (found,) = thinned(_with(scene)).sections[0].parts
    assert isinstance(found, Scene)
    assert len(found.time) == FRAMES
    assert (found.time[0], found.time[-1]) == (0.0, 20.0)
    assert np.array_equal(found.pose[:, 3] * 0.01, found.time)
    on = [k for k, each in enumerate(found.flags[0].values) if each == "1"]
    assert on == [77, 199]
    assert found.rows == n


def test_signals_of_single_members_are_for_the_page_only() -> None:
    samples = Samples(np.array([3.0, 5.0]), np.array([0.0, 1.0]), np.array([[1.0, 2.0], [3.0, 4.0]]), 9)
    chart = Chart("c", time_axis([0.0, 1.0]), (Series("a", LENGTH, np.array([1.0, 2.0])),), samples=samples)
    (found,) = thinned(_with(chart)).charts
    assert found.samples is None
    assert found.series[0].values.tolist() == [1.0, 2.0]

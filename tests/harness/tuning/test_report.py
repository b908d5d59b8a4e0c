"""The report of a search as plain data: how much better, with which values, whether that holds elsewhere."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from gough_stewart.harness.tuning.candidates import Evaluation, Goal
from gough_stewart.harness.tuning.report import tuning_report, tuning_verdict
from gough_stewart.harness.tuning.search import Search
from gough_stewart.harness.tuning.space import Axis

METRIC = "tracking.position.norm_rms"


def evaluation(value: float, at: float = 3.0) -> Evaluation:
    return Evaluation((at,), value, (), 0, "")


@dataclass
class Made:
    """A search of one key from 1 to 6 Hz, 2 Hz before, of 8 mm before and 6 mm after; 9 and 7 on fresh members."""

    title: str = "made"
    changed: dict[str, dict[str, Any]] = field(default_factory=dict)
    values: dict[str, float | int] = field(default_factory=lambda: {"controller.bandwidth": 3.0})
    seen: Evaluation = field(default_factory=lambda: evaluation(6e-3))
    fresh: Evaluation | None = field(default_factory=lambda: evaluation(7e-3))
    before: Evaluation | None = field(default_factory=lambda: evaluation(8e-3))
    before_fresh: Evaluation | None = field(default_factory=lambda: evaluation(9e-3))
    search: Search = field(default_factory=lambda: searched(ending=""))
    members: int = 20
    fresh_members: int = 40
    warnings: tuple[str, ...] = ()


def searched(**more: Any) -> Search:
    place: Any = SimpleNamespace(target=SimpleNamespace(unit="Hz"))
    axis = Axis("controller.bandwidth", place, 1.0, 6.0, 2.0)
    tried = [evaluation(8e-3, 2.0), evaluation(np.inf, 6.0), evaluation(6e-3)]
    return Search((axis,), Goal(METRIC, (), 0.9), tried, [0, 0, 0], **more)


def test_fresh_members_carry_the_verdict() -> None:
    """Expected: from 9 to 7 mm is 22 % less; the search's own 6 mm is a number, not the verdict."""
    report = tuning_report(Made(), "said")
    assert report.verdict.text == (
        "Position error, RMS, 90 % of 40 fresh members: from 9 mm to 7 mm (22 % less); with controller.bandwidth 3 Hz"
    )
    assert report.verdict.status == "good"
    assert (report.number("value").value, report.number("fresh").value) == (6e-3, 7e-3)
    chart, landscape = report.charts
    assert [series.name for series in chart.series] == ["candidates", "best so far"]
    (kept,) = landscape.series
    assert (landscape.x.name, landscape.x.quantity.unit, landscape.note) == (
        "controller.bandwidth", "Hz", "1 candidate above the chart.",
    )  # fmt: skip
    np.testing.assert_array_equal(kept.values, [8e-3, np.nan, 6e-3])
    np.testing.assert_array_equal(chart.series[1].values, [8e-3, 8e-3, 6e-3])


def test_doubts_are_told() -> None:
    """Expected: a value within 1 % of its range from the end; a search that was interrupted; one that made it worse."""
    near = tuning_verdict(Made(values={"controller.bandwidth": 5.96}))
    assert near.text.endswith("; controller.bandwidth at the end of its range, beyond which it may be better")
    assert near.status == "marginal"
    cut = tuning_verdict(Made(fresh=None, before_fresh=None, search=searched(is_interrupted=True)))
    assert cut.text.startswith("Position error, RMS: from 8 mm to 6 mm (25 % less)")
    assert cut.text.endswith("; interrupted, and not tried on fresh members")
    worse = tuning_verdict(Made(fresh=evaluation(9.9e-3)))
    assert "(10 % more)" in worse.text
    assert worse.status == "bad"

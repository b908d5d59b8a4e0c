"""Searches whose candidates are made up: what is best, what is said of them, and what charts show."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.reports import tables_of

METRIC = "tracking.position.norm_peak"
VARY = ("controller.bandwidth=2..5Hz,log", "loop.delay=0..3", "plant.platform_mass=0.9..1.4 t")
CONDITIONS = ("force.rms < 95 N", "stroke.margin >= 10 µm")
INF, NAN = math.inf, math.nan
# Points, value [m], RMS force [N], margin [m], failed members.
TRIED: list[tuple[tuple[float, int, float], float, float, float, int]] = [
    ((2.0, 0, 900.0), 0.0050, 80.0, 0.10, 0),
    ((3.1, 2, 1300.0), 0.0030, 96.0, 0.20, 0),  # breaks the first condition
    ((4.9, 1, 950.0), 0.0040, 70.0, 0.05, 0),
    ((2.6, 3, 1100.0), INF, INF, -INF, 2),  # has no value
    ((3.7, 1, 1250.0), 0.0020, 60.0, 1e-6, 0),  # breaks the second one
    ((2.3, 0, 1375.0), 0.0025, 94.0, 0.02, 0),  # the best
    ((4.2, 2, 1010.0), 0.9000, 90.0, 0.30, 0),  # too large to be shown
]
KEPT = [True, False, True, False, False, True, True]


@pytest.fixture(scope="module")
def real() -> gs.Tuning:
    """A search of three keys, whose candidates are replaced."""
    short = {"loop.duration": 0.02, "reference.at": 0.002}
    wide = [condition.replace("95 N", "95 kN") for condition in CONDITIONS]
    options: Any = {"members": 1, "generations": 1, "population": 5}
    found = gs.tune("heave_step", VARY, METRIC, short, subject_to=wide, **options)
    narrow = [replace(condition, bound=bound) for condition, bound in zip(found.search.goal.conditions, (95.0, 1e-5),
                                                                         strict=True)]  # fmt: skip
    required = replace(narrow[0].requirement, text=CONDITIONS[0])
    goal = replace(found.search.goal, conditions=(replace(narrow[0], requirement=required), narrow[1]), quantile=0.6)
    return replace(found, search=replace(found.search, goal=goal))


def searched(real: gs.Tuning) -> Any:
    tried = [
        real.seen._replace(point=point, value=value, conditions=(force, margin), failed=failed, reason="", metrics={})
        for point, value, force, margin, failed in TRIED
    ]
    generation = [0, 0, 0, 0, 1, 1, 1]
    return replace(real.search, tried=tried, generation=generation, ending="after 2 generations", is_interrupted=False)


def tuned(real: gs.Tuning, **parts: Any) -> gs.Tuning:
    """The result, on three members, of which one was left out."""
    search = searched(real)
    best = search.best
    assert best is not None
    fresh = best._replace(value=0.0031, conditions=(94.5, NAN), failed=1)
    values = {axis.key: value for axis, value in zip(search.axes, best.point, strict=True)}
    made = replace(real, values=values, seen=best, fresh=fresh, before_fresh=None, search=search, members=3,
                   before=best._replace(value=INF, conditions=(INF, -INF), failed=2), fresh_members=5)  # fmt: skip
    return replace(made, **parts)


def test_the_best_meets_all_conditions_and_the_one_that_most_break_is_named_with_the_nearest(real: gs.Tuning) -> None:
    """Expected: counted by hand; the nearest in the unit that is shown."""
    search = searched(real)
    tried = search.tried
    assert search.best == tried[5]
    assert tuned(real).candidates["kept"].to_list() == KEPT
    assert replace(search, tried=tried[1:2] + tried[3:5]).best is None
    failed = tried[3]._replace(reason="too far")
    no_margin = tried[1]._replace(conditions=(120.0, 0.2))
    for some, said in (
        ([], "no candidate was tried"),
        ([tried[1], no_margin, tried[4]],
         "'force.rms < 95 N' was not met by 2 of 3 candidates, the nearest reached 60 N"),
        ([tried[4], tried[4], tried[1]],
         "'stroke.margin >= 10 µm' was not met by 2 of 3 candidates, the nearest reached 200 mm"),
        ([tried[3], failed, tried[0]], "2 of 3 candidates have members that do not complete; the first: too far"),
        ([tried[3], tried[0]], f"1 of 2 candidates have no value of {METRIC}"),
        ([tried[3]._replace(value=1.0)], "'force.rms < 95 N' was not met by 1 of 1 candidates"),
    ):  # fmt: skip
        assert replace(search, tried=some).broken_most() == said


def test_fresh_members_carry_the_verdict_and_doubts_are_said(real: gs.Tuning) -> None:
    """Expected: from 9 to 7 mm is 22 % less; the search's own 6 mm is a number, not the verdict."""
    goal = replace(real.search.goal, conditions=(), quantile=0.9, metric="tracking.position.norm_rms")
    axis = replace(real.search.axes[0], low=1.0, high=6.0, is_log=False)

    def verdict(after: float = 7e-3, value: float = 3.0, **parts: Any) -> Any:
        before, seen, before_fresh, fresh = (
            real.seen._replace(point=(value,), value=x, conditions=(), metrics={}) for x in (8e-3, 6e-3, 9e-3, after)
        )
        search = replace(real.search, axes=(axis,), goal=goal, tried=[before, seen], generation=[0, 0])
        made = replace(real, values={axis.key: value}, seen=seen, fresh=fresh, before=before,
                       before_fresh=before_fresh, search=search, members=20, fresh_members=40)  # fmt: skip
        report = replace(made, **parts).report()
        assert report.number("value").value == 6e-3
        return report.verdict

    assert verdict().text == (
        "Position error, RMS, 90 % of 40 fresh members: from 9 mm to 7 mm (22 % less); with controller.bandwidth 3 Hz"
    )
    assert verdict().status == "good"
    assert [number.value for number in verdict().numbers] == [6e-3, 7e-3, 3.0]
    near = verdict(value=5.96)
    assert near.text.endswith("; controller.bandwidth at the end of its range, beyond which it may be better")
    assert near.status == "marginal"
    alone = verdict(fresh=None, before_fresh=None)
    assert alone.text.startswith("Position error, RMS: from 8 mm to 6 mm (25 % less)")
    worse = verdict(after=9.9e-3)
    assert ("(10 % more)" in worse.text, worse.status) == (True, "bad")
    # an experiment that breaks a condition itself is no rival
    found = tuned(real)
    allowed = replace(found, before_fresh=found.seen._replace(value=0.002, conditions=(96.0, 1.0))).report().verdict
    assert "; the values before break a condition; with controller.bandwidth 2.3 Hz" in allowed.text
    assert "; not held on fresh members: stroke.margin >= 10 µm" in allowed.text
    assert found.report().notes[-1].text.endswith(" On these, 'stroke.margin >= 10 µm' does not hold.")
    cut = replace(found, search=replace(found.search, is_interrupted=True), fresh=None).report().verdict
    assert cut.text.endswith("; interrupted, and not tried on fresh members")


def test_tables_have_what_was_and_what_is(real: gs.Tuning) -> None:
    """Expected: values with their ranges in SI units; metric and conditions on both kinds of members; who failed."""
    tables = tables_of(tuned(real).report())
    rows = {row[0]: [cell.value for cell in row[1:]] for row in tables["Tuned"].rows}
    assert rows == {
        "controller.bandwidth": [2.0, 2.3, 2.0, 5.0],
        "loop.delay": [1.0, 0.0, 0.0, 3.0],
        "plant.platform_mass": [pytest.approx(1216.9), 1375.0, 900.0, 1400.0],
    }
    table = tables["Metric and conditions, 60 % of 3 members"]
    assert [column.name for column in table.columns] == ["", "was", "is", "was, fresh", "is, fresh"]
    first, force, margin, failed = table.rows
    assert [cell.value for cell in first[1:]] == [INF, 0.0025, None, 0.0031]
    assert [cell.value for cell in force[1:]] == [INF, 94.0, None, 94.5]
    assert [cell.value for cell in margin[1:]] == [-INF, 0.02, None, None]
    assert failed == ("members that failed", 2, 0, None, 1)


def test_charts_show_candidates_by_each_key(real: gs.Tuning) -> None:
    """Expected: dots where conditions hold and where not, each at its key and value; large values are counted."""
    found = tuned(real)
    every, *by_key = found.report().charts
    value, kept = np.array([row[1] for row in TRIED]), np.array(KEPT)
    shown = np.isfinite(value) & (value <= 5e-3 + 4 * 2.5e-3)  # of the kept: the median, and four times to the least
    assert [chart.x.name for chart in by_key] == [text.partition("=")[0] for text in VARY]
    for k, chart in enumerate(by_key):
        assert (chart.kind, chart.group, chart.x.scale) == ("points", "values", "log" if k == 0 else "linear")
        assert chart.x.values.tolist() == [row[0][k] for row in TRIED]
        assert [series.name for series in chart.series] == ["meets all conditions", "breaks a condition"]
        for series, which in zip(chart.series, (kept, ~kept), strict=True):
            np.testing.assert_array_equal(series.values, np.where(shown & which, value, np.nan))
        assert chart.note == "2 candidates above the chart."
    assert every.x.values.tolist() == list(range(1, 8))
    np.testing.assert_array_equal(every.series[0].values, np.where(np.isfinite(value), value, np.nan))
    best = np.minimum.accumulate(np.where(kept, value, np.inf))
    np.testing.assert_array_equal(every.series[1].values, np.where(np.isfinite(best), best, np.nan))

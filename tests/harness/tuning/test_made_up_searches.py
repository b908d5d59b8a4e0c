"""Searches whose candidates are made up: what is best, what is said of them, and what files and figures show."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import load_experiment
from gough_stewart.harness.errors import NoCandidateError
from gough_stewart.harness.tuning.candidates import members_for
from gough_stewart.harness.tuning.goal import Evaluation, Goal, condition_of
from gough_stewart.harness.tuning.search import Search
from gough_stewart.harness.tuning.space import SearchAxis, axes_of
from gough_stewart.harness.tuning.tuning import tuning_files
from tests.support.uneven_loops import experiment_of

METRIC, KNOWN = "tracking.position.norm_peak", ("tracking.position.norm_peak", "force.rms", "stroke.margin")
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


def axes(vary: tuple[str, ...]) -> tuple[SearchAxis, ...]:
    """Of a shipped experiment."""
    return axes_of(vary, members_for(load_experiment("heave_step"), 1, None))


def searched(keys: int) -> Search:
    """With so many of the keys."""
    goal = Goal(METRIC, tuple(condition_of(text, KNOWN) for text in CONDITIONS), 0.6)
    tried = [Evaluation(p[:keys], value, (force, margin), failed, "") for p, value, force, margin, failed in TRIED]
    return Search(axes(VARY[:keys]), goal, tried, [0, 0, 0, 0, 1, 1, 1], "after 2 generations")


def tuned(search: Search, **parts: Any) -> gs.Tuning:
    """The result, on three members, of which one was left out."""
    best = search.best
    assert best is not None
    fresh, before = Evaluation(best.point, 0.0031, (94.5, NAN), 1, ""), Evaluation((), INF, (INF, -INF), 2, "")
    values: dict[str, float | int] = dict(zip([axis.key for axis in search.axes], best.point, strict=True))
    made = gs.Tuning(load_experiment("heave_step"), values, best, fresh, before, None, search, 3, 5, 1, 2.5e-9)
    return replace(made, **parts)


def statement(found: gs.Tuning) -> str:
    """What is said below the tables, in one line."""
    text = " ".join(repr(found).split())
    return text[text.rindex("position error, peak: ") :]


def test_conditions_come_before_the_metric_and_failures_before_both() -> None:
    """Expected: shares of the bounds by hand, which add up; a million for each member that failed, and for one more."""
    search = searched(3)
    violations = [search.goal.violation(each) for each in search.tried]
    assert [violation == 0 for violation in violations] == KEPT
    assert violations[1] == pytest.approx(1 / 95)
    assert violations[4] == pytest.approx(0.9)
    assert violations[3] == pytest.approx(2e6 + 3e6)
    assert search.best == search.tried[5]
    both = Evaluation((), 0.001, (190.0, 5e-6), 0, "")
    assert search.goal.violation(both) == pytest.approx(1 + 0.5)
    lost = Evaluation((), INF, (80.0, 0.1), 0, "")
    assert search.goal.violation(lost) == pytest.approx(1e6)
    assert search.goal.violation(lost._replace(failed=1)) == pytest.approx(2e6)
    alone = replace(search, tried=search.tried[1:2] + search.tried[3:5])
    assert alone.best is None


def test_the_condition_that_most_candidates_break_is_named_with_the_nearest() -> None:
    """Expected: counted by hand; the nearest in the unit that is shown."""
    search = searched(3)
    tried = search.tried
    assert replace(search, tried=[]).broken_most() == "no candidate was tried"
    assert replace(search, tried=[tried[1], tried[1]._replace(conditions=(120.0, 0.2)), tried[4]]).broken_most() == (
        "'force.rms < 95 N' was not met by 2 of 3 candidates, the nearest reached 60 N"
    )
    assert replace(search, tried=[tried[4], tried[4], tried[1]]).broken_most() == (
        "'stroke.margin >= 10 µm' was not met by 2 of 3 candidates, the nearest reached 200 mm"
    )
    failed = tried[3]._replace(reason="too far")
    assert replace(search, tried=[tried[3], failed, tried[0]]).broken_most() == (
        "2 of 3 candidates have members that do not complete; the first: too far"
    )
    assert replace(search, tried=[tried[3], tried[0]]).broken_most() == (f"1 of 2 candidates have no value of {METRIC}")
    alone = replace(search, tried=[tried[3]._replace(value=1.0)])
    assert alone.broken_most() == "'force.rms < 95 N' was not met by 1 of 1 candidates"


@cache
def files_of(keys: int) -> dict[str, bytes]:
    """All of them."""
    return tuning_files(tuned(searched(keys)), "heave_step", Path())


def test_files_have_every_number_and_null_where_there_is_none() -> None:
    """Expected: the candidates above; strict JSON that a person can read."""
    files = files_of(3)
    text = files["tuning.json"].decode()

    def refused(word: str) -> None:
        raise AssertionError(word)

    written = json.loads(text, parse_constant=refused)
    assert text.startswith(f'{{\n  "metric": "{METRIC}",\n  "subject_to": [\n    "force.rms < 95 N",\n')
    assert '"stroke.margin >= 10 µm"' in text
    assert text.endswith("}\n")
    written.pop("versions")
    none = {"force.rms": None, "stroke.margin": None}
    assert written == {
        "metric": METRIC,
        "subject_to": list(CONDITIONS),
        "quantile": 0.6,
        "values": {"controller.bandwidth": 2.3, "plant.platform_mass": 1375.0, "loop.delay": 0},
        "units": {"controller.bandwidth": "Hz", "plant.platform_mass": "kg", "loop.delay": ""},
        "members": 3,
        "seen": {"value": 0.0025, "conditions": {"force.rms": 94.0, "stroke.margin": 0.02}, "failed": 0},
        "before": {"value": None, "conditions": none, "failed": 2},
        "fresh_members": 5,
        "fresh": {"value": 0.0031, "conditions": {"force.rms": 94.5, "stroke.margin": None}, "failed": 1},
        "before_fresh": None,
        "candidates": 7,
        "ending": "after 2 generations",
        "left_out": 1,
        "integration_error": 2.5e-9,
    }
    rows = [line.split(",") for line in files["candidates.csv"].decode().splitlines()]
    assert rows[0] == ["generation", *(text.partition("=")[0] for text in VARY), "value", *KNOWN[1:], "failed", "kept"]
    for k, (cells, (point, *numbers, failed), kept) in enumerate(zip(rows[1:], TRIED, KEPT, strict=True)):
        assert [int(cells[0]), *map(float, cells[1:4])] == [int(k > 3), *point]
        assert [float(cell) for cell in cells[4:7]] == numbers
        assert (int(cells[7]), cells[8]) == (failed, str(kept).lower())
    tuned_text = files["tuned.toml"].decode()
    assert 'bandwidth = "2.3 Hz"' in tuned_text
    assert 'platform_mass = "1375.0 kg"' in tuned_text
    assert "delay = 0" in tuned_text


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({}, "2.5 mm on the 3 members of the search; 60 % of 5 fresh members have at most 3.1 mm. On these, "
         "'stroke.margin >= 10 µm' does not hold."),
        ({"members": 1}, "2.5 mm on the one run of the search; 60 % of 5 fresh members have at most 3.1 mm. On these, "
         "'stroke.margin >= 10 µm' does not hold."),
        ({"fresh": None}, "2.5 mm in the search; not evaluated again: nothing is random, so other runs are the same."),
    ],
)  # fmt: skip
def test_the_statement_names_the_members_and_what_does_not_hold(parts: dict[str, Any], says: str) -> None:
    """Expected: the whole sentence."""
    assert statement(tuned(searched(3), **parts)) == f"position error, peak: {says}"
    both = Evaluation((), 0.0031, (95.0, 9e-6), 0, "")
    broken = "On these, 'force.rms < 95 N' and 'stroke.margin >= 10 µm' does not hold."
    assert statement(tuned(searched(3), fresh=both)).endswith(broken)
    fine = Evaluation((), 0.0031, (94.9, 1e-5), 0, "")
    assert statement(tuned(searched(3), fresh=fine)).endswith("have at most 3.1 mm.")


def of_one_key(after: float = 7e-3, value: float = 3.0, **parts: Any) -> gs.Tuning:
    """A search of one key from 1 to 6 Hz, 8 mm before and 6 mm after, on fresh members 9 mm and 7 mm."""
    goal = Goal("tracking.position.norm_rms", (), 0.9)
    before, seen, before_fresh, fresh = (Evaluation((value,), x, (), 0, "") for x in (8e-3, 6e-3, 9e-3, after))
    search = Search(axes(("controller.bandwidth=1..6Hz",)), goal, [before, seen], [0, 0])
    made = gs.Tuning(load_experiment("heave_step"), {"controller.bandwidth": value}, seen, fresh, before, before_fresh,
                     search, 20, 40, 0, 0.0)  # fmt: skip
    return replace(made, **parts)


def test_fresh_members_carry_the_verdict_and_doubts_are_told() -> None:
    """Expected: from 9 to 7 mm is 22 % less; the search's own 6 mm is a number, not the verdict.

    A value within 1 % of its range from the end; a search that was interrupted; one that made it worse.
    """
    report = of_one_key().report()
    assert report.verdict.text == (
        "Position error, RMS, 90 % of 40 fresh members: from 9 mm to 7 mm (22 % less); with controller.bandwidth 3 Hz"
    )
    assert report.verdict.status == "good"
    assert (report.number("value").value, report.number("fresh").value) == (6e-3, 7e-3)
    near = of_one_key(value=5.96).report().verdict
    assert near.text.endswith("; controller.bandwidth at the end of its range, beyond which it may be better")
    assert near.status == "marginal"
    search = replace(of_one_key().search, is_interrupted=True)
    cut = of_one_key(fresh=None, before_fresh=None, search=search).report().verdict
    assert cut.text.startswith("Position error, RMS: from 8 mm to 6 mm (25 % less)")
    assert cut.text.endswith("; interrupted, and not tried on fresh members")
    worse = of_one_key(after=9.9e-3).report().verdict
    assert "(10 % more)" in worse.text
    assert worse.status == "bad"
    # an experiment that breaks a condition itself is no rival
    allowed = tuned(searched(3), before_fresh=Evaluation((), 0.002, (96.0, 1.0), 0, "")).report().verdict
    assert "; the values before break a condition; with controller.bandwidth 2.3 Hz" in allowed.text
    assert "; not held on fresh members: stroke.margin >= 10 µm" in allowed.text


@pytest.mark.parametrize("keys", [1, 3])
def test_charts_show_candidates_by_each_key(keys: int) -> None:
    """Expected: dots where conditions hold and where not, each at its key and value; large values are counted."""
    search = searched(keys)
    every, *landscape = tuned(search).report().charts
    value = np.array([each.value for each in search.tried])
    points = np.array([each.point for each in search.tried], dtype=float)
    kept = np.array(KEPT)
    shown = np.isfinite(value) & (value <= 5e-3 + 4 * 2.5e-3)  # of the kept: the median, and four times to the least
    assert [chart.x.name for chart in landscape] == [text.partition("=")[0] for text in VARY[:keys]]
    for k, chart in enumerate(landscape):
        assert (chart.kind, chart.group, chart.x.scale) == ("points", "values", "log" if k == 0 else "linear")
        assert chart.x.values.tolist() == points[:, k].tolist()
        assert [each.name for each in chart.series] == ["meets all conditions", "breaks a condition"]
        for series, which in zip(chart.series, (kept, ~kept), strict=True):
            np.testing.assert_array_equal(series.values, np.where(shown & which, value, np.nan))
        assert chart.note == "2 candidates above the chart."
    assert every.x.values.tolist() == list(range(1, 8))
    np.testing.assert_array_equal(every.series[0].values, np.where(np.isfinite(value), value, np.nan))
    best = np.minimum.accumulate(np.where(kept, value, np.inf))
    np.testing.assert_array_equal(every.series[1].values, np.where(np.isfinite(best), best, np.nan))


def test_reasons_of_candidates_that_are_impossible_are_told() -> None:
    """Expected: none of five can be made; the first reason is the platform's own."""
    with pytest.raises(NoCandidateError) as caught:
        gs.tune(
            experiment_of("pd", loop={"duration": 0.04, "sample_time": 5e-3, "plant_step": 1e-3}),
            ["plant.platform_mass=-9..-2kg"],
            "force.rms",
            members=1,
            generations=1,
            population=5,
        )
    said = "(after 1 generation): 5 of 5 candidates have members that do not complete; the first: "
    assert said in str(caught.value)
    assert "platform_mass" in str(caught.value).partition(said)[2]


@pytest.mark.parametrize(
    ("text", "whole", "u", "value", "share"),
    [
        ("controller.bandwidth=2..8Hz", False, 0.25, 3.5, 0.25),
        ("controller.bandwidth=2..8Hz, log", False, 0.5, 4.0, 0.5),
        ("loop.delay=1..4", True, 0.0, 1, 0.125),
        ("loop.delay=1..4", True, 0.2499, 1, 0.125),
        ("loop.delay=1..4", True, 0.25, 2, 0.375),
        ("loop.delay=1..4", True, 1.0, 4, 0.875),
    ],
)
def test_numbers_of_the_unit_cube_are_values_and_back(
    text: str, whole: bool, u: float, value: float, share: float
) -> None:
    """Expected: by hand; whole numbers have equal parts of the range, and stand in their middle."""
    (axis,) = axes((text,))
    assert axis.is_whole == whole
    assert axis.value(u) == pytest.approx(value)
    assert isinstance(axis.value(u), int) == whole
    assert axis.share(value) == pytest.approx(share)

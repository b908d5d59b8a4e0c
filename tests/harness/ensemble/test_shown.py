"""Tables, pages and warnings of ensembles from closed forms: of large ones, of one pair, with and without failures."""

import re
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble.compare import (
    compare,
    comparison_report,
    comparison_tables,
    known_numbers,
)
from gough_stewart.harness.ensemble.data import (
    failures,
    oscillation_warning,
    usual_metrics,
    works,
    worst_members,
)
from gough_stewart.harness.ensemble.ensemble_report import (
    Ensemble,
    ensemble_report,
    failure_table,
    quantile_table,
    sensitivity_table,
    worst_by,
    worst_table,
)
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.page import page_of
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import INPUTS, ensemble_of
from tests.support.page_arrays import data_of, unpacked
from tests.support.tables_shown import heads_of, rows_of

PEAK = "tracking.position.norm_peak"


def normal(n: int, seed: int = 2) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, 4))


def with_columns(ensemble: Ensemble, **columns: Any) -> Ensemble:
    """The same with other columns; `__` in a name is a dot."""
    series = [polars.Series(name.replace("__", "."), values) for name, values in columns.items()]
    return Ensemble(ensemble.members.with_columns(series), ensemble.bands, ensemble.metadata)


def words_of(page: bytes) -> str:
    text = re.sub('<span class="term"[^>]*>([^<]*)</span>', r"\1", page.decode().partition("<script")[0])
    return " ".join(re.sub("<[^>]*>", " ", text).split())


NAMES = tuple(f"input {k}" for k in range(17))
SHARES = np.roll(0.9 - 0.05 * np.arange(17), 5)
SOBOL = Sensitivity(PEAK, "sobol", NAMES, SHARES / 3, SHARES / 30, SHARES, SHARES / 20, None, 1900, 19)
BETA = Sensitivity(
    "stroke.margin",
    "regression",
    NAMES,
    np.where(np.arange(17) % 2, 1, -1) * SHARES,
    SHARES / 9,
    None,
    None,
    0.4,
    99,
    0,
)
ORDER = [*range(5, 17), *range(5)]


def test_tables_of_sensitivity_have_every_number_at_its_place() -> None:
    """Expected: the given numbers to two digits, the largest total index or the largest |β| first, eight of 17."""
    table = sensitivity_table(SOBOL)
    assert table.title == "What makes the position error, peak vary"
    assert "left out: 19 " in table.note
    assert [column.name.strip() for column in table.columns] == ["input", "alone", "±", "in total", "±"]
    assert table.first_shown == 8
    assert [row[0] for row in table.rows] == [NAMES[k] for k in ORDER]
    for k, row in zip(ORDER, table.rows, strict=True):
        assert row[1:] == (SHARES[k] / 3, SHARES[k] / 30, SHARES[k], SHARES[k] / 20)
    table = sensitivity_table(BETA)
    assert table.title == "What makes the stroke margin vary"
    assert [column.name for column in table.columns] == ["input", "β", "±"]
    for k, row in zip(ORDER, table.rows, strict=True):
        assert row == (NAMES[k], SHARES[k] * (1 if k % 2 else -1), SHARES[k] / 9)


def test_the_report_has_the_bars_of_the_most_influential_inputs() -> None:
    """Expected: 15 of 17 by their names, of both kinds of sensitivity, with what they are of."""
    for known, axis in ((SOBOL, "share of the variance"), (BETA, "standardised regression coefficient β")):
        report = ensemble_report(ensemble_of(normal(40)), PEAK, known)
        (chart,) = (chart for chart in report.charts if chart.kind == "bars")
        assert chart.x.labels == tuple(NAMES[k] for k in ORDER[:15])
        assert chart.y is not None
        assert (chart.y.name, chart.note, len(chart.series[0].values)) == (axis, known.remark, 15)
    assert (
        "Sobol' indices of 1900 members; left out: 19 not completed or without a value, or at a point" in SOBOL.remark
    )
    assert "R² = 0.40, of 99 members; ± and whiskers" in BETA.remark
    assert "far from linear" in BETA.remark


@pytest.fixture(scope="module")
def large() -> Ensemble:
    """More members than a page has points; the last hundred diverge, and a letter varies that is no number."""
    n = 10_100
    outcome = ["completed"] * 10_000 + ["diverged"] * 100
    found = ensemble_of(normal(n), outcome, ["the loop diverged" if each != "completed" else None for each in outcome])
    return with_columns(found, varied__controller__file=["a"] * n)


def test_the_page_of_a_large_ensemble_has_every_member(large: Ensemble) -> None:
    """Expected: a point for each, gaps for those that did not complete; their numbers in the unit that is shown."""
    report = ensemble_report(large, PEAK)
    page = page_of(report)
    data, said = data_of(page), words_of(page)
    points = [chart for chart in data["charts"] if chart["kind"] == "points"]
    assert [chart["x"]["name"] for chart in points] == list(INPUTS)
    (series,) = points[0]["series"]
    assert unpacked(data["arrays"][series["members"]]).tolist() == list(range(10_100))
    found = unpacked(data["arrays"][series["values"]])
    expected = np.append(large.values(PEAK)[:10_000], np.full(100, np.nan))
    np.testing.assert_allclose(points[0]["y"]["factor"] * found, 1e3 * expected, atol=1e-3)
    assert points[0]["y"]["title"] == "position error, peak [mm]"
    marks = [mark["value"] for mark in data["charts"][0]["marks"]]
    assert marks == pytest.approx(np.quantile(expected[:10_000], [0.05, 0.5, 0.95]).tolist())
    names = {each["name"] for each in data["members"]["numbers"]}
    assert {"position error, peak", "disk margin"} <= names
    assert "10,100 members drawn at random, seed 7" in said
    assert "Quantiles are without the 100 members not completed." in said
    assert "Quantiles are of the first 10,000 members." in said
    assert "Worst members" not in said
    small = words_of(page_of(ensemble_report(ensemble_of(normal(30)), PEAK)))
    assert not re.search("Quantiles are without|first 10,000|Not completed", small)


EVENLY = "as if members were drawn independently; the members of {} cover the ranges more evenly"
DESIGNS = {
    "random": ("drawn at random", ""),
    "latin_hypercube": ("of a Latin hypercube", EVENLY.format("a Latin hypercube")),
    "sobol": ("of a Sobol sequence", EVENLY.format("a Sobol sequence")),
    "saltelli": (
        "of Saltelli's design",
        "of 5 points, not of 30 members: the 6 members of a point of Saltelli's design share their numbers",
    ),
}


@pytest.mark.parametrize("sampling", DESIGNS)
def test_the_design_and_what_it_means_for_confidence_are_told(sampling: str) -> None:
    """Expected: no note on independent members; of Sobol points what may make the intervals too narrow; no seed."""
    found = ensemble_of(normal(30), sampling=sampling)
    bare = Ensemble(found.members, found.bands, {k: v for k, v in found.metadata.items() if k != "seed"})
    report, (drawn, told) = ensemble_report(bare, PEAK), DESIGNS[sampling]
    assert report.lead == f"30 members {drawn}"
    notes = [note.text for note in report.notes]
    assert len(notes) == bool(told)
    assert told in "".join(notes)
    is_sobol = sampling in ("sobol", "saltelli")
    assert ("product of two of many inputs they may be too narrow" in "".join(notes)) == is_sobol


@pytest.mark.parametrize(("members", "are_even"), [(6, True), (12, True), (14, False), (4, False)])
def test_members_that_do_not_fill_the_grids_evenly_are_told(members: int, are_even: bool) -> None:
    """Expected: of 2 × 3 combinations, multiples of six have no note."""
    grids = {"loop": {"delay": {"grid": [0, 1]}}, "platform_mass": {"grid": ["1 t", "1.1 t", "1.2 t"]}}
    settings = {"loop.duration": 0.01, "ensemble": {"members": members, **grids}}
    notes = [note.text for note in gs.ensemble("heave_step", settings, workers=1).report(charts=False).notes]
    told = [text for text in notes if "grids with 6 combinations have the first ones more often" in text]
    assert bool(told) == (not are_even)


def test_the_worst_members_are_found_by_their_numbers() -> None:
    """Expected: of members 100 to 139 in reverse, each row has the numbers of its own member."""
    found = ensemble_of(normal(40), ["completed"] * 39 + ["diverged"])
    numbers = np.arange(139, 99, -1)
    found = with_columns(found, member=numbers)
    worst = worst_members(found.members, "margins.disk", 3)
    disk = found.values("margins.disk")
    assert worst == [100, *numbers[:39][np.argsort(disk[:39])][:2].tolist()]
    table = worst_table(found, worst, "stroke.margin")
    assert table.title == "Worst members by stroke margin"
    heads = ("platform_mass [kg]", "controller.bandwidth", "base_points[1,2] [m]", "leg_coulomb_friction [N]")
    assert heads_of(table) == ("member", "outcome", "stroke margin [mm]", *heads)
    for member, row in zip(worst, table.rows, strict=True):
        k = 139 - member
        assert row[:2] == (member, "diverged" if member == 100 else "completed")
        assert row[2:] == (found.values("stroke.margin")[k], *(found.values(name)[k] for name in INPUTS))
    page = page_of(ensemble_report(found, "stroke.margin", None, {worst[0]: "", worst[1]: "b&c/r.html"})).decode()
    assert f'<a href="b%26c/r.html">{worst[1]}</a>' in page
    assert f">{worst[0]}</th>" in page


def test_worst_members_that_complete_have_the_largest_value_and_no_value_is_the_best() -> None:
    """Expected: sorted by hand; of small margins, deviations and unstable loops the smallest; impossible never."""
    outcome = ["completed"] * 4 + ["stopped", "impossible", "diverged"]
    merit = [5.0, None, 9.0, 7.0, 1.0, 2.0, 3.0]
    found = with_columns(
        ensemble_of(normal(7), outcome), ended=[2.0, 2.0, 2.0, 2.0, 0.7, None, 0.3], force__peak=merit,
        stroke__margin=merit, margins__stable=[1.0, None, 0.0, 1.0, 1.0, 1.0, 1.0],
    )  # fmt: skip
    assert worst_members(found.members, "force.peak", 9) == [6, 4, 2, 3, 0, 1]
    assert worst_members(found.members, "stroke.margin", 5) == [6, 4, 0, 3, 2]
    assert worst_members(found.members, "margins.stable", 3) == [6, 4, 2]


def test_the_metric_of_the_worst_is_the_experiments_or_the_error_or_the_force() -> None:
    """Expected: `worst_by`, also by its short name; otherwise the first of the two that there is."""

    def ranked(worst: str | None, without: tuple[str, ...] = ()) -> str:
        found = ensemble_of(normal(9), experiment={"ensemble": {"worst_by": worst}})
        return worst_by(Ensemble(found.members.drop(without), found.bands, found.metadata))

    assert ranked(None) == PEAK
    assert ranked("stroke.margin") == "stroke.margin"
    assert ranked("disk_margin") == "margins.disk"
    assert ranked(None, (PEAK,)) == "force.peak"


def test_failures_beyond_the_most_frequent_are_one_row() -> None:
    """Expected: three causes of 3, 2 and 1 members; the others are counted together."""
    outcome = ["completed"] * 4 + ["diverged"] * 3 + ["stopped"] * 2 + ["impossible"] * 2 + ["diverged"]
    cause = [*[None] * 4, "at 1 s", "at 2 s", "at 7.5e-3 s", "by hand", "by hand", "no path", "no pose", None]
    found = ensemble_of(normal(12), outcome, cause)
    assert [(each.outcome, each.cause, each.members) for each in failures(found.members)] == [
        *[("diverged", "at 1 s", (4, 5, 6)), ("stopped", "by hand", (7, 8)), ("impossible", "no path", (9,))],
        *[("impossible", "no pose", (10,)), ("diverged", "", (11,))],
    ]
    table = failure_table(found.members, most=2)
    assert [column.name for column in table.columns] == ["member", "outcome", "cause", "members with it"]
    assert table.rows[:2] == ((4, "diverged", "at 1 s", 3), (7, "stopped", "by hand", 2))
    assert (table.first_shown, len(table.rows), table.links) == (2, 5, ())
    # only members whose runs were kept have a page
    assert failure_table(found.members, pages={7: "worst/member-7/report.html"}).links == (
        *("", "worst/member-7/report.html", "", "", ""),
    )


def test_all_metrics_are_shown_or_the_usual_ones() -> None:
    """Expected: usual ones in their order, none that is 0 for all or of no member; without them, all of the columns."""
    found = with_columns(
        ensemble_of(normal(40)), saturation__rate_limited__any=np.zeros(40), stroke__exceeded__any=np.zeros(40),
        tracking__leg_length__peak=np.full(40, np.nan), step_response__z__final_error=np.ones(40),
        force__rms=np.ones(40), margins__stable=np.zeros(40),
    )  # fmt: skip
    usual = rows_of(quantile_table(found.members, usual_metrics(found.members)))
    assert [row[0] for row in usual] == [
        *("position error, RMS mm", "position error, peak mm"),
        *("orientation error, peak deg", "z: overshoot %", "z: settling time s"),
        *("peak force N", "peak power W", "work, absolute J"),
        *("stroke margin mm", "force limited %", "stable", "disk margin"),
    ]
    table = quantile_table(found.members, found.metrics)
    every = rows_of(table)
    assert len(every) == len(found.metrics) == len(found.members.columns) - 4 - 4 - 2
    assert heads_of(table) == ("", "5 %", "25 %", "50 %", "75 %", "95 %", "members")
    cells = next(row for row in every if row[0] == "z: settling time s")
    values = found.members["step_response.z.settling_time"].drop_nulls().to_numpy()
    assert [float(str(cell)) for cell in cells[1:6]] == pytest.approx(
        np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95]).tolist(), rel=6e-3
    )
    assert cells[6] == str(len(values)) < "40"


def test_members_that_oscillate_are_counted_by_kind_with_the_largest() -> None:
    """Expected: the sentence by hand; the largest amplitude is neither first nor last; growing ones do not work."""
    kinds = [None, "growing", "oscillating", "oscillating", None, "oscillating", "growing", None]
    amplitude = [None, 0.1, 3e-4, 7.25e-3, None, 1e-3, 0.25, None]
    frequency = [None, 9.0, 11.0, 12.34, None, 13.0, None, None]
    found = with_columns(
        ensemble_of(normal(8), ["completed"] * 7 + ["stopped"]),
        oscillation=kinds, oscillation__amplitude=amplitude, oscillation__frequency=frequency,
    )  # fmt: skip
    assert oscillation_warning(found.members) == (
        "the loops of 3 of 8 members oscillate by themselves; member 3 has the largest amplitude, 7.25 mm at 12.3 Hz; "
        "the loops of 2 of 8 members grow by themselves; member 6 has the largest amplitude, 250 mm. "
        "`run --member K` shows one"
    )
    assert works(found.members).tolist() == [True, False, True, True, True, True, False, False]
    table = quantile_table(found.members, ["force.peak"])
    assert table.title == "8 members: 7 completed, 1 stopped (3 oscillating and 2 growing by themselves)"
    assert table.note == "Quantiles are without the 1 member not completed."
    sound = with_columns(found, oscillation=[None] * 3 + ["oscillating"] + [None] * 4)
    assert "7 completed, 1 stopped (1 oscillating by themselves)" in quantile_table(sound.members, ["force.peak"]).title
    assert (
        oscillation_warning(with_columns(found, oscillation=polars.Series([None] * 8, dtype=polars.String)).members)
        == ""
    )
    assert oscillation_warning(ensemble_of(normal(8)).members) == ""


def test_a_comparison_of_one_pair_has_a_difference_without_interval() -> None:
    """Expected: the difference of the one member that completed in both; of other numbers of members a refusal."""
    a = ensemble_of(normal(3), ["completed", "completed", "diverged"])
    b = ensemble_of(normal(3), ["diverged", "completed", "completed"])
    b = with_columns(b, force__peak=a.values("force.peak") - [1.0, 20.0, 300.0])
    found = compare(a, b, ("one", "two"))
    row = found.differences.filter(polars.col("metric") == "force.peak").row(0, named=True)
    assert (row["pairs"], row["mean"], row["median"], row["less_b"]) == (1, pytest.approx(-20), pytest.approx(-20), 1.0)
    assert row["mean_low"] is None
    assert row["mean_high"] is None
    gap = found.gaps
    assert gap.members["outcome"].to_list() == ["not in both", "completed", "not in both"]
    assert gap.members["ended"].to_list() == a.members["ended"].to_list()
    assert gap.varied == INPUTS
    assert gap.values("platform_mass").tolist() == a.values("platform_mass").tolist()
    assert gap.values("force.peak") == pytest.approx([-1, -20, -300])
    assert gap.title == "two − one"
    completed, mean, median = comparison_tables(found, usual_metrics(a.members))
    assert [row[1:] for row in completed.rows] == [(1, 1), (1, 0)]
    every = comparison_tables(found, found.a.metrics)[1]
    assert len(mean.rows) <= len(every.rows) == len(found.differences)
    (k,) = (k for k, row in enumerate(mean.rows) if row[0] == "peak force")
    assert mean.texts(k)[3:] == ("-20 N", "–", "–")
    assert (median.texts(k)[1], median.texts(k)[4]) == ("-20 N", "100")
    report = comparison_report(found)
    differences = report.number("difference.force.peak").members
    assert differences is not None
    np.testing.assert_allclose(differences, [np.nan, -20, np.nan])
    for path, each in (("force.peak", b), ("first.force.peak", a)):
        members = report.number(path).members
        assert members is not None
        assert members[1] == each.values("force.peak")[1]
    assert {each.path for each in report.numbers} <= {each.path for each in known_numbers()}
    renumbered = with_columns(b, member=[0, 1, 7])
    with pytest.raises(RecordError, match="3 and 3 members, 2 of them in both; expected the same members in both"):
        compare(a, renumbered)
    # members are joined by their number, whatever the order of the rows
    turned = compare(a, Ensemble(b.members.reverse(), b.bands, b.metadata))
    assert turned.gaps.members.equals(found.gaps.members)
    never = ensemble_of(normal(3), ["diverged"] * 3)
    assert compare(never, b).differences.is_empty()


def test_inputs_that_are_no_numbers_are_the_same_in_both() -> None:
    """Expected: names of files that vary have no value as numbers, which is no difference."""
    a = with_columns(ensemble_of(normal(5)), varied__controller__file=["a", "b", "c", "d", "e"])
    assert (compare(a, a).differences["pairs"] == 5).all()


def test_each_step_of_an_ensemble_is_told(tmp_path: Any) -> None:
    """Expected: what it does, in order; a resumed one that is finished only plans."""
    keys = {"loop.duration": 0.01}
    said, done = list[str](), list[tuple[int, int]]()

    def run(resume: bool) -> gs.Ensemble:
        return gs.ensemble(
            "heave_tolerances", keys, members=3, seed=4, out=tmp_path / "out", workers=1, resume=resume,
            status=said.append, progress=lambda k, of: done.append((k, of)),
        )  # fmt: skip

    first = run(resume=True)
    assert said == ["planning", "checking finished chunks", "running", "tables"]
    assert done == [(3, 3)]
    assert run(resume=True).members.equals(first.members)
    assert said[4:] == ["planning"]
    said.clear()
    run(resume=False)
    assert said == ["planning", "running", "running", "tables"]

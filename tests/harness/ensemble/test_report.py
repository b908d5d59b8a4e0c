"""What is said of an ensemble: how many machines do it, how well, how sure, and what makes them differ.

Members have figures of merit that are closed forms of what varies.
"""

import re
from dataclasses import replace
from math import comb, fsum
from typing import Any

import numpy as np
import polars
import pytest
from scipy.stats import binomtest

import gough_stewart as gs
from gough_stewart import Ensemble
from gough_stewart.harness.ensemble.ensemble_report import (
    ensemble_report,
    ensemble_verdict,
    failure_table,
    quantile_table,
    sensitivity_table,
    worst_table,
)
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, group_name, sensitivity
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.table import Table
from tests.support.arrays import FloatArray
from tests.support.ensembles import INPUTS, SLOPES, ensemble_of
from tests.support.page_arrays import data_of, unpacked

PEAK = "tracking.position.norm_peak"


def normal(n: int, seed: int = 2) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, 4))


def with_columns(ensemble: Ensemble, **columns: Any) -> Ensemble:
    series = [polars.Series(name.replace("__", "."), values) for name, values in columns.items()]
    return Ensemble(ensemble.members.with_columns(series), ensemble.bands, ensemble.metadata)


@pytest.mark.parametrize(("n", "lost"), [(400, 7), (25, 0), (40, 40)])
def test_the_verdict_counts_machines_with_an_exact_interval(n: int, lost: int) -> None:
    """Expected: SciPy's Clopper–Pearson interval in percent, to three digits; all, some or none complete."""
    found = ensemble_of(normal(n), ["completed"] * (n - lost) + ["diverged"] * lost)
    verdict = ensemble_report(found, PEAK).verdict
    test = binomtest(n - lost, n).proportion_ci(0.95, "exact")
    parts = re.match(
        r"([\d,]+) of ([\d,]+) machines complete their runs \(95 % confidence: (\S+) to (\S+) %\)", verdict.text
    )
    assert parts is not None, verdict.text
    assert (parts[1], parts[2]) == (str(n - lost), str(n))
    assert [float(parts[3]), float(parts[4])] == pytest.approx([100 * test.low, 100 * test.high], rel=6e-3)
    assert verdict.status == ("good" if not lost else "bad" if lost == n else "marginal")
    share = verdict.numbers[0]
    assert (share.value, share.low, share.high) == pytest.approx(((n - lost) / n, test.low, test.high))
    assert "Clopper" in share.explanation


def test_most_machines_stay_within_a_quantile_that_is_bounded_by_order_statistics() -> None:
    """Expected: the 95 % quantile of the completed, rounded up; ends that bracket it with ≥ 95 % by binomial sums."""
    rng = np.random.default_rng(3)
    made = ensemble_of(normal(1000), ["completed"] * 990 + ["stopped"] * 10)
    found = with_columns(made, **{PEAK: np.where(np.arange(1000) < 990, rng.gamma(3.0, 1e-4, 1000), 9.0)})
    verdict = ensemble_report(found, PEAK).verdict
    values = np.sort(found.values(PEAK)[:990])
    number = verdict.numbers[1]
    assert number.value == pytest.approx(np.quantile(values, 0.95))
    assert number.low is not None
    assert number.high is not None
    below, above = int((values < number.low).sum()), int((values <= number.high).sum())

    # P(r-th <= q) and P(s-th >= q), summed term by term
    def at_most(k: int) -> float:
        return fsum(comb(990, j) * 0.95**j * 0.05 ** (990 - j) for j in range(max(k - 400, 0), k + 1))

    assert at_most(below) <= 0.025 < at_most(below + 1)
    assert at_most(above - 2) < 0.975 <= at_most(above - 1)
    said = float(verdict.text.partition("stay within ")[2].split()[0])
    assert number.value is not None
    assert 1e3 * number.value <= said <= 1e3 * number.value * 1.1
    assert verdict.text.partition("stay within ")[2].startswith(f"{said:g} mm of their reference (")


def test_too_few_machines_give_no_upper_end() -> None:
    """Expected: with 25 members, 1 − 0.95²⁵ = 72 % is too little confidence that the largest is above the quantile."""
    verdict = ensemble_report(ensemble_of(normal(25)), PEAK).verdict
    assert verdict.numbers[1].high is None
    assert "; too few members for more)" in verdict.text


def test_a_growing_loop_does_not_count_and_the_cause_is_named_only_if_it_is_sure() -> None:
    made = ensemble_of(normal(30))
    kinds = ["growing"] * 2 + [None] * 28
    found = with_columns(made, oscillation=kinds, oscillation__amplitude=[0.1, 0.2, *[None] * 28],
                         oscillation__frequency=[None] * 30)  # fmt: skip
    names, main = ("a", "b"), np.array([0.3, -0.8])
    sure = Sensitivity(PEAK, "regression", names, main, np.array([0.1, 0.2]), None, None, 0.9, 30, 0)
    doubtful = Sensitivity(PEAK, "regression", names, main, np.array([0.1, 0.9]), None, None, 0.9, 30, 0)
    report = ensemble_report(found, PEAK, sure)
    assert report.verdict.text.startswith("28 of 30 machines complete their runs without a growing loop")
    assert report.verdict.text.endswith("; b matters most")
    assert "matters most" not in ensemble_report(found, PEAK, doubtful).verdict.text
    assert [note.kind for note in report.notes] == ["warning"]


def test_a_metric_that_is_better_if_larger_has_its_lower_quantile() -> None:
    """Expected: 95 % have at least the 5 % quantile, rounded down."""
    found = ensemble_of(normal(500))
    report = ensemble_report(found, "stroke.margin")
    value = np.quantile(found.values("stroke.margin"), 0.05)
    said = re.search(r"95 % of them have a stroke margin of at least (\S+) mm", report.verdict.text)
    assert said is not None
    assert 0 <= 1e3 * value - float(said[1]) < 0.1 * abs(1e3 * value)
    assert report.number("stroke.margin").value == pytest.approx(value)


def test_every_metric_has_a_value_for_each_member_and_none_where_the_run_ended_early() -> None:
    """Expected: the column of the table; NaN of members that did not complete, but for margins."""
    found = ensemble_of(normal(20), ["completed"] * 17 + ["diverged"] * 3)
    report = ensemble_report(found, PEAK)
    peak, disk = (report.number(path).members for path in (PEAK, "margins.disk"))
    assert peak is not None
    assert disk is not None
    np.testing.assert_array_equal(peak[:17], found.values(PEAK)[:17])
    assert np.isnan(peak[17:]).all()
    np.testing.assert_array_equal(disk, found.values("margins.disk"))


def test_who_has_not_settled_is_told_with_the_time_waited() -> None:
    """Expected: 12 of 18 completed members without a settling time, 1.5 s after a step at 0.5 s of 2 s."""
    made = ensemble_of(normal(20), ["completed"] * 18 + ["diverged"] * 2)
    times = [0.4] * 6 + [None] * 14
    found = with_columns(made, step_response__z__settling_time=times, step_response__z__at=[0.5] * 20,
                         ended=[2.0] * 18 + [0.7] * 2)  # fmt: skip
    table = next(part for part in ensemble_report(found, PEAK).parts() if isinstance(part, Table))
    assert "In 12 of 18 members z had not settled to 2 % 1.5 s after its step" in table.note


@pytest.mark.parametrize(
    ("name", "distribution", "is_said"),
    [
        ("platform_mass", {"uniform": [0.9, 1.1]}, True),
        ("platform_mass", {"uniform": [1100, 1300]}, False),
        ("platform_mass", {"normal": [120, 10]}, True),
        ("platform_mass", {"grid": [900, 1000]}, True),
        ("platform_mass", {"choice": [1250, 1200]}, False),
        ("platform_mass", {"factor": {"uniform": [0.9, 1.1]}}, False),
        ("leg_coulomb_friction", {"uniform": ["0 N", "100 N"]}, False),  # 100 N: at the end of it
        ("platform_com", {"uniform": [0.01, 0.02]}, False),
    ],
)
def test_a_distribution_without_the_nominal_value_is_a_warning_in_the_verdict(
    name: str, distribution: dict[str, object], is_said: bool
) -> None:
    """Expected: motion_base has 1216.9 kg; 0.9 to 1.1 kg is one kilogram, which "completes"; 0 is no factor."""
    few = {"members": 4, name: distribution, "base_points": {"normal": "0.2 mm"}}
    found = gs.ensemble("heave_step", {"loop.duration": 0.05, "ensemble": few}, workers=1).report(charts=False)
    mass = "the experiment's platform_mass of 1217 kg is "
    warning = f"{mass if is_said else ''}outside of its distribution"
    assert (warning.casefold() in found.verdict.text.casefold()) == is_said
    assert [warning in note.text for note in found.notes if note.kind == "warning"] == [True] * is_said
    assert (found.verdict.status == "marginal") == is_said


def test_an_ensemble_of_a_step_says_what_is_left_of_it_and_its_faults() -> None:
    """Expected: the 95 % quantile of the errors at the end, each of the records' last tenth; not the step of 50 mm."""
    few = {"members": 8, "platform_mass": {"uniform": [1000, 1400]}}
    settings = {"ensemble": few, "fault": [{"at": 0.6, "duration": 0.1, "cut": [3]}]}
    found = gs.ensemble("heave_step", settings, workers=1)
    final = found.values("tracking.position.norm_final")
    record = gs.run("heave_step", settings, member=5)
    error = np.linalg.norm(record["error.position"], axis=1)
    assert final[5] == pytest.approx(error[-201:].max(), rel=1e-6)
    assert error.max() > 0.049 > 5 * final.max()
    verdict = found.report(charts=False).verdict
    assert verdict.text.startswith("Leg 3 without force from 0.6 to 0.7 s; 8 of 8 machines")
    assert "95 % of them end within " in verdict.text
    assert verdict.numbers[1].value == pytest.approx(np.quantile(final, 0.95))


def failing() -> Ensemble:
    """60 members: three diverge for causes that differ in numbers, one is stopped, one is impossible."""
    outcome, cause = ["completed"] * 60, list[str | None]([None] * 60)
    for k, gap in ((4, "0.31"), (17, "1.2e-3"), (41, "12")):
        outcome[k], cause[k] = "diverged", f"the platform is {gap} m from its reference; the bound is 0.05 m"
    outcome[23], cause[23] = "stopped", "leg 3 is 1.7 m long; its stroke is 0.9 to 1.6 m"
    outcome[9], cause[9] = "impossible", "platform_mass is -3 kg; expected > 0 kg"
    return ensemble_of(normal(60), outcome, cause)


def test_an_effect_on_both_sides_is_seen_and_what_nothing_explains_is_not_named() -> None:
    """Expected: y of x₀² is a monotone function of |x₀ − 0|, whose rank has β = 1; y of x₀ x₁ is of neither."""
    members = ensemble_of(normal(4000))
    bent = sensitivity(members, "tracking.position.norm_rms")
    assert (bent.method, bent.order[0], bent.explains) == ("ranks", 0, True)
    np.testing.assert_allclose(bent.main, [1, 0, 0, 0], atol=0.05)
    assert bent.r2 == pytest.approx(1.0, abs=0.01)
    product = sensitivity(members, "power.peak")
    assert not product.explains
    assert "saltelli" in product.remark
    named = [ensemble_verdict(members, metric, sensitivity(members, metric)).text for metric in (PEAK, "power.peak")]
    assert [text.endswith("matters most") for text in named] == [True, False]
    # 40 members of which as many columns as there are numbers of them explain much by chance
    few = ensemble_of(normal(40))
    noise = {f"varied.noise[{k}]": np.random.default_rng(k).normal(size=40) for k in range(25)}
    chance = replace(few, members=few.members.with_columns(**{name: polars.Series(x) for name, x in noise.items()}))
    by_chance = sensitivity(chance, "power.peak")
    assert by_chance.r2 is not None
    assert by_chance.r2 > 0.7
    assert not by_chance.explains


def test_all_members_count_in_the_regression() -> None:
    """Expected: β = b = a/|a|, half widths 1.96 |b| √((1 − b²)/n) of a linear y of normal x, from all 30,000.

    ln β̂ₖ = ln bₖ + ln sₖ − ln s_y of sample deviations, whose covariances are 1/2n, 1/2n and bₖ²/2n. The bounds of 100
    resamples scatter by 12 %; four intervals within 35 % fail one time in 300.
    """
    x = normal(30_000)
    found = sensitivity(ensemble_of(x), PEAK)
    slopes = SLOPES / np.linalg.norm(SLOPES)
    expected = 1.96 * np.abs(slopes) * np.sqrt((1 - slopes**2) / len(x))
    assert (np.abs(found.main - slopes) <= 4 * expected + 1e-12).all()
    np.testing.assert_allclose(found.main_confidence, expected, rtol=0.35, atol=1e-12)
    assert ([INPUTS[k] for k in found.order], found.used, found.left_out) == (list(INPUTS), 30_000, 0)
    assert "30000 members; ± and whiskers" in found.remark
    # the first half, without which the other coefficients would be others
    x[:15_000, 0] *= 3
    joint = SLOPES * x.std(axis=0) / (x @ SLOPES).std()
    np.testing.assert_allclose(sensitivity(ensemble_of(x), PEAK).main, joint, atol=0.02)


def test_a_confidence_that_is_not_known_is_none() -> None:
    """Expected: of an input that differs in one member of 40, resamples without it have no coefficient, others do."""
    x = normal(40)
    x[:, 3] = 0.0
    x[7, 3] = 1.0
    found = sensitivity(ensemble_of(x), PEAK)
    assert np.isfinite(found.main_confidence).all()
    known = Sensitivity(PEAK, "regression", INPUTS[:1], np.ones(1), np.array([np.nan]), None, None, 1.0, 40, 0)
    assert page_of(ensemble_report(ensemble_of(x), PEAK, known)).startswith(b"<!doctype html>")


def test_integration_errors_far_beyond_the_tolerance_are_told() -> None:
    """Expected: the largest with its member, and how many are more than tenfold; nothing up to that."""
    ensemble = ensemble_of(normal(40), tolerance=1e-8)
    errors = np.full(40, 10 * 1e-8)
    assert not with_columns(ensemble, integration_error=errors).integration_warning(1e-8)
    errors[[3, 17]] = 2e-7, 3.4e-5
    said = with_columns(ensemble, integration_error=errors).integration_warning(1e-8)
    assert "up to 3.4e-05 in a plant step (member 17)" in said
    assert "the tolerance of 1e-08 in 2 of 40 members" in said


def test_an_ensemble_shows_itself_in_a_few_lines() -> None:
    """Expected: title, how many ended how, the failures, and no row beyond a hundred columns."""
    found = failing()
    text = repr(found)
    assert text.startswith("Ensemble: closed forms\n55 of 60 machines complete their runs (95 % confidence: ")
    assert "60 members: 55 completed, 3 diverged, 1 impossible, 1 stopped" in text
    assert "platform_mass is -3 kg" in text
    assert max(map(len, text.splitlines()[2:])) <= 100  # a verdict is one line
    assert found._repr_html_().count("<table>") == 3


def test_what_cannot_be_said_is_refused_with_the_reason() -> None:
    """Expected: the message names the metric, and what is missing."""
    ensemble = ensemble_of(normal(40))
    with pytest.raises(gs.GoughStewartError, match=r"no metric 'force.peek'.*force\.peak"):
        sensitivity(ensemble, "force.peek")
    with pytest.raises(gs.GoughStewartError, match="6 members have a value; expected at least 7 for 4 inputs"):
        sensitivity(ensemble_of(normal(6)), PEAK)
    members = ensemble.members.with_columns(polars.lit(1.0).alias(PEAK))
    with pytest.raises(gs.GoughStewartError, match="is the same for all members"):
        sensitivity(Ensemble(members, ensemble.bands, ensemble.metadata), PEAK)
    assert group_name(["base_points[1,1]", "base_points[1,2]", "platform_mass"]) == "base_points & platform_mass"


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
    worst = found.worst_members("margins.disk", 3)
    disk = found.values("margins.disk")
    assert worst == [100, *numbers[:39][np.argsort(disk[:39])][:2].tolist()]
    table = worst_table(found, worst, "stroke.margin")
    assert table.title == "Worst members by stroke margin"
    heads = ("platform_mass [kg]", "controller.bandwidth", "base_points[1,2] [m]", "leg_coulomb_friction [N]")
    assert table.heads == ("member", "outcome", "stroke margin [mm]", *heads)
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
    assert found.worst_members("force.peak", 9) == [6, 4, 2, 3, 0, 1]
    assert found.worst_members("stroke.margin", 5) == [6, 4, 0, 3, 2]
    assert found.worst_members("margins.stable", 3) == [6, 4, 2]


def test_the_metric_of_the_worst_is_the_experiments_or_the_error_or_the_force() -> None:
    """Expected: `worst_by`, also by its short name; otherwise the first of the two that there is."""

    def ranked(worst: str | None, without: tuple[str, ...] = ()) -> str:
        found = ensemble_of(normal(9), experiment={"ensemble": {"worst_by": worst}})
        return Ensemble(found.members.drop(without), found.bands, found.metadata).worst_by

    assert ranked(None) == PEAK
    assert ranked("stroke.margin") == "stroke.margin"
    assert ranked("disk_margin") == "margins.disk"
    assert ranked(None, (PEAK,)) == "force.peak"


def test_failures_beyond_the_most_frequent_are_one_row() -> None:
    """Expected: three causes of 3, 2 and 1 members; the others are counted together."""
    outcome = ["completed"] * 4 + ["diverged"] * 3 + ["stopped"] * 2 + ["impossible"] * 2 + ["diverged"]
    cause = [*[None] * 4, "at 1 s", "at 2 s", "at 7.5e-3 s", "by hand", "by hand", "no path", "no pose", None]
    found = ensemble_of(normal(12), outcome, cause)
    assert [(each.outcome, each.cause, each.members) for each in found.failures] == [
        *[("diverged", "at 1 s", (4, 5, 6)), ("stopped", "by hand", (7, 8)), ("impossible", "no path", (9,))],
        *[("impossible", "no pose", (10,)), ("diverged", "", (11,))],
    ]
    table = failure_table(found, most=2)
    assert [column.name for column in table.columns] == ["member", "outcome", "cause", "members with it"]
    assert table.rows[:2] == ((4, "diverged", "at 1 s", 3), (7, "stopped", "by hand", 2))
    assert (table.first_shown, len(table.rows), table.links) == (2, 5, ())
    # only members whose runs were kept have a page
    assert failure_table(found, pages={7: "worst/member-7/report.html"}).links == (
        *("", "worst/member-7/report.html", "", "", ""),
    )


def test_all_metrics_are_shown_or_the_usual_ones() -> None:
    """Expected: usual ones in their order, none that is 0 for all or of no member; without them, all of the columns."""
    found = with_columns(
        ensemble_of(normal(40)), saturation__rate_limited__any=np.zeros(40), stroke__exceeded__any=np.zeros(40),
        tracking__leg_length__peak=np.full(40, np.nan), step_response__z__final_error=np.ones(40),
        force__rms=np.ones(40), margins__stable=np.zeros(40),
    )  # fmt: skip
    usual = quantile_table(found, found.usual_metrics).shown
    assert [row[0] for row in usual] == [
        *("position error, RMS mm", "position error, peak mm"),
        *("orientation error, peak deg", "z: overshoot %", "z: settling time s"),
        *("peak force N", "peak power W", "work, absolute J"),
        *("stroke margin mm", "force limited %", "stable", "disk margin"),
    ]
    table = quantile_table(found, found.metrics)
    every = table.shown
    assert len(every) == len(found.metrics) == len(found.members.columns) - 4 - 4 - 2
    assert table.heads == ("", "5 %", "25 %", "50 %", "75 %", "95 %", "members")
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
    assert found.oscillation_warning == (
        "the loops of 3 of 8 members oscillate without input; member 3 has the largest amplitude, 7.25 mm at 12.3 Hz; "
        "the loops of 2 of 8 members grow without input; member 6 has the largest amplitude, 250 mm. "
        "`run --member K` shows one"
    )
    assert found.works.tolist() == [True, False, True, True, True, True, False, False]
    table = quantile_table(found, ["force.peak"])
    assert table.title == "8 members: 7 completed, 1 stopped (3 oscillating and 2 growing without input)"
    assert table.note == "Quantiles are without the 1 member not completed."
    sound = with_columns(found, oscillation=[None] * 3 + ["oscillating"] + [None] * 4)
    assert "7 completed, 1 stopped (1 oscillating without input)" in quantile_table(sound, ["force.peak"]).title
    assert with_columns(found, oscillation=polars.Series([None] * 8, dtype=polars.String)).oscillation_warning == ""
    assert ensemble_of(normal(8)).oscillation_warning == ""


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

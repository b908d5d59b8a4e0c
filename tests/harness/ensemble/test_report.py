"""What is said of an ensemble whose figures of merit are closed forms of what varies."""

import re
from typing import Any

import numpy as np
import polars
import pytest
from scipy.stats import binom, binomtest

import gough_stewart as gs
from gough_stewart import Ensemble
from tests.harness.ensemble.ensembles import INPUTS, LEVELS, PEAK, ensemble_of, judged_by, normal, with_columns
from tests.support.reports import tables_of


def charts_of(ensemble: Ensemble, group: str) -> list[Any]:
    return [chart for chart in ensemble.report().charts if chart.group == group]


# --- the verdict


@pytest.mark.parametrize(("n", "lost"), [(400, 7), (25, 0), (40, 40)])
def test_the_verdict_counts_machines_with_an_exact_interval(n: int, lost: int) -> None:
    """Expected: SciPy's Clopper–Pearson interval in percent, to three digits; all, some or none complete."""
    verdict = ensemble_of(normal(n), ["completed"] * (n - lost) + ["diverged"] * lost).report().verdict
    test = binomtest(n - lost, n).proportion_ci(0.95, "exact")
    said = re.match(r"(\d+) of (\d+) machines complete their runs \(95 % confidence: (\S+) to (\S+) %\)", verdict.text)
    assert said is not None, verdict.text
    assert (said[1], said[2]) == (str(n - lost), str(n))
    assert [float(said[3]), float(said[4])] == pytest.approx([100 * test.low, 100 * test.high], rel=6e-3)
    assert verdict.status == ("good" if not lost else "bad" if lost == n else "marginal")
    share = verdict.numbers[0]
    assert (share.value, share.low, share.high) == pytest.approx(((n - lost) / n, test.low, test.high))
    assert "Clopper" in share.explanation


@pytest.mark.parametrize("metric", [PEAK, "stroke.margin"])
@pytest.mark.parametrize(("n", "lost"), [(25, 0), (59, 3), (400, 10)])
def test_most_machines_stay_within_a_quantile_between_order_statistics(metric: str, n: int, lost: int) -> None:
    """Expected: the 95 % quantile, of a margin that of 5 %; ends by sums of the binomial distribution, or none."""
    outcome = ["completed"] * n + ["stopped"] * lost
    found = with_columns(ensemble_of(normal(n + lost), outcome), **judged_by(metric))
    values, level = np.sort(found.values(metric)[:n]), 0.95 if metric == PEAK else 0.05
    verdict = found.report(charts=False).verdict
    number = verdict.numbers[1]
    assert number.value == found.report().number(metric).value == pytest.approx(np.quantile(values, level))
    lows = [r for r in range(1, n + 1) if binom.cdf(r - 1, n, level) <= 0.025]
    highs = [s for s in range(1, n + 1) if binom.cdf(s - 1, n, level) >= 0.975]
    assert (number.low, number.high) == (
        values[max(lows) - 1] if lows else None,
        values[min(highs) - 1] if highs else None,
    )
    assert ("too few members for more" in verdict.text) == (not lows or not highs)
    words = "95 % of them stay within (\\S+) mm of" if metric == PEAK else "a stroke margin of at least (\\S+) mm"
    said = re.search(words, verdict.text)
    assert said is not None, verdict.text
    assert number.value is not None
    # rounded to the side on which it stays true
    gap = (float(said[1]) - 1e3 * number.value) * (1 if metric == PEAK else -1)
    assert 0 <= gap <= 0.1 * abs(1e3 * number.value)


def test_members_that_oscillate_are_counted_by_kind_and_growing_ones_do_not_work() -> None:
    """Expected: the sentence by hand; the largest amplitude is neither first nor last."""
    made = ensemble_of(normal(8), ["completed"] * 7 + ["stopped"])
    assert not [note for note in made.report().notes if note.kind == "warning"]  # of an older version: no such column
    kinds = [None, "growing", "oscillating", "oscillating", None, "oscillating", "growing", None]
    columns = {
        "oscillation": kinds,
        "oscillation.amplitude": [None, 0.1, 3e-4, 7.25e-3, None, 1e-3, 0.25, None],
        "oscillation.frequency": [None, 9.0, 11.0, 12.34, None, 13.0, None, None],
    }
    report = with_columns(made, columns).report()
    assert [note.text for note in report.notes if note.kind == "warning"] == [
        "the loops of 3 of 8 members oscillate without input; member 3 has the largest amplitude, 7.25 mm at 12.3 Hz; "
        "the loops of 2 of 8 members grow without input; member 6 has the largest amplitude, 250 mm. "
        "`run --member K` shows one"
    ]
    assert report.verdict.text.startswith("5 of 8 machines complete their runs without a growing loop")
    title = "8 members: 7 completed, 1 stopped (3 oscillating and 2 growing without input)"
    assert tables_of(report)[title].note.endswith("Quantiles are without the 1 member not completed.")
    one = {**columns, "oscillation": [None] * 3 + ["oscillating"] + [None] * 4}
    assert "8 members: 7 completed, 1 stopped (1 oscillating without input)" in tables_of(
        with_columns(made, one).report()
    )


@pytest.mark.parametrize(
    ("name", "distribution", "is_outside"),
    [
        ("platform_mass", {"uniform": [0.9, 1.1]}, True),
        ("platform_mass", {"grid": [1300, 1400]}, True),
        ("platform_mass", {"choice": [1250, 1200]}, False),
        ("platform_mass", {"factor": {"uniform": [0.9, 1.1]}}, False),
        ("leg_coulomb_friction", {"uniform": ["0 N", "100 N"]}, False),  # 100 N: at the end of it
        ("platform_com", {"uniform": [0.01, 0.02]}, False),
    ],
)
def test_a_distribution_without_the_nominal_value_is_a_warning_in_the_verdict(
    name: str, distribution: dict[str, object], is_outside: bool
) -> None:
    """Expected: motion_base has 1216.9 kg; 0.9 to 1.1 kg is one kilogram, which "completes"; 0 is no factor."""
    few = {"members": 2, name: distribution, "base_points": {"normal": "0.2 mm"}}
    settings = {"loop.duration": 0.01, "reference.at": 0.002, "ensemble": few}
    report = gs.ensemble("heave_step", settings, workers=1).report(charts=False)
    mass = "the experiment's platform_mass of 1217 kg is "
    warning = f"{mass if is_outside else ''}outside of its distribution"
    assert (warning.casefold() in report.verdict.text.casefold()) == is_outside
    assert [warning in note.text for note in report.notes if note.kind == "warning"] == [True] * is_outside
    assert (report.verdict.status == "marginal") == is_outside


def test_an_ensemble_of_a_step_says_what_is_left_of_it_and_its_faults() -> None:
    """Expected: the 95 % quantile of the errors at the end, each of the records' last tenth; not the step of 50 mm."""
    few = {"members": 8, "platform_mass": {"uniform": [1000, 1400]}}
    settings = {"ensemble": few, "fault": [{"at": 0.6, "duration": 0.1, "cut": [3]}]}
    found = gs.ensemble("heave_step", settings, workers=1)
    final = found.values("tracking.position.norm_final")
    error = np.linalg.norm(gs.run("heave_step", settings, member=5)["error.position"], axis=1)
    assert final[5] == pytest.approx(error[-201:].max(), rel=1e-6)
    assert error.max() > 0.049 > 5 * final.max()
    verdict = found.report(charts=False).verdict
    assert verdict.text.startswith("Leg 3 without force from 0.6 to 0.7 s; 8 of 8 machines")
    assert "95 % of them end within " in verdict.text
    assert verdict.numbers[1].value == pytest.approx(np.quantile(final, 0.95))


# --- what makes members differ


def test_an_effect_on_both_sides_is_seen_and_what_nothing_explains_is_not_named() -> None:
    """Expected: y of x₀² is a monotone function of |x₀ − 0|, whose rank has β = 1; y of x₀ x₁ is of neither."""
    members = ensemble_of(normal(2500))
    bent = with_columns(members, **judged_by("tracking.position.norm_rms")).report()
    table = tables_of(bent)["What makes the position error, RMS vary"]
    assert table.rows[0][0] == INPUTS[0]
    assert [row[1] for row in table.rows] == pytest.approx([1, 0, 0, 0], abs=0.07)
    assert table.note.startswith("Standardised regression of the metric's rank on that of each input's distance")
    product = with_columns(members, **judged_by("power.peak")).report()
    assert "use sampling = 'saltelli'" in tables_of(product)["What makes the peak power vary"].note
    named = [report.verdict.text.endswith("platform_mass matters most") for report in (members.report(), bent, product)]
    assert named == [True, True, False]
    # 40 members of which as many columns as there are numbers of them explain much by chance
    noise = {f"varied.noise[{k}]": np.random.default_rng(k).normal(size=40) for k in range(25)}
    by_chance = with_columns(ensemble_of(normal(40)), noise, **judged_by("power.peak")).report()
    note = tables_of(by_chance)["What makes the peak power vary"].note
    share = re.search(r"R² = (0\.\d+)", note)
    assert share is not None
    assert float(share[1]) > 0.7
    assert "matter" not in by_chance.verdict.text


@pytest.mark.parametrize("what", ["six members", "all alike", "nothing varies"])
def test_too_little_for_a_regression_leaves_the_inputs_in_the_order_of_the_table(what: str) -> None:
    """Expected: 7 members tell of 4 inputs, 6 do not; without sensitivity no cause, and charts by column."""
    assert "What makes the position error, peak vary" in tables_of(ensemble_of(normal(7)).report())
    found = ensemble_of(normal(6 if what == "six members" else 40))
    if what == "all alike":
        found = with_columns(found, {PEAK: np.ones(40)})
    if what == "nothing varies":
        found = Ensemble(found.members.drop(f"varied.{name}" for name in INPUTS), found.bands.clear(), {})
    report = found.report()
    assert not [title for title in tables_of(report) if title.startswith("What makes")]
    groups = list(dict.fromkeys(chart.group for chart in report.charts))
    if what == "nothing varies":
        assert groups == ["distribution"]
    else:
        assert groups == ["distribution", "bands", "dependence"]
        assert [chart.x.name for chart in charts_of(found, "dependence")] == list(INPUTS)
    with pytest.raises(gs.GoughStewartError, match=r"no metric 'force.peek'.*force\.peak"):
        found.values("force.peek")


# --- tables


def test_every_metric_has_a_value_for_each_member_and_none_where_the_run_ended_early() -> None:
    """Expected: the column of the table; NaN of members that did not complete, but for margins."""
    found = ensemble_of(normal(20), ["completed"] * 17 + ["diverged"] * 3)
    report = found.report()
    peak, disk = (report.number(path).members for path in (PEAK, "margins.disk"))
    assert peak is not None
    assert disk is not None
    np.testing.assert_array_equal(peak, np.append(found.values(PEAK)[:17], [np.nan] * 3))
    np.testing.assert_array_equal(disk, found.values("margins.disk"))


def test_who_has_not_settled_is_counted_with_the_time_waited() -> None:
    """Expected: 12 of 18 completed members without a settling time, 1.5 s after a step at 0.5 s of 2 s."""
    made = ensemble_of(normal(20), ["completed"] * 18 + ["diverged"] * 2)
    columns = {"step_response.z.settling_time": [0.4] * 6 + [None] * 14, "step_response.z.at": [0.5] * 20,
               "ended": [2.0] * 18 + [0.7] * 2}  # fmt: skip
    (table, *_) = tables_of(with_columns(made, columns).report()).values()
    assert "In 12 of 18 members z had not settled to 2 % 1.5 s after its step" in table.note


# Words and units of docs/ensembles.md, in the order of the table.
USUAL = {
    **{f"tracking.{pose}.norm_{kind}": (f"{pose} error, {words}", unit)
       for pose, unit in (("position", "mm"), ("orientation", "deg"))
       for kind, words in (("rms", "RMS"), ("peak", "peak"), ("final", "at the end"))},
    "tracking.leg_length.peak": ("leg error, peak", "mm"),
    **{f"step_response.{axis}.{name}": (f"{axis}: {words}", unit)
       for axis in ("x", "y", "z", "roll", "pitch", "yaw")
       for name, words, unit in (("overshoot_percent", "overshoot", "%"), ("rise_time", "rise time", "s"),
                                 ("settling_time", "settling time", "s"))},
    "force.peak": ("peak force", "N"),
    "power.peak": ("peak power", "W"),
    "energy.absolute_total": ("work, absolute", "J"),
    "stroke.margin": ("stroke margin", "mm"),
    "saturation.force_limited.any": ("force limited", "%"),
    "saturation.rate_limited.any": ("rate limited", "%"),
    "stroke.exceeded.any": ("beyond stroke", "%"),
    "margins.stable": ("stable", ""),
    "margins.disk": ("disk margin", ""),
}  # fmt: skip


def test_the_first_table_has_all_usual_metrics_and_the_last_all_of_them() -> None:
    """Expected: quantiles by NumPy of those that have the number; none that is 0 for all, or of no member."""
    made = ensemble_of(normal(4))
    columns = {name: np.full(4, 0.0123 * (k + 1)) for k, name in enumerate(USUAL)}
    columns |= {"force.rms": np.ones(4), "power.mean": np.ones(4), "step_response.z.at": np.ones(4)}
    some = {"force.peak": np.array([1.0, 2.0, 4.0, np.nan]), "stroke.exceeded.any": np.zeros(4),
            "tracking.leg_length.peak": np.full(4, np.nan)}  # fmt: skip
    whole = Ensemble(made.members.select("member", "outcome", "ended", "cause"), made.bands, {})
    usual, everything = (tables_of(with_columns(whole, columns | more).report()) for more in ({}, some))
    shown = usual["4 members: 4 completed"]
    rows = {row[0]: row[1:] for row in shown.rows}
    # the unfolded table comes last, under the same title
    assert len(rows) == len(USUAL) + 3
    for name, (words, unit) in USUAL.items():
        *quantiles, members = rows[words]
        assert [cell.value for cell in quantiles] == pytest.approx([columns[name][0]] * 5)
        assert members == 4
        assert {cell.quantity.unit for cell in quantiles} == {unit}
    parts = with_columns(whole, columns | some).report().parts()
    first: Any = next(part for part in parts if hasattr(part, "rows"))
    left_out = {"stroke.exceeded.any", "tracking.leg_length.peak"}
    order = [words for name, (words, _) in USUAL.items() if name not in left_out]
    steps = [words for words in order if ": " in words]
    assert [row[0] for row in first.rows if ": " not in row[0]] == [words for words in order if words not in steps]
    assert {row[0] for row in first.rows if ": " in row[0]} == set(steps)
    assert [column.name for column in first.columns] == ["", "5 %", "25 %", "50 %", "75 %", "95 %", "members"]
    forces = {row[0]: row for row in everything["4 members: 4 completed"].rows}["peak force"]
    quantiles = np.quantile([1, 2, 4], [0.05, 0.25, 0.5, 0.75, 0.95])
    assert [cell.value for cell in forces[1:6]] == pytest.approx(quantiles.tolist())
    assert forces[6] == 3


def test_failures_are_counted_by_cause_the_most_frequent_first() -> None:
    """Expected: causes that differ only in numbers are one, of its first member; a page where the run was kept."""
    outcome = ["completed"] * 4 + ["diverged"] * 3 + ["stopped"] * 2 + ["impossible"] * 2 + ["diverged"]
    cause = [*[None] * 4, "at 1 s", "at 2 s", "at 7.5e-3 s", "by hand", "by hand", "no path", "no pose", None]
    found = ensemble_of(normal(12), outcome, cause)
    table = tables_of(found.report(worst={7: "worst/member-7/report.html"}))["Not completed"]
    assert table.rows == (
        (4, "diverged", "at 1 s", 3), (7, "stopped", "by hand", 2), (9, "impossible", "no path", 1),
        (10, "impossible", "no pose", 1), (11, "diverged", "", 1),
    )  # fmt: skip
    assert table.links == ("", "worst/member-7/report.html", "", "", "")
    text = repr(found)
    assert text.startswith("Ensemble: closed forms\n4 of 12 machines complete their runs (95 % confidence: ")
    assert "12 members: 4 completed, 4 diverged, 2 impossible, 2 stopped" in text
    assert max(map(len, text.splitlines()[2:])) <= 100  # a verdict is one line
    assert found._repr_html_().count("<table>") == 2


def test_the_worst_members_are_those_with_the_largest_value_and_before_them_those_that_failed() -> None:
    """Expected: sorted by hand; of small margins, deviations and unstable loops the smallest; impossible never."""
    outcome = ["completed"] * 4 + ["stopped", "impossible", "diverged"]
    merit, number = [5.0, None, 9.0, 7.0, 1.0, 2.0, 3.0], np.arange(106, 99, -1)
    columns = {"ended": [2.0, 2.0, 2.0, 2.0, 0.7, None, 0.3], "force.peak": merit, "stroke.margin": merit,
               "margins.stable": [1.0, None, 0.0, 1.0, 1.0, 1.0, 1.0], "member": number}  # fmt: skip
    found = with_columns(ensemble_of(normal(7), outcome), columns)
    for metric, rows in (
        ("force.peak", [6, 4, 2, 3, 0, 1]), ("stroke.margin", [6, 4, 0, 3, 2]), ("margins.stable", [6, 4, 2]),
    ):  # fmt: skip
        assert found.worst_members(metric, len(rows)) == number[rows].tolist()
    by_stroke = with_columns(found, **judged_by("stroke.margin"))
    table = tables_of(by_stroke.report(worst={100: "", 102: "b&c/r.html"}))["Worst members by stroke margin"]
    heads = ("platform_mass [kg]", "controller.bandwidth", "base_points[1,2] [m]", "leg_coulomb_friction [N]")
    assert tuple(column.title for column in table.columns) == ("member", "outcome", "stroke margin [mm]", *heads)
    for row, member, k in zip(table.rows, (100, 102), (6, 4), strict=True):
        assert row == (member, outcome[k], merit[k], *(found.values(name)[k] for name in INPUTS))
    assert table.links == ("", "b&c/r.html")


@pytest.mark.parametrize(
    ("asked", "without", "metric"),
    [(None, (), PEAK), ("stroke.margin", (), "stroke.margin"), ("disk_margin", (), "margins.disk"),
     (None, (PEAK,), "force.peak")],
)  # fmt: skip
def test_the_metric_of_the_worst_is_the_experiments_or_the_error_or_the_force(
    asked: str | None, without: tuple[str, ...], metric: str
) -> None:
    found = ensemble_of(normal(9), experiment={"ensemble": {"worst_by": asked}})
    assert Ensemble(found.members.drop(without), found.bands, found.metadata).worst_by == metric


# --- notes


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
def test_the_design_and_what_it_means_for_confidence_are_said(sampling: str) -> None:
    """Expected: no note on independent members; of Sobol points what may make the intervals too narrow."""
    report, (drawn, note) = ensemble_of(normal(30), sampling=sampling).report(), DESIGNS[sampling]
    assert report.lead == f"30 members {drawn}, seed 7"
    notes = "".join(each.text for each in report.notes)
    assert len(report.notes) == bool(note)
    assert note in notes
    is_sobol = sampling in ("sobol", "saltelli")
    assert ("product of two of many inputs they may be too narrow" in notes) == is_sobol


def test_members_that_do_not_fill_the_grids_evenly_and_steps_that_are_too_long_are_warnings() -> None:
    """Expected: of 2 × 3 combinations, multiples of six have none; errors up to tenfold the tolerance have none."""
    grids = {"loop": {"delay": {"grid": [0, 1]}}, "platform_mass": {"grid": ["1 t", "1.1 t", "1.2 t"]}}
    settings = {"loop.duration": 0.01, "ensemble": {"members": 4, **grids}}
    notes = gs.ensemble("heave_step", settings, workers=1).report().notes
    assert notes[1].text.startswith("4 members of grids with 6 combinations")

    def warnings(members: int, errors: Any, **metadata: Any) -> list[str]:
        made = with_columns(ensemble_of(normal(members)), {"integration_error": errors}, tolerance=1e-8, **metadata)
        return [note.text for note in made.report().notes if note.kind == "warning"]

    small = np.full(42, 10 * 1e-8)
    assert warnings(42, small, combinations=6, substeps=4) == []
    (uneven,) = warnings(40, small[:40], combinations=6)
    assert uneven.startswith("40 members of grids with 6 combinations have the first ones more often")
    errors = small.copy()
    errors[[3, 17]] = 2e-7, 3.4e-5
    assert warnings(42, errors) == []  # of controlled steps
    (far,) = warnings(42, errors, substeps=4)
    assert "up to 3.4e-05 in a plant step (member 17)" in far
    assert "the tolerance of 1e-08 in 2 of 42 members" in far


# --- charts


N = 3350
# With the title of the axis and its factor.
SIGNALS = {
    "position[1]": ("x [m]", 1.0),
    "orientation[2]": ("pitch [deg]", 180 / np.pi),
    "velocity[2]": ("velocity 2 [m/s]", 1.0),
    "leg_velocity[6]": ("leg velocity 6 [m/s]", 1.0),
    "actuator_force[4]": ("actuator force 4 [N]", 1.0),
    "error.leg_length[5]": ("error of leg length 5 [mm]", 1e3),
    "error.position.norm": ("error of position, norm [mm]", 1e3),
    "error.orientation[3]": ("error of yaw [deg]", 180 / np.pi),
    "angular_velocity[1]": ("angular velocity 1 [deg/s]", 180 / np.pi),
}
# Of less and less influence on the peak error, with their units.
VARIED = {
    **{"leg_viscous_friction[4]": " [N·s/m]", "platform_mass": " [kg]", "loop.delay": "", "base_points[2,3]": " [m]"},
    **{"sensors.noise.leg_length": "", "plant.parameters.leg_lower_mass": " [kg]", "gravity[1]": " [m/s²]"},
    **{"platform.leg_length_max": " [m]", "disturbance.1.force[2]": "", "reference.at": "", "platform_com[3]": " [m]"},
    **{f"controller.gain[{k}]": "" for k in range(6)},
}


@pytest.fixture(scope="module")
def uneven() -> Ensemble:
    """Columns of random numbers, each about another mean; nine members diverge, two of them with huge errors."""
    rng = np.random.default_rng(5)
    diverged = np.arange(N) % 400 == 100
    x = rng.normal(size=(N, len(VARIED)))
    # in the table, the least influential input comes first
    columns: dict[str, Any] = {"member": np.arange(N)}
    columns |= {f"varied.{name}": 3.0 + k + 0.1 * x[:, k] for k, name in reversed([*enumerate(VARIED)])}
    columns |= {"varied.controller.file": ["a.py"] * N}
    columns |= {"outcome": np.where(diverged, "diverged", "completed"), "ended": 2.0, "cause": None}
    columns |= {name: 0.01 * (k + 1) * (1 + 0.1 * rng.normal(size=N)) for k, name in enumerate(USUAL)}
    columns[PEAK] = 0.02 + 1e-4 * x @ (2.0 ** -np.arange(len(VARIED)))
    columns[PEAK][[100, 3300]] = 7.0, 9.0
    columns["force.peak"][[5, 9]] = 40.0, -3.0
    columns["power.peak"][diverged] = 1e6
    bands = [
        {"signal": name, "time": t, **dict(zip(LEVELS, row, strict=True))}
        for k, name in enumerate(SIGNALS)
        for t, row in zip((7.3 + 0.25 * np.arange(5)).tolist(), np.sort(k + rng.normal(size=(5, 7))), strict=True)
    ]
    return Ensemble(polars.DataFrame(columns), polars.DataFrame(bands), {"title": "uneven", "sampling": "random"})


def test_bands_are_those_of_the_table(uneven: Ensemble) -> None:
    """Expected: all signals, errors first; edges of the three bands and the median, of every time, in shown units."""
    charts = charts_of(uneven, "bands")
    shown = sorted(SIGNALS, key=lambda name: not name.startswith("error."))
    assert [chart.y_title for chart in charts] == [SIGNALS[name][0] for name in shown]
    for chart, name in zip(charts, shown, strict=True):
        part = uneven.bands.filter(polars.col("signal") == name)
        assert (chart.title, chart.note) == (SIGNALS[name][0].partition(" [")[0], "Of the members still running.")
        assert chart.x.values.tolist() == part["time"].to_list()
        assert [s.name for s in chart.series] == ["lowest to highest", "5 to 95 %", "25 to 75 %", "median"]
        for series, ends in zip(chart.series, (("lowest", "highest"), ("q05", "q95"), ("q25", "q75")), strict=False):
            np.testing.assert_array_equal([series.low, series.high], [part[end] for end in ends])
        np.testing.assert_array_equal(chart.series[3].values, part["q50"])
        assert chart.series[0].quantity.factor == pytest.approx(SIGNALS[name][1])
    for n, more in ((10_000, ""), (10_001, " Quantiles are of the first 10,000 members.")):
        many = Ensemble(polars.concat([uneven.members] * 3).head(n), uneven.bands, uneven.metadata)
        assert {chart.note for chart in charts_of(many, "bands")} == {f"Of the members still running.{more}"}


def test_histograms_are_of_the_members_that_completed(uneven: Ensemble) -> None:
    """Expected: that of the verdict first; counts, quantiles, and what lies outside, by NumPy; margins of all."""
    charts, order = charts_of(uneven, "distribution"), [PEAK, *(name for name in USUAL if name != PEAK)]
    assert {chart.x.name for chart in charts} == {USUAL[name][0] for name in order}
    assert charts[0].x.name == USUAL[PEAK][0]
    by_words = {chart.x.name: chart for chart in charts}
    for name in order:
        chart, is_margin = by_words[USUAL[name][0]], name.startswith("margins.")
        members = uneven.members if is_margin else uneven.members.filter(polars.col("outcome") == "completed")
        values = np.sort(members[name].to_numpy())
        assert len(values) == (N if is_margin else N - 9)
        counts, edges = chart.series[0].values, chart.x.values
        outliers = 2 if name == "force.peak" else 0
        inside = values[outliers // 2 : len(values) - outliers // 2]
        assert edges == pytest.approx(np.linspace(inside[0], inside[-1], 41))
        # a value at an edge may round to either side
        assert np.abs(counts - np.histogram(inside, edges)[0]).sum() <= 2
        assert [mark.value for mark in chart.marks] == pytest.approx(np.quantile(values, [0.05, 0.5, 0.95]).tolist())
        assert chart.note == ("peak force: 2 members outside, -3 to 40 N in all." if outliers else "")


@pytest.mark.parametrize("others", [0, 1])
def test_a_metric_that_is_all_but_constant_has_a_histogram(others: int) -> None:
    """Expected: all 400 values between the edges, none of them an outlier."""
    values = np.append(np.full(400 - others, 5.0), np.full(others, 9.0))
    found = with_columns(ensemble_of(normal(400)), {"force.peak": values}, **judged_by("force.peak"))
    chart = charts_of(found, "distribution")[0]
    assert np.sum(chart.series[0].values) == 400
    edges = chart.x.values
    assert (edges[0], edges[-1], chart.note) == ((5.0, 9.0, "") if others else (4.5, 5.5, ""))


def test_the_metric_is_drawn_against_the_most_influential_inputs(uneven: Ensemble) -> None:
    """Expected: 15 of 17 inputs in the order of their slopes, four at first; every member that completed; bars of β."""
    charts = charts_of(uneven, "dependence")
    # the last slopes are smaller than what the members' correlations leave open
    assert [chart.x.title for chart in charts][:9] == [f"{name}{unit}" for name, unit in VARIED.items()][:9]
    assert [chart.detail for chart in charts] == [False] * 4 + [True] * 11
    completed = (uneven.members["outcome"] == "completed").to_numpy()
    for chart in charts:
        (dots,) = chart.series
        np.testing.assert_array_equal(chart.x.values, uneven.members[f"varied.{chart.x.name}"])
        np.testing.assert_array_equal(dots.values, np.where(completed, uneven.members[PEAK], np.nan))
        assert (dots.members.tolist(), chart.y_title) == (list(range(N)), "position error, peak [mm]")
    (bars,) = charts_of(uneven, "sensitivity")
    assert bars.x.labels == tuple(chart.x.name for chart in charts)
    slopes = 2.0 ** -np.arange(17)
    np.testing.assert_allclose(bars.series[0].values, (slopes / np.linalg.norm(slopes))[:15], atol=0.05)

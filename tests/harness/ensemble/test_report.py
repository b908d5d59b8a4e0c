"""The report of an ensemble as plain data: how many machines do it, how well, how sure, what makes them differ."""

import re
from typing import Any

import numpy as np
import polars
import pytest
from scipy.stats import binomtest

import gough_stewart as gs
from gough_stewart.harness.ensemble.ensemble_report import Ensemble, ensemble_report
from gough_stewart.harness.ensemble.sensitivity import Sensitivity
from gough_stewart.harness.report.chart import Chart
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import ensemble_of

PEAK = "tracking.position.norm_peak"


def normal(n: int) -> FloatArray:
    return np.random.default_rng(5).normal(size=(n, 4))


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
        return sum(float(np.exp(_log_binomial(990, j, 0.95))) for j in range(k + 1))

    assert at_most(below) <= 0.025 < at_most(below + 1)
    assert at_most(above - 2) < 0.975 <= at_most(above - 1)
    said = float(verdict.text.partition("stay within ")[2].split()[0])
    assert number.value is not None
    assert 1e3 * number.value <= said <= 1e3 * number.value * 1.1
    assert verdict.text.partition("stay within ")[2].startswith(f"{said:g} mm of their reference (")


def _log_binomial(n: int, k: int, p: float) -> float:
    from math import lgamma, log

    return lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1) + k * log(p) + (n - k) * log(1 - p)


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
    table = next(part for part in ensemble_report(found, PEAK).parts() if not isinstance(part, Chart))
    assert "In 12 of 18 members z had not settled to 2 % 1.5 s after its step" in table.note  # type: ignore[union-attr]


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

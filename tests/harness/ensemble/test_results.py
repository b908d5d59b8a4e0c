"""What is said of an ensemble, on members whose figures of merit are closed forms of what varies."""

from dataclasses import replace

import numpy as np
import polars
import pytest
from rich.console import Console

from gough_stewart.harness.ensemble.charts import FIGURES
from gough_stewart.harness.ensemble.compare import compare, comparison_report
from gough_stewart.harness.ensemble.data import integration_warning
from gough_stewart.harness.ensemble.ensemble_report import Ensemble, ensemble_report, ensemble_verdict
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, group_name, sensitivity
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.report.page import page_of
from gough_stewart.harness.report.table import Table
from gough_stewart.harness.report.terminal import TerminalTable
from gough_stewart.harness.sampling.design import SamplingDesign
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import INPUTS, SLOPES, ensemble_of

PEAK = "tracking.position.norm_peak"


def normal(n: int, seed: int = 2) -> FloatArray:
    return np.random.default_rng(seed).normal(size=(n, 4))


def failing() -> Ensemble:
    """60 members: three diverge for causes that differ in numbers, one is stopped, one is impossible."""
    outcome, cause = ["completed"] * 60, list[str | None]([None] * 60)
    for k, gap in ((4, "0.31"), (17, "1.2e-3"), (41, "12")):
        outcome[k], cause[k] = "diverged", f"the platform is {gap} m from its reference; the bound is 0.05 m"
    outcome[23], cause[23] = "stopped", "leg 3 is 1.7 m long; its stroke is 0.9 to 1.6 m"
    outcome[9], cause[9] = "impossible", "platform_mass is -3 kg; expected > 0 kg"
    return ensemble_of(normal(60), outcome, cause)


def test_standardised_coefficients_are_those_of_the_closed_form_and_their_confidence_holds_them() -> None:
    """Expected: aₖ / |a| of y = a · x; noise of the sample is in R² = 1 and the inputs' own correlations alone."""
    found = sensitivity(ensemble_of(normal(4000)), PEAK)
    assert found.inputs == INPUTS
    np.testing.assert_allclose(found.main, SLOPES / np.linalg.norm(SLOPES), atol=0.03)
    assert found.r2 == pytest.approx(1.0)
    assert [INPUTS[k] for k in found.order] == list(INPUTS)


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


def test_all_members_count_in_the_regression_and_what_does_not_is_named() -> None:
    """Expected: β = b = a/|a|, half widths 1.96 |b| √((1 − b²)/n) of a linear y of normal x, from all 30,000.

    ln β̂ₖ = ln bₖ + ln sₖ − ln s_y of sample deviations, whose covariances are 1/2n, 1/2n and bₖ²/2n. The bounds of 100
    resamples scatter by 12 %; four intervals within 35 % fail one time in 300.
    """
    x = normal(30_000)
    x[:20_000, 2] = 1.0  # a rare difference, which the first 20,000 members do not have
    x[20_000:, 2] *= np.sqrt(3 / 2)
    found = sensitivity(ensemble_of(x), PEAK)
    assert (found.used, found.left_out, found.without) == (30_000, 0, ())
    assert "30000 members; ± and whiskers" in found.remark
    x = normal(30_000)
    found = sensitivity(ensemble_of(x), PEAK)
    slopes = SLOPES / np.linalg.norm(SLOPES)
    expected = 1.96 * np.abs(slopes) * np.sqrt((1 - slopes**2) / len(x))
    assert (np.abs(found.main - slopes) <= 4 * expected + 1e-12).all()
    np.testing.assert_allclose(found.main_confidence, expected, rtol=0.35, atol=1e-12)
    # the first half, without which the other coefficients would be others
    x[:15_000, 0] *= 3
    halves = sensitivity(ensemble_of(x), PEAK)
    joint = SLOPES * x.std(axis=0) / (x @ SLOPES).std()
    np.testing.assert_allclose(halves.main, joint, atol=0.02)


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
    members = ensemble.members.with_columns(polars.Series("integration_error", errors))
    assert not integration_warning(members, 1e-8)
    errors[[3, 17]] = 2e-7, 3.4e-5
    members = ensemble.members.with_columns(polars.Series("integration_error", errors))
    said = integration_warning(members, 1e-8)
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


def test_sobol_indices_are_those_of_the_closed_form() -> None:
    """Expected: y = a · x has aₖ² / |a|² alone and in total; of a product nothing alone, all in total."""
    design = SamplingDesign("saltelli", 5, 6 * 1024, INPUTS, (1, 1, 1, 1), ((0,), (1,), (2,), (3,)))
    # uniform of unit deviation
    x = np.sqrt(12) * (design.points(0, design.members) - 0.5)
    ensemble = ensemble_of(x, sampling="saltelli")
    found = sensitivity(ensemble, PEAK)
    np.testing.assert_allclose(found.main, SLOPES**2 / (SLOPES @ SLOPES), atol=0.03)
    assert found.total is not None
    np.testing.assert_allclose(found.total, SLOPES**2 / (SLOPES @ SLOPES), atol=0.03)
    product = sensitivity(ensemble, "power.peak")
    assert product.total is not None
    np.testing.assert_allclose(product.main, 0, atol=0.05)
    np.testing.assert_allclose(product.total, [1, 1, 0, 0], atol=0.1)


def test_what_cannot_be_said_is_refused_with_the_reason() -> None:
    """Expected: the message names the metric, and what is missing."""
    ensemble = ensemble_of(normal(40))
    with pytest.raises(RecordError, match=r"no metric 'force.peek'.*force\.peak"):
        sensitivity(ensemble, "force.peek")
    with pytest.raises(RecordError, match="6 members have a value; expected at least 7 for 4 inputs"):
        sensitivity(ensemble_of(normal(6)), PEAK)
    members = ensemble.members.with_columns(polars.lit(1.0).alias(PEAK))
    with pytest.raises(RecordError, match="is the same for all members"):
        sensitivity(Ensemble(members, ensemble.bands, ensemble.metadata), PEAK)
    assert group_name(["base_points[1,1]", "base_points[1,2]", "platform_mass"]) == "base_points & platform_mass"


def test_tables_are_whole_in_eighty_columns() -> None:
    """Expected: no text is cut, of all usual metrics and of the comparison."""
    ensemble = failing()
    gap = polars.Series(PEAK, ensemble.values(PEAK) - 1.23456e-6 * np.arange(60) ** 2)
    other = Ensemble(ensemble.members.with_columns(gap), ensemble.bands, ensemble.metadata)
    both = compare(ensemble, other, ("a_rather_long_name", "another_rather_long_name"))
    console = Console(width=80, color_system=None)
    tables = (part for part in ensemble.report(charts=False).parts() if isinstance(part, Table))
    compared = (part for part in comparison_report(both, charts=False).parts() if isinstance(part, Table))
    for shown_table in map(TerminalTable, (*tables, *compared)):
        with console.capture() as shown:
            console.print(shown_table)
        cut = [line for line in shown.get().splitlines() if "…" in line.replace(" … ", "") and "│" in line]
        # causes are cut on purpose, and once
        assert not [
            line for line in cut if "diverged" not in line and "impossible" not in line and "stopped" not in line
        ]


def test_charts_leave_out_what_is_not_there() -> None:
    """Expected: without bands and inputs, the distributions of the metrics alone."""
    ensemble = failing()
    found = ensemble_report(ensemble, PEAK, sensitivity(ensemble, PEAK))
    assert {chart.group for chart in found.charts} == set(FIGURES)
    bare = ensemble.members.select([name for name in ensemble.members.columns if not name.startswith("varied.")])
    rest = ensemble_report(Ensemble(bare, ensemble.bands.clear(), {}), PEAK)
    assert {chart.group for chart in rest.charts} == {"distribution"}


def test_only_the_same_members_are_compared() -> None:
    """Expected: a message that names what differs."""
    first, x = failing(), normal(60)
    with pytest.raises(RecordError, match="60 and 59 members, 59 of them in both"):
        compare(first, ensemble_of(x[:59]))
    with pytest.raises(RecordError, match=r"platform_mass of member 0 is .* expected the same \[ensemble\]"):
        compare(first, ensemble_of(normal(60, seed=3)))

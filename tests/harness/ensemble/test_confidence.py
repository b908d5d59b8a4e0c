"""Confidence intervals: resample by resample, by SciPy, and by how often they cover the truth in each design."""

import math
import re

import numpy as np
import polars
import pytest
from numpy.typing import NDArray
from scipy import stats

import gough_stewart as gs
from gough_stewart import Ensemble
from gough_stewart.harness.ensemble.compare import compare
from gough_stewart.harness.ensemble.sensitivity import sensitivity
from gough_stewart.harness.report.proportions import quantile_interval
from gough_stewart.harness.sampling.design import Sampling, SamplingDesign
from tests.support.arrays import FloatArray
from tests.support.coverage import RESPONSES, SHARES, coverage, drawn, ends_of_median
from tests.support.ensembles import INPUTS, ensemble_of
from tests.support.experiments import experiment_from

PEAK = "tracking.position.norm_peak"


def of_metric(x: FloatArray, y: FloatArray, outcome: list[str] | None = None, sampling: str = "random") -> Ensemble:
    """Members with these inputs (n, 4) and this peak error (n,)."""
    found = ensemble_of(x, outcome, sampling=sampling)
    return Ensemble(found.members.with_columns(polars.Series(PEAK, y)), found.bands, found.metadata)


def bent(x: FloatArray) -> FloatArray:
    """A metric that no line has: R² is some 0.7."""
    return np.asarray(0.02 + 1e-3 * (x @ [2.0, -1.0, 0.5, 0.2] + np.abs(x[:, 1]) * x[:, 0] + x[:, 2] ** 2))


@pytest.mark.parametrize("failed", [0, 9])
def test_whiskers_of_a_regression_are_those_of_its_hundred_resamples(failed: int) -> None:
    """Expected: β of NumPy's least squares on columns of mean 0 and deviation 1 of each resample."""
    n = 70
    x = np.random.default_rng(6).normal(size=(n + failed, 4)) * [1.0, 3.0, 0.2, 7.0] + 5.0
    x[:n, 2] = 4.2
    outcome = ["completed"] * n + ["diverged"] * failed
    y = bent(x)
    found = sensitivity(of_metric(x, y, outcome), PEAK)
    assert (found.used, found.left_out, found.without) == (n, failed, (INPUTS[2],))
    assert f"the same for all of these members: {INPUTS[2]}" in found.remark
    kept = x[:n][:, [0, 1, 3]]

    def beta(rows: NDArray[np.intp]) -> FloatArray:
        z, w = kept[rows], y[:n][rows]
        z, w = (z - z.mean(axis=0)) / z.std(axis=0), (w - w.mean()) / w.std()
        return np.asarray(np.linalg.lstsq(z, w, rcond=None)[0])

    whole = np.arange(n)
    assert found.main == pytest.approx(beta(whole), rel=1e-9)
    rng = np.random.default_rng(1)
    again = np.array([beta(rng.integers(0, n, n)) for _ in range(100)])
    low, high = np.quantile(again, [0.025, 0.975], axis=0)
    assert found.main_confidence == pytest.approx((high - low) / 2, rel=1e-7)
    z = (kept - kept.mean(axis=0)) / kept.std(axis=0)
    w = (y[:n] - y[:n].mean()) / y[:n].std()
    assert found.r2 == pytest.approx(1 - ((w - z @ found.main) ** 2).mean())
    assert found.r2 is not None
    assert found.r2 < 0.95


def test_whiskers_of_indices_are_those_of_their_hundred_resamples() -> None:
    """Expected: the sums of Saltelli's estimators, point by point; 1.96 deviations of resampled points."""
    design = SamplingDesign("saltelli", 5, 6 * 40, INPUTS, (1, 1, 1, 1), ((0,), (1,), (2,), (3,)))
    x = np.sqrt(12) * (design.points(0, design.members) - 0.5)
    outcome = ["completed"] * len(x)
    outcome[6 * 7 + 2] = "stopped"
    y = bent(x)
    found = sensitivity(of_metric(x, y, outcome, "saltelli"), PEAK)
    assert (found.used, found.left_out) == (6 * 39, 6)
    points = np.delete(y.reshape(40, 6), 7, axis=0)
    points = (points - points.mean()) / points.std()

    def indices(rows: NDArray[np.intp]) -> tuple[list[float], list[float]]:
        first, last = points[rows, 0], points[rows, 5]
        both = np.concatenate([first, last])
        V = (both**2).mean() - both.mean() ** 2
        n = len(rows)
        alone = [sum(last * (points[rows, k] - first)) / n / V for k in range(1, 5)]
        total = [sum((first - points[rows, k]) ** 2) / (2 * n) / V for k in range(1, 5)]
        return alone, total

    assert found.total is not None
    assert found.total_confidence is not None
    alone, total = indices(np.arange(39))
    assert found.main == pytest.approx(alone, rel=1e-9)
    assert found.total == pytest.approx(total, rel=1e-9)
    resamples = np.random.default_rng(1).integers(39, size=(39, 100))
    again = np.array([indices(resamples[:, k]) for k in range(100)])
    spread = 1.959964 * again.std(axis=0, ddof=1)
    assert found.main_confidence == pytest.approx(spread[0], rel=1e-6)
    assert found.total_confidence == pytest.approx(spread[1], rel=1e-6)
    assert found.order == np.argsort(-np.array(total)).tolist()


def test_differences_in_blocks_are_as_sure_as_one_member_of_each() -> None:
    """Expected: of blocks whose members differ alike, Student's interval and order statistics of one of each.

    Of the first block two members are left out: 12 blocks are then worth (11·6 + 4)²/(11·36 + 16) = 11.893. What is
    left has no closed form but the ratio's variance, summed term by term.
    """
    rng = np.random.default_rng(4)
    a = ensemble_of(rng.normal(size=(72, 4)), sampling="saltelli")
    gap = 1e-3 * rng.normal(size=12)

    def row_of(outcome: list[str]) -> dict[str, float]:
        values = a.members.with_columns(
            polars.Series(PEAK, a.values(PEAK) + np.repeat(gap, 6)), outcome=np.array(outcome)
        )
        found = compare(a, Ensemble(values, a.bands, a.metadata))
        return found.differences.row(by_predicate=polars.col("metric") == PEAK, named=True)

    row = row_of(["completed"] * 72)
    assert row["pairs"] == 72
    mean = stats.t.interval(0.95, 11, gap.mean(), stats.sem(gap))
    assert (row["mean_low"], row["mean_high"]) == pytest.approx(mean, rel=1e-9)
    median = ends_of_median(gap)
    assert (row["median_low"], row["median_high"]) == pytest.approx(median, abs=1e-12)
    row = row_of(["stopped"] * 2 + ["completed"] * 70)
    sizes = np.array([4] + [6] * 11)
    middle = float(sizes @ gap / 70)
    error = np.sqrt(12 / 11 * sum((m * (d - middle)) ** 2 for m, d in zip(sizes, gap, strict=True))) / 70
    assert row["mean"] == pytest.approx(middle, rel=1e-9)
    assert row["mean_high"] - row["mean"] == pytest.approx(stats.t.ppf(0.975, 11) * error, rel=1e-9)
    assert a.independent(np.arange(72) > 1) == pytest.approx(70**2 / (11 * 36 + 16))


# Of one input out of ten, nine of twelve members of a point of Saltelli's design are copies of its first one.
@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol", "saltelli"])
def test_intervals_cover_the_truth_in_every_design(sampling: Sampling) -> None:
    """Expected: at least 93 % of 100 seeds by the closed form, and no wider than as many blocks; see the evidence."""
    response = RESPONSES["one input"]
    numbers = drawn(sampling, 10, 120 if sampling == "saltelli" else 10, response, range(100))
    bounds = {share: response.quantile(share, 10) for share in SHARES}
    for share, (covered, widest) in coverage(numbers, 10, bounds).items():
        assert covered >= 0.93, share
        assert widest <= 1.3, share


def test_a_saltelli_ensemble_is_as_sure_as_its_points() -> None:
    """Expected: quantiles of χ₃ for the distance of the start; of 16 points, 7 other inputs copy 9 of 10 members.

    As if its 160 members were independent, the interval of the share of 50 % covers it in some half of the seeds.
    """
    home = gs.load_preset("motion_base").home_position.tolist()
    others = ("platform_mass", "leg_lower_mass", "leg_upper_mass", "leg_viscous_friction", "platform_inertia",
              "leg_lower_com", "leg_upper_com")  # fmt: skip
    experiment = experiment_from({
        "title": "small", "platform": {"preset": "motion_base"},
        "reference": {"type": "hold"},
        "start": {"position": home},
        "controller": {"type": "pd", "bandwidth": "2 Hz", "feedforward": "gravity"},
        "loop": {"duration": 0.002, "sample_time": 0.002},
        "ensemble": {
            "members": 160, "sampling": "saltelli", "start": {"position": {"normal": "1 mm"}},
            **{name: {"factor": {"uniform": [0.99, 1.01]}} for name in others},
        },
    })  # fmt: skip
    reports = [gs.ensemble(experiment, seed=seed, workers=1).report(charts=False) for seed in range(20)]
    bounds = {share: 1e-3 * float(stats.chi(3).ppf(share)) for share in SHARES}
    for share, (covered, widest) in coverage((r.number(PEAK) for r in reports), 16, bounds).items():
        assert covered >= 0.93, share
        assert widest <= 1.3, share
    ends = [(r.verdict.numbers[0], r.verdict.numbers[1]) for r in reports]
    q = 1e-3 * stats.chi(3).ppf(0.95)
    for complete, peak in ends:
        assert [complete.low, complete.high] == pytest.approx([0.025 ** (1 / 16), 1.0])
        # 0.95^16 = 44 %: the largest of 16 says no upper end
        assert peak.high is None
        assert peak.low is not None
    assert sum(peak.low <= q for _, peak in ends if peak.low is not None) >= 19
    (note,) = (note.text for note in reports[0].notes)
    assert "16 points, not of 160 members: the 10 members of a point" in note


@pytest.mark.parametrize("sampling", ["random", "saltelli"])
def test_what_matters_most_is_said_only_if_it_matters_more(sampling: str) -> None:
    """Expected: of two forces at the same time and place neither; both by name with their intervals. Of 3 to 1 one."""

    def said(seed: int, spread: float) -> str:
        push = {"at": 0.0, "duration": 0.02, "force": [0.0, 0.0, 500.0]}
        varied = {
            "1": {"force": {"factor": {"normal": [1.0, spread]}}},
            "2": {"force": {"factor": {"normal": [1.0, 0.1]}}},
        }
        experiment = experiment_from({
            "title": "small", "platform": {"preset": "motion_base"},
            "reference": {"type": "hold"},
            "controller": {"type": "pd", "bandwidth": "4 Hz", "feedforward": "gravity"},
            "loop": {"duration": 0.01, "sample_time": 0.002},
            "disturbance": [push, push],
            "ensemble": {"members": 128, "sampling": sampling, "disturbance": varied},
        })  # fmt: skip
        found = gs.ensemble(experiment, seed=seed, workers=1)
        text = found.report(charts=False).verdict.text
        assert text in " ".join(repr(found).split())
        return text

    for seed in range(3):
        alike = re.search(r"; (\S+) and (\S+) matter alike \((\S+) \[(\S+), (\S+)\] and (\S+) \[", said(seed, 0.1))
        assert alike is not None
        assert {alike[1], alike[2]} == {"disturbance.1.force.factor", "disturbance.2.force.factor"}
        # β² or the share of each is a half
        expected = 0.5 if sampling == "saltelli" else np.sqrt(0.5)
        assert float(alike[3]) == pytest.approx(expected, abs=0.2)
        assert float(alike[4]) < float(alike[3]) < float(alike[5])
    assert said(0, 0.3).endswith("; disturbance.1.force.factor matters most")


def test_design_points_that_vary_in_nothing_have_no_share() -> None:
    """Expected: too few whole points, or a metric that is the same in all, are refused by the name of the metric."""
    x = np.zeros((12, 4))
    with pytest.raises(ValueError, match="1 points of Saltelli's design are complete; expected at least 2"):
        sensitivity(of_metric(x, np.arange(12.0), ["completed"] * 11 + ["stopped"], "saltelli"), PEAK)
    with pytest.raises(ValueError, match=f"{PEAK}: is the same for all members"):
        sensitivity(of_metric(x, np.ones(12), None, "saltelli"), PEAK)
    # only the points between the ends vary
    y = np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 1.0], 2)
    found = sensitivity(of_metric(x, y, None, "saltelli"), PEAK)
    assert found.total is not None
    assert found.main.tolist() == found.total.tolist() == [0.0] * 4


@pytest.mark.parametrize(("n", "level"), [(10, 0.5), (59, 0.95), (100, 0.95), (213, 0.25)])
def test_the_interval_of_a_quantile_is_the_narrowest_of_order_statistics(n: int, level: float) -> None:
    """Expected: exact sums of the binomial distribution; one value further in would leave more than 2.5 % outside."""

    def at_most(k: int) -> float:
        return math.fsum(math.comb(n, j) * level**j * (1 - level) ** (n - j) for j in range(k + 1))

    found = quantile_interval(np.arange(1.0, n + 1)[::-1], level)
    lows = [r for r in range(1, n + 1) if at_most(r - 1) <= 0.025]
    highs = [s for s in range(1, n + 1) if at_most(s - 1) >= 0.975]
    assert found == (max(lows, default=None), min(highs, default=None))

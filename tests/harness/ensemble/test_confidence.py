"""How sure an ensemble is: resample by resample by NumPy, exact intervals by SciPy, and who matters beyond doubt."""

import re
from typing import Any

import numpy as np
import pytest
import tomlkit
from numpy.typing import NDArray
from scipy import stats

import gough_stewart as gs
from gough_stewart import Ensemble
from tests.harness.ensemble.ensembles import INPUTS, PEAK, SLOPES, ensemble_of, normal, with_columns
from tests.support.arrays import FloatArray
from tests.support.commands import invoke
from tests.support.experiments import experiment_from
from tests.support.reports import report_in, tables_of

TABLE = "What makes the position error, peak vary"


def with_peak(x: FloatArray, y: FloatArray, outcome: list[str] | None = None, **metadata: Any) -> Ensemble:
    """Members with these inputs (n, 4) and this peak error (n,)."""
    return with_columns(ensemble_of(x, outcome, **metadata), {PEAK: y})


def bent(x: FloatArray) -> FloatArray:
    """A metric that no line has: R² is some 0.7."""
    return np.asarray(0.02 + 1e-3 * (x @ [2.0, -1.0, 0.5, 0.2] + np.abs(x[:, 1]) * x[:, 0] + x[:, 2] ** 2))


def shown(found: Ensemble) -> tuple[str, tuple[str, ...], FloatArray]:
    """The remark, the inputs, and by series value and half width (series, 2, inputs), alike in table and chart."""
    report = found.report()
    table, (chart,) = tables_of(report)[TABLE], [c for c in report.charts if c.group == "sensitivity"]
    assert tuple(row[0] for row in table.rows) == chart.x.labels
    numbers = (
        np.array([[row[1:] for row in table.rows]], dtype=float).reshape(len(table.rows), -1, 2).transpose(1, 2, 0)
    )
    for series, (values, half) in zip(chart.series, numbers, strict=True):
        drawn = np.array([series.values, series.low, series.high], dtype=float)
        np.testing.assert_allclose(drawn, [values, values - half, values + half])
    return table.note, chart.x.labels, numbers


@pytest.mark.parametrize("failed", [0, 9])
def test_whiskers_of_a_regression_are_those_of_its_hundred_resamples(failed: int) -> None:
    """Expected: β of NumPy's least squares on columns of mean 0 and deviation 1 of each resample, largest |β| first."""
    n = 70
    x = np.random.default_rng(6).normal(size=(n + failed, 4)) * [1.0, 3.0, 0.2, 7.0] + 5.0
    x[:n, 2] = 4.2
    y, kept = bent(x), x[:n][:, [0, 1, 3]]
    note, names, ((main, half),) = shown(with_peak(x, y, ["completed"] * n + ["diverged"] * failed))

    def beta(rows: NDArray[np.intp]) -> FloatArray:
        z, w = kept[rows], y[:n][rows]
        z, w = (z - z.mean(axis=0)) / z.std(axis=0), (w - w.mean()) / w.std()
        return np.asarray(np.linalg.lstsq(z, w, rcond=None)[0])

    whole = beta(np.arange(n))
    order = np.argsort(-np.abs(whole))
    assert names == tuple(np.array(INPUTS)[[0, 1, 3]][order])
    assert main == pytest.approx(whole[order], rel=1e-9)
    rng = np.random.default_rng(1)
    low, high = np.quantile([beta(rng.integers(0, n, n)) for _ in range(100)], [0.025, 0.975], axis=0)
    assert half == pytest.approx(((high - low) / 2)[order], rel=1e-7)
    z, w = (kept - kept.mean(axis=0)) / kept.std(axis=0), (y[:n] - y[:n].mean()) / y[:n].std()
    share = 1 - ((w - z @ whole) ** 2).mean()
    assert note.startswith(f"Standardised regression, R² = {share:.2f}, of {n} members")
    assert (f"left out: {failed} not completed" in note) == (failed > 0)
    assert f"the same for all of these members: {INPUTS[2]}" in note


def test_all_members_count_in_the_regression() -> None:
    """Expected: β = b = a/|a|, half widths 1.96 |b| √((1 − b²)/n) of a linear y of normal x, from all 6,000.

    ln β̂ₖ = ln bₖ + ln sₖ − ln s_y of sample deviations, whose covariances are 1/2n, 1/2n and bₖ²/2n. The bounds of 100
    resamples scatter by 12 %; four intervals within 35 % fail one time in 300.
    """
    x = normal(6000)
    note, names, ((main, half),) = shown(ensemble_of(x))
    slopes = SLOPES / np.linalg.norm(SLOPES)
    expected = 1.96 * np.abs(slopes) * np.sqrt((1 - slopes**2) / len(x))
    assert names == INPUTS
    assert (np.abs(main - slopes) <= 4 * expected + 1e-12).all()
    np.testing.assert_allclose(half, expected, rtol=0.35, atol=1e-12)
    assert "6000 members; ± and whiskers" in note
    # the first half, without which the other coefficients would be others
    x[:3000, 0] *= 3
    joint = SLOPES * x.std(axis=0) / (x @ SLOPES).std()
    np.testing.assert_allclose(shown(ensemble_of(x))[2][0, 0], joint, atol=0.03)
    # an input that differs in one member: resamples without it have no coefficient, others do
    x = normal(40)
    x[:, 3] = np.arange(40) == 7
    assert np.isfinite(shown(ensemble_of(x))[2]).all()


def saltelli(points: int, seed: int = 5) -> FloatArray:
    """Rows A, A with a column of B each, B, of two random matrices (n (p + 2), p)."""
    A, B = np.random.default_rng(seed).normal(size=(2, points, 4))
    rows = [A, *(np.where(np.arange(4) == k, B, A) for k in range(4)), B]
    return np.stack(rows, axis=1).reshape(-1, 4)


def test_whiskers_of_indices_are_those_of_their_hundred_resamples() -> None:
    """Expected: the sums of Saltelli's estimators, point by point; 1.96 deviations of resampled points; by total."""
    x = saltelli(40)
    outcome, y = ["completed"] * len(x), bent(x)
    outcome[6 * 7 + 2] = "stopped"
    groups = [["platform_mass", "controller.bandwidth"], [INPUTS[1]], [INPUTS[2]], [INPUTS[3]]]
    note, names, ((alone, alone_half), (total, total_half)) = shown(
        with_peak(x, y, outcome, sampling="saltelli", groups=groups)
    )
    points = np.delete(y.reshape(40, 6), 7, axis=0)
    points = (points - points.mean()) / points.std()

    def indices(rows: NDArray[np.intp]) -> FloatArray:
        first, last = points[rows, 0], points[rows, 5]
        both = np.concatenate([first, last])
        V, n = (both**2).mean() - both.mean() ** 2, len(rows)
        main = [sum(last * (points[rows, k] - first)) / n / V for k in range(1, 5)]
        return np.array([main, [sum((first - points[rows, k]) ** 2) / (2 * n) / V for k in range(1, 5)]])

    whole = indices(np.arange(39))
    order = np.argsort(-whole[1])
    # columns that vary together are one input
    assert names == tuple(np.array(["platform_mass & controller.bandwidth", *INPUTS[1:]])[order])
    assert alone == pytest.approx(whole[0][order], rel=1e-9)
    assert total == pytest.approx(whole[1][order], rel=1e-9)
    resamples = np.random.default_rng(1).integers(39, size=(39, 100))
    spread = 1.959964 * np.std([indices(resamples[:, k]) for k in range(100)], axis=0, ddof=1)
    assert [alone_half, total_half] == pytest.approx(spread[:, order], rel=1e-6)
    assert note.startswith(f"Sobol' indices of {6 * 39} members; left out: 6 not completed")


@pytest.mark.parametrize("what", ["one point", "all alike", "nothing but between the ends"])
def test_points_that_vary_in_nothing_have_no_share(what: str) -> None:
    """Expected: no table of one whole point or of equal values; shares of 0 where only other points vary."""
    y = np.ones(12) if what == "all alike" else np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 1.0], 2)
    outcome = ["completed"] * 11 + ["stopped" if what == "one point" else "completed"]
    found = with_peak(np.zeros((12, 4)), y, outcome, sampling="saltelli")
    if what.startswith("nothing"):
        assert (shown(found)[2][:, 0] == 0).all()
    else:
        assert TABLE not in tables_of(found.report())


def test_a_saltelli_ensemble_is_as_sure_as_its_points(tmp_path: Any) -> None:
    """Expected: SciPy's intervals of 16 points; of 160 independent members they would be three times as narrow."""
    home = gs.load_preset("motion_base").home_position.tolist()
    others = ("platform_mass", "leg_lower_mass", "leg_upper_mass", "leg_viscous_friction", "platform_inertia",
              "leg_lower_com", "leg_upper_com")  # fmt: skip
    experiment = {
        "title": "small", "platform": {"preset": "motion_base"},
        "reference": {"type": "hold"},
        "start": {"position": home},
        "controller": {"type": "pd", "bandwidth": "2 Hz", "feedforward": "gravity"},
        "loop": {"duration": 0.002, "sample_time": 0.002},
        "ensemble": {
            "members": 160, "sampling": "saltelli", "seed": 3, "start": {"position": {"normal": "1 mm"}},
            **{name: {"factor": {"uniform": [0.99, 1.01]}} for name in others},
        },
    }  # fmt: skip
    found = gs.ensemble(experiment_from(experiment), workers=1)
    report = found.report(charts=False)
    complete, peak = report.verdict.numbers
    assert [complete.low, complete.high] == pytest.approx([0.025 ** (1 / 16), 1.0])
    # 0.95^16 = 44 %: the largest of 16 says no upper end
    assert peak.high is None
    assert peak.low is not None
    (note,) = (note.text for note in report.notes)
    assert "16 points, not of 160 members: the 10 members of a point" in note
    (tmp_path / "small.toml").write_text(tomlkit.dumps(experiment))
    bound = float(np.median(found.values(PEAK)))
    few = ("--workers", "1", "--set", "ensemble.worst=0", "--out", str(tmp_path / "out"))
    done = invoke(
        "ensemble", str(tmp_path / "small.toml"), *few, "--require", f"{PEAK} <= {bound!r} for 50 % of members"
    )
    assert done.exit_code == 4, done.output
    (judged,) = report_in(tmp_path / "out")["requirements"]
    said = re.search(r"(\d+) of 160 members hold it.*; of all, (\S+) to (\S+) % with 95 % confidence", judged["note"])
    assert said is not None, judged["note"]
    holding = int(said[1]) / 10
    ends = stats.beta.ppf(0.025, holding, 17 - holding), stats.beta.ppf(0.975, holding + 1, 16 - holding)
    assert [float(said[2]), float(said[3])] == pytest.approx([100 * end for end in ends], rel=6e-3)


def test_three_of_four_that_matter_alike_are_named() -> None:
    """Expected: of four slopes of 1 the first three with β of about a half, and how many more there are."""
    text = with_peak(normal(400), 0.01 + 1e-3 * normal(400).sum(axis=1)).report(charts=False).verdict.text
    share = r"0\.[45]\d \[0\.\d\d, 0\.\d\d\]"
    assert re.search(rf"; \S+, \S+, \S+ and 1 other matter alike \({share}, {share} and {share}\)$", text), text


@pytest.mark.parametrize("sampling", ["random", "saltelli"])
def test_what_matters_most_is_named_only_if_it_matters_more(sampling: str) -> None:
    """Expected: of two forces at the same time and place neither; both by name with their intervals. Of 3 to 1 one."""

    def verdict(seed: int, spread: float) -> str:
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

    for seed in range(2):
        alike = re.search(r"; (\S+) and (\S+) matter alike \((\S+) \[(\S+), (\S+)\] and (\S+) \[", verdict(seed, 0.1))
        assert alike is not None
        assert {alike[1], alike[2]} == {"disturbance.1.force.factor", "disturbance.2.force.factor"}
        # β² or the share of each is a half
        expected = 0.5 if sampling == "saltelli" else np.sqrt(0.5)
        assert float(alike[3]) == pytest.approx(expected, abs=0.2)
        assert float(alike[4]) < float(alike[3]) < float(alike[5])
    assert verdict(0, 0.3).endswith("; disturbance.1.force.factor matters most")

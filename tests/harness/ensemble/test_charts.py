"""Charts of an ensemble as data, number by number, against the columns of its tables."""

from typing import Any

import numpy as np
import polars
import pytest

from gough_stewart import Ensemble
from gough_stewart.harness.ensemble.ensemble_report import ensemble_report
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity
from gough_stewart.harness.report.chart import Chart
from tests.support.ensembles import ensemble_of

PEAK = "tracking.position.norm_peak"
N = 3350
# With the title of the axis and its factor.
SIGNALS = {
    "position[1]": ("x [m]", 1.0),
    "orientation[2]": ("pitch [deg]", 180 / np.pi),
    "velocity[2]": ("velocity 2 [m/s]", 1.0),
    "leg_velocity[6]": ("leg velocity 6 [m/s]", 1.0),
    "actuator_force[4]": ("actuator force 4 [N]", 1.0),
    "error.position[2]": ("error of y [mm]", 1e3),
    "error.leg_length[5]": ("error of leg length 5 [mm]", 1e3),
    "error.position.norm": ("error of position, norm [mm]", 1e3),
    "error.orientation.norm": ("error of orientation, norm [deg]", 180 / np.pi),
    "error.orientation[3]": ("error of yaw [deg]", 180 / np.pi),
    "angular_velocity[1]": ("angular velocity 1 [deg/s]", 180 / np.pi),
}
# In the order in which they are shown after that of the verdict.
METRICS = {
    "tracking.position.norm_rms": ("position error, RMS [mm]", 1e3),
    PEAK: ("position error, peak [mm]", 1e3),
    "tracking.leg_length.peak": ("leg error, peak [mm]", 1e3),
    "step_response.z.rise_time": ("z: rise time [s]", 1.0),
    "force.peak": ("peak force [N]", 1.0),
    "power.peak": ("peak power [W]", 1.0),
    "stroke.margin": ("stroke margin [mm]", 1e3),
    "saturation.force_limited.any": ("force limited [%]", 100.0),
    "margins.disk": ("disk margin", 1.0),
}
# Of less and less influence on the peak error.
INPUTS = {
    **{"leg_viscous_friction[4]": " [N·s/m]", "platform_mass": " [kg]", "loop.delay": "", "base_points[2,3]": " [m]"},
    **{"sensors.noise.leg_length": "", "plant.parameters.leg_lower_mass": " [kg]", "gravity[1]": " [m/s²]"},
    **{"platform.leg_length_max": " [m]", "disturbance.1.force[2]": "", "reference.at": "", "platform_com[3]": " [m]"},
    **{f"controller.gain[{k}]": "" for k in range(6)},
}


@pytest.fixture(scope="module")
def ensemble() -> Ensemble:
    """Columns of random numbers, each about another mean; nine members diverge, two of them with huge errors."""
    rng = np.random.default_rng(5)
    diverged = np.arange(N) % 400 == 100
    x = rng.normal(size=(N, len(INPUTS)))
    # in the table, the least influential input comes first
    columns: dict[str, Any] = {"member": np.arange(N)}
    columns |= {f"varied.{name}": 3.0 + k + 0.1 * x[:, k] for k, name in reversed([*enumerate(INPUTS)])}
    columns |= {"varied.controller.file": ["a.py"] * N}
    columns |= {"outcome": np.where(diverged, "diverged", "completed"), "ended": 2.0, "cause": None}
    columns |= {name: 0.01 * (k + 1) * (1 + 0.1 * rng.normal(size=N)) for k, name in enumerate(METRICS)}
    columns[PEAK] = 0.02 + 1e-4 * x @ (2.0 ** -np.arange(len(INPUTS)))
    columns[PEAK][[100, 3300]] = 7.0, 9.0
    columns["force.peak"][[5, 9]] = 40.0, -3.0
    columns["power.peak"][diverged] = 1e6
    levels = ("lowest", "q05", "q25", "q50", "q75", "q95", "highest")
    bands = [
        {"signal": name, "time": t, **dict(zip(levels, row, strict=True))}
        for k, name in enumerate(SIGNALS)
        for t, row in zip((7.3 + 0.25 * np.arange(5)).tolist(), np.sort(k + rng.normal(size=(5, 7))), strict=True)
    ]
    return Ensemble(polars.DataFrame(columns), polars.DataFrame(bands), {"title": "uneven", "sampling": "random"})


@pytest.fixture(scope="module")
def known(ensemble: Ensemble) -> Sensitivity:
    return sensitivity(ensemble, PEAK)


@pytest.fixture(scope="module")
def charts(ensemble: Ensemble, known: Sensitivity) -> dict[str, list[Chart]]:
    """By their groups."""
    return grouped(ensemble, PEAK, known)


def grouped(ensemble: Ensemble, by: str, known: Sensitivity | None = None) -> dict[str, list[Chart]]:
    groups: dict[str, list[Chart]] = {}
    for chart in ensemble_report(ensemble, by, known).charts:
        groups.setdefault(chart.group, []).append(chart)
    return groups


def test_bands_are_those_of_the_table(ensemble: Ensemble, charts: dict[str, list[Chart]]) -> None:
    """Expected: all signals, errors first; edges of the three bands and the median, of every time, in shown units."""
    shown = sorted(SIGNALS, key=lambda name: not name.startswith("error."))
    assert [chart.y_title for chart in charts["bands"]] == [SIGNALS[name][0] for name in shown]
    for chart, name in zip(charts["bands"], shown, strict=True):
        part = ensemble.bands.filter(polars.col("signal") == name)
        assert (chart.title, chart.note) == (SIGNALS[name][0].partition(" [")[0], "Of the members still running.")
        assert chart.is_over_time
        assert np.asarray(chart.x.values).tolist() == part["time"].to_list()
        assert [series.name for series in chart.series] == [
            "lowest to highest", "5 to 95 %", "25 to 75 %", "median",
        ]  # fmt: skip
        for series, ends in zip(chart.series, (("lowest", "highest"), ("q05", "q95"), ("q25", "q75")), strict=False):
            np.testing.assert_array_equal([series.low, series.high], [part[end] for end in ends])
        np.testing.assert_array_equal(chart.series[3].values, part["q50"])
        assert chart.series[0].quantity.factor == pytest.approx(SIGNALS[name][1])


def test_histograms_are_of_the_members_that_completed(ensemble: Ensemble, charts: dict[str, list[Chart]]) -> None:
    """Expected: that of the verdict first; counts, quantiles, and what lies outside, by NumPy; margins of all."""
    shown = [PEAK, *(name for name in METRICS if name != PEAK)]
    assert [chart.x.title for chart in charts["distribution"]] == [METRICS[name][0] for name in shown]
    for chart, name in zip(charts["distribution"], shown, strict=True):
        is_margin = name.startswith("margins.")
        members = ensemble.members if is_margin else ensemble.members.filter(polars.col("outcome") == "completed")
        values = np.sort(members[name].to_numpy())
        assert len(values) == (N if is_margin else N - 9)
        counts, edges = np.asarray(chart.series[0].values), np.asarray(chart.x.values)
        outliers = 2 if name == "force.peak" else 0
        inside = values[outliers // 2 : len(values) - outliers // 2]
        assert edges == pytest.approx(np.linspace(inside[0], inside[-1], 41))
        # a value at an edge may round to either side
        assert np.abs(counts - np.histogram(inside, edges)[0]).sum() <= 2
        marks = [mark.value for mark in chart.marks]
        assert marks == pytest.approx(np.quantile(values, [0.05, 0.5, 0.95]).tolist())
        assert [mark.text for mark in chart.marks] == ["5 %", "50 %", "95 %"]
        assert chart.note == ("peak force: 2 members outside, -3 to 40 N in all." if outliers else "")
        assert chart.x.quantity.factor == pytest.approx(METRICS[name][1])


@pytest.mark.parametrize("others", [0, 1])
def test_a_metric_that_is_all_but_constant_has_a_histogram(others: int) -> None:
    """Expected: all 400 values between the edges, none of them an outlier."""
    found = ensemble_of(np.random.default_rng(2).normal(size=(400, 4)))
    values = np.append(np.full(400 - others, 5.0), np.full(others, 9.0))
    members = found.members.with_columns(polars.Series("force.peak", values))
    chart = grouped(Ensemble(members, found.bands, found.metadata), "force.peak")["distribution"][0]
    assert np.sum(chart.series[0].values) == 400
    edges = np.asarray(chart.x.values)
    assert (edges[0], edges[-1], chart.note) == ((5.0, 9.0, "") if others else (4.5, 5.5, ""))


def test_the_metric_is_drawn_against_the_most_influential_inputs(
    ensemble: Ensemble, charts: dict[str, list[Chart]]
) -> None:
    """Expected: 15 of 17 inputs in the order of their slopes, four at first; every member that completed."""
    assert [chart.x.title for chart in charts["dependence"]] == [f"{name}{INPUTS[name]}" for name in [*INPUTS][:15]]
    assert [chart.detail for chart in charts["dependence"]] == [False] * 4 + [True] * 11
    completed = (ensemble.members["outcome"] == "completed").to_numpy()
    for chart, name in zip(charts["dependence"], INPUTS, strict=False):
        (dots,) = chart.series
        np.testing.assert_array_equal(chart.x.values, ensemble.members[f"varied.{name}"])
        np.testing.assert_array_equal(dots.values, np.where(completed, ensemble.members[PEAK], np.nan))
        assert dots.members is not None
        assert (dots.members.tolist(), chart.y_title) == (list(range(N)), "position error, peak [mm]")


def test_charts_leave_out_what_is_not_there() -> None:
    """Expected: without sensitivity, inputs as in the table; without bands and inputs, distributions alone."""
    found = ensemble_of(np.random.default_rng(2).normal(size=(60, 4)))
    groups = grouped(found, "margins.disk")
    assert list(groups) == ["distribution", "bands", "dependence"]
    assert [chart.x.name for chart in groups["dependence"]] == list(found.varied)
    bare = found.members.select([name for name in found.members.columns if not name.startswith("varied.")])
    assert list(grouped(Ensemble(bare, found.bands.clear(), {}), PEAK)) == ["distribution"]


def test_bars_of_a_regression_are_its_coefficients(known: Sensitivity, charts: dict[str, list[Chart]]) -> None:
    """Expected: 2⁻ᵏ over the root of the sum of squares, the most influential one first."""
    (chart,) = charts["sensitivity"]
    assert chart.title == "what makes the position error, peak vary"
    # the last slopes are smaller than what the members' correlations leave open
    assert chart.x.labels[:9] == tuple(INPUTS)[:9]
    assert (len(chart.x.labels), chart.y_title) == (15, "standardised regression coefficient β")
    slopes = 2.0 ** -np.arange(17)
    (bars,) = chart.series
    np.testing.assert_allclose(bars.values, (slopes / np.linalg.norm(slopes))[:15], atol=0.05)
    half, order = known.main_confidence, known.order[:15]
    np.testing.assert_allclose(np.array(bars.low), (known.main - half)[order])
    np.testing.assert_allclose(np.array(bars.high), (known.main + half)[order])
    assert chart.note.startswith(f"standardised regression, R² = 1.00, of {N - 9} members; left out: 9 not completed")


def test_bars_of_indices_are_total_and_alone() -> None:
    """Expected: the given numbers, by total, each with its own whisker, and both names."""
    total, main = np.array([0.1, 0.7, 0.45]), np.array([0.08, 0.5, 0.2])
    halves = np.array([0.01, 0.04, 0.02]), np.array([0.03, 0.05, 0.06])
    given = Sensitivity("force.peak", "sobol", ("a", "b", "c"), main, halves[0], total, halves[1], None, 640, 10)
    (chart,) = grouped(ensemble_of(np.random.default_rng(2).normal(size=(60, 4))), "force.peak", given)["sensitivity"]
    assert (chart.x.labels, chart.y_title) == (("b", "c", "a"), "share of the variance")
    assert [series.name for series in chart.series] == ["alone", "in total"]
    for series, values, half in zip(chart.series, (main, total), halves, strict=True):
        for found, expected in ((series.values, values), (series.low, values - half), (series.high, values + half)):
            np.testing.assert_allclose(np.array(found), expected[[1, 2, 0]])

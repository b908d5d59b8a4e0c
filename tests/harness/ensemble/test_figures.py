"""Figures of an ensemble as they are drawn, number by number, against the columns of its tables.

Every signal and metric has a panel; of the inputs, those that matter most.
"""

from typing import Any

import numpy as np
import polars
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.ensemble.ensemble_report import Ensemble, ensemble_report
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.report.palette import colour_of
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import ensemble_of
from tests.support.figures import data_of, figures_drawn

PEAK = "tracking.position.norm_peak"
N = 3350
SIGNALS = {
    "position[1]": ("x [m]", 1.0),
    "position[3]": ("z [m]", 1.0),
    "orientation[2]": ("pitch [deg]", 180 / np.pi),
    "orientation[3]": ("yaw [deg]", 180 / np.pi),
    "velocity[2]": ("velocity 2 [m/s]", 1.0),
    "leg_length[4]": ("leg length 4 [m]", 1.0),
    "leg_velocity[6]": ("leg velocity 6 [m/s]", 1.0),
    "actuator_force[1]": ("actuator force 1 [N]", 1.0),
    "actuator_force[4]": ("actuator force 4 [N]", 1.0),
    "error.position[1]": ("error of x [mm]", 1e3),
    "error.position[2]": ("error of y [mm]", 1e3),
    "error.orientation[1]": ("error of roll [deg]", 180 / np.pi),
    "error.leg_length[5]": ("error of leg length 5 [mm]", 1e3),
    "error.position.norm": ("error of position, norm [mm]", 1e3),
    "error.orientation.norm": ("error of orientation, norm [deg]", 180 / np.pi),
    "error.orientation[3]": ("error of yaw [deg]", 180 / np.pi),
    "angular_velocity[1]": ("angular velocity 1 [deg/s]", 180 / np.pi),
}
# In the order in which they are shown after that of the verdict, with units.
METRICS = {
    "tracking.position.norm_rms": ("position error, RMS [mm]", 1e3),
    PEAK: ("position error, peak [mm]", 1e3),
    "tracking.orientation.norm_rms": ("orientation error, RMS [deg]", 180 / np.pi),
    "tracking.orientation.norm_peak": ("orientation error, peak [deg]", 180 / np.pi),
    "tracking.leg_length.peak": ("leg error, peak [mm]", 1e3),
    "step_response.z.rise_time": ("z: rise time [s]", 1.0),
    "step_response.yaw.overshoot_percent": ("yaw: overshoot [%]", 1.0),
    "force.peak": ("peak force [N]", 1.0),
    "power.peak": ("peak power [W]", 1.0),
    "energy.absolute_total": ("work, absolute [J]", 1.0),
    "stroke.margin": ("stroke margin [mm]", 1e3),
    "saturation.force_limited.any": ("force limited [%]", 100.0),
    "saturation.rate_limited.any": ("rate limited [%]", 100.0),
    "margins.stable": ("stable", 1.0),
    "margins.disk": ("disk margin", 1.0),
}
# Of less and less influence on the peak error.
INPUTS = (
    *("leg_viscous_friction[4]", "platform_mass", "loop.delay", "base_points[2,3]", "sensors.noise.leg_length"),
    *("reference.at", "platform_com[3]", "actuators.force_limit", "plant.parameters.leg_lower_mass"),
    *("controller.bandwidth", "platform.leg_length_max", "gravity[1]", "disturbance.1.force[2]"),
)
UNITS = {
    "leg_viscous_friction[4]": "N·s/m",
    "platform_mass": "kg",
    "base_points[2,3]": "m",
    "platform_com[3]": "m",
    "plant.parameters.leg_lower_mass": "kg",
    "platform.leg_length_max": "m",
    "gravity[1]": "m/s²",
}


def made() -> Ensemble:
    """Columns of random numbers, each about another mean; nine members diverge, two of them with huge errors."""
    rng = np.random.default_rng(5)
    diverged = np.arange(N) % 400 == 100
    x = rng.normal(size=(N, len(INPUTS)))
    # in the table, the least influential input comes first
    columns: dict[str, Any] = {"member": np.arange(N)}
    columns |= {f"varied.{INPUTS[k]}": 3.0 + k + 0.1 * x[:, k] for k in reversed(range(len(INPUTS)))}
    columns |= {"varied.controller.file": ["a.py"] * N}
    columns |= {"outcome": np.where(diverged, "diverged", "completed"), "ended": 2.0, "cause": None}
    for k, name in enumerate(METRICS):
        columns[name] = 0.01 * (k + 1) * (1 + 0.1 * rng.normal(size=N))
    columns[PEAK] = 0.02 + 1e-4 * x @ (2.0 ** -np.arange(len(INPUTS)))
    columns[PEAK][[100, 3300]] = 7.0, 9.0
    columns["force.peak"][[5, 9]] = 40.0, -3.0
    columns["power.peak"][diverged] = 1e6
    time = 7.3 + 0.25 * np.arange(5)
    bands = [
        {
            "signal": name,
            "time": t,
            **dict(zip(("lowest", "q05", "q25", "q50", "q75", "q95", "highest"), row, strict=True)),
        }
        for k, name in enumerate(SIGNALS)
        for t, row in zip(time.tolist(), np.sort(k + rng.normal(size=(5, 7))).tolist(), strict=True)
    ]
    return Ensemble(polars.DataFrame(columns), polars.DataFrame(bands), {"title": "uneven", "sampling": "random"})


@pytest.fixture(scope="module")
def ensemble() -> Ensemble:
    return made()


@pytest.fixture(scope="module")
def found(ensemble: Ensemble) -> Sensitivity:
    return sensitivity(ensemble, PEAK)


def drawn_of(ensemble: Ensemble, by: str, found: Sensitivity | None = None) -> dict[str, Figure]:
    """The figures by the names of their files."""
    with figures_drawn(is_rendered=False) as made:
        files = figures(ensemble_report(ensemble, by, found), ("png",))
    return {name.removesuffix(".png"): figure for name, figure in zip(files, made, strict=True)}


@pytest.fixture(scope="module")
def drawn(ensemble: Ensemble, found: Sensitivity) -> dict[str, Figure]:
    figures = drawn_of(ensemble, PEAK, found)
    assert list(figures) == ["distribution", "bands", "dependence", "sensitivity"]
    return figures


def panels_of(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def title_and_panel(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title(loc="left"): axes for axes in panels_of(figure)}


def legend_of(figure: Figure) -> tuple[list[str], str]:
    """The words of the one legend of a grid, and its title."""
    (legend,) = (each for part in figure.subfigs for each in part.legends)
    return [text.get_text() for text in legend.get_texts()], legend.get_title().get_text()


def test_bands_are_those_of_the_table_in_shown_units(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: all signals, errors first; edges of the three bands and the median, of every time; one legend."""
    figure = drawn["bands"]
    shown = sorted(SIGNALS, key=lambda name: not name.startswith("error."))
    panels = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in panels] == [SIGNALS[name][0] for name in shown]
    assert [axes.get_xlabel() for axes in panels] == [""] * 14 + ["time [s]"] * 3
    for axes, name in zip(panels, shown, strict=True):
        part, factor = ensemble.bands.filter(polars.col("signal") == name), SIGNALS[name][1]
        time = part["time"].to_numpy()
        ends_of = (("lowest", "highest"), ("q05", "q95"), ("q25", "q75"))
        for fill, ends in zip(axes.collections, ends_of, strict=True):
            corners = np.asarray(fill.get_paths()[0].vertices, dtype=float)
            edges = np.unique(np.round(corners, 9), axis=0)
            expected = [(t, factor * value) for end in ends for t, value in zip(time, part[end], strict=True)]
            np.testing.assert_allclose(edges, np.unique(np.round(expected, 9), axis=0), rtol=1e-9)
        (median,) = axes.get_lines()
        x, y = data_of(median)
        assert x.tolist() == time.tolist()
        np.testing.assert_allclose(y, factor * part["q50"].to_numpy())
        assert axes.get_xlim() == (7.3, 8.3)
    names, note = legend_of(figure)
    assert names == ["lowest to highest", "5 to 95 %", "25 to 75 %", "median"]
    assert note == "Of the members still running."
    assert [axes.axison for axes in figure.axes] == [True] * 17 + [False]


@pytest.mark.parametrize("others", [0, 1])
def test_a_metric_that_is_all_but_constant_has_a_histogram(others: int) -> None:
    """Expected: all 400 values between the edges, none of them an outlier."""
    found = ensemble_of(np.random.default_rng(2).normal(size=(400, 4)))
    values = np.append(np.full(400 - others, 5.0), np.full(others, 9.0))
    members = found.members.with_columns(polars.Series("force.peak", values))
    figure = drawn_of(Ensemble(members, found.bands, found.metadata), "force.peak")["distribution"]
    axes = panels_of(figure)[0]
    (steps,) = axes.patches
    counts, edges = steps.get_data()[:2]  # type: ignore[attr-defined]
    assert counts.sum() == 400
    assert (edges[0], edges[-1]) == ((5.0, 9.0) if others else (4.5, 5.5))
    assert legend_of(figure)[1] == ""


def test_histograms_are_of_the_members_that_completed(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: that of the verdict first; counts between the edges, quantiles, and what lies outside, by NumPy.

    Margins are of all members.
    """
    figure = drawn["distribution"]
    shown = [PEAK, *(name for name in METRICS if name != PEAK)]
    panels = panels_of(figure)
    assert [axes.get_xlabel() for axes in panels] == [METRICS[name][0] for name in shown]
    assert [axes.get_ylabel() for axes in panels] == ["members", "", ""] * 5
    completed = ensemble.members.filter(polars.col("outcome") == "completed")
    for axes, name in zip(panels, shown, strict=True):
        of = ensemble.members if name.startswith("margins.") else completed
        values = np.sort(METRICS[name][1] * of[name].to_numpy())
        assert len(values) == (N if name.startswith("margins.") else N - 9)
        (steps,) = axes.patches
        counts, edges = steps.get_data()[:2]  # type: ignore[attr-defined]
        outliers = 2 if name == "force.peak" else 0
        inside = values[outliers // 2 : len(values) - outliers // 2]
        assert len(counts) == 40
        assert (edges[0], edges[-1]) == pytest.approx((inside[0], inside[-1]))
        assert np.diff(edges) == pytest.approx(np.ptp(inside) / 40)
        expected = np.histogram(inside, edges)[0]
        # a value at an edge may round to either side
        assert np.abs(counts - expected).sum() <= 2
        assert [data_of(line)[0][0] for line in axes.get_lines()] == pytest.approx(
            np.quantile(values, [0.05, 0.5, 0.95]).tolist()
        )
    names, note = legend_of(figure)
    assert names == ["members", "5 %, 50 %, 95 %"]
    assert note == "peak force: 2 members outside, -3 to 40 N in all."


def test_the_metric_is_drawn_against_the_most_influential_inputs(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: the first four inputs in the order of their slopes; every member that completed."""
    panels = panels_of(drawn["dependence"])
    assert [axes.get_xlabel() for axes in panels] == [
        f"{name} [{UNITS[name]}]" if name in UNITS else name for name in INPUTS[:4]
    ]
    assert [axes.get_ylabel() for axes in panels] == ["position error, peak [mm]", ""] * 2
    completed = (ensemble.members["outcome"] == "completed").to_numpy()
    for axes, name in zip(panels, INPUTS[:4], strict=True):
        (dots,) = axes.get_lines()
        x, y = data_of(dots)
        np.testing.assert_allclose(x, ensemble.members[f"varied.{name}"].to_numpy())
        np.testing.assert_allclose(y[completed], 1e3 * ensemble.members[PEAK].to_numpy()[completed])
        assert np.isnan(y[~completed]).all()
        assert dots.get_color() == colour_of("actual")
        assert dots.get_rasterized()


def test_without_sensitivity_inputs_are_in_the_order_of_the_experiment() -> None:
    """Expected: four inputs as in the table, rows of three panels, points of few members as lines of a drawing."""
    figures = drawn_of(ensemble_of(np.random.default_rng(2).normal(size=(60, 4))), "margins.disk")
    assert list(figures) == ["distribution", "bands", "dependence"]
    panels = panels_of(figures["dependence"])
    assert [axes.get_xlabel() for axes in panels] == [
        *("platform_mass [kg]", "controller.bandwidth", "base_points[1,2] [m]", "leg_coulomb_friction [N]")
    ]
    assert not any(axes.get_lines()[0].get_rasterized() for axes in panels)
    heights = [figures[name].get_figheight() for name in ("bands", "dependence")]
    assert heights == pytest.approx([0.55 + 1.9 * rows for rows in (2, 2)])


def bars_of(axes: Axes, container: int) -> tuple[FloatArray, FloatArray]:
    """Their lengths, and half widths of the whiskers."""
    bars: Any = axes.containers[container]
    segments = np.array(bars.errorbar.lines[2][0].get_segments())
    return np.array([bar.get_width() for bar in bars]), np.ptp(segments[:, :, 0], axis=1) / 2


def test_bars_of_a_regression_are_its_coefficients(found: Sensitivity, drawn: dict[str, Figure]) -> None:
    """Expected: 2⁻ᵏ over the root of the sum of squares, the most influential one on top."""
    (axes,) = drawn["sensitivity"].axes
    assert axes.get_title(loc="left") == "what makes the position error, peak vary"
    assert [label.get_text() for label in axes.get_yticklabels()] == list(INPUTS)
    assert axes.yaxis.get_inverted()
    lengths, halves = bars_of(axes, -1)
    slopes = 2.0 ** -np.arange(13)
    assert lengths == pytest.approx(slopes / np.linalg.norm(slopes), abs=0.05)
    assert lengths.tolist() == found.main[found.order].tolist()
    assert halves == pytest.approx(found.main_confidence[found.order])
    assert axes.get_xlabel() == "standardised regression coefficient β"
    (note,) = (text.get_text() for text in axes.texts)
    assert note.startswith(f"standardised regression, R² = 1.00, of {N - 9} members; left out: 9 not completed")


def test_bars_of_indices_are_total_and_alone() -> None:
    """Expected: the given numbers, by total, each with its own whisker, and the names in the legend."""
    total, main = np.array([0.1, 0.7, 0.45]), np.array([0.08, 0.5, 0.2])
    halves = np.array([0.01, 0.04, 0.02]), np.array([0.03, 0.05, 0.06])
    known = Sensitivity("force.peak", "sobol", ("a", "b", "c"), main, halves[0], total, halves[1], None, 640, 10)
    figures = drawn_of(ensemble_of(np.random.default_rng(2).normal(size=(60, 4))), "force.peak", known)
    (axes,) = figures["sensitivity"].axes
    order = [1, 2, 0]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["b", "c", "a"]
    wide = [k for k, each in enumerate(axes.containers) if hasattr(each, "patches")]
    for container, values, half in zip(wide, (main, total), halves, strict=True):
        lengths, whiskers = bars_of(axes, container)
        assert lengths.tolist() == values[order].tolist()
        assert whiskers == pytest.approx(half[order])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["alone", "in total"]
    assert axes.get_xlabel() == "share of the variance"

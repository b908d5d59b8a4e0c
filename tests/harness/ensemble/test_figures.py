"""Figures of an ensemble as they are drawn, number by number, against the columns of its tables.

There is more of everything than a figure shows: signals, metrics, inputs and members.
"""

from itertools import pairwise
from typing import Any

import numpy as np
import polars
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gough_stewart.harness.ensemble.figures import ensemble_figures
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.ensemble.sensitivity import Sensitivity, sensitivity
from gough_stewart.harness.output.colours import COLOURS
from gough_stewart.model.vectors import FloatArray
from tests.support.ensembles import ensemble_of
from tests.support.figures import data_of, figures_drawn

PEAK = "tracking.position.norm_peak"
N, SHOWN = 3350, 3000
SIGNALS = {
    "position[1]": ("x [m]", 1.0),
    "position[3]": ("z [m]", 1.0),
    "orientation[2]": ("pitch [rad]", 1.0),
    "orientation[3]": ("yaw [rad]", 1.0),
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
    "angular_velocity[1]": ("angular velocity 1 [rad/s]", 1.0),
}
# In the order in which they are shown, with units; the last three have no panel.
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
    "leg_viscous_friction[4]": "N.s/m",
    "platform_mass": "kg",
    "base_points[2,3]": "m",
    "platform_com[3]": "m",
    "plant.parameters.leg_lower_mass": "kg",
    "platform.leg_length_max": "m",
    "gravity[1]": "m/s2",
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


@pytest.fixture(scope="module")
def drawn(ensemble: Ensemble, found: Sensitivity) -> dict[str, Figure]:
    """The figures by the names of their files."""
    with figures_drawn(is_rendered=False) as figures:
        files = ensemble_figures(ensemble, PEAK, found)
    assert list(files) == ["bands.png", "histograms.png", "dependence.png", "sensitivity.png"]
    return {name.removesuffix(".png"): figure for name, figure in zip(files, figures, strict=True)}


def title_of(figure: Figure) -> str:
    return " ".join(figure.get_suptitle().split())


def panels_of(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def title_and_panel(figure: Figure) -> dict[str, Axes]:
    return {axes.get_title(loc="left"): axes for axes in panels_of(figure)}


def notes_of(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_bands_are_those_of_the_table_in_shown_units(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: the first 15 signals; the edges of both fills, the extremes and the median, of every time."""
    figure = drawn["bands"]
    said = "uneven: 3350 members; median, 25 to 75 %, 5 to 95 %, extremes; 15 of 17 signals"
    assert title_of(figure) == said
    panels = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in panels] == [text for text, _ in list(SIGNALS.values())[:15]]
    assert [axes.get_xlabel() for axes in panels] == [""] * 12 + ["time [s]"] * 3
    for axes, (name, (_, factor)) in zip(panels, SIGNALS.items(), strict=False):
        part = ensemble.bands.filter(polars.col("signal") == name)
        time = part["time"].to_numpy()
        for fill, ends in zip(axes.collections, (("q05", "q95"), ("q25", "q75")), strict=True):
            corners = np.asarray(fill.get_paths()[0].vertices, dtype=float)
            edges = np.unique(np.round(corners, 9), axis=0)
            expected = [(t, factor * value) for end in ends for t, value in zip(time, part[end], strict=True)]
            np.testing.assert_allclose(edges, np.unique(np.round(expected, 9), axis=0), rtol=1e-9)
        for line, of in zip(axes.get_lines(), ("lowest", "highest", "q50"), strict=True):
            assert [each.tolist() for each in data_of(line)] == [
                time.tolist(),
                pytest.approx((factor * part[of].to_numpy()).tolist()),
            ]
        assert axes.get_xlim() == (7.3, 8.3)
        assert axes.yaxis.get_offset_text().get_fontsize() == 7


def test_a_line_that_hardly_moves_is_not_blown_up() -> None:
    """Expected: 10 μm about the middle of a position in m, as 0.01 mm of an error; larger spans stay."""
    ensemble = made()
    level = {
        **{"position[1]": 0.7, "orientation[2]": 0.3, "velocity[2]": 0.2, "angular_velocity[1]": -0.4},
        **{
            "error.position[1]": 0.3e-3,
            "error.orientation[1]": 0.2e-3,
            "actuator_force[1]": 40.0,
            "leg_length[4]": 2.0,
        },
    }
    flat = ensemble.bands.filter(polars.col("signal").is_in(list(level))).with_columns(
        polars.col("signal").replace_strict(level).alias(name)
        for name in ("lowest", "q05", "q25", "q50", "q75", "q95", "highest")
    )
    is_leg = polars.col("signal") == "leg_length[4]"
    # 3 cm below, or 3 μm
    flat = flat.with_columns(polars.col("lowest") - polars.when(is_leg).then(0.03).otherwise(3e-6))
    with figures_drawn(is_rendered=False) as figures:
        ensemble_figures(Ensemble(ensemble.members, flat, {"title": "flat"}), PEAK)
    panels = title_and_panel(figures[0])
    for title, middle, span in (
        ("x [m]", 0.7 - 1.5e-6, 1e-5),
        ("pitch [rad]", 0.3 - 1.5e-6, 1e-5),
        ("velocity 2 [m/s]", 0.2 - 1.5e-6, 1e-4),
        ("angular velocity 1 [rad/s]", -0.4 - 1.5e-6, 1e-4),
        ("error of x [mm]", 0.3 - 1.5e-3, 1e-2),
        ("error of roll [deg]", np.degrees(0.2e-3 - 1.5e-6), 1e-3),
        ("actuator force 1 [N]", 40.0, 1.0),
    ):
        assert panels[title].get_ylim() == pytest.approx((middle - span / 2, middle + span / 2), abs=span / 1e4), title
    assert panels["leg length 4 [m]"].get_ylim() == pytest.approx((1.97 - 0.0015, 2 + 0.0015))
    # eight panels in rows of three: one without a panel has no frame
    assert len(panels) == 8
    assert [axes.axison for axes in figures[0].axes] == [True] * 8 + [False]
    grid = panels["x [m]"].get_gridspec()
    assert grid is not None
    assert (grid.nrows, grid.ncols) == (3, 3)


@pytest.mark.parametrize("others", [0, 1])
def test_a_metric_that_is_all_but_constant_has_a_histogram_and_an_axis(others: int) -> None:
    """Expected: all 400 values between the edges, none of them an outlier; an axis of 1 + 15 % about one value."""
    found = ensemble_of(np.random.default_rng(2).normal(size=(400, 4)))
    values = np.append(np.full(400 - others, 5.0), np.full(others, 9.0))
    members = found.members.with_columns(polars.Series("force.peak", values))
    with figures_drawn(is_rendered=False) as figures:
        ensemble_figures(Ensemble(members, found.bands, found.metadata), "force.peak")
    axes = title_and_panel(figures[1])["peak force [N]"]
    (steps,) = axes.patches
    counts, edges = steps.get_data()[:2]  # type: ignore[attr-defined]
    assert counts.sum() == 400
    assert len(counts) == 20
    assert (edges[0], edges[-1]) == ((5.0, 9.0) if others else (4.5, 5.5))
    assert notes_of(axes) == []
    if not others:
        assert {axes.get_ylim() for axes in panels_of(figures[2])} == {(4.95, 5.1)}


def test_histograms_are_of_the_members_that_completed(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: the first 12 metrics; counts between the edges, quantiles, and what lies outside, by NumPy."""
    figure = drawn["histograms"]
    assert title_of(figure) == (
        "uneven: metrics of the members that completed (9 did not); 5, 50, 95 % dashed; 12 of 15 metrics"
    )
    panels = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in panels] == [text for text, _ in list(METRICS.values())[:12]]
    completed = ensemble.members.filter(polars.col("outcome") == "completed")
    for axes, (name, (_, factor)) in zip(panels, METRICS.items(), strict=False):
        values = np.sort(factor * completed[name].to_numpy())
        assert len(values) == N - 9
        (steps,) = axes.patches
        counts, edges = steps.get_data()[:2]  # type: ignore[attr-defined]
        outliers = 2 if name == "force.peak" else 0
        inside = values[outliers // 2 : len(values) - outliers // 2]
        assert len(counts) == 40
        assert (edges[0], edges[-1]) == pytest.approx((inside[0], inside[-1]))
        assert np.diff(edges) == pytest.approx(np.ptp(inside) / 40)
        expected = [np.count_nonzero((inside >= a) & (inside < b)) for a, b in pairwise(edges)]
        assert counts.tolist() == [*expected[:-1], expected[-1] + np.count_nonzero(inside == edges[-1])]
        assert [data_of(line)[0][0] for line in axes.get_lines()] == pytest.approx(
            np.quantile(values, [0.05, 0.5, 0.95]).tolist()
        )
        assert notes_of(axes) == (["2 outside; -3 to 40 in all"] if outliers else [])
        lines = [axis.get_gridlines()[0].get_visible() for axis in (axes.xaxis, axes.yaxis)]
        assert lines == [False, True]


def test_the_metric_is_drawn_against_the_most_influential_inputs(ensemble: Ensemble, drawn: dict[str, Figure]) -> None:
    """Expected: 12 inputs in the order of their slopes; the first 3,000 members by outcome; what is above, said."""
    figure = drawn["dependence"]
    assert title_of(figure) == (
        "uneven: position error, peak [mm] against what varies; 3000 of 3350 members; 12 of 13 inputs"
    )
    panels = panels_of(figure)
    assert [axes.get_title(loc="left") for axes in panels] == [
        f"{name} [{UNITS[name]}]" if name in UNITS else name for name in INPUTS[:12]
    ]
    members = ensemble.members.head(SHOWN)
    for axes, name in zip(panels, INPUTS, strict=False):
        dots = {line.get_label(): data_of(line) for line in axes.get_lines()}
        assert list(dots) == ["completed", "ended early"]
        colours = [line.get_color() for line in axes.get_lines()]
        assert colours == [COLOURS[0], COLOURS[1]]
        for label, outcome in (("completed", "completed"), ("ended early", "diverged")):
            some = members.filter(polars.col("outcome") == outcome)
            assert dots[label][0].tolist() == some[f"varied.{name}"].to_list()
            assert dots[label][1] == pytest.approx(1e3 * some[PEAK].to_numpy())
        assert len(dots["ended early"][0]) == 8
        low, high = np.quantile(1e3 * ensemble.members[PEAK].to_numpy(), [0, 0.999])
        assert axes.get_ylim() == pytest.approx((low - 0.05 * (high - low), high + 0.1 * (high - low)))
        assert notes_of(axes) == ["1 above; the largest: 7e+03"]
    assert panels[0].get_legend() is not None
    assert panels[1].get_legend() is None


def test_without_failures_and_sensitivity_no_legend_and_the_order_of_the_experiment() -> None:
    """Expected: four inputs as in the table, nothing above the largest, rows of three panels."""
    x = np.random.default_rng(2).normal(size=(60, 4))
    with figures_drawn(is_rendered=False) as figures:
        ensemble_figures(ensemble_of(x), "margins.disk")
    bands, histograms, dependence = figures
    assert title_of(bands) == "closed forms: 60 members; median, 25 to 75 %, 5 to 95 %, extremes"
    assert title_of(histograms) == "closed forms: metrics of 60 members; 5, 50, 95 % dashed"
    assert title_of(dependence) == "closed forms: disk margin against what varies"
    assert [axes.get_title(loc="left") for axes in panels_of(dependence)] == [
        *("platform_mass [kg]", "controller.bandwidth", "base_points[1,2] [m]", "leg_coulomb_friction [N]")
    ]
    assert all(axes.get_legend() is None and not axes.texts for axes in dependence.axes)
    # as many classes as the root of the number of members, eight or more
    assert {len(axes.patches[0].get_data()[0]) for axes in panels_of(histograms)} == {8}  # type: ignore[attr-defined]
    heights = [figure.get_figheight() for figure in figures]
    assert heights == pytest.approx([0.6 + 1.9 * rows for rows in (2, 4, 2)])


def bars_of(axes: Axes, container: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Their lengths, half widths of the whiskers, and positions."""
    bars: Any = axes.containers[container]
    lengths, at = [bar.get_width() for bar in bars], [bar.get_y() + bar.get_height() / 2 for bar in bars]
    segments = np.array(bars.errorbar.lines[2][0].get_segments())
    return np.array(lengths), np.ptp(segments[:, :, 0], axis=1) / 2, np.array(at)


def test_bars_of_a_regression_are_its_coefficients(found: Sensitivity, drawn: dict[str, Figure]) -> None:
    """Expected: 2⁻ᵏ over the root of the sum of squares, the most influential one on top, 12 of 13."""
    figure = drawn["sensitivity"]
    (axes,) = figure.axes
    assert title_of(figure) == "What makes the position error, peak vary"
    assert [label.get_text() for label in axes.get_yticklabels()] == list(INPUTS[:12])[::-1]
    lengths, halves, at = bars_of(axes, -1)
    slopes = 2.0 ** -np.arange(12)
    assert lengths[::-1] == pytest.approx(slopes / np.linalg.norm(slopes), abs=0.05)
    assert lengths.tolist() == found.main[found.order[:12]][::-1].tolist()
    assert halves == pytest.approx(found.main_confidence[found.order[:12]][::-1])
    assert at.tolist() == list(range(12))
    assert axes.get_xlabel() == "standardised regression coefficient β"
    assert [axis.get_gridlines()[0].get_visible() for axis in (axes.xaxis, axes.yaxis)] == [True, False]
    assert axes.get_title(loc="left") == f"standardised regression, R² = 1.00, of {N - 9} members; left out: 9 not " + (
        "completed or without a value"
    )


def test_bars_of_indices_are_total_and_alone() -> None:
    """Expected: the given numbers, by total, each with its own whisker, and the names in the legend."""
    total, main = np.array([0.1, 0.7, 0.45]), np.array([0.08, 0.5, 0.2])
    halves = np.array([0.01, 0.04, 0.02]), np.array([0.03, 0.05, 0.06])
    known = Sensitivity("force.peak", "sobol", ("a", "b", "c"), main, halves[0], total, halves[1], None, 640, 10)
    with figures_drawn(is_rendered=False) as figures:
        ensemble_figures(ensemble_of(np.random.default_rng(2).normal(size=(60, 4))), "force.peak", known)
    (axes,) = figures[-1].axes
    order = [0, 2, 1]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a", "c", "b"]
    wide = [k for k, each in enumerate(axes.containers) if hasattr(each, "patches")]
    for container, values, half, place in zip(wide, (total, main), halves[::-1], (-0.19, 0.19), strict=True):
        lengths, whiskers, at = bars_of(axes, container)
        assert lengths.tolist() == values[order].tolist()
        assert whiskers == pytest.approx(half[order])
        assert at == pytest.approx(np.arange(3) + place)
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["in total", "alone"]
    assert axes.get_xlabel() == "share of the variance (Sobol' index)"
    assert axes.get_title(loc="left").startswith("Sobol' indices of 640 members; left out: 10 not completed")
    assert "whiskers" not in axes.get_title(loc="left")
    # the inputs of a dependence are in the order of the experiment: indices are of groups
    assert panels_of(figures[-2])[0].get_title(loc="left") == "platform_mass [kg]"

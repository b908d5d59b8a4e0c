"""What the reproduction reports of a case in which no two numbers are alike: numbers, tables, figures, files."""

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from rich.console import Console

import gough_stewart as gs
from gough_stewart.harness.paper import agreement, figures, readings, reproduce
from gough_stewart.harness.paper.case_report import case_report
from gough_stewart.harness.paper.open_loop import Trajectory, run_kane, run_kernel, run_stepping
from gough_stewart.harness.report.plotting import COLOURS, DASHES
from gough_stewart.harness.report.table import Table
from gough_stewart.model import interface
from gough_stewart.model.formulations.cases import OpenLoopCase, paper_case
from tests.support.lagrangian import Pose, legs_along
from tests.support.uneven import INPUTS, STATE, UNEVEN

CASE = OpenLoopCase("uneven *case*", UNEVEN, STATE, INPUTS.actuator_force, 0.3)
ROWS = [
    agreement.Agreement("first thing", 2.5e-9, 1e-8, "m, rad"),
    agreement.Agreement("second thing", 3.4e-5, 2e-6, "relative"),
]
READINGS = [
    readings.Reading("a point", "decided so", "other way", 0.01234, 0.56789, "a remark", 3.125),
    readings.Reading("another", "thus", "not thus", None, None, "impossible: why"),
]
WEIGHT = {"static_leg_force": 44.125, "share_of_total_weight": 49.534}
DRIFT: Any = {
    "loose": SimpleNamespace(
        time=np.array([0.0, 0.1, 0.25, 0.3]),
        position_violation=np.array([0.0, 1e-5, 3e-5, 2e-5]),
        velocity_violation=np.array([0.0, 4e-4, 6e-4, 5e-4]),
    ),
    "tight": SimpleNamespace(
        time=np.array([0.0, 0.2, 0.3]),
        position_violation=np.array([0.0, 8e-8, 7e-8]),
        velocity_violation=np.array([0.0, 2e-7, 1e-7]),
    ),
}
DRIFT_ENDS = [
    {"steps": 3, "closure_gap_end": 2e-5, "slip_end": 5e-4},
    {"steps": 2, "closure_gap_end": 7e-8, "slip_end": 1e-7},
]


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return run_kernel(CASE)


def test_friction_work_and_states_are_those_of_another_integration(run: Trajectory) -> None:
    """Expected: the energy balance E(t) − E(0) = Σ F ΔL − lost; the stepping model; the Lagrangian's leg lengths."""
    energy = run["kinetic_energy"] + run["potential_energy"]
    put_in = (run["leg_length"] - run["leg_length"][0]) @ CASE.actuator_force
    np.testing.assert_allclose(run.friction_work, put_in - (energy - energy[0]), rtol=0, atol=1e-9)
    assert (np.diff(run.friction_work) > 0).all()
    reached: list[float] = []
    stepped = run_stepping(CASE, progress=reached.append)
    np.testing.assert_allclose(stepped, run.states, rtol=0, atol=1e-6)
    np.testing.assert_allclose(reached, np.linspace(0.003, 0.3, 100), rtol=1e-12)
    leap = run_stepping(CASE, rows=False)
    assert leap.shape == (2, 12)
    np.testing.assert_allclose(leap, run.states[[0, -1]], rtol=0, atol=1e-6)
    assert np.abs(leap[1] - stepped[-1]).max() > 0
    pose = run.states[:, :6]
    length = legs_along(UNEVEN, Pose(pose, np.zeros_like(pose), np.zeros_like(pose)))[0]
    np.testing.assert_allclose(run["leg_length"], length, rtol=0, atol=1e-12)
    times: list[float] = []
    np.testing.assert_array_equal(run_kernel(CASE, progress=times.append).states, run.states)
    assert min(times) == 0
    assert max(times) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("viscous", "coulomb", "lost"), [(0.0, 0.0, False), (7.0, 0.0, True), (0.0, 1.9, True), (7.0, 1.9, True)]
)
def test_each_kind_of_friction_loses_work(viscous: float, coulomb: float, lost: bool) -> None:
    """Expected: Σ of force times leg velocity, as formulas, by the trapezoidal rule."""
    platform = replace(UNEVEN, leg_viscous_friction=viscous, leg_coulomb_friction=coulomb)
    found = run_kernel(replace(CASE, platform=platform, duration=0.1), 1e-8)
    v = found["leg_velocity"]
    force = viscous * platform.leg_viscous_friction_factor * v
    force = force + coulomb * platform.leg_coulomb_friction_factor * np.tanh(v / platform.leg_friction_velocity)
    expected = np.trapezoid((force * v).sum(axis=1), found.time)
    assert found.friction_work[-1] == pytest.approx(expected, rel=1e-4, abs=1e-12)
    assert (found.friction_work[-1] > 0) == lost


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    """The content of a report with round numbers, no two alike."""
    start = {
        "position": [0.12, -0.09, 2.97],
        "orientation": [0.09, -0.14, 0.21],
        "velocity": [0.21, -0.13, 0.08],
        "angular_velocity": [-0.11, 0.17, 0.26],
    }
    ends = {
        "position": [0.1, -0.2, 3.25],
        "orientation": [-0.0, 0.5, 0.625],
        "velocity": [1.0, 2.0, 3.0],
        "angular_velocity": [4.0, 5.0, 6.0],
    }
    result = {
        "end": ends,
        "leg_length_end": [3.1, 3.2, 3.3, 3.4, 3.5, 3.6],
        "largest_condition_number": 12.345,
        "friction_work": 0.0123456,
        "actuator_work": 7.654321,
    }
    case = {
        "title": "uneven *case*",
        "platform": "uneven",
        "source": "made up",
        "duration": 0.3,
        "actuator_force": CASE.actuator_force.tolist(),
        "start": start,
    }
    return {
        "case": case,
        "result": result,
        "agreement": [{**asdict(row), "holds": row.holds} for row in ROWS],
        "drift": {"loose": DRIFT_ENDS[0], "tight": DRIFT_ENDS[1]},
        "readings": [asdict(reading) for reading in READINGS],
        "published_forces": WEIGHT,
    }


def test_tables_of_the_terminal_have_every_number(content: dict[str, Any]) -> None:
    """Expected: written out."""
    found = case_report(content)
    motion, agreed, drift, other = (part for part in found.parts() if isinstance(part, Table))
    assert motion.title == "Uneven *case*"
    assert [column.name for column in motion.columns] == ["", "start", "after 0.3 s"]
    assert motion.shown == [
        *(("x m", "0.12", "0.1"), ("y m", "-0.09", "-0.2"), ("z m", "2.97", "3.25")),
        *(("roll deg", "5.157", "0"), ("pitch deg", "-8.021", "28.65"), ("yaw deg", "12.03", "35.81")),
        *(("velocity, x m/s", "0.21", "1"), ("velocity, y m/s", "-0.13", "2"), ("velocity, z m/s", "0.08", "3")),
        ("angular velocity, x deg/s", "-6.303", "229.2"),
        ("angular velocity, y deg/s", "9.74", "286.5"),
        ("angular velocity, z deg/s", "14.9", "343.8"),
    ]
    assert agreed.title == "Agreement of the formulations"
    assert agreed.shown == [
        ("first thing", "2.5e-09", "1e-08", "m, rad", "ok"),
        ("second thing", "3.4e-05", "2e-06", "relative", "MISSED"),
    ]
    assert [column.name for column in drift.columns] == ["run", "closure gap [m]", "slip [m/s, rad/s]"]
    assert drift.shown == [("loose", "2e-05", "0.0005"), ("tight", "7e-08", "1e-07")]
    assert list(other.rows) == [
        ("a point: decided so", "other way", 3.125, 0.01234, 0.56789),
        ("another: thus", "not thus", None, None, None),
    ]
    assert [column.quantity.unit for column in other.columns[2:] if column.quantity] == ["m", "m", "deg"]
    bare = case_report({**content, "readings": [], "published_forces": None})
    assert len([part for part in bare.parts() if isinstance(part, Table)]) == 3
    assert [number.value for number in found.numbers][-2:] == [2.5e-9, 3.4e-5]
    assert found.number("agreement.2").margin == pytest.approx(2e-6 - 3.4e-5)


def test_the_verdict_says_how_far_the_platform_moves_in_every_reading(content: dict[str, Any]) -> None:
    """Expected: heights and forces of the content; a reading that cannot run does not count; one that sinks does."""
    made = content
    verdict = case_report(made).verdict
    low, high = min(CASE.actuator_force), max(CASE.actuator_force)
    assert verdict.text == (
        "Under the published forces the platform rises from 2.97 m to 3.25 m in 0.3 s, in every reading of the scan "
        f"that is possible (3.12 to 3.12 m); they are {low:.3g} and {high:.3g} N where 44.1 N would hold it; 1 of 2 "
        "comparisons of the formulations and FMUs are within their bounds"
    )
    assert verdict.status == "bad"
    assert (verdict.numbers[1].low, verdict.numbers[1].high) == (3.125, 3.125)
    sinks = {**made["readings"][0], "height": 2.5}
    text = case_report({**made, "readings": [*made["readings"], sinks]}).verdict.text
    assert "in 1 of 2 readings of the scan that is possible (2.5 to 3.12 m)" in text
    assert case_report({**made, "readings": [], "published_forces": None}).verdict.text.startswith(
        "Under the constant forces of the case the platform rises from 2.97 m to 3.25 m in 0.3 s; 1 of 2 "
    )


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures as they are drawn, before they become PNG."""
    made: list[Figure] = []

    def png(draw: Any, width: float, height: float = 3.6) -> bytes:
        figure = Figure(figsize=(width, height))
        draw(figure)
        made.append(figure)
        return b"png"

    monkeypatch.setattr(figures, "png", png)
    return made


def _curves(axes: Any) -> Iterator[tuple[str, str, str, np.ndarray[Any, Any], np.ndarray[Any, Any]]]:
    for line in axes.get_lines():
        yield line.get_label(), to_hex(line.get_color()), line.get_linestyle(), line.get_xdata(), line.get_ydata()


def test_figures_show_each_number_under_its_name(run: Trajectory, drawn: list[Figure]) -> None:
    """Expected: columns of the run by place: 0 to 5 pose, 6 to 11 velocities; legs by the Lagrangian's geometry."""
    assert list(figures.open_loop_figures(CASE, run)) == [f"figure-{k}.png" for k in (4, 5, 6, 7)]
    pose, states = run.states[:, :6], run.states
    along = legs_along(UNEVEN, Pose(pose, _rates(states), np.zeros_like(pose)))
    legs = [f"leg {i}" for i in range(1, 7)]
    expected = [
        [
            ("position of Op", "[m]", ["x", "y", "z"], states[:, :3]),
            ("roll, pitch, yaw", "[rad]", ["roll α", "pitch β", "yaw γ"], states[:, 3:6]),
        ],
        [
            ("velocity of Op", "[m/s]", ["v_x", "v_y", "v_z"], states[:, 6:9]),
            ("angular velocity, world", "[rad/s]", ["ω_x", "ω_y", "ω_z"], states[:, 9:]),
        ],
        [("leg length", "[m]", legs, along[0])],
        [("sliding velocity", "[m/s]", legs, along[1])],
    ]
    titles = ["Fig. 4 — Position and orientation", "Fig. 5 — Linear", "Fig. 6 — The length", "Fig. 7 — Sliding"]
    for figure, title, panels in zip(drawn, titles, expected, strict=True):
        shown = figure.get_suptitle()
        assert shown.startswith(title)
        assert shown.endswith("(uneven)")
        for axes, (what, unit, names, values) in zip(figure.axes, panels, strict=True):
            assert axes.get_title() == what
            assert axes.get_ylabel() == unit
            assert axes.get_xlabel() == "time [s]"
            curves = list(_curves(axes))
            assert [curve[0] for curve in curves] == names
            assert [curve[1] for curve in curves] == [to_hex(each) for each in COLOURS[: len(names)]]
            assert [curve[2] for curve in curves] == list(DASHES[: len(names)])
            for k, (*_, x, y) in enumerate(curves):
                np.testing.assert_array_equal(x, run.time)
                np.testing.assert_allclose(y, values[:, k], rtol=0, atol=1e-9)
            legend: Any = axes.get_legend()
            assert legend._ncols == (2 if len(names) == 6 else 1)
    assert [tuple(figure.get_size_inches()) for figure in drawn] == [(8, 3.6), (8, 3.6), (6, 3.6), (6, 3.6)]


def _rates(states: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Rates of the pose: of the angles from ω by the inverse of ω = E(angles) d(angles)/dt."""
    _, beta, gamma = states[:, 3:6].T
    zero, one = np.zeros_like(beta), np.ones_like(beta)
    E = np.stack(
        [
            np.stack([np.cos(beta) * np.cos(gamma), -np.sin(gamma), zero], axis=-1),
            np.stack([np.cos(beta) * np.sin(gamma), np.cos(gamma), zero], axis=-1),
            np.stack([-np.sin(beta), zero, one], axis=-1),
        ],
        axis=-2,
    )
    return np.concatenate([states[:, 6:9], np.linalg.solve(E, states[:, 9:, None])[..., 0]], axis=1)


def test_the_figure_of_the_drift_shows_both_violations_of_every_run(drawn: list[Figure]) -> None:
    """Expected: the numbers given, without the consistent start, which a logarithmic axis cannot show."""
    figures.drift_figure(DRIFT)
    (figure,) = drawn
    left, right = figure.axes
    for axes, name, unit in ((left, "position_violation", "[m]"), (right, "velocity_violation", "[m/s, rad/s]")):
        assert axes.get_ylabel() == unit
        assert axes.get_yscale() == "log"
        for k, ((label, colour, dash, x, y), (key, kane)) in enumerate(zip(_curves(axes), DRIFT.items(), strict=True)):
            assert (label, colour, dash) == (key, to_hex(COLOURS[k]), DASHES[k])
            np.testing.assert_array_equal(x, kane.time[1:])
            np.testing.assert_array_equal(y, getattr(kane, name)[1:])
    assert left.get_title() == "gap in the closures, largest |Φ|"
    assert right.get_title() == "slip of the constraints, largest |Φ_q y|"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(DRIFT)


def _with(run: Trajectory, column: str, change: np.ndarray[Any, Any]) -> Trajectory:
    """The run with a result multiplied by 1 + change (n,)."""
    results = run.results.copy()
    at = [k for k, name in enumerate(interface.RESULT_COLUMNS) if name.partition("[")[0] == column]
    results[:, at] *= 1 + change[:, None]
    return replace(run, results=results)


def test_each_comparison_measures_what_it_names() -> None:
    """Expected: a disturbance of known size in one of the runs appears in its own row, and is 0 elsewhere.

    A rotation of angle δ in the last row moves one angle by δ; a factor 1 + δ of all forces, at the row where they are
    largest, is δ of the largest.
    """
    case = replace(CASE, duration=0.05)
    kernel, kane = run_kernel(case), run_kane(case)
    stepping, leap = run_stepping(case), run_stepping(case, rows=False)
    rows = agreement.agreement(case, kernel, kane, stepping, leap)
    assert [(row.bound, row.unit) for row in rows] == [
        (1e-10, "relative"),
        (1e-10, "relative"),
        (1e-10, "relative"),
        (1e-10, "relative"),
        (1e-8, "m, rad"),
        (1e-6, "m, rad"),
        (1e-6, "m, rad"),
        (1e-6, "relative"),
        (1e-9, "relative"),
    ]
    names = [
        "task space (NumPy)",
        "Kane",
        "Newton–Euler",
        "joint forces: Newton–Euler",
        "Kane's DAE (RK45",
        "a step a row",
    ]
    names += ["one step", "multipliers of Kane's DAE", "energy minus work"]
    assert all(name in row.what for name, row in zip(names, rows, strict=True))
    assert all(row.holds for row in rows), rows
    # the columns of the pose: the fourth is an angle, the second a position, negative and positive
    moved = [stepping.copy(), leap.copy()]
    moved[0][-1, 3] -= 3e-3
    moved[1][-1, 1] += 5e-3
    moved[0][:-1], moved[0][-1, 6:], moved[1][0] = 9.0, 9.0, 9.0
    position = kane.configuration.position.copy()
    position[-1, 2] -= 7e-3
    position[:-1] += 1.0
    changed = replace(kane, configuration=kane.configuration._replace(position=position))
    found = agreement.agreement(case, kernel, changed, moved[0], moved[1])
    assert [found[k].measured for k in (4, 5, 6)] == pytest.approx([7e-3, 3e-3, 5e-3], rel=1e-3)
    assert [found[k].measured for k in (0, 1, 2, 3, 7, 8)] == [rows[k].measured for k in (0, 1, 2, 3, 7, 8)]
    # the largest difference over the largest value of any row, each a norm over all components
    for columns, at in ((("joint_force",), (3, 7)), (("acceleration", "angular_acceleration"), (0, 1, 2))):
        size = np.linalg.norm(np.concatenate([kernel[c].reshape(101, -1) for c in columns], axis=1), axis=1)
        wrong = np.zeros(101)
        wrong[17] = 1e-3
        disturbed = kernel
        for column in columns:
            disturbed = _with(disturbed, column, wrong)
        scale = np.where(wrong > 0, size * (1 + wrong), size).max()
        for k, row in enumerate(agreement.agreement(case, disturbed, kane, stepping, leap)):
            if k in at:
                assert row.measured == pytest.approx(1e-3 * size[17] / scale, rel=1e-4), row
            elif k < 4 or k == 7:
                assert row.measured == rows[k].measured
    # energy: the largest of |W| and T is the scale
    lost = kernel.friction_work.copy()
    lost[40] += 0.01
    work = (kernel["leg_length"] - kernel["leg_length"][0]) @ case.actuator_force - lost
    scale = max(np.abs(work).max(), kernel["kinetic_energy"].max())
    assert agreement.energy_error(case, replace(kernel, friction_work=lost)) == pytest.approx(0.01 / scale, rel=1e-5)
    heavy = _with(kernel, "kinetic_energy", np.full(101, 1e-3))
    # all kinetic energies too large by 0.1 %: only what they gain is
    gained = np.abs(kernel["kinetic_energy"] - kernel["kinetic_energy"][0]).max()
    error = agreement.energy_error(case, heavy)
    assert error == pytest.approx(1e-3 * gained / max(np.abs(work).max(), heavy["kinetic_energy"].max()), rel=1e-4)


def test_other_readings_move_the_end_by_what_a_run_of_them_does() -> None:
    """Expected: runs of platforms changed here, by the stepping model; angles about moving axes by their definition."""
    names = ["far", "alike", "order", "r2", "r_G", "g", "friction", "axes"]
    found = dict(zip(names, readings.other_readings(), strict=True))
    case = paper_case()
    end, p = run_stepping(case, rows=False)[-1], case.platform
    azimuth = np.radians([75, -75, 195, 45, 315, 165])
    far = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(6)], axis=1)
    others = {
        "far": replace(p, platform_points=far),
        "r2": replace(p, leg_upper_com=float(np.sqrt(3 * 0.0537))),
        "r_G": replace(p, platform_com=np.array([0, 0, 0.1])),
        "g": replace(p, gravity=np.array([0, 0, -9.80665])),
        "friction": replace(p, leg_viscous_friction=1.0),
    }
    for name, platform in others.items():
        reading = found[name]
        try:
            change = np.abs(run_stepping(replace(case, platform=platform), rows=False)[-1] - end)
        except gs.GoughStewartError:
            assert reading.position_change is None or name == "far"
            continue
        assert reading.position_change == pytest.approx(change[:3].max(), rel=1e-3)
        assert reading.orientation_change == pytest.approx(change[3:6].max(), rel=1e-3)
    order = run_stepping(paper_case(minus_first=True), rows=False)[-1]
    assert found["order"].position_change == pytest.approx(np.abs(order - end)[:3].max(), rel=1e-3)
    assert found["order"].orientation_change == pytest.approx(np.abs(order - end)[3:6].max(), rel=1e-3)
    # R = Rx(a) Ry(b) Rz(c): R13 = sin b, R23 = −sin a cos b, R12 = −cos b sin c
    roll, pitch, yaw = end[3:6]
    c, s = np.cos, np.sin
    Rz = np.array([[c(yaw), -s(yaw), 0], [s(yaw), c(yaw), 0], [0, 0, 1]])
    Ry = np.array([[c(pitch), 0, s(pitch)], [0, 1, 0], [-s(pitch), 0, c(pitch)]])
    Rx = np.array([[1, 0, 0], [0, c(roll), -s(roll)], [0, s(roll), c(roll)]])
    R = Rz @ Ry @ Rx
    moving = np.array([np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0])])
    assert found["axes"].orientation_change == pytest.approx(np.abs(moving - end[3:6]).max(), rel=1e-4)


@pytest.fixture(scope="module")
def made() -> tuple[reproduce.Reproduction, str, dict[str, Any]]:
    """A reproduction of a short case of the uneven platform, with FMUs that are made up, and what it showed."""
    case = replace(CASE, duration=0.04)
    kernel = run_kernel(case)
    wrong = kernel.states.copy()
    wrong[-1, 5] += 4e-4
    calls: dict[str, Any] = {}

    def units(case: OpenLoopCase, done: Any) -> Any:
        calls["case"] = case
        done()
        return {"a.fmu": b"zip", "b.fmu": b"zap"}, {"good FMU": kernel.states, "wrong FMU": wrong}

    shown = StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduce, "_units", units)
        patch.setattr(figures, "png", lambda *_: b"png")
        console = Console(file=shown, force_terminal=True, width=120)
        found = reproduce.reproduce(case, console, page=True)
    return found, shown.getvalue(), calls


def test_a_reproduction_has_all_parts_and_says_whether_it_agrees(
    made: tuple[reproduce.Reproduction, str, dict[str, Any]], tmp_path: Path
) -> None:
    """Expected: names and contents by hand; a FMU that is wrong by 4e-4 misses its bound."""
    found, shown, calls = made
    assert list(found.files) == [
        "open_loop.csv",
        *(f"figure-{k}.png" for k in (4, 5, 6, 7)),
        "drift.png",
        "comparison.json",
        "a.fmu",
        "b.fmu",
        "report.html",
    ]
    assert calls["case"].title == CASE.title
    rows = found.report["agreement"]
    assert [row["holds"] for row in rows] == [True] * 10 + [False]
    assert rows[9]["what"] == "final pose: good FMU (tolerance 1e-8) against kernel"
    assert (rows[9]["bound"], rows[9]["unit"]) == (1e-6, "m, rad")
    assert rows[10]["measured"] == pytest.approx(4e-4, rel=1e-6)
    assert not found.agrees
    good = replace(found, report={**found.report, "agreement": rows[:10]})
    assert good.agrees
    assert repr(found).startswith(
        "<Reproduction: 10 of 11 comparisons within their bounds; files open_loop.csv, figure-4"
    )
    assert json.loads(found.files["comparison.json"]) == found.report
    assert found.report["readings"] == []
    assert found.report["published_forces"] is None
    # states by name and place in the vector of 12; condition number, work and loss as formulas
    run = run_kernel(calls["case"])
    last, result = run.states[-1].tolist(), found.report["result"]
    assert [*result["end"].values()] == [last[:3], last[3:6], last[6:9], last[9:]]
    assert found.report["case"]["start"]["angular_velocity"] == STATE.angular_velocity.tolist()
    rho = np.array([1, 1, 1, *[np.sqrt((UNEVEN.platform_points**2).sum() / 6)] * 3])
    largest = max(np.linalg.cond(gs.leg_jacobian(UNEVEN, x[:3], x[3:6]) / rho) for x in run.states)
    assert result["largest_condition_number"] == pytest.approx(largest, rel=1e-9)
    power = run["leg_velocity"] @ CASE.actuator_force
    assert result["actuator_work"] == pytest.approx(np.trapezoid(power, run.time), rel=1e-4)
    assert result["friction_work"] == run.friction_work[-1] != run.friction_work[0]
    table = polars.read_csv(found.files["open_loop.csv"])
    assert table["time"].to_list() == pytest.approx(np.linspace(0, 0.04, 101).tolist())
    assert table["leg_length[4]"][-1] == found.report["result"]["leg_length_end"][3]
    drift = found.report["drift"]
    assert list(drift) == [
        "without Baumgarte, rtol 1e-3",
        "Baumgarte α = β = 10/s, rtol 1e-3",
        "without Baumgarte, rtol 1e-6",
        "Baumgarte α = β = 10/s, rtol 1e-6",
    ]
    for label, ends in drift.items():
        rtol, baumgarte = (1e-3 if "1e-3" in label else 1e-6), ((0.0, 0.0) if "without" in label else (10.0, 10.0))
        kane = run_kane(replace(CASE, duration=0.04), baumgarte, rtol, own_steps=True)
        assert ends["steps"] == len(kane.time) - 1
        assert ends["closure_gap_end"] == pytest.approx(kane.position_violation[-1])
    for text in ("stepping model", "task-space kernel", "Kane's DAE", "FMUs", "drift", "figures", "comparisons"):
        assert text in shown
    assert "other readings" not in shown
    page = found.files["report.html"].decode()
    assert re.search(r"Agreement of the formulations.*MISSED", page, re.DOTALL)
    assert found.save(tmp_path / "out") == [tmp_path / "out" / name for name in found.files]
    assert {each.name: each.read_bytes() for each in (tmp_path / "out").iterdir()} == found.files

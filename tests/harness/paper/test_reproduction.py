"""The reproduction of the paper's case, and of an uneven platform: its files, numbers, figures, and what it says."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.demo import Demo
from tests.support.figures import data_of, figures_drawn
from tests.support.page_arrays import elements
from tests.support.reports import tables_of
from tests.support.uneven import UNEVEN

PAPER = gs.load_preset("liu2000")
FORCES = [55, 49.5, 55, 49.5, 55, 49.5]
LEGS = tuple(f"leg {k}" for k in range(1, 7))


@pytest.fixture(scope="module")
def published(demo: Demo) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((demo.paper / "comparison.json").read_text())
    return found


def end_of(platform: gs.Platform, forces: Any = FORCES) -> FloatArray:
    """The pose after the paper's second, by the stepping model."""
    model = gs.SteppingModel(platform)
    model.set_many({"position": [0, 0, 3.0], "orientation": [0, 0, -0.1], "velocity": [0, 0.2, 0],
                    "angular_velocity": [0, 0.1, 0], "actuator_force": forces})  # fmt: skip
    model.do_step(0.0, 1.0)
    return np.asarray(model.state[:6])


def test_the_case_is_the_published_one_and_its_table_that_of_the_stepping_model(
    demo: Demo, published: dict[str, Any]
) -> None:
    """Expected: section IV of the paper; energy less what the forces put in is constant."""
    case = published["case"]
    assert (case["duration"], case["actuator_force"]) == (1.0, FORCES)
    assert case["start"] == {"position": [0, 0, 3.0], "orientation": [0, 0, -0.1], "velocity": [0, 0.2, 0],
                             "angular_velocity": [0, 0.1, 0]}  # fmt: skip
    table = polars.read_csv(demo.paper / "open_loop.csv")
    assert table["time"].to_numpy() == pytest.approx(np.linspace(0, 1, 101))
    pose = table.select([f"position[{k}]" for k in (1, 2, 3)] + [f"orientation[{k}]" for k in (1, 2, 3)]).to_numpy()
    assert pose[-1] == pytest.approx(end_of(PAPER), abs=1e-6)
    lengths = table.select([f"leg_length[{k}]" for k in range(1, 7)]).to_numpy()
    arms = np.einsum("nij,kj->nki", Rotation.from_euler("xyz", pose[:, 3:]).as_matrix(), PAPER.platform_points)
    assert lengths == pytest.approx(np.linalg.norm(pose[:, None, :3] + arms - PAPER.base_points, axis=2), abs=1e-12)
    energy = (table["kinetic_energy"] + table["potential_energy"]).to_numpy()
    assert energy - energy[0] == pytest.approx((lengths - lengths[0]) @ FORCES, abs=1e-7)


# What is compared, with its bound, and its unit.
COMPARED = {
    "platform acceleration: task space (NumPy) against kernel": (1e-10, "relative"),
    "platform acceleration: Kane against kernel": (1e-10, "relative"),
    "platform acceleration: Newton–Euler against kernel": (1e-10, "relative"),
    "joint forces: Newton–Euler against kernel": (1e-10, "relative"),
    "final pose: Kane's DAE (RK45, rtol 1e-10) against kernel (DOP853, 1e-12)": (1e-8, "m, rad"),
    "final pose: stepping model (tolerance 1e-8, a step a row) against kernel": (1e-6, "m, rad"),
    "final pose: stepping model (tolerance 1e-8, one step) against kernel": (1e-6, "m, rad"),
    "joint forces along the run: multipliers of Kane's DAE against task space": (1e-6, "relative"),
    "energy minus work of the forces, largest over the run": (1e-9, "relative"),
    **{
        f"final pose: FMU, FMI {version} {kind} (tolerance 1e-8) against kernel": (1e-7, "m, rad")
        for version in ("2.0", "3.0")
        for kind in ("Co-Simulation", "Model Exchange under CVode")
    },
}


def test_all_formulations_and_units_agree(published: dict[str, Any]) -> None:
    """Expected: every comparison within its bound, of the published case."""
    assert {row["what"]: (row["bound"], row["unit"]) for row in published["agreement"]} == COMPARED
    assert all(0 <= row["measured"] <= row["bound"] and row["holds"] for row in published["agreement"])


def test_other_readings_of_the_scan_move_the_end_by_what_a_run_of_them_does(published: dict[str, Any]) -> None:
    """Expected: runs of platforms changed here, by the stepping model; angles about moving axes by SciPy."""
    names = ("far", "alike", "order", "r2", "r_G", "g", "friction", "axes")
    readings = dict(zip(names, published["readings"], strict=True))
    end = end_of(PAPER)
    azimuth = np.radians([75, -75, 195, 45, 315, 165])  # 60° away, by turns + and −
    far = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(6)], axis=1)
    others = {
        "far": end_of(replace(PAPER, platform_points=far)),
        "order": end_of(PAPER, np.reshape(FORCES, (3, 2))[:, ::-1].ravel()),
        "r2": end_of(replace(PAPER, leg_upper_com=float(np.sqrt(3 * 0.0537)))),
        "r_G": end_of(replace(PAPER, platform_com=np.array([0, 0, 0.1]))),
        "g": end_of(replace(PAPER, gravity=np.array([0, 0, -9.80665]))),
        "friction": end_of(replace(PAPER, leg_viscous_friction=1.0)),
    }
    for name, pose in others.items():
        change = np.abs(pose - end)
        assert readings[name]["position_change"] == pytest.approx(change[:3].max(), rel=2e-3), name
        assert readings[name]["orientation_change"] == pytest.approx(change[3:].max(), rel=2e-3), name
        assert readings[name]["height"] == pytest.approx(pose[2], abs=1e-5), name
    # joints 15° beside 60°, 180° and 300°, in the printed order, are those of a singular platform
    assert readings["alike"]["position_change"] is None
    assert readings["alike"]["remark"].startswith("impossible: ")
    moving = Rotation.from_euler("xyz", end[3:]).as_euler("XYZ")
    assert readings["axes"]["orientation_change"] == pytest.approx(np.abs(moving - end[3:]).max(), rel=1e-4)
    assert readings["axes"]["position_change"] == 0
    assert [readings[name]["other"] for name in ("far", "order", "g")] == [
        "60° away, alternately + and −", "− first", "9.80665 m/s²",
    ]  # fmt: skip


def test_the_published_forces_are_those_of_the_whole_weight(published: dict[str, Any]) -> None:
    """Expected by hand: L = √(14 − 2√3); share 28 g L/18; moments about the base joints for what one leg holds."""
    L = np.sqrt(14 - 2 * np.sqrt(3))
    held = 2 * 0.4144 + (L - 0.4144)
    vertical = 98.1 / 6 + 9.81 * 9 / L**2 + held / L * 9.81 * (1 - 9 / L**2)
    assert published["published_forces"] == {
        "static_leg_force": pytest.approx(vertical * L / 3, rel=1e-12),
        "share_of_total_weight": pytest.approx(28 * 9.81 * L / 18, rel=1e-12),
    }


# A text to the figures and to the page, in any script.
NAME = "a [red]b[/nope] $\\frac{c$ <b> 台"


@pytest.fixture(scope="module")
def uneven() -> tuple[gs.Platform, Any, list[Figure]]:
    """A short-legged, uneven platform with friction, and its figures as they were drawn."""
    platform = replace(UNEVEN, name=NAME)
    with figures_drawn() as figures:
        found = gs.reproduce(platform, page=True)
    return platform, found, figures


def test_a_platform_of_ones_own_has_all_files_and_numbers(
    uneven: tuple[gs.Platform, Any, list[Figure]], tmp_path: Path
) -> None:
    """Expected: numbers of open_loop.csv, by formulas: condition number, work by trapezoids, friction by its law."""
    platform, found, _ = uneven
    names = ["open_loop.csv", *(f"figure-{k}.png" for k in (4, 5, 6, 7)), "drift.png", "comparison.json",
             "gough_stewart_fmi2.fmu", "gough_stewart_fmi3.fmu", "report.html"]  # fmt: skip
    assert list(found.files) == names
    assert found.agrees
    report = found.report
    assert len(report["agreement"]) == len(COMPARED)
    assert json.loads(found.files["comparison.json"]) == report
    assert (report["readings"], report["published_forces"]) == ([], None)
    case, record = report["case"], found.record
    assert (case["platform"], case["source"]) == (NAME, platform.source)
    assert record.metadata["duration"] == record.metadata["outcome"]["time"] == case["duration"]
    assert record["actuator_force"].tolist() == [case["actuator_force"]] * 101
    table = polars.read_csv(found.files["open_loop.csv"])

    def column(name: str, n: int) -> FloatArray:
        return table.select([f"{name}[{k}]" for k in range(1, n + 1)]).to_numpy()

    position, orientation, rate = column("position", 3), column("orientation", 3), column("leg_velocity", 6)
    end = report["result"]["end"]
    assert (end["position"], end["orientation"]) == (position[-1].tolist(), orientation[-1].tolist())
    assert end["angular_velocity"] == column("angular_velocity", 3)[-1].tolist()
    assert report["result"]["leg_length_end"] == column("leg_length", 6)[-1].tolist()
    rho = np.array([1, 1, 1, *[np.sqrt((platform.platform_points**2).sum() / 6)] * 3])
    poses = zip(position, orientation, strict=True)
    largest = max(np.linalg.cond(gs.leg_jacobian(platform, x, angles) / rho) for x, angles in poses)
    assert report["result"]["largest_condition_number"] == pytest.approx(largest, rel=1e-9)
    work = np.trapezoid(rate @ report["case"]["actuator_force"], table["time"])
    assert report["result"]["actuator_work"] == pytest.approx(work, rel=1e-3)
    force = platform.leg_viscous_friction * platform.leg_viscous_friction_factor * rate
    slip = np.tanh(rate / platform.leg_friction_velocity)
    force = force + platform.leg_coulomb_friction * platform.leg_coulomb_friction_factor * slip
    lost = np.trapezoid((force * rate).sum(axis=1), table["time"])
    assert report["result"]["friction_work"] == pytest.approx(lost, rel=2e-3)
    drift = report["drift"]
    assert list(drift) == [f"{b}, rtol {t}" for t in ("1e-3", "1e-6")
                           for b in ("without Baumgarte", "Baumgarte α = β = 10/s")]  # fmt: skip
    assert drift["without Baumgarte, rtol 1e-3"]["steps"] < drift["without Baumgarte, rtol 1e-6"]["steps"]
    gaps = [each["closure_gap_end"] for each in drift.values()]
    assert gaps[0] > max(gaps[1:])
    (title,), (main,) = (elements(found.files["report.html"], path) for path in ("//head/title/text()", "//main"))
    assert NAME in title
    text = " ".join(main.text_content().split())
    assert [row["what"] for row in report["agreement"] if row["what"] not in text] == []
    assert repr(found).startswith(f"<Reproduction: {len(COMPARED)} of {len(COMPARED)} comparisons within their bounds")
    assert found.save(tmp_path / "out") == [tmp_path / "out" / name for name in names]
    assert {each.name: each.read_bytes() for each in (tmp_path / "out").iterdir()} == found.files


def test_figures_show_each_number_under_its_name(uneven: tuple[gs.Platform, Any, list[Figure]]) -> None:
    """Expected: columns of open_loop.csv; of the drift, a curve for each run on logarithmic axes, which end as told."""
    _, found, figures = uneven
    table = polars.read_csv(found.files["open_loop.csv"])
    shown: list[tuple[str, dict[str, tuple[str, tuple[str, ...]]]]] = [
        ("Fig. 4 — Position", {"position of Op": ("position", ("x", "y", "z")),
                               "roll, pitch, yaw": ("orientation", ("roll α", "pitch β", "yaw γ"))}),
        ("Fig. 5 — Linear", {"velocity of Op": ("velocity", ("v_x", "v_y", "v_z")),
                             "angular velocity, world": ("angular_velocity", ("ω_x", "ω_y", "ω_z"))}),
        ("Fig. 6 — The length", {"leg length": ("leg_length", LEGS)}),
        ("Fig. 7 — Sliding", {"sliding velocity": ("leg_velocity", LEGS)}),
    ]  # fmt: skip
    *pictures, drift = figures
    for figure, (title, panels) in zip(pictures, shown, strict=True):
        assert figure.get_suptitle().startswith(title)
        assert figure.get_suptitle().replace("\n", " ").endswith(f"({NAME})")
        for axes, (what, (name, labels)) in zip(figure.axes, panels.items(), strict=True):
            assert (axes.get_ylabel().partition(" [")[0], axes.get_xlabel()) == (what, "time [s]")
            lines = axes.get_lines()
            assert tuple(line.get_label() for line in lines) == labels
            assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == len(labels)
            for k, line in enumerate(lines, 1):
                x, y = data_of(line)
                np.testing.assert_allclose([x, y], [table["time"], table[f"{name}[{k}]"]], rtol=1e-12)
    ends = found.report["drift"]
    for axes, unit, key in zip(drift.axes, ("[m]", "[m/s, rad/s]"), ("closure_gap_end", "slip_end"), strict=True):
        assert (axes.get_ylabel()[-len(unit) :], axes.get_yscale()) == (unit, "log")
        assert [line.get_label() for line in axes.get_lines()] == list(ends)
        for line, numbers in zip(axes.get_lines(), ends.values(), strict=True):
            x, y = data_of(line)
            # without the consistent start, which a logarithmic axis cannot show
            assert (len(x), y[-1]) == (numbers["steps"], numbers[key])


@pytest.fixture(scope="module")
def made_up(uneven: tuple[gs.Platform, Any, list[Figure]]) -> dict[str, Any]:
    """A report with round numbers, no two alike."""
    start = {"position": [0.12, -0.09, 2.97], "orientation": [0.09, -0.14, 0.21], "velocity": [0.21, -0.13, 0.08],
             "angular_velocity": [-0.11, 0.17, 0.26]}  # fmt: skip
    end = {"position": [0.1, -0.2, 3.25], "orientation": [-0.0, 0.5, 0.625], "velocity": [1.0, 2.0, 3.0],
           "angular_velocity": [4.0, 5.0, 6.0]}  # fmt: skip
    rows = [{"what": "first", "measured": 2.5e-9, "bound": 1e-8, "unit": "m, rad", "holds": True},
            {"what": "second", "measured": 3.4e-5, "bound": 2e-6, "unit": "relative", "holds": False}]  # fmt: skip
    keys = ("point", "decided", "other", "position_change", "orientation_change", "remark", "height")
    readings = [("a point", "decided so", "other way", 0.01234, 0.56789, "a remark", 3.125),
                ("another", "thus", "not thus", None, None, "impossible: why", None)]  # fmt: skip
    content: dict[str, Any] = uneven[1].report
    return {
        **content,
        "case": {**content["case"], "title": "uneven *case*", "duration": 0.3, "start": start,
                 "actuator_force": [52.0, 38.0, 47.0, 44.0, 58.0, 41.0]},
        "result": {**content["result"], "end": end, "leg_length_end": [3.1, 3.2, 3.3, 3.4, 3.5, 3.6]},
        "agreement": rows,
        "drift": {"loose": {"steps": 3, "closure_gap_end": 2e-5, "slip_end": 5e-4},
                  "tight": {"steps": 2, "closure_gap_end": 7e-8, "slip_end": 1e-7}},
        "readings": [dict(zip(keys, reading, strict=True)) for reading in readings],
        "published_forces": {"static_leg_force": 44.125, "share_of_total_weight": 49.534},
    }  # fmt: skip


def test_tables_have_every_number(uneven: tuple[gs.Platform, Any, list[Figure]], made_up: dict[str, Any]) -> None:
    """Expected: written out."""
    made = replace(uneven[1], report=made_up)
    assert not made.agrees
    document = made.document(charts=False)
    motion, agreed, drift, other = tables_of(document).values()
    assert motion.title == "Uneven *case*"
    case, end = made_up["case"]["start"], made_up["result"]["end"]
    values = [(x, y) for name in case for x, y in zip(case[name], end[name], strict=True)]
    assert [(row[1].value, row[2].value) for row in motion.rows] == values
    assert [row[0] for row in motion.rows][:7] == ["x", "y", "z", "roll", "pitch", "yaw", "velocity, x"]
    assert motion.columns[2].name == "after 0.3 s"
    assert agreed.rows == (("first", 2.5e-9, 1e-8, "m, rad", "ok"), ("second", 3.4e-5, 2e-6, "relative", "MISSED"))
    assert drift.rows == (("loose", 2e-5, 5e-4), ("tight", 7e-8, 1e-7))
    assert other.rows == (
        ("a point: decided so", "other way", 3.125, 0.01234, 0.56789), ("another: thus", "not thus", None, None, None),
    )  # fmt: skip
    assert [column.quantity.unit for column in other.columns[2:]] == ["m", "m", "deg"]
    assert [row[1].quantity.unit for row in motion.rows[::3]] == ["m", "deg", "m/s", "deg/s"]
    assert motion.group_ends == (2, 5, 8)
    bound = document.number("agreement.2")
    assert (bound.limit, bound.margin) == (2e-6, pytest.approx(2e-6 - 3.4e-5))
    found = [document.number(f"case.{name}").value for name in ("height.start", "height.end", "leg_length.end")]
    assert found == [2.97, 3.25, 3.6]
    assert document.lead.endswith("constant forces for 0.3 s")
    weight, end_of_motion = (note.text for note in document.notes)
    assert re.search(r"holds 44\.12 N \(.* all bodies, 49\.53 N\. So", weight)
    assert end_of_motion.endswith("the longest leg ends at 3.6 m.")
    assert len(tables_of(uneven[1].document(charts=False))) == 3
    assert {chart.group for chart in uneven[1].document().charts}


def test_the_verdict_says_how_far_the_platform_moves_in_every_reading(
    uneven: tuple[gs.Platform, Any, list[Figure]], made_up: dict[str, Any]
) -> None:
    """Expected: heights and forces of the content; a reading that cannot run does not count; one that sinks does."""

    def verdict(**parts: Any) -> Any:
        return replace(uneven[1], report={**made_up, **parts}).document(charts=False).verdict

    assert verdict().text == (
        "Under the published forces the platform rises from 2.97 m to 3.25 m in 0.3 s, in every reading of the scan "
        "that is possible (3.12 to 3.12 m); they are 38 and 58 N where 44.1 N would hold it; 1 of 2 "
        "comparisons of the formulations and FMUs are within their bounds"
    )
    assert verdict().status == "bad"
    start, end = verdict().numbers
    assert (start.value, end.low, end.high) == (2.97, 3.125, 3.125)
    sinks = {**made_up["readings"][0], "height": 2.5}
    text = verdict(readings=[*made_up["readings"], sinks]).text
    assert "in 1 of 2 readings of the scan that is possible (2.5 to 3.12 m)" in text
    low = {**made_up["result"], "end": {**made_up["result"]["end"], "position": [0.1, -0.2, 2.5]}}
    assert "the platform sinks from 2.97 m to 2.5 m in 0.3 s" in verdict(result=low).text
    bare = verdict(readings=[], published_forces=None, agreement=made_up["agreement"][:1])
    assert bare.text == (
        "Under the constant forces of the case the platform rises from 2.97 m to 3.25 m in 0.3 s; all comparisons of "
        "the formulations and FMUs are within their bounds"
    )
    assert bare.status == "good"

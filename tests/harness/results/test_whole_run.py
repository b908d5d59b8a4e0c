"""All that is said of one run, number by number: metrics, files, tables and pictures of an uneven machine in trouble.

Legs reach their force, rate, stroke, velocity and power limits, other ones at other times; all six axes step, no two
alike; the machine is not the nominal one.
"""

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from lxml import html
from typer.testing import Result

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.drawn_figures import drawn
from tests.support.metric_definitions import defined_metrics, same_to_rounding
from tests.support.orientations import rotation_vectors
from tests.support.uneven import UNEVEN

MACHINE = replace(
    UNEVEN,
    leg_length_min=2.6,
    leg_length_max=3.44,
    leg_velocity_max=0.25,
    actuator_force_max=90.0,
    actuator_power_max=20.0,
)
TOML = """
title = "in trouble"
[platform]
file = "uneven.toml"
[plant]
parameters = { platform_mass = 13.9, platform_com = [0.02, -0.07, 0.11] }
[reference]
type = "point_to_point"
position_change = [0.061, -0.047, 0.083]
orientation_change = [0.071, -0.064, 0.095]
at = 0.12
duration = 0.2
[controller]
type = "pid"
proportional_gain = [1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0]
derivative_gain = [110.0, 140.0, 95.0, 125.0, 150.0, 105.0]
integral_gain = [900.0, 1500.0, 700.0, 1100.0, 2000.0, 800.0]
feedforward = "gravity"
[loop]
duration = 0.8
sample_time = 0.005
plant_step = 0.0025
delay = 1
[sensors.noise]
leg_length = "0.3 mm"
[actuators]
force_limit = 88.0
rate_limit = 900.0
[limits]
reference = "warn"
position_error = 10.0
[[disturbance]]
at = 0.06
duration = 0.05
force = [40.0, -30.0, 55.0]
torque = [9.0, -7.0, 5.0]
"""
POSE = ("position", "orientation")
# A quarter of a point of a panel 100 points high.
SEEN = 2.5e-3


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    """The command, and its files."""
    folder = tmp_path_factory.mktemp("whole")
    gs.save_platform(MACHINE, folder / "uneven.toml")
    (folder / "trouble.toml").write_text(TOML)
    out = folder / "out"
    return invoke("run", str(folder / "trouble.toml"), "--out", str(out)), out


@pytest.fixture(scope="module")
def record(done: tuple[Result, Path]) -> gs.Record:
    """The record that the command has written."""
    return gs.read_record(done[1])


@pytest.fixture(scope="module")
def expected(record: gs.Record) -> dict[str, Any]:
    """Its metrics by definition."""
    return defined_metrics(record.table, MACHINE.as_dict())


# --- metrics ---------------------------------------------------------------------------------------------------------


def test_the_run_is_one_in_which_much_happens(expected: dict[str, Any]) -> None:
    """A number that is the same for all legs, or 0, would hide what is wrong with it: here it is seldom so."""
    assert [step["axis"] for step in expected["step_response"]] == ["x", "y", "z", "roll", "pitch", "yaw"]
    assert {step["rise_time"] is None for step in expected["step_response"]} == {True, False}
    assert len({step["overshoot_percent"] for step in expected["step_response"]}) >= 5
    for name in ("force_limited", "rate_limited"):
        share = expected["saturation"][name]
        assert len(set(share["legs"])) >= 5
        assert max(share["legs"]) < share["any"] < 1
    assert 0 < expected["stroke"]["exceeded"]["any"] < 1
    assert expected["stroke"]["margin"] < 0
    beyond = [expected["limits"][name]["first_exceeded"] for name in ("leg_velocity_max", "actuator_power_max")]
    assert beyond[0] != beyond[1]
    assert None in expected["limits"]["actuator_force_max"]["first_exceeded"]


def test_all_metrics_are_their_definitions(
    done: tuple[Result, Path], record: gs.Record, expected: dict[str, Any]
) -> None:
    """Expected: plain loops over the rows, by the words of `gs.metrics`, of the record and of the file of metrics."""
    written = json.loads((done[1] / "metrics.json").read_text())
    for found in (dict(gs.metrics(record)), written):
        outcome = found.pop("outcome")
        assert {key: outcome[key] for key in ("status", "time", "cause")} == {
            "status": "completed",
            "time": 0.8,
            "cause": None,
        }
        same_to_rounding(found, expected)


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 2), slice(37, 120), slice(150, None)])
def test_metrics_of_a_record_that_starts_at_another_time_and_place(record: gs.Record, rows: slice) -> None:
    """Expected: the definitions, on parts of the rows from 7.3 s on: one row, two, the middle, the end.

    They are shorter than the run was to be, so that none has an error at its end.
    """
    later = record.table[rows].with_columns(polars.col("time") + 7.3)
    found = dict(gs.metrics(gs.Record(later, record.metadata)))
    found.pop("outcome")
    same_to_rounding(found, defined_metrics(later, MACHINE.as_dict(), is_whole=False))


def test_each_row_has_the_legs_and_the_feedforward_of_its_own_reference(record: gs.Record) -> None:
    """Expected: the nominal platform's lengths and J [v; ω] along a reference that rests, moves and rests again.

    The feedforward holds the pose half a sample and the delay later: at rest, that of the row.
    """
    pose = (record["reference.position"], record["reference.orientation"])
    assert record["reference.leg_length"] == pytest.approx(gs.leg_geometry(MACHINE, *pose).length, rel=1e-13)
    twist = np.hstack([record["reference.velocity"], record["reference.angular_velocity"]])
    rates = (gs.leg_jacobian(MACHINE, *pose) @ twist[..., None])[..., 0]
    assert record["reference.leg_velocity"] == pytest.approx(rates, rel=1e-12, abs=1e-13)
    rest = np.r_[0:40, 140:321]
    held = gs.static_leg_forces(MACHINE, pose[0][rest], pose[1][rest])
    assert record["controller.feedforward"][rest] == pytest.approx(held, rel=1e-12)
    assert np.ptp(held, axis=0).min() > 0.1


# --- files -----------------------------------------------------------------------------------------------------------


def test_both_files_hold_all_columns_and_the_same_bits(done: tuple[Result, Path], record: gs.Record) -> None:
    """Expected: the table of the CSV, which stands for itself, with units and names of the interface."""
    rows = list(csv.reader((done[1] / "record.csv").read_text().splitlines()))
    names, first, last = (rows[k] for k in (0, 1, -1))
    assert names == record.table.columns
    assert len(rows) - 1 == record.table.height == 321
    for row, k in ((first, 0), (last, -1)):
        for name, cell in zip(names, row, strict=True):
            value = record[name][k]
            assert (cell == str(bool(value)).lower()) if name.startswith("flag.") else (float(cell) == value), name
    assert gs.read_record(done[1] / "record.csv").table.equals(record.table)
    assert gs.read_record(done[1] / "record.parquet").metadata == json.loads((done[1] / "metadata.json").read_text())


def test_a_record_says_what_it_is(record: gs.Record, expected: dict[str, Any]) -> None:
    """Expected: the peaks by definition, in mm and degrees; times of the first and last row."""
    later = gs.Record(record.table.with_columns(polars.col("time") + 7.3), record.metadata)
    lines = dict(re.split(r"\s{2,}", line.strip()) for line in repr(later).splitlines()[1:])
    assert repr(later).splitlines()[0] == "Record: in trouble"
    peaks = {
        name: (180 / np.pi if name == "orientation" else 1e3) * max(expected["tracking"][name]["peak"])
        for name in (*POSE, "leg_length")
    }
    assert lines == {
        "platform": "uneven",
        "plant": "model",
        "outcome": "completed at 0.8 s",
        "table": f"321 rows, {len(record.table.columns)} columns",
        "time": "7.3 to 8.1 s",
        "peak error of position": f"{peaks['position']:.4g} mm",
        "peak error of orientation": f"{peaks['orientation']:.4g} deg",
        "peak error of leg length": f"{peaks['leg_length']:.4g} mm",
    }
    captions = [str(each.text) for each in html.fragment_fromstring(later._repr_html_()).iter("caption")]
    assert captions == ["Record: in trouble", "Tracking error", "Step response", "Legs"]


# --- tables ----------------------------------------------------------------------------------------------------------


def tables_in(text: str) -> dict[str, dict[str, list[str]]]:
    """Rows by their first cell, by title; the heads are the row ""."""
    found: dict[str, dict[str, list[str]]] = {}
    title = ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split("[│┃]", line)[1:-1]]
        if cells:
            found.setdefault(title, {})[cells[0]] = cells[1:]
        elif line and line[0] not in "┏┡└├":
            title = line.strip()
    return found


SHOWN_AS = {"mm": 1e3, "deg": 180 / np.pi}


def values_in(cells: Sequence[str]) -> list[float | None]:
    return [None if cell == "–" else float(cell) for cell in cells]


def by_unit(scale: float, values: Sequence[float | None]) -> list[Any]:
    """As shown: four digits, None where there is none."""
    return [None if value is None else pytest.approx(scale * value, rel=6e-4, abs=1e-9) for value in values]


def test_the_command_prints_every_number_at_its_place_in_its_unit(
    done: tuple[Result, Path], record: gs.Record, expected: dict[str, Any]
) -> None:
    """Expected: the definitions, in mm, degrees, % and SI units, to four digits."""
    assert done[0].exit_code == 0, done[0].output
    tables = tables_in(done[0].stdout)
    assert list(tables)[:3] == ["Tracking error", "Step response", "Legs"]
    tracking, steps, legs = (dict(tables[name]) for name in list(tables)[:3])
    assert tracking.pop("") == ["RMS", "peak", "at the end"]
    for name, unit, rows in (
        ("position", "mm", ("x", "y", "z", "|position|")),
        ("orientation", "deg", ("roll", "pitch", "yaw", "|orientation|")),
    ):
        part = expected["tracking"][name]
        pairs = [
            *zip(part["rms"], part["peak"], strict=True),
            (part["norm_rms"], part["norm_peak"], part["norm_final"]),
        ]
        for row, pair in zip(rows, pairs, strict=True):
            cells = tracking.pop(f"{row} {unit}")
            assert values_in(cells[: len(pair)]) == by_unit(SHOWN_AS[unit], pair)
    assert not tracking
    assert steps.pop("") == ["from", "to", "at [s]", "overshoot [%]", "rise [s]", "settling [s]", "final error"]
    for step in expected["step_response"]:
        is_length = step["axis"] in "xyz"
        *cells, error = steps.pop(step["axis"])
        keys = ("at", "overshoot_percent", "rise_time", "settling_time")
        assert values_in(cells[2:]) == by_unit(1.0, [step[key] for key in keys])
        units = ("m", "mm") if is_length else ("deg", "deg")
        scales = (1.0, 1e3) if is_length else (180 / np.pi, 180 / np.pi)
        shown = zip((*cells[:2], error), ("from", "to", "final_error"), (0, 0, 1), strict=True)
        for cell, key, kind in shown:
            number, unit = cell.split()
            assert unit == units[kind]
            assert float(number) == pytest.approx(scales[kind] * step[key], rel=6e-4)
    assert not steps
    check_legs(legs, expected)
    printed = tables_in(str(gs.metrics(record)))
    assert values_in(printed["Legs"]["peak force N"][:6]) == by_unit(1.0, expected["force"]["peak"])[:6]


def check_legs(legs: dict[str, list[str]], expected: dict[str, Any]) -> None:
    """Every row of the legs' table, and no other."""
    assert legs.pop("") == ["1", "2", "3", "4", "5", "6", "all"]
    tracking, stroke, limits = expected["tracking"]["leg_length"], expected["stroke"], expected["limits"]
    rows: dict[str, tuple[float, Sequence[float | None], float | None]] = {
        "RMS error mm": (1e3, tracking["rms"], None),
        "peak error mm": (1e3, tracking["peak"], None),
        "shortest m": (1.0, stroke["shortest"], None),
        "longest m": (1.0, stroke["longest"], None),
        "peak force N": (1.0, expected["force"]["peak"], None),
        "RMS force N": (1.0, expected["force"]["rms"], None),
        "peak power W": (1.0, expected["power"]["peak"], None),
        "mean power W": (1.0, expected["power"]["mean"], None),
        "net work J": (1.0, expected["energy"]["net"], expected["energy"]["net_total"]),
        "work, absolute J": (1.0, expected["energy"]["absolute"], expected["energy"]["absolute_total"]),
        "leg velocity, of its limit %": (100.0, limits["leg_velocity_max"]["used"], None),
        "leg velocity, first beyond s": (1.0, limits["leg_velocity_max"]["first_exceeded"], None),
        "actuator force, of its limit %": (100.0, limits["actuator_force_max"]["used"], None),
        "actuator power, of its limit %": (100.0, limits["actuator_power_max"]["used"], None),
        "actuator power, first beyond s": (1.0, limits["actuator_power_max"]["first_exceeded"], None),
        "force limited %": (
            100.0,
            expected["saturation"]["force_limited"]["legs"],
            100 * expected["saturation"]["force_limited"]["any"],
        ),
        "rate limited %": (
            100.0,
            expected["saturation"]["rate_limited"]["legs"],
            100 * expected["saturation"]["rate_limited"]["any"],
        ),
        "stroke exceeded %": (100.0, stroke["exceeded"]["legs"], 100 * stroke["exceeded"]["any"]),
    }
    assert list(legs) == list(rows)
    for name, (scale, values, total) in rows.items():
        assert values_in(legs[name][:6]) == by_unit(scale, values), name
        assert legs[name][6] == "" if total is None else float(legs[name][6]) == pytest.approx(total, rel=6e-4), name


def test_a_notebook_shows_the_same_cells(done: tuple[Result, Path], record: gs.Record) -> None:
    """Expected: the tables of the command, row by row."""
    shown = {}
    for table in html.fragment_fromstring(gs.metrics(record)._repr_html_(), create_parent="div").iter("table"):
        rows = [[str(cell.text_content()) for cell in row.iterchildren()] for row in table.iter("tr")]
        caption = table.find("caption")
        assert caption is not None
        shown[str(caption.text)] = {row[0]: row[1:] for row in rows}
    printed = tables_in(done[0].stdout)
    assert shown == {name: printed[name] for name in shown}
    assert len(shown) == 3


# Words, unit and factor of paths of every kind, shown anywhere.
NAMED = {
    "tracking.position.norm_rms": ("position error, RMS", "mm", 1e3),
    "tracking.position.norm_peak": ("position error, peak", "mm", 1e3),
    "tracking.position.norm_final": ("position error, at the end", "mm", 1e3),
    "tracking.orientation.norm_peak": ("orientation error, peak", "deg", 180 / np.pi),
    "tracking.leg_length.rms": ("leg error, RMS", "mm", 1e3),
    "step_response.yaw.to": ("yaw: to", "deg", 180 / np.pi),
    "step_response.z.at": ("z: step at", "s", 1.0),
    "step_response.roll.overshoot_percent": ("roll: overshoot", "%", 1.0),
    "step_response.pitch.settling_time": ("pitch: settling time", "s", 1.0),
    "step_response.pitch.final_error": ("pitch: final error", "deg", 180 / np.pi),
    "force.peak": ("peak force", "N", 1.0),
    "power.peak": ("peak power", "W", 1.0),
    "energy.absolute_total": ("work, absolute", "J", 1.0),
    "energy.net": ("work of a leg, net", "J", 1.0),
    "saturation.rate_limited.legs": ("rate limited, a leg", "%", 100.0),
    "stroke.margin": ("stroke margin", "mm", 1e3),
    "stroke.exceeded.any": ("beyond stroke", "%", 100.0),
    "stroke.shortest": ("shortest leg", "mm", 1e3),
    "limits.leg_velocity_max.used": ("leg velocity, of its limit", "%", 100.0),
    "limits.actuator_force_max.limit": ("limit of actuator force", "N", 1.0),
}


def test_each_metric_has_its_words_unit_and_factor(record: gs.Record) -> None:
    """Expected: the table above; of all others a text, a sentence, and a value of `gs.metrics`."""
    numbers = {number.path: number for number in record.report(charts=False).numbers}
    for path, (text, unit, factor) in NAMED.items():
        number = numbers[path]
        assert (number.name, number.quantity.unit, number.quantity.factor) == (text, unit, factor)
    assert all(number.name and number.explanation for number in numbers.values())


# --- pictures --------------------------------------------------------------------------------------------------------


def test_figures_show_the_columns_of_the_record_with_their_limits(record: gs.Record) -> None:
    """Expected: every line of the four figures is a column in the unit of its title; limits where they were set."""
    figures = drawn(record.report())
    assert list(figures) == ["errors", "pose", "actuators", "legs"]
    assert [axes.get_title() for axes in figures["errors"]] == ["position error [mm]", "orientation error [deg]"]
    for axes, name, scale in zip(figures["errors"], POSE, (1e3, degrees(1)), strict=True):
        for k, line in enumerate(axes.lines):
            assert np.allclose(line.get_xdata(), record["time"])
            assert np.allclose(line.get_ydata(), scale * record[f"error.{name}"][:, k])
    home = (MACHINE.home_position, MACHINE.home_orientation)
    for k, axes in enumerate(figures["pose"]):
        name, scale = (POSE[0], 1e3) if k < 3 else (POSE[1], degrees(1))
        assert axes.get_title().endswith("[mm]" if k < 3 else "[deg]")
        for line, column in zip(axes.lines, (name, f"reference.{name}"), strict=True):
            change = record[column] - home[0] if k < 3 else rotation_vectors(home[1], record[column])
            assert np.allclose(line.get_ydata(), scale * change[:, k % 3], atol=1e-9)
    (forces,) = figures["actuators"]
    lines, limits = forces.lines[:-2], [float(line.get_ydata()[0]) for line in forces.lines[-2:]]
    assert sorted(limits) == [-88, 88]
    assert len(lines) == 6
    for k, line in enumerate(lines):
        assert line.get_drawstyle() == "steps-post"
        assert np.allclose(line.get_ydata(), record["actuator_force"][:, k])
    for k, axes in enumerate(figures["legs"]):
        actual, reference, *limit_lines = axes.lines
        assert np.allclose(actual.get_ydata(), record["leg_length"][:, k])
        assert np.allclose(reference.get_ydata(), record["reference.leg_length"][:, k])
        values = np.concatenate([actual.get_ydata(), reference.get_ydata()])
        # with 5 % of room on both sides; farther limits would flatten the lines
        low, high, span = values.min(), values.max(), 1.1 * np.ptp(values)
        near = [limit for limit in (2.6, 3.44) if low - 2.05 * span < limit < high + 2.05 * span]
        assert [float(line.get_ydata()[0]) for line in limit_lines] == near

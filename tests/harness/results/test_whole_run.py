"""All that is said of one run, number by number: metrics, files, tables and pictures of an uneven machine in trouble.

Legs reach their force, rate, stroke, velocity and power limits, other ones at other times; all six axes step, no two
alike; the machine is not the nominal one.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import Result, invoke
from tests.support.metric_definitions import defined_metrics, same_to_rounding
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


def test_the_file_of_metrics_has_them_by_their_definitions(
    done: tuple[Result, Path], record: gs.Record, expected: dict[str, Any]
) -> None:
    """Expected: plain loops over the rows, by the words of `gs.metrics`."""
    written = json.loads((done[1] / "metrics.json").read_text())
    assert written == gs.metrics(record)
    outcome = written.pop("outcome")
    assert [outcome[key] for key in ("status", "time", "cause")] == ["completed", 0.8, None]
    same_to_rounding(written, expected)


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
        norms = tuple(part[f"norm_{kind}"] for kind in ("rms", "peak", "final"))
        pairs = [*zip(part["rms"], part["peak"], strict=True), norms]
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
        **{
            f"{name} limited %": (100.0, share["legs"], 100 * share["any"])
            for name in ("force", "rate")
            for share in [expected["saturation"][f"{name}_limited"]]
        },
        "stroke exceeded %": (100.0, stroke["exceeded"]["legs"], 100 * stroke["exceeded"]["any"]),
    }
    assert list(legs) == list(rows)
    for name, (scale, values, total) in rows.items():
        assert values_in(legs[name][:6]) == by_unit(scale, values), name
        assert legs[name][6] == "" if total is None else float(legs[name][6]) == pytest.approx(total, rel=6e-4), name


# Words, unit and factor of paths of every kind, shown anywhere.
NAMED = {
    "tracking.position.norm_final": ("position error, at the end", "mm", 1e3),
    "tracking.orientation.norm_peak": ("orientation error, peak", "deg", 180 / np.pi),
    "tracking.leg_length.rms": ("leg error, RMS", "mm", 1e3),
    "step_response.yaw.to": ("yaw: to", "deg", 180 / np.pi),
    "step_response.roll.overshoot_percent": ("roll: overshoot", "%", 1.0),
    "step_response.pitch.final_error": ("pitch: final error", "deg", 180 / np.pi),
    "power.peak": ("peak power", "W", 1.0),
    "energy.net": ("work of a leg, net", "J", 1.0),
    "saturation.rate_limited.legs": ("rate limited, a leg", "%", 100.0),
    "stroke.margin": ("stroke margin", "mm", 1e3),
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

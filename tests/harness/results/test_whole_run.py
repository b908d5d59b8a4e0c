"""All that is said of one run, number by number, of an uneven machine whose legs reach different limits."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import Result, invoke
from tests.support.experiments import written
from tests.support.metric_definitions import defined_metrics, same_to_rounding
from tests.support.reports import parts_in, rows_in, units_in
from tests.support.uneven import PARAMETERS
from tests.support.uneven_loops import experiment_of

LIMITS = {"leg_length_min": 2.9, "leg_length_max": 3.44, "leg_velocity_max": 0.25, "actuator_power_max": 20.0}
LIMITS |= {"actuator_force_max": 90.0}
MOVES = {"position_change": [0.061, -0.047, 0.083], "orientation_change": [0.071, -0.064, 0.095]}
TROUBLE = experiment_of(
    "pid",
    platform={"preset": "liu2000", "parameters": PARAMETERS | LIMITS},
    reference={"type": "point_to_point", **MOVES, "at": 0.12, "duration": 0.2},
    loop={"duration": 0.8, "sample_time": 5e-3, "plant_step": 2.5e-3, "delay": 1},
    sensors={"noise": {"leg_length": "0.3 mm"}},
    actuators={"force_limit": 88.0, "rate_limit": 900.0},
    limits={"reference": "warn", "position_error": 10.0},
    disturbance=[{"at": 0.06, "duration": 0.05, "force": [40.0, -30.0, 55.0], "torque": [9.0, -7.0, 5.0]}],
)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Path]:
    folder = tmp_path_factory.mktemp("whole")
    out = folder / "out"
    return invoke("run", str(written(TROUBLE, folder / "trouble.toml")), "--out", str(out), "--json"), out


@pytest.fixture(scope="module")
def record(done: tuple[Result, Path]) -> gs.Record:
    return gs.read_record(done[1])


@pytest.fixture(scope="module")
def expected(record: gs.Record) -> dict[str, Any]:
    return defined_metrics(record.table, PARAMETERS | LIMITS)


def test_the_file_of_metrics_has_them_by_their_definitions(
    done: tuple[Result, Path], record: gs.Record, expected: dict[str, Any]
) -> None:
    """Expected: plain loops over the rows, by the words of `gs.metrics`."""
    written = json.loads((done[1] / "metrics.json").read_text())
    assert written == gs.metrics(record)
    outcome = written.pop("outcome")
    assert [outcome[key] for key in ("status", "time", "cause")] == ["completed", 0.8, None]
    same_to_rounding(written, expected)


def check(data: dict[str, Any], table: dict[str, Any], rows: dict[str, tuple[str, Sequence[Any]]]) -> None:
    """The rows of a table, and no other: units of display, and numbers in SI units."""
    found = rows_in(table)
    assert list(found) == list(rows)
    assert units_in(data, table) == {name: unit for name, (unit, _) in rows.items()}
    for name, (_, values) in rows.items():
        assert found[name] == pytest.approx(values), name


def test_tables_have_every_number_at_its_place_in_its_unit(done: tuple[Result, Path], expected: dict[str, Any]) -> None:
    """Expected: the definitions."""
    assert done[0].exit_code == 0, done[0].output
    data = json.loads(done[0].stdout)
    tables = parts_in(data, "table")[:3]
    assert [table["title"] for table in tables] == ["Tracking error", "Step response", "Legs"]
    heads = [[(column["name"], column.get("quantity", "")) for column in table["columns"]] for table in tables]
    assert heads[0] == [("", ""), ("RMS", ""), ("peak", ""), ("at the end", "")]
    numbers = [("at", "time"), ("overshoot", "percentage"), ("rise", "time"), ("settling", "time")]
    assert heads[1] == [("", ""), ("from", ""), ("to", ""), *numbers, ("final error", "")]
    assert heads[2] == [(name, "") for name in ("", *"123456", "all")]
    tracking: dict[str, tuple[str, Sequence[Any]]] = {}
    for name, unit, axes in (("position", "mm", ("x", "y", "z")), ("orientation", "deg", ("roll", "pitch", "yaw"))):
        part = expected["tracking"][name]
        tracking |= {axis: (unit, [part["rms"][k], part["peak"][k], ""]) for k, axis in enumerate(axes)}
        tracking[f"|{name}|"] = (unit, [part[f"norm_{kind}"] for kind in ("rms", "peak", "final")])
    check(data, tables[0], tracking)
    keys = ("from", "to", "at", "overshoot_percent", "rise_time", "settling_time", "final_error")
    steps = {each["axis"]: [each[key] for key in keys] for each in expected["step_response"]}
    check(data, tables[1], {axis: ("m" if axis in "xyz" else "deg", values) for axis, values in steps.items()})
    assert [row[-1]["quantity"] for row in tables[1]["rows"]] == ["length"] * 3 + ["angle"] * 3
    stroke, limits, saturation = (expected[name] for name in ("stroke", "limits", "saturation"))
    of_legs = {
        "RMS error": ("mm", expected["tracking"]["leg_length"]["rms"]),
        "peak error": ("mm", expected["tracking"]["leg_length"]["peak"]),
        "shortest": ("m", stroke["shortest"]),
        "longest": ("m", stroke["longest"]),
        "peak force": ("N", expected["force"]["peak"]),
        "RMS force": ("N", expected["force"]["rms"]),
        "peak power": ("W", expected["power"]["peak"]),
        "mean power": ("W", expected["power"]["mean"]),
        "net work": ("J", [*expected["energy"]["net"], expected["energy"]["net_total"]]),
        "work, absolute": ("J", [*expected["energy"]["absolute"], expected["energy"]["absolute_total"]]),
        "leg velocity, of its limit": ("%", limits["leg_velocity_max"]["used"]),
        "leg velocity, first beyond": ("s", limits["leg_velocity_max"]["first_exceeded"]),
        "actuator force, of its limit": ("%", limits["actuator_force_max"]["used"]),
        "actuator power, of its limit": ("%", limits["actuator_power_max"]["used"]),
        "actuator power, first beyond": ("s", limits["actuator_power_max"]["first_exceeded"]),
    }
    shares = {"force limited": saturation["force_limited"], "rate limited": saturation["rate_limited"]}
    for name, share in {**shares, "stroke exceeded": stroke["exceeded"]}.items():
        of_legs[name] = ("%", [*share["legs"], share["any"]])
    check(data, tables[2], {name: (unit, [*values, ""][:7]) for name, (unit, values) in of_legs.items()})


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

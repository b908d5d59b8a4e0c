"""Every pair of options of an experiment, against a loop written from the documentation."""

from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from allpairspy import AllPairs

import gough_stewart as gs
from gough_stewart.harness.experiment.file import experiment_from
from gough_stewart.model.platform import Platform
from gough_stewart.model.vectors import FloatArray
from tests.support.documented_loop import Documented, simulate
from tests.support.uneven import UNEVEN

DURATION, SAMPLE_TIME = 0.15, 0.005
# Six different gains, of legs and of axes.
LEG_GAINS = {
    "kp": [1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0],
    "kd": [110.0, 140.0, 95.0, 125.0, 150.0, 105.0],
    "ki": [900.0, 1500.0, 700.0, 1100.0, 2000.0, 800.0],
}
TASK_GAINS = {
    "kp": [6000.0, 7500.0, 9000.0, 5200.0, 4100.0, 3300.0],
    "kd": [520.0, 610.0, 700.0, 430.0, 390.0, 310.0],
    "ki": [5000.0, 8000.0, 9000.0, 4500.0, 3000.0, 2500.0],
}
ALONG = np.array([0.021, -0.017, 0.026, 0.031, -0.024, 0.035])
OPTIONS: dict[str, list[Any]] = {
    "type": ["pd", "pid"],
    "space": ["leg", "task"],
    "derivative_on": ["error", "measurement"],
    "derivative_filter": [None, 0.009],
    "discretisation": ["tustin", "backward_diff", "zoh"],
    "feedforward": ["none", "gravity", "computed_torque"],
    "anti_windup_time": [None, 0.06],
    "delay": [0, 1, 3],
    "plant_step": [SAMPLE_TIME, SAMPLE_TIME / 5],
    "sensor_time": [None, 2 * SAMPLE_TIME],
    "quantisation": [0.0, 4e-4],
    "force_limit": [np.inf, 76.0],
    "rate_limit": [np.inf, 900.0],
    "lag": [0.0, 0.012],
    "reference": ["sine", "point_to_point", "step"],
    "machine": ["as believed", "differs", "changes"],
    "disturbance": [False, True],
    "start": [False, True],
}
# No two of its rows share all of their options; every pair of two options' values is in one of them.
ROWS = [dict(zip(OPTIONS, row, strict=True)) for row in AllPairs(list(OPTIONS.values()))]
_MACHINE: dict[str, Any] = {
    "platform_mass": 13.9,
    "platform_com": [0.02, -0.07, 0.11],
    "leg_viscous_friction": 9.5,
    "gravity": [0.8, -1.1, -9.6],
}
_CHANGED: dict[str, Any] = {"platform_mass": 15.2, "platform_com": [-0.03, -0.02, 0.21]}
_CHANGE_AT, _FROM, _FOR = 0.05, 0.035, 0.06
_WRENCH = np.array([9.0, -14.0, 21.0, 3.0, -4.0, 6.0])


def _machine(kind: str, time: float) -> Platform:
    if kind == "as believed":
        return UNEVEN
    machine = replace(UNEVEN, **_MACHINE)
    if kind == "changes" and time > _CHANGE_AT - 1e-9:
        return replace(machine, **_CHANGED)
    return machine


def _wrench(time: float) -> FloatArray:
    return _WRENCH if _FROM - 1e-9 < time < _FROM + _FOR - 1e-9 else np.zeros(6)


def _expected(row: dict[str, Any]) -> Documented:
    options = {
        **row,
        **(TASK_GAINS if row["space"] == "task" else LEG_GAINS),
        "sample_time": SAMPLE_TIME,
        "duration": DURATION,
        "along": ALONG,
        "frequency": 2.3,
        "phase": 0.6,
        "at": 0.03,
        "move_duration": 0.11,
        "disturbance": _wrench if row["disturbance"] else lambda _time: np.zeros(6),
    }
    if row["type"] == "pd":
        options["ki"] = [0.0] * 6
    home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation])
    start = home + 0.3 * ALONG[::-1] if row["start"] else None
    return simulate(options, UNEVEN, lambda time: _machine(row["machine"], time), start)


def _recorded(row: dict[str, Any], folder: Path) -> gs.Record:
    gs.save_platform(UNEVEN, folder / "uneven.toml")
    gains = TASK_GAINS if row["space"] == "task" else LEG_GAINS
    controller = {
        "type": row["type"],
        "space": row["space"],
        "proportional_gain": gains["kp"],
        "derivative_gain": gains["kd"],
        "derivative_on": row["derivative_on"],
        "discretisation": row["discretisation"],
        "feedforward": row["feedforward"],
    }
    if row["derivative_filter"]:
        controller["derivative_filter"] = row["derivative_filter"]
    if row["type"] == "pid":
        controller["integral_gain"] = gains["ki"]
        if row["anti_windup_time"]:
            controller["anti_windup_time"] = row["anti_windup_time"]
    change = {"position_change": ALONG[:3].tolist(), "orientation_change": ALONG[3:].tolist()}
    swing = {"position_amplitude": ALONG[:3].tolist(), "orientation_amplitude": ALONG[3:].tolist()}
    reference = {
        "sine": {"type": "sine", **swing, "frequency": 2.3, "phase": 0.6},
        "point_to_point": {"type": "point_to_point", **change, "at": 0.03, "duration": 0.11},
        "step": {"type": "step", **change, "at": 0.03},
    }[row["reference"]]
    values: dict[str, Any] = {
        "title": "options together",
        "platform": {"file": "uneven.toml"},
        "plant": {"tolerance": 1e-11},
        "reference": reference,
        "controller": controller,
        "loop": {
            "duration": DURATION,
            "sample_time": SAMPLE_TIME,
            "plant_step": row["plant_step"],
            "delay": row["delay"],
        },
        "sensors": {"quantisation": {"leg_length": row["quantisation"]} if row["quantisation"] else {}},
        "actuators": {
            "force_limit": row["force_limit"] if np.isfinite(row["force_limit"]) else "none",
            "lag": row["lag"],
        },
        "limits": {"reference": "warn", "position_error": 10.0},
    }
    if row["sensor_time"]:
        values["sensors"]["sample_time"] = row["sensor_time"]
    if np.isfinite(row["rate_limit"]):
        values["actuators"]["rate_limit"] = row["rate_limit"]
    if row["machine"] != "as believed":
        values["plant"]["parameters"] = _MACHINE
    if row["machine"] == "changes":
        values["change"] = [{"at": _CHANGE_AT, "parameters": _CHANGED}]
    if row["disturbance"]:
        values["disturbance"] = [
            {"at": _FROM, "duration": _FOR, "force": _WRENCH[:3].tolist(), "torque": _WRENCH[3:].tolist()}
        ]
    if row["start"]:
        home = np.concatenate([UNEVEN.home_position, UNEVEN.home_orientation]) + 0.3 * ALONG[::-1]
        rest = [0.0, 0.0, 0.0]
        values["start"] = {
            "position": home[:3].tolist(),
            "orientation": home[3:].tolist(),
            "velocity": rest,
            "angular_velocity": rest,
        }
    return gs.run(experiment_from(values, "options").from_file("options", folder))


def _name(row: dict[str, Any]) -> str:
    return "-".join(str(value) for value in row.values())


@pytest.mark.parametrize("row", ROWS, ids=_name)
def test_every_pair_of_options_does_what_the_documentation_says(row: dict[str, Any], tmp_path: Path) -> None:
    """Expected: the loop written from docs/control.md around a Lagrangian's plant, without code of the harness."""
    record, expected = _recorded(row, tmp_path), _expected(row)
    assert record.metadata["outcome"]["status"] == "completed"
    pose = np.concatenate([record["position"], record["orientation"]], axis=1)
    np.testing.assert_allclose(record["controller.force"], expected.command, rtol=0, atol=2e-5)
    np.testing.assert_allclose(record["actuator_force"], expected.actuator_force, rtol=0, atol=2e-5)
    np.testing.assert_allclose(pose, expected.pose, rtol=0, atol=2e-8)
    np.testing.assert_allclose(record["leg_length"], expected.leg_length, rtol=0, atol=2e-8)


def test_every_pair_of_values_is_in_a_row() -> None:
    """Expected: counted; a library that leaves pairs out would make the test above smaller unseen."""
    names = list(OPTIONS)
    for a, b in combinations(names, 2):
        met = {(str(row[a]), str(row[b])) for row in ROWS}
        assert met == {(str(x), str(y)) for x, y in product(OPTIONS[a], OPTIONS[b])}


def test_the_limits_of_the_rows_are_reached(tmp_path: Path) -> None:
    """A row in which a limit is never active says nothing of it: most of those that have one reach it."""
    for name, flag in (("force_limit", "flag.force_limited"), ("rate_limit", "flag.rate_limited")):
        limited = [row for row in ROWS if np.isfinite(row[name])]
        reached = [bool(_recorded(row, tmp_path)[flag].any()) for row in limited]
        assert sum(reached) >= 0.7 * len(limited)
